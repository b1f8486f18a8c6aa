"""Programs that run beside a simulated robot, such as its camera: a process of their own, which ends with the robot's.

Both ends of that: who starts one (`Companion`), and the program that is started (`until_told`).
"""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
from collections.abc import Callable, Iterator, Sequence

from gateway.process.own_module import own_module

__all__ = ["Companion", "until_told"]


class Companion:
    """A program beside this one, from `with` to its end.

    Args:
        module: Of this package, to be run; it takes `--parent`.
        words: Its command line.
        patience_s: So long its orderly end is waited for [s]; then it is killed.
    """

    def __init__(self, module: str, words: Sequence[str], patience_s: float) -> None:
        self._command = own_module(module, *words, "--parent", str(os.getpid()))
        self._patience_s = patience_s
        self._process: subprocess.Popen[bytes] | None = None

    @property
    def pid(self) -> int | None:
        """Its process id while it runs."""
        return None if self._process is None or self._process.poll() is not None else self._process.pid

    def __enter__(self) -> Companion:
        """Start it."""
        self._process = subprocess.Popen(self._command, stdin=subprocess.DEVNULL)
        return self

    def __exit__(self, *_: object) -> None:
        """End it, and wait for that."""
        if self._process is None:
            return
        self._process.terminate()
        try:
            self._process.wait(self._patience_s)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()


@contextlib.contextmanager
def until_told(parent: int | None = None) -> Iterator[Callable[[], bool]]:
    """Yield a function that says whether SIGINT or SIGTERM has come, or the parent has gone; for the main thread.

    Args:
        parent: Process id of the parent; None when it does not matter.
    """
    told: list[int] = []
    before = {
        number: signal.signal(number, lambda number, _: told.append(number))
        for number in (signal.SIGINT, signal.SIGTERM)
    }
    try:
        yield lambda: bool(told) or (parent is not None and os.getppid() != parent)
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
