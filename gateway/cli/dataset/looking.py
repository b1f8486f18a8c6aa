"""`ta2 dataset show | diff`: what a dataset holds, an episode of it as a picture; in what two of them differ."""

from __future__ import annotations

import json
from argparse import Namespace
from dataclasses import asdict

from gateway.cli.terminal.ending import ExitStatus
from gateway.cli.terminal.progress import teller
from gateway.dataset.differing import differences
from gateway.dataset.drawing import draw, groups_of
from gateway.dataset.lerobot_reader import Dataset
from gateway.errors import Code, failure

__all__ = ["counted", "diff", "show"]


def counted(number: int, what: str) -> str:
    """Return a number of things in words."""
    return f"{number} {what}" + ("" if number == 1 else "s")


def show(options: Namespace) -> ExitStatus:
    """Show a dataset, or an episode; draw it where a file is named.

    Raises:
        Rejected: BAD_REQUEST, it cannot be read, has no such episode, or cannot be drawn.
    """
    try:
        return _shown(options)
    except (OSError, ValueError, LookupError) as error:
        message = f"{options.dataset} cannot be shown: {type(error).__name__}: {error}"
        hint = "`ta2 dataset check` says what is wrong with it"
        raise failure(Code.BAD_REQUEST, message, field="dataset", hint=hint) from error


def _shown(options: Namespace) -> ExitStatus:
    dataset = Dataset(options.dataset)
    number, episode, fps = options.episode or 0, None, dataset.fps
    episodes, rows = (int(dataset.info.get(name, 0)) for name in ("total_episodes", "total_frames"))
    if options.episode is not None or options.out is not None:
        episode = next(dataset.readable([number]), None)
        if episode is None:
            message, bound = f"{dataset.folder} has no episode {number}", f"0 to {episodes - 1}"
            raise failure(Code.BAD_REQUEST, message, field="episode", bound=bound)
    if options.out is not None and episode is not None:
        title = f"{dataset.folder.resolve().name}, episode {number}: {', '.join(episode.tasks)}"
        draw(dataset, episode, title, options.out)
    tasks, vectors = list(dataset.tasks().values()), groups_of(dataset)
    if options.json:
        facts = {"ok": True, "version": dataset.version, "episodes": episodes, "rows": rows, "fps": fps, "tasks": tasks}
        cameras = {name: dataset.features[name]["shape"] for name in dataset.cameras}
        file = str(options.out or "")
        print(json.dumps(facts | {"vectors": vectors, "cameras": cameras, "file": file}, ensure_ascii=False))
        return ExitStatus.OK
    if options.out is not None:
        print(options.out)
        return ExitStatus.OK
    much = f"{counted(episodes, 'episode')}, {rows} rows, {rows / fps:.1f} s"
    print(f"{dataset.folder}: LeRobot {dataset.version}, {much}, {fps:g} rows per second")
    for task in tasks:
        print(f"task      {task or '(none)'}")
    for name, groups in vectors.items():
        print(f"vector    {name}: {counted(sum(len(names) for names, _ in groups), 'dimension')}")
        for names, unit in groups:
            label = names[0] if len(names) == 1 else f"{names[0]} .. {names[-1]}"
            print(f"            {label}" + (f" [{unit}]" if unit else ""))
    for name in dataset.cameras:
        height, width, *_ = dataset.features[name]["shape"]
        print(f"camera    {name}: {width} x {height}")
    if episode is not None:
        print(f"episode   {number}: {episode.rows} rows, {episode.rows / fps:.1f} s, {', '.join(episode.tasks)}")
    return ExitStatus.OK


def diff(options: Namespace) -> ExitStatus:
    """Say in what two datasets differ.

    Raises:
        Rejected: BAD_REQUEST, one of them cannot be read.
    """
    a, b = Dataset(options.dataset), Dataset(options.other)
    with teller() as tell:
        found = differences(a, b, lambda share: tell.advance("diff", share, f"{share:.0%}"))
    if options.json:
        print(json.dumps({"ok": not found, "differences": [asdict(one) for one in found]}, ensure_ascii=False))
    else:
        for one in found:
            print(": ".join(filter(None, (one.where, one.feature, one.message))))
        print("they differ" if found else "they hold the same")
    return ExitStatus.REFUSED if found else ExitStatus.OK
