"""Agreement: whether the model of an arm is that of the robot, judged live: FK(joint states) against current_ee_pose.

Per arm the median over some seconds of how far the two are apart, in position and in angle. What moves the robot by the model
may rely on it while the verdict is AGREES, and on nothing else: too few pairs, or none for a while, are UNKNOWN, and that
is no yes. A median does not care for a few late samples of a fast motion.

When a pose was measured is known to some milliseconds only, and at 0.5 m/s each of them is half a millimetre. So one lag of the
poses against the joints is fitted along, over the same seconds, and what it explains is not held against the model: distances
are those that are left. Only what changes with the speed is explained so; at rest nothing is.

Pure and in virtual time: whoever owns one tells it what arrived and when, and asks. The pose has no stamp (manual §4.8), so
arrival is what both streams are paired by (`pairing.py`).
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from enum import Enum
from statistics import median
from typing import NamedTuple

from msgspec import Struct

from gateway.kinematics.identification.pairing import BOUND_NS, Pair, Pairing
from gateway.kinematics.placement import Placement, rows_from_quat, turn_rad
from gateway.kinematics.solving.chain import ArmChain
from gateway.values import EePose, Side, ValueRefused, Vector

__all__ = ["Agreement", "ModelJudge", "Tolerances", "Verdict"]

MOST_PAIRS = 2000
"""Of a window; older ones are let go."""
NEIGHBOURS_NS = 250_000_000
"""Pairs that are further apart tell no speed [ns]."""
STILL = 100.0
"""How much the speed must change before a lag is believed [1/s²]: squares of speeds in tolerances per second, added up. With
this a lag of 20 ms is half believed when what it explains is a fifth of a tolerance."""
FAR = 10.0
"""A residual that is so many tolerances beyond what the longest lag makes is none's."""
STANDING: Vector = (0.0, 0.0, 0.0)


class Agreement(str, Enum):
    """What is known of the model."""

    UNKNOWN = "unknown"
    AGREES = "agrees"
    DIFFERS = "differs"


class Tolerances(Struct, frozen=True, kw_only=True):
    """From when on a model is another one.

    Attributes:
        position_m: Largest median distance [m].
        angle_rad: Largest median angle [rad].
        window_ns: Over so long [ns].
        silence_ns: Without a pair for so long nothing is known any more [ns].
        least_pairs: Fewer in the window say nothing.
        bound_ns: Longest time between the samples of joints around a pose [ns].
        lag_ns: Poses may be this much earlier or later than they seem; more is not explained [ns].
        return_share: A model that differed agrees again below this share of the tolerances, so that it does not flicker.

    Raises:
        ValueRefused: One that is not above 0, or a share above 1.
    """

    position_m: float = 0.005
    angle_rad: float = 0.02
    window_ns: int = 3_000_000_000
    silence_ns: int = 500_000_000
    least_pairs: int = 20
    bound_ns: int = BOUND_NS
    lag_ns: int = 30_000_000
    return_share: float = 0.8

    def __post_init__(self) -> None:
        """Refuse what would judge nothing."""
        for name in self.__struct_fields__:
            value = getattr(self, name)
            if not 0 < value < math.inf:
                raise ValueRefused(f"{name} is {value}; a finite number above 0 is needed")
        if self.return_share > 1.0:
            raise ValueRefused(f"return_share is {self.return_share}; up to 1 is allowed")


class Verdict(Struct, frozen=True, kw_only=True):
    """What is known of the model of one arm.

    Attributes:
        side: Which arm.
        state: The verdict.
        reason: Why, with figures, for people.
        pairs: In the window.
        position_m: Median distance [m]; None without pairs.
        angle_rad: Median angle [rad]; None without pairs.
        lag_s: By how much later than they seem the poses are, as far as motion tells [s]; 0 without any.
    """

    side: Side
    state: Agreement
    reason: str
    pairs: int
    position_m: float | None
    angle_rad: float | None
    lag_s: float

    @property
    def is_usable(self) -> bool:
        """Whether the robot may be moved by the model."""
        return self.state is Agreement.AGREES

    @property
    def is_differing(self) -> bool:
        """Whether the robot is another one than the model's; not knowing is neither."""
        return self.state is Agreement.DIFFERS


