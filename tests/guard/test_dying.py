"""Rules of `dying`: over means that not one thread can run any more, and that comes before the files are closed."""

from __future__ import annotations

import os
import select
import signal
import subprocess
import sys
import time
from collections.abc import Iterator

import pytest

from gateway.guard.dying import DyingProcess, _is_exiting

pytestmark = pytest.mark.skipif(not hasattr(os, "pidfd_open"), reason="a kernel or Python without pidfd")

CHILD = """
import sys, threading, time
for _ in range(8):
    threading.Thread(target=time.sleep, args=(60,), daemon=True).start()
held = bytearray(200_000_000)
held[::4096] = b"x" * len(held[::4096])
print("ready", flush=True)
time.sleep(60)
"""


@pytest.fixture
def child() -> Iterator[subprocess.Popen[str]]:
    """A process with threads, memory and a pipe."""
    process = subprocess.Popen([sys.executable, "-c", CHILD], stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    assert process.stdout.readline() == "ready\n"
    yield process
    process.kill()
    process.wait()
    process.stdout.close()


@pytest.mark.parametrize("first", [None, signal.SIGSTOP], ids=["running", "frozen"])
def test_a_process_is_over_when_it_was_killed_and_never_before(child: subprocess.Popen[str], first: int | None) -> None:
    """Running or stopped it is not over; killed it soon is, no later than its pipe closes, also once waited for."""
    pidfd = os.pidfd_open(child.pid)
    dying = DyingProcess(pidfd)
    assert not dying.is_over()
    if first is not None:
        child.send_signal(first)
        assert not dying.is_over()
    signal.pidfd_send_signal(pidfd, signal.SIGKILL)
    deadline = time.monotonic() + 5.0
    while not dying.is_over():
        assert time.monotonic() < deadline
        if select.select([child.stdout], [], [], 0)[0]:
            assert dying.is_over(), "its pipe is closed, so it is over"
    child.wait()
    assert dying.is_over(), "it has been waited for"
    os.close(pidfd)
    assert not dying.is_over(), "nobody can tell"


def test_no_such_file_is_an_error() -> None:
    """A caller without a pidfd has the pipe."""
    with pytest.raises(OSError):
        DyingProcess(-1)


@pytest.mark.parametrize(
    ("stat", "is_exiting"),
    [
        ("7 (a) b) S 1 7 7 0 -1 4194560 0 0", False),
        ("7 (a) b) D 1 7 7 0 -1 4194564 0 0", True),
        ("7 (x) Z 1 7 7 0 -1 4194560 0 0", True),
        ("7 (x) T 1 7 7 0 -1 1077936192 0 0", False),
    ],
)
def test_a_threads_flag_is_found_behind_any_name(stat: str, *, is_exiting: bool) -> None:
    """Names may hold blanks and parentheses."""
    assert _is_exiting(stat) is is_exiting
