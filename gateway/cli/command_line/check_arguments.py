"""Arguments of `ta2 check` and `ta2 doctor`."""

from __future__ import annotations

from typing import Any

from gateway.cli.command_line.adding import add_client_command, add_command, file_to_write
from gateway.cli.command_line.robot_arguments import MODES, PARTS, add_robot

__all__ = ["add_check"]


def add_check(commands: Any) -> None:  # noqa: ANN401  argparse's private class
    """Add `check` and `doctor`."""
    check = add_client_command(
        commands,
        "check",
        "check a robot as the manual asks before it is used (§2.7), point by point",
        "Sends nothing; what moves is checked only when all else is well and a person typed `move`. Without --robot or "
        "--config it asks the gateway where the robot is, and moves through that.",
    )
    add_robot(check, "check", "of the only robot there")
    check.add_argument("--video", action="store_true", help="check the cameras, too, for 10 s (manual §2.7.2)")
    check.add_argument("--html", type=file_to_write, metavar="FILE", help="write the report as one page, too")
    check.add_argument(
        "--without",
        action="append",
        default=[],
        choices=PARTS,
        help="a part that is not there, or off; may be repeated",
    )
    check.add_argument("--mode", choices=MODES, help="control mode that was saved for both arms (default: tell it)")
    check.add_argument("--consent", metavar="WORD", help="`move`, in place of typing it: the robot MOVES")
    doctor = add_command(
        commands,
        "doctor",
        "say whether this computer is set up for a gateway, and what to type where it is not",
        "Changes nothing. Status 1 when something is a problem.",
    )
    doctor.add_argument("--json", action="store_true", help="print JSON on standard output")
