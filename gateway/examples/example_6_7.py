"""Manual §6.7: the lift up, a pause, down again, off. Needs the lift model, and its servo enabled."""

from __future__ import annotations

import sys

from gateway.client import connect

__all__ = ["main"]

STEPS = [("Lift up", 0.3, 1.5), ("Pause", 0.0, 0.4), ("Lift down", -0.3, 1.5)]  # part of full speed, seconds


def main(target: str | None = None) -> None:
    """Up, wait, down: a velocity lives while this program does, and the lift stops when it dies."""
    with connect(target, name="example 6.7") as robot, robot.control() as own:
        for name, velocity, seconds in STEPS:
            print(name)
            own.lift.drive_for(velocity, seconds)
        print("Stop")
        own.lift.disable()


if __name__ == "__main__":
    main(*sys.argv[1:])
