"""The FSM heartbeat: 1.0 while armed, 0.0 until PAUSE is seen, else silence (manual §4.7, 20 Hz).

It also keeps the one fact that survives a loss: whether a 0.0 is *owed*, because a 1.0 of ours was out and no FSM 0 was
seen since.
"""

from __future__ import annotations

from enum import Enum

from gateway.core.messages.outputs import Frame, FrameKind
from gateway.core.streams.grid import Grid
from gateway.core.streams.stream import SentLog
from gateway.robot.topics import FSM_ENABLE, TOPICS

__all__ = ["LAST_WORD_NS", "Beat", "HeartbeatStream"]

SETTLE_NS = 150_000_000
"""An FSM 0 counts as an answer to our last heartbeat only when it arrives this much later [ns]: `/fsm_state` comes at
20 Hz, so a sample that was already under way may still tell of the time before."""

LAST_WORD_NS = 300_000_000
"""How long the last word to a robot that is not heard is repeated [ns]."""
LAST_WORD_HZ = 100.0
"""And how often: a bridge keeps the last ten samples that a dead node has not taken (§4.1.1), none of which may be a 1.0."""


class Beat(str, Enum):
    """What the heartbeat stream is doing."""

    SILENT = "silent"
    ONE = "one"
    ZERO = "zero"


class HeartbeatStream:
    """Sends 1.0 or 0.0 at 20 Hz.

    Args:
        zero_timeout_ns: 0.0 is repeated at most this long [ns].
    """

    topic = FSM_ENABLE

    def __init__(self, zero_timeout_ns: int) -> None:
        self.log = SentLog()
        self.beat = Beat.SILENT
        self.is_owed = False
        """Whether a 1.0 of ours was out and no FSM 0 was seen since."""
        self.last_one_ns: int | None = None
        """When the last 1.0 left [ns]."""
        self.gave_up_at_ns: int | None = None
        """When the last repetition of 0.0 ended without FSM 0 [ns]; None when none did since the last good one."""
        self._steady, self._quick = Grid(TOPICS[self.topic].rate_hz), Grid(LAST_WORD_HZ)
        self._zero_timeout_ns = zero_timeout_ns
        self._zero_since_ns = 0
        self._is_once = False
        self._is_brief = False
        self._is_estop = False
        self._is_new = False

    @property
    def running(self) -> bool:
        """Whether frames are being sent."""
        return self.beat is not Beat.SILENT

    @property
    def is_ending(self) -> bool:
        """Whether 0.0 is being repeated."""
        return self.beat is Beat.ZERO

    @property
    def is_last_word(self) -> bool:
        """Whether that is but the last word to a robot that is not heard."""
        return self.is_ending and self._is_brief

    @property
    def is_estop(self) -> bool:
        """Whether the 0.0 being repeated is an e-stop's: it goes on even in VR mode and beside other writers."""
        return self._is_estop

    @property
    def _grid(self) -> Grid:
        return self._quick if self.is_last_word else self._steady

    def ones(self, now_ns: int) -> None:
        """Send 1.0, the first at once. Ends a repetition of 0.0."""
        if self.beat is not Beat.ONE:
            self.beat = Beat.ONE
            self._is_estop = False
            self._grid.start(now_ns)

    def zeros(self, now_ns: int, *, is_estop: bool = False) -> None:
        """Send 0.0, the first at once, then at 20 Hz until FSM 0 is seen or the time is over."""
        self._is_estop = self._is_estop or is_estop
        if self.beat is Beat.ZERO and not self._is_once and not self._is_brief and not is_estop:
            return
        self.beat = Beat.ZERO
        self._is_new, self._is_once, self._is_brief, self._zero_since_ns = True, False, False, now_ns
        self._grid.start(now_ns)

    def last_word(self, now_ns: int) -> None:
        """Send 0.0 for a moment to a robot that is not heard. It stays owed; a repetition that is under way goes on."""
        if self.beat is not Beat.ZERO:
            self.zeros(now_ns)
            self._is_brief = True
            self._quick.start(now_ns)

    def zero_once(self, now_ns: int) -> None:
        """Send one 0.0, and only if it is owed: somebody else commands the robot now. An e-stop's repetition goes on."""
        if self._is_estop and self.beat is Beat.ZERO:
            return
        if not self.is_owed:
            self.silence()
            return
        self.beat = Beat.ZERO
        self._is_new, self._is_once, self._is_brief, self._zero_since_ns = True, True, False, now_ns
        self._grid.start(now_ns)

    def silence(self) -> None:
        """Send nothing any more."""
        self.beat = Beat.SILENT
        self._is_new = self._is_estop = False
        self.log.end()

    def fsm_zero_seen(self, received_ns: int) -> None:
        """An FSM 0 sample arrived: it settles what is owed and ends a repetition, if it can be an answer to us."""
        reference_ns = SETTLE_NS + (self.last_one_ns if self.last_one_ns is not None else -SETTLE_NS)
        if self.beat is Beat.ZERO:
            reference_ns = max(reference_ns, self._zero_since_ns)
        if self.beat is not Beat.ONE and not self._is_new and received_ns > reference_ns:
            self.is_owed, self.gave_up_at_ns = False, None
            if self.beat is Beat.ZERO:
                self.silence()

    def next_due_ns(self) -> int | None:
        """Return the next instant of the grid [ns]; None when silent."""
        return self._grid.next_ns() if self.running else None

    def frame(self, now_ns: int) -> Frame | None:
        """Return the heartbeat that is due now, or None."""
        if self.beat is Beat.ZERO and not self._is_new:
            self._end_zeros(now_ns)
        due_ns = self._grid.due(now_ns) if self.running else None
        if due_ns is None:
            return None
        self._is_new = False
        if self.beat is Beat.ONE:
            self.is_owed, self.last_one_ns = True, now_ns
            return Frame(topic=self.topic, values=(1.0,), kind=FrameKind.BEAT, epoch=0, due_ns=due_ns)
        self.is_owed = self.is_owed and not self._is_once
        return Frame(topic=self.topic, values=(0.0,), kind=FrameKind.STOP, epoch=0, due_ns=due_ns)

    def _end_zeros(self, now_ns: int) -> None:
        """Go silent when the single 0.0 or the last word has left, or when the repeated one was not answered in time."""
        if self._is_once or (self._is_brief and now_ns - self._zero_since_ns >= LAST_WORD_NS):
            self.silence()
        elif now_ns - self._zero_since_ns > self._zero_timeout_ns:
            self.gave_up_at_ns = now_ns
            self.silence()
