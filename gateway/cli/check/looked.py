"""Rows of `ta2 check` for which nobody needs to move: pure, over one look at the wire and what came meanwhile.

Rates, copies, refusals, types and others are judged by the findings of `ta2 link`; a row is where a finding is shown. What those
do not judge is judged here. A cause hides its effects: without a router nothing is said of topics.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence, Set
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Final

from msgspec.structs import replace

from gateway.api.protocol import Wire
from gateway.cli.check.capture import Capture, stamp_ns
from gateway.cli.check.rows import MOVING, TITLES, Row, row, skipped
from gateway.cli.looking.link_findings import FAST, SLOW, TWICE, Finding, findings_of, names_of
from gateway.cli.terminal.figures import fsm_text
from gateway.robot.topics import (
    CHASSIS_STATE,
    CHASSIS_VELOCITY,
    FSM_STATE,
    JOINT_STATE,
    LIFT_COMMAND,
    STATE_TOPICS,
    TOPICS,
    arm_state,
)
from gateway.values import Side

__all__ = ["FIRST_S", "PARTS", "ROW_OF", "Seen", "Wish", "looked", "parts_of"]

S = 1_000_000_000

FIRST_S = 10.0
"""Each state comes within this (manual §2.7.1) [s]."""
KNOCK_S = 3.0
"""The port answers within this (manual §2.7.1, `nc -w 3`) [s]."""
FROZEN_S = 1.0
"""A state that keeps its stamp for so long while it comes is no news [s] (choice)."""
CLOCK_S = 0.5
"""The clocks agree within this [s] (choice: recordings and the host's log stay comparable)."""
LATENCY_S = 0.1
"""No topic's quickest sample is older than that of the others by more [s] (choice)."""
STILL_RAD = 0.05
"""A joint that stands still is measured within this [rad] (choice; the manual's §6.6 calls it arrived)."""
PARTS: Final = ("left_arm", "right_arm", "chassis", "lift_servo")
_PART_TOPICS: Final = {"chassis": (CHASSIS_STATE, CHASSIS_VELOCITY), "lift_servo": (LIFT_COMMAND,)}

ROW_OF: Final[Mapping[str, str]] = {
    "NO_LINK": "router",
    "NO_ROBOT": "bridge",
    "OTHER_NAMESPACE": "bridge",
    "TWO_ROBOTS": "bridge",
    "NOT_ANNOUNCED": "announced",
    "ROUTE_LOST": "announced",
    "WRONG_TYPE": "types",
    "ROUTE_DEAD": "routes",
    "SAMPLE_REFUSED": "samples",
    "ROUTE_SUSPECT": "states",
    "SLOW": "rates",
    "FAST": "rates",
    "STATE_DUPLICATED": "copies",
    "FOREIGN_WRITER": "writers",
    "OTHER_GATEWAY": "writers",
}
"""Where each finding of `ta2 link` is shown that is more than worth knowing."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Wish:
    """What a person said about the robot.

    Attributes:
        without: Parts that are not there, or are meant to be off.
        mode: `joint` or `pose`, as saved for both arms (manual §2.3); None to be told.
    """

    without: Set[str] = frozenset()
    mode: str | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Seen:
    """What a check has seen.

    Attributes:
        wire: One look at it.
        capture: What came meanwhile.
        began_ns: When that began to listen [ns].
        knock_s: How long the port took to answer [s]; None when it did not, or is no TCP port.
        knock_error: Why it did not; empty when it did, or was not asked.
    """

    wire: Wire
    capture: Capture
    began_ns: int
    knock_s: float | None = None
    knock_error: str = ""


@dataclass(frozen=True, slots=True)
class _Look:
    """The same, with what nobody expects left out, and each finding at its row."""

    seen: Seen
    topics: Sequence[str]
    findings: Mapping[str, Sequence[Finding]]
    mode: Mapping[str, object] | None
    wish: Wish = field(default_factory=Wish)

    def wired(self, name: str, found: str, **figures: object) -> Row:
        """Return a row that `ta2 link` judges."""
        wrong = self.findings.get(name, ())
        text = "; ".join(each.text for each in wrong) or found
        return row(name, not wrong, text, remedy=wrong[0].remedy if wrong else "", **figures)  # type: ignore[arg-type]  # figure, bound, unit


def parts_of(mode: Mapping[str, object] | None, wish: Wish, *, has_lift: bool) -> dict[str, bool]:
    """Return which of the parts that are expected are enabled in the robot's configuration (manual §2.3)."""
    expected = [part for part in PARTS if part not in wish.without and (has_lift or part != "lift_servo")]
    return {part: bool((mode or {}).get(f"enable_{part}")) for part in expected}


def looked(seen: Seen, wish: Wish) -> list[Row]:
    """Return all rows for which nothing moves, `video` excepted.

    Args:
        seen: What was seen.
        wish: What a person said about the robot.
    """
    absent = {topic for part in wish.without for topic in _topics_of(part)}
    wire = replace(seen.wire, topics=tuple(topic for topic in seen.wire.topics if topic.name not in absent))
    by_row: dict[str, list[Finding]] = {}
    for finding in findings_of(wire):
        if finding.level != "info" or finding.code == "UNKNOWN":
            by_row.setdefault(ROW_OF.get(finding.code, finding.code), []).append(finding)
    topics = [topic for topic in STATE_TOPICS if topic not in absent]
    look = _Look(seen, topics, by_row, seen.capture.mode(), wish)
    rows = [
        _network(seen),
        look.wired("router", f"zenoh {wire.router_version.partition('-')[0] or 'of unknown version'}"),
    ]
    if wire.is_up:
        rows.append(look.wired("bridge", _bridge(wire)))
    why = "the robot's router was not reached" if not wire.is_up else "no robot is known there"
    if rows[-1].verdict == "pass":
        rows += [*_wire_rows(look, wire), *_come(look), *_robot_rows(look)]
        why = ""
    rest = tuple(name for name in TITLES if name not in (*MOVING, "video", *(each.name for each in rows)))
    order = list(TITLES)
    return sorted([*rows, *skipped(rest, why)], key=lambda each: order.index(each.name))


def _topics_of(part: str) -> tuple[str, ...]:
    side = part.partition("_arm")[0]
    return _PART_TOPICS.get(part) or tuple(
        topic for topic in TOPICS if topic.removeprefix("/api").startswith(f"/{side}_")
    )


def _network(seen: Seen) -> Row:
    if seen.knock_error:
        return row(
            "network",
            False,
            seen.knock_error,
            bound=f"<= {KNOCK_S:g}",
            unit="s",
            remedy="check power, cable and address",
        )
    if seen.knock_s is None:
        return row("network", "skipped", f"{seen.wire.endpoint} is no TCP port")
    return row("network", True, seen.wire.endpoint, figure=seen.knock_s, bound=f"<= {KNOCK_S:g}", unit="s")


def _bridge(wire: Wire) -> str:
    bridge = next((each for each in wire.bridges if each.is_robot), None)
    domain = "" if bridge is None or bridge.domain is None else f", DDS domain {bridge.domain}"
    version = bridge.version if bridge is not None and bridge.version else "of unknown version"
    return f"ros2dds {version}{domain}, {f'namespace {wire.namespace}' if wire.namespace else 'no namespace'}"


def _wire_rows(look: _Look, wire: Wire) -> Iterator[Row]:
    heard = [topic for topic in wire.topics if topic.is_state and topic.is_heard and topic.route == "active"]
    yield look.wired("announced", f"{sum(bool(topic.announced) for topic in wire.topics)} of {len(wire.topics)} topics")
    yield look.wired("types", "as in the manual")
    yield look.wired("routes", "all that are known")
    refused = sum(topic.refused for topic in wire.topics)
    yield look.wired("samples", "all of them", figure=refused, bound="<= 0", unit="samples refused")
    parts = [topic.rate_hz / topic.nominal_hz for topic in heard if topic.rate_hz > 0.0]
    worst = max(parts, key=lambda part: abs(part - 1.0), default=None)
    bound = f"{SLOW:g} to {FAST:g}"
    yield look.wired("rates", "the furthest off", figure=worst, bound=bound, unit="of the manual's rate")
    times = max((topic.times for topic in heard), default=None)
    yield look.wired("copies", "as it should be", figure=times, bound=f"< {TWICE:g}", unit="times")
    closed = look.findings.get("UNKNOWN", ())
    if closed and "writers" not in look.findings:
        yield row("writers", "unknown", closed[0].text, remedy="`ta2 link` says more after some seconds")
    else:
        yield look.wired("writers", f"{len(wire.neighbours)} sessions are there, none of them commands")


def _come(look: _Look) -> Iterator[Row]:
    """Yield what is judged by the messages themselves."""
    kept = {topic: look.seen.capture.arrivals(topic) for topic in look.topics}
    first_s = {topic: (came[0][0] - look.seen.began_ns) / S for topic, came in kept.items() if came}
    missing = [topic for topic in look.topics if topic not in first_s]
    silent = look.findings.get("states", ())
    found = f"nothing came of {names_of(missing)}" if missing else "; ".join(each.text for each in silent)
    late_s = max(first_s.values(), default=None)
    yield row(
        "states", not missing and not silent and (late_s or 0.0) <= FIRST_S, found or "the last of them",
        figure=late_s, bound=f"<= {FIRST_S:g}", unit="s", remedy="look at the node on the robot that publishes it",
    )  # fmt: skip
    stamps = {
        topic: [(at_ns, stamp) for at_ns, payload in came if (stamp := stamp_ns(topic, payload)) is not None]
        for topic, came in kept.items()
        if TOPICS[topic].type_name == JOINT_STATE
    }
    old_s = {topic: _unchanged_s(came) for topic, came in stamps.items() if came}
    frozen = [topic for topic, age_s in old_s.items() if age_s > FROZEN_S]
    yield row(
        "fresh", not frozen if old_s else "unknown", f"the same again and again: {names_of(frozen)}" if frozen else "the oldest stamp",
        figure=max(old_s.values(), default=None), bound=f"<= {FROZEN_S:g}", unit="s", remedy="restart that node on the robot",
    )  # fmt: skip
    back = {topic: sum(b < a for (_, a), (_, b) in pairwise(came)) for topic, came in stamps.items()}
    wrong = [topic for topic, count in back.items() if count]
    yield row(
        "order", not wrong if old_s else "unknown", f"out of order: {names_of(wrong)}" if wrong else "all of them",
        figure=sum(back.values()), bound="<= 0", unit="samples", remedy="one publisher for each topic; restart the robot's bridge",
    )  # fmt: skip
    ages = {
        topic: min(at_ns - stamp for at_ns, stamp in came) / S
        for topic, came in stamps.items()
        if came and topic not in frozen
    }
    behind = {topic: age_s - min(ages.values()) for topic, age_s in ages.items()}
    slow = [topic for topic, by_s in behind.items() if by_s > LATENCY_S]
    yield row(
        "latency", not slow if ages else "unknown", f"later than others: {names_of(slow)}" if slow else "the slowest",
        figure=max(behind.values(), default=None), bound=f"<= {LATENCY_S:g}", unit="s", remedy="look at the robot's load",
    )  # fmt: skip
    clock_ns = look.seen.wire.clock_ns
    yield row(
        "clock", "unknown" if clock_ns is None else abs(clock_ns) <= CLOCK_S * S,
        "no stamped sample came" if clock_ns is None else "the robot's clock minus ours",
        figure=None if clock_ns is None else clock_ns / S, bound=f"within {CLOCK_S:g}", unit="s",
        remedy="let both keep one time (NTP or chrony): recordings and logs are compared by it",
    )  # fmt: skip


def _unchanged_s(came: Sequence[tuple[int, int]]) -> float:
    """Return for how long the newest stamp has come [s]."""
    last_ns, newest = came[-1]
    since_ns = next((at_ns for at_ns, stamp in reversed(came) if stamp != newest), came[0][0])
    return (last_ns - since_ns) / S


def _robot_rows(look: _Look) -> Iterator[Row]:
    """Yield what the robot says of itself."""
    mode, capture, page = look.mode, look.seen.capture, "set it on the robot's page, save, apply, restart (§2.3)"
    if mode is None:
        yield from skipped(("mode", "parts", "control"), "no /api/current_mode that can be read came")
    else:
        is_api = bool(mode.get("meta_mode"))
        yield row("mode", is_api, "API" if is_api else "VR: API commands are not taken (§3.1.1)", remedy=page)
        parts = parts_of(mode, look.wish, has_lift=look.seen.wire.model == "lift")
        off = [part for part, is_on in parts.items() if not is_on]
        found = f"disabled: {', '.join(off)}" if off else ", ".join(parts)
        yield row(
            "parts",
            not off,
            found,
            remedy=f"{page}; parts that are meant to be off: --without {' --without '.join(off)}",
        )
        modes = {side.value: "joint" if mode.get(f"{side}_arm_control_mode") else "pose" for side in Side}
        other = look.wish.mode is not None and set(modes.values()) != {look.wish.mode}
        found = ", ".join(f"{side} {each}" for side, each in modes.items())
        yield row("control", not other, found, bound=look.wish.mode or "", remedy=page)
    fsm = [int(value) for _, value in capture.numbers(FSM_STATE)][-1:]
    ready = bool(fsm) and 0 <= fsm[0] <= 2
    remedy = "end VR or playback on the robot; in ERROR look at the robot, and restart it"
    yield row(
        "fsm",
        ready if fsm else "unknown",
        fsm_text(fsm[0] if fsm else None),
        bound="PAUSE, SLOW_START or READY",
        remedy=remedy,
    )
    spread = {
        side.value: max(max(joint) - min(joint) for joint in zip(*came, strict=True))
        for side in Side
        if (came := [each.q_rad for each in capture.motors(arm_state(side))])
    }
    moved = [side for side, by_rad in spread.items() if not by_rad <= STILL_RAD]
    yield row(
        "still", not moved if spread else "unknown", f"moved, or seem to: {', '.join(moved)}" if moved else "the furthest",
        figure=max(spread.values(), default=None), bound=f"<= {STILL_RAD:g}", unit="rad",
        remedy="who moves it? else the encoder of that joint",
    )  # fmt: skip
