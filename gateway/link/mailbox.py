"""The newest sample of one topic, from zenoh's threads to the loop.

Any thread puts payloads in, one thread (the loop's) takes the newest out. Rules:

* `put` stamps nothing, decodes nothing, compares nothing: it appends to a deque and returns. What costs time
  (duplicates, gaps, counters) is done by `take`, so that no reader thread of zenoh ever waits for the loop.
* Copies of a sample are skipped before anything is decoded: a real bridge can deliver a sample N times (wire.md 3.1 f).
  A copy is a sample whose stamp is one of the last 4; types without a stamp, and stamps that were never set (zero), are
  never skipped.
* No lock. `deque.append`, `popleft` and `len` are single operations that other threads cannot interleave with, and
  there is one consumer: what `len` has counted cannot be taken by anybody else. Two producers at once (the old and the
  new subscription of a re-declared route) can only swap two neighbours. `newest_ns` is one assignment of an int.
* Bounded: with nobody taking, the oldest payloads are forgotten and the counters become lower bounds.

Knows no zenoh, no clock and nothing of a message but where its stamp is.
"""

from __future__ import annotations

from collections import deque
from typing import Final, NamedTuple

__all__ = ["CAPACITY", "Arrival", "Mailbox"]

CAPACITY = 1024
"""Payloads kept while nobody takes: 5 s of a 200 Hz topic."""

REMEMBERED_STAMPS = 4
"""A copy may come this many distinct samples late."""

STAMP: Final = slice(4, 12)
"""Where the stamp lies in the payload of a type with a header, whichever its byte order: behind the encapsulation
header. Copies are byte-identical, so the raw bytes tell as much as the number would."""
STAMP_BYTES: Final = 8
NEVER_SET: Final = bytes(STAMP_BYTES)


class Arrival(NamedTuple):
    """The newest payload since the last `take`, and what happened on the way.

    Attributes:
        payload: As it came.
        received_ns: Local monotonic arrival [ns].
        samples: Number of samples since the last arrival that was taken, this one included, copies excluded.
        duplicates: Copies skipped in the same time.
        worst_gap_ns: Longest interval between two samples, copies excluded [ns]; 0 when there was no earlier one.
    """

    payload: bytes
    received_ns: int
    samples: int
    duplicates: int
    worst_gap_ns: int


class Mailbox:
    """One topic's mailbox.

    Args:
        is_stamped: Whether the type begins with a header, so that copies can be told from successors.

    Attributes:
        newest_ns: Arrival of the newest payload, copies included, for any thread to read [ns]; None before the first.
    """

    __slots__ = ("_duplicates", "_inbox", "_is_stamped", "_last_ns", "_stamps", "newest_ns")

    def __init__(self, *, is_stamped: bool) -> None:
        self.newest_ns: int | None = None
        self._is_stamped = is_stamped
        self._inbox: deque[tuple[int, bytes]] = deque(maxlen=CAPACITY)
        self._stamps: deque[bytes] = deque(maxlen=REMEMBERED_STAMPS)
        self._last_ns: int | None = None
        self._duplicates = 0

    def put(self, payload: bytes, received_ns: int) -> None:
        """Keep a payload. Any thread, a microsecond.

        Args:
            payload: As it came.
            received_ns: Local monotonic arrival [ns].
        """
        self._inbox.append((received_ns, payload))
        self.newest_ns = received_ns

    def take(self) -> Arrival | None:
        """Return the newest sample since the last call, or None. One thread only.

        Copies alone give None; they are reported with the next sample.
        """
        inbox = self._inbox
        if not inbox:
            return None
        is_stamped, stamps = self._is_stamped, self._stamps
        newest: bytes | None = None
        count = worst_gap_ns = 0
        last_ns = self._last_ns
        # As many as there are now: a flood that comes in meanwhile cannot hold the loop here.
        for _ in range(len(inbox)):
            received_ns, payload = inbox.popleft()
            if is_stamped:
                stamp = payload[STAMP]
                if stamp in stamps:
                    self._duplicates += 1
                    continue
                if stamp != NEVER_SET and len(stamp) == STAMP_BYTES:
                    stamps.append(stamp)
            if last_ns is not None and received_ns - last_ns > worst_gap_ns:
                worst_gap_ns = received_ns - last_ns
            last_ns = received_ns
            newest = payload
            count += 1
        if newest is None or last_ns is None:
            return None
        self._last_ns = last_ns
        duplicates, self._duplicates = self._duplicates, 0
        return Arrival(newest, last_ns, count, duplicates, worst_gap_ns)
