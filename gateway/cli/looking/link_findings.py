"""What is wrong with the wire, and what to do about it, worst first: read off one look at it. Pure.

Rules
    * A cause hides its effects: without a transport nothing is said about topics, without a robot nothing about its routes.
    * Whoever reads this may have no gateway that runs: each finding says what a person can do next.
    * What others could do is told as it is: nothing on port 9000 asks who somebody is (manual §3.3.1).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from cdr_types import BadName
from cdr_types.qos import Durability, Reliability, parse_qos
from gateway.api.protocol import Wire, WireNeighbour, WireTopic
from gateway.cli.terminal.figures import since_text

__all__ = ["Finding", "findings_of", "names_of"]

SLOW, FAST = 0.8, 1.25
"""A topic's rate is as it should be between these parts of the manual's."""
TWICE = 1.5
"""From so many copies of each sample on they are no retransmissions."""
ORDER = ("error", "warning", "info")
GOING_ON_NS = 10_000_000_000
"""Commands of somebody else are going on until none came for this long [ns]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Finding:
    """One thing to know.

    Attributes:
        level: `error`: the robot cannot be used; `warning`: it may not do what it should; `info`: worth knowing.
        code: Stable code, as far as there is one; else a word for scripts.
        text: What is seen.
        remedy: What to do; may be empty.
    """

    level: str
    code: str
    text: str
    remedy: str = ""


def findings_of(wire: Wire) -> tuple[Finding, ...]:
    """Return everything that is worth knowing, worst first."""
    if not wire.is_up:
        return (_no_link(wire),)
    found = [*_robot(wire), *_others(wire), *_access(wire)]
    return tuple(sorted(found, key=lambda finding: ORDER.index(finding.level)))


def names_of(topics: Sequence[str], most: int = 3) -> str:
    """Return names of topics in one line: all of a few, the number of many."""
    shown = ", ".join(topics[:most])
    return shown if len(topics) <= most else f"{shown} and {len(topics) - most} more"


# --------------------------------------------------------------------------------------------------------- link, robot


def _no_link(wire: Wire) -> Finding:
    why = wire.trouble or f"there is no transport to {wire.endpoint}"
    return Finding(
        level="error",
        code="NO_LINK",
        text=why,
        remedy="check power, cable and address of the robot (tcp 9000)"
        + ("" if wire.trouble else f"; `ta2 link --robot {wire.endpoint}` tries by itself and says more"),
    )


def _robot(wire: Wire) -> Iterator[Finding]:
    states = [topic for topic in wire.topics if topic.is_state]
    if any(topic.announced or topic.age_ns is not None for topic in states):
        yield from _states(wire, states)
        if any(topic.announced for topic in states):  # else the robot's node is away, and its ears with it
            yield from _commands([topic for topic in wire.topics if not topic.is_state])
        yield from _announcements(wire)
        return
    here = f"under namespace {wire.namespace}" if wire.namespace else "without a namespace"
    if not wire.robots:
        there = next((bridge for bridge in wire.bridges if bridge.zid == wire.router_zid), None)
        if there is None:
            text, remedy = f"the router answers, and no bridge announces a robot {here}", "start the robot's bridge"
        else:
            domain = "" if there.domain is None else f" (it has {there.domain})"
            text = f"the robot's bridge is there and announces no robot {here}: it meets none of the robot's nodes"
            remedy = (
                f"start the robot's software; its bridge needs the DDS domain of the nodes{domain} and, in front of "
                "Humble, ROS_DISTRO=humble"
            )
        yield Finding(level="error", code="NO_ROBOT", text=text, remedy=remedy)
    elif len(wire.robots) == 1:
        name = wire.robots[0]
        yield Finding(
            level="error",
            code="OTHER_NAMESPACE",
            text=f"no robot announces itself {here}; there is one {_under(name)}",
            remedy=f'namespace = "{name}" in section [robot]' + (f", or `ta2 run --namespace {name}`" if name else ""),
        )
    else:
        yield Finding(
            level="error",
            code="OTHER_NAMESPACE",
            text=f"no robot announces itself {here}; there are {len(wire.robots)}: {', '.join(map(_under, wire.robots))}",
            remedy="choose one: namespace in section [robot], or --namespace NAME",
        )


