"""`ta2 topics`: every public topic of the robot with what is measured of it. For scripts the same as JSON."""

from __future__ import annotations

import json
from argparse import Namespace
from collections.abc import Iterator, Sequence

import msgspec
from rich.console import Console
from rich.text import Text

from gateway.api import protocol
from gateway.cli.terminal.connection import connected
from gateway.cli.terminal.ending import ExitStatus
from gateway.cli.terminal.figures import age_limit_ns, age_text, rate_text
from gateway.cli.terminal.others import foreign_on, other_text
from gateway.robot.topics import COMMAND_TOPICS, STATE_TOPICS, TOPICS, VARIANTS

__all__ = ["carry_out", "document", "foreign_lines", "lines", "route_lines"]

READY = "ready"
"""What the gateway says of a route that works."""

SLOW = 0.8
"""A topic below this part of its nominal rate is slow."""

STATE_COLUMNS = (27, -10, 7, 8, 7, 9, 4, 7)
COMMAND_COLUMNS = (26, -17, 7, 8, 7, 8, 7, 7)
"""Widths; a negative one is aligned to the left."""


def carry_out(options: Namespace) -> ExitStatus:
    """Print them.

    Raises:
        Disconnected: No gateway answers.
    """
    with connected("topics", options.target, options.timeout_s) as robot:
        info, view, routes = robot.info, robot.state.view, robot.routes()
    if options.json:
        print(json.dumps(document(info, view, routes), indent=2))
        return ExitStatus.OK
    Console(highlight=False).print(
        *lines(info, view), *route_lines(routes), *foreign_lines(view), sep="\n", soft_wrap=True
    )
    return ExitStatus.OK


def document(info: protocol.Info, view: protocol.Snapshot, routes: protocol.Routes) -> dict[str, object]:
    """Return the topics for scripts: times in seconds, rates in hertz, null for what is not known."""
    topics: dict[str, object] = {}
    for name in (*STATE_TOPICS, *VARIANTS[info.model].command_topics):
        topic = TOPICS[name]
        row: dict[str, object] = {
            "direction": topic.direction.value,
            "type": topic.type_name,
            "section": topic.section,
            "nominal_hz": topic.rate_hz,
            "route": routes.routes.get(name),
        }
        state, stream = view.topics.get(name), view.streams.get(name)
        if state is not None:
            row |= {
                "rate_hz": state.rate_hz,
                "age_s": None if state.age_ns is None else state.age_ns / 1e9,
                "worst_gap_s": state.worst_gap_ns / 1e9,
                "count": state.count,
                "duplicates": state.duplicates,
                "refused": state.refused,
            }
        if stream is not None:
            row |= {
                "running": stream.running,
                "sent": stream.sent,
                "rate_hz": stream.rate_hz,
                "worst_gap_s": stream.worst_gap_ns / 1e9,
                "foreign": [msgspec.to_builtins(other) for other in foreign_on(view, name)],
            }
        topics[name] = row
    return topics


def lines(info: protocol.Info, view: protocol.Snapshot) -> Iterator[Text]:
    """Yield two tables: what comes from the robot, what goes to it."""
    titles = ("FROM THE ROBOT", "type", "nominal", "Hz", "age", "worst gap", "dup", "refused")
    yield _row(titles, STATE_COLUMNS, "bold")
    for name in STATE_TOPICS:
        yield _state(name, view.topics.get(name))
    yield Text()
    titles = ("TO THE ROBOT", "type", "nominal", "Hz", "gap", "at most", "sent", "")
    yield _row(titles, COMMAND_COLUMNS, "bold")
    for name in VARIANTS[info.model].command_topics:
        yield _command(name, view.streams.get(name))


def route_lines(routes: protocol.Routes) -> Iterator[Text]:
    """Yield how the robot's bridge stands to the topics: in one line when all is well, else a line for each that is not."""
    if not routes.routes:
        return
    bridge = f"the robot's bridge ({routes.bridge_version})" if routes.bridge_version else "the robot's bridge"
    troubled = {name: words for name, words in routes.routes.items() if words != READY}
    yield Text()
    if troubled:
        yield Text(f"{bridge}: {len(troubled)} of {len(routes.routes)} routes are not ready", style="yellow")
    else:
        yield Text(f"{bridge}: all {len(routes.routes)} routes are ready")
    for name, words in troubled.items():
        yield Text(f"  {name}: {words}", style="yellow")
    if routes.undelivered:
        yield Text(f"  {routes.undelivered} frames were not sent for want of a transport", style="yellow")


def foreign_lines(view: protocol.Snapshot) -> Iterator[Text]:
    """Yield who else sends on a command topic, or announces it; nothing where nobody does."""
    found = [(name, other) for name in COMMAND_TOPICS for other in foreign_on(view, name)]
    if found:
        yield Text()
        yield Text("somebody else is on the robot's command topics (manual §3.3.2):", style="red")
    for name, other in found:
        yield Text(f"  {name}: {other_text(other, view.at_ns)}", style="red")


def _row(values: Sequence[str], widths: Sequence[int], style: str) -> Text:
    first, *rest = (f"{v:>{w}}" if w > 0 else f"{v:<{-w}}" for v, w in zip(values, widths, strict=True))
    return Text(" ".join([first.strip().ljust(abs(widths[0])), *rest]).rstrip(), style=style)


def _state(name: str, view: protocol.TopicView | None) -> Text:
    topic = TOPICS[name]
    kind = topic.type_name.rpartition("/")[2]
    if view is None or view.age_ns is None:
        return _row((name, kind, f"{topic.rate_hz:g}", "-", "never", "-", "0", "0"), STATE_COLUMNS, "red")
    style = ""
    if view.age_ns > age_limit_ns(name):
        style = "red"
    elif view.rate_hz < SLOW * topic.rate_hz or view.refused or view.duplicates:
        style = "yellow"
    values = (name, kind, f"{topic.rate_hz:g}", rate_text(view.rate_hz), age_text(view.age_ns))
    return _row((*values, age_text(view.worst_gap_ns), str(view.duplicates), str(view.refused)), STATE_COLUMNS, style)


def _command(name: str, view: protocol.StreamView | None) -> Text:
    topic = TOPICS[name]
    kind = topic.type_name.rpartition("/")[2]
    limit = age_text(topic.watchdog_ns)
    if view is None:
        return _row((name, kind, f"{topic.rate_hz:g}", "-", "-", limit, "-", "unused"), COMMAND_COLUMNS, "dim")
    late = view.running and topic.watchdog_ns is not None and view.worst_gap_ns > topic.watchdog_ns
    style = "red" if late else "green" if view.running else ""
    values = (name, kind, f"{topic.rate_hz:g}", rate_text(view.rate_hz) if view.running else "-")
    gap = age_text(view.worst_gap_ns) if view.sent else "-"
    return _row((*values, gap, limit, str(view.sent), "running" if view.running else "off"), COMMAND_COLUMNS, style)
