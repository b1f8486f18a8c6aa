"""Manual §6.6: both arms to the initial position, then disable. Needs both arms enabled, in joint control."""

from __future__ import annotations

import sys

from gateway.client import connect

__all__ = ["main"]

GOALS = {"left": [0.41, 1.16, -0.47, 0.90, 0.23, -0.15, 0.60], "right": [-0.50, -0.92, 0.52, -1.28, 0.32, 0.55, -0.52]}


def main(target: str | None = None) -> None:
    """Enable, move, and wait until every measured joint has stayed within 0.05 rad of its goal for 0.5 s."""
    with connect(target, name="example 6.6") as robot, robot.control() as own:
        own.enable()
        result = own.move_to(GOALS, speed=0.3, tolerance=0.05).result(timeout=60.0)
        print(f"Both arms converged! Measured error {result.error:.4f} rad after {result.duration:.1f} s")


if __name__ == "__main__":
    main(*sys.argv[1:])
