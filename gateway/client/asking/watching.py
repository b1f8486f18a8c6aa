"""Watching without asking: the next snapshot, the next notice, the next instant. Procedures like those of `procedures`.

Rules
    * Watching outlives the daemon: one that is restarted is watched on by itself, from what it says now. Its absence
      counts as silence.
    * The newest snapshot wins, whatever came meanwhile; of notices none is left out without being counted.
    * Whoever watches is told by `Closed` that the client was closed: an iterator then ends, and raises nothing.
"""

from __future__ import annotations

import math
from collections.abc import Callable

from gateway.api import protocol
from gateway.client.asking.procedures import REQUEST_NS, Procedure
from gateway.client.asking.requests import number
from gateway.client.asking.waits import Pause, Seen, not_in_time
from gateway.client.connection.session import Session, Sighting
from gateway.errors import Code, GatewayError, failure

__all__ = ["Feed", "Pace", "first", "fresh", "pause"]

FOREVER_NS = 1 << 62
"""A deadline that is never reached [ns]: 146 years."""


class _Watched:
    """Waits for a snapshot that shows something, across restarts of the daemon; gives False when the client was closed.

    Nothing is returned before `not_before_ns`, from which the timeout counts [ns].
    """

    def __init__(
        self, session: Session, wanted: Callable[[Sighting, int], bool], timeout_ns: int, not_before_ns: int = 0
    ) -> None:
        self._session = session
        self._wanted = wanted
        self._timeout_ns = timeout_ns
        self._not_before_ns = not_before_ns
        self.deadline_ns = max(session.transport.now_ns(), not_before_ns) + timeout_ns

    def poll(self, now_ns: int) -> Sighting | bool | None:
        session = self._session
        session.require_own_process()
        if session.is_closed:
            return False
        sighting = session.sighting()
        if sighting is None or now_ns < self._not_before_ns or not self._wanted(sighting, now_ns):
            return None
        return sighting

    def expire(self) -> GatewayError:
        try:
            self._session.require_daemon()
        except GatewayError as gone:
            return gone
        return not_in_time(self._session, "the next snapshot", self._timeout_ns)


class Pace:
    """Takes new snapshots at a highest rate.

    Args:
        session: Of this client.
        max_rate: At most so many a second [Hz]; None for as they come.
        timeout_ns: Longest wait for the next one [ns].
    """

    def __init__(self, session: Session, max_rate: float | None, timeout_ns: int) -> None:
        max_rate = None if max_rate is None else number("max_rate", max_rate)
        if max_rate is not None and not (math.isfinite(max_rate) and max_rate > 0):
            raise failure(
                Code.OUT_OF_RANGE,
                f"max_rate is {max_rate:g} Hz, a positive rate is needed",
                field="max_rate",
                value=f"{max_rate:g}",
                bound="> 0",
                unit="Hz",
                hint="stay inside the bound",
            )
        self._session = session
        self._period_ns = 0 if max_rate is None else round(1e9 / max_rate)
        self._timeout_ns = timeout_ns
        self._last = ("", 0)
        self._due_ns = session.transport.now_ns()

    def next(self) -> Procedure[Sighting | None]:
        """Return the next snapshot, not before it is due; None when the client was closed.

        Raises:
            GatewayTimeout: A daemon is there and made none in time.
            Disconnected: No daemon came in time.
        """
        sighting: Sighting | bool = yield _Watched(self._session, self._is_new, self._timeout_ns, self._due_ns)
        if isinstance(sighting, bool):
            return None
        self._last = sighting.daemon, sighting.view.seq
        self._due_ns = max(self._due_ns + self._period_ns, self._session.transport.now_ns() - self._period_ns)
        return sighting

    def _is_new(self, sighting: Sighting, _: int) -> bool:
        daemon, seq = self._last
        return sighting.daemon != daemon or sighting.view.seq > seq


def first(session: Session) -> Procedure[Sighting]:
    """Return the first snapshot of a daemon that has just come."""
    sighting: Sighting = yield Seen(session, lambda seen: seen, REQUEST_NS, "the first snapshot")
    return sighting


def fresh(session: Session, max_age_ns: int, timeout_ns: int) -> Procedure[Sighting]:
    """Return a snapshot whose newest state of the robot is at most so old.

    Raises:
        Stale: STATE_STALE, none came in time.
        Disconnected: No daemon is there, or the client was closed.
    """

    def is_fresh(sighting: Sighting, now_ns: int) -> bool:
        age_ns = sighting.view.link.age_ns
        return age_ns is not None and age_ns + now_ns - sighting.received_ns <= max_age_ns

    try:
        sighting: Sighting | bool = yield _Watched(session, is_fresh, timeout_ns)
    except TimeoutError as error:
        raise failure(
            Code.STATE_STALE,
            f"no state of the robot younger than {max_age_ns / 1e6:g} ms came in {timeout_ns / 1e9:g} s",
            field="max_age",
            bound=f"<= {max_age_ns / 1e9:g}",
            unit="s",
        ) from error
    if isinstance(sighting, bool):
        session.require_daemon()  # raises: it was closed
        raise AssertionError("a closed client has a daemon")
    return sighting


class _News:
    """Waits for the next notice, or for the client to be closed."""

    def __init__(self, session: Session, place: int, timeout_ns: int | None) -> None:
        self._session = session
        self._place = place
        self.deadline_ns = FOREVER_NS if timeout_ns is None else session.transport.now_ns() + timeout_ns

    def poll(self, _: int) -> tuple[protocol.Notice, int, int] | bool | None:
        self._session.require_own_process()
        found = self._session.news.read(self._place)
        if found is None and self._session.is_closed:
            return False
        return found

    def expire(self) -> GatewayError:
        try:
            self._session.require_daemon()
        except GatewayError as gone:
            return gone
        return failure(Code.TIMEOUT, "no notice came")


class Feed:
    """One reader of the notices, with a place of its own among them.

    Args:
        session: Of this client.
        timeout_ns: Silence after which it ends, until it is read again [ns]; None for never.
        has_backlog: Whether it begins with what is kept since `connect()`, or with what comes from now on.

    Attributes:
        lost: Notices that this reader did not get: lost on the way, or pushed out because it was too slow.
    """

    def __init__(self, session: Session, timeout_ns: int | None, has_backlog: bool) -> None:
        self.lost = 0
        self._session = session
        self._timeout_ns = timeout_ns
        self._place = 0 if has_backlog else session.news.end

    def _next(self) -> Procedure[protocol.Notice | None]:
        """Return the next notice; None when there was silence for too long, or the client was closed.

        Raises:
            Disconnected: There was silence for lack of a daemon.
        """
        try:
            found: tuple[protocol.Notice, int, int] | bool = yield _News(self._session, self._place, self._timeout_ns)
        except TimeoutError:
            return None
        if isinstance(found, bool):
            return None
        notice, self._place, missing = found
        self.lost += missing
        return notice


def pause(until_ns: int) -> Procedure[None]:
    """Let time pass until an instant of the transport's clock [ns]."""
    yield Pause(until_ns)
