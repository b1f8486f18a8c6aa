"""Rules of one simulated gripper (§4.4)."""

from __future__ import annotations

import math

import pytest

from gateway.sim.robot.gripper import OPEN_RAD, SimGripper, torque_nm
from gateway.sim.robot.journal import Journal
from gateway.sim.robot.manual import GRIPPER_TORQUE_NM, MS, S, Side
from gateway.sim.robot.settings import SimSettings


def gripper(**settings) -> SimGripper:
    """A left gripper."""
    return SimGripper(Side.LEFT, SimSettings(**settings), Journal())


def gripping(level: float, **settings) -> SimGripper:
    """A gripper whose arm is commanded and started at time 0."""
    sim = gripper(**settings)
    sim.command(level, 0)
    sim.arm_commanded(0)
    sim.engage(is_started=True, is_paused=False, is_enabled=True)
    return sim


@pytest.mark.parametrize(("level", "torque"), GRIPPER_TORQUE_NM)
def test_torque_follows_the_table(level, torque):
    """Each row of the manual's table holds exactly."""
    assert torque_nm(level) == pytest.approx(torque)


def test_torque_is_linear_between_the_rows():
    """Half way between two rows the torque is half way too."""
    assert torque_nm(0.025) == pytest.approx(1.5)
    assert torque_nm(0.775) == pytest.approx(-1.2)


def test_low_input_opens_and_high_input_closes():
    """0.0 turns the motor to the open end and 1.0 to the closed end; the motor angle grows opening."""
    for level, end in ((0.0, OPEN_RAD), (1.0, 0.0)):
        sim = gripping(level)
        sim.move(5 * S)
        assert sim.angle_rad == end
        assert sim.v_radps == 0.0
        assert sim.effort_nm == torque_nm(level)


def test_speed_shows_while_it_turns():
    """While it opens the motor speed is positive, while it closes negative."""
    for level, sign in ((0.0, 1.0), (1.0, -1.0)):
        sim = gripping(level)
        sim.move(10 * MS)
        assert math.copysign(1.0, sim.v_radps) == sign


def test_an_object_stops_the_fingers_and_feels_the_torque():
    """Closing on an object stops at it, with the torque still applied; opening is free."""
    sim = gripping(0.8, left_object_rad=0.3)
    sim.move(5 * S)
    assert (sim.angle_rad, sim.v_radps) == (0.3, 0.0)
    assert sim.effort_nm < -1.0
    sim.command(0.0, 0)
    sim.move(5 * S)
    assert sim.angle_rad == OPEN_RAD


@pytest.mark.parametrize("level", [-0.01, 1.01, math.nan, math.inf])
def test_an_illegal_input_is_refused_and_the_last_one_kept(level):
    """Only finite values in [0, 1] are legal."""
    sim = gripping(0.8)
    assert not sim.command(level, 0)
    assert sim.level_01 == 0.8


def test_the_last_input_stays_while_the_arms_stream_lives():
    """Ending the gripper's own messages changes nothing."""
    sim = gripping(0.8)
    for now_ns in range(0, 10 * S, 100 * MS):
        sim.expire(now_ns)
        sim.arm_commanded(now_ns)
        sim.engage(is_started=True, is_paused=False, is_enabled=True)
        assert sim.effort_nm == torque_nm(0.8)


def test_torque_is_cancelled_100_ms_after_the_arms_stream_ends():
    """Exactly 100 ms is in time; a nanosecond more cancels the torque, and the gripper stays where it is."""
    sim = gripping(0.8)
    sim.move(50 * MS)
    where = sim.angle_rad
    sim.expire(100 * MS)
    sim.engage(is_started=True, is_paused=False, is_enabled=True)
    assert sim.is_engaged
    sim.expire(100 * MS + 1)
    sim.engage(is_started=True, is_paused=False, is_enabled=True)
    assert sim.effort_nm == 0.0
    sim.move(1 * S)
    assert (sim.angle_rad, sim.v_radps) == (where, 0.0)


def test_an_old_input_returns_with_the_arms_stream():
    """The robot may still hold an older value: a new arm stream brings its torque back."""
    sim = gripping(0.8)
    sim.expire(1 * S)
    sim.engage(is_started=True, is_paused=False, is_enabled=True)
    assert sim.effort_nm == 0.0
    sim.arm_commanded(2 * S)
    sim.engage(is_started=True, is_paused=False, is_enabled=True)
    assert sim.effort_nm == torque_nm(0.8)


def test_nothing_is_applied_before_the_first_start():
    """The arm must be enabled and controlled (§4.1): in a first PAUSE the stream alone does not grip."""
    sim = gripper()
    sim.command(0.8, 0)
    sim.arm_commanded(0)
    sim.engage(is_started=False, is_paused=True, is_enabled=True)
    assert sim.effort_nm == 0.0


@pytest.mark.parametrize("survives", [True, False])
def test_grip_in_pause_is_a_choice(survives):
    """§4.4 ties the torque to the arm's stream only; the careful reading of §4.1 can be chosen."""
    sim = gripping(0.8, grip_survives_pause=survives)
    sim.engage(is_started=False, is_paused=True, is_enabled=True)
    assert sim.is_engaged is survives


def test_a_disabled_arm_has_no_grip():
    """Switching the arm off takes the torque away."""
    sim = gripping(0.8)
    sim.engage(is_started=True, is_paused=False, is_enabled=False)
    assert sim.effort_nm == 0.0
