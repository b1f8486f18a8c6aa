"""`ta2 bag`: what a bag or a folder of them holds, whether it is fit for use, and what is made of it (cut, merge, export)."""

from __future__ import annotations

import json
from argparse import Namespace
from contextlib import ExitStack
from datetime import datetime, timezone
from pathlib import Path
from typing import Any

from msgspec import to_builtins
from msgspec.structs import asdict
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from gateway.cli.terminal.ending import ExitStatus
from gateway.cli.terminal.progress import teller
from gateway.errors import Code, GatewayError, failure
from gateway.recording.bag_check import Checked, check
from gateway.recording.bag_reader import Bag
from gateway.recording.bag_writer import ACTIVE, METADATA
from gateway.recording.editing import Made, cut, merge
from gateway.recording.episodes import episodes, told_episodes
from gateway.recording.exporting import export

__all__ = ["carry_out"]

MOST_LISTED = 50
MARKS = {"error": "ERROR", "warning": "warning"}


def carry_out(options: Namespace) -> ExitStatus:
    """Show or judge a bag, list those of a folder, or make something of one.

    Raises:
        Rejected: BAD_REQUEST, there is none, it cannot be read, or there is no such part of it.
    """
    if options.verb in ("cut", "merge", "export"):
        return _make(options)
    if options.verb == "list":
        return _list(options.bag, as_json=options.json)
    with Bag(options.bag) as bag:
        if options.verb == "check":
            with teller() as tell:
                checked = check(bag, lambda share: tell.advance("check", share, f"{share:.0%}"))
            _show_check(checked, as_json=options.json)
            return ExitStatus.OK if checked.ok else ExitStatus.REFUSED
        _show_info(bag, as_json=options.json)
        return ExitStatus.OK


def _make(options: Namespace) -> ExitStatus:
    """Make a bag or tables, and say what came of it."""
    with ExitStack() as opened, teller() as tell:

        def on_progress(share: float, name: str = "") -> None:
            tell.advance(options.verb, share, f"{share:.0%} {name}".rstrip())

        bags = [opened.enter_context(Bag(path)) for path in ([options.bag] if options.verb != "merge" else options.bag)]
        if options.verb == "export":
            tables = export(bags[0], options.out, options.format, options.topic, on_progress)
            made: Made | None = None
        elif options.verb == "merge":
            made = merge(bags, options.out, on_progress)
        else:
            part = {"from_s": options.from_s, "to_s": options.to_s, "episode": options.episode}
            made = cut(bags[0], options.out, **part, on_progress=on_progress)
    if made is None:
        if options.json:
            print(json.dumps({"ok": True, "tables": [asdict(t) | {"file": str(t.file or "")} for t in tables]}))
            return ExitStatus.OK
        for table in tables:
            skipped = f", {table.malformed} malformed ones left out" if table.malformed else ""
            print(f"{table.file or table.topic}: {table.why or f'{table.rows} rows, {table.columns} columns'}{skipped}")
        return ExitStatus.OK
    if options.json:
        print(json.dumps({"ok": True, **asdict(made), "file": str(made.file)}))
    else:
        print(f"{made.file}: {made.messages} messages, {made.episodes} episodes")
    return ExitStatus.OK


def _list(folder: Path, *, as_json: bool) -> ExitStatus:
    """Show the bags of a folder, the newest first; one that cannot be read says why: it goes on, perhaps."""
    try:
        found = [path for path in folder.resolve().iterdir() if _is_bag(path)]
        found.sort(key=lambda path: path.stat().st_mtime_ns, reverse=True)
    except OSError as error:
        message, hint = f"{folder}: {error.strerror or error}", "name a folder in which bags lie"
        raise failure(Code.BAD_REQUEST, message, field="bag", hint=hint) from None
    rows = [_listed(path) for path in found[:MOST_LISTED]]
    if as_json:
        print(json.dumps({"ok": True, "count": len(found), "bags": rows}, ensure_ascii=False))
        return ExitStatus.OK
    if not rows:
        print(f"no bags in {folder}")
    for row in rows:
        print(f"{Path(row['bag']).name}: ", end="")
        print(row["problem"] or f"{row['duration_s']:.1f} s, {_counted(row)} {row['task']}".rstrip())
    return ExitStatus.OK


