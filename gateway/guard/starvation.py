"""Tells whether a process is kept from running: threads of it could go on, and no core takes them.

On a core that it shares with others a process waits for its turn: behind ordinary programs where it has no real-time
priority, behind another urgent one where it has the same, and for 50 ms in each second behind all ordinary programs together,
for which the kernel keeps 5 % of a core. It hangs as little as one whose core stands still.

Rules it obeys
    * Only what the kernel says counts, thread by thread: that it is runnable, and how long it has run. Who was runnable when
      asked about, is so still, and has not run a nanosecond since, waits.
    * A thread that waits behind others of its own process waits for no turn: where they have run for half of the time, the
      process has had it. A loop that spins hangs.
    * Who is stopped, sleeps or waits for a lock does not wait for a core. Where the kernel does not say, nobody does.
"""

from __future__ import annotations

import time
from pathlib import Path

__all__ = ["Starvation"]


class Starvation:
    """Whether a process starves, asked for again and again."""

    def __init__(self, pid: int, proc: Path = Path("/proc")) -> None:
        self._tasks = proc / str(pid) / "task"
        self._runnable: dict[Path, int] = {}
        self._asked_ns = 0

    def ask(self) -> int:
        """Note which threads could run; return how many."""
        self._asked_ns = time.monotonic_ns()
        try:
            tasks = list(self._tasks.iterdir())
        except OSError:  # it has ended, or no /proc is here
            tasks = []
        found = {task: _ran_ns(task) for task in tasks}
        self._runnable = {task: ran_ns for task, ran_ns in found.items() if ran_ns is not None}
        return len(self._runnable)

    def is_over(self) -> bool:
        """Return whether no thread that could run when asked about still waits for its first moment since."""
        ran_ns, waiting = 0, 0
        for task, before_ns in self._runnable.items():
            after_ns = _ran_ns(task)
            if after_ns is not None:
                ran_ns += after_ns - before_ns
                waiting += after_ns == before_ns
        return waiting == 0 or 2 * ran_ns >= time.monotonic_ns() - self._asked_ns


def _ran_ns(task: Path) -> int | None:
    """Return how long a thread has run [ns]; None when it could not run now, or nothing is said of it."""
    try:
        if (task / "stat").read_bytes().rpartition(b") ")[2][:1] != b"R":
            return None
        return int((task / "schedstat").read_bytes().split()[0])
    except (OSError, ValueError, IndexError):  # it has ended meanwhile
        return None
