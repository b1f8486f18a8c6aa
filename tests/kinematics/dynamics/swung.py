"""An arm in the simulation with forces that is another one than described, swung along an exciting motion, in virtual time."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import mujoco
import numpy as np

from gateway.kinematics.capsules import hull
from gateway.kinematics.collision import CollisionModel
from gateway.kinematics.description import arm_joint, nominal
from gateway.kinematics.dynamics.arm_dynamics import ArmDynamics
from gateway.kinematics.dynamics.excitation import DT_S, Excitation, excite
from gateway.kinematics.dynamics.identification import Motion
from gateway.kinematics.dynamics.parameters import DriveParameters
from gateway.robot.limits import HOME_Q_RAD
from gateway.settings.settings import Settings
from gateway.sim.physics.world import World
from gateway.sim.robot.manual import Side as SimSide
from gateway.values import Side

__all__ = ["LEFT", "Other", "exciting", "swung"]

LEFT = Side.LEFT
VISCOUS = 0.2
NOISE_NM = 0.05


@dataclass(frozen=True)
class Other:
    """An arm whose masses, friction and efforts are 5 to 10 % off, and how it swung.

    Attributes:
        motion: As measured, 100 times a second, with noise.
        scale: Torque per effort.
        coulomb_nm: Friction.
    """

    motion: Motion
    scale: np.ndarray
    coulomb_nm: np.ndarray


def gap_m(body, q):
    """What is free between the body's parts, the right arm at home."""
    return body.posture({**HOME_Q_RAD, LEFT: tuple(q.tolist())}).nearest().gap_m


@cache
def exciting() -> Excitation:
    """The left arm's, clear of the body by 5 cm."""
    arm, limits, body = (
        ArmDynamics(nominal(), LEFT, DriveParameters()),
        Settings().arm,
        CollisionModel(nominal(), hull()),
    )
    lower, upper = (np.array(side[LEFT]) for side in (limits.lower_rad, limits.upper_rad))
    found = excite(lower, upper, limits.v_radps, limits.a_radps2, arm.torques, lambda q: gap_m(body, q) > 0.05)
    assert found is not None
    return found


@cache
def swung(seed: int = 4) -> Other:
    """Let it swing."""
    rng, world, sim = np.random.default_rng(seed), World(has_lift=False), SimSide.LEFT
    model = world.model
    off = [1.0 + rng.uniform(0.05, 0.1, 7) * rng.choice([-1.0, 1.0], 7) for _ in range(3)]
    coulomb = []
    for number in range(1, 8):
        joint = model.joint(arm_joint(LEFT, number)).id
        body, dof = model.jnt_bodyid[joint], model.jnt_dofadr[joint]
        model.body_mass[body] *= off[0][number - 1]
        model.body_inertia[body] *= off[0][number - 1]
        model.dof_frictionloss[dof] *= off[1][number - 1]
        model.dof_damping[dof] += VISCOUS
        coulomb.append(model.dof_frictionloss[dof])
    mujoco.mj_setConst(model, world.data)
    path, scale, rows = exciting().q_rad, off[2], []
    world.pose_base(-2.0)  # away from the table
    world.pose_arm(sim, path[0])
    world.pose_arm(SimSide.RIGHT, np.array(HOME_Q_RAD[Side.RIGHT]))
    world.drive(SimSide.RIGHT, np.array(HOME_Q_RAD[Side.RIGHT]))
    times = np.arange(0.0, DT_S * (len(path) - 1), 0.002)
    points = DT_S * np.arange(len(path))
    finely = np.stack([np.interp(times, points, column) for column in path.T], axis=1)
    for number, at in enumerate(
        finely
    ):  # a robot fills in between setpoints; steps would show as a friction of their own
        world.drive(sim, at)
        world.step()
        if number % 5 == 0:
            q, dq, torque = world.arm(sim)
            noise = rng.normal(0.0, 1.0, (3, 7))
            rows.append((q + 2e-4 * noise[0], dq + 2e-3 * noise[1], torque / scale + NOISE_NM * noise[2]))
    q, dq, tau = (np.array(column) for column in zip(*rows, strict=True))
    return Other(
        motion=Motion(at_s=0.01 * np.arange(len(q)), q_rad=q, dq_radps=dq, tau_nm=tau),
        scale=scale,
        coulomb_nm=np.array(coulomb),
    )
