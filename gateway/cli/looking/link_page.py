"""`ta2 link` as a page: what is at the other end, every topic, everybody who is there, what is wrong. Pure: lines out.

It is made to be pasted: every line stands by itself, ids are whole, and nothing depends on the width of a terminal.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

from rich.text import Text

from cdr_types import BadName
from cdr_types.qos import Durability, History, Reliability, parse_qos
from gateway.api.protocol import Wire, WireBridge, WireNeighbour, WireTopic
from gateway.cli.looking.link_findings import FAST, SLOW, TWICE, findings_of, names_of
from gateway.cli.terminal.figures import age_text, rate_text, since_text
from gateway.cli.terminal.style import STEP_MARKS, STEP_STYLES

__all__ = ["lines", "qos_text"]

S = 1_000_000_000
LABEL = 10
STATE_COLUMNS = (-27, -10, -21, -11, 6, 7, 6, 8)
COMMAND_COLUMNS = (-27, -17, -21, -11)
WHO_COLUMNS = (-15, -32, -24)
"""Widths; a negative one is aligned to the left."""

GOOD, WAITS, BAD = "green", "yellow", "bold red"
ROUTE_STYLES = {
    "active": GOOD,
    "announced": GOOD,
    "silent": WAITS,
    "unannounced": WAITS,
    "unknown": "dim",
    "dead": BAD,
    "lost": BAD,
    "inactive": BAD,
}
KINDS = {"guard": "its guard", "robot": "the robot", "gateway": "gateway", "bridge": "ROS bridge"}


def lines(wire: Wire, seen_by: str, is_gateway: bool) -> Iterator[Text]:
    """Yield the page."""
    yield from _head(wire, seen_by)
    if wire.is_up:
        yield Text()
        yield from _topics(wire)
        yield Text()
        yield from _who(wire, is_gateway)
    yield Text()
    yield from _findings(wire)


# ---------------------------------------------------------------------------------------------------------------- head


def _head(wire: Wire, seen_by: str) -> Iterator[Text]:
    namespace = f"namespace {wire.namespace}" if wire.namespace else "no namespace"
    yield _row("robot", f"{wire.endpoint}, {wire.model}, {namespace}", "bold")
    yield _row("seen by", seen_by)
    if not wire.is_up:
        yield _row("link", "DOWN", BAD)
        return
    yield _row("link", f"up for {since_text(wire.up_ns)}", GOOD)
    yield _row("router", f"{wire.router_zid}, {_zenoh(wire.router_version)}")
    robots = [bridge for bridge in wire.bridges if bridge.is_robot]
    for bridge in robots:
        yield _row("bridge", f"{bridge.zid}, {_bridge(bridge)}")
    if not robots:
        there = next((f"{each.zid}, {_bridge(each)}: " for each in wire.bridges if each.zid == wire.router_zid), "")
        yield _row("bridge", f"{there}announces no robot here" if there else "none announces a robot here", BAD)
    yield _row("clock", _clock(wire.clock_ns), "" if wire.clock_ns is not None else "dim")


def _row(label: str, text: str, style: str = "") -> Text:
    return Text.assemble((f"{label:<{LABEL}}", "dim"), (text, style))


def _zenoh(version: str) -> str:
    return f"zenoh {_short(version)}" if version else "it does not say its version"


def _short(version: str) -> str:
    """Return a version without the commit and the compiler that zenoh puts behind it."""
    return version.partition("-")[0].strip()


def _bridge(bridge: WireBridge) -> str:
    parts = [f"ros2dds {_short(bridge.version)}" if bridge.version else "it does not say its version"]
    if bridge.domain is not None:
        parts.append(f"DDS domain {bridge.domain}")
    return ", ".join(parts)


def _clock(clock_ns: int | None) -> str:
    if clock_ns is None:
        return "unknown: no stamped sample came"
    seconds = abs(clock_ns) / S
    if seconds < 0.05:
        return f"the robot's stamps agree with this clock within {seconds * 1e3:.0f} ms"
    way = "ahead of" if clock_ns > 0 else "behind"
    text = f"{seconds:.3f} s" if seconds < 1e4 else f"{seconds:.0f} s ({since_text(abs(clock_ns))})"
    return f"the robot's stamps are {text} {way} this clock; ages here do not depend on it"


# -------------------------------------------------------------------------------------------------------------- topics


def _topics(wire: Wire) -> Iterator[Text]:
    titles = ("FROM THE ROBOT", "type", "QoS as announced", "route", "Hz", "manual", "times", "age")
    yield _columns(titles, STATE_COLUMNS, "bold")
    for topic in wire.topics:
        if topic.is_state:
            yield _state(topic)
    yield Text()
    yield _columns(("TO THE ROBOT", "type", "QoS as announced", "route"), COMMAND_COLUMNS, "bold")
    for topic in wire.topics:
        if not topic.is_state:
            values = (topic.name, _type(topic), _announced(topic), topic.route)
            yield _columns(values, COMMAND_COLUMNS, "", {3: ROUTE_STYLES.get(topic.route, "")})


def _state(topic: WireTopic) -> Text:
    values = (topic.name, _type(topic), _announced(topic), topic.route)
    if not topic.is_heard:
        return _columns((*values, "-", f"{topic.nominal_hz:g}", "-", "-"), STATE_COLUMNS, "dim")
    part = topic.rate_hz / topic.nominal_hz
    age = "never" if topic.age_ns is None else age_text(topic.age_ns)
    return _columns(
        (*values, rate_text(topic.rate_hz), f"{topic.nominal_hz:g}", f"{topic.times:.1f}".removesuffix(".0"), age),
        STATE_COLUMNS,
        "",
        {
            3: ROUTE_STYLES.get(topic.route, ""),
            4: "" if SLOW <= part <= FAST else WAITS,
            6: WAITS if topic.times >= TWICE else "",
            7: "" if topic.route == "active" else ROUTE_STYLES.get(topic.route, ""),
        },
    )


def _type(topic: WireTopic) -> str:
    """Return the type that is announced, without its package; the manual's where nobody announces one."""
    types = sorted({each.type_name for each in topic.announced}) or [topic.type_name]
    return "|".join(name.rpartition("/")[2] for name in types)


