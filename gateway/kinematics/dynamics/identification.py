"""What one arm's drives and masses differ in from the description, from motion that was measured: friction, scale, masses.

At each instant the efforts are what the body as described asks for, and what else there is:

    effort = (torques as described + Y heavier + coulomb * tanh(v / stick) + viscous * v + rotor * a) / scale

with Y, pinocchio's joint torque regressor: linear but for the scale, and solved by Gauss and Newton. A scale of all joints
looks like heavier links, and many masses show only together: so what is usual counts as a measurement of its own, and
standard deviations say what the motion added. Accelerations are differences of velocities; all are smoothed alike. An
arm at rest tells nothing, for friction holds it wherever it likes: such times are left out.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from gateway.kinematics.description import Description
from gateway.kinematics.dynamics.arm_dynamics import MOMENTS, ArmDynamics
from gateway.kinematics.dynamics.parameters import ARMATURE_KGM2, STICK_RADPS, DriveParameters
from gateway.values import ARM_DOF, Side

__all__ = ["Found", "Motion", "TooLittle", "identify_dynamics"]

Array = NDArray[np.float64]

SMOOTH_S: Final = 0.03
"""Standard deviation of the smoothing in time [s]."""
APART_S: Final = 0.05
"""Equations are so far apart: nearer ones have the same noise [s]."""
LEAST_S: Final = 15.0
"""Shorter motion is not looked at [s]."""
HELD_BACK: Final = 0.25
"""This part of the motion, its end, is not fitted: what is left there says what the result is worth."""
LEAST_MOVED_RAD: Final = 0.3
"""Each joint goes back and forth by this at least [rad]."""
MOST_CONDITION: Final = 50.0
"""Above this condition number load, friction and rotor of a joint are not told apart."""
STEPS: Final = 8
"""Of Gauss and Newton."""
GAP_S: Final = 0.1
"""A motion with a longer gap than this is not smooth [s]."""
SCALE_SD, MASS_PART, HAND_KG, LEVER_M, ROTOR_SD_KGM2, VISCOUS_SD = 0.1, 0.1, 0.3, 0.1, 0.01, 1.0
COULOMB_PART: Final = 0.05
"""What is usual (choice): scale within a tenth; masses within a tenth, the hand's within 0.3 kg; their centres as if what is
heavier lay 0.1 m off; rotors within a half; friction within 5 % of the motor's greatest torque, and 1 N·m·s/rad."""


class Motion(Struct, frozen=True, kw_only=True):
    """Joints of an arm in the order of time.

    Attributes:
        at_s: Times, shape (n,) [s].
        q_rad: Positions, shape (n, 7) [rad].
        dq_radps: Velocities, shape (n, 7) [rad/s].
        tau_nm: Efforts as reported, shape (n, 7) [N·m].
    """

    at_s: Array
    q_rad: Array
    dq_radps: Array
    tau_nm: Array


class Found(Struct, frozen=True, kw_only=True):
    """What was found; vectors have shape (7,).

    Attributes:
        drives: Friction, scale, rotors and masses, with what is left on held-back motion as their standard deviation.
        sd: Standard deviations of what is in `drives`, by its name there.
        condition: Condition number of each joint's load, friction and rotor.
        before_nm: What is left on held-back motion with the nominal numbers, root mean square [N·m].
        after_nm: The same with what was found.
        range_nm: Range of each joint's effort there.
    """

    drives: DriveParameters
    sd: dict[str, Array]
    condition: Array
    before_nm: Array
    after_nm: Array
    range_nm: Array


class TooLittle(Struct, frozen=True, kw_only=True):
    """Why a motion cannot tell, and what to do about it.

    Attributes:
        message: Why, with figures.
        hint: What to do.
        condition: Condition numbers, shape (7,); empty before there are any.
    """

    message: str
    hint: str
    condition: tuple[float, ...] = ()


