"""Who else is on the robot, as a person reads it: one line each, the dangerous ones first. Pure."""

from __future__ import annotations

from collections.abc import Iterator

from gateway.api import protocol
from gateway.cli.terminal.figures import since_text, topic_text

__all__ = ["foreign_on", "is_in_the_way", "other_text", "others_in_order"]


def is_in_the_way(other: protocol.OtherView) -> bool:
    """Return whether somebody commands the robot, or announces it; a gateway that is only connected does not."""
    return other.armed or other.kind != "gateway"


def others_in_order(view: protocol.Snapshot) -> list[protocol.OtherView]:
    """Return all of them, whoever is in the way first."""
    return sorted(view.others.seen, key=lambda other: not is_in_the_way(other))


def other_text(other: protocol.OtherView, at_ns: int) -> str:
    """Return one line about somebody."""
    name = other.zid or "a session without a name"
    who = f"{name} at {other.link}" if other.link else name
    since = since_text(at_ns - other.since_ns)
    if other.kind == "gateway":
        return f"gateway {who} {'commands the robot' if other.armed else 'is connected, commands nothing'}, for {since}"
    if other.kind == "data":
        return f"{who} has sent {other.count} commands on {topic_text(other.topic)} for {since}"
    how = "a ROS node behind" if other.kind == "token" else "a publisher of"
    return f"{how} {who} announces {topic_text(other.topic)}, for {since}"


def foreign_on(view: protocol.Snapshot, topic: str) -> Iterator[protocol.OtherView]:
    """Yield those who send on a command topic, or announce it."""
    yield from (other for other in view.others.seen if other.topic == topic)
