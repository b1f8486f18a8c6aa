"""Is everything well? One flat answer for logs, metrics and people, made without asking anybody."""

from __future__ import annotations

import os
from collections.abc import Mapping

from msgspec import Struct, field
from msgspec.structs import replace

from gateway.client.connection.session import Session
from gateway.client.state.reading import state_of
from gateway.client.state.showing import health_table

__all__ = ["Health", "health_of"]

OLD_NS = 1_000_000_000
"""An older snapshot says nothing about the robot's health [ns]."""


class Health(Struct, frozen=True, kw_only=True):
    """Is everything well, and if not, what is it? Plain numbers, ready for a log or a metric.

    Attributes:
        daemon: Whether the daemon is connected.
        ok: It is, the link is fresh, nothing is latched, no stop went undelivered, and this was seen within a second.
        state: What a person should read, e.g. `ACTIVE`, `ESTOP`.
        link_up: Whether there is a transport to the robot.
        link_age: Age of the newest state of the robot [s]; None before the first.
        fsm: Name of the robot's FSM state.
        latches: What holds motion off until `recover()`.
        findings: Codes of what seems to keep the robot from doing what it is told; `why()` has words and remedies.
        lease_holder: Name of the owner; None when there is none.
        lease_lost_for: How long the owner has been silent beyond the limit [s]; None while it is alive.
        free_in: Until the lease is free [s]; None when no clock runs.
        down_in: Until everything goes down [s]; None when no clock runs.
        ages: Age of each state topic [s]; None for those that were never heard.
        rates: Measured rate of each state topic [Hz].
        streams: Worst gap of each command stream that runs, in the last 10 s [s].
        loop_late: Latest lateness of the control loop [s].
        loop_worst_late: Worst one in the last 10 s [s].
        loop_skipped: Periods that the control loop skipped since its start.
        snapshot_age: Since the newest snapshot arrived here [s]; None before the first.
        snapshots_dropped: Snapshots that did not reach this client.
        notices_dropped: Notices that did not reach this client, or that were pushed out before anybody read `events()`.
        stop_undelivered: The last stop of this client could not be sent to the robot for lack of a transport, or the
            daemon has said so of somebody's, and it was not seen since that the link is fresh and nothing is latched. Use
            the physical emergency stop.
    """

    daemon: bool
    ok: bool = False
    state: str = "UNKNOWN"
    link_up: bool = False
    link_age: float | None = None
    fsm: str = "UNKNOWN"
    latches: tuple[str, ...] = ()
    findings: tuple[str, ...] = ()
    lease_holder: str | None = None
    lease_lost_for: float | None = None
    free_in: float | None = None
    down_in: float | None = None
    ages: Mapping[str, float | None] = field(default_factory=dict)
    rates: Mapping[str, float] = field(default_factory=dict)
    streams: Mapping[str, float] = field(default_factory=dict)
    loop_late: float | None = None
    loop_worst_late: float | None = None
    loop_skipped: int = 0
    snapshot_age: float | None = None
    snapshots_dropped: int = 0
    notices_dropped: int = 0
    stop_undelivered: bool = False

    def _repr_html_(self) -> str:
        """Show it as a table, in a notebook."""
        return health_table(self)


def health_of(session: Session) -> Health:
    """Return the health as this client sees it; never raises for lack of a daemon. A forked process has none."""
    if os.getpid() != session.pid:  # a lock that was held at the fork is never given back
        return Health(daemon=False)
    connected, sighting = session.is_connected, session.sighting()
    seen = Health(
        daemon=connected,
        snapshots_dropped=session.snapshots_dropped,
        notices_dropped=session.news.dropped,
        stop_undelivered=session.stop_undelivered,
    )
    if sighting is None:
        return seen
    state = state_of(sighting, session.transport.now_ns())
    view, since_ns = state.view, round(state.age * 1e9)
    well = view.link.fresh and not view.latches and not session.stop_undelivered
    return replace(
        seen,
        ok=connected and well and since_ns < OLD_NS,
        state=view.shown,
        link_up=view.link.up,
        link_age=_seconds(view.link.age_ns, since_ns),
        fsm=state.fsm_name,
        latches=tuple(view.latches),
        findings=tuple(finding.code for finding in view.findings),
        lease_holder=view.lease.name if view.lease.owned else None,
        lease_lost_for=_seconds(view.lease.lost_ns, since_ns),
        free_in=_seconds(view.lease.free_in_ns, -since_ns),
        down_in=_seconds(view.lease.down_in_ns, -since_ns),
        ages={name: _seconds(topic.age_ns, since_ns) for name, topic in view.topics.items()},
        rates={name: topic.rate_hz for name, topic in view.topics.items()},
        streams={name: stream.worst_gap_ns / 1e9 for name, stream in view.streams.items() if stream.running},
        loop_late=view.loop.late_ns / 1e9,
        loop_worst_late=view.loop.worst_late_ns / 1e9,
        loop_skipped=view.loop.skipped,
        snapshot_age=state.age,
    )


def _seconds(value_ns: int | None, since_ns: int) -> float | None:
    return None if value_ns is None else max(0, value_ns + since_ns) / 1e9
