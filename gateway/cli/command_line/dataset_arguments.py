"""Arguments of `ta2 dataset`."""

from __future__ import annotations

import argparse
from functools import partial
from pathlib import Path
from typing import Any

from gateway.cli.command_line.adding import add_command, utf8_text
from gateway.cli.command_line.numbers import above_zero, integer
from gateway.robot.vector_layout import EYES, STATE_WIDTHS

__all__ = ["add_dataset"]

MOST_FPS = 200.0
"""The robot's states come that often [Hz] (manual §4.1.1)."""
MOST_EPISODES = 1_000_000
DIMS = tuple(map(str, STATE_WIDTHS))
FORMATS = ("v2.1", "v3.0")
_fps = partial(above_zero, most=MOST_FPS, what="rows per second")
_rows = partial(integer, least=1, most=100_000, what="number of rows")
_episode = partial(integer, least=0, most=MOST_EPISODES, what="number of an episode")


def _episodes(text: str) -> list[int]:
    """Return the numbers of a list such as `0,3-5`."""
    found: list[int] = []
    for part in text.split(","):
        first, _, last = part.partition("-")
        found += range(_episode(first), (_episode(last) if last else _episode(first)) + 1)
    if not found:
        raise argparse.ArgumentTypeError(f"{text!r} names no episode")
    return found


def _picture(text: str) -> Path:
    path = Path(text)
    if path.suffix.lower() not in (".png", ".html"):
        raise argparse.ArgumentTypeError(f"{text!r} is no .png and no .html")
    return path


def add_dataset(commands: Any) -> None:  # noqa: ANN401  argparse's private class
    """Add `dataset` and its verbs; `options.verb` says which verb it is."""
    more = "Reads bags of `ta2 record`, of `ros2 bag record` (manual §5.4) and of the robot's own recorder. Needs no LeRobot."
    verbs = add_command(commands, "dataset", "make bags into a dataset for training", more).add_subparsers(
        title="what to do", dest="verb", metavar="VERB", required=True
    )
    build = add_command(verbs, "build", "make bags into a dataset that LeRobot and openpi load")
    build.add_argument(
        "bags", nargs="+", type=Path, metavar="DIR", help="folders of bags, in the order of their episodes"
    )
    build.add_argument("--out", type=Path, required=True, metavar="DIR", help="of the dataset, made anew")
    build.add_argument(
        "--format",
        choices=FORMATS,
        default="v2.1",
        help="of LeRobot: v2.1 for openpi, v3.0 for LeRobot from 0.4 on (default v2.1)",
    )
    build.add_argument(
        "--fps", type=_fps, default=45.0, metavar="HZ", help="rows per second (default 45, as the cameras)"
    )
    build.add_argument(
        "--task", type=utf8_text, default="", metavar="TEXT", help="what is shown, in words, instead of what was noted"
    )
    build.add_argument("--success-only", action="store_true", help="only episodes that were judged a success")
    layout = build.add_mutually_exclusive_group()
    layout.add_argument("--dims", choices=DIMS, default="72", help="of the maker's vector (default 72)")
    layout.add_argument(
        "--layout", type=Path, metavar="FILE", help="own vectors, in TOML: see the docs, Build a dataset"
    )
    build.add_argument(
        "--video",
        action="append",
        default=[],
        type=Path,
        metavar="FILE",
        help="of `ta2 video record`, one for each bag (default: the one in the bag's folder, if any)",
    )
    build.add_argument(
        "--eyes",
        choices=tuple(EYES),
        default=next(iter(EYES)),
        help="which views the cameras are: see the docs (default vendor_openpi)",
    )
    build.add_argument(
        "--least-rows", type=_rows, default=30, metavar="N", help="leave out shorter episodes (default 30)"
    )
    build.add_argument("--by-arrival", action="store_true", help="go by messages' arrivals, not by their stamps")
    check = add_command(verbs, "check", "read a dataset, and say what is missing or wrong")
    show = add_command(verbs, "show", "show what a dataset holds, and what happens in an episode of it")
    show.add_argument("--episode", type=_episode, metavar="N", help="this one, from 0 on (drawn without it: 0)")
    show.add_argument("--out", type=_picture, metavar="FILE", help="draw it: pictures and vectors, .png or .html")
    diff = add_command(
        verbs, "diff", "say in what two datasets differ", "Format and coding aside; status 1 if they do."
    )
    diff.add_argument("dataset", type=Path, metavar="DIR", help="one")
    diff.add_argument("other", type=Path, metavar="DIR", help="the other")
    merge = add_command(verbs, "merge", "put datasets together into a new one", "No video is encoded anew.")
    merge.add_argument("datasets", nargs="+", type=Path, metavar="DIR", help="in the order of their episodes")
    split = add_command(verbs, "split", "copy episodes of a dataset into a new one", "No video is encoded anew.")
    split.add_argument("--episodes", type=_episodes, required=True, metavar="LIST", help="from 0 on, such as 0,3-5")
    for sub in (merge, split):
        sub.add_argument("--out", type=Path, required=True, metavar="DIR", help="of the dataset, made anew")
    for sub in (check, show, split):
        sub.add_argument("dataset", type=Path, metavar="DIR", help="its folder, the one with meta/ in it")
    for sub in (build, check, show, diff, merge, split):
        sub.add_argument("--json", action="store_true", help="print JSON on standard output")
