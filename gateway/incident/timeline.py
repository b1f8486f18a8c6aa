"""What happened in an incident, for people: line by line, and joints over time."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

from gateway.core.messages.events import CommandRequested, SampleArrived
from gateway.incident.replay import Incident, ticks
from gateway.messages.requests import Acquire, Take
from gateway.robot.topics import arm_state, joint_command
from gateway.values import ArmState, Side

__all__ = ["Moment", "Points", "joints", "timeline"]

Points = list[tuple[int, Sequence[float]]]
"""Monotonic times [ns], and seven joints [rad] at each."""


class Moment(NamedTuple):
    """A line of the timeline: monotonic time [ns], what it is (notice, request, gap), how loud, and its text."""

    at_ns: int
    kind: str
    level: str
    text: str


def timeline(found: Incident) -> Iterator[Moment]:
    """Yield what happened, in its order: what was told, what was asked and refused, and where something is missing.

    Raises:
        OSError: A piece cannot be read.
        ValueError: Something else is in it.
    """
    names: dict[str, str] = {}
    for is_gap, tick in ticks(found):
        if is_gap:
            yield Moment(tick.now_ns, "gap", "error", "here something is missing: the disk did not keep up, or refused")
        answers = {(reply.client_id, reply.request_id): reply for reply in tick.replies}
        for event in tick.heard:
            if isinstance(event, CommandRequested):
                if isinstance(event.request, (Acquire, Take)):
                    names[event.client_id] = event.request.name
                reply = answers.get((event.client_id, event.request_id))
                no = reply.refusal if reply is not None else None
                who = event.name or names.get(event.client_id, event.client_id)
                text = f"{type(event.request).__name__} by {who}"
                said = "" if no is None else f": refused, {no.code}: {no.message}"
                yield Moment(tick.now_ns, "request", "info" if no is None else "warning", text + said)
        for told in tick.notices:
            yield Moment(tick.now_ns, "notice", told.level.value, f"{told.code}: {told.message}")


def joints(found: Incident) -> tuple[dict[Side, Points], dict[Side, Points]]:
    """Return per arm what was sent and what was measured; raises as `timeline`."""
    asked: dict[Side, Points] = {side: [] for side in Side}
    measured: dict[Side, Points] = {side: [] for side in Side}
    commands, states = {joint_command(side): side for side in Side}, {arm_state(side): side for side in Side}
    for _, tick in ticks(found):
        for frame in tick.frames:
            if frame.topic in commands:
                asked[commands[frame.topic]].append((tick.now_ns, frame.values))
        for event in tick.heard:
            if isinstance(event, SampleArrived) and isinstance(event.value, ArmState) and event.topic in states:
                measured[states[event.topic]].append((event.received_ns, event.value.q_rad))
    return asked, measured