def identify_dynamics(description: Description, side: Side, motion: Motion, source: str) -> Found | TooLittle:
    """Return what an arm differs in, or why its motion cannot tell.

    Args:
        description: Of the body, with the joint zeros of this robot.
        side: Which arm.
        motion: What was measured, while nothing touched the arm and the base stood.
        source: Where the result will be, for people who ask what an estimate stands on.
    """
    described = ArmDynamics(description, side, DriveParameters(armature_kgm2=(0.0,) * ARM_DOF))
    why = _too_little(motion)
    if why is not None:
        return why
    q, dq, ddq, tau = _smoothed(motion)
    is_told = _is_moving(dq)
    q, dq, ddq, tau = q[is_told], dq[is_told], ddq[is_told], tau[is_told]
    load = np.array([described.torques(*row) for row in zip(q, dq, ddq, strict=True)])
    links = np.array([described.regressor(*row) for row in zip(q, dq, ddq, strict=True)])
    own = np.stack((load, np.tanh(dq / STICK_RADPS), dq, ddq), axis=2)  # columns of each joint of its own
    condition = np.array([_condition(own[:, n]) for n in range(ARM_DOF)])
    if condition.max() > MOST_CONDITION:
        worst = int(condition.argmax())
        return TooLittle(
            message=f"joint {worst + 1} moved so that load, friction and rotor look alike (condition number "
            f"{condition[worst]:.0f}, at most {MOST_CONDITION:.0f})",
            hint="move all joints at once, back and forth, slowly and quickly: `ta2 identify --dynamics --excite FILE`",
            condition=tuple(condition.tolist()),
        )
    fitted = round((1.0 - HELD_BACK) * len(q))
    usual, spread = _usual(described, description, side)
    values, noise = usual, np.ones(ARM_DOF)
    for _ in range(STEPS):  # what is left says how much each joint counts, and then what is left
        values, covariance = _step(own[:fitted], links[:fitted], tau[:fitted], noise, values, usual, spread)
        left = (tau - _efforts(own, links, values))[:fitted]
        noise = (_rms(left) + 1e-6) * np.sqrt(_alike(left))
    sd = np.sqrt(covariance.diagonal())
    names = ("scale", "coulomb_nm", "viscous_nmsprad", "armature_kgm2")
    own_values, own_sd = (numbers[: 4 * ARM_DOF].reshape(ARM_DOF, 4).T for numbers in (values, sd))
    after = _rms((tau - _efforts(own, links, values))[fitted:])
    # The first was the effort per torque; what is multiplied by it is divided again.
    own_values, own_sd = (numbers / own_values[0] for numbers in (own_values, own_sd))
    own_values[0], own_sd[0] = 1.0 / values[: 4 * ARM_DOF : 4], own_sd[0] / values[: 4 * ARM_DOF : 4]
    found = {name: tuple(np.maximum(row, 0.0).tolist()) for name, row in zip(names, own_values, strict=True)}
    heavier = values[4 * ARM_DOF :].reshape(ARM_DOF, MOMENTS)
    nominal = DriveParameters()
    plain = tau - load - np.array(nominal.armature_kgm2) * ddq
    return Found(
        drives=DriveParameters(
            source=source,
            unsure_part=0.0,
            friction_sd_nm=tuple(after.tolist()),
            heavier=tuple(map(tuple, heavier.tolist())),
            **found,
        ),
        sd={**dict(zip(names, own_sd, strict=True)), "heavier": sd[4 * ARM_DOF :].reshape(ARM_DOF, MOMENTS)},
        condition=condition,
        before_nm=_rms(plain[fitted:]),
        after_nm=after,
        range_nm=np.ptp(tau[fitted:], axis=0),
    )


def _too_little(motion: Motion) -> TooLittle | None:
    moved_s = float(np.diff(motion.at_s)[_is_moving(motion.dq_radps)[1:]].sum())
    if moved_s < LEAST_S:
        hint = f"record {LEAST_S:.0f} s or more of motion that nothing touches"
        return TooLittle(message=f"{moved_s:.1f} s of motion is too short", hint=hint)
    gap_s = float(np.diff(motion.at_s).max())
    if gap_s > GAP_S or np.diff(motion.at_s).min() <= 0.0:
        return TooLittle(
            message=f"the motion has a gap of {gap_s:.2f} s", hint="record it again, on the robot's network"
        )
    if not motion.tau_nm.any(axis=0).all():
        return TooLittle(message="a joint reports no effort at all (§4.8)", hint="nothing can be found without efforts")
    moved = np.ptp(motion.q_rad, axis=0)
    if moved.min() < LEAST_MOVED_RAD:
        joint = int(moved.argmin())
        return TooLittle(
            message=f"joint {joint + 1} moved through {moved[joint]:.2f} rad, {LEAST_MOVED_RAD} rad are needed",
            hint="move every joint back and forth",
        )
    return None


def _is_moving(dq_radps: Array) -> NDArray[np.bool_]:
    """Return at which times any joint moves, shape (n,)."""
    return np.asarray((np.abs(dq_radps) > STICK_RADPS).any(axis=1))


