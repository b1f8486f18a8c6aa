"""Records: what comes is queued by zenoh's threads, and written, every quarter of a second, by the one that calls `step`.

    tap, gateway tap -> queue -> bag writer -> disk, twice a second

Rules
    * Nothing waits for the disk but this process's own queue, which is bounded: what does not fit is counted and told.
    * A message is written as it came. Its log time is its arrival by the wall clock of the recording's begin, kept by the
      monotonic one: a step of the host's clock does not show. Its publish time is the stamp of its header, by the robot's
      clock; where it has none, the arrival again. How far the two clocks are apart is noted in the bag.
    * A recording does not begin on a disk that is nearly full, and ends well on one that becomes so.

Knows no terminal. Times are handed in by whoever steps it.
"""

from __future__ import annotations

import json
import shutil
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Final

from msgspec import Struct

from cdr_types import CdrError, encode, peek_stamp
from cdr_types.messages.std_msgs import String
from gateway.errors import Code, failure
from gateway.recording.bag_writer import OFFSET, BagWriter
from gateway.recording.topics import EPISODES, NEVER_NS, RecordedTopic, as_alias, gap_ns

__all__ = ["BEGIN_FREE_BYTES", "LEAST_FREE_BYTES", "Progress", "Recorder"]

BEGIN_FREE_BYTES: Final = 2 * 1024**3
"""A recording does not begin with less free on its disk: more than an hour of a robot without video."""
LEAST_FREE_BYTES: Final = 512 * 1024**2
"""It ends before less is left: the host needs some."""
MOST_WAITING: Final = 200_000
"""Messages that may wait for the disk: two minutes of a robot's whole state, some 100 MB."""
FLUSH_NS: Final = 500_000_000
"""What was recorded is on the disk after so long [ns]."""
LOOK_AT_DISK_NS: Final = 1_000_000_000


class Heard(Struct):
    """What came of one topic: newest arrival, gaps and the longest interval [ns], smallest arrival minus stamp [ns]."""

    is_stamped: bool
    gap_ns: int
    last_ns: int = 0
    gaps: int = 0
    worst_ns: int = 0
    offset_ns: int = NEVER_NS


class Progress(Struct, frozen=True, kw_only=True):
    """How a recording is.

    Attributes:
        messages: Written.
        size_bytes: Of its file.
        lost: Messages that did not fit into the queue.
        gaps: Per topic, how often it was missing, and for how long at most [ns]; those without are left out.
        silent: States of which nothing came at all.
        free_bytes: On the disk.
        error: Why it cannot go on; empty.
    """

    messages: int
    size_bytes: int
    lost: int
    gaps: Mapping[str, tuple[int, int]]
    silent: tuple[str, ...]
    free_bytes: int
    error: str


