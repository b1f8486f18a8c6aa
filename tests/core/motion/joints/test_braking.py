"""Stops and ramps of one joint: against ruckig's velocity interface, against dense sampling, and by their own rules."""

from __future__ import annotations

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from ruckig import ControlInterface, InputParameter, Ruckig, Synchronization, Trajectory

from gateway.core.motion.joints.braking import REST, ROUNDING_RAD, Braking, JointLimits, advance, duration, ramp
from gateway.core.motion.space import PlanFailed, State

A, J = 3.0, 20.0
LOWER = (-1.0, -0.01, -2.6, 0.25, -1.8, -1.4, -0.7)
UPPER = (1.0, 0.01, 1.3, 2.2, 1.8, 1.4, 0.7)
fixed = settings(max_examples=80, derandomize=True, deadline=None)


def limits(v=1.0, a=A, j=J, lower=LOWER, upper=UPPER) -> JointLimits:
    """Limits of the default configuration, with one joint that may hardly move."""
    return JointLimits(v_radps=v, a_radps2=a, j_radps3=j, lower_rad=lower, upper_rad=upper)


BRAKING = Braking(limits(), 0.01)
velocities = st.floats(-1.0, 1.0)
accelerations = st.floats(-A, A)


def ruckigs_stop(v: float, a: float, v_end: float) -> Trajectory:
    """The same change of velocity by ruckig."""
    entry, trajectory = InputParameter(1), Trajectory(1)
    entry.control_interface = ControlInterface.Velocity
    entry.synchronization = Synchronization.No
    entry.current_position, entry.current_velocity, entry.current_acceleration = [0.0], [v], [a]
    entry.target_velocity, entry.max_acceleration, entry.max_jerk = [v_end], [A], [J]
    Ruckig(1).calculate(entry, trajectory)
    return trajectory


# ------------------------------------------------------------------------------------------------------- limits


@pytest.mark.parametrize("name", ["v", "a", "j"])
@pytest.mark.parametrize("value", [0.0, -1.0, math.nan, math.inf])
def test_limits_that_leave_no_motion_are_refused(name, value):
    """A zero, negative or non-finite limit is refused by name; ruckig would take it and fail later."""
    with pytest.raises(ValueError, match=rf"{name}_rad.* is {value}, a finite number above 0 is needed"):
        limits(**{name: value})


def test_position_limits_are_seven_finite_pairs_in_order():
    """Short, non-finite and crossed position limits are refused with the joint."""
    with pytest.raises(ValueError, match="lower_rad has 1 values, 7 are needed"):
        limits(lower=(0.0,))
    with pytest.raises(ValueError, match=r"upper_rad\[6\] is inf"):
        limits(upper=(*UPPER[:6], math.inf))
    with pytest.raises(ValueError, match=r"joint 4: lower limit 2.2 rad is not below upper limit 2.2 rad"):
        limits(lower=(*LOWER[:3], 2.2, *LOWER[4:]))


@pytest.mark.parametrize("period_s", [0.0, -0.01, math.nan, math.inf])
def test_a_period_that_is_none_is_refused(period_s):
    """The time between setpoints is finite and above 0."""
    with pytest.raises(ValueError, match="the period is"):
        Braking(limits(), period_s)


# -------------------------------------------------------------------------------------------------------- ramps


@fixed
@given(v=velocities, a=accelerations, v_end=velocities)
def test_a_ramp_is_as_quick_as_ruckigs_and_takes_the_same_way(v, a, v_end):
    """Duration and states of a ramp are those of ruckig's velocity interface: it is time-optimal."""
    course, oracle = ramp(v, a, v_end, A, J), ruckigs_stop(v, a, v_end)
    assert duration(course) == pytest.approx(oracle.duration, abs=1e-6)
    for part in (0.0, 0.1, 0.35, 0.6, 0.85, 1.0, 1.3):
        time_s = part * duration(course)
        q, w, b = advance(0.0, v, a, course, time_s)
        (q_oracle,), (w_oracle,), (b_oracle,) = oracle.at_time(time_s)
        assert q == pytest.approx(q_oracle, abs=1e-6)
        assert w == pytest.approx(w_oracle, abs=1e-6)
        assert b == pytest.approx(b_oracle, abs=1e-4)


