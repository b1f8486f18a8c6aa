"""What an arm's drives do beside the rigid body: scale of the efforts, friction, rotors; how far all that is trusted; its load.

Friction of a joint at velocity v is `coulomb * tanh(v / STICK_RADPS) + viscous * v`: Coulomb's with a smooth sign, so that
noise around standstill is no chatter. Nothing of it is published: the nominal parameters have a standard deviation instead.
"""

from __future__ import annotations

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from gateway.kinematics.description import Description
from gateway.values import ARM_DOF, Side, Vector, require_finite

__all__ = ["DriveParameters", "Load", "nominal_parameters"]

Array = NDArray[np.float64]

STICK_RADPS = 0.02
"""Slower than about this, a joint's friction is not that of a motion [rad/s]; ten times the noise of velocities."""
ARMATURE_KGM2 = 0.02
"""Rotor of each drive behind its gear, as the vendor's MuJoCo example has it [kg m²]; the description has none."""
PART_UNSURE = 0.15
"""Nominal numbers may be off by this part of the effort: masses and the scale of the efforts by a tenth each."""
FRICTION_PART = 0.02
"""Friction that nobody identified is within this part of a motor's greatest torque, one standard deviation."""

NONE: Vector = (0.0,) * ARM_DOF


class Load(Struct, frozen=True, kw_only=True):
    """What a hand holds, as a point.

    Attributes:
        mass_kg: Its mass [kg].
        com_m: Its centre of mass in the frame of the end effector, shape (3,) [m].
    """

    mass_kg: float
    com_m: Vector


class DriveParameters(Struct, frozen=True, kw_only=True):
    """One arm's drives; vectors have shape (7,).

    Attributes:
        source: Where they come from: `nominal`, or the file that they were identified to.
        scale: Torque per effort that the robot reports [N·m/(N·m)].
        coulomb_nm: Coulomb friction [N·m].
        viscous_nmsprad: Viscous friction [N·m·s/rad].
        armature_kgm2: Inertia of the rotor at the joint [kg·m²].
        unsure_part: Standard deviation of all that follows masses and scale, as a part of the effort.
        friction_sd_nm: Standard deviation of the friction, and of whatever else is no part of the load [N·m].
        heavier: What each joint's link is heavier by than described, and its first moments about the joint's frame along x, y,
            z, shape (7, 4) [kg, kg·m]; empty where nothing differs.
    """

    source: str = "nominal"
    scale: Vector = (1.0,) * ARM_DOF
    coulomb_nm: Vector = NONE
    viscous_nmsprad: Vector = NONE
    armature_kgm2: Vector = (ARMATURE_KGM2,) * ARM_DOF
    unsure_part: float = PART_UNSURE
    friction_sd_nm: Vector = NONE
    heavier: tuple[Vector, ...] = ()

    def __post_init__(self) -> None:
        """Refuse wrong shapes and numbers that no drive has.

        Raises:
            ValueRefused: A vector has not seven finite numbers.
            ValueError: A scale is not positive, or anything else is negative.
        """
        for name in ("scale", "coulomb_nm", "viscous_nmsprad", "armature_kgm2", "friction_sd_nm"):
            values: Vector = getattr(self, name)
            require_finite(name, values, ARM_DOF)
            if min(values) < 0.0 or (name == "scale" and min(values) <= 0.0):
                raise ValueError(f"{name} has {min(values)}, which no drive has")
        for link in self.heavier:
            require_finite("heavier", link, 4)
        if len(self.heavier) not in (0, ARM_DOF):
            raise ValueError(f"heavier has {len(self.heavier)} links, an arm has {ARM_DOF}")
        if not 0.0 <= self.unsure_part < 1.0:
            raise ValueError(f"unsure_part {self.unsure_part} is outside [0, 1)")

    def friction_nm(self, dq_radps: Array) -> Array:
        """Return the torque that friction takes at velocities, shape (7,) [N·m]; positive against positive velocity."""
        return (
            np.asarray(self.coulomb_nm) * np.tanh(dq_radps / STICK_RADPS) + np.asarray(self.viscous_nmsprad) * dq_radps
        )

    def unknown_friction_nm(self, dq_radps: Array) -> Array:
        """Return the standard deviation of the friction at velocities, shape (7,) [N·m].

        A joint that stands is held by anything up to its Coulomb friction, in either direction.
        """
        sticking = np.asarray(self.coulomb_nm) * (1.0 - np.tanh(np.abs(dq_radps) / STICK_RADPS))
        unknown: Array = np.hypot(np.asarray(self.friction_sd_nm), sticking)
        return unknown


def nominal_parameters(description: Description, side: Side) -> DriveParameters:
    """Return what is assumed of an arm that nobody identified.

    Args:
        description: For the motors' greatest torques.
        side: Which arm.
    """
    return DriveParameters(friction_sd_nm=tuple(FRICTION_PART * joint.effort for joint in description.arm(side)))
