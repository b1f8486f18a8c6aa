"""One state topic's route through the robot's bridge: is it dead, lost or alive, and when may it be revived.

Pure: ages, evidence and `now_ns` in, an observation or a wish out (BEHAVIOUR, "The bridge misbehaves"; wire.md 3.1).

```
samples come                                   alive
silent, nobody announces it for half a second  ROUTE_LOST   only a restart of the robot's node or bridge helps
silent, never there since the transport opened no route: a part that is switched off has none (§2.7.1)
silent, announced, admin shows no DDS reader   ROUTE_DEAD   re-declare our subscription
silent, announced, reader there                alive: the robot's node itself is silent
silent, announced, admin space unreadable      unknown: nothing is done, nothing is said
```

Re-declaring too often degrades the bridge (wire.md 3.1 g): attempts back off and never exceed 4 in a minute.
"""

from __future__ import annotations

from collections import deque

from msgspec import Struct

from gateway.core.messages.events import RouteObserved
from gateway.errors import Code
from gateway.robot.topics import Topic

__all__ = ["FIRST_DATA_NS", "MAX_REVIVALS", "REVIVAL_WINDOW_NS", "Evidence", "RouteWatch", "silence_ns"]

MS = 1_000_000
S = 1_000_000_000

MIN_SILENCE_NS = 500 * MS
"""Silence of a fast topic after which its route is looked at."""
SILENT_PERIODS = 3
"""Slow topics get this many of their periods."""
FIRST_DATA_NS = 2 * S
"""Time that a fresh connection gets to deliver the first sample (wire.md 2.2)."""
FIRST_DELAY_NS = 2 * S
DELAY_FACTOR = 3
MAX_DELAY_NS = 60 * S
"""Attempts at 0, 2, 8, 26 s, then every minute."""
IDLE_DELAY_NS = 5 * S
"""A topic whose route is not dead is looked up again after this."""
GONE_NS = 500 * MS
"""A topic is not announced for this long, on one transport, before its route is called lost: the end of a transport takes
all tokens away a moment before it is told, and the next one brings them after it is."""
MAX_REVIVALS = 4
"""At most this many re-declarations of one topic ..."""
REVIVAL_WINDOW_NS = 60 * S
"""... in this time."""


class Evidence(Struct, frozen=True, kw_only=True):
    """What the admin space says about a topic's route.

    Attributes:
        has_reader: Whether the bridge holds a DDS reader for it; None when nothing could be read.
        others: Who else is connected and may subscribe, for the remedy: zenoh ids, with addresses where they are known.
    """

    has_reader: bool | None
    others: tuple[str, ...] = ()


class RouteWatch:
    """Watches one topic."""

    def __init__(self, topic: Topic) -> None:
        self._topic = topic
        self._silence_ns = silence_ns(topic.rate_hz)
        self.code: Code | None = None
        """ROUTE_DEAD, ROUTE_LOST, or None while nothing is known to be wrong."""
        self._told: Code | None = None
        self._gone: tuple[int, int] | None = None  # since when not announced, on the transport of when
        self._there_ns: int | None = None  # the transport on which it was announced last
        self._attempts = 0
        self._next_look_ns = 0
        self._revivals: deque[int] = deque(maxlen=MAX_REVIVALS)

    def is_silent(self, now_ns: int, up_since_ns: int, newest_ns: int | None) -> bool:
        """Return whether samples should have come and did not.

        `newest_ns` is None before the first sample.
        """
        if newest_ns is None or newest_ns < up_since_ns:
            return now_ns - up_since_ns > max(FIRST_DATA_NS, self._silence_ns)
        return now_ns - newest_ns > self._silence_ns

    def observe(
        self, now_ns: int, up_since_ns: int, newest_ns: int | None, *, is_announced: bool
    ) -> RouteObserved | None:
        """Take in the ages and the tokens; return what has changed, if anything.

        `newest_ns` is None before the first sample.
        """
        name = self._topic.name
        if is_announced:
            self._gone, self._there_ns = None, up_since_ns
        elif self._gone is None or self._gone[1] != up_since_ns:
            self._gone = now_ns, up_since_ns
        if not self.is_silent(now_ns, up_since_ns, newest_ns):
            if newest_ns is None or newest_ns < up_since_ns:
                return None  # too early to say
            self._attempts = 0
            self._next_look_ns = 0
            return self._change(None, f"{name}: samples come again", now_ns)
        if self._gone is None or now_ns - self._gone[0] < GONE_NS:
            return None  # the admin space decides, or it is too early to say
        if self._there_ns != up_since_ns and (newest_ns is None or newest_ns < up_since_ns):
            self.code = None  # what was told of an earlier transport stands until something comes
            return None
        return self._change(
            Code.ROUTE_LOST,
            f"{name} is silent and nobody announces it: the robot's node is away. "
            "Restart that node in an orderly way, or the robot's bridge",
            now_ns,
        )

    def wants_evidence(self, now_ns: int) -> bool:
        """Return whether a silent, announced topic should be looked up in the admin space now."""
        return now_ns >= self._next_look_ns

    def judge(self, now_ns: int, evidence: Evidence) -> tuple[RouteObserved | None, bool]:
        """Hear the admin space of a silent, announced topic; return what has changed, and whether to re-declare it now."""
        name = self._topic.name
        self._next_look_ns = now_ns + IDLE_DELAY_NS
        if evidence.has_reader is None:
            return None, False
        if evidence.has_reader:
            return self._change(None, f"{name}: the route stands, the robot's node is silent", now_ns), False
        self._next_look_ns = now_ns + min(FIRST_DELAY_NS * DELAY_FACTOR**self._attempts, MAX_DELAY_NS)
        may_revive = len(self._revivals) < MAX_REVIVALS or now_ns - self._revivals[0] >= REVIVAL_WINDOW_NS
        if may_revive:
            self._revivals.append(now_ns)
            self._attempts += 1
        return self._change(Code.ROUTE_DEAD, f"{name}: {_remedy(evidence)}", now_ns), may_revive

    def _change(self, code: Code | None, message: str, now_ns: int) -> RouteObserved | None:
        self.code = code
        if code is self._told:
            return None
        self._told = code
        return RouteObserved(topic=self._topic.name, code=code, message=message, at_ns=now_ns)


def silence_ns(rate_hz: float) -> int:
    """Return how long a topic of this rate [Hz] may be silent [ns]."""
    return max(MIN_SILENCE_NS, int(SILENT_PERIODS * S / rate_hz))


def _remedy(evidence: Evidence) -> str:
    text = "the robot's bridge announces it but has no DDS reader for it; the subscription is declared again"
    if evidence.others:
        return f"{text}. That cannot help while somebody else subscribes, perhaps one of these: {', '.join(evidence.others)}"
    return f"{text}. If that does not help, restart the robot's bridge"