def _under(namespace: str) -> str:
    return f"under namespace {namespace}" if namespace else "without a namespace"


# -------------------------------------------------------------------------------------------------------------- topics


def _states(wire: Wire, states: Sequence[WireTopic]) -> Iterator[Finding]:
    heard = [topic for topic in states if topic.is_heard]
    for route, level, code, text, remedy in (
        (
            "dead", "error", "ROUTE_DEAD", "announced, and the robot's bridge does not read it",
            "end whoever else listens to it, or restart the robot's bridge",
        ),
        ("lost", "error", "ROUTE_LOST", "gone: nobody announces it any more", "restart the robot's node or bridge"),
        (
            "unannounced", "warning", "NOT_ANNOUNCED", "announced by nobody",
            "start the node that publishes it; a part that is switched off has none",
        ),
        ("silent", "warning", "ROUTE_SUSPECT", "announced, and nothing comes", "look at that node on the robot"),
    ):  # fmt: skip
        names = [topic.name for topic in heard if topic.route == route]
        if names:
            yield Finding(level=level, code=code, text=f"{text}: {names_of(names)}", remedy=remedy)
    times = max((topic.times for topic in heard), default=1.0)
    if times >= TWICE:
        names = [topic.name for topic in heard if topic.times >= TWICE]
        text = f"the robot's bridge delivers each sample {round(times)} times: {names_of(names)}"
        yield Finding(level="warning", code="STATE_DUPLICATED", text=text, remedy="restart the robot's bridge")
    rates = {topic.name: topic.rate_hz / topic.nominal_hz for topic in heard if topic.route == "active"}
    slow = [name for name, part in rates.items() if 0.0 < part < SLOW]
    fast = [name for name, part in rates.items() if part > FAST]
    if slow:
        text = f"slower than the manual says (§4.1.1): {names_of(slow)}"
        yield Finding(level="warning", code="SLOW", text=text, remedy="look at the network, and at the robot's load")
    if fast:
        text = f"faster than the manual says (§4.1.1): {names_of(fast)}"
        yield Finding(level="warning", code="FAST", text=text, remedy="look for a second publisher of it on the robot")
    for topic in heard:
        if topic.refused:
            text = f"{topic.refused} samples of {topic.name} could not be read; the last: {topic.why_refused}"
            remedy = "the robot's software differs from the manual; report this page"
            yield Finding(level="error", code="SAMPLE_REFUSED", text=text, remedy=remedy)


def _commands(commands: Sequence[WireTopic]) -> Iterator[Finding]:
    missing = [topic.name for topic in commands if topic.route == "unannounced"]
    if missing:
        everything = (
            "" if len(missing) < len(commands) else "; the robot may be in VR mode, or its control is not running"
        )
        text = f"nobody on the robot listens to {names_of(missing)}{everything}"
        remedy = (
            "start that node on the robot; a part that is switched off has none, and `model` in section [robot] says "
            "which commands are expected"
        )
        yield Finding(level="warning", code="NOT_ANNOUNCED", text=text, remedy=remedy)
    inactive = [topic.name for topic in commands if topic.route == "inactive"]
    if inactive:
        text = f"the robot's bridge does not pass on {names_of(inactive)}: what is sent there is lost"
        yield Finding(level="error", code="ROUTE_DEAD", text=text, remedy="restart the robot's bridge")


