"""Gripper: opening, speed and grip force from the motor's angle and torque, with how far each may be off (§4.4.2).

One motor moves both fingers. A torque τ at the motor holds a pressure λ between each finger and the thing between them,
λ = τ / (J_lᵀ n_l + J_rᵀ n_r), as long as both press alike; one motor's torque cannot tell them apart if they do not.
Here n points to where a finger opens, and a grip is counted positive.

What is known of the linkage comes from the vendor's description. Two lengths of each finger are not given: the rotor's
radius and the coupler. They are parameters with nominal values that say how they were found (`Length.basis`), and their
doubt is part of every force. The table of §4.4 is feed-forward only: the manual says that the motor's real torque also
depends on its position and speed, so a force from the table is a guess with a wide margin; prefer a measured torque.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, Final

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from gateway.kinematics.description import Description
from gateway.kinematics.linkage import Branch, Closure
from gateway.robot.limits import gripper_torque_nm
from gateway.values import ValueRefused, require_finite

__all__ = ["GripForce", "Gripper", "Length", "Torque", "feed_forward", "measured"]

TABLE_RATIO: Final = 0.15
"""Doubt of the table's torque, as part of it (ours: §4.4 gives the value alone)."""
MEASURED_RATIO: Final = 0.05
"""Doubt of a measured torque, as part of it (ours; the motor measures its current)."""
FRICTION_NM: Final = 0.08
"""Torque that friction of motor and linkage may hide, either way [N·m] (ours: §4.8 shows 0.06 at rest)."""
ANGLE_SIGMA_RAD: Final = 0.02
"""Doubt of the motor's zero [rad] (ours: §4.8 shows 1.13 rad where the description ends at 1)."""
ASSUMED_SIGMA_M: Final = 0.0005
"""Doubt of a length that was inferred [m] (ours)."""

OTHER_COUPLER_M: Final = 0.04523
"""Length of the second finger's coupler [m]. Twice its centre of mass would be 44.1 mm, but with that the linkage is
stretched out at 0.95 rad, inside its range: the bar is not uniform. This one, with the rotor radius of the first finger,
opens both fingers alike at 1 rad, as the description has it (`mimic_of_crank_lg_joint2: -1`)."""

STEP_M: Final = 1e-5
STEP_RAD: Final = 1e-4


class Length(Struct, frozen=True, kw_only=True):
    """A length that nobody published.

    Attributes:
        value_m: Nominal value [m].
        sigma_m: Its standard deviation [m].
        basis: How it was found, for people.
    """

    value_m: float
    sigma_m: float
    basis: str


class Torque(Struct, frozen=True, kw_only=True):
    """A torque at the motor; positive opens (§4.4).

    Attributes:
        value_nm: Torque [N·m].
        sigma_nm: Its standard deviation, friction included [N·m].
        basis: `feed_forward` or `measured`.
    """

    value_nm: float
    sigma_nm: float
    basis: str


def feed_forward(raw: float) -> Torque:
    """Return what a gripper's input asks of the motor, by the table of §4.4.

    Args:
        raw: Input, 0 opens most, 0.1 is no torque, 1 closes most.

    Raises:
        ValueRefused: Not in 0..1.
    """
    if not 0.0 <= raw <= 1.0:
        raise ValueRefused(f"a gripper's input is {raw}, [0, 1] is allowed (§4.4)")
    value_nm = gripper_torque_nm(raw)
    return Torque(value_nm=value_nm, sigma_nm=math.hypot(TABLE_RATIO * value_nm, FRICTION_NM), basis="feed_forward")


def measured(tau_nm: float) -> Torque:
    """Return a torque that the motor reports (`effort` of §4.8).

    Raises:
        ValueRefused: Not finite.
    """
    require_finite("effort", (tau_nm,), 1)
    return Torque(value_nm=tau_nm, sigma_nm=math.hypot(MEASURED_RATIO * tau_nm, FRICTION_NM), basis="measured")


class GripForce(Struct, frozen=True, kw_only=True):
    """How hard each finger presses, if both press alike.

    Attributes:
        force_n: Towards each other, negative when they push outwards [N].
        sigma_n: Standard deviation [N].
        parts_n: What it is made of: part of the deviation by source, independent of each other [N].
        opening_m: Between the fingers [m].
        basis: Of the torque.
    """

    force_n: float
    sigma_n: float
    parts_n: Mapping[str, float]
    opening_m: float
    basis: str


