"""`python -m tests.bench.fleet_numbers`: what a fleet of any size costs its network, from what one robot was measured to say.

Nothing here is measured: `tests.bench.fleet` does that, and `docs/explanation/fleets.md` has the table that this prints.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

__all__ = ["MEASURED", "Measured", "Sizes", "sizes", "table"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Measured:
    """One robot, as `bin/bench fleet` saw it.

    Attributes:
        snapshot_bytes: A snapshot, as it is put and as `ta2 fleet list` is answered.
        reply_bytes: The answer to a stop, in JSON.
        target_bytes: A streamed target of one arm.
        key_bytes: A key with zenoh's own header; declared keys would be shorter.
        link_bytes: A message's share of TCP, TLS and Ethernet, when each is sent by itself.
        hop_s: A router's time for one message, one way, from socket to socket [s].
        router_hz: Messages a second that one router passes on, on one core.
    """

    snapshot_bytes: int = 4460
    reply_bytes: int = 102
    target_bytes: int = 86
    key_bytes: int = 95
    link_bytes: int = 95
    hop_s: float = 0.0003
    router_hz: float = 60_000.0


MEASURED = Measured()

SNAPSHOT_HZ, TARGETS_HZ, KEEPALIVE_HZ, LEASE_HZ = 50.0, 100.0, 20.0, 2.0
"""Of a viewer; of an owner, both arms at 50 Hz; of an owner; of each connection, both ways (a lease of 2 s, four times)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Sizes:
    """What a fleet costs.

    Attributes:
        robots: In it.
        routers: Of each level, from the leaves that robots connect to up to the one on top.
        idle_hz: Messages at all leaves while nobody asks anything.
        list_bps: At the top, one `ta2 fleet watch` that looks once a second [bit/s].
        views_hz: Messages at all leaves with a viewer and an owner of every hundredth robot.
        views_bps: The same at the top, when all of them are beyond it [bit/s].
        tokens: That every router knows.
        stop_messages: Of one stop for all, with its answers, on all links.
        stop_s: From the command to the last robot, on the way down [s].
        answers_s: Until the last answer is there [s].
        answers_bytes: Of all answers, at the top.
    """

    robots: int
    routers: tuple[int, ...]
    idle_hz: float
    list_bps: float
    views_hz: float
    views_bps: float
    tokens: int
    stop_messages: int
    stop_s: float
    answers_s: float
    answers_bytes: float


def sizes(robots: int, fan_out: int = 100, one: Measured = MEASURED) -> Sizes:
    """Return what a fleet costs.

    Args:
        robots: How many.
        fan_out: Connections below each router, at most.
        one: What one robot says.
    """
    routers = [math.ceil(robots / fan_out)]
    while routers[-1] > 1:
        routers.append(math.ceil(routers[-1] / fan_out))
    levels, head = len(routers), one.key_bytes + one.link_bytes
    watched = max(1, robots // 100)
    per_view_hz = SNAPSHOT_HZ + TARGETS_HZ + KEEPALIVE_HZ
    per_view_bytes = (
        SNAPSHOT_HZ * (one.snapshot_bytes + head) + TARGETS_HZ * (one.target_bytes + head) + KEEPALIVE_HZ * head
    )
    links = robots + sum(routers[:-1])
    widest = min(fan_out, robots)
    return Sizes(
        robots=robots,
        routers=tuple(routers),
        idle_hz=2 * LEASE_HZ * robots,
        list_bps=8 * robots * (one.snapshot_bytes + 2 * head),
        views_hz=watched * per_view_hz,
        views_bps=8 * watched * per_view_bytes,
        tokens=2 * robots + watched,
        stop_messages=2 * links + links + robots * levels,
        stop_s=levels * (one.hop_s + widest / one.router_hz),
        answers_s=levels * (one.hop_s + widest / one.router_hz) + levels * one.hop_s + robots / one.router_hz,
        answers_bytes=robots * (one.reply_bytes + head),
    )


def table() -> str:
    """Return the table of the page."""
    lines = [
        "| robots | routers, from the leaves up | idle, all leaves | one watch at 1 Hz, at the top"
        " | every 100th owned and viewed, at the top | tokens | one stop for all: messages"
        " | last robot has it | last answer is there |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for robots in (1, 8, 50, 1000, 10_000):
        found = sizes(robots)
        lines.append(
            f"| {robots} | {' + '.join(map(str, found.routers))} | {found.idle_hz:.0f}/s | {found.list_bps / 1e6:.2f} Mbit/s"
            f" | {found.views_hz:.0f}/s, {found.views_bps / 1e6:.1f} Mbit/s | {found.tokens} | {found.stop_messages}"
            f" | {found.stop_s * 1e3:.1f} ms | {found.answers_s * 1e3:.0f} ms, {found.answers_bytes / 1e3:.0f} kB |"
        )
    return "\n".join(lines)


if __name__ == "__main__":
    print(table())
