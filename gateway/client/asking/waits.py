"""What a client waits for, as values that a shell can poll: a daemon, an answer, a state, an instant.

Rules
    * Every wait has a deadline. What was missing when it passed is in the exception: the state that was seen last.
    * A reply that was lost is asked for again with the same request number, as long as it is the same daemon: it then
      answers what it answered before. When that fails, the outcome is unknown, and said to be.
    * A wait raises what ended it, in the exception class of its code.

Nothing here waits: `poll` looks, and the shell sleeps between two looks. Called with the session's condition held.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Generic, Protocol, TypeVar

from gateway.api import protocol
from gateway.client.connection.session import Session, Sighting
from gateway.errors import STOP_UNKNOWN, Code, GatewayError, failure, to_exception

__all__ = [
    "Answer",
    "Daemon",
    "Pause",
    "Seen",
    "Stopped",
    "Wait",
    "answered_reply",
    "dropped",
    "not_in_time",
]

REPEAT_NS = 100_000_000
"""Shortest time between two attempts to get a lost reply [ns]."""

ALONE_NS = 300_000_000
"""A stop that nobody took for so long, while no daemon is known, goes elsewhere [ns]."""

T = TypeVar("T")
T_co = TypeVar("T_co", covariant=True)


class Wait(Protocol[T_co]):
    """Something to wait for.

    Attributes:
        deadline_ns: When to give up, on the transport's clock [ns].
    """

    deadline_ns: int

    def poll(self, now_ns: int) -> T_co | None:
        """Return what was waited for, or None when it is not there yet; raise what makes it impossible."""

    def expire(self) -> GatewayError:
        """Return the exception for the deadline."""


class Daemon:
    """Waits until a daemon of our version is there."""

    def __init__(self, session: Session, timeout_ns: int) -> None:
        self._session = session
        self.deadline_ns = session.transport.now_ns() + timeout_ns

    def poll(self, now_ns: int) -> bool | None:
        """Return True when it is there.

        Raises:
            ProtocolError: UNSUPPORTED_VERSION, only daemons of other versions are there.
        """
        if self._session.is_connected:
            return True
        if self._session.other_versions:
            others = ", ".join(sorted(self._session.other_versions))
            raise failure(
                Code.UNSUPPORTED_VERSION,
                f"the daemon speaks protocol version {others}, this client {protocol.PROTOCOL_VERSION}",
                field="version",
                value=others,
                bound=str(protocol.PROTOCOL_VERSION),
            )
        return None

    def expire(self) -> GatewayError:
        """Say that nobody is there."""
        return failure(Code.DISCONNECTED, f"no daemon answers at {self._session.transport.address}")


class Answer(Generic[T]):
    """Asks something and waits for the answer.

    `payload` goes again when the answer was lost; `read` makes the answer out of what came, and may raise what that
    says.

    Raises:
        Disconnected: No daemon is there; nothing was sent.
    """

    def __init__(
        self, session: Session, key: str, payload: bytes, read: Callable[[bytes], T], timeout_ns: int, what: str
    ) -> None:
        session.require_daemon()
        self._session = session
        self._key = key
        self._payload = payload
        self._read = read
        self._what = what
        self._daemon = session.daemon
        self._answer: bytes | None = None
        self._under_way = False
        self._repeat_ns = 0
        self.deadline_ns = session.transport.now_ns() + timeout_ns
        self._send(session.transport.now_ns())

    def _send(self, now_ns: int) -> None:
        self._under_way = True
        self._repeat_ns = now_ns + REPEAT_NS
        timeout_s = max(self.deadline_ns - now_ns, 1_000_000) / 1e9
        self._session.transport.ask(self._key, self._payload, timeout_s, self._take)

    def _take(self, payload: bytes | None) -> None:
        if payload is None:  # without the session's lock, see `Transport.ask`: the next look finds it
            self._under_way = False
            return
        with self._session.changed:
            self._under_way = False
            self._answer = payload
        self._session.notify()

    def poll(self, now_ns: int) -> T | None:
        """Return the answer.

        Raises:
            GatewayError: What the daemon refused with.
            OutcomeUnknown: The daemon went away before it answered.
        """
        if self._answer is not None:
            try:
                return self._read(self._answer)
            except protocol.Malformed as error:
                raise failure(Code.UNSUPPORTED_VERSION, f"the answer to {self._what} is not ours: {error}") from None
        if not self._under_way:
            try:
                self._session.require_daemon(self._daemon)
            except GatewayError as error:
                raise self._unknown(error.refusal.message) from None
            if now_ns >= self._repeat_ns and self._session.is_connected:
                self._send(now_ns)
        return None

    def expire(self) -> GatewayError:
        """Say that the outcome is unknown."""
        return self._unknown("no reply came in time")

    def _unknown(self, why: str) -> GatewayError:
        return failure(Code.OUTCOME_UNKNOWN, f"{self._what} was sent and may or may not have run: {why}")


def answered_reply(payload: bytes) -> protocol.Reply:
    """Return an accepting reply; raise the exception of a refusing one."""
    reply = protocol.decode_reply(payload)
    if reply.refusal is not None:
        raise to_exception(protocol.refusal_of(reply.refusal))
    return reply


def dropped(session: Session, command: protocol.Stop | protocol.Estop) -> tuple[str, bytes]:
    """Drop a stop where it needs no session and asks nobody; return its key and payload, to ask what became of it.

    Raises:
        Disconnected: There is nobody to ask: this client was closed, or this process was forked. It was dropped all the same,
            as somebody's.
    """
    key = protocol.ESTOP_KEY if isinstance(command, protocol.Estop) else protocol.STOP_KEY
    who = {"name": session.name, "reason": command.reason}
    try:
        session.require_own_process()
        if session.is_closed:
            session.require_daemon()
        who |= {"client_id": session.client_id, "secret": session.secret}
    except GatewayError as error:
        raise to_exception(replace(error.refusal, hint=STOP_UNKNOWN)) from None
    finally:
        payload = protocol.encode(who, protocol.JSON)
        session.transport.drop(key, payload)
    return key, payload


class Stopped:
    """Sends a stop, and waits for what became of it. It leaves first: nothing is asked, and nobody need be known, before."""

    def __init__(self, session: Session, command: protocol.Stop | protocol.Estop, timeout_ns: int) -> None:
        self._session = session
        self._key, self._payload = dropped(session, command)
        self._reply: protocol.Reply | None = None
        self._under_way = False
        self._repeat_ns = 0
        self._may_have_run = session.is_connected
        self._begun_ns = session.transport.now_ns()
        self.deadline_ns = self._begun_ns + timeout_ns
        self._send(self._begun_ns)

    def _send(self, now_ns: int) -> None:
        self._under_way = True
        self._repeat_ns = now_ns + REPEAT_NS
        left_s = max(self.deadline_ns - now_ns, 1_000_000) / 1e9
        self._session.transport.ask(self._key, self._payload, left_s, self._take)

    def _take(self, payload: bytes | None) -> None:
        if payload is None:  # as in `Answer`
            self._under_way = False
            return
        with self._session.changed:
            self._under_way = False
            self._reply = protocol.decode_reply(payload)
        self._session.notify()

    def poll(self, now_ns: int) -> protocol.Reply | None:
        """Return the reply.

        Raises:
            GatewayError: It was refused.
            OutcomeUnknown: The daemon went away before it answered.
            Disconnected: Nobody is there, or was.
        """
        if self._reply is not None:
            if self._reply.refusal is not None:
                raise to_exception(protocol.refusal_of(self._reply.refusal))
            return self._reply
        if not self._under_way:
            if now_ns - self._begun_ns > ALONE_NS:
                try:
                    self._session.require_daemon()
                except GatewayError as error:
                    if self._may_have_run:
                        raise self._unknown(error.message) from None
                    raise failure(error.code, error.message, hint=STOP_UNKNOWN) from None
            if now_ns >= self._repeat_ns:
                self._send(now_ns)
        return None

    def expire(self) -> GatewayError:
        """Say that nobody knows whether it stopped."""
        return self._unknown("no answer came in time")

    def _unknown(self, why: str) -> GatewayError:
        text = f"the stop of {self._session.name!r} was sent and may or may not have run: {why}"
        return failure(Code.OUTCOME_UNKNOWN, text, hint=STOP_UNKNOWN)


class Seen(Generic[T]):
    """Waits until a snapshot shows something.

    `condition` returns what was waited for, or None, and may raise what makes it impossible; snapshots up to
    `after_seq` do not count.
    """

    def __init__(
        self,
        session: Session,
        condition: Callable[[Sighting], T | None],
        timeout_ns: int,
        what: str,
        *,
        after_seq: int = 0,
    ) -> None:
        session.require_daemon()
        self._session = session
        self._condition = condition
        self._what = what
        self._timeout_ns = timeout_ns
        self._after_seq = after_seq
        self._daemon = session.daemon
        self.deadline_ns = session.transport.now_ns() + timeout_ns

    def poll(self, now_ns: int) -> T | None:
        """Return what the newest snapshot shows.

        Raises:
            Disconnected: The daemon is gone.
        """
        self._session.require_daemon(self._daemon)
        sighting = self._session.sighting()
        if sighting is None or sighting.view.seq <= self._after_seq:
            return None
        return self._condition(sighting)

    def expire(self) -> GatewayError:
        """Say what was seen instead."""
        return not_in_time(self._session, self._what, self._timeout_ns)


def not_in_time(session: Session, what: str, timeout_ns: int) -> GatewayError:
    """Return the exception for a wait that ended in vain: what was seen instead."""
    sighting = session.sighting()
    if sighting is None:
        seen = "no snapshot came"
    else:
        view = sighting.view
        age_s = (session.transport.now_ns() - sighting.received_ns) / 1e9
        fsm = "unknown" if view.fsm is None else protocol.FSM_NAMES.get(view.fsm, str(view.fsm))
        link = "fresh" if view.link.fresh else ("stale" if view.link.up else "down")
        seen = f"the gateway is {view.shown}, the robot's FSM {fsm}, the link {link} (seen {age_s:.2f} s ago)"
    return failure(Code.TIMEOUT, f"{what} did not happen in {timeout_ns / 1e9:g} s: {seen}")


class Pause:
    """Waits for an instant."""

    def __init__(self, until_ns: int) -> None:
        self.deadline_ns = until_ns

    def poll(self, now_ns: int) -> bool | None:
        """Return True when it has come."""
        return True if now_ns >= self.deadline_ns else None

    def expire(self) -> GatewayError:
        """Never called: at the deadline `poll` is true."""
        raise AssertionError("an instant was waited for past itself")
