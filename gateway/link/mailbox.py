"""The newest sample of one topic, from zenoh's threads to the loop.

Any thread puts payloads into a `Mailbox`, one thread (the loop's) takes the newest out. A `Tray` is for topics that
decide about nothing, or are looked at often: zenoh keeps the samples, no thread of ours wakes for each of them, and the
loop fetches them when it looks. Of 1,420 samples a second five sevenths cost a process with callbacks 1.5 % of a core
more than one with trays, out of 3.8 %. Rules:

* `put` stamps nothing, decodes nothing, compares nothing: it appends to a deque and returns. What costs time
  (duplicates, gaps, counters) is done by `take`, so that no reader thread of zenoh ever waits for the loop.
* Copies of a sample are skipped before anything is decoded: a real bridge can deliver a sample N times (wire.md 3.1 f).
  A copy is a sample whose stamp is one of the last 4; types without a stamp, and stamps that were never set (zero), are
  never skipped.
* No lock. `deque.append`, `popleft` and `len` are single operations that other threads cannot interleave with, and
  there is one consumer: what `len` has counted cannot be taken by anybody else. Two producers at once (the old and the
  new subscription of a re-declared route) can only swap two neighbours. `newest_ns` is one assignment of an int.
* Bounded: with nobody taking, the oldest payloads are forgotten and the counters become lower bounds.
* A tray knows of a sample only that it came between two looks. It says the earlier one, so that no state ever looks
  younger than it is; a gap is what is sure, or what the number of samples makes of the time between two looks.

Knows no zenoh, no clock and nothing of a message but where its stamp is.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from typing import Final, NamedTuple, Protocol

__all__ = ["CAPACITY", "Arrival", "Kept", "Mailbox", "Tally", "Tray"]

CAPACITY = 1024
"""Payloads kept while nobody takes: 5 s of a 200 Hz topic."""

SKIMMED = 16
"""Samples of a tray that was only skimmed, kept until somebody looks: the newest ones."""

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


class Tally(NamedTuple):
    """What has been taken since the beginning.

    Attributes:
        samples: Copies excluded.
        copies: Copies skipped.
        last_ns: Arrival of the newest sample [ns]; None before the first.
    """

    samples: int = 0
    copies: int = 0
    last_ns: int | None = None


class Bytes(Protocol):
    """A payload where zenoh keeps it."""

    def to_bytes(self) -> bytes:
        """Return a copy."""


class Kept(Protocol):
    """A sample that zenoh keeps."""

    @property
    def payload(self) -> Bytes:
        """Its payload."""


class Mailbox:
    """One topic's mailbox.

    Args:
        is_stamped: Whether the type begins with a header, so that copies can be told from successors.

    Attributes:
        newest_ns: Arrival of the newest payload, copies included, for any thread to read [ns]; None before the first.
        tally: What has been taken, for any thread to read: replaced as a whole.
    """

    __slots__ = ("_duplicates", "_inbox", "_is_stamped", "_last_ns", "_stamps", "newest_ns", "tally")

    def __init__(self, *, is_stamped: bool) -> None:
        self.newest_ns: int | None = None
        self.tally = Tally()
        self._is_stamped = is_stamped
        self._inbox: deque[tuple[int, bytes]] = deque(maxlen=CAPACITY)
        self._stamps: deque[bytes] = deque(maxlen=REMEMBERED_STAMPS)
        self._last_ns: int | None = None
        self._duplicates = 0

    def put(self, payload: bytes, received_ns: int) -> None:
        """Keep a payload. Any thread, a microsecond."""
        self._inbox.append((received_ns, payload))
        self.newest_ns = received_ns

    def take(self) -> Arrival | None:
        """Return the newest sample since the last call, or None. One thread only.

        Copies alone give None; they are reported with the next sample.
        """
        inbox = self._inbox
        if not inbox:
            return None
        newest: bytes | None = None
        count = worst_gap_ns = 0
        last_ns = self._last_ns
        # As many as there are now: a flood that comes in meanwhile cannot hold the loop here.
        for _ in range(len(inbox)):
            received_ns, payload = inbox.popleft()
            if self._is_stamped and self._is_copy(payload):
                continue
            if last_ns is not None and received_ns - last_ns > worst_gap_ns:
                worst_gap_ns = received_ns - last_ns
            last_ns = received_ns
            newest = payload
            count += 1
        if newest is None or last_ns is None:
            return None
        self._last_ns = last_ns
        return Arrival(newest, last_ns, count, self._count(count, last_ns), worst_gap_ns)

    def _count(self, samples: int, last_ns: int) -> int:
        """Count samples that are taken; return the copies skipped since the ones before."""
        duplicates, self._duplicates = self._duplicates, 0
        before = self.tally
        self.tally = Tally(before.samples + samples, before.copies + duplicates, last_ns)
        return duplicates

    def _is_copy(self, payload: bytes) -> bool:
        """Count a copy of one of the last samples, or remember a sample."""
        stamp, stamps = payload[STAMP], self._stamps
        if stamp in stamps:
            self._duplicates += 1
            return True
        if stamp != NEVER_SET and len(stamp) == STAMP_BYTES:
            stamps.append(stamp)
        return False


class Tray(Mailbox):
    """A mailbox that is filled when somebody looks."""

    __slots__ = ("_drain", "_looked_ns", "_seen_ns", "_skimmed", "_skimmed_ns")

    def __init__(self, *, is_stamped: bool) -> None:
        super().__init__(is_stamped=is_stamped)
        self._drain: Callable[[], Sequence[Kept]] = _nothing
        self._looked_ns = 0
        self._seen_ns: int | None = None  # the look that last found a sample
        self._skimmed: Sequence[Kept] = ()
        self._skimmed_ns = 0

    def attach(self, drain: Callable[[], Sequence[Kept]], now_ns: int) -> None:
        """Take samples from there from now on. Any thread.

        Args:
            drain: Returns the samples that wait, oldest first, at most `CAPACITY`; never waits, never raises.
            now_ns: Nothing that it returns came earlier [ns].
        """
        self._drain = drain  # first: a look that comes in between only takes its samples for older
        self._looked_ns = max(now_ns, self._looked_ns)

    def skim(self, now_ns: int) -> None:
        """Note that what waits here came before now, and no more: it is read by the next look. One thread only."""
        since_ns, self._looked_ns = self._looked_ns, now_ns
        kept = self._drain()
        if kept:
            self.newest_ns = self._skimmed_ns = since_ns
            self._skimmed = [*self._skimmed, *kept][-SKIMMED:] if self._skimmed else kept

    def look(self, now_ns: int) -> Arrival | None:
        """Return the newest sample since the last look, or None. One thread only.

        Args:
            now_ns: Local monotonic time, read before the call: what this look finds came earlier, what it leaves came
                later than the last look [ns].
        """
        self.skim(now_ns)
        kept, since_ns = self._skimmed, self._skimmed_ns
        if not kept:
            return None
        self._skimmed = ()
        payloads = self._originals(kept) if self._is_stamped else [kept[-1].payload.to_bytes()]
        count = len(payloads) if self._is_stamped else len(kept)
        if not count:
            return None
        seen_ns, self._seen_ns = self._seen_ns, now_ns
        worst_gap_ns = 0 if seen_ns is None else max(since_ns - seen_ns, (now_ns - since_ns) // count)
        return Arrival(payloads[-1], since_ns, count, self._count(count, since_ns), worst_gap_ns)

    def _originals(self, kept: Sequence[Kept]) -> list[bytes]:
        """Return the payloads without copies, which are counted."""
        payloads = [sample.payload.to_bytes() for sample in kept]
        stamps = [payload[STAMP] for payload in payloads]
        different = {*stamps}
        is_plain = NEVER_SET not in different and min(map(len, stamps)) == STAMP_BYTES
        if is_plain and len(different) == len(stamps) and different.isdisjoint(self._stamps):
            self._stamps.extend(stamps)  # nearly always: no copy among them, and each has its stamp
            return payloads
        return [payload for payload in payloads if not self._is_copy(payload)]


def _nothing() -> Sequence[Kept]:
    return ()
