"""`ta2 dataset show | diff`: what a dataset holds, an episode of it as a picture; in what two of them differ."""

from __future__ import annotations

import json
import math
from argparse import Namespace
from dataclasses import asdict
from typing import Any

from gateway.cli.terminal.ending import ExitStatus
from gateway.cli.terminal.progress import teller
from gateway.dataset.differing import differences
from gateway.dataset.drawing import draw, parts_of
from gateway.dataset.lerobot_reader import Dataset, EpisodeRead
from gateway.errors import Code, Refusal, to_exception

__all__ = ["counted", "diff", "show"]


def counted(number: int, what: str) -> str:
    """Return a number of things in words."""
    return f"{number} {what}" + ("" if number == 1 else "s")


def show(options: Namespace) -> ExitStatus:
    """Show a dataset, or an episode; draw it where a file is named.

    Raises:
        Rejected: BAD_REQUEST, it cannot be read, has no such episode, or cannot be drawn.
    """
    dataset = Dataset(options.dataset)
    number = options.episode or 0
    episode = None if options.episode is None and options.out is None else next(dataset.readable([number]), None)
    if episode is None and (options.episode is not None or options.out is not None):
        bound = f"0 to {int(dataset.info.get('total_episodes', 0)) - 1}"
        message = f"{dataset.folder} has no episode {number}"
        raise to_exception(
            Refusal(code=Code.BAD_REQUEST, message=message, field="episode", value=str(number), bound=bound)
        )
    facts = _facts(dataset, episode)
    if options.out is not None and episode is not None:
        title = f"{dataset.folder.resolve().name}, episode {number}: {', '.join(episode.tasks)}"
        try:
            draw(dataset, episode, title, options.out)
        except (OSError, ValueError) as error:
            message = f"{options.out} cannot be drawn: {error}"
            raise to_exception(Refusal(code=Code.BAD_REQUEST, message=message, field="out")) from error
        facts["file"] = str(options.out)
    if options.json:
        print(json.dumps(facts, ensure_ascii=False))
    elif options.out is not None:
        print(options.out)
    else:
        _print(facts)
    return ExitStatus.OK


def _facts(dataset: Dataset, episode: EpisodeRead | None) -> dict[str, Any]:
    try:
        tasks = dataset.tasks()
    except Exception as error:  # files of others: whatever a reader meets says that they cannot be read
        message, hint = f"{dataset.folder} cannot be read: {error!r}", "`ta2 dataset check` says what is wrong with it"
        raise to_exception(Refusal(code=Code.BAD_REQUEST, message=message, field="dataset", hint=hint)) from error
    facts: dict[str, Any] = {
        "ok": True,
        "dataset": str(dataset.folder),
        "version": dataset.version,
        "episodes": int(dataset.info.get("total_episodes", 0)),
        "rows": int(dataset.info.get("total_frames", 0)),
        "fps": dataset.fps,
        "tasks": list(tasks.values()),
        "vectors": {
            name: [{"names": names, "unit": unit} for names, unit in mine] for name, mine in parts_of(dataset).items()
        },
        "cameras": {name: dataset.features[name]["shape"] for name in dataset.cameras},
    }
    if episode is not None:
        facts["episode"] = {"number": episode.number, "rows": episode.rows, "tasks": list(episode.tasks)}
    return facts


def _print(facts: dict[str, Any]) -> None:
    fps = facts["fps"]
    much = f"{counted(facts['episodes'], 'episode')}, {facts['rows']} rows, {facts['rows'] / fps:.1f} s"
    print(f"{facts['dataset']}: LeRobot {facts['version']}, {much}, {fps:g} rows per second")
    for task in facts["tasks"]:
        print(f"task      {task or '(none)'}")
    for name, parts in facts["vectors"].items():
        print(f"vector    {name}: {counted(sum(len(part['names']) for part in parts), 'dimension')}")
        for part in parts:
            names = part["names"][0] if len(part["names"]) == 1 else f"{part['names'][0]} .. {part['names'][-1]}"
            print(f"            {names}" + (f" [{part['unit']}]" if part["unit"] else ""))
    for name, shape in facts["cameras"].items():
        print(f"camera    {name}: {shape[1]} x {shape[0]}")
    if "episode" in facts:
        one = facts["episode"]
        print(f"episode   {one['number']}: {one['rows']} rows, {one['rows'] / fps:.1f} s, {', '.join(one['tasks'])}")


def diff(options: Namespace) -> ExitStatus:
    """Say in what two datasets differ.

    Raises:
        Rejected: BAD_REQUEST, one of them cannot be read.
    """
    a, b = Dataset(options.dataset), Dataset(options.other)
    with teller() as tell:
        found = differences(a, b, lambda share: tell.advance("diff", share, f"{share:.0%}"))
    if options.json:
        told = [asdict(one) | {"largest": one.largest if math.isfinite(one.largest) else None} for one in found]
        print(json.dumps({"ok": not found, "differences": told}, ensure_ascii=False))
    else:
        for one in found:
            print(": ".join(filter(None, (one.where, one.feature, one.message))))
        print("they differ" if found else "they hold the same")
    return ExitStatus.REFUSED if found else ExitStatus.OK
