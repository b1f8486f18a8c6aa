"""Keys of a terminal: taken one by one and unechoed; Ctrl-C and Ctrl-Z stay what they are."""

from __future__ import annotations

import os
import select
import sys
import termios
import time
import tty
from collections.abc import Iterator
from contextlib import contextmanager

__all__ = ["Keys", "keys"]


class Keys:
    """What is pressed; nothing where there is no terminal.

    Args:
        file: Of the terminal, or None.
    """

    def __init__(self, file: int | None) -> None:
        self._file = file

    @property
    def are_there(self) -> bool:
        """Whether anybody can press one."""
        return self._file is not None and _is_ours(self._file)

    def wait(self, seconds: float) -> str:
        """Wait so long [s], or until something is pressed; return that, in lower case."""
        if not self.are_there:  # reading in the background would stop this process
            time.sleep(seconds)
            return ""
        if self._file is None or not select.select([self._file], [], [], seconds)[0]:
            return ""
        pressed = os.read(self._file, 64)
        if not pressed:  # the terminal is gone
            self._file = None
        return pressed.decode(errors="replace").lower()

    def renew(self) -> None:
        """Take keys one by one again: while this process stood still, a shell may have changed its terminal."""
        if self._file is not None and self.are_there:
            tty.setcbreak(self._file, termios.TCSANOW)


def _is_ours(file: int) -> bool:
    try:
        return os.tcgetpgrp(file) == os.getpgrp()
    except OSError:
        return False


@contextmanager
def keys() -> Iterator[Keys]:
    """Let single keys through while the block runs, and give the terminal back as it was."""
    file = sys.stdin.fileno() if sys.stdin.isatty() else None
    if file is None or not _is_ours(file):
        yield Keys(None)
        return
    before = termios.tcgetattr(file)
    tty.setcbreak(file)
    try:
        yield Keys(file)
    finally:
        if _is_ours(file):  # in the background it is the shell's, and asking for it would stop this process
            termios.tcsetattr(file, termios.TCSADRAIN, before)
