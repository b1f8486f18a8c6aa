"""Paths as functions of their own time: leads, trajectories, ends; and the checks of goals and speeds."""

from __future__ import annotations

import math

import pytest
from ruckig import InputParameter, Ruckig, Trajectory

from gateway.core.motion.joints.braking import Braking, JointLimits
from gateway.core.motion.joints.path import REST, Path, PlanFailed, Start, check_entry, check_goal, check_speed

LIMITS = JointLimits(
    v_radps=1.0,
    a_radps2=3.0,
    j_radps3=20.0,
    lower_rad=(-1.8, 0.0, -2.6, 0.25, -1.8, -1.4, -0.7),
    upper_rad=(1.8, 1.9, 1.3, 2.2, 1.8, 1.4, 0.7),
)
BRAKING = Braking(LIMITS, 0.01)
HOME = (0.41, 1.16, -0.47, 0.90, 0.23, -0.15, 0.60)
MOVING = Start(
    q_rad=HOME,
    dq_radps=(0.8, -0.8, 0.2, 0.0, 0.0, 0.0, 0.0),
    ddq_radps2=(0.0, 0.0, 2.0, 0.0, 0.0, 0.0, 0.0),
    braking=BRAKING,
)
RESTING = Start(q_rad=HOME, dq_radps=REST, ddq_radps2=REST, braking=BRAKING)


# ------------------------------------------------------------------------------------------------------- checks


def test_a_goal_inside_the_limits_passes_as_a_tuple():
    """Both ends of the range are inside."""
    assert check_goal("left arm", list(LIMITS.lower_rad), LIMITS) == LIMITS.lower_rad
    assert check_goal("left arm", LIMITS.upper_rad, LIMITS) == LIMITS.upper_rad


@pytest.mark.parametrize("goal", [(), (0.0,), (0.5,) * 6, (0.5,) * 8])
def test_a_goal_of_another_length_is_refused(goal):
    """It is ruckig that would take it without a word, and drive the missing joints anywhere."""
    with pytest.raises(PlanFailed, match=f"left arm position has {len(goal)} values, 7 are needed") as failed:
        check_goal("left arm", goal, LIMITS)
    assert (failed.value.joint, failed.value.bound) == ("", "") and math.isnan(failed.value.value)


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_a_goal_that_is_not_finite_is_refused(value):
    """With the element."""
    with pytest.raises(PlanFailed, match=rf"left arm position\[2\] is {value}"):
        check_goal("left arm", (*HOME[:2], value, *HOME[3:]), LIMITS)


@pytest.mark.parametrize(("index", "value"), [(3, 0.25 - 1e-12), (3, 2.2000001), (6, 5.0)])
def test_a_goal_outside_the_limits_is_refused_with_joint_value_and_bound(index, value):
    """However little it is outside."""
    with pytest.raises(PlanFailed) as failed:
        check_goal("left arm", (*HOME[:index], value, *HOME[index + 1 :]), LIMITS)
    bound = f"[{LIMITS.lower_rad[index]}, {LIMITS.upper_rad[index]}]"
    assert (failed.value.joint, failed.value.value, failed.value.bound) == (f"left arm joint {index + 1}", value, bound)
    assert str(failed.value) == f"left arm joint {index + 1}: {value} rad is outside {bound} rad"


@pytest.mark.parametrize("speed", [0.0, -0.5, 1.0001, math.nan, math.inf])
def test_a_speed_that_is_no_factor_is_refused(speed):
    """A factor is above 0 and at most 1."""
    with pytest.raises(PlanFailed, match=r"speed is .*, a factor in \(0, 1\] is needed"):
        check_speed(speed)


def test_a_factor_passes():
    """Up to 1."""
    assert (check_speed(1.0), check_speed(0.01)) == (1.0, 0.01)


# ------------------------------------------------------------------------------------------------------ slowing


def test_an_arm_knows_whether_it_rests_and_whether_it_is_too_fast():
    """Joint 3 is bound for 0.3 rad/s: 0.2 now, and 2²/(2·20) before its acceleration is gone."""
    assert RESTING.is_at_rest and not MOVING.is_at_rest
    assert not Start(q_rad=HOME, dq_radps=REST, ddq_radps2=MOVING.ddq_radps2, braking=BRAKING).is_at_rest
    assert MOVING.is_over(0.79) and not MOVING.is_over(0.8)
    slow = Start(q_rad=HOME, dq_radps=(0.0, 0.0, 0.2, *REST[3:]), ddq_radps2=MOVING.ddq_radps2, braking=BRAKING)
    assert slow.is_over(0.29) and not slow.is_over(0.31)


