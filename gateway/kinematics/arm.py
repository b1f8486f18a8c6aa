"""Arm: the kinematics of one arm, forward and inverse, whatever its numbers come from.

Poses are those of `left_ee` / `right_ee` in `left_shoulder_base` / `right_shoulder_base` (§4.0), joint angles in order of
§4.0.3. Whether the closed form holds is found in the axes (`shape.py`): where they meet it is the answer, for a
calibrated arm, too; where they miss each other a little it is where a numerical search begins; where they do not meet the
search is all there is.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from msgspec.structs import replace
from numpy.typing import NDArray

from gateway.errors import Refusal
from gateway.kinematics.correction import built_in
from gateway.kinematics.description import Description
from gateway.kinematics.placement import Placement
from gateway.kinematics.solving.bend import CLOSE_M, CLOSE_RAD, Bend
from gateway.kinematics.solving.chain import ArmChain
from gateway.kinematics.solving.dexterity import Dexterity, dexterity
from gateway.kinematics.solving.inverse import Branch, ClosedForm, Solution
from gateway.kinematics.solving.numeric import Found, found_from
from gateway.kinematics.solving.sectors import Sector
from gateway.kinematics.solving.shape import ArmShape, shape_of
from gateway.kinematics.solving.unreachable import not_found, why_not
from gateway.robot.limits import HOME_Q_RAD, JOINT_LOWER_RAD, JOINT_UPPER_RAD
from gateway.values import ARM_DOF, EePose, Side, ValueRefused, Vector, require_finite

__all__ = ["CLOSE_M", "CLOSE_RAD", "ArmModel", "NotClosed"]


class NotClosed(ValueError):
    """What only the closed form can tell was asked of an arm whose axes do not meet. The text says which, and by how much."""


class ArmModel:
    """One arm.

    Args:
        description: Numbers of the body.
        side: Which arm.
        lower_rad: Lowest joint angles, shape (7,) [rad]; None for the robot's own software limits (§4.13). The vendor's
            description is narrower on joints 1 and 2: pass its ranges to keep inside those.
        upper_rad: Highest joint angles, shape (7,) [rad]; None likewise.

    Raises:
        ValueRefused: Limits of another length, not finite, or a lowest angle that is not below the highest.

    Attributes:
        side: Which arm.
        chain: Its forward kinematics.
        shape: What was found in its axes.
        lower_rad: Lowest joint angles.
        upper_rad: Highest joint angles.
    """

    def __init__(
        self, description: Description, side: Side, lower_rad: Vector | None = None, upper_rad: Vector | None = None
    ) -> None:
        self.side = side
        self.lower_rad = JOINT_LOWER_RAD[side] if lower_rad is None else lower_rad
        self.upper_rad = JOINT_UPPER_RAD[side] if upper_rad is None else upper_rad
        _require_ranges(self.lower_rad, self.upper_rad)
        self.chain = ArmChain(description, side)
        self.shape = _shape(description, side)
        self._closed = ClosedForm(self.shape, side, self.lower_rad, self.upper_rad)

    def forward(self, q_rad: Sequence[float]) -> EePose:
        """Return the end effector's pose in the shoulder frame.

        Args:
            q_rad: Joint angles, shape (7,) [rad]; not judged by limits.
        """
        return self.chain.forward(q_rad).pose

    def jacobian(self, q_rad: Sequence[float]) -> NDArray[np.float64]:
        """Return the geometric Jacobian in the shoulder frame, shape (6, 7): [m/rad], then [rad/rad]."""
        return self.chain.jacobian(q_rad)

    def dexterity(self, q_rad: Sequence[float]) -> Dexterity:
        """Return manipulability and nearness to a singularity at joint angles, shape (7,) [rad]."""
        return dexterity(self.chain.jacobian(q_rad))

    def inverse(self, pose: EePose, seed_rad: Sequence[float]) -> Solution | Refusal:
        """Return the joint angles inside the limits that take a pose, nearest to a seed; or why there are none.

        A solution takes some 30 µs, a reason some milliseconds: where time counts, ask `solution`.

        Args:
            pose: Of the end effector in the shoulder frame.
            seed_rad: Joint angles to stay near to, shape (7,) [rad]: usually the measured or the last ones.

        Raises:
            ValueRefused: The seed has another length, or is not finite.
        """
        found = self.solution(pose, seed_rad)
        if found is not None:
            return found
        target = Placement.of(pose)
        if self.shape.is_exact:
            return why_not(self._closed, self.side, target)
        nearest = min(self._searched(target, tuple(seed_rad)), key=lambda end: end.error_m + end.error_rad)
        return not_found(self.side, nearest.error_m, nearest.error_rad)

    def solution(self, pose: EePose, seed_rad: Sequence[float]) -> Solution | None:
        """Return what `inverse` returns, but None where there is no solution.

        Raises:
            ValueRefused: The seed has another length, or is not finite.
        """
        seed = tuple(seed_rad)
        require_finite("seed", seed, ARM_DOF)
        target = Placement.of(pose)
        if self.shape.is_exact:
            return self._closed.nearest(target, seed)
        for found in self._searched(target, seed):
            if found.error_m < CLOSE_M and found.error_rad < CLOSE_RAD:
                return Solution(found.q_rad, self._closed.arm_angle_rad(found.q_rad))
        return None

    def bend(self, q_rad: Sequence[float]) -> Bend:
        """Return how the arm is bent at joint angles, shape (7,) [rad]: for what goes on from there, smoothly.

        Raises:
            NotClosed: The arm's axes do not meet, not even nearly.
        """
        if not self.shape.is_near:
            self._exact()
        return Bend(self._closed, self.chain, q_rad, is_exact=self.shape.is_exact)

    def branches(self, pose: EePose, arm_angle_rad: float) -> tuple[Branch, ...]:
        """Return all joint angles that take a pose with an arm angle, those inside the limits first.

        Args:
            pose: Of the end effector in the shoulder frame.
            arm_angle_rad: How far the elbow is lifted outward [rad]; see `circle.py`.

        Returns:
            Eight, or none if the wrist is out of reach.

        Raises:
            NotClosed: The arm's axes do not meet.
        """
        return self._exact().branches(Placement.of(pose), arm_angle_rad)

    def sectors(self, pose: EePose) -> tuple[Sector, ...]:
        """Return the arm angles at which a pose can be taken inside the limits, as begins and ends [rad].

        Raises:
            NotClosed: The arm's axes do not meet.
        """
        return self._exact().sectors(Placement.of(pose))

    def arm_angle_rad(self, q_rad: Sequence[float]) -> float:
        """Return the arm angle of joint angles, shape (7,) [rad].

        Raises:
            NotClosed: The arm's axes do not meet.
        """
        return self._exact().arm_angle_rad(q_rad)

    def reach_m(self) -> tuple[float, float]:
        """Return the least and greatest distance from shoulder to wrist inside the limits [m].

        Raises:
            NotClosed: The arm's axes do not meet.
        """
        return self._exact().reach_m()

    def _exact(self) -> ClosedForm:
        if not self.shape.is_exact:
            raise NotClosed(f"the {self.side} arm has no closed form: {self.shape.worst}: {self.shape.gap:.3g}")
        return self._closed

    def _searched(self, target: Placement, seed: Vector) -> Iterator[Found]:
        """Search from the closed form's answer where the arm is nearly of its shape, from the seed, and from home."""
        begins = [seed, HOME_Q_RAD[self.side]]
        nearly = self._closed.nearest(target, seed) if self.shape.is_near else None
        if nearly is not None:
            begins.insert(0, nearly.q_rad)
        for begin in begins:
            yield found_from(self.chain, target, begin, self.lower_rad, self.upper_rad)


def _shape(description: Description, side: Side) -> ArmShape:
    """Return the shape of an arm as described, with what was measured on one robot."""
    shape = shape_of(ArmChain(description.described or description, side))
    if description.described is None:
        return shape
    own = built_in(description, side)
    return replace(shape, tip=shape.tip.after(own.ee), zeros_rad=own.offsets_rad, base=own.shoulder)


def _require_ranges(lower_rad: Vector, upper_rad: Vector) -> None:
    require_finite("lower_rad", lower_rad, ARM_DOF)
    require_finite("upper_rad", upper_rad, ARM_DOF)
    for joint, (low, high) in enumerate(zip(lower_rad, upper_rad, strict=True), start=1):
        if not low < high:
            raise ValueRefused(
                f"joint {joint} has the range [{low:g}, {high:g}] rad; the lower must be below the upper"
            )
