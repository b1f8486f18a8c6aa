"""`python -m gateway.sim`: a simulated robot without the rest of the command line; for tests."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from gateway.sim.node import DEFAULT_LISTEN
from gateway.sim.robot.settings import PHYSICS
from gateway.sim.starting import CannotStart, start


def command_line() -> argparse.ArgumentParser:
    """Return what can be said about a simulated robot on a command line."""
    parser = argparse.ArgumentParser(prog="python -m gateway.sim", description="A simulated TeleAvatar 2.")
    parser.add_argument("--listen", default=DEFAULT_LISTEN, help="endpoint of its router (default: %(default)s)")
    parser.add_argument("--mode", choices=("joint", "pose"), default="joint", help="control mode of both arms")
    parser.add_argument("--left-mode", choices=("joint", "pose"), help="control mode of the left arm")
    parser.add_argument("--right-mode", choices=("joint", "pose"), help="control mode of the right arm")
    parser.add_argument("--model", choices=("lite", "standard", "lift"), default="standard")
    parser.add_argument("--namespace", default="", help="of its bridge")
    parser.add_argument("--seed", type=int, default=0, help="seed of the measurement noise")
    parser.add_argument(
        "--disable", action="append", default=[], choices=("left_arm", "right_arm", "chassis", "lift_servo")
    )
    parser.add_argument(
        "--physics", choices=PHYSICS, default=PHYSICS[0], help="how it moves: as lags and speeds, or with forces"
    )
    parser.add_argument("--differs", type=float, default=0.0, help="how far its arms are from their numbers [%%]")
    parser.add_argument("--clock-offset-s", type=float, default=0.0, help="robot's clock minus the host's at the start")
    parser.add_argument("--clock-drift-ppm", type=float, default=0.0, help="how much faster it runs")
    parser.add_argument("--viewer", action="store_true", help="show it in a window; needs --physics mujoco")
    parser.add_argument("--record", type=Path, metavar="FILE", help="film it, *.mp4; needs --physics mujoco")
    parser.add_argument("--camera-to", metavar="HOST:PORT", help="send its camera's pictures there (default: none)")
    return parser


def main(arguments: list[str] | None = None) -> int:
    """Parse the arguments and run; return the exit code."""
    options = command_line().parse_args(arguments)
    try:
        return start(options)
    except CannotStart as error:
        sys.stderr.write(f"{error}\n")
        return 1


if __name__ == "__main__":
    sys.exit(main())
