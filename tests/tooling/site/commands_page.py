"""The reference of the commands, from the parsers that read them."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from copy import copy
from functools import partial

from gateway.cli.command_line.arguments import EPILOG, parser
from tests.tooling.site.markdown import cell, table

__all__ = ["page"]

WIDTH = 84


def page() -> str:
    """Return the page."""
    return "\n".join(["# Commands", "", "What `ta2 --help` and `ta2 COMMAND --help` say.", "", *_lines(parser(), 1)])


def _lines(of: argparse.ArgumentParser, level: int) -> Iterator[str]:
    """Yield a command, then those below it. argparse has no public way to list what a parser takes."""
    below = [action for action in of._actions if isinstance(action, argparse._SubParsersAction)]
    narrow = copy(of)  # the parser is everybody's in this process
    narrow.formatter_class = partial(argparse.HelpFormatter, width=WIDTH)  # type: ignore[assignment]  # typed as a class, called like one
    if level > 1:
        yield from (f"{'#' * level} {of.prog}", "", cell(of.description or ""), "")
        yield from ("```text", narrow.format_usage().removeprefix("usage: ").rstrip(), "```", "")
        if rows := [_row(of, action) for action in of._actions if _is_told(action)]:
            yield from (table(["Option", "Means"], rows), "")
    else:
        yield from ("```text", EPILOG, "```", "")
    for action in below:
        for command in action.choices.values():
            yield from _lines(command, level + 1)


def _is_told(action: argparse.Action) -> bool:
    return not isinstance(action, (argparse._SubParsersAction, argparse._HelpAction))


def _row(of: argparse.ArgumentParser, action: argparse.Action) -> tuple[str, str]:
    wanted = action.metavar or (f"{{{','.join(action.choices)}}}" if action.choices else "")
    if isinstance(wanted, tuple):
        wanted = " ".join(wanted)
    names = [f"{name} {wanted}".strip() for name in action.option_strings] or [wanted or action.dest]
    shown = "<br>".join(f"`{name}`" for name in names)
    return shown, cell((action.help or "") % {**vars(action), "prog": of.prog})
