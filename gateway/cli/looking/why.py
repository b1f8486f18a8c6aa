"""`ta2 why`: what keeps the robot from doing what it is told, with remedies. For scripts the same as JSON."""

from __future__ import annotations

import json
from argparse import Namespace
from collections.abc import Iterator

import msgspec
from rich.console import Console
from rich.text import Text

from gateway.cli.terminal.advice import next_steps
from gateway.cli.terminal.connection import connected
from gateway.cli.terminal.ending import ExitStatus, in_shell_words
from gateway.cli.terminal.style import STEP_MARKS, STEP_STYLES
from gateway.client import Why

__all__ = ["carry_out", "document", "lines"]


def carry_out(options: Namespace) -> ExitStatus:
    """Print it.

    Raises:
        Disconnected: No gateway answers.
    """
    with connected("why", options.target, options.timeout_s) as robot:
        info, state, why = robot.info, robot.state, robot.why()
    if options.json:
        print(json.dumps(document(why), ensure_ascii=False, indent=2))
        return ExitStatus.OK
    console = Console(highlight=False)
    for line in lines(why):
        console.print(line, soft_wrap=True)
    for kinds, reason in why.grouped():
        console.print(
            Text.assemble(("refused now: ", "dim"), (", ".join(kinds), "bold"), f"  {in_shell_words(reason)}"),
            soft_wrap=True,
        )
    for step in next_steps(state.view, info):
        if step.subject != "finding":
            console.print(Text(f"{STEP_MARKS[step.level]} {step.text}", style=STEP_STYLES[step.level]), soft_wrap=True)
    return ExitStatus.OK


def document(why: Why) -> dict[str, object]:
    """Return it for scripts."""
    return {
        "state": why.state,
        "latches": dict(why.latches),
        "findings": [
            {
                "code": finding.code,
                "message": finding.message,
                "hint": finding.hint,
                "since_s": round(finding.since, 3),
                "facts": dict(finding.facts),
            }
            for finding in why.findings
        ],
        "refusals": {kind: msgspec.to_builtins(refusal) for kind, refusal in why.refusals.items()},
    }


def lines(why: Why) -> Iterator[Text]:
    """Yield what was inferred: the code and since when, then what is seen, then what to do."""
    for finding in why.findings:
        yield Text.assemble((finding.code, "bold yellow"), f"  for {finding.since:.1f} s")
        yield Text(f"  {finding.message}")
        yield Text(f"  -> {in_shell_words(finding.hint)}", style="bold")
