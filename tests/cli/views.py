"""Snapshots as clients get them, for tests of what is shown."""

from __future__ import annotations

from msgspec.structs import replace

from gateway.api import protocol
from gateway.api.translate import describe
from gateway.messages.snapshot import LeaseView, StreamView, TopicView
from gateway.robot.topics import COMMAND_TOPICS, STATE_TOPICS, TOPICS
from gateway.settings.settings import Settings
from tests.api.stand_in import a_snapshot

MS = 1_000_000
S = 1_000_000_000
INFO = describe(Settings(), socket="/run/ta2/gateway.sock", pid=4711)


def all_topics():
    """Return every state topic, well and alive."""
    return {
        name: TopicView(
            age_ns=3 * MS, rate_hz=TOPICS[name].rate_hz, worst_gap_ns=7 * MS, count=9, duplicates=0, refused=0
        )
        for name in STATE_TOPICS
    }


def a_view(**changes):
    """Return a snapshot of a robot at rest, with every topic and stream, changed as asked."""
    snapshot = a_snapshot(seq=7, at_ns=1000 * S)
    streams = {name: StreamView(running=False, sent=0, rate_hz=0.0, worst_gap_ns=0) for name in COMMAND_TOPICS}
    return as_seen(replace(snapshot, **{"topics": all_topics(), "streams": streams, **changes}))


def as_seen(snapshot):
    """Return a snapshot of the core as a client decodes it."""
    return protocol.decode_snapshot(protocol.encode(snapshot))


def owned(**changes):
    """Return the lease of an owner who lives."""
    lease = LeaseView(
        owned=True,
        name="policy-a",
        client_id="c0ffee",
        pid=123,
        epoch=4,
        since_ns=990 * S,
        on_loss="hold",
        lost_ns=None,
        free_in_ns=None,
        down_in_ns=None,
    )
    return replace(lease, **changes)
