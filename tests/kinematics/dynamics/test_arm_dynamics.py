"""Dynamics of an arm against pinocchio's own numbers, of the whole body, and against MuJoCo's."""

from __future__ import annotations

import pickle

import numpy as np
import pytest

pin = pytest.importorskip("pinocchio", reason="pinocchio is not installed: pip install 'teleavatar-gateway[body]'")

from gateway.kinematics.arm import ArmModel
from gateway.kinematics.description import arm_joint, nominal
from gateway.kinematics.dynamics.arm_dynamics import ArmDynamics
from gateway.kinematics.dynamics.parameters import ARMATURE_KGM2, DriveParameters, Load
from gateway.kinematics.pin_model import pin_model
from gateway.robot.limits import JOINT_LOWER_RAD, JOINT_UPPER_RAD
from gateway.values import Side

EXACT = 1e-9


def arm(side, armature=0.0):
    """An arm of our numbers."""
    return ArmDynamics(nominal(), side, DriveParameters(armature_kgm2=(armature,) * 7))


def moving(side, count, seed=0):
    """Yield postures, velocities and accelerations."""
    rng = np.random.default_rng(seed)
    low, high = np.array(JOINT_LOWER_RAD[side]), np.array(JOINT_UPPER_RAD[side])
    for _ in range(count):
        yield rng.uniform(low, high), rng.uniform(-3.0, 3.0, 7), rng.uniform(-15.0, 15.0, 7)


class Whole:
    """The whole body as pinocchio has it, both arms and wheels, the base fixed."""

    def __init__(self, side):
        self.model = pin_model(nominal())
        self.data = self.model.createData()
        index = [self.model.getJointId(arm_joint(side, number)) for number in range(1, 8)]
        self.at = np.array([self.model.joints[number].idx_v for number in index])

    def full(self, values):
        """Return coordinates of all joints, zero but for the arm's."""
        vector = np.zeros(self.model.nv)
        vector[self.at] = values
        return vector


@pytest.mark.parametrize("side", Side)
def test_numbers_are_pinocchios_own(side):
    """Gravity, torques of a motion and momentum, of the whole body, to 1e-9."""
    ours, whole = arm(side), Whole(side)
    model, data, at = whole.model, whole.data, whole.at
    for q_rad, dq, ddq in moving(side, 50):
        q, v, a = whole.full(q_rad), whole.full(dq), whole.full(ddq)
        masses = pin.crba(model, data, q)[np.ix_(at, at)].copy()
        assert ours.gravity(q_rad) == pytest.approx(pin.computeGeneralizedGravity(model, data, q)[at], abs=EXACT)
        assert ours.torques(q_rad, dq, ddq) == pytest.approx(pin.rnea(model, data, q, v, a)[at], abs=EXACT)
        terms = ours.terms(q_rad, dq)
        change = pin.computeCoriolisMatrix(model, data, q, v).T @ v
        assert terms.momentum_nms == pytest.approx(masses @ dq, abs=EXACT)
        assert terms.drift_nm == pytest.approx(change[at] - ours.gravity(q_rad), abs=EXACT)
        assert terms.gravity_nm == pytest.approx(ours.gravity(q_rad), abs=EXACT)


@pytest.mark.parametrize("side", Side)
def test_the_jacobian_is_that_of_our_own_kinematics(side):
    """In the shoulder's axes, at the end effector: one frame for poses and wrenches."""
    ours, kinematics = arm(side), ArmModel(nominal(), side)
    assert (ours.frame, ours.point) == (f"{side.value}_shoulder_base", f"{side.value}_ee")
    for q_rad, _, _ in moving(side, 20):
        assert ours.jacobian(q_rad) == pytest.approx(np.array(kinematics.jacobian(tuple(q_rad))), abs=EXACT)


def test_rotors_are_inertia_of_their_joint_alone():
    """In momentum and torques."""
    bare, with_rotors = arm(Side.LEFT), arm(Side.LEFT, ARMATURE_KGM2)
    for q_rad, dq, ddq in moving(Side.LEFT, 5):
        torque = with_rotors.torques(q_rad, dq, ddq) - bare.torques(q_rad, dq, ddq)
        assert torque == pytest.approx(ARMATURE_KGM2 * ddq, abs=EXACT)
        momentum = with_rotors.terms(q_rad, dq).momentum_nms - bare.terms(q_rad, dq).momentum_nms
        assert momentum == pytest.approx(ARMATURE_KGM2 * dq, abs=EXACT)


