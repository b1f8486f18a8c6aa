"""Manual §6.3: both grippers pushed open with full torque. Needs both arms enabled, in end-effector control."""

from __future__ import annotations

import sys
from itertools import islice

from gateway.client import connect

__all__ = ["main"]


def main(target: str | None = None) -> None:
    """Enable, which holds both hands at the pose where they are, open both grippers, and watch that the hands stay."""
    with connect(target, name="example 6.3") as robot, robot.control() as own:
        own.enable()
        own.left_gripper.open(1.0)
        own.right_gripper.open(1.0)
        for state in islice(robot.states(max_rate=2.0), 6):
            print(f"left hand at {state.left_arm.pose.p.round(3)} m, gripper at {state.left_gripper.q[0]:.2f} rad")


if __name__ == "__main__":
    main(*sys.argv[1:])
