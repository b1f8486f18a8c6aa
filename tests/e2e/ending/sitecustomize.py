"""Lets a test end one thread of a process that it starts: Python imports this there, being first on PYTHONPATH.

On SIGUSR2 each thread whose name stands in the file `ENDING` gets an exception that is none of Python's own errors, as a
panic of a compiled part is. Where nothing stands there the names of all threads are written down; for `hang` whoever
answers stops does so no more, and for `deaf` the daemon does not hear from its guard that this is so, either. The exception
can only come between two instructions of Python: waits without an end are waited in slices here, so that it does.
"""

from __future__ import annotations

import contextlib
import ctypes
import logging
import os
import select
import signal
import subprocess
import threading

SLICE_S = 0.05

_wait, _popen_wait, _read = threading.Condition.wait, subprocess.Popen.wait, os.read


class Panic(BaseException):
    """As zenoh's: a BaseException."""


def _sliced_wait(self, timeout=None):
    while timeout is None:
        if _wait(self, SLICE_S):
            return True
    return _wait(self, timeout)


def _sliced_popen_wait(self, timeout=None):
    while timeout is None:
        with contextlib.suppress(subprocess.TimeoutExpired):
            return _popen_wait(self, SLICE_S)
    return _popen_wait(self, timeout)


def _sliced_read(descriptor, length):
    while threading.current_thread().name == "core-probe" and not select.select([descriptor], [], [], SLICE_S)[0]:
        pass
    return _read(descriptor, length)


def _hang(self, timeout_s):
    threading.Event().wait()


def _hear_nothing(self, now_ns):
    return []


def _end(number, frame):
    with open(os.environ["ENDING"], encoding="utf-8") as file:
        wanted = file.read().strip()
    threads = {thread.name: thread for thread in threading.enumerate()}
    if not wanted:
        with open(f"{os.environ['ENDING']}.{os.getpid()}", "w", encoding="utf-8") as file:
            file.write("".join(f"{name}\n" for name in threads))
    elif wanted in ("hang", "deaf"):
        from gateway.api.stop_lane import StopLane
        from gateway.guard.launcher import GuardLauncher

        StopLane.deliver = _hang
        if wanted == "deaf":
            GuardLauncher.poll = _hear_nothing
    else:
        for name in wanted.split():
            ident = ctypes.c_ulong(threads[name].ident)
            ctypes.pythonapi.PyThreadState_SetAsyncExc(ident, ctypes.py_object(Panic))
        logging.getLogger("ending").info("the test ends %s", wanted)  # wakes whoever waits for a line


if "ENDING" in os.environ:
    threading.Condition.wait, subprocess.Popen.wait, os.read = _sliced_wait, _sliced_popen_wait, _sliced_read
    signal.signal(signal.SIGUSR2, _end)
