"""The command that follows a file, as data; part of `arguments.py`, which gives it its parser."""

from __future__ import annotations

import argparse
import math
from functools import partial
from pathlib import Path

from gateway.cli.command_line.numbers import between, integer

__all__ = ["add_follow", "add_replay"]

FILES_HELP = """files:
  FILE.npy   an array of shape (N, 7) for one arm, (N, 14) for both, the left one first
  FILE.npz   arrays `left`, `right` of shape (N, 7); `times` (N,) or `dt`; `space`
  FILE.json  an object with the same names, or the rows alone
  FILE.csv   7 or 14 numbers a line, 8 or 15 with the time first; or a first line with
             names: time, left_1 ... left_7, right_1 ..., left_x left_y left_z left_qx ...

Joints [rad] in the order of manual §4.0.3; poses as x, y, z [m], qx, qy, qz, qw in the
arm's shoulder frame; times [s] rise and count from the first one. The whole file is judged before
anything moves. Ctrl-C leaves the arms held."""

_episode = partial(integer, least=1, most=100_000, what="number of an episode")
_stretch = partial(between, least=1.0, most=100.0, what="factor")


def add_follow(follow: argparse.ArgumentParser) -> None:
    """Add the options of `follow`."""
    follow.formatter_class = argparse.RawDescriptionHelpFormatter
    follow.epilog = FILES_HELP
    follow.add_argument("file", metavar="FILE", help="a trajectory: .npy, .npz, .csv or .json")
    follow.add_argument(
        "--arm", choices=("left", "right", "both"), default="", help="which arm (default: those in the file)"
    )
    follow.add_argument(
        "--space",
        choices=("joint", "pose"),
        default="",
        help="what the numbers are (default: as the file says, else joint)",
    )
    follow.add_argument(
        "--dt", type=_positive, metavar="S", help="time from point to point [s], for a file that has no times"
    )
    follow.add_argument(
        "--stretch", type=_stretch, default=1.0, metavar="F", help="makes all of it so many times slower, 1 to 100"
    )
    follow.add_argument(
        "--smoothing",
        type=_positive,
        default=0.0,
        metavar="S",
        help="average jitter over so much time on each side [s]",
    )
    start = follow.add_mutually_exclusive_group()
    start.add_argument("--start-in", type=_number, metavar="S", help="begin so long after enabling [s], up to 10")
    start.add_argument(
        "--start-at",
        type=_number,
        metavar="T",
        help="begin at this time on the monotonic clock of the gateway's host [s]",
    )
    follow.add_argument("--approach", action="store_true", help="move the arms to the first point before, with --speed")
    for name, what in (
        ("tolerance", "reached within this of the last point"),
        ("path-tolerance", "end it when farther away"),
    ):
        follow.add_argument(
            f"--{name}",
            nargs="+",
            type=_positive,
            metavar="D",
            help=f"{what}: one or seven distances [rad], of poses two [m, rad]",
        )
    follow.add_argument("--check", action="store_true", help="only say whether it could be followed; nothing moves")


def add_replay(replay: argparse.ArgumentParser) -> None:
    """Add the options of `replay`; as `add_follow`."""
    replay.add_argument("bag", metavar="DIR", help="a recording: of `ta2 record` or another of ROS 2")
    replay.add_argument("--episode", type=_episode, metavar="N", help="which one (default: the first not discarded)")
    replay.add_argument(
        "--arm", choices=("left", "right", "both"), default="", help="which arm (default: those in the recording)"
    )
    replay.add_argument(
        "--stretch", type=_stretch, default=1.0, metavar="F", help="makes all of it so many times slower, 1 to 100"
    )
    replay.add_argument(
        "--smoothing",
        type=_positive,
        default=0.1,
        metavar="S",
        help="average jitter over so much time on each side [s] (default %(default)s)",
    )
    replay.add_argument("--approach", action="store_true", help="move the arms to the first point before, with --speed")
    replay.add_argument("--check", action="store_true", help="only say whether it could be replayed; nothing moves")
    replay.add_argument(
        "--plot", type=Path, metavar="FILE", help="draw joints beside the recorded ones (.png, .svg, .pdf)"
    )
    replay.add_argument("--view", action="store_true", help="show the robot meanwhile, as `ta2 view` does")


def _number(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise argparse.ArgumentTypeError(f"{text.strip()!r} is no number")
    return value


def _positive(text: str) -> float:
    value = _number(text)
    if value <= 0.0:
        raise argparse.ArgumentTypeError(f"{text.strip()!r} is not above 0")
    return value