def _announced(topic: WireTopic) -> str:
    return " | ".join(dict.fromkeys(qos_text(each.qos) for each in topic.announced)) or "-"


def qos_text(text: str) -> str:
    """Return a token's QoS in words: what it leaves out is left out, volatile is what is meant by no durability.

    Args:
        text: As in the token, `:1::0,10`.
    """
    try:
        qos = parse_qos(text)
    except BadName:
        return text
    words = []
    if qos.reliability is not None:
        words.append("reliable" if qos.reliability is Reliability.RELIABLE else "best-effort")
    words.append("volatile" if qos.durability in (None, Durability.VOLATILE) else "transient")
    if qos.history is History.KEEP_ALL:
        words.append("all")
    elif qos.depth is not None:
        words.append(str(qos.depth))
    return " ".join(words)


def _columns(values: Sequence[str], widths: Sequence[int], style: str, styles: Mapping[int, str] | None = None) -> Text:
    line = Text(style=style)
    for n, (value, width) in enumerate(zip(values, widths, strict=True)):
        cell = f"{value:>{width}}" if width > 0 else f"{value:<{-width}}"
        line.append(cell if n == 0 else f" {cell}", (styles or {}).get(n, ""))
    return line


# ----------------------------------------------------------------------------------------------------------------- who


def _who(wire: Wire, is_gateway: bool) -> Iterator[Text]:
    titles = ("WHO IS THERE", "zenoh id", "address")
    yield _columns(titles, WHO_COLUMNS, "bold").append(" what it does, and could do")
    bridges = {bridge.zid: bridge for bridge in wire.bridges}
    for who in wire.neighbours:
        kind = ("this gateway" if is_gateway else "this look") if who.kind == "self" else KINDS.get(who.kind)
        text, style = _doing(who, bridges.get(who.zid), is_router=who.zid == wire.router_zid)
        values = (kind or who.whatami or "sender", who.zid or "(does not say)", _address(who.address))
        yield _columns(values, WHO_COLUMNS, "").append(f" {text}", style)


def _address(address: str) -> str:
    return address.partition("?")[0].partition("#")[0] or "-"


def _doing(who: WireNeighbour, bridge: WireBridge | None, *, is_router: bool) -> tuple[str, str]:
    """Return what somebody does, or could do, and its style."""
    if who.kind == "self":
        return "", ""
    if who.kind == "guard":
        return "stops the robot if the gateway dies", ""
    facts = []
    if who.kind == "robot":
        facts.append(" and ".join([*(["router"] if is_router else []), *(["ROS bridge"] if bridge else [])]))
    if who.kind == "bridge" and bridge is not None:
        facts.append(_bridge(bridge))
    if who.sent:
        ago = "" if who.sent_age_ns is None else f", the last {since_text(who.sent_age_ns)} ago"
        facts.append(f"SENT {sum(who.sent.values())} commands on {names_of(sorted(who.sent))}{ago}")
    if who.publishes:
        facts.append(f"announces commands on {names_of(who.publishes)}")
    if who.listens:
        facts.append(f"reads {len(who.listens)} topics")
    if who.kind == "gateway":
        facts.insert(0, "COMMANDS the robot" if who.is_armed else "commands nothing; could when it enables")
    elif who.kind != "robot" and not (who.sent or who.publishes):
        facts.append("could command: any ROS node behind it" if who.kind == "bridge" else "could command")
    style = BAD if who.sent or who.is_armed else WAITS if who.publishes else ""
    return "; ".join(facts), style


# ------------------------------------------------------------------------------------------------------------ findings


def _findings(wire: Wire) -> Iterator[Text]:
    found = findings_of(wire)
    if not any(finding.level != "info" for finding in found):
        yield Text(" ok the wire is as it should be", style=f"bold {GOOD}")
    for finding in found:
        style = STEP_STYLES[finding.level]
        remedy = f" -> {finding.remedy}" if finding.remedy else ""
        yield Text.assemble((f"{STEP_MARKS[finding.level]} {finding.code}: ", style), finding.text, (remedy, "bold"))
