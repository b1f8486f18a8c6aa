"""Manual §6.1: the left hand to a pose, then disable. Needs the left arm enabled, in end-effector control."""

from __future__ import annotations

import sys

from gateway.client import connect

__all__ = ["main"]

POSITION = [-0.0144, 0.0181, -0.545]  # m
QUATERNION = [-0.6519, 0.2602, 0.7054, 0.0990]  # x, y, z, w


def main(target: str | None = None) -> None:
    """Enable, move straight to the pose, and wait until it is measured there; a pose belongs to its arm's shoulder."""
    with connect(target, name="example 6.1") as robot, robot.control() as own:
        own.enable()
        result = own.left_arm.move_pose(POSITION, QUATERNION, frame="left_shoulder_base", speed=0.5).result(
            timeout=60.0
        )
        print(f"Target reached! Position error {result.error_m:.4f} m after {result.duration:.1f} s")


if __name__ == "__main__":
    main(*sys.argv[1:])
