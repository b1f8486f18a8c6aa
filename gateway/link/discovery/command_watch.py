"""The robot's command topics: did the robot's bridge stop listening to them while everything else looks healthy.

Pure: tokens and `now_ns` in, an observation out. A robot's node that was killed and started again before its DDS lease ran
out is forgotten by the bridge when that lease ends, although the new node lives: all its routes go (wire.md 3.1 b2). Our
own tokens keep the state coming, so that nothing but the missing tokens tells: what is sent to the robot is lost.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping

from gateway.core.messages.events import RouteObserved
from gateway.errors import Code

__all__ = ["LOST_AFTER_NS", "CommandWatch"]

LOST_AFTER_NS = 500_000_000
"""A token that is away for a shorter time is no loss: a node may just be starting anew [ns]."""


class CommandWatch:
    """Watches whether the robot listens to what we may send."""

    def __init__(self) -> None:
        self._listeners: dict[str, set[str]] = {}
        """Per topic the bridges of the robot that have listened to it on this transport."""
        self._missing_since_ns: dict[str, int] = {}
        self._lost: tuple[str, ...] = ()

    def forget(self) -> None:
        """Another transport, perhaps another robot."""
        self._listeners, self._missing_since_ns, self._lost = {}, {}, ()

    def observe(
        self, now_ns: int, listening: Mapping[str, Collection[str]], robot_zids: Collection[str]
    ) -> RouteObserved | None:
        """Take in the tokens; return what has changed, if anything."""
        for topic, zids in listening.items():
            found = {zid for zid in zids if zid in robot_zids}
            if found:
                self._listeners.setdefault(topic, set()).update(found)
        missing = {topic for topic, zids in self._listeners.items() if zids.isdisjoint(listening.get(topic, ()))}
        self._missing_since_ns = {topic: self._missing_since_ns.get(topic, now_ns) for topic in sorted(missing)}
        lost = tuple(topic for topic, since_ns in self._missing_since_ns.items() if now_ns - since_ns >= LOST_AFTER_NS)
        if lost == self._lost:
            return None
        before, self._lost = self._lost, lost
        if set(lost) <= set(before):
            back = ", ".join(sorted(set(before) - set(lost)))
            return RouteObserved(topic=before[0], code=None, message=f"the robot listens again to {back}", at_ns=now_ns)
        message = (
            f"nobody on the robot listens any more to {', '.join(lost)}: what is sent there is lost. "
            "Restart the robot's node in an orderly way, or the robot's bridge"
        )
        return RouteObserved(topic=lost[0], code=Code.ROUTE_LOST, message=message, at_ns=now_ns)