class _Residual(NamedTuple):
    """One comparison: what is missing from the model's place to the measured one, and how the arm moves."""

    stamp_ns: int
    off_m: Vector
    turn_rad: Vector
    v_mps: Vector
    w_radps: Vector
    along: float
    """Product of residual and speed, both in tolerances [1/s]."""
    square: float
    """Square of the speed [1/s²]."""
    is_near: bool
    """Whether it may tell of a lag: a pose of nowhere does not."""


class ModelJudge:
    """Judges the model of one arm."""

    def __init__(self, side: Side, arm: ArmChain, tolerances: Tolerances | None = None) -> None:
        self.side = side
        self._arm = arm
        self._tolerances = Tolerances() if tolerances is None else tolerances
        self._pairing = Pairing(self._tolerances.bound_ns)
        self._residuals: deque[_Residual] = deque()
        self._last: tuple[int, Placement] | None = None
        self._differed = False

    def joints(self, q_rad: Vector, stamp_ns: int) -> None:
        """Take joints.

        Args:
            q_rad: Reported joint angles, shape (7,) [rad].
            stamp_ns: When they arrived [ns].

        Raises:
            ValueRefused: Not seven finite joints.
        """
        self._keep(self._pairing.joints(q_rad, stamp_ns))

    def pose(self, pose: EePose, stamp_ns: int) -> None:
        """Take a measured pose of the end effector in the shoulder frame, and when it arrived [ns]."""
        self._keep(self._pairing.pose(pose, stamp_ns))

    def forget(self) -> None:
        """Begin anew: the link was gone, or it is another robot."""
        self._pairing = Pairing(self._tolerances.bound_ns)
        self._residuals.clear()
        self._last = None
        self._differed = False

    def verdict(self, now_ns: int) -> Verdict:
        """Return what is known now.

        Args:
            now_ns: On the clock of the stamps [ns].
        """
        limits = self._tolerances
        while self._residuals and self._residuals[0].stamp_ns < now_ns - limits.window_ns:
            self._residuals.popleft()
        pairs = len(self._residuals)
        if not pairs:
            return self._verdict(Agreement.UNKNOWN, "no joints and pose of one instant have arrived", None, 0.0)
        lag_s = self._lag_s()
        medians = self._medians(lag_s)
        silent_ns = now_ns - self._residuals[-1].stamp_ns
        if silent_ns > limits.silence_ns:
            text = f"nothing for {silent_ns / 1e9:.1f} s, at most {limits.silence_ns / 1e9:g} s is allowed"
            return self._verdict(Agreement.UNKNOWN, text, medians, lag_s)
        if pairs < limits.least_pairs:
            text = f"{pairs} pairs so far, {limits.least_pairs} are needed"
            return self._verdict(Agreement.UNKNOWN, text, medians, lag_s)
        share = limits.return_share if self._differed else 1.0
        self._differed = medians[0] > share * limits.position_m or medians[1] > share * limits.angle_rad
        figures = (
            f"FK(joint_states) and current_ee_pose are {1e3 * medians[0]:.2f} mm and {1e3 * medians[1]:.2f} mrad apart "
            f"(median of {pairs}), up to {1e3 * share * limits.position_m:g} mm and {1e3 * share * limits.angle_rad:g} mrad "
            "are allowed"
        )
        return self._verdict(Agreement.DIFFERS if self._differed else Agreement.AGREES, figures, medians, lag_s)

    def _verdict(self, state: Agreement, reason: str, medians: tuple[float, float] | None, lag_s: float) -> Verdict:
        position_m, angle_rad = (None, None) if medians is None else medians
        return Verdict(
            side=self.side,
            state=state,
            reason=reason,
            pairs=len(self._residuals),
            position_m=position_m,
            angle_rad=angle_rad,
            lag_s=lag_s,
        )

    def _lag_s(self) -> float:
        """Return the lag that explains how what is seen changes with the speed; held near 0 where little does.

        Least squares beside a displacement that stays: that one is the model's, and must not pass for a lag.
        """
        rows, most_s = [row for row in self._residuals if row.is_near], self._tolerances.lag_ns / 1e9
        if not rows:
            return 0.0
        off_m, turn = _mean([row.off_m for row in rows]), _mean([row.turn_rad for row in rows])
        v_mps, w_radps = _mean([row.v_mps for row in rows]), _mean([row.w_radps for row in rows])
        along = sum([row.along for row in rows]) - len(rows) * self._product(off_m, v_mps, turn, w_radps)
        square = sum([row.square for row in rows]) - len(rows) * self._product(v_mps, v_mps, w_radps, w_radps)
        return min(max(-along / (square + STILL), -most_s), most_s)

    def _medians(self, lag_s: float) -> tuple[float, float]:
        """Return distance and angle that a lag leaves: a pose of then, with what the arm has moved since."""
        off_m, off_rad = [], []
        for row in self._residuals:
            (x, y, z), (vx, vy, vz) = row.off_m, row.v_mps
            off_m.append(math.hypot(x + lag_s * vx, y + lag_s * vy, z + lag_s * vz))
            (x, y, z), (vx, vy, vz) = row.turn_rad, row.w_radps
            off_rad.append(math.hypot(x + lag_s * vx, y + lag_s * vy, z + lag_s * vz))
        return median(off_m), median(off_rad)

    def _keep(self, pairs: tuple[Pair, ...]) -> None:
        for pair in pairs:
            if self._residuals and pair.stamp_ns < self._residuals[-1].stamp_ns:
                self._residuals.clear()  # another clock: what was measured by the old one has no age on this one
                self._last = None
            self._residuals.append(self._compared(pair))
            if len(self._residuals) > MOST_PAIRS:
                self._residuals.popleft()

    def _compared(self, pair: Pair) -> _Residual:
        at = self._arm.forward(pair.q_rad)
        off_m = _minus(pair.pose.p_m, at.p_m)
        turn = turn_rad(at.rows, rows_from_quat(pair.pose.quat_xyzw))
        last, self._last = self._last, (pair.stamp_ns, at)
        v_mps = w_radps = STANDING
        if last is not None and 0 < pair.stamp_ns - last[0] <= NEIGHBOURS_NS:
            per_s = 1e9 / (pair.stamp_ns - last[0])
            v_mps = _times(per_s, _minus(at.p_m, last[1].p_m))
            w_radps = _times(per_s, turn_rad(last[1].rows, at.rows))
        off, square = self._product(off_m, off_m, turn, turn), self._product(v_mps, v_mps, w_radps, w_radps)
        return _Residual(
            stamp_ns=pair.stamp_ns,
            off_m=off_m,
            turn_rad=turn,
            v_mps=v_mps,
            w_radps=w_radps,
            along=self._product(off_m, v_mps, turn, w_radps),
            square=square,
            is_near=math.sqrt(off) < FAR + math.sqrt(square) * self._tolerances.lag_ns / 1e9,
        )

    def _product(self, a_m: Vector, b_m: Vector, a_rad: Vector, b_rad: Vector) -> float:
        """Return the scalar product of two displacements, lengths and angles in tolerances."""
        (ax, ay, az), (bx, by, bz), (cx, cy, cz), (dx, dy, dz) = a_m, b_m, a_rad, b_rad
        lengths, angles = ax * bx + ay * by + az * bz, cx * dx + cy * dy + cz * dz
        return lengths / self._tolerances.position_m**2 + angles / self._tolerances.angle_rad**2


def _minus(a: Vector, b: Vector) -> Vector:
    (ax, ay, az), (bx, by, bz) = a, b
    return ax - bx, ay - by, az - bz


def _times(factor: float, a: Vector) -> Vector:
    x, y, z = a
    return factor * x, factor * y, factor * z


def _mean(rows: Sequence[Vector]) -> Vector:
    return tuple([sum(column) / len(rows) for column in zip(*rows, strict=True)])
