"""What a hand holds, from what pulls its joints in postures that it was moved through slowly, up and down. Pure arithmetic.

The weight of a load turns each joint by torques that are linear in its mass and its first moments in the hand's frame: one
direction of the moments, that along gravity, takes a second posture. Friction is against the motion, so the mean of both
directions is free of it but for what differs between them. What the parameters do not know is wrong in all postures alike,
and is weighed so: more postures do not make it surer. What then does not fit makes everything less sure.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from gateway.kinematics.dynamics.observer import LEAST_SD_NM, Dynamics
from gateway.kinematics.dynamics.wrench import HAND_M
from gateway.values import ARM_DOF

__all__ = ["CannotTell", "Swings", "Weighed", "weigh"]

Array = NDArray[np.float64]

REMAINS: Final = 0.1
"""Friction in both directions is alike but for this part of it, one standard deviation (choice)."""
MOST_CONDITION: Final = 300.0
"""Above this condition number postures do not tell a centre of mass: some 60 to 120 is usual, a posture alone has none."""
SURE: Final = 2.0
"""A hand holds something when its mass is so many standard deviations above nothing."""


class Swings(Struct, frozen=True, kw_only=True):
    """What was measured, a row for each posture.

    Attributes:
        q_rad: Joint positions in the middle of the swing, shape (n, 7) [rad].
        up_nm: What pulled the joints, the mean while they moved towards larger positions, shape (n, 7) [N·m].
        down_nm: The same while they moved back.
        noise_nm: Standard deviation of the mean of both, shape (n, 7) [N·m].
        beside_empty: Whether the torques are what is more than with the empty hand: masses of the arm are no part of it.
    """

    q_rad: Array
    up_nm: Array
    down_nm: Array
    noise_nm: Array
    beside_empty: bool


class Weighed(Struct, frozen=True, kw_only=True):
    """What the hand holds.

    Attributes:
        mass_kg: Its mass [kg]; below zero where the arm is lighter than its model.
        mass_sd_kg: Standard deviation [kg].
        com_m: Its centre of mass in the end effector's frame, shape (3,) [m]; None while it may be nothing.
        com_sd_m: Standard deviation [m].
        condition: Condition number of the postures.
    """

    mass_kg: float
    mass_sd_kg: float
    com_m: Array | None
    com_sd_m: Array | None
    condition: float


class CannotTell(Struct, frozen=True):
    """Why postures cannot tell."""

    message: str


def weigh(dynamics: Dynamics, swings: Swings) -> Weighed | CannotTell:
    """Return what the hand holds, or why that cannot be told.

    Args:
        dynamics: Of the arm.
        swings: Measured by an observer that counts on no load.
    """
    drives, count = dynamics.drives, len(swings.q_rad)
    columns = np.concatenate([dynamics.load_columns(q) for q in swings.q_rad]) * (1.0, *(1.0 / HAND_M,) * 3)
    _, sizes, directions = np.linalg.svd(columns)
    condition = float(sizes[0] / max(sizes[-1], 1e-12))
    if condition > MOST_CONDITION:
        axes = ("its mass", *(f"its centre along {axis} of {dynamics.point}" for axis in "xyz"))
        lost = " and ".join(axis for axis, part in zip(axes, directions[-1], strict=True) if abs(part) > 0.4)
        return CannotTell(
            f"these postures do not tell {lost} (condition number {condition:.0f}, at most {MOST_CONDITION:.0f})"
        )
    pulls = 0.5 * (swings.up_nm + swings.down_nm)
    friction = 0.5 * (swings.up_nm - swings.down_nm)
    own = np.array([dynamics.terms(q, np.zeros(ARM_DOF), ()).gravity_nm for q in swings.q_rad])
    unsure = drives.unsure_part * (pulls if swings.beside_empty else own)
    alike = 0.0 if swings.beside_empty or drives.unsure_part else np.square(drives.friction_sd_nm)
    spread = np.zeros((count, ARM_DOF, count, ARM_DOF))
    each, joints = np.arange(count), np.arange(ARM_DOF)
    for joint in joints:
        spread[:, joint, :, joint] = np.outer(unsure[:, joint], unsure[:, joint])
    spread[:, joints, :, joints] += np.broadcast_to(alike, ARM_DOF)[:, None, None]
    noise = np.square(swings.noise_nm) + np.square(REMAINS * friction) + LEAST_SD_NM**2
    spread[each[:, None], joints, each[:, None], joints] += noise
    inverse = np.linalg.inv(spread.reshape(count * ARM_DOF, -1))
    covariance = np.linalg.inv(columns.T @ inverse @ columns)
    found = covariance @ columns.T @ inverse @ pulls.ravel()
    left = pulls.ravel() - columns @ found
    covariance *= max(1.0, float(left @ inverse @ left) / (len(left) - len(found)))
    mass, moments, mass_sd = float(found[0]), found[1:] / HAND_M, float(np.sqrt(covariance[0, 0]))
    com = com_sd = None
    if mass > SURE * mass_sd:
        com = moments / mass
        slopes = np.column_stack((-com / mass, np.eye(3) / (HAND_M * mass)))
        com_sd = np.sqrt((slopes @ covariance @ slopes.T).diagonal())
    return Weighed(mass_kg=mass, mass_sd_kg=mass_sd, com_m=com, com_sd_m=com_sd, condition=condition)
