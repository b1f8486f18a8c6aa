"""`python -m gateway.sim`: a simulated robot without the rest of the command line; for tests."""

from __future__ import annotations

import argparse
import sys

from gateway.sim.node import DEFAULT_LISTEN, main_sim
from gateway.sim.settings import SimSettings


def main(arguments: list[str] | None = None) -> int:
    """Parse the arguments and run; return the exit code."""
    parser = argparse.ArgumentParser(prog="python -m gateway.sim", description="A simulated TeleAvatar 2.")
    parser.add_argument("--listen", default=DEFAULT_LISTEN, help="endpoint of its router (default: %(default)s)")
    parser.add_argument("--mode", choices=("joint", "pose"), default="joint", help="control mode of both arms")
    parser.add_argument("--left-mode", choices=("joint", "pose"), help="control mode of the left arm")
    parser.add_argument("--right-mode", choices=("joint", "pose"), help="control mode of the right arm")
    parser.add_argument("--model", choices=("lite", "standard", "lift"), default="standard")
    parser.add_argument("--seed", type=int, default=0, help="seed of the measurement noise")
    parser.add_argument(
        "--disable", action="append", default=[], choices=("left_arm", "right_arm", "chassis", "lift_servo")
    )
    options = parser.parse_args(arguments)
    settings = SimSettings(
        model=options.model,
        left_mode=options.left_mode or options.mode,
        right_mode=options.right_mode or options.mode,
        seed=options.seed,
        enable_left_arm="left_arm" not in options.disable,
        enable_right_arm="right_arm" not in options.disable,
        enable_chassis="chassis" not in options.disable,
        enable_lift_servo="lift_servo" not in options.disable,
    )
    return main_sim(options.listen, settings)


if __name__ == "__main__":
    sys.exit(main())
