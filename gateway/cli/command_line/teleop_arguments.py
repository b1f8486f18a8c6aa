"""Arguments of `ta2 teleop`."""

from __future__ import annotations

from typing import Any

from gateway.cli.command_line.adding import add_client_command, add_take, add_yes, utf8_text

__all__ = ["add_teleop"]


def add_teleop(commands: Any) -> None:  # noqa: ANN401  argparse's private class
    """Add `teleop`."""
    more = (
        "Moves only while a key is repeated or a button held. q ends it, Ctrl-C leaves the arms held, ? lists the keys."
    )
    sub = add_client_command(commands, "teleop", "jog the robot by keyboard or gamepad", more, shows_json=False)
    sub.add_argument("--device", choices=("keyboard", "gamepad"), default="keyboard", help="default %(default)s")
    sub.add_argument("--arm", choices=("left", "right"), default="left", help="which one first (default %(default)s)")
    sub.add_argument(
        "--task",
        type=utf8_text,
        default="",
        metavar="TEXT",
        help="of the episodes, in words (default: the recording's)",
    )
    sub.add_argument("--hold", action="store_true", help="leave the arms held at the end instead of pausing the robot")
    add_yes(sub)
    add_take(sub)