@fixed
@given(v=velocities, a=accelerations, v_end=velocities, parts=st.lists(st.floats(0.0, 1.2), min_size=2, max_size=2))
def test_a_ramp_keeps_acceleration_and_jerk(v, a, v_end, parts):
    """Between any two instants the acceleration changes by at most j·dt, and it never exceeds its limit."""
    course = ramp(v, a, v_end, A, J)
    early, late = sorted(part * duration(course) for part in parts)
    first, second = advance(0.0, v, a, course, early), advance(0.0, v, a, course, late)
    assert max(abs(first[2]), abs(second[2])) <= A * (1 + 1e-12)
    assert abs(second[2] - first[2]) <= J * (late - early) + 1e-9


@fixed
@given(v=velocities, a=accelerations, v_end=velocities)
def test_a_ramp_ends_exactly(v, a, v_end):
    """From its duration on, velocity and acceleration are the wanted ones without rounding, and the position goes on."""
    course = ramp(v, a, v_end, A, J)
    q, w, b = advance(0.0, v, a, course, duration(course))
    assert (w, b) == (v_end, 0.0)
    assert advance(0.0, v, a, course, duration(course) + 0.5)[0] == pytest.approx(q + 0.5 * v_end, abs=1e-12)


def test_a_joint_at_rest_stays_at_rest():
    """The stop of nothing takes no time."""
    course = ramp(0.0, 0.0, 0.0, A, J)
    assert duration(course) == 0.0
    assert advance(0.3, 0.0, 0.0, course, 0.0) == (0.3, 0.0, 0.0)
    assert advance(0.3, 0.0, 0.0, course, 0.01) == (0.3, 0.0, 0.0)


@fixed
@given(v=velocities, a=accelerations, part=st.floats(0.0, 1.0))
def test_the_stop_of_a_point_on_a_stop_is_the_rest_of_it(v, a, part):
    """Stopping step by step ends where, and when, the whole stop does."""
    course = BRAKING.stop(v, a)
    time_s = part * duration(course)
    point = advance(0.0, v, a, course, time_s)
    assert BRAKING.rest(*point) == pytest.approx(BRAKING.rest(0.0, v, a), abs=1e-9)
    assert duration(BRAKING.stop(*point[1:])) == pytest.approx(duration(course) - time_s, abs=1e-6)


@fixed
@given(q=st.floats(-1.0, 1.0), v=velocities, a=accelerations)
def test_the_rest_is_where_the_stop_ends(q, v, a):
    """The closed form of the rest agrees with going there."""
    course = BRAKING.stop(v, a)
    assert BRAKING.rest(q, v, a) == pytest.approx(advance(q, v, a, course, duration(course))[0], abs=1e-14)


@pytest.mark.parametrize(
    ("v", "a", "v_max", "v_end"),
    [
        (0.8, 0.0, 0.3, 0.3),  # too fast: to the limit
        (-0.8, 0.0, 0.3, -0.3),
        (0.2, 2.0, 0.3, 0.3),  # would be too fast
        (0.2, 0.0, 0.3, 0.2),  # slow enough: on at that velocity
        (0.5, -3.0, 0.3, 0.275),  # brakes so hard that it is bound for less
        (0.8, 0.0, 0.0, 0.0),  # a stop
    ],
)
def test_slowing_goes_to_the_limit_or_stays_below_it(v, a, v_max, v_end):
    """A joint is slowed to the limit only when it is bound for more."""
    assert BRAKING.slow(v, a, v_max)[4] == pytest.approx(v_end)


@pytest.mark.parametrize(
    ("v", "a", "is_over"),
    [
        (0.5, 0.0, False),
        (0.5001, 0.0, True),
        (-0.5001, 0.0, True),
        (0.4, 2.1, True),
        (0.4, 1.9, False),
        (0.6, -3.0, True),
    ],
)
def test_a_joint_is_over_a_limit_when_it_is_or_will_be(v, a, is_over):
    """Beyond 0.5 rad/s counts at once, and so does an acceleration that leads there inevitably (a²/2j = 0.1 at 2 rad/s²)."""
    assert BRAKING.is_over(v, a, 0.5) is is_over


# ------------------------------------------------------------------------------------------------------- inside


