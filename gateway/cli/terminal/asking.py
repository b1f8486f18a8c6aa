"""Asking a person before something moves."""

from __future__ import annotations

import sys
import termios

__all__ = ["confirmed"]


def confirmed() -> bool:
    """Ask a person; where there is none, the command line has said it all."""
    if not (sys.stdin.isatty() and sys.stderr.isatty()):
        return True
    termios.tcflush(sys.stdin, termios.TCIFLUSH)  # what was typed before the question is no answer to it
    print("Nobody and nothing in reach, the emergency stop at hand? Move? [y/N] ", end="", file=sys.stderr, flush=True)
    return sys.stdin.readline().strip().lower() in ("y", "yes")
