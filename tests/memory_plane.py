"""The local plane without a network: joins clients and an engine inside one thread, for tests in virtual time.

The same inbox and outbox as behind the sockets, without the threads: a question is read when it is asked, a reply is
delivered when it is sent. `tests.memory_transport` is the other half; it knows this class by its shape only.
"""

from __future__ import annotations

import weakref
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

from gateway.api import protocol
from gateway.api.access.roles import Asker
from gateway.api.inbox import Inbox
from gateway.api.outbox import Outbox
from gateway.api.stop_lane import StopLane
from gateway.core.messages import events, outputs
from gateway.messages.snapshot import Snapshot

__all__ = ["Listener", "MemoryPlane"]


class Listener(Protocol):
    """A client as the plane sees it."""

    def on_snapshot(self, payload: bytes, seq: int, received_ns: int) -> None:
        """Take a published snapshot."""
        ...

    def on_notice(self, payload: bytes, number: int) -> None:
        """Take a notice and its number."""
        ...

    def on_daemon(self, token: str, alive: bool) -> None:
        """Learn that a daemon's token came or went."""
        ...


ADMIN = Asker()


@dataclass(slots=True, kw_only=True)
class _MemoryQuestion:
    key: str
    payload: bytes
    encoding: str
    received_ns: int
    on_done: Callable[[bytes | None], None]
    asker: Asker = ADMIN

    def answer(self, payload: bytes, encoding: str) -> None:
        self.on_done(payload)

    def drop(self) -> None:
        self.on_done(None)


class MemoryPlane:
    """A local plane whose clients live in this process; `poll`, `send` and `publish_snapshot` as `LocalPlane` has them.

    Args:
        info: What the daemon says about itself.
        now_ns: The clock of both sides [ns].
        daemon_id: Identity in its liveliness token.
    """

    def __init__(self, info: protocol.Info, now_ns: Callable[[], int], daemon_id: str = "memory") -> None:
        self.now_ns = now_ns
        self.reachable = True
        self._daemon_id = daemon_id
        self._stops = StopLane()
        weakref.finalize(self, self._stops.close)
        self._outbox = Outbox(info, self._stops)
        self._inbox = Inbox(self._outbox)
        self._stops.proven = self._inbox.identities.is_proven
        self._outbox.add_audience(self)
        self._listeners: dict[str, Listener] = {}
        self._heeded: frozenset[str] = frozenset()

    # ------------------------------------------------------------------------------------------------ the client's side

    def join(self, client_id: str, listener: Listener) -> None:
        """Let a client in; it learns at once that the daemon lives."""
        self._listeners[client_id] = listener
        if self.reachable:
            listener.on_daemon(protocol.daemon_token(self._daemon_id), True)

    def leave(self, client_id: str) -> None:
        """Let a client go, as when its liveliness token ends."""
        if self._listeners.pop(client_id, None) is not None:
            self._inbox.put_gone(client_id, self.now_ns())

    def ask(self, key: str, payload: bytes, encoding: str, on_done: Callable[[bytes | None], None]) -> None:
        """Ask something; `on_done` gets the reply, or None when there will be none."""
        if not self.reachable:
            on_done(None)
            return
        question = _MemoryQuestion(
            key=key, payload=payload, encoding=encoding, received_ns=self.now_ns(), on_done=on_done
        )
        if key in (protocol.STOP_KEY, protocol.ESTOP_KEY):
            self._stops.arrive(key, payload, question.received_ns, question)
            return
        self._inbox.ask(question)
        while self._inbox.sort(0):
            pass
        self._flush()

    def put(self, key: str, payload: bytes) -> None:
        """Put a target or a keepalive."""
        if not self.reachable:
            return
        if key in (protocol.STOP_KEY, protocol.ESTOP_KEY):
            self._stops.arrive(key, payload, self.now_ns())
        elif protocol.put_by(key)[0] not in self._heeded:
            return
        elif key.startswith(f"{protocol.ROOT}/keepalive/"):
            self._inbox.put_keepalive(key, self.now_ns())
        elif key.startswith(f"{protocol.ROOT}/check_in/"):
            self._inbox.put_check_in(key, self.now_ns())
        else:
            self._inbox.put_target(key, payload, protocol.MSGPACK, self.now_ns())

    def set_reachable(self, reachable: bool) -> None:
        """Cut or mend the connection: clients see the daemon's token go or come; nothing passes meanwhile."""
        self.reachable = reachable
        for listener in self._listeners.values():
            listener.on_daemon(protocol.daemon_token(self._daemon_id), reachable)

    # ------------------------------------------------------------------------------------------------ the engine's side

    def poll(self) -> list[events.Event]:
        """Return what arrived since the last call, stops first."""
        return [*self._stops.poll(), *self._inbox.poll()]

    def heed(self, client_ids: frozenset[str]) -> None:
        """Let those clients, and nobody else, put targets, keepalives and check-ins."""
        self._heeded = client_ids

    def send(self, replies: Sequence[outputs.Reply], notices: Sequence[outputs.Notice]) -> None:
        """Deliver replies and notices."""
        self._outbox.send(replies, notices)
        self._flush()

    def publish_snapshot(self, snapshot: Snapshot) -> None:
        """Deliver a snapshot."""
        self._outbox.publish_snapshot(snapshot)
        self._outbox.expire(self.now_ns())
        self._flush()

    def _flush(self) -> None:
        while self._stops.deliver(0) or self._outbox.deliver(0):
            pass

    # ------------------------------------------------------------------------------------------------ as an audience

    def wants_snapshots(self) -> bool:
        """Whether any client is there to listen."""
        return self.reachable and bool(self._listeners)

    def put_snapshot(self, payload: bytes, seq: int) -> None:
        """Hand a snapshot to every client."""
        for listener in list(self._listeners.values()):
            listener.on_snapshot(payload, seq, self.now_ns())

    def put_notice(self, payload: bytes, number: int) -> None:
        """Hand a notice to every client."""
        if self.reachable:
            for listener in list(self._listeners.values()):
                listener.on_notice(payload, number)
