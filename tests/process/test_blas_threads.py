"""Rules of `gateway.process.blas_threads`: numpy starts no thread beside ours, unless the user wants it otherwise."""

from __future__ import annotations

import os
import subprocess
import sys

from gateway.process.blas_threads import VARIABLES, one_blas_thread

PROGRAM = """
import os
from gateway.process.blas_threads import one_blas_thread
one_blas_thread()
import numpy as np
np.ones((300, 300)) @ np.ones((300, 300))
print(len(os.listdir("/proc/self/task")))
"""


def test_numpy_works_in_the_thread_that_calls_it():
    """In a process of its own, with a product that is large enough to be shared out."""
    environment = {name: value for name, value in os.environ.items() if name not in VARIABLES}
    done = subprocess.run([sys.executable, "-c", PROGRAM], env=environment, capture_output=True, text=True, timeout=30)
    assert done.returncode == 0, done.stderr
    assert done.stdout.split() == ["1"]


def test_what_the_user_set_stays(monkeypatch):
    """The variables are the library's own, and whoever sets them knows why."""
    monkeypatch.setattr("os.environ", {VARIABLES[0]: "4"})
    one_blas_thread()
    assert os.environ == {VARIABLES[0]: "4", VARIABLES[1]: "1"}
