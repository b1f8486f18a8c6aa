"""Rows of `ta2 check` for which nobody needs to move: pure, over one look at the wire and what came meanwhile.

Rates, copies, refusals, types and others are judged by the findings of `ta2 link`; a row is where a finding is shown.
What those do not judge is judged here. A cause hides its effects: without a router nothing is said of topics.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence, Set
from dataclasses import dataclass
from itertools import pairwise
from math import isfinite
from typing import Final

from msgspec.structs import replace

from gateway.api.protocol import Wire
from gateway.cli.check.capture import Capture, stamp_ns
from gateway.cli.check.rows import MOVING, POINTS, Row, measured, row, skipped, worst
from gateway.cli.looking.link_findings import Finding, findings_of, names_of
from gateway.cli.terminal.figures import fsm_text
from gateway.robot.topics import FSM_STATE, STATE_TOPICS, TOPICS, arm_state
from gateway.values import Side

__all__ = ["PARTS", "ROW_OF", "Seen", "Wish", "looked", "parts_of"]

S = 1_000_000_000
PARTS: Final = {"left_arm": "/left_", "right_arm": "/right_", "chassis": "/chassis/", "lift_servo": "/servo/"}
"""Parts that can be switched off (manual §2.3), and how their topics begin."""

ROW_OF: Final[Mapping[str, str]] = {
    "NO_LINK": "router",
    **dict.fromkeys(("NO_ROBOT", "OTHER_NAMESPACE", "TWO_ROBOTS"), "bridge"),
    **dict.fromkeys(("NOT_ANNOUNCED", "ROUTE_LOST"), "announced"),
    "WRONG_TYPE": "types",
    "ROUTE_DEAD": "routes",
    "SAMPLE_REFUSED": "samples",
    "ROUTE_SUSPECT": "states",
    **dict.fromkeys(("SLOW", "FAST"), "rates"),
    "STATE_DUPLICATED": "copies",
    **dict.fromkeys(("FOREIGN_WRITER", "OTHER_GATEWAY"), "writers"),
}
"""Where each finding of `ta2 link` is shown that is more than worth knowing."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Wish:
    """What a person said: parts that are not there or meant to be off, and the mode that was saved for both arms."""

    without: Set[str] = frozenset()
    mode: str | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Seen:
    """What a check has seen: one look at the wire, and what came since then [ns].

    The port took so long to answer [s], or did not for that reason; neither where it is no TCP port.
    """

    wire: Wire
    capture: Capture
    began_ns: int
    knock_s: float | None = None
    knock_error: str = ""


Findings = Mapping[str, Sequence[Finding]]


def parts_of(mode: Mapping[str, object] | None, wish: Wish, *, has_lift: bool) -> dict[str, bool]:
    """Return which of the parts that are expected are enabled in the robot's configuration (manual §2.3)."""
    expected = [part for part in PARTS if part not in wish.without and (has_lift or part != "lift_servo")]
    return {part: bool((mode or {}).get(f"enable_{part}")) for part in expected}


def looked(seen: Seen, wish: Wish) -> list[Row]:
    """Return all rows for which nothing moves, `video` excepted."""
    off = tuple(PARTS[part] for part in wish.without)
    absent = {topic for topic in TOPICS if topic.removeprefix("/api").startswith(off)}
    wire = replace(seen.wire, topics=tuple(topic for topic in seen.wire.topics if topic.name not in absent))
    found: dict[str, list[Finding]] = {}
    for finding in findings_of(wire):
        if finding.level != "info" or finding.code == "UNKNOWN":
            found.setdefault(ROW_OF.get(finding.code, finding.code), []).append(finding)
    why, rows = "the robot's router was not reached", [_network(seen)]
    if wire.is_up or not seen.knock_error:
        rows.append(_wired("router", found, f"zenoh {wire.router_version.partition('-')[0] or 'that says no version'}"))
    if wire.is_up:
        why = "no robot is known there"
        rows.append(_wired("bridge", found, _bridge(wire)))
    if wire.is_up and rows[-1].verdict == "pass":
        explained = {topic.name for topic in wire.topics if topic.route in ("dead", "lost", "unannounced")}
        heard = [topic for topic in STATE_TOPICS if topic not in absent | explained]
        rows += [*_wire_rows(wire, found), *_come(seen, heard, found), *_robot_rows(seen, wish)]
    done = {each.name for each in rows}
    rows += skipped((name for name in POINTS if name not in {*MOVING, "video", *done}), why)
    return sorted(rows, key=lambda each: list(POINTS).index(each.name))


def _wired(name: str, found: Findings, text: str, figure: float | None = None) -> Row:
    """Return a row that `ta2 link` judges."""
    wrong = found.get(name, ())
    return row(
        name, not wrong, "; ".join(each.text for each in wrong) or text, figure, wrong[0].remedy if wrong else None
    )


def _network(seen: Seen) -> Row:
    if seen.knock_s is None and not seen.knock_error:
        return row("network", "skipped", f"{seen.wire.endpoint} is no TCP port", remedy="")
    return measured("network", seen.knock_s, seen.wire.endpoint, wrong=seen.knock_error)


