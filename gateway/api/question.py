"""A query that waits for its answer, wherever it came from. The desks know this shape, the transports fill it."""

from __future__ import annotations

import logging
from typing import Protocol

import zenoh

from gateway.api.access.roles import Asker
from gateway.api.keys import JSON, MSGPACK

__all__ = ["Audience", "Question", "ZenohQuestion", "plain_encoding", "reply_encoding"]

log = logging.getLogger(__name__)


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


class ZenohQuestion:
    """A zenoh query that waits for its answer."""

    __slots__ = ("_query", "asker", "encoding", "key", "payload", "received_ns")

    def __init__(self, query: zenoh.Query, received_ns: int, asker: Asker) -> None:
        self._query = query
        self.asker = asker
        self.key = str(query.key_expr)
        self.payload = b"" if query.payload is None else query.payload.to_bytes()
        self.encoding = plain_encoding(query.encoding)
        self.received_ns = received_ns

    def answer(self, payload: bytes, encoding: str) -> None:
        """Reply and finish. A client that has gone meanwhile needs no reply."""
        try:
            with self._query as query:
                query.reply(self.key, payload, encoding=encoding)
        except zenoh.ZError as error:
            log.debug("a reply on %s was not sent: %s", self.key, error)

    def drop(self) -> None:
        """Finish without a reply."""
        self._query.drop()  # type: ignore[no-untyped-call]  # zenoh's stubs leave the return type out


def plain_encoding(encoding: zenoh.Encoding | None) -> str:
    """Return the encoding as protocol text; empty when none was given (zenoh then says `zenoh/bytes`)."""
    text = "" if encoding is None else str(encoding)
    return "" if text.startswith("zenoh/") else text.partition(";")[0]