def stop_stays_inside(index: int, q: float, v: float, a: float) -> float:
    """By how much a densely sampled stop stays inside the limits of a joint [rad]; below 0 it leaves them."""
    course = BRAKING.stop(v, a)
    way = [advance(q, v, a, course, duration(course) * n / 400)[0] for n in range(401)]
    return min(min(way) - LOWER[index], UPPER[index] - max(way))


@settings(max_examples=300, derandomize=True, deadline=None)
@given(
    index=st.sampled_from([0, 1]), part=st.floats(-1.0, 1.0), v=velocities, a=accelerations, scale=st.floats(0.0, 1.0)
)
def test_can_stop_is_what_sampling_the_stop_finds(index, part, v, a, scale):
    """A state can stop when every point of its stop is inside, in a wide range as in one of 0.02 rad."""
    q, v, a = part * UPPER[index], v * scale, a * scale
    room = stop_stays_inside(index, q, v, a)
    if abs(room) > 1e-6:  # between two samples nobody can tell
        assert BRAKING.can_stop(index, q, v, a) is (room > 0.0)


@pytest.mark.parametrize(
    ("q", "v", "a", "can"),
    [
        (0.0, 1.0, 3.0, True),  # far from the limits nothing is asked
        (1.0, 0.0, 0.0, True),  # at rest at the limit
        (1.0 + 1e-9, 0.0, 0.0, False),  # beyond it
        (0.95, 0.5, 0.0, False),  # too late to stop
        (0.95, -0.5, 0.0, True),  # moving away
        (0.9999, 0.02, -3.0, True),  # turning back in time
        (0.99995, 0.02, -3.0, False),  # turning back too late, though it would rest inside
        (math.nan, math.nan, math.nan, False),
    ],
)
def test_can_stop_near_a_limit(q, v, a, can):
    """One row per reason, joint 1 with its limit at 1 rad."""
    assert BRAKING.can_stop(0, q, v, a) is can


def test_a_state_that_turns_back_too_late_is_found_although_it_rests_inside():
    """The row above is what it says: only the turning point is outside."""
    assert BRAKING.rest(0.99995, 0.02, -3.0) < 1.0
    assert stop_stays_inside(0, 0.99995, 0.02, -3.0) < 0.0


def test_far_from_its_limits_a_joint_can_stop_at_any_speed():
    """Between positions from which no stop, however long, gets there."""
    assert BRAKING.is_far(2, -1.0, 0.5) and all(BRAKING.can_stop(2, -1.0, -1.0, a) for a in (-3.0, 3.0))
    assert not BRAKING.is_far(2, -2.5, 0.5) and not BRAKING.is_far(2, -1.0, 1.2)


def test_what_may_be_dropped_is_a_millionth_of_the_jerk_limit_or_rounding():
    """Eight times the tiny distance (weights 1, 3, 3, 1) is below 1e-6 of j·dt³, unless that is finer than rounding."""
    assert 8 * BRAKING.tiny_rad <= 1e-6 * J * 0.01**3
    assert Braking(limits(v=1e-3, a=1e-3, j=1e-2), 0.005).tiny_rad == ROUNDING_RAD


def test_a_motion_lands_on_its_goal_when_it_is_as_good_as_there_and_never_outside():
    """A distance that counts against no limit is closed; a greater one stays; what is outside is put on the limit."""
    goal = (1.0, 0.0, 0.5, 1.0, 0.0, 0.0, 0.7)
    end = (1.0 - 1e-16, 1e-8, 0.5, 2.3, -2.0, 1e-14, 0.7 + 1e-14)
    assert BRAKING.land(end, goal) == (1.0, 1e-8, 0.5, 2.2, -1.8, 0.0, 0.7)


# ------------------------------------------------------------------------------------------------------ the whole arm

LIMITS = JointLimits(
    v_radps=1.0,
    a_radps2=3.0,
    j_radps3=20.0,
    lower_rad=(-1.8, 0.0, -2.6, 0.25, -1.8, -1.4, -0.7),
    upper_rad=(1.8, 1.9, 1.3, 2.2, 1.8, 1.4, 0.7),
)
ARM = Braking(LIMITS, 0.01)
HOME = (0.41, 1.16, -0.47, 0.90, 0.23, -0.15, 0.60)
MOVING = State(HOME, (0.8, -0.8, 0.2, 0.0, 0.0, 0.0, 0.0), (0.0, 0.0, 2.0, 0.0, 0.0, 0.0, 0.0))


