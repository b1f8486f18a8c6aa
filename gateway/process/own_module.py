"""How a process of this package starts another one: from the very same package, wherever it is started.

`python -m` looks in the working directory first. A folder `gateway` of somebody else's there would be run in place of the
guard, or keep it from starting.
"""

from __future__ import annotations

import sys
from pathlib import Path

__all__ = ["own_module"]

ROOT = Path(__file__).resolve().parents[2]
"""Where this package lies."""


def own_module(name: str, *words: str) -> list[str]:
    """Return the command that runs a module of this package as a program.

    Args:
        name: Of the module, e.g. `gateway.guard.guard`.
        words: Its command line.
    """
    path = f"sys.path[:] = [{str(ROOT)!r}, *filter(None, sys.path)]"  # '' is the working directory
    program = f"import runpy, sys; {path}; runpy.run_module({name!r}, None, '__main__', True)"
    return [sys.executable, "-c", program, *words]