def _bridge(wire: Wire) -> str:
    bridge = next((each for each in wire.bridges if each.is_robot), None)
    domain = "" if bridge is None or bridge.domain is None else f", DDS domain {bridge.domain}"
    version = bridge.version if bridge is not None and bridge.version else "that does not say more"
    return f"ros2dds {version}{domain}, {f'namespace {wire.namespace}' if wire.namespace else 'no namespace'}"


def _wire_rows(wire: Wire, found: Findings) -> Iterator[Row]:
    heard = [topic for topic in wire.topics if topic.is_state and topic.is_heard and topic.route == "active"]
    parts = [topic.rate_hz / topic.nominal_hz for topic in heard if topic.rate_hz > 0.0]
    yield _wired("announced", found, f"{sum(bool(topic.announced) for topic in wire.topics)} of {len(wire.topics)}")
    yield _wired("types", found, "all of them")
    yield _wired("routes", found, "all of them")
    yield _wired("samples", found, "all of them", sum(topic.refused for topic in wire.topics))
    yield _wired("rates", found, "the furthest off", max(parts, key=lambda part: abs(part - 1.0), default=None))
    yield _wired("copies", found, "the most", max((topic.times for topic in heard), default=None))
    if "UNKNOWN" in found and "writers" not in found:
        yield row("writers", "unknown", found["UNKNOWN"][0].text, remedy="`ta2 link` says more after some seconds")
    else:
        yield _wired("writers", found, f"{len(wire.neighbours)} sessions are there")


def _come(seen: Seen, topics: Sequence[str], found: Findings) -> Iterator[Row]:
    """Yield what is judged by the messages themselves."""
    kept = {topic: seen.capture.arrivals(topic) for topic in topics}
    first_s = {topic: (came[0][0] - seen.began_ns) / S for topic, came in kept.items() if came}
    missing = [topic for topic in topics if topic not in first_s]
    silent = "; ".join(each.text for each in found.get("states", ()))
    wrong = f"nothing came of {names_of(missing)}" if missing else silent
    yield measured("states", max(first_s.values(), default=None), "the last of them", wrong=wrong)
    stamps = {
        topic: stamped
        for topic, came in kept.items()
        if (stamped := [(at_ns, stamp) for at_ns, data in came if (stamp := stamp_ns(topic, data)) is not None])
    }
    judged = f"of {len(stamps)} of {len(kept)} topics"
    old_s = {topic: _unchanged_s(came) for topic, came in stamps.items()}
    yield worst("fresh", old_s, f"the oldest {judged}", "the same again and again")
    back = {topic: float(sum(b < a for (_, a), (_, b) in pairwise(came))) for topic, came in stamps.items()}
    yield worst("order", back, f"the most {judged}", "out of order")
    age_s = {
        topic: min(at_ns - stamp for at_ns, stamp in came) / S
        for topic, came in stamps.items()
        if old_s[topic] <= POINTS["fresh"].most
    }
    least_s = min(age_s.values(), default=0.0)
    late_s = {topic: s - least_s for topic, s in age_s.items()}
    yield worst("latency", late_s, f"the slowest of {len(late_s)} of {len(kept)} topics", "later than others")
    clock_ns = seen.wire.clock_ns
    yield measured("clock", None if clock_ns is None else clock_ns / S, "the robot's minus ours")


def _unchanged_s(came: Sequence[tuple[int, int]]) -> float:
    """Return for how long the newest stamp has come [s]."""
    last_ns, newest = came[-1]
    return (last_ns - next((at_ns for at_ns, stamp in reversed(came) if stamp != newest), came[0][0])) / S


def _robot_rows(seen: Seen, wish: Wish) -> Iterator[Row]:
    """Yield what the robot says of itself."""
    mode = seen.capture.mode()
    if mode is None:
        yield from (row(name, "unknown", "no mode came that can be read") for name in ("mode", "parts", "control"))
    else:
        is_api = bool(mode.get("meta_mode"))
        yield row("mode", is_api, "API" if is_api else "VR: API commands are not taken (§3.1.1)")
        parts = parts_of(mode, wish, has_lift=seen.wire.model == "lift")
        off = [part for part, is_on in parts.items() if not is_on]
        yield row("parts", not off, f"disabled: {', '.join(off)}" if off else ", ".join(parts))
        modes = {side.value: "joint" if mode.get(f"{side}_arm_control_mode") else "pose" for side in Side}
        wanted = wish.mode is None or set(modes.values()) == {wish.mode}
        yield row("control", wanted, ", ".join(f"{side} {each}" for side, each in modes.items()))
    fsm = next((int(message.data) for _, message in reversed(seen.capture.messages(FSM_STATE))), None)
    yield measured("fsm", fsm, fsm_text(fsm))
    spread_rad = {
        side.value: max(max(joint) - min(joint) for joint in zip(*came, strict=False))
        for side in Side
        if (
            came := [
                each for _, message in seen.capture.messages(arm_state(side)) if isfinite(sum(each := message.position))
            ]
        )
    }
    yield worst("still", spread_rad, "the furthest", "moved, or seem to")
