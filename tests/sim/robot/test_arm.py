"""Rules of one simulated arm (§4.3, §4.7, §4.10, §4.13)."""

from __future__ import annotations

import math

import numpy as np
import pytest

from gateway.sim.robot.arm import Drive, SimArm
from gateway.sim.robot.geometry import EePose, arm_geometry
from gateway.sim.robot.journal import Journal
from gateway.sim.robot.manual import LOWER_RAD, MS, UPPER_RAD, S, Side
from gateway.sim.robot.settings import HANGING_RAD, SimSettings

STIFF = SimSettings()
START = np.array(HANGING_RAD[Side.LEFT])


def arm(settings: SimSettings = STIFF, side: Side = Side.LEFT) -> SimArm:
    """An arm without gravity offset."""
    return SimArm(side, settings, Journal())


def follow(sim: SimArm, target, duration_ns: int, step_ns: int = 10 * MS) -> None:
    """Stream a constant target and follow it."""
    for now_ns in range(0, duration_ns, step_ns):
        sim.command_joints(list(target), now_ns)
        sim.set_drive(Drive.FOLLOW)
        sim.move(step_ns)


def test_follows_with_a_first_order_lag():
    """After one time constant 63 % of a step is done, and the velocity is the rest over the time constant."""
    sim = arm()
    sim.command_joints(list(START + 0.1), 0)
    sim.set_drive(Drive.FOLLOW)
    sim.move(40 * MS)
    assert sim.q_rad - START == pytest.approx(np.full(7, 0.1 * (1 - math.exp(-1))))
    assert sim.v_radps == pytest.approx(np.full(7, 0.1 * math.exp(-1) / 0.04))


@pytest.mark.parametrize("drive", [Drive.FOLLOW, Drive.APPROACH, Drive.STILL])
def test_motion_does_not_depend_on_the_step(drive):
    """One long step and many odd ones end at the same place with the same velocity."""
    ends = []
    for step_ns in (300 * MS, 7 * MS, 1 * MS):
        sim = arm(SimSettings(creep_radps=0.01))
        sim.command_joints(list(START + np.array([0.2, -0.1, 0.05, 0.0, 0.02, 0.0, -0.04])), 0)
        sim.set_drive(Drive.FOLLOW)
        sim.move(20 * MS)
        sim.set_drive(drive)
        left_ns = 300 * MS
        while left_ns:
            sim.move(min(step_ns, left_ns))
            left_ns -= min(step_ns, left_ns)
        ends.append((sim.q_rad, sim.v_radps))
    for q, v in ends[1:]:
        assert q == pytest.approx(ends[0][0], abs=1e-12)
        assert v == pytest.approx(ends[0][1], abs=1e-9)


