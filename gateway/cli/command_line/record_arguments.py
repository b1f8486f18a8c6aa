"""Arguments of `ta2 record`, `ta2 episode` and `ta2 bag`."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from gateway.cli.command_line.adding import add_command, utf8_text
from gateway.cli.command_line.numbers import seconds, udp_port
from gateway.cli.command_line.video_arguments import PORT

__all__ = ["add_bag", "add_episode", "complete_record"]

FORMATS = ("csv", "parquet")
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
    record.add_argument("--video", action="store_true", help="record the cameras, too, into the bag's folder")
    record.add_argument(
        "--video-port", type=udp_port, default=PORT, metavar="N", help=f"UDP port of the pictures (default {PORT})"
    )
    record.add_argument(
        "--aliases", action="store_true", help="keep commands under their names inside the robot, too, in the file only"
    )
    record.add_argument(
        "--task", type=utf8_text, default="", metavar="TEXT", help="what is shown, in words: noted in the bag"
    )


def add_episode(episode: argparse.ArgumentParser) -> None:
    """Add what `episode` takes; `options.verb` says what is asked."""
    episode.add_argument("verb", choices=EPISODE_VERBS, help="what to tell; status only asks")
    episode.add_argument(
        "text", type=utf8_text, nargs="*", metavar="TEXT", help="of a mark or a verdict; of start, the task"
    )
    episode.add_argument(
        "--task", type=utf8_text, default="", metavar="TEXT", help="what is shown, in words (default: the recording's)"
    )


def add_bag(commands: Any) -> None:  # noqa: ANN401  argparse's private class
    """Add `bag` and its verbs; `options.verb` says which verb it is."""
    more = "Reads bags of ours, and those of ROS 2 (MCAP or SQLite)."
    verbs = add_command(commands, "bag", "look at a recording", more).add_subparsers(
        title="what to do", dest="verb", metavar="VERB", required=True
    )
    listed = add_command(verbs, "list", "list the bags of a folder with their episodes, the newest first")
    listed.add_argument(
        "bag", type=Path, nargs="?", default=Path(), metavar="DIR", help="in which they lie (default: here)"
    )
    listed.add_argument("--json", action="store_true", help="print JSON on standard output")
    for name, text in (
        ("info", "show what a bag holds"),
        ("topics", "list its topics, the same"),
        ("check", "read every message, and say what is missing or wrong"),
    ):
        sub = add_command(verbs, name, text)
        _add_bag(sub)
    part = add_command(verbs, "cut", "copy a part of a bag into a new one", "Messages are copied byte for byte.")
    _add_bag(part, out="of the new bag")
    part.add_argument(
        "--from", dest="from_s", type=_moment, default=0.0, metavar="S", help="begin (default %(default)g)"
    )
    part.add_argument("--to", dest="to_s", type=seconds, metavar="S", help="end (default: that of the bag)")
    part.add_argument(
        "--episode", type=int, metavar="N", help="only this episode; --from and --to count from its begin"
    )
    merged = add_command(
        verbs, "merge", "put bags together into a new one, in the order of arrival", "Episodes are counted on."
    )
    _add_bag(merged, out="of the new bag", nargs="+")
    table = add_command(
        verbs, "export", "write tables: a file for each topic, a row for each message, a column for each value"
    )
    _add_bag(table, out="of the tables, made anew")
    table.add_argument(
        "--format", choices=FORMATS, default=FORMATS[0], help="default: %(default)s; parquet takes pyarrow"
    )
    table.add_argument("--topic", action="append", metavar="NAME", help="only this one; may be repeated")


def _add_bag(sub: argparse.ArgumentParser, out: str = "", nargs: str | None = None) -> None:
    sub.add_argument("bag", type=Path, nargs=nargs, metavar="DIR", help="its folder; or an .mcap file")
    if out:
        sub.add_argument("--out", type=Path, required=True, metavar="DIR", help=f"folder {out}")
    sub.add_argument("--json", action="store_true", help="print JSON on standard output")


def _moment(text: str) -> float:
    return 0.0 if text.strip() in ("0", "0.0") else seconds(text)
