"""Arguments of `ta2 enable`, `home`, `move`, `move-pose`, `follow` and `replay`."""

from __future__ import annotations

from functools import partial
from typing import Any

from gateway.cli.command_line.adding import add_client_command, add_take, add_yes
from gateway.cli.command_line.follow_arguments import add_follow, add_replay
from gateway.cli.command_line.numbers import above_zero, factor

__all__ = ["add_motions"]

PATIENCE_S = 60.0
"""How long a motion may take [s]."""
_distance = partial(above_zero, most=0.2, what="distance [rad]")


def add_motions(commands: Any) -> None:  # noqa: ANN401  argparse's private class
    """Add the commands that own the robot and move its arms."""
    enable = add_client_command(
        commands,
        "enable",
        "enable the arms, hold them where they are until Ctrl-C, then release",
        shows_json=False,
        timeout_s=12.0,
        timeout_of="longest wait until the robot is READY",
    )
    motions = []
    for name, text in (
        ("home", "move both arms to the initial position of manual §6.6: enable, move, disable"),
        ("move", "move one or both arms to joint positions: enable, move, disable"),
        ("move-pose", "move one or both end effectors to poses: enable, move, disable"),
    ):
        motion = add_client_command(
            commands,
            name,
            text,
            "Ctrl-C leaves the arms held.",
            timeout_s=PATIENCE_S,
            timeout_of="longest wait for the motion to end",
        )
        motions.append(motion)
    follow = add_client_command(
        commands,
        "follow",
        "follow a trajectory from a file: judge it, enable, follow, disable",
        timeout_s=PATIENCE_S,
        timeout_of="longest wait for the approach, and for the arms to settle after the last point",
    )
    add_follow(follow)
    replay = add_client_command(
        commands, "replay", "tell the arms what they were told in a recording: judge it, enable, follow, disable",
        timeout_s=PATIENCE_S, timeout_of="longest wait for the approach, and for the arms to settle after the last point",
    )  # fmt: skip
    add_replay(replay)
    move = motions[1]
    for side in ("left", "right"):
        move.add_argument(
            f"--{side}",
            nargs="+",
            metavar="Q",
            help=f"seven joints of the {side} arm [rad], in the order of manual §4.0.3, spaces or commas between them",
        )
    for side in ("left", "right"):
        motions[2].add_argument(
            f"--{side}",
            nargs="+",
            metavar="P",
            help=f"x y z [m] qx qy qz qw of the {side} end effector in {side}_shoulder_base (manual §4.0.1)",
        )
    straight = "go straight in joint mode, too; in end-effector mode the arms always do"
    motions[2].add_argument("--straight", action="store_true", help=straight)
    motions[2].add_argument("--clip", action="store_true", help="move a position beyond the reach to its end")
    move.add_argument("--by", action="store_true", help="the joints are offsets from where the arms are")
    move.add_argument("--clip", action="store_true", help="move a target outside the limits to the limit, and say so")
    for motion in motions:
        motion.add_argument(
            "--tolerance",
            type=_distance,
            metavar="RAD",
            help="reached within this [rad] (default: as configured, 0.05)",
        )
    motions += (follow, replay)
    for motion in motions:
        motion.add_argument(
            "--speed",
            type=factor,
            default=0.5,
            metavar="F",
            help="factor on the configured velocity limit, up to 1 (default %(default)s)",
        )
        motion.add_argument("--hold", action="store_true", help="leave the arms held instead of pausing the robot")
        add_yes(motion)
    for owning in (enable, *motions):
        add_take(owning)
