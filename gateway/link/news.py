"""What zenoh's callbacks say about the transport to the robot's router, and what the loop is told of it.

Who has taken a LinkDown before a LinkUp has seen every outage, however short; another router id means another robot
process. One thread notes at a time (zenoh's, or the link's own at the end of a session), one takes (the loop's).
"""

from __future__ import annotations

from collections import deque

from gateway.core.messages.events import (
    Event,
    LinkDown,
    LinkUp,
    RobotsAnnounced,
    RouteObserved,
    SampleArrived,
    SampleRefused,
)
from gateway.core.messages.sightings import Sighting

__all__ = ["TransportNews", "time_of"]


class TransportNews:
    """Transports that opened and closed.

    Attributes:
        router_zid: Zenoh id of the router at the other end, as was noted last; empty without a transport.
        up_since_ns: When the last transport opened [ns].
    """

    def __init__(self) -> None:
        self.router_zid = ""
        self.up_since_ns = 0
        self._news: deque[tuple[str, bool, int]] = deque()  # appended there, taken here, each one atomic operation
        self._told_zid = ""

    def note(self, zid: str, is_open: bool, at_ns: int) -> None:
        """Note that a transport opened or closed."""
        if is_open:
            self.up_since_ns = at_ns
            self.router_zid = zid
        elif self.router_zid == zid:
            self.router_zid = ""
        self._news.append((zid, is_open, at_ns))

    def take(self, own_zid: str) -> list[Event]:
        """Return what has been noted since the last call."""
        events: list[Event] = []
        while self._news:
            events += self._events(*self._news.popleft(), own_zid)
        return events

    def _events(self, zid: str, is_open: bool, at_ns: int, own_zid: str) -> list[Event]:
        before = self._told_zid
        if is_open:
            self._told_zid = zid
            if before == zid:
                return []
            gone: list[Event] = [LinkDown(at_ns=at_ns)] if before else []
            return [*gone, LinkUp(router_zid=zid, at_ns=at_ns, own_zid=own_zid)]
        if before != zid:
            return []
        self._told_zid = ""
        return [LinkDown(at_ns=at_ns)]


def time_of(event: Event) -> int:
    """Return when something of the robot plane happened [ns].

    Raises:
        TypeError: It is not of the robot plane.
    """
    if isinstance(event, (SampleArrived, SampleRefused)):
        return event.received_ns
    if isinstance(event, (LinkUp, LinkDown, RouteObserved, RobotsAnnounced, Sighting)):
        return event.at_ns
    raise TypeError(f"the robot plane makes no {type(event).__name__}")
