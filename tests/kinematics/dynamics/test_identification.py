"""Dynamics found from motion in the simulation with forces, whose masses, friction and efforts are 5 to 10 % off."""

from __future__ import annotations

import numpy as np
import pytest

from tests.changed import replace

REASON = "pinocchio or MuJoCo is not installed: pip install 'teleavatar-gateway[body,sim]'"
pytest.importorskip("pinocchio", reason=REASON)
pytest.importorskip("mujoco", reason=REASON)

from gateway.kinematics.description import nominal
from gateway.kinematics.dynamics.arm_dynamics import ArmDynamics
from gateway.kinematics.dynamics.identification import Found, Motion, TooLittle, identify_dynamics
from gateway.kinematics.dynamics.observer import MomentumObserver
from gateway.kinematics.dynamics.parameters import nominal_parameters
from tests.kinematics.dynamics.swung import LEFT, VISCOUS, exciting, swung


def identified(motion):
    """What is found of the left arm."""
    return identify_dynamics(nominal(), LEFT, motion, "robot.json")


@pytest.fixture(scope="module")
def found() -> Found:
    """Of a motion that tells."""
    result = identified(swung().motion)
    assert isinstance(result, Found), result
    return result


def test_less_than_a_twentieth_of_the_range_of_effort_is_left_on_motion_that_was_not_fitted(found):
    """Several times less than with the nominal numbers."""
    assert (found.after_nm < 0.05 * found.range_nm).all()
    assert (found.after_nm < 0.5 * found.before_nm).all()


def test_what_differs_is_found_within_what_is_said_of_it(found):
    """Scale within three standard deviations, and these are small; friction within a third, as a smooth sign has it."""
    off = (np.array(found.drives.scale) - swung().scale) / found.sd["scale"]
    assert np.abs(off).max() < 3.0 and found.sd["scale"].max() < 0.1
    assert np.array(found.drives.coulomb_nm) == pytest.approx(swung().coulomb_nm, rel=0.35)
    assert np.array(found.drives.viscous_nmsprad) == pytest.approx(VISCOUS, abs=0.3)
    assert found.drives.source == "robot.json" and found.condition.max() < 10.0


def test_an_identified_arm_feels_less_that_is_not_there(found):
    """Along the same free motion, the observer's torques are a third of the nominal ones, within fewer newtons metre."""
    motion, worst = swung().motion, {}
    for drives in (nominal_parameters(nominal(), LEFT), found.drives):
        observer, felt = MomentumObserver(ArmDynamics(nominal(), LEFT, drives)), []
        rows = zip(motion.at_s, motion.q_rad, motion.dq_radps, motion.tau_nm, strict=True)
        for at_s, q, dq, tau in rows:
            observer.update(round(1e9 * at_s) + 1, *(tuple(row.tolist()) for row in (q, dq, tau)))
            felt.append(observer.torque_nm)
        worst[drives.source] = np.sqrt(np.mean(np.square(felt[100:]), axis=0))
        sd = np.sqrt(observer.variance_nm2())
        worst[f"{drives.source} sd"] = sd
    assert (worst["robot.json"] < 0.6 * worst["nominal"]).all()
    assert (worst["robot.json sd"] < worst["nominal sd"]).all()


def test_a_rest_before_and_behind_the_motion_changes_nothing(found):
    """Friction holds a resting arm wherever it likes: what is reported there is no part of it, of no range, of no remainder."""
    motion = swung().motion
    marks = [0] * 800 + list(range(len(motion.at_s))) + [-1] * 1500
    q, dq, tau = (getattr(motion, name)[marks] for name in ("q_rad", "dq_radps", "tau_nm"))
    stands = np.diff(marks, prepend=0) == 0
    dq[stands] = 0.0
    tau[stands] += 0.5 * swung().coulomb_nm
    rested = identified(Motion(at_s=0.01 * np.arange(len(marks)), q_rad=q, dq_radps=dq, tau_nm=tau))
    assert isinstance(rested, Found) and (rested.after_nm < 0.05 * rested.range_nm).all()
    assert np.array(rested.drives.scale) == pytest.approx(np.array(found.drives.scale), abs=0.01)


def cut(seconds, **changes):
    """A part of the motion, changed."""
    motion, count = swung().motion, round(100 * seconds)
    rows = {name: getattr(motion, name)[:count].copy() for name in ("at_s", "q_rad", "dq_radps", "tau_nm")}
    return replace(Motion(**rows), **changes)


def still(joint):
    """A motion in which one joint stands."""
    motion = cut(40.0)
    motion.q_rad[:, joint], motion.dq_radps[:, joint] = 0.5, 0.0
    return motion


def deaf():
    """A motion in which a joint reports no effort."""
    motion = cut(40.0)
    motion.tau_nm[:, 2] = 0.0
    return motion


def resting():
    """A motion of 10 s, the first 0.3 s of them slower than anything is told, and half a minute of rest behind it."""
    motion = cut(40.0)
    motion.dq_radps[1000:] = 0.0
    return motion


def gone():
    """A motion with a hole of half a second."""
    motion = cut(40.0)
    motion.at_s[2000:] += 0.5
    return motion


def steady():
    """A joint that only ever turns at one speed: friction and load cannot be told from each other."""
    motion, t = cut(40.0), 0.01 * np.arange(4000)
    motion.q_rad[:, 0], motion.dq_radps[:, 0] = -1.0 + 0.05 * t[: len(motion.at_s)], 0.05
    return motion


@pytest.mark.parametrize(
    ("motion", "words"),
    [
        (lambda: cut(10.0), "9.7 s of motion is too short"),
        (resting, "9.7 s of motion is too short"),
        (lambda: cut(0.0), "0.0 s of motion is too short"),
        (lambda: still(6), "joint 7 moved through 0.00 rad"),
        (deaf, "no effort"),
        (gone, "a gap of 0.51 s"),
        (steady, "joint 1 moved so that load, friction and rotor look alike"),
    ],
)
def test_a_motion_that_cannot_tell_is_refused_with_what_to_do(motion, words):
    """No numbers are made up."""
    result = identified(motion())
    assert isinstance(result, TooLittle) and words in result.message and result.hint


def test_the_exciting_motion_says_beforehand_how_well_it_tells(found):
    """Its condition number is about that of what was measured."""
    assert exciting().condition == pytest.approx(found.condition.max(), rel=0.5)