def _smoothed(motion: Motion) -> tuple[Array, Array, Array, Array]:
    """Return positions, velocities, accelerations and efforts on an even grid, shape (n, 7) each."""
    step_s = float(np.median(np.diff(motion.at_s)))
    grid = np.arange(motion.at_s[0], motion.at_s[-1], step_s)
    reach = int(np.ceil(4.0 * SMOOTH_S / step_s))
    kernel = np.exp(-0.5 * np.square(np.arange(-reach, reach + 1) * step_s / SMOOTH_S))
    kernel /= kernel.sum()

    def smooth(values: Array) -> Array:
        columns = [np.interp(grid, motion.at_s, values[:, n]) for n in range(ARM_DOF)]
        return np.stack([np.convolve(column, kernel, mode="valid") for column in columns], axis=1)

    q, dq, tau = (smooth(values) for values in (motion.q_rad, motion.dq_radps, motion.tau_nm))
    every = max(1, round(APART_S / step_s))
    return q[::every], dq[::every], np.gradient(dq, step_s, axis=0)[::every], tau[::every]


def _condition(columns: Array) -> float:
    """Return the condition number of columns of length one."""
    lengths = np.linalg.norm(columns, axis=0)
    return float(np.linalg.cond(columns / np.where(lengths > 0.0, lengths, 1.0)))


def _usual(described: ArmDynamics, description: Description, side: Side) -> tuple[Array, Array]:
    """Return what is usual of each number, and its standard deviation, shape (56,) each."""
    own = np.tile([1.0, 0.0, 0.0, ARMATURE_KGM2], ARM_DOF)
    coulomb = [COULOMB_PART * joint.effort for joint in description.arm(side)]
    own_sd = np.array([(SCALE_SD, one, VISCOUS_SD, ROTOR_SD_KGM2) for one in coulomb]).ravel()
    kg = np.array([MASS_PART * inertia.mass for inertia in list(described.model.inertias)[-ARM_DOF:]])
    kg[-1] = max(kg[-1], HAND_KG)
    links_sd = np.outer(kg, (1.0, LEVER_M, LEVER_M, LEVER_M)).ravel()
    return np.concatenate((own, np.zeros(len(links_sd)))), np.concatenate((own_sd, links_sd))


def _step(
    own: Array, links: Array, tau: Array, noise: Array, values: Array, usual: Array, spread: Array
) -> tuple[Array, Array]:
    """Return the numbers that fit best as seen from others, and their covariance."""
    count, width = len(tau), 4 * ARM_DOF
    scale, heavier = values[:width:4], values[width:]
    more = links @ heavier  # of each joint [N·m]
    matrix = np.zeros((count, ARM_DOF, len(values)))
    for joint in range(ARM_DOF):
        matrix[:, joint, 4 * joint : 4 * joint + 4] = own[:, joint]
        matrix[:, joint, 4 * joint] += more[:, joint]
    matrix[:, :, width:] = scale[:, None] * links
    weighted = (matrix / noise[:, None]).reshape(count * ARM_DOF, -1)
    left = ((tau - _efforts(own, links, values)) / noise).ravel()
    covariance: Array = np.asarray(np.linalg.inv(weighted.T @ weighted + np.diag(spread**-2.0)), dtype=np.float64)
    return values + covariance @ (weighted.T @ left + (usual - values) * spread**-2.0), covariance


def _efforts(own: Array, links: Array, values: Array) -> Array:
    """Return the efforts that numbers make, shape (n, 7) [N·m]."""
    width = 4 * ARM_DOF
    mine = np.einsum("njk,jk->nj", own, values[:width].reshape(ARM_DOF, 4))
    efforts: Array = mine + values[:width:4] * (links @ values[width:])
    return efforts


def _alike(left: Array) -> Array:
    """Return how many equations in a row say the same, shape (7,): what is left is friction more than noise."""
    centred = left - left.mean(axis=0)
    reach = range(1, max(2, len(left) // 8))
    together = np.array([np.mean(centred[lag:] * centred[:-lag], axis=0) for lag in reach])
    together /= np.mean(np.square(centred), axis=0) + 1e-12
    alike: Array = 1.0 + 2.0 * np.where(np.cumprod(together > 0.0, axis=0), together, 0.0).sum(axis=0)
    return alike


def _rms(values: Array) -> Array:
    rms: Array = np.sqrt(np.mean(np.square(values), axis=0))
    return rms
