"""`ta2 dataset build | check`: bags made into a dataset for training, and a dataset judged. Needs no robot and no gateway."""

from __future__ import annotations

import json
from argparse import Namespace
from dataclasses import asdict

from gateway.cli.terminal.ending import ExitStatus
from gateway.cli.terminal.progress import teller
from gateway.dataset.building import PROVENANCE, Built, Choices, build
from gateway.dataset.checking import CheckedDataset, check_dataset
from gateway.dataset.layout import load, vendor_layout
from gateway.dataset.lerobot_reader import Dataset

__all__ = ["carry_out"]


def carry_out(options: Namespace) -> ExitStatus:
    """Build or judge a dataset.

    Raises:
        Rejected: BAD_REQUEST, a bag, the layout, the folder or the dataset is not what it has to be.
    """
    return _check(options) if options.verb == "check" else _build(options)


def _build(options: Namespace) -> ExitStatus:
    choices = Choices(
        layout=load(options.layout) if options.layout else vendor_layout(int(options.dims)),
        version=options.format,
        fps=options.fps,
        task=options.task,
        success_only=options.success_only,
        least_rows=options.least_rows,
        by_arrival=options.by_arrival,
        eyes=options.eyes,
    )
    with teller() as tell:
        built = build(
            options.bags,
            options.out,
            choices,
            lambda what, share: tell.advance(what, share, f"{share:.0%}"),
            options.video,
        )
    if options.json:
        print(json.dumps(asdict(built) | {"ok": True, "folder": str(built.folder)}, ensure_ascii=False))
    else:
        _show(built, choices)
    return ExitStatus.OK


def _show(built: Built, choices: Choices) -> None:
    length_s = built.rows / choices.fps
    print(
        f"{built.folder}: {_count(built.episodes, 'episode')}, {built.rows} rows, {length_s:.1f} s, LeRobot {choices.version}"
    )
    for task in built.tasks:
        print(f"task      {task or '(none: policies that read a prompt learn nothing from it; --task TEXT)'}")
    for reason, count in built.left_out.items():
        print(f"left out  {count} x {reason}")
    for name, share in built.partly.items():
        print(f"partly    {name}: {share:.0%} of the rows, 0 in the others")
    for feature, parts in built.uncovered.items():
        print(f"zero      {feature}: nothing was recorded of {', '.join(parts)}")
    print(f"where each episode and dimension comes from: {built.folder / PROVENANCE}")


def _check(options: Namespace) -> ExitStatus:
    dataset = Dataset(options.dataset)
    with teller() as tell:
        checked = check_dataset(dataset, lambda share: tell.advance("check", share, f"{share:.0%}"))
    if options.json:
        print(json.dumps(asdict(checked) | {"ok": checked.ok}, ensure_ascii=False))
    else:
        _show_check(checked)
    return ExitStatus.OK if checked.ok else ExitStatus.REFUSED


def _show_check(checked: CheckedDataset) -> None:
    for finding in checked.findings:
        mark = "ERROR" if finding.level == "error" else finding.level
        print(f"{mark:<8}" + (f"{finding.where}: " if finding.where else "") + finding.message)
    verdict = "fit for training" if checked.ok else "not fit for training"
    print(f"LeRobot {checked.version}, {_count(checked.episodes, 'episode')}, {checked.rows} rows: {verdict}")


def _count(number: int, what: str) -> str:
    return f"{number} {what}" + ("" if number == 1 else "s")