def test_slow_start_approaches_at_half_a_radian_per_second():
    """In SLOW_START the way of 1 rad takes two seconds, whatever the target says at once."""
    sim = arm()
    target = START + np.array([0.0, -1.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    sim.command_joints(list(target), 0)
    sim.set_drive(Drive.APPROACH)
    speeds = []
    for _ in range(200):
        sim.move(10 * MS)
        speeds.append(float(np.max(np.abs(sim.v_radps))))
    assert max(speeds) <= 0.5 + 1e-9
    assert speeds[100] == pytest.approx(0.5, abs=1e-6)
    assert abs(sim.q_rad[1] - target[1]) == pytest.approx(0.5 * 0.04, rel=1e-3)
    sim.move(300 * MS)
    assert sim.deviation_rad < 1e-3


def test_zero_velocity_brakes_and_stays():
    """Under a zero-velocity command the arm comes to rest within some centimetres and does not come back (§4.10)."""
    sim = arm()
    follow(sim, START + 0.3, 50 * MS)
    before = sim.q_rad.copy()
    sim.set_drive(Drive.STILL)
    sim.move(1 * S)
    rest = sim.q_rad.copy()
    assert np.all(rest > before)
    assert np.all(rest < START + 0.3)
    assert np.max(np.abs(sim.v_radps)) < 1e-12
    sim.move(10 * S)
    assert np.array_equal(sim.q_rad, rest)


def test_creep_sinks_an_arm_that_is_not_held():
    """PAUSE is no position hold: with a creep rate the arm sinks slowly (§4.10)."""
    sim = arm(SimSettings(creep_radps=0.001))
    sim.move(2 * S)
    assert sim.q_rad[0] - START[0] == pytest.approx(-0.002)


@pytest.mark.parametrize("compliance_radpnm", [0.0, 1e-3])
def test_gravity_offset_shows_while_following(compliance_radpnm):
    """A held target is missed by what the servos give under gravity, mirrored on the right, and by nothing else."""
    settings = SimSettings(compliance_radpnm=compliance_radpnm)
    for side in Side:
        sim = arm(settings, side)
        follow(sim, HANGING_RAD[side], 1 * S)
        assert sim.q_rad - HANGING_RAD[side] == pytest.approx(settings.sag_rad(side), abs=1e-9)


def test_exactly_seven_values_are_needed():
    """Fewer are refused and leave the target; of more the first seven count."""
    sim = arm()
    assert not sim.command_joints([0.1] * 6, 0)
    assert not sim.command_joints([], 0)
    assert not sim.is_streamed
    assert sim.command_joints([*(START + 0.01), 99.0], 0)
    assert sim.target_rad == pytest.approx(START + 0.01)


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_values_that_are_not_finite_are_refused(value):
    """NaN is refused (§4.10), and so is infinity; neither feeds the stream."""
    sim = arm()
    target = START.copy()
    target[3] = value
    assert not sim.command_joints(target.tolist(), 0)
    assert not sim.is_streamed


@pytest.mark.parametrize("side", Side)
def test_targets_beyond_the_limits_are_clipped_silently(side):
    """Both limits of every joint are kept (§4.13), and only the robot's own counter tells."""
    for offset, limit in ((-9.0, LOWER_RAD[side]), (9.0, UPPER_RAD[side])):
        sim = arm(side=side)
        assert sim.command_joints([offset] * 7, 0)
        assert sim.target_rad.tolist() == list(limit)
        assert sim.clips == 1
    assert sim.command_joints(list(UPPER_RAD[side]), 0)
    assert sim.clips == 1


def test_a_gap_of_more_than_150_ms_ends_the_stream():
    """0.15 s is the longest interval; a nanosecond more is an interruption (§4.10)."""
    sim = arm()
    sim.command_joints(START.tolist(), 0)
    sim.expire(150 * MS)
    assert sim.is_streamed
    sim.expire(150 * MS + 1)
    assert not sim.is_streamed
    assert sim.stream_losses == 1
    sim.set_drive(Drive.FOLLOW)
    assert sim.drive is Drive.STILL


@pytest.mark.parametrize(("silence", "mode"), [("pursues", "pose"), ("pursues", "joint"), ("stops", "pose")])
def test_only_an_arm_in_end_effector_mode_pursues_its_last_pose_in_silence_where_that_was_chosen(silence, mode):
    """The watchdog of §4.3 is one of joint commands; §4.2 has none. PAUSE ends it all the same."""
    sim = arm(SimSettings(lag_s=0.05, left_mode=mode, pose_silence=silence))
    goal = sim.q_rad + 0.1
    if mode == "pose":
        assert sim.command_pose(arm_geometry(Side.LEFT).forward(goal), 0)
    else:
        assert sim.command_joints(goal, 0)
    target = sim.target_rad
    sim.set_drive(Drive.FOLLOW)
    sim.move(50 * MS)
    sim.expire(1 * S)
    sim.set_drive(Drive.FOLLOW)
    assert (sim.drive is Drive.FOLLOW) is sim.is_streamed is (silence == "pursues" and mode == "pose")
    sim.move(1 * S)
    assert np.allclose(sim.q_rad, target, atol=1e-3) == sim.is_streamed
    sim.set_drive(Drive.STILL)
    assert sim.drive is Drive.STILL


@pytest.mark.parametrize("reason", ["disabled", "blocked", "silent"])
def test_only_an_enabled_free_and_commanded_arm_follows(reason):
    """Otherwise the motors get zero velocity, whatever the state machine allows."""
    sim = arm()
    if reason != "silent":
        sim.command_joints(START.tolist(), 0)
    sim.is_enabled = reason != "disabled"
    sim.is_blocked = reason == "blocked"
    sim.set_drive(Drive.FOLLOW)
    assert sim.drive is Drive.STILL


def test_start_takes_the_present_pose_as_target_unless_a_stream_says_otherwise():
    """With no target yet the target is the pose at enabling; a living stream's target is kept (§4.7)."""
    sim = arm()
    follow(sim, START + 0.2, 60 * MS)
    sim.drop_stream()
    sim.start()
    assert sim.deviation_rad == 0.0
    sim.command_joints((START + 0.2).tolist(), 0)
    sim.start()
    assert sim.deviation_rad > 0.01


def test_pose_command_is_followed_through_the_robots_own_ik():
    """A pose near by becomes joint angles that have this pose (§4.2)."""
    sim = arm()
    wanted = arm_geometry(Side.LEFT).forward(START + 0.05)
    assert sim.command_pose(wanted, 0)
    assert arm_geometry(Side.LEFT).forward(sim.target_rad).position_m == pytest.approx(wanted.position_m, abs=1e-4)


@pytest.mark.parametrize(
    "pose",
    [
        EePose(position_m=(2.0, 0.0, 0.0), quat_xyzw=(0.0, 0.0, 0.0, 1.0)),
        EePose(position_m=(math.nan, 0.0, 0.0), quat_xyzw=(0.0, 0.0, 0.0, 1.0)),
        EePose(position_m=(0.1, 0.1, -0.4), quat_xyzw=(0.0, 0.0, 0.0, 0.0)),
        EePose(position_m=(0.1, 0.1, -0.4), quat_xyzw=(math.inf, 0.0, 0.0, 1.0)),
    ],
)
def test_invalid_ik_protects_with_zero_velocity_until_a_valid_target(pose):
    """An invalid IK result is not passed on; the arm stands until the next valid target (§4.10)."""
    sim = arm()
    good = arm_geometry(Side.LEFT).forward(START)
    assert sim.command_pose(good, 0)
    before = sim.target_rad
    assert not sim.command_pose(pose, 10 * MS)
    sim.set_drive(Drive.FOLLOW)
    assert sim.drive is Drive.STILL
    assert sim.target_rad is before
    assert sim.command_pose(good, 20 * MS)
    sim.set_drive(Drive.FOLLOW)
    assert sim.drive is Drive.FOLLOW
