"""`ta2 completion`: a script by which a shell completes commands, options, choices and paths, made from the parser itself."""

from __future__ import annotations

import argparse
from argparse import Namespace
from collections.abc import Mapping

from gateway.cli.command_line.arguments import parser
from gateway.cli.terminal.ending import ExitStatus
from gateway.errors import Code, failure

__all__ = ["FILES", "FOLDERS", "carry_out"]

FILES = frozenset({"FILE", "PATH", "TARGET"})
"""Options and arguments that the usage shows by these names take the path of a file, or may."""
FOLDERS = frozenset({"DIR"})
"""The same for folders."""


def carry_out(options: Namespace) -> ExitStatus:
    """Print the script of a shell.

    Raises:
        GatewayError: BAD_REQUEST: the library that writes it is not installed.
    """
    try:
        import shtab
    except ImportError:
        raise failure(Code.BAD_REQUEST, "shtab is not installed", hint="pip install shtab") from None
    top = parser()
    _mark_paths(top, dict.fromkeys(FILES, shtab.FILE) | dict.fromkeys(FOLDERS, shtab.DIRECTORY))
    print(shtab.complete(top, options.shell))
    return ExitStatus.OK


def _mark_paths(parser: argparse.ArgumentParser, marks: Mapping[str, object]) -> None:
    """Tell shtab what takes a path, at every depth."""
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for sub in action.choices.values():
                _mark_paths(sub, marks)
        elif isinstance(action.metavar, str) and action.metavar in marks:
            action.complete = marks[action.metavar]  # type: ignore[attr-defined]  # where shtab looks for it
