"""Manual §6.5: the chassis ahead at 0.05 m/s for two seconds, then stop. Needs the chassis enabled; no FSM heartbeat."""

from __future__ import annotations

import sys

from gateway.client import connect

__all__ = ["main"]


def main(target: str | None = None) -> None:
    """Drive, and return when it stands: ramps and zeros are the gateway's business, also when this program dies."""
    with connect(target, name="example 6.5") as robot, robot.control() as own:
        own.chassis.drive_for(vx=0.05, vy=0.0, wz=0.0, duration=2.0)
        print("stopped")


if __name__ == "__main__":
    main(*sys.argv[1:])