@pytest.mark.parametrize("side", Side)
def test_the_momentum_changes_by_what_drives_and_weights_do_on_a_base_that_moves(side):
    """dp/dt = tau + drift along a motion of arm, chassis and lift together, by differences in time."""
    ours, h = arm(side, ARMATURE_KGM2), 1e-6
    base, accelerates = np.array([0.4, -0.3, 0.8, 0.2]), np.array([0.5, 0.7, -0.6, 0.9])
    for q_rad, dq, ddq in moving(side, 10):

        def momentum(t, q_rad=q_rad, dq=dq, ddq=ddq):
            # The base's own axes: they turn with the yaw, and so does what it is driven at in them.
            turn = base[2] * t
            c, s = np.cos(turn), np.sin(turn)
            x, y = base[:2] + accelerates[:2] * t
            seen = (c * x + s * y, -s * x + c * y, base[2] + accelerates[2] * t, base[3] + accelerates[3] * t)
            return ours.terms(q_rad + dq * t + 0.5 * ddq * t * t, dq + ddq * t, seen).momentum_nms

        change = (momentum(h) - momentum(-h)) / (2.0 * h)
        torque = ours.torques(q_rad, dq, ddq, tuple(base), tuple(accelerates))
        drift = ours.terms(q_rad, dq, tuple(base)).drift_nm
        assert change == pytest.approx(torque + drift, abs=1e-4)


def test_a_lift_that_falls_makes_the_arm_weightless():
    """Downwards is positive, as the description has it."""
    ours = arm(Side.LEFT)
    q_rad = next(moving(Side.LEFT, 1))[0]
    torque = ours.torques(q_rad, np.zeros(7), np.zeros(7), (), (0.0, 0.0, 0.0, 9.81))
    assert torque == pytest.approx(0.0, abs=1e-9) and np.abs(ours.gravity(q_rad)).max() > 0.5


@pytest.mark.parametrize("side", Side)
def test_mujoco_says_the_same_of_the_same_masses(side):
    """Torques of a motion on a base that moves and turns; the hand's moving parts, which nobody published, apart."""
    mujoco = pytest.importorskip("mujoco", reason="MuJoCo is not installed: pip install 'teleavatar-gateway[sim]'")
    from gateway.sim.physics.world import World

    world, ours = World(has_lift=True), arm(side)
    model, data = world.model, world.data
    for number in range(model.nbody):
        name = model.body(number).name
        if any(part in name for part in ("rotor", "crank", "coupler", "finger")):
            model.body_mass[number], model.body_inertia[number] = 1e-12, 1e-15
    first = model.joint(arm_joint(side, 1)).id
    qpos, qvel = model.jnt_qposadr[first], model.jnt_dofadr[first]
    given = [(model.jnt_qposadr[i], model.jnt_dofadr[i]) for i in (model.joint(n).id for n in BASE)]
    base, accelerates = (0.4, -0.3, 0.8, 0.2), (0.5, 0.7, -0.6, 0.9)
    for q_rad, dq, ddq in moving(side, 20):
        data.qpos[qpos : qpos + 7], data.qvel[qvel : qvel + 7], data.qacc[:] = q_rad, dq, 0.0
        data.qacc[qvel : qvel + 7] = ddq
        for (at, dof), speed, faster in zip(given, base, accelerates, strict=True):
            data.qpos[at], data.qvel[dof], data.qacc[dof] = 0.0, speed, faster
        data.qpos[given[3][0]] = 0.31
        mujoco.mj_fwdPosition(model, data)
        mujoco.mj_fwdVelocity(model, data)
        found = np.zeros(model.nv)
        mujoco.mj_rne(model, data, 1, found)
        assert ours.torques(q_rad, dq, ddq, base, accelerates) == pytest.approx(found[qvel : qvel + 7], abs=1e-6)


BASE = ("base_x", "base_y", "base_yaw", "lift")


@pytest.mark.parametrize("side", Side)
def test_a_load_is_a_point_in_the_hand(side):
    """Its weight as its columns say, its momentum as the Jacobian of where it is; a copy has it too; None takes it away."""
    bare, loaded, load = arm(side), arm(side), Load(mass_kg=0.4, com_m=(0.15, 0.02, -0.03))
    loaded.carry(load)
    moments = load.mass_kg * np.array((1.0, *load.com_m))
    kinematics = ArmModel(nominal(), side)
    for q_rad, dq, _ in moving(side, 10):
        weight = loaded.gravity(q_rad) - bare.gravity(q_rad)
        assert weight == pytest.approx(-loaded.load_columns(q_rad) @ moments, abs=EXACT)
        shoulder_R_ee = rotation(kinematics.forward(tuple(q_rad)).quat_xyzw)
        turning, lever = bare.jacobian(q_rad), shoulder_R_ee @ load.com_m
        point = turning[:3] - np.cross(lever, turning[3:].T).T
        momentum = loaded.terms(q_rad, dq).momentum_nms - bare.terms(q_rad, dq).momentum_nms
        assert momentum == pytest.approx(load.mass_kg * point.T @ (point @ dq), abs=EXACT)
        assert pickle.loads(pickle.dumps(loaded)).gravity(q_rad) == pytest.approx(loaded.gravity(q_rad), abs=0.0)
    loaded.carry(None)
    assert loaded.load is None and loaded.gravity(q_rad) == pytest.approx(bare.gravity(q_rad), abs=0.0)


def rotation(quat_xyzw):
    """Return the rotation matrix of a quaternion."""
    return pin.Quaternion(np.array(quat_xyzw)).toRotationMatrix()