class Gripper(Struct, frozen=True, kw_only=True):
    """Both fingers of a gripper; left and right hand have the same.

    Attributes:
        fingers: Linkage of the first and the second finger; the first is at positive y of {b}.
        rotor_radius: Of both fingers' pins on the rotor.
        couplers: Of the first and the second finger.
    """

    fingers: tuple[Branch, Branch]
    rotor_radius: Length
    couplers: tuple[Length, Length]

    @staticmethod
    def of(
        description: Description, rotor_radius: Length | None = None, couplers: tuple[Length, Length] | None = None
    ) -> Gripper:
        """Return the gripper of a description.

        Args:
            description: Numbers of the body.
            rotor_radius: Of this gripper, if it was measured; None for the nominal one.
            couplers: Of this gripper, if they were measured; None for the nominal ones.

        Raises:
            ValueRefused: The lengths cannot be joined.
        """
        table = description.gripper["left"]
        first, second = _closed(table, ""), _closed(table, "other_")
        com_x, com_y, _ = table["coupler"]["com_m"]
        far_pin = first.pivot + first.short_arm + 2.0 * complex(com_x, -com_y)
        radius = rotor_radius or _assumed(abs(far_pin), "end of a uniform coupler, at twice its centre of mass")
        bars = couplers or (
            _assumed(2.0 * math.hypot(com_x, com_y), "uniform bar: twice its centre of mass"),
            _assumed(OTHER_COUPLER_M, "opens both fingers alike at 1 rad; a uniform bar would jam at 0.95 rad"),
        )
        fingers = [
            Branch(
                pivot_m=(at.pivot.real, at.pivot.imag),
                short_arm_m=(at.short_arm.real, at.short_arm.imag),
                long_arm_m=(at.long_arm.real, at.long_arm.imag),
                rotor_radius_m=radius.value_m,
                coupler_m=bar.value_m,
            )
            for at, bar in zip((first, second), bars, strict=True)
        ]
        return Gripper(fingers=(fingers[0], fingers[1]), rotor_radius=radius, couplers=bars)

    def close(self, q_rad: float) -> tuple[Closure, Closure]:
        """Return both fingers' linkages at a motor angle [rad].

        Raises:
            ValueRefused: One cannot be there.
        """
        return self.fingers[0].close(q_rad), self.fingers[1].close(q_rad)

    def opening_m(self, q_rad: float) -> float:
        """Return the distance between the fingers, 0 when closed [m].

        Raises:
            ValueRefused: The linkage cannot be there.
        """
        now, closed = self.close(q_rad), self.close(0.0)
        return float(sum(n * (a.finger_m[1] - b.finger_m[1]) for n, a, b in zip(OPENS, now, closed, strict=True)))

    def opening_per_rad_m(self, q_rad: float) -> float:
        """Return how fast the fingers part by the motor's angle, J_lᵀ n_l + J_rᵀ n_r [m/rad].

        Raises:
            ValueRefused: The linkage cannot be there.
        """
        return float(sum(n * at.jacobian_m[1] for n, at in zip(OPENS, self.close(q_rad), strict=True)))

    def force(self, q_rad: float, torque: Torque, angle_sigma_rad: float = ANGLE_SIGMA_RAD) -> GripForce:
        """Return how hard each finger presses.

        Args:
            q_rad: Motor angle, measured [rad].
            torque: At the motor; `measured` rather than `feed_forward`.
            angle_sigma_rad: Standard deviation of the angle [rad].

        Raises:
            ValueRefused: The linkage cannot be there, or within its doubt could not.
        """
        lever_m = self.opening_per_rad_m(q_rad)
        force_n = -torque.value_nm / lever_m
        per_lever = -force_n / lever_m  # of the force by the lever [N/m]
        by_angle = (self.opening_per_rad_m(q_rad + STEP_RAD) - self.opening_per_rad_m(q_rad - STEP_RAD)) / (
            2 * STEP_RAD
        )
        parts = {
            "torque": torque.sigma_nm / abs(lever_m),
            "angle": abs(per_lever * by_angle) * angle_sigma_rad,
            **{name: abs(per_lever * slope) * length.sigma_m for name, slope, length in self._by_lengths(q_rad)},
        }
        return GripForce(
            force_n=force_n,
            sigma_n=math.hypot(*parts.values()),
            parts_n=parts,
            opening_m=self.opening_m(q_rad),
            basis=torque.basis,
        )

    def _by_lengths(self, q_rad: float) -> list[tuple[str, float, Length]]:
        """Return how the lever changes with each unpublished length, by central differences."""

        def lever(radius_m: float, first_m: float, second_m: float) -> float:
            fingers = tuple(
                replace(finger, rotor_radius_m=finger.rotor_radius_m + radius_m, coupler_m=finger.coupler_m + bar_m)
                for finger, bar_m in zip(self.fingers, (first_m, second_m), strict=True)
            )
            return replace(self, fingers=(fingers[0], fingers[1])).opening_per_rad_m(q_rad)

        names = ("rotor radius", "first coupler", "second coupler")
        lengths = (self.rotor_radius, *self.couplers)
        steps = STEP_M * np.eye(3)
        return [
            (name, (lever(*step) - lever(*-step)) / (2.0 * STEP_M), length)
            for name, step, length in zip(names, steps, lengths, strict=True)
        ]


OPENS: Final = (1.0, -1.0)
"""The way in which a finger opens along y of {b}: n of the first and of the second (§4.4.2)."""


class _Closed(Struct, frozen=True):
    pivot: complex
    short_arm: complex
    long_arm: complex


def _closed(table: Mapping[str, Any], prefix: str) -> _Closed:
    """Return where a finger's linkage is when closed, in {b}: x of the hand, y its z, from the rotor's axis.

    The joints of the linkage are turned −90° about x, so the y of their own frames is −z of the hand's.
    """
    rotor_x, _, rotor_z = table["rotor"]["xyz_m"]
    x, _, z = table[f"{prefix}crank"]["xyz_m"]
    (short_x, short_y, _), (long_x, long_y, _) = (table[f"{prefix}{part}"]["xyz_m"] for part in ("coupler", "finger"))
    return _Closed(complex(x - rotor_x, z - rotor_z), complex(short_x, -short_y), complex(long_x, -long_y))


def _assumed(value_m: float, basis: str) -> Length:
    return Length(value_m=value_m, sigma_m=ASSUMED_SIGMA_M, basis=f"not published: {basis}")
