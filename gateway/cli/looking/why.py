"""`ta2 why`: what keeps the robot from doing what it is told, with remedies. For scripts the same as JSON.

With --since what was told in a time, from the files of the black box: the only part that needs no gateway.
"""

from __future__ import annotations

import json
import time
from argparse import Namespace
from collections.abc import Iterator
from datetime import datetime, timezone

import msgspec
from rich.console import Console
from rich.text import Text

from gateway.cli.looking.boxes import boxes, places
from gateway.cli.terminal.advice import next_steps
from gateway.cli.terminal.connection import connected
from gateway.cli.terminal.ending import ExitStatus, in_shell_words
from gateway.cli.terminal.style import STEP_MARKS, STEP_STYLES
from gateway.client import Why
from gateway.errors import Code, failure

__all__ = ["carry_out", "document", "lines"]


def carry_out(options: Namespace) -> ExitStatus:
    """Print it.

    Raises:
        Disconnected: No gateway answers.
    """
    if options.since is not None:
        return _told_since(time.time() - options.since, as_json=options.json)
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


def _told_since(since_s: float, *, as_json: bool) -> ExitStatus:
    """Print what the gateways of this user, and of a service, told and refused, from their files, the oldest first."""
    from gateway.incident.event_log import read_events

    among = places()
    folders, status = boxes(among)
    try:
        told = [(event, folder.name) for folder in folders for event in read_events(folder, since_s)]
    except OSError as error:
        raise failure(Code.BAD_REQUEST, str(error), field="since") from None
    for event, robot in sorted(told, key=lambda each: float(str(each[0]["t"]))):
        if as_json:
            print(json.dumps({**event, "robot": robot}, ensure_ascii=False))
            continue
        when = (
            datetime.fromtimestamp(float(str(event["t"])), timezone.utc).astimezone().strftime("%m-%d %H:%M:%S.%f")[:-3]
        )
        who = f"refused to {event['client']}" if event.get("event") == "refused" else event.get("level", "")
        more = f" ({event['more']} more before)" if event.get("more") else ""
        at = f"{robot}  " if len(folders) > 1 else ""
        print(f"{when}  {at}{who}  {event.get('code')}: {event.get('message')}{more}")
    if not (told or as_json):
        print(f"nothing was told in that time, as far as is written in {' and '.join(map(str, among))}")
    return status


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
