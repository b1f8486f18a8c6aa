"""Manual §6.4: both arms to a symmetric configuration, and hold it. Needs both arms enabled, in joint control."""

from __future__ import annotations

import sys
from itertools import islice

from gateway.client import connect

__all__ = ["main"]

# Joint 4 is 0.01 rad from its limit (manual §4.13): check the limits before you change a goal.
GOALS = {"left": [0.0, 1.57, 0.0, 0.26, 0.0, 0.0, 0.0], "right": [0.0, -1.57, 0.0, -0.26, 0.0, 0.0, 0.0]}


def main(target: str | None = None) -> None:
    """Enable, move, hold for three seconds, release; every path begins where the arms are."""
    with connect(target, name="example 6.4") as robot, robot.control() as own:
        own.enable()
        own.move_to(GOALS, speed=0.5).result(timeout=60.0)
        for state in islice(robot.states(max_rate=1.0), 4):
            print(f"held, {state.left_arm.tracking_error:.3f} and {state.right_arm.tracking_error:.3f} rad off")


if __name__ == "__main__":
    main(*sys.argv[1:])
