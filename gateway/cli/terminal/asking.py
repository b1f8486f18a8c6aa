"""Asking a person before something moves."""

from __future__ import annotations

import contextlib
import sys
import termios

__all__ = ["confirmed"]

QUESTION = "Nobody and nothing in reach, the emergency stop at hand? Move? [y/N] "


def confirmed() -> bool:
    """Ask whoever types, on his terminal even where stderr goes elsewhere; without one the command line has said it all."""
    if not sys.stdin.isatty():
        return True
    termios.tcflush(sys.stdin, termios.TCIFLUSH)  # what was typed before the question is no answer to it
    with contextlib.ExitStack() as stack:
        shown = sys.stderr
        if not shown.isatty():
            with contextlib.suppress(OSError):  # no terminal of this session
                shown = stack.enter_context(open("/dev/tty", "w", encoding="utf-8"))
        print(QUESTION, end="", file=shown, flush=True)
        return sys.stdin.readline().strip().lower() in ("y", "yes")