def test_home_is_at_rest_inside_the_limits():
    """Where 0 is outside, at the limit."""
    assert ARM.home == ((0.0, 0.0, 0.0, 0.25, 0.0, 0.0, 0.0), REST, REST)


def test_what_rounding_put_beyond_a_limit_is_put_on_it():
    """The rest of the state stays, and a state inside stays the same."""
    beyond = MOVING._replace(values=(1.8 + 1e-12, *HOME[1:]))
    assert ARM.settle(beyond, MOVING) == MOVING._replace(values=(1.8, *HOME[1:]))
    assert ARM.settle(MOVING, beyond) is MOVING


def test_a_goal_inside_the_limits_passes_as_a_tuple():
    """Both ends of the range are inside."""
    assert ARM.check_place("left arm", list(LIMITS.lower_rad)) == (LIMITS.lower_rad, REST, REST)
    assert ARM.check_place("left arm", LIMITS.upper_rad).values == LIMITS.upper_rad


@pytest.mark.parametrize("goal", [(), (0.0,), (0.5,) * 6, (0.5,) * 8])
def test_a_goal_of_another_length_is_refused(goal):
    """It is ruckig that would take it without a word, and drive the missing joints anywhere."""
    with pytest.raises(PlanFailed, match=f"left arm position has {len(goal)} values, 7 are needed") as failed:
        ARM.check_place("left arm", goal)
    assert (failed.value.joint, failed.value.bound) == ("", "") and math.isnan(failed.value.value)


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_a_goal_that_is_not_finite_is_refused(value):
    """With the element."""
    with pytest.raises(PlanFailed, match=rf"left arm position\[2\] is {value}"):
        ARM.check_place("left arm", (*HOME[:2], value, *HOME[3:]))


@pytest.mark.parametrize(("index", "value"), [(3, 0.25 - 1e-12), (3, 2.2000001), (6, 5.0)])
def test_a_goal_outside_the_limits_is_refused_with_joint_value_and_bound(index, value):
    """However little it is outside."""
    with pytest.raises(PlanFailed) as failed:
        ARM.check_place("left arm", (*HOME[:index], value, *HOME[index + 1 :]))
    bound = f"[{LIMITS.lower_rad[index]}, {LIMITS.upper_rad[index]}]"
    assert (failed.value.joint, failed.value.value, failed.value.bound) == (f"left arm joint {index + 1}", value, bound)
    assert str(failed.value) == f"left arm joint {index + 1}: {value} rad is outside {bound} rad"


def test_slowing_ends_at_velocities_within_the_limit():
    """Each joint on its own: two slow down, one keeps what it is bound for, four do not move."""
    slowing = ARM.slowing(MOVING, 0.4)
    assert slowing.at(0.0) == slowing.start == MOVING
    q_rad, dq_radps, ddq_radps2 = slowing.at(slowing.duration_s)
    assert dq_radps == pytest.approx((0.4, -0.4, 0.3, 0.0, 0.0, 0.0, 0.0))
    assert ddq_radps2 == REST
    assert q_rad[3:] == HOME[3:]


def test_slowing_to_nothing_is_a_stop():
    """All velocities are exactly 0 at its end, which is where each joint's own stop ends."""
    stop = ARM.halt(MOVING)
    q_rad, dq_radps, ddq_radps2 = stop.at(stop.duration_s)
    assert (dq_radps, ddq_radps2) == (REST, REST)
    assert q_rad == pytest.approx([ARM.rest(*joint) for joint in zip(*MOVING, strict=True)], abs=1e-14)
    assert q_rad == pytest.approx(ARM.halted(MOVING), abs=1e-14)


def test_a_moving_state_inside_all_limits_is_an_entry():
    """As it is, in tuples; the velocity limit itself is inside."""
    v, a = (1.0, *MOVING.v[1:]), list(MOVING.a)
    assert ARM.check_entry(list(HOME), v, a) == (HOME, v, MOVING.a)


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
        ARM.check_entry(q, v, a)