def _announcements(wire: Wire) -> Iterator[Finding]:
    """Yield what is announced otherwise than the manual says."""
    for topic in wire.topics:
        types = sorted({each.type_name for each in topic.announced} - {topic.type_name})
        if types:
            text = f"{topic.name} is announced as {', '.join(types)}; the manual says {topic.type_name}"
            remedy = "this is not the robot of this manual, or another release of its software"
            yield Finding(level="error", code="WRONG_TYPE", text=text, remedy=remedy)
        who = sorted({each.zid for each in topic.announced})
        if topic.is_state and len(who) > 1:
            text = f"{topic.name} is announced by {len(who)} bridges: {', '.join(who)}"
            remedy = "end one of them: two robots, or a host that publishes the robot's own topic"
            yield Finding(level="error", code="TWO_ROBOTS", text=text, remedy=remedy)
    odd = sorted({text for topic in wire.topics if topic.is_state for text in _odd_qos(topic)})
    if odd:
        yield Finding(level="info", code="QOS", text=f"other QoS than §4.1.1 says: {names_of(odd)}")


def _odd_qos(topic: WireTopic) -> Iterator[str]:
    for each in topic.announced:
        try:
            qos = parse_qos(each.qos)
        except BadName:
            continue
        if qos.reliability is not None and qos.reliability is not Reliability.RELIABLE:
            yield f"{topic.name} is best effort"
        if qos.durability not in (None, Durability.VOLATILE):
            yield f"{topic.name} is transient local"


# -------------------------------------------------------------------------------------------------------------- others


def _others(wire: Wire) -> Iterator[Finding]:
    for who in wire.neighbours:
        if who.kind not in ("self", "guard"):
            yield from _other(who, _name(who))
    gateways = [who.address.rpartition(":")[0] for who in wire.neighbours if who.kind == "gateway" and who.address]
    if len(set(gateways)) < len(gateways):
        text = "a gateway and its guard are two sessions: what looks like two gateways at one address may be one"
        yield Finding(level="info", code="GUARD", text=text)
    free = [who for who in wire.neighbours if who.kind in ("bridge", "session") and who.address]
    if free:
        text = (
            f"{len(free)} {'other is' if len(free) == 1 else 'others are'} connected and could command the robot at any "
            "time: nothing there asks who somebody is (manual §3.3.1)"
        )
        yield Finding(
            level="info", code="CONNECTED", text=text, remedy="know them all; keep the robot's network its own"
        )


def _other(who: WireNeighbour, name: str) -> Iterator[Finding]:
    topics = names_of([f"{topic} ({count})" for topic, count in sorted(who.sent.items())])
    level, code, remedy = "warning", "FOREIGN_WRITER", "stop it before you enable the robot"
    if who.kind == "gateway":  # what it sends is its right as long as it is armed, and over when it is not
        if not who.is_armed:
            return
        code, text = "OTHER_GATEWAY", f"{name} commands the robot"
        remedy = "one gateway at a time: stop the other one first (manual §3.3.2)"
    elif who.sent_age_ns is not None and who.sent_age_ns < GOING_ON_NS:
        text = f"{name} sends commands on {topics}; the robot obeys everybody in turn (manual §3.3.2)"
        level, remedy = "error", "stop it"
    elif who.publishes:
        text = f"{name} announces commands on {names_of(who.publishes)}"
    elif who.sent_age_ns is not None:
        text = f"{name} has sent commands on {topics}, the last {since_text(who.sent_age_ns)} ago"
        level, remedy = "info", "know who that was"
    else:
        return
    yield Finding(level=level, code=code, text=text, remedy=remedy)


def _name(who: WireNeighbour) -> str:
    kinds = {"gateway": "the gateway", "robot": "a ROS node on the robot", "bridge": "a ROS node behind the bridge"}
    name = f"{kinds.get(who.kind, 'the session')} {who.zid}" if who.zid else "somebody who does not say who he is"
    return f"{name} at {who.address}" if who.address else name


def _access(wire: Wire) -> Iterator[Finding]:
    if not wire.router_version and not any(who.address for who in wire.neighbours):
        text = "the router does not say who is connected: its admin space is closed, or it has not been asked yet"
        yield Finding(level="info", code="UNKNOWN", text=text)
    if wire.undelivered:
        text = f"{wire.undelivered} frames were not sent for want of a transport since the gateway started"
        yield Finding(level="info", code="UNDELIVERED", text=text)
