"""A query that waits for its answer, wherever it came from. The desks know this shape, the transports fill it."""

from __future__ import annotations

from typing import Protocol

from gateway.api.access.roles import Asker
from gateway.api.keys import JSON, MSGPACK

__all__ = ["Audience", "Question", "reply_encoding"]


class Question(Protocol):
    """One query of a client.

    Attributes:
        key: Key that was asked.
        payload: What came with it; untrusted.
        encoding: zenoh encoding of the payload; empty when none was given.
        received_ns: Local monotonic arrival [ns].
        asker: Who asks, as far as the way tells.
    """

    key: str
    payload: bytes
    encoding: str
    received_ns: int
    asker: Asker

    def answer(self, payload: bytes, encoding: str) -> None:
        """Send the one answer and finish. Never raises; may block for a moment when the client does not read."""

    def drop(self) -> None:
        """Finish without an answer; the client will call the outcome unknown."""


class Audience(Protocol):
    """Listeners behind one transport."""

    def wants_snapshots(self) -> bool:
        """Whether anybody listens to snapshots at present."""

    def put_snapshot(self, payload: bytes, seq: int) -> None:
        """Send a snapshot to all who listen; never blocks for one who does not read, never raises."""

    def put_notice(self, payload: bytes, number: int) -> None:
        """Send a notice and its number to all who listen; never raises."""


def reply_encoding(question: Question) -> str:
    """Return the encoding in which a question is answered: its own when we know it, else msgpack."""
    return JSON if question.encoding == JSON else MSGPACK
