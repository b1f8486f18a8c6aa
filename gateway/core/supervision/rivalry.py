"""What follows from others on the robot beside the supervisor's table: our claim, the words about them, and a 0.0 that ends.

Looked at once a tick, before conditions and requests. Who is there is known to `others.py`, when a claim holds to
`claim.py`, and what a foreign writer or another gateway stops stands in the supervisor's table (`conditions.py` fires it).
"""

from __future__ import annotations

from collections.abc import Iterable

from gateway.core.messages.outputs import Level
from gateway.core.messages.sightings import ClaimShown, ForeignData, ForeignTokens, Gateway, GatewayTokens, Sighting
from gateway.core.others.others import Trace
from gateway.core.supervision.coordinator import Coordinator
from gateway.core.supervision.supervisor import STREAMING
from gateway.errors import Code

__all__ = ["NEWCOMER_NS", "Rivalry"]

NEWCOMER_NS = 1_000_000_000
"""A gateway that commands nothing is told of after this [ns]: our own guard is seen before it has said its name."""


class Rivalry:
    """Follows others."""

    def __init__(self, coordinator: Coordinator) -> None:
        self._coordinator = coordinator
        self._was_alone = True
        self._told_writers: dict[str, str] = {}
        self._told_gateways: dict[str, Gateway] = {}
        self._told_data: dict[tuple[str, str], Trace] = {}

    def link_up(self, own_zid: str, now_ns: int) -> None:
        """Another transport is open.

        Args:
            own_zid: Zenoh id of our session on it; empty when unknown.
            now_ns: Monotonic time [ns].
        """
        others = self._coordinator.others
        others.own_zid = own_zid
        others.befriend(own_zid)
        self._coordinator.claim.link_up(now_ns)

    def receive(self, sighting: Sighting) -> None:
        """Take what the link saw."""
        others = self._coordinator.others
        if isinstance(sighting, ForeignData):
            others.see_data(sighting)
        elif isinstance(sighting, ForeignTokens):
            others.see_writers(sighting.writers, sighting.at_ns)
        elif isinstance(sighting, GatewayTokens):
            others.see_gateways(sighting.gateways, sighting.at_ns)
        elif isinstance(sighting, ClaimShown):
            self._coordinator.claim.shown(sighting.claim, sighting.at_ns)
        else:
            others.befriend(sighting.zid)

    def step(self, now_ns: int) -> None:
        """Claim or withdraw, say who came and went, and end a 0.0 that would fall in somebody else's motion."""
        coordinator = self._coordinator
        body, others = coordinator.body, coordinator.others
        is_wanted = coordinator.lease.owner is not None or coordinator.state in STREAMING
        if coordinator.state not in STREAMING and coordinator.guard.is_held_elsewhere(others.armed_friends):
            is_wanted = False  # to that guard a claim is another gateway's: it would let go
        rivals = [gateway.zid for gateway in others.armed]
        coordinator.claim.step(
            now_ns,
            is_wanted=is_wanted,
            is_used=(is_wanted and not rivals) or any(stream.running for stream in body.streams),
            own_zid=others.own_zid,
            rivals=rivals,
        )
        was_alone, self._was_alone = self._was_alone, others.is_alone
        if was_alone and others.is_alone:
            return  # nobody to tell of, and nobody left since
        self._tell_writers(now_ns)
        self._tell_gateways(now_ns)
        self._tell_data(others.data(now_ns), now_ns)
        heartbeat = body.heartbeat
        if heartbeat.is_ending and not heartbeat.is_estop and (rivals or others.arm_data_text(now_ns)):
            heartbeat.silence()

    # ------------------------------------------------------------------------------------------------ words

    def _tell_writers(self, now_ns: int) -> None:
        told: dict[str, str] = {}
        for writer in self._coordinator.others.writers:
            topics = told.get(writer.zid)
            told[writer.zid] = f"{topics}, {writer.topic}" if topics else writer.topic
        if told == self._told_writers:
            return
        links = {writer.zid: writer.link for writer in self._coordinator.others.writers}
        for zid in told.keys() - self._told_writers.keys():
            where = links[zid] or "an unknown address"
            self._coordinator.notice(
                Code.FOREIGN_WRITER,
                Level.WARNING,
                f"zenoh session {zid} at {where} announces commands to the robot: {told[zid]}",
                now_ns,
                zid=zid,
                link=links[zid],
                topics=told[zid],
            )
        for zid in self._told_writers.keys() - told.keys():
            self._coordinator.notice(
                Code.FOREIGN_WRITER,
                Level.INFO,
                f"zenoh session {zid} announces no commands any more",
                now_ns,
                zid=zid,
            )
        self._told_writers = told

    def _tell_gateways(self, now_ns: int) -> None:
        others, told = self._coordinator.others, self._told_gateways
        there = {
            gateway.zid: gateway
            for gateway in others.gateways
            if gateway.is_armed or gateway.zid in told or now_ns - others.since_ns(gateway) >= NEWCOMER_NS
        }
        if there == told:
            return
        for zid in {*there, *told}:
            before, after = told.get(zid), there.get(zid)
            is_armed, was_armed = after is not None and after.is_armed, before is not None and before.is_armed
            if (after is not None and before is not None and is_armed == was_armed) or zid in others.friends:
                continue  # its address became known, or that it is ours
            if is_armed:
                words = "commands the robot, or is about to"
            elif after is None:
                words = "is gone"
            else:
                words = "commands nothing any more" if was_armed else "is connected, and commands nothing"
            self._coordinator.notice(
                Code.OTHER_GATEWAY,
                Level.WARNING if is_armed else Level.INFO,
                f"another gateway, zenoh session {zid}, {words}",
                now_ns,
                zid=zid,
                link=after.link if after is not None else "",
            )
        self._told_gateways = there

    def _tell_data(self, traces: Iterable[Trace], now_ns: int) -> None:
        there = {(trace.topic, trace.zid): trace for trace in traces}
        for key in there.keys() - self._told_data.keys():
            trace = there[key]
            self._coordinator.notice(
                Code.FOREIGN_WRITER,
                Level.WARNING,
                f"commands on {trace.topic} that we did not send, by {self._coordinator.others.sender(trace)}",
                now_ns,
                topic=trace.topic,
                zid=trace.zid,
                link=trace.link,
            )
        for key in self._told_data.keys() - there.keys():
            trace = self._told_data[key]
            self._coordinator.notice(
                Code.FOREIGN_WRITER,
                Level.INFO,
                f"no foreign commands on {trace.topic} any more; there were {trace.count}",
                now_ns,
                topic=trace.topic,
                zid=trace.zid,
            )
        self._told_data = there
