"""The commands for grippers, chassis and lift, as data."""

from __future__ import annotations

import argparse
from functools import partial
from typing import Any

from gateway.cli.command_line.adding import add_client_command, add_take, add_yes
from gateway.cli.command_line.numbers import between

__all__ = ["GRIPPER_ACTIONS", "LIFT_ACTIONS", "add_ground", "take_velocity"]

GRIPPER_ACTIONS = ("grip", "open", "relax", "set")
LIFT_ACTIONS = ("up", "down", "off")
AXES = ("vx", "vy", "wz")
_part = partial(between, least=0.0, most=1.0, what="part")
_velocity = partial(between, least=-1.0, most=1.0, what="velocity [m/s, rad/s]")
_seconds = partial(between, least=0.05, most=600.0, what="time [s]")


def add_ground(commands: Any) -> None:  # noqa: ANN401  argparse's private class
    """Add `gripper`, `payload`, `drive` and `lift`."""
    gripper = add_client_command(
        commands,
        "gripper",
        "close, open or relax a gripper: enable, command, watch, disable",
        "A grip is lost when the robot pauses: --hold keeps it for a minute, and for the next command.",
    )
    gripper.add_argument("side", choices=("left", "right"), help="which gripper")
    gripper.add_argument("action", choices=GRIPPER_ACTIONS, help="what it shall do")
    gripper.add_argument(
        "value",
        nargs="?",
        type=_part,
        metavar="RAW",
        help="for set: the robot's own input, 0 opens most, 0.1 is no torque, 1 closes most (manual §4.4)",
    )
    gripper.add_argument(
        "--force",
        type=_part,
        default=0.5,
        metavar="F",
        help="part of the greatest torque, up to 1 (default %(default)s)",
    )
    gripper.add_argument("--hold", action="store_true", help="leave the arms held with the grip, not paused")
    payload = add_client_command(
        commands,
        "payload",
        "weigh what a hand holds, by small slow swings of its arm, and count on it in what the arm feels",
        "Needs `[model] dynamics`; nothing but the load may touch the arm. What differs from the model's masses looks like a "
        "load: weigh the empty hand first, with --json into a file, and then in the same posture with --empty.",
    )
    payload.add_argument("--arm", choices=("left", "right"), required=True, help="which")
    act = payload.add_mutually_exclusive_group()
    act.add_argument("--none", action="store_true", help="weigh nothing, and count on nothing: the hand is empty")
    act.add_argument("--empty", metavar="FILE", help="what --json printed of the empty hand, in the same posture")
    drive = add_client_command(
        commands,
        "drive",
        "drive the chassis at a velocity for a time, then ramp down",
        "Nobody measures how far it comes (manual §4.5). Ctrl-C stops it.",
    )
    drive.add_argument(
        "velocity",
        nargs="*",
        type=_velocity,
        metavar="VX VY WZ",
        help="along x and y [m/s], around z [rad/s]; those left out are 0. Or by name:",
    )
    for name, what in (("vx", "along x [m/s]"), ("vy", "along y [m/s]"), ("wz", "around z [rad/s]")):
        drive.add_argument(f"--{name}", type=_velocity, default=0.0, metavar="V", help=f"{what} (default 0)")
    lift = add_client_command(
        commands,
        "lift",
        "drive the lift up or down for a time, or take its servo off",
        "Only on the lift model. Where the lift is, nobody measures (manual §4.12). Ctrl-C stops it.",
    )
    lift.add_argument("action", choices=LIFT_ACTIONS, help="where to")
    lift.add_argument(
        "--speed", type=_part, default=0.3, metavar="F", help="part of full speed, up to 1 (default %(default)s)"
    )
    for sub in (gripper, drive, lift):
        sub.add_argument(
            "--for", dest="for_s", type=_seconds, default=1.0, metavar="S", help="how long [s] (default %(default)s)"
        )
    for sub in (gripper, payload, drive, lift):
        add_take(sub)
        add_yes(sub)


def take_velocity(drive: argparse.ArgumentParser, options: argparse.Namespace) -> None:
    """Put the velocity that was given by place where the one by name is; end the process when there are both, or too many."""
    by_place = options.velocity
    if len(by_place) > len(AXES):
        drive.error(f"{len(by_place)} velocities; VX VY WZ are three at most")
    if by_place and any(getattr(options, axis) for axis in AXES):
        drive.error("a velocity stands by place (VX VY WZ) or by name (--vx, --vy, --wz), not both")
    for axis, value in zip(AXES, by_place, strict=False):
        setattr(options, axis, value)
