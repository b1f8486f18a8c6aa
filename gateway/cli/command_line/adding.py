"""How a command is added to the command line: its name and help, and what several have in common."""

from __future__ import annotations

import argparse
import os
from pathlib import Path
from typing import Any

from gateway.cli.command_line.numbers import seconds

__all__ = ["add_client_command", "add_command", "add_take", "add_target", "add_yes", "file_to_write", "utf8_text"]


def add_command(commands: Any, name: str, text: str, more: str = "") -> argparse.ArgumentParser:  # noqa: ANN401  argparse's private class
    """Return the parser of a new command; `text` is its line in the list, `more` what its own help says on top."""
    sub: argparse.ArgumentParser = commands.add_parser(
        name,
        help=text,
        description=f"{text[0].upper()}{text[1:]}.{f' {more}' if more else ''}",
        allow_abbrev=False,
    )
    return sub


def add_client_command(
    commands: Any,  # noqa: ANN401  argparse's private class
    name: str,
    text: str,
    more: str = "",
    *,
    shows_json: bool = True,
    timeout_s: float = 5.0,
    timeout_of: str = "longest wait for the gateway",
) -> argparse.ArgumentParser:
    """Return the parser of a new command that talks to a gateway: it has its address, a timeout, and JSON."""
    sub = add_command(commands, name, text, more)
    add_target(sub)
    sub.add_argument(
        "--timeout",
        dest="timeout_s",
        type=seconds,
        default=timeout_s,
        metavar="S",
        help=f"{timeout_of} [s] (default {timeout_s:g})",
    )
    if shows_json:
        sub.add_argument("--json", action="store_true", help="print JSON on standard output")
    return sub


def add_target(sub: argparse.ArgumentParser) -> None:
    """Add the gateway's address."""
    sub.add_argument(
        "--socket",
        "--at",
        dest="target",
        metavar="TARGET",
        help="the gateway: a path, unix:PATH, tcp/HOST:PORT, tls/HOST:PORT, or NAME in the fleet of TA2_FLEET (default: "
        "found by itself)",
    )


def add_yes(sub: argparse.ArgumentParser) -> None:
    """Add that nobody is asked."""
    sub.add_argument("--yes", action="store_true", help="do not ask before moving (with no terminal nobody is asked)")


def add_take(sub: argparse.ArgumentParser) -> None:
    """Add that an owner is no reason to wait."""
    sub.add_argument("--take", metavar="REASON", help="take the robot from its owner, who is shown the reason")


def file_to_write(text: str) -> Path:
    """Return where a file can be written, asked before anything is done whose outcome would be lost.

    Raises:
        ArgumentTypeError: It cannot.
    """
    path = Path(text)
    if path.is_dir() or not os.access(path if path.exists() else path.parent, os.W_OK):
        raise argparse.ArgumentTypeError(f"{text!r} cannot be written: name a file in a folder that is there")
    return path


def utf8_text(text: str) -> str:
    """Return words that are written or sent, as they were typed.

    Raises:
        ArgumentTypeError: They are no UTF-8: what a shell hands over otherwise comes as lone surrogates.
    """
    try:
        text.encode()
    except UnicodeEncodeError:
        raise argparse.ArgumentTypeError(f"{text!r} is no text in UTF-8") from None
    return text