def _counted(row: dict[str, Any]) -> str:
    """Return how many episodes somebody told of; without, all of a bag counts as one."""
    count = len(row["episodes"]) if row["is_told"] else 0
    return f"{count or 'no'} episode{'' if count == 1 else 's'}"


def _listed(path: Path) -> dict[str, Any]:
    try:
        with Bag(path) as bag:
            known = {"begin_ns": bag.begin_ns, "duration_s": bag.duration_s, "size_bytes": bag.size_bytes}
            told = told_episodes(bag)
            return {
                "bag": str(path),
                "problem": "",
                **known,
                "task": bag.facts().get("task", ""),
                "episodes": [asdict(episode) for episode in (episodes(bag) if told is None else told)],
                "is_told": told is not None,
            }
    except GatewayError as error:
        return {"bag": str(path), "problem": error.message}


def _is_bag(path: Path) -> bool:
    names = (
        path / METADATA,
        *path.glob("*.mcap"),
        *path.glob(f"*{ACTIVE}"),
        *([path] if path.suffix == ".mcap" else ()),
    )
    return any(name.is_file() for name in names)


def _show_info(bag: Bag, *, as_json: bool) -> None:
    facts, begun = bag.facts(), datetime.fromtimestamp(bag.begin_ns / 1e9, tz=timezone.utc).astimezone()
    if as_json:
        topics = [asdict(topic) for topic in bag.topics]
        print(
            json.dumps(
                {
                    "bag": str(bag.path),
                    "begin_ns": bag.begin_ns,
                    "duration_s": bag.duration_s,
                    "messages": bag.message_count,
                    "size_bytes": bag.size_bytes,
                    "facts": dict(facts),
                    "episodes": [asdict(episode) for episode in episodes(bag)],
                    "topics": topics,
                },
                ensure_ascii=False,
            )
        )
        return
    print(f"{bag.path}: {bag.duration_s:.1f} s from {begun:%Y-%m-%d %H:%M:%S}, {bag.message_count} messages, ", end="")
    print(f"{bag.size_bytes / 1e6:.1f} MB")
    for name in ("robot", "model", "task"):
        if facts.get(name):
            print(f"{name:<8}{facts[name]}")
    for topic in bag.topics:
        if topic.alias_of:
            print(f"alias   {topic.name} of {topic.alias_of}")
    _show_episodes(bag)
    table = Table("topic", "type", box=None, pad_edge=False)
    table.add_column("messages", justify="right")
    table.add_column("Hz", justify="right")
    for topic in bag.topics:
        rate = f"{topic.count / bag.duration_s:.1f}" if bag.duration_s else ""
        table.add_row(topic.name, topic.type_name, str(topic.count), rate)
    Console(soft_wrap=True, highlight=False).print(table)


def _show_episodes(bag: Bag) -> None:
    """Show them as a table, where somebody told of any."""
    told = told_episodes(bag)
    if told is None:
        return
    table = Table("episode", box=None, pad_edge=False)
    for name in (r"from \[s]", r"length \[s]"):
        table.add_column(name, justify="right")
    for name in ("outcome", "marks", "task"):
        table.add_column(name)
    for episode in told:
        begin_s, length_s = (episode.begin_ns - bag.begin_ns) / 1e9, (episode.end_ns - episode.begin_ns) / 1e9
        outcome = "discarded" if episode.is_discarded else episode.outcome
        words = [
            f"{begin_s:.2f}",
            f"{length_s:.2f}",
            outcome if episode.is_finished else f"{outcome} unfinished".strip(),
        ]
        table.add_row(str(episode.number), *words, str(len(episode.marks)), escape(episode.task))
    Console(soft_wrap=True, highlight=False).print(table)


def _show_check(checked: Checked, *, as_json: bool) -> None:
    if as_json:
        print(json.dumps(to_builtins(checked) | {"ok": checked.ok}, ensure_ascii=False))
        return
    for finding in checked.findings:
        where = f"{finding.topic}: " if finding.topic else ""
        print(f"{MARKS[finding.level]:<8}{where}{finding.message}" + (f" -> {finding.hint}" if finding.hint else ""))
    verdict = "fit for use" if checked.ok else "not fit for use"
    if checked.ok and not checked.findings:
        verdict = "nothing is wrong"
    print(f"{checked.messages} messages in {checked.duration_s:.1f} s: {verdict}")
