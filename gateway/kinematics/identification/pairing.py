"""Pairing: joint angles and end-effector poses of one arm, brought to the same instant.

The pose of the robot has no stamp of its own (manual §4.8), so both are taken by when they arrived, on one clock. They come
at their own times: the joints are interpolated to the time of the pose, between the sample before and the one after it, if
these are near enough to each other. A pose that finds no such neighbours is dropped; nothing is extrapolated.

Virtual time: stamps are integers, and whatever clock they are of is the caller's affair.
"""

from __future__ import annotations

from collections import deque
from typing import NamedTuple

from msgspec import Struct

from gateway.values import ARM_DOF, EePose, Vector, require_finite

__all__ = ["BOUND_NS", "Pair", "Pairing"]

BOUND_NS = 50_000_000
"""Longest time between two samples of the joints, between which a pose is still paired [ns]."""

MOST_WAITING = 100
"""Poses that wait for the joints to catch up; older ones are dropped."""
HISTORY = 16
"""Samples of the joints that are kept for poses that come late."""


class Pair(Struct, frozen=True, kw_only=True):
    """Joints and pose of an arm at one instant.

    Attributes:
        stamp_ns: When [ns].
        q_rad: Reported joint angles, shape (7,) [rad].
        pose: Measured pose of the end effector in the shoulder frame.

    Raises:
        ValueRefused: Not seven finite joints.
    """

    stamp_ns: int
    q_rad: Vector
    pose: EePose

    def __post_init__(self) -> None:
        """Refuse anything but seven finite joints."""
        require_finite("q_rad", self.q_rad, ARM_DOF)


class Joints(NamedTuple):
    """A sample of the joints."""

    stamp_ns: int
    q_rad: Vector


class Pairing:
    """Brings the two streams of one arm together.

    Args:
        bound_ns: Longest time between the two samples of the joints around a pose [ns].
    """

    def __init__(self, bound_ns: int = BOUND_NS) -> None:
        self._bound_ns = bound_ns
        self._joints: deque[Joints] = deque(maxlen=HISTORY)
        self._waiting: deque[tuple[int, EePose]] = deque()
        self._newest_pose_ns: int | None = None

    def joints(self, q_rad: Vector, stamp_ns: int) -> tuple[Pair, ...]:
        """Take joints; return the pairs that they complete.

        A stamp that was there already is skipped. One that goes back begins anew: the clock was another one.

        Args:
            q_rad: Reported joint angles, shape (7,) [rad].
            stamp_ns: When they arrived [ns].

        Raises:
            ValueRefused: Not seven finite joints.
        """
        require_finite("q_rad", q_rad, ARM_DOF)
        if self._joints and stamp_ns == self._joints[-1].stamp_ns:
            return ()
        if self._joints and stamp_ns < self._joints[-1].stamp_ns:
            self._waiting.clear()
            self._joints.clear()
            self._newest_pose_ns = None
        self._joints.append(Joints(stamp_ns, q_rad))
        return self._completed()

    def pose(self, pose: EePose, stamp_ns: int) -> tuple[Pair, ...]:
        """Take a pose; return the pair it makes, if the joints of its time are there already.

        One that is not newer than the one before is skipped.

        Args:
            pose: Of the end effector in the shoulder frame.
            stamp_ns: When it arrived [ns].
        """
        if self._newest_pose_ns is not None and stamp_ns <= self._newest_pose_ns:
            return ()
        self._newest_pose_ns = stamp_ns
        if len(self._waiting) == MOST_WAITING:
            self._waiting.popleft()
        self._waiting.append((stamp_ns, pose))
        return self._completed()

    def _completed(self) -> tuple[Pair, ...]:
        pairs: list[Pair] = []
        while self._waiting and self._joints and self._waiting[0][0] <= self._joints[-1].stamp_ns:
            stamp_ns, pose = self._waiting.popleft()
            q_rad = self._joints_at(stamp_ns)
            if q_rad is not None:
                pairs.append(Pair(stamp_ns=stamp_ns, q_rad=q_rad, pose=pose))
        return tuple(pairs)

    def _joints_at(self, stamp_ns: int) -> Vector | None:
        """Return the joints at a time up to the newest sample's; None where their samples are too far apart."""
        after = self._joints[-1]
        for before in reversed(self._joints):
            if before.stamp_ns == stamp_ns:
                return before.q_rad
            if before.stamp_ns < stamp_ns:
                between_ns = after.stamp_ns - before.stamp_ns
                if between_ns > self._bound_ns:
                    return None
                share = (stamp_ns - before.stamp_ns) / between_ns
                return tuple([a + share * (b - a) for a, b in zip(before.q_rad, after.q_rad, strict=True)])
            after = before
        return None
