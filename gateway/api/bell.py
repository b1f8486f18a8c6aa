"""A bell: rung from any thread, it ends the sleep of the one that waits for it."""

from __future__ import annotations

import contextlib
import os
import select
from collections.abc import Sequence

__all__ = ["Bell"]


class Bell:
    """Rings once for all that has come since it was hushed."""

    def __init__(self) -> None:
        self._reader, self._ringer = os.pipe()
        os.set_blocking(self._reader, False)
        os.set_blocking(self._ringer, False)

    def ring(self) -> None:
        """Ring; any thread, never waits."""
        with contextlib.suppress(BlockingIOError):  # it rings already
            os.write(self._ringer, b"!")

    def wait(self, seconds: float, also: Sequence[int] = ()) -> bool:
        """Wait until it rings, and hush it; return whether it rang, or another file has something to be read.

        Args:
            seconds: Longest wait [s].
            also: Other files.
        """
        ready, _, _ = select.select([self._reader, *also], [], [], seconds)
        if self._reader in ready:
            self.hush()
        return bool(ready)

    def hush(self) -> None:
        """Ring no more."""
        with contextlib.suppress(BlockingIOError):
            os.read(self._reader, 65536)

    def close(self) -> None:
        """Give its files back; nobody may ring any more."""
        os.close(self._reader)
        os.close(self._ringer)
