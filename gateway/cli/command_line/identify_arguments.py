"""The command for identification, as data."""

from __future__ import annotations

from typing import Any

from gateway.cli.command_line.adding import add_client_command
from gateway.cli.command_line.numbers import above_zero

__all__ = ["add_identify"]


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
    identify.add_argument(
        "--seconds",
        type=_seconds,
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
    identify.add_argument("--keep", metavar="FILE", help="write the pairs that were measured live to FILE (.jsonl)")
    identify.add_argument(
        "--out",
        metavar="FILE",
        help="write what was found to this robot's calibration (.json), new or into what is there",
    )
    identify.add_argument("--serial", metavar="S", help="serial number of this robot (default: as configured)")
    identify.add_argument("--config", metavar="FILE", help="settings of this robot: serial number, model, URDF")


def _seconds(text: str) -> float:
    return above_zero(text, 86_400.0, "time [s]")
