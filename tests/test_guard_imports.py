"""Tests of how slim the guard is: it brakes in the daemon's place, and has no use for the body's model."""

from __future__ import annotations

import subprocess
import sys

PLAIN = {"description", "placement", "separation", "separation.judgement", "separation.stopping"}
"""Modules of kinematics that are plain values and formulas: what the engine that guard and daemon share names them for."""

SCRIPT = """
import sys
import gateway.guard.guard
print(" ".join(sorted(sys.modules)))
"""


def test_the_guard_loads_neither_an_array_library_nor_the_model():
    """Of kinematics nothing but what needs no array library; not on any way round either."""
    found = subprocess.run([sys.executable, "-c", SCRIPT], capture_output=True, text=True, check=True, timeout=60)
    modules = set(found.stdout.split())
    assert "gateway.core.engine" in modules  # it is the guard's own code that was loaded
    assert not {name.partition(".")[0] for name in modules} & {"numpy", "pinocchio", "mujoco"}
    kinematics = {
        name.removeprefix("gateway.kinematics.") for name in modules if name.startswith("gateway.kinematics.")
    }
    assert kinematics <= PLAIN
