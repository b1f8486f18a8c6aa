"""Watching without asking: the next snapshot, the next notice, the next instant. Procedures like those of `procedures`."""

from __future__ import annotations

import math

from gateway.api import protocol
from gateway.client.procedures import Procedure
from gateway.client.session import Session, Sighting
from gateway.client.waits import NextNotice, Pause, Seen
from gateway.errors import Code, Refusal, to_exception

__all__ = ["Pace", "next_notice", "next_sighting", "pause"]


def next_sighting(session: Session, after_seq: int, not_before_ns: int, timeout_ns: int) -> Procedure[Sighting]:
    """Return the next snapshot with a greater number, not before an instant."""
    sighting: Sighting = yield Seen(
        session,
        lambda seen: seen,
        timeout_ns,
        "the next snapshot",
        after_seq=after_seq,
        not_before_ns=not_before_ns,
    )
    return sighting


class Pace:
    """Takes new snapshots at a highest rate.

    Args:
        session: Of this client.
        max_rate: At most so many a second [Hz]; None for as they come.
        timeout_ns: Longest wait for the next one [ns].
    """

    def __init__(self, session: Session, max_rate: float | None, timeout_ns: int) -> None:
        if max_rate is not None and not (math.isfinite(max_rate) and max_rate > 0):
            raise to_exception(
                Refusal(
                    code=Code.OUT_OF_RANGE,
                    message=f"max_rate is {max_rate:g} Hz, a positive rate is needed",
                    field="max_rate",
                    value=f"{max_rate:g}",
                    bound="> 0",
                    unit="Hz",
                )
            )
        self._session = session
        self._period_ns = 0 if max_rate is None else round(1e9 / max_rate)
        self._timeout_ns = timeout_ns
        self._seq = 0
        self._due_ns = session.transport.now_ns()

    def next(self) -> Procedure[Sighting]:
        """Return the next snapshot, not before it is due."""
        sighting = yield from next_sighting(self._session, self._seq, self._due_ns, self._timeout_ns)
        self._seq = sighting.view.seq
        self._due_ns = max(self._due_ns + self._period_ns, self._session.transport.now_ns() - self._period_ns)
        return sighting


def next_notice(session: Session, timeout_ns: int) -> Procedure[protocol.Notice]:
    """Return the oldest notice that was not read; GatewayTimeout when none comes."""
    notice: protocol.Notice = yield NextNotice(session, timeout_ns)
    return notice


def pause(until_ns: int) -> Procedure[None]:
    """Let time pass until an instant of the transport's clock [ns]."""
    yield Pause(until_ns)
