"""Bend: how an arm is bent, and its joints for other poses and arm angles while it stays bent like that.

For what goes on smoothly from a posture: elbow, shoulder and wrist keep their sides, the joints are smooth functions of pose
and arm angle, and at the posture's own pose and arm angle they are exactly that posture. For an arm whose axes meet it is the
closed form; where they miss each other a little it is the closed form moved by what it is off at the posture, then corrected by
a search.
"""

from __future__ import annotations

from collections.abc import Sequence

from gateway.kinematics.placement import Placement
from gateway.kinematics.solving.chain import ArmChain
from gateway.kinematics.solving.inverse import NOTHING, ClosedForm, Swivel
from gateway.kinematics.solving.numeric import found_from
from gateway.values import Vector

__all__ = ["CLOSE_M", "CLOSE_RAD", "Bend"]

CLOSE_M = 1e-9
"""A numerical solution is one when it is at least this close [m] ..."""
CLOSE_RAD = 1e-9
"""... and this close [rad]."""


class Bend:
    """How an arm is bent.

    Args:
        closed: Closed form of the arm's shape, exact or nearly.
        chain: Its forward kinematics.
        q_rad: The posture, shape (7,) [rad].
        is_exact: Whether the shape is the arm's own.

    Attributes:
        arm_angle_rad: Of the posture.
        is_exact: Likewise.
    """

    def __init__(self, closed: ClosedForm, chain: ArmChain, q_rad: Sequence[float], *, is_exact: bool) -> None:
        self.arm_angle_rad = closed.arm_angle_rad(q_rad)
        self.is_exact = is_exact
        self._closed, self._chain, self._q_rad = closed, chain, tuple(q_rad)
        self._off_rad = NOTHING
        if not is_exact:
            here = closed.swivel(chain.forward(q_rad), q_rad)
            if here is not None:  # else no pose near this one is within reach either
                self._off_rad = tuple([q - c for q, c in zip(q_rad, here.at(self.arm_angle_rad), strict=True)])

    def swivel(self, target: Placement) -> Swivel | None:
        """Return the joint angles for a pose by arm angle; None when the wrist is out of reach of the bare bones.

        Args:
            target: End effector in the shoulder frame.
        """
        return self._closed.swivel(target, self._q_rad, self._off_rad)

    def refined(self, target: Placement, q_rad: Vector) -> Vector | None:
        """Return joint angles of `swivel` corrected for what the arm's shape is off; None where that leaves the limits.

        Args:
            target: End effector in the shoulder frame.
            q_rad: Joint angles that nearly take it, shape (7,) [rad].
        """
        if self.is_exact:
            return q_rad
        lower, upper = zip(*self._closed.limits_rad, strict=True)
        found = found_from(self._chain, target, q_rad, lower, upper)
        return found.q_rad if found.error_m < CLOSE_M and found.error_rad < CLOSE_RAD else None
