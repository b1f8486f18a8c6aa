"""Does an arm do what its setpoints ask? Judged from both over the last 0.6 s, against noise, lag and standing still.

The robot gives no reasons (manual §4.10, §4.12), so this looks at what is seen: per number of a setpoint (seven joints, or
the parts of a pose), how far the setpoint went and how far the measured value went.

Rules
    * The measured value gets `LAG_NS` to follow: what it did up to now is held against what the setpoint did before that.
      A lagging arm, a reversal or a slow one is therefore no stall.
    * Distances count in *grains*: the smallest step that is more than noise, a unit for each number.
    * A verdict stands until the arm has caught up or the stream ends, whatever the setpoint does meanwhile.

It knows no state, no stream and no clock: whoever looks says when, and drops the history when it means nothing.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence

from msgspec import Struct

from gateway.values import Vector

__all__ = ["JOINT_GRAIN", "POSE_GRAIN", "WINDOW_NS", "Following", "Stall"]

MS = 1_000_000

WINDOW_NS = 600 * MS
"""Setpoints and measured values are compared over this [ns]."""
LAG_NS = 250 * MS
"""An arm may follow this much later [ns]: six times the lag that the robot's own example allows for (manual §6.1)."""

JOINT_GRAIN: Vector = (0.03,) * 7
"""A joint that should have moved this much, and did not, is stuck [rad]."""
POSE_GRAIN: Vector = (0.015, 0.015, 0.015, 0.03, 0.03, 0.03, 0.03)
"""The same for a pose: position [m] and quaternion, shape (7,)."""

STUCK = 0.25
"""A number that went less than this part of what was asked does not follow."""
AWAY = 1.5
"""... once it is so many grains away from its setpoint."""
SLOW = 0.13
"""A setpoint that creeps is judged from this many grains on, once it is far away."""
FAR = 2.0
"""So many grains away from its setpoint is far."""
CAUGHT_UP = 1.0
"""A stuck number that is no further from its setpoint than this many grains has caught up."""
STILL = 0.1
"""What moves less than this many grains stands still; noise is less."""
MOVES = 0.5
"""What went more than this many grains after another number had stopped does follow."""


class Stall(Struct, frozen=True):
    """What does not follow.

    Attributes:
        since_ns: Since when it stands still, as far as it can be seen [ns].
        stuck: Indices of the numbers that do not follow.
        others_follow: Whether others that were asked to move did.
        worst: Index of the stuck number that is furthest from its setpoint, in grains.
        setpoint: Its setpoint now.
        measured: Its measured value now.
    """

    since_ns: int
    stuck: tuple[int, ...]
    others_follow: bool
    worst: int
    setpoint: float
    measured: float

    @property
    def off(self) -> float:
        """How far it is away, in its own unit."""
        return abs(self.setpoint - self.measured)


class Following:
    """Setpoints and measured values of one arm.

    Args:
        grain: Per number, the step that counts.
    """

    def __init__(self, grain: Vector) -> None:
        self._grain = grain
        self._seen: deque[tuple[int, Vector, Vector]] = deque()
        self._stall: Stall | None = None

    def forget(self) -> None:
        """Begin anew: the stream ended, was seeded, or nothing is known of the arm."""
        self._seen.clear()
        self._stall = None

    def look(self, setpoint: Vector, measured: Vector, now_ns: int) -> Stall | None:
        """Take both in and return what does not follow, or None.

        Args:
            setpoint: The last one that was sent, shape (7,).
            measured: What was measured last, shape (7,), in the same units.
            now_ns: Monotonic time [ns]; a few looks come in each `LAG_NS`.
        """
        seen = self._seen
        seen.append((now_ns, setpoint, measured))
        while now_ns - seen[0][0] > WINDOW_NS:
            seen.popleft()
        if self._stall is not None:
            self._stall = self._follow_up(self._stall, setpoint, measured)
        elif setpoint != seen[0][1]:  # it is held most of the time
            self._stall = self._judge(now_ns)
        return self._stall

    def _judge(self, now_ns: int) -> Stall | None:
        seen = self._seen
        asked = _spans([entry[1] for entry in seen if now_ns - entry[0] >= LAG_NS])
        if not any(span > SLOW * grain for span, grain in zip(asked, self._grain, strict=False)):
            return None  # nothing was asked for: most of the time
        went = _spans([entry[2] for entry in seen])
        _, setpoint, measured = seen[-1]
        stuck = []
        for n, grain in enumerate(self._grain):
            away = abs(setpoint[n] - measured[n])
            is_asked = asked[n] >= grain and away >= AWAY * grain
            is_creeping = asked[n] >= SLOW * grain and away >= FAR * grain
            if (is_asked or is_creeping) and went[n] < STUCK * asked[n]:
                stuck.append(n)
        if not stuck:
            return None
        since_ns, others_follow = self._since_stop(stuck)
        first = Stall(since_ns, tuple(stuck), others_follow, stuck[0], 0.0, 0.0)
        return self._follow_up(first, setpoint, measured)

    def _since_stop(self, stuck: Sequence[int]) -> tuple[int, bool]:
        """Return when the first stuck number had stopped, and whether other numbers went on after that."""
        first = stuck[0]
        since_ns, _, latest = self._seen[-1]
        after: list[Vector] = []
        for at_ns, _, measured in reversed(self._seen):
            if abs(measured[first] - latest[first]) > STILL * self._grain[first]:
                break
            since_ns = at_ns
            after.append(measured)
        went = zip(_spans(after), self._grain, strict=True)
        return since_ns, any(span >= MOVES * grain for n, (span, grain) in enumerate(went) if n not in stuck)

    def _follow_up(self, stall: Stall, setpoint: Vector, measured: Vector) -> Stall | None:
        """Return the stall as it is now; None when what was stuck has caught up."""
        grains = {n: abs(setpoint[n] - measured[n]) / self._grain[n] for n in stall.stuck}
        worst = max(grains, key=lambda n: grains[n])
        if grains[worst] < CAUGHT_UP:
            return None
        return Stall(stall.since_ns, stall.stuck, stall.others_follow, worst, setpoint[worst], measured[worst])


def _spans(vectors: Sequence[Vector]) -> list[float]:
    """Return how far each number went; nothing when there is nothing to compare."""
    return [max(values) - min(values) for values in zip(*vectors, strict=True)]
