"""`ta2 dataset`: bags made into a dataset for training; datasets judged, put together, taken apart. Needs no robot."""

from __future__ import annotations

import json
from argparse import Namespace
from dataclasses import asdict

from gateway.cli.dataset.looking import counted, diff, show
from gateway.cli.terminal.ending import ExitStatus
from gateway.cli.terminal.progress import teller
from gateway.dataset.building import PROVENANCE, Built, Choices, build
from gateway.dataset.checking import CheckedDataset, check_dataset
from gateway.dataset.editing import merge, split
from gateway.dataset.layout import load, vendor_layout
from gateway.dataset.lerobot_reader import Dataset

__all__ = ["carry_out"]


def carry_out(options: Namespace) -> ExitStatus:
    """Do what the verb says.

    Raises:
        Rejected: BAD_REQUEST, a bag, the layout, the folder or the dataset is not what it has to be.
    """
    verbs = {"check": _check, "merge": _edit, "split": _edit, "show": show, "diff": diff}
    return verbs.get(options.verb, _build)(options)


def _edit(options: Namespace) -> ExitStatus:
    with teller() as tell:

        def on_progress(share: float) -> None:
            tell.advance(options.verb, share, f"{share:.0%}")

        if options.verb == "merge":
            made = merge([Dataset(folder) for folder in options.datasets], options.out, on_progress)
        else:
            made = split(Dataset(options.dataset), options.episodes, options.out, on_progress)
    if options.json:
        print(json.dumps(asdict(made) | {"ok": True, "folder": str(made.folder)}, ensure_ascii=False))
    else:
        print(f"{made.folder}: {counted(made.episodes, 'episode')}, {made.rows} rows")
    return ExitStatus.OK


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
        f"{built.folder}: {counted(built.episodes, 'episode')}, {built.rows} rows, {length_s:.1f} s, LeRobot {choices.version}"
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
    print(f"LeRobot {checked.version}, {counted(checked.episodes, 'episode')}, {checked.rows} rows: {verdict}")
