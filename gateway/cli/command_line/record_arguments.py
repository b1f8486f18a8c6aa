"""Arguments of `ta2 record`, `ta2 episode` and `ta2 bag`."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from gateway.cli.command_line.numbers import seconds
from gateway.cli.command_line.video_arguments import AddCommand

__all__ = ["add_bag", "add_episode", "complete_record"]

EPISODE_VERBS = ("start", "stop", "mark", "success", "failure", "discard", "status")


def complete_record(record: argparse.ArgumentParser) -> None:
    """Add what `record` takes beside the robot and the gateway."""
    record.add_argument(
        "verb",
        nargs="?",
        choices=("recover",),
        help="make a bag whole whose recorder was killed, in the folder that follows",
    )
    record.add_argument("folder", nargs="?", type=Path, metavar="DIR", help="of the bag that is to be recovered")
    record.add_argument("--out", type=Path, metavar="DIR", help="of the bag, made anew (default: ta2-DATE-TIME here)")
    record.add_argument("--seconds", type=seconds, metavar="S", help="how long [s] (default: until Ctrl-C)")
    record.add_argument("--task", default="", metavar="TEXT", help="what is shown, in words: noted in the bag")


def add_episode(episode: argparse.ArgumentParser) -> None:
    """Add what `episode` takes; `options.verb` says what is asked."""
    episode.add_argument("verb", choices=EPISODE_VERBS, help="what to tell; status only asks")
    episode.add_argument("text", nargs="*", metavar="TEXT", help="of a mark or a verdict; of start, the task")
    episode.add_argument(
        "--task", default="", metavar="TEXT", help="what is shown, in words (default: the recording's)"
    )


def add_bag(commands: Any, add: AddCommand) -> None:  # noqa: ANN401  argparse's private class
    """Add `bag` and its verbs; `options.verb` says which verb it is."""
    more = "Reads bags of ours, and those of ROS 2 (MCAP or SQLite)."
    verbs = add(commands, "bag", "look at a recording", more).add_subparsers(
        title="what to do", dest="verb", metavar="VERB", required=True
    )
    for name, text in (
        ("info", "show what a bag holds"),
        ("topics", "list its topics, the same"),
        ("check", "read every message, and say what is missing or wrong"),
    ):
        sub = add(verbs, name, text)
        sub.add_argument("bag", type=Path, metavar="DIR", help="its folder; or an .mcap file")
        sub.add_argument("--json", action="store_true", help="print JSON on standard output")
