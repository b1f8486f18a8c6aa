"""Arguments of `ta2 policy run`."""

from __future__ import annotations

import argparse
from functools import partial
from typing import Any

from gateway.cli.command_line.adding import add_client_command, add_take, add_yes, utf8_text
from gateway.cli.command_line.numbers import above_zero, between, integer, seconds, udp_port
from gateway.cli.command_line.video_arguments import PORT

__all__ = ["add_policy"]

MORE = (
    "Asks for the next action chunk while the last one plays. Ctrl-C leaves the arms held. --dry asks and judges, --shadow "
    "compares with whoever drives: both send nothing. With cameras, also: pip install 'teleavatar-gateway[policy,video]'."
)

_pixels = partial(integer, least=16, most=2048, what="side [pixels]")
_hz = partial(above_zero, most=100.0, what="rate [Hz]")
_steps = partial(integer, least=1, most=450, what="number of steps")
_smoothing = partial(between, least=0.0, most=1.0, what="time [s]")


def _function(text: str) -> str:
    """Return `MODULE:FUNCTION`, both perhaps with dots; raise ArgumentTypeError for anything else."""
    module, _, path = text.partition(":")
    if not all(word.isidentifier() for word in (*module.split("."), *path.split("."))):
        raise argparse.ArgumentTypeError(f"{text!r} is not of the form MODULE:FUNCTION, such as my_policy:act")
    return text


def add_policy(verbs: Any) -> None:  # noqa: ANN401  argparse's private class
    """Add `run`."""
    run = add_client_command(
        verbs,
        "run",
        "play a policy: of an openpi or LeRobot server, or a Python function",
        MORE,
        timeout_of="longest wait for the gateway, and an answer",
    )
    policy = run.add_mutually_exclusive_group(required=True)
    policy.add_argument(
        "--server", metavar="URL", help="of the policy: ws://HOST:PORT (openpi), grpc://HOST:PORT (LeRobot)"
    )
    policy.add_argument(
        "--local",
        type=_function,
        metavar="MODULE:FUNCTION",
        help="a policy in Python, of the current folder too, in a process of its own",
    )
    run.add_argument(
        "--policy", metavar="TYPE:NAME", help="what LeRobot's server shall load: act:FOLDER, or a name on its hub"
    )
    run.add_argument("--device", metavar="NAME", help="where LeRobot's server runs it: cuda, cpu, ... (default: cpu)")
    run.add_argument("--api-key-file", metavar="FILE", help="with the key that the server asks for")
    run.add_argument("--prompt", type=utf8_text, default="", metavar="TEXT", help="the task, in words")
    run.add_argument(
        "--map",
        metavar="FILE",
        help="what the policy is shown and says: vendor_openpi (default), left_eyes, lerobot (default with grpc://), or a file",
    )
    run.add_argument(
        "--resize", type=_pixels, metavar="N", help="make pictures N x N, with bars (default: as in --map)"
    )
    run.add_argument("--seconds", type=seconds, metavar="S", help="how long [s] (default: until Ctrl-C)")
    run.add_argument("--hz", type=_hz, metavar="HZ", help="steps a second (default: as the server says, else 30)")
    run.add_argument(
        "--horizon", type=_steps, default=0, metavar="N", help="steps played of a chunk (default: half of it)"
    )
    run.add_argument(
        "--smoothing",
        type=_smoothing,
        default=0.1,
        metavar="S",
        help="averages jitter over S around a step (default 0.1)",
    )
    run.add_argument(
        "--patience",
        type=seconds,
        default=10.0,
        metavar="S",
        help="how long a lost server and refused chunks are borne [s] (default %(default)g)",
    )
    run.add_argument(
        "--approach", action="store_true", help="move to a first step that is far away, with a motion of its own"
    )
    run.add_argument(
        "--until-contact", type=float, metavar="N", help="end well when a hand is pushed with so many newtons"
    )
    run.add_argument(
        "--direction", type=float, nargs=3, metavar=("X", "Y", "Z"), help="... along this, in the shoulder's frame"
    )
    run.add_argument(
        "--back-off", type=float, default=0.0, metavar="M", help="... and go back by so much of the way it came [m]"
    )
    looking = run.add_mutually_exclusive_group()
    looking.add_argument("--dry", action="store_true", help="ask and judge only: own nothing, send nothing")
    looking.add_argument(
        "--shadow",
        action="store_true",
        help="ask while somebody else moves the arms, and compare: own nothing, send nothing",
    )
    run.add_argument("--plot", metavar="FILE", help="draw joints as told and as measured to FILE (.png, .svg)")
    run.add_argument(
        "--video-port", type=udp_port, default=PORT, metavar="N", help="of the pictures (default %(default)s)"
    )
    run.add_argument("--hold", action="store_true", help="leave the arms held instead of pausing the robot")
    add_yes(run)
    add_take(run)