class Recorder:
    """One recording. `take` and `tell` may be called by any thread, everything else by one.

    Args:
        folder: Of the bag.
        topics: Of the robot and of the gateway, see `recorded_topics`.
        facts: About the recording, noted in the bag: robot, task, ...
        wall_ns: Wall clock [ns].
        clock: Monotonic clock [ns].
        free_bytes: Free room of a folder's disk.

    Raises:
        Rejected: BAD_REQUEST, see `BagWriter`; the disk has too little room.
    """

    def __init__(
        self,
        folder: Path,
        topics: Sequence[RecordedTopic],
        facts: Mapping[str, str],
        *,
        wall_ns: Callable[[], int] = time.time_ns,
        clock: Callable[[], int] = time.monotonic_ns,
        free_bytes: Callable[[Path], int] = lambda folder: shutil.disk_usage(folder).free,
    ) -> None:
        self._free_bytes = free_bytes
        nearest = next(parent for parent in (folder.resolve(), *folder.resolve().parents) if parent.exists())
        free = free_bytes(nearest)
        if free < BEGIN_FREE_BYTES:
            message = (
                f"{folder}: {free / 1e9:.1f} GB are free there, {BEGIN_FREE_BYTES / 1e9:.1f} GB are needed to begin"
            )
            raise failure(Code.BAD_REQUEST, message, field="out", hint="free some, or record elsewhere with --out")
        self._bag = BagWriter(folder, topics)
        self._topics = topics
        self._numbers = {topic.name: number for number, topic in enumerate(topics)}
        self._aliases = {self._numbers[topic.alias_of]: n for n, topic in enumerate(topics) if topic.alias_of}
        self._heard = [Heard(topic.is_stamped, gap_ns(topic.rate_hz)) for topic in topics]
        self._clock = clock
        self._anchor_ns = wall_ns() - clock()
        self._queue: deque[tuple[int, int, bytes]] = deque()
        self._lost = 0
        self._begun_ns = self._flushed_ns = clock()
        self._looked_ns = 0
        self._free = free
        self._error = ""
        begun = {"begun_ns": str(self._begun_ns + self._anchor_ns), "wall_minus_monotonic_ns": str(self._anchor_ns)}
        self._bag.note(begun | dict(facts))
        self._bag.flush()

    # ------------------------------------------------------------------------------------------------ any thread

    def take(self, number: int, received_ns: int, payload: bytes) -> None:
        """Take a message; never waits.

        Args:
            number: Which topic.
            received_ns: Monotonic arrival [ns].
            payload: As it came.
        """
        if len(self._queue) < MOST_WAITING:
            self._queue.append((number, received_ns, payload))
        else:
            self._lost += 1

    def tell(self, topic: str, facts: Mapping[str, object]) -> bool:
        """Take what a gateway or a user says, as JSON; never waits.

        Args:
            topic: `EVENTS`, `GATEWAY`, `CONTACT`, `POLICY` or `EPISODES`; what is said of an episode gets its time here.
            facts: What is said.

        Returns:
            Whether there was room for it.
        """
        now_ns = self._clock()
        if topic == EPISODES:
            facts = {**facts, "at_ns": now_ns + self._anchor_ns}
        is_room = len(self._queue) < MOST_WAITING
        self.take(self._numbers[topic], now_ns, encode(String(data=json.dumps(facts, ensure_ascii=False))))
        return is_room

    # ------------------------------------------------------------------------------------------------ the recording's own

    def step(self, now_ns: int) -> Progress:
        """Write what has come; return how the recording is. It is over when that has an error.

        Args:
            now_ns: Monotonic time [ns].
        """
        if not self._error:
            try:
                self._write(len(self._queue))
                if now_ns - self._flushed_ns >= FLUSH_NS:
                    self._bag.flush()
                    self._flushed_ns = now_ns
                if now_ns - self._looked_ns >= LOOK_AT_DISK_NS:
                    self._looked_ns, self._free = now_ns, self._free_bytes(self._bag.folder)
                if self._free < LEAST_FREE_BYTES:
                    self._error = f"the disk is nearly full: {self._free / 1e6:.0f} MB are left"
            except OSError as error:
                self._error = f"the disk does not take it: {error.strerror or error}"
        return self.progress(now_ns)

    def progress(self, now_ns: int) -> Progress:
        """Return how the recording is, without writing."""
        gaps, silent = {}, []
        for topic, heard in zip(self._topics, self._heard, strict=True):
            if topic.rate_hz and not heard.last_ns:
                silent.append(topic.name)
            elif topic.rate_hz:
                running_ns = now_ns - heard.last_ns
                is_missing = running_ns > heard.gap_ns
                if heard.gaps or is_missing:
                    gaps[topic.name] = heard.gaps + is_missing, max(heard.worst_ns, running_ns if is_missing else 0)
        return Progress(
            messages=sum(
                self._bag.counts[number] for number in self._numbers.values() if not self._topics[number].alias_of
            ),
            size_bytes=self._bag.size_bytes,
            lost=self._lost,
            gaps=gaps,
            silent=tuple(silent),
            free_bytes=self._free,
            error=self._error,
        )

    def finish(self) -> Path | None:
        """Write what still waits, and complete the bag; return its file, or None where the disk did not let it."""
        try:
            self._write(len(self._queue))
            offsets = {
                OFFSET + topic.name: str(heard.offset_ns)
                for topic, heard in zip(self._topics, self._heard, strict=True)
                if heard.offset_ns != NEVER_NS
            }
            self._bag.note({"lost": str(self._lost), "error": self._error, **offsets})
            return self._bag.finish()
        except OSError as error:
            self._error = self._error or f"the disk does not take it: {error.strerror or error}"
            self._bag.abandon()
            return None

    def abandon(self) -> None:
        """End at once, and leave the file to be recovered: nobody knows what is wrong."""
        self._bag.abandon()

    def discard(self) -> None:
        """Take the bag away again: nothing came that is worth one."""
        self._bag.discard()

    def _write(self, count: int) -> None:
        anchor_ns, add, take, hearings = self._anchor_ns, self._bag.add, self._queue.popleft, self._heard
        for _ in range(count):
            number, received_ns, payload = take()
            heard = hearings[number]
            log_ns = publish_ns = received_ns + anchor_ns
            if heard.is_stamped:
                try:
                    stamp_ns = peek_stamp(payload)
                    publish_ns = stamp_ns if stamp_ns > 0 else log_ns  # no bag holds a time before 1970
                except CdrError:  # malformed: it is recorded all the same
                    pass
                offset_ns = log_ns - publish_ns
                if offset_ns < heard.offset_ns and offset_ns:
                    heard.offset_ns = offset_ns
            if heard.last_ns:
                interval_ns = received_ns - heard.last_ns
                if interval_ns > heard.worst_ns:
                    heard.worst_ns = interval_ns
                if interval_ns > heard.gap_ns:
                    heard.gaps += 1
            heard.last_ns = received_ns
            add(number, log_ns, publish_ns, payload)
            if number in self._aliases and (again := as_alias(self._topics[number], payload)) is not None:
                add(self._aliases[number], log_ns, publish_ns, again)
