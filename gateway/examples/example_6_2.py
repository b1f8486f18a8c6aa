"""Manual §6.2: both grippers pushed open a little. Needs both arms enabled, in joint control."""

from __future__ import annotations

import sys
from itertools import islice

from gateway.client import connect

__all__ = ["main"]

FORCE = 0.04  # towards open: a torque of +1.2 N·m, no position (manual §4.4)


def main(target: str | None = None) -> None:
    """Enable, which holds both arms where they are (a gripper obeys only then), command both grippers, and watch them."""
    with connect(target, name="example 6.2") as robot, robot.control() as own:
        own.enable()
        own.left_gripper.set(FORCE)
        own.right_gripper.set(FORCE)
        for state in islice(robot.states(max_rate=2.0), 6):
            left, right = state.left_gripper, state.right_gripper
            print(
                f"left {left.q[0]:.2f} rad, {left.tau[0]:+.2f} N·m; right {right.q[0]:.2f} rad, {right.tau[0]:+.2f} N·m"
            )


if __name__ == "__main__":
    main(*sys.argv[1:])
