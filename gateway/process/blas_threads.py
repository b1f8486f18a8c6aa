"""One thread for numpy's linear algebra, in a process that needs none of the others: called before numpy is imported.

The library below numpy starts a thread for every core when it is loaded. Here it would multiply matrices of seven columns;
each thread would only be one more to lock into memory, to schedule and to keep on the daemon's core. It reads its
environment then; what a user set there himself stays.
"""

from __future__ import annotations

import os

__all__ = ["VARIABLES", "one_blas_thread"]

VARIABLES = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS")


def one_blas_thread() -> None:
    """Let numpy work in the thread that calls it, if it is not imported yet."""
    for variable in VARIABLES:
        os.environ.setdefault(variable, "1")
