"""The commands for the robot's body, as data: its frames, its identification, its numbers."""

from __future__ import annotations

import argparse
from typing import Any

from gateway.cli.command_line.adding import add_client_command, file_to_write
from gateway.cli.command_line.numbers import seconds

__all__ = ["add_frames", "add_identify", "add_model"]


def add_frames(commands: Any) -> None:  # noqa: ANN401  argparse's private class
    """Add `frames`."""
    frames = add_client_command(
        commands,
        "frames",
        "show the frames of manual appendix A: the tree, where each frame is, and whether that is this robot's own",
        "Needs no gateway: without --live the arms are at the joints given, else at the initial position of manual §6.6.",
    )
    frames.add_argument("--live", action="store_true", help="take the joints from the gateway, with their stamps")
    for side in ("left", "right"):
        frames.add_argument(
            f"--{side}", nargs=7, type=float, metavar="Q", help=f"seven joints of the {side} arm [rad] (manual §4.0.3)"
        )
    frames.add_argument("--calibration", metavar="FILE", help="what was calibrated on this robot (.json, .toml)")
    frames.add_argument("--urdf", metavar="FILE", help="kinematics of this URDF in place of our own numbers")
    frames.add_argument("--serial", metavar="S", help="serial number of this robot (default: as configured)")
    frames.add_argument("--config", metavar="FILE", help="settings with serial number and model of this robot")
    frames.add_argument(
        "--chain", nargs=2, metavar=("PARENT", "CHILD"), help="only where CHILD is in PARENT, and by which transforms"
    )
    frames.add_argument("--plot", metavar="FILE", help="draw them to FILE (.png, .svg, .pdf); needs matplotlib")


def add_identify(commands: Any) -> None:  # noqa: ANN401  argparse's private class
    """Add `identify`."""
    identify = add_client_command(
        commands,
        "identify",
        "find joint zeros and end effector of this robot's arms from joints and poses that were measured",
        "Moves nothing: somebody else moves the arms, slowly, all joints, through much of their range, while --live looks on, "
        "says what is missing, and ends when there is enough. "
        "Status 1 when an arm cannot be identified; the reason says how to move so that it can.",
    )
    source = identify.add_mutually_exclusive_group(required=True)
    source.add_argument("file", nargs="?", metavar="FILE", help="pairs of joints and poses (.jsonl, .csv)")
    source.add_argument("--live", action="store_true", help="take them from the gateway")
    source.add_argument(
        "--excite",
        type=file_to_write,
        metavar="FILE",
        help="write a motion of one arm (.npz) that tells its dynamics well, for `ta2 follow`",
    )
    identify.add_argument(
        "--dynamics",
        action="store_true",
        help="find friction, scale of the efforts and masses instead, from motion that nothing touches (extra `body`)",
    )
    identify.add_argument(
        "--seconds",
        type=seconds,
        default=180.0,
        metavar="S",
        help="how long to look on with --live at most [s]; it ends as soon as there is enough (default 180)",
    )
    identify.add_argument(
        "--arm", choices=("left", "right"), help="only this arm (default: all that there are pairs of)"
    )
    identify.add_argument(
        "--joints-only", action="store_true", help="only the joints' zeros, not the end effector's frame"
    )
    identify.add_argument("--shoulder", action="store_true", help="the shoulder's frame too")
    identify.add_argument("--urdf", metavar="FILE", help="against this URDF (default: as configured, our own numbers)")
    identify.add_argument(
        "--keep", type=file_to_write, metavar="FILE", help="write the pairs that were measured live to FILE (.jsonl)"
    )
    identify.add_argument(
        "--out",
        metavar="FILE",
        help="write what was found to this robot's calibration (.json), new or into what is there",
    )
    identify.add_argument("--serial", metavar="S", help="serial number of this robot (default: as configured)")
    identify.add_argument("--config", metavar="FILE", help="settings of this robot: serial number, model, URDF")


def add_model(model: argparse.ArgumentParser) -> None:
    """Add what can be done with the model.

    Args:
        model: Parser of `model`.
    """
    acts = model.add_subparsers(title="what to do", dest="act", metavar="ACT", required=True)
    text = "work the manual's and the published figures out again, and say where the numbers differ"
    check = acts.add_parser(
        "check",
        help=text,
        description=f"{text[0].upper()}{text[1:]}. Status 1 when one differs. Needs no robot and no gateway.",
        allow_abbrev=False,
    )
    check.add_argument(
        "--urdf", metavar="FILE", help="check this description instead of our own numbers, and compare it with them"
    )
    check.add_argument("--json", action="store_true", help="print JSON on standard output")
