"""Tells when a process that was killed can do nothing any more: sooner than its files are closed.

The kernel ends a process thread by thread: it marks each as exiting, frees the memory of all, and only then closes files
and tells whoever waits. A thread that is marked never runs a line of its program again and begins no system call; what is
left is the kernel's own work, 4 to 5 ms for the locked memory of a daemon. Nothing can be started meanwhile either: with
SIGKILL pending the kernel makes no threads.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Final

__all__ = ["DyingProcess"]

EXITING: Final = 0x4
"""PF_EXITING of the kernel: the flag of a thread that is on its way out."""
FLAGS: Final = 6
"""Place of a thread's flags in /proc/PID/stat, counted from the state behind its name (proc_pid_stat(5), field 9)."""


class DyingProcess:
    """A process to which SIGKILL has been sent.

    Args:
        pidfd: Which one; only this can mean no other one.

    Raises:
        OSError: If there is no such file, or no /proc.
    """

    def __init__(self, pidfd: int) -> None:
        self._info = Path(f"/proc/self/fdinfo/{pidfd}")
        self._info.read_text()

    def is_over(self) -> bool:
        """Return whether no thread of it can run any more; False where that cannot be told."""
        try:
            pid = self._pid()
            if pid < 1:
                return pid == -1
            stats = [task.joinpath("stat").read_text() for task in Path(f"/proc/{pid}/task").iterdir()]
            # It may have been waited for meanwhile, and its number given to another one.
            return self._pid() == -1 or all(map(_is_exiting, stats))
        except (OSError, ValueError):  # a thread that went while it was looked at: the next look tells
            return False

    def _pid(self) -> int:
        """Return its number; -1 when it has been waited for, 0 when it lives where we see no numbers."""
        found = re.search(r"^Pid:\s*(-?\d+)", self._info.read_text(), re.MULTILINE)
        return int(found[1]) if found else 0


def _is_exiting(stat: str) -> bool:
    state, *fields = stat.rpartition(")")[2].split()
    return state in "ZX" or bool(int(fields[FLAGS - 1]) & EXITING)