def test_slowing_ends_at_velocities_within_the_limit():
    """Each joint on its own: two slow down, one keeps what it is bound for, four do not move."""
    slowing = MOVING.slow(0.4)
    assert slowing.at(0.0) == (MOVING.q_rad, MOVING.dq_radps, MOVING.ddq_radps2)
    q_rad, dq_radps, ddq_radps2 = slowing.at(slowing.duration_s)
    assert dq_radps == pytest.approx((0.4, -0.4, 0.3, 0.0, 0.0, 0.0, 0.0))
    assert ddq_radps2 == REST
    assert q_rad[3:] == HOME[3:]


def test_slowing_to_nothing_is_a_stop():
    """All velocities are exactly 0 at its end, which is where each joint's own stop ends."""
    stop = MOVING.slow(0.0)
    q_rad, dq_radps, ddq_radps2 = stop.at(stop.duration_s)
    assert (dq_radps, ddq_radps2) == (REST, REST)
    joints = zip(MOVING.q_rad, MOVING.dq_radps, MOVING.ddq_radps2, strict=True)
    assert q_rad == pytest.approx([BRAKING.rest(*joint) for joint in joints], abs=1e-14)


# -------------------------------------------------------------------------------------------------------- paths


def trajectory_to(start_rad, goal_rad) -> Trajectory:
    """From rest to rest, for two arms: the other one stays."""
    entry, trajectory = InputParameter(14), Trajectory(14)
    entry.current_position, entry.target_position = [0.0] * 7 + list(start_rad), [0.0] * 7 + list(goal_rad)
    entry.max_velocity, entry.max_acceleration, entry.max_jerk = [1.0] * 14, [3.0] * 14, [20.0] * 14
    Ruckig(14).calculate(entry, trajectory)
    return trajectory


def test_a_path_is_its_arms_part_of_the_trajectory_and_ends_at_rest():
    """The second arm of a plan reads joints 8 to 14, and from the duration on exactly its end."""
    goal = (0.0, 1.0, 0.0, 0.5, 0.0, 0.0, 0.0)
    trajectory = trajectory_to(HOME, goal)
    path = Path(
        start=RESTING,
        lead=None,
        lead_s=0.0,
        trajectory=trajectory,
        first=7,
        duration_s=trajectory.duration,
        end_rad=goal,
    )
    assert path.duration_ns == round(trajectory.duration * 1e9)
    assert path.at(0.0) == (HOME, REST, REST)
    assert path.at(0.3) == tuple(tuple(column[7:]) for column in trajectory.at_time(0.3))
    assert path.at(trajectory.duration) == (goal, REST, REST)
    assert path.at(trajectory.duration + 5.0) == (goal, REST, REST)


def test_a_lead_comes_before_the_trajectory_and_joins_it():
    """Until `lead_s` the joints slow down; then the trajectory begins where they are."""
    stop = MOVING.slow(0.0)
    rest_rad = stop.at(stop.duration_s)[0]
    trajectory = trajectory_to(rest_rad, HOME)
    lead_s = stop.duration_s + 0.1  # the other arm needs longer
    duration_s = lead_s + trajectory.duration
    path = Path(
        start=MOVING, lead=stop, lead_s=lead_s, trajectory=trajectory, first=7, duration_s=duration_s, end_rad=HOME
    )
    assert path.at(0.1) == stop.at(0.1)
    assert path.at(lead_s - 1e-9)[0] == pytest.approx(path.at(lead_s)[0], abs=1e-12)
    assert path.at(lead_s) == (rest_rad, REST, REST)
    assert path.at(duration_s) == (HOME, REST, REST)


# ------------------------------------------------------------------------------------------------------- entries


def test_a_moving_state_inside_all_limits_is_an_entry():
    """As it is, in tuples; the velocity limit itself is inside."""
    v, a = (1.0, *MOVING.dq_radps[1:]), list(MOVING.ddq_radps2)
    assert check_entry(list(HOME), v, a, BRAKING) == (HOME, v, MOVING.ddq_radps2)


@pytest.mark.parametrize(
    ("q", "v", "a", "why"),
    [
        ((0.0,) * 6, REST, REST, "entry position has 6 values"),
        ((9.0, *HOME[1:]), REST, REST, "outside"),
        (HOME, REST[:6], REST, "entry velocity has 6 values"),
        (HOME, REST, (math.nan, *REST[1:]), "entry acceleration"),
        (HOME, (*REST[:2], -1.1, *REST[3:]), REST, "entry joint 3: too fast"),
        (HOME, REST, (*REST[:6], 3.1), "entry joint 7: accelerates"),
        ((1.79, *HOME[1:]), (0.9, *REST[1:]), REST, "entry joint 1: cannot stop inside"),
    ],
)
def test_a_state_that_cannot_be_gone_on_with_is_refused(q, v, a, why):
    """Each limit alone; braking must end inside the position limits as well."""
    with pytest.raises(PlanFailed, match=why):
        check_entry(q, v, a, BRAKING)
