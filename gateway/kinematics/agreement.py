"""Agreement: whether the model of an arm is that of the robot, judged live: FK(joint states) against current_ee_pose.

Per arm the median over some seconds of how far the two are apart, in position and in angle. What moves the robot by the model
may rely on it while the verdict is AGREES, and on nothing else: too few pairs, or none for a while, are UNKNOWN, and that
is no yes. A median does not care for a few late samples of a fast motion.

Pure and in virtual time: whoever owns one tells it what arrived and when, and asks. The pose has no stamp (manual §4.8), so
arrival is what both streams are paired by (`pairing.py`).
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum
from statistics import median
from typing import Protocol

from gateway.kinematics.pairing import BOUND_NS, Pair, Pairing
from gateway.kinematics.placement import Placement, rows_from_quat, turn_rad
from gateway.values import EePose, Side, ValueRefused, Vector

__all__ = ["Agreement", "Arm", "ModelJudge", "Tolerances", "Verdict"]

MOST_PAIRS = 2000
"""Of a window; older ones are let go."""


class Arm(Protocol):
    """What is judged: `chain.ArmChain` is one."""

    def forward(self, q_rad: Sequence[float]) -> Placement:
        """Return the end effector in the shoulder frame for joints, shape (7,) [rad]."""
        ...


class Agreement(str, Enum):
    """What is known of the model."""

    UNKNOWN = "unknown"
    AGREES = "agrees"
    DIFFERS = "differs"


@dataclass(frozen=True, slots=True, kw_only=True)
class Tolerances:
    """From when on a model is another one.

    Attributes:
        position_m: Largest median distance [m].
        angle_rad: Largest median angle [rad].
        window_ns: Over so long [ns].
        silence_ns: Without a pair for so long nothing is known any more [ns].
        least_pairs: Fewer in the window say nothing.
        bound_ns: Longest time between the samples of joints around a pose [ns].
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
    return_share: float = 0.8

    def __post_init__(self) -> None:
        """Refuse what would judge nothing."""
        for name in self.__slots__:
            value = getattr(self, name)
            if not 0 < value < math.inf:
                raise ValueRefused(f"{name} is {value}; a finite number above 0 is needed")
        if self.return_share > 1.0:
            raise ValueRefused(f"return_share is {self.return_share}; up to 1 is allowed")


@dataclass(frozen=True, slots=True, kw_only=True)
class Verdict:
    """What is known of the model of one arm.

    Attributes:
        side: Which arm.
        state: The verdict.
        reason: Why, with figures, for people.
        pairs: In the window.
        position_m: Median distance [m]; None without pairs.
        angle_rad: Median angle [rad]; None without pairs.
    """

    side: Side
    state: Agreement
    reason: str
    pairs: int
    position_m: float | None
    angle_rad: float | None

    @property
    def is_usable(self) -> bool:
        """Whether the robot may be moved by the model."""
        return self.state is Agreement.AGREES


class ModelJudge:
    """Judges the model of one arm.

    Args:
        side: Which arm.
        arm: Its model.
        tolerances: From when on it is another one.
    """

    def __init__(self, side: Side, arm: Arm, tolerances: Tolerances | None = None) -> None:
        self.side = side
        self._arm = arm
        self._tolerances = Tolerances() if tolerances is None else tolerances
        self._pairing = Pairing(self._tolerances.bound_ns)
        self._residuals: deque[tuple[int, float, float]] = deque(maxlen=MOST_PAIRS)
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
        self._differed = False

    def verdict(self, now_ns: int) -> Verdict:
        """Return what is known now.

        Args:
            now_ns: On the clock of the stamps [ns].
        """
        limits = self._tolerances
        while self._residuals and self._residuals[0][0] < now_ns - limits.window_ns:
            self._residuals.popleft()
        pairs = len(self._residuals)
        if not pairs:
            return self._verdict(Agreement.UNKNOWN, "no joints and pose of one instant have arrived", None)
        medians = median([row[1] for row in self._residuals]), median([row[2] for row in self._residuals])
        silent_ns = now_ns - self._residuals[-1][0]
        if silent_ns > limits.silence_ns:
            return self._verdict(
                Agreement.UNKNOWN,
                f"nothing for {silent_ns / 1e9:.1f} s, at most {limits.silence_ns / 1e9:g} s is allowed",
                medians,
            )
        if pairs < limits.least_pairs:
            return self._verdict(Agreement.UNKNOWN, f"{pairs} pairs so far, {limits.least_pairs} are needed", medians)
        share = limits.return_share if self._differed else 1.0
        self._differed = medians[0] > share * limits.position_m or medians[1] > share * limits.angle_rad
        figures = (
            f"FK(joint_states) and current_ee_pose are {1e3 * medians[0]:.2f} mm and {1e3 * medians[1]:.2f} mrad apart "
            f"(median of {pairs}), up to {1e3 * share * limits.position_m:g} mm and {1e3 * share * limits.angle_rad:g} mrad "
            "are allowed"
        )
        return self._verdict(Agreement.DIFFERS if self._differed else Agreement.AGREES, figures, medians)

    def _verdict(self, state: Agreement, reason: str, medians: tuple[float, float] | None) -> Verdict:
        position_m, angle_rad = (None, None) if medians is None else medians
        return Verdict(
            side=self.side,
            state=state,
            reason=reason,
            pairs=len(self._residuals),
            position_m=position_m,
            angle_rad=angle_rad,
        )

    def _keep(self, pairs: tuple[Pair, ...]) -> None:
        for pair in pairs:
            if self._residuals and pair.stamp_ns < self._residuals[-1][0]:
                self._residuals.clear()  # another clock: what was measured by the old one has no age on this one
            at = self._arm.forward(pair.q_rad)
            turn = turn_rad(at.rows, rows_from_quat(pair.pose.quat_xyzw))
            self._residuals.append((pair.stamp_ns, math.dist(at.p_m, pair.pose.p_m), math.hypot(*turn)))
