"""How a simulated robot moves and whether one looks at it, as arguments of `ta2 sim`. Knows nothing of what they do."""

from __future__ import annotations

import argparse
from pathlib import Path

__all__ = ["add_physics"]


def add_physics(sim: argparse.ArgumentParser) -> None:
    """Add `--physics`, `--viewer`, `--headless` and `--record`."""
    sim.add_argument(
        "--physics",
        choices=("kinematic", "mujoco"),
        default="kinematic",
        help="how it moves: as lags and speeds, or with forces, contacts and a table of things (default %(default)s)",
    )
    sight = sim.add_mutually_exclusive_group()
    sight.add_argument(
        "--viewer", action="store_true", help="show it in a window; needs --physics mujoco and a display"
    )
    sight.add_argument("--headless", dest="viewer", action="store_false", help="show no window (default)")
    sim.add_argument(
        "--record",
        type=Path,
        metavar="FILE",
        help="film the scene from the side, *.mp4; needs --physics mujoco, no display",
    )
