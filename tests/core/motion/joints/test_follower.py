"""Following a streamed target: within every limit, whatever ruckig finds, and without overshooting for a lower speed."""

from __future__ import annotations

import math
from itertools import pairwise

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gateway.core.motion import follower as module
from gateway.core.motion.joints.braking import REST, Braking, JointLimits
from gateway.core.motion.joints.follower import JointFollower
from gateway.core.motion.solver import NoPlan
from gateway.core.motion.space import State
from gateway.robot.limits import HOME_Q_RAD, JOINT_LOWER_RAD, JOINT_UPPER_RAD
from gateway.values import ARM_DOF, Side

V, A, J, DT = 1.0, 3.0, 20.0, 0.01
LOWER, UPPER = JOINT_LOWER_RAD[Side.LEFT], JOINT_UPPER_RAD[Side.LEFT]
HOME = HOME_Q_RAD[Side.LEFT]
AT_HOME = State(HOME, REST, REST)
BRAKING = Braking(JointLimits(v_radps=V, a_radps2=A, j_radps3=J, lower_rad=LOWER, upper_rad=UPPER), DT)


def at_home(index: int, value: float) -> tuple[float, ...]:
    """The home position with one joint elsewhere."""
    return (*HOME[:index], value, *HOME[index + 1 :])


def moving(index: int, q: float, v: float, a: float = 0.0):
    """The arm at home with one joint on its way."""
    zeros = [0.0] * ARM_DOF
    return State(at_home(index, q), (*zeros[:index], v, *zeros[index + 1 :]), (*zeros[:index], a, *zeros[index + 1 :]))


def begun(target, speed=1.0) -> JointFollower:
    """A follower with its first target."""
    follower = JointFollower(BRAKING)
    follower.begin()
    aim(follower, target, speed)
    return follower


def aim(follower: JointFollower, target, speed=1.0) -> None:
    """Another target; where the arm is makes no difference to joints."""
    follower.aim(tuple(target), speed, AT_HOME)


def run(follower: JointFollower, state, steps: int) -> list:
    """All states from `state` on."""
    states = [state]
    for _ in range(steps):
        states.append(follower.follow(states[-1]))
    return states


def check(states) -> None:
    """Every setpoint is inside and stoppable; differences keep velocity, acceleration and jerk."""
    for q_rad, dq_radps, ddq_radps2 in states:
        for n, joint in enumerate(zip(q_rad, dq_radps, ddq_radps2, strict=True)):
            assert LOWER[n] - 1e-12 <= joint[0] <= UPPER[n] + 1e-12
            assert BRAKING.can_stop(n, *joint)
    for n in range(ARM_DOF):
        q = [state[0][n] for state in states]
        first = [y - x for x, y in pairwise(q)]
        second = [y - x for x, y in pairwise(first)]
        third = [y - x for x, y in pairwise(second)]
        assert max(map(abs, first)) <= V * DT * (1 + 1e-6)
        assert max(map(abs, second)) <= A * DT**2 * (1 + 1e-6)
        assert max(map(abs, third)) <= J * DT**3 * (1 + 1e-6)


# ----------------------------------------------------------------------------------------------------- arriving


def test_a_target_is_reached_exactly_and_then_nothing_moves():
    """0.3 rad take 0.80 s at 1 rad/s, 3 rad/s², 20 rad/s³; the end is the target, at rest, without rounding."""
    target = at_home(0, 0.71)
    states = run(begun(target), AT_HOME, 100)
    check(states)
    arrived = next(n for n, state in enumerate(states) if state == (target, REST, REST))
    assert arrived == pytest.approx(80, abs=2)
    assert all(state == (target, REST, REST) for state in states[arrived:])


def test_joints_do_not_wait_for_one_another():
    """A small step is done before a large one."""
    target = (HOME[0] + 0.05, HOME[1] - 1.0, *HOME[2:])
    states = run(begun(target), AT_HOME, 60)
    assert states[-1][0][0] == target[0] and states[-1][1][0] == 0.0
    assert states[-1][1][1] < -0.5


def test_the_latest_target_counts():
    """A new target turns the arm around."""
    follower = begun(at_home(0, 1.8))
    states = run(follower, AT_HOME, 60)
    aim(follower, at_home(0, -1.0))
    states += run(follower, states[-1], 400)[1:]
    check(states)
    assert states[-1] == (at_home(0, -1.0), REST, REST)


def test_limits_are_targets_like_any_others():
    """From one end of every range to the other, and back before it is reached."""
    follower = begun(LOWER)
    states = run(follower, State(UPPER, REST, REST), 150)
    for target, steps in ((UPPER, 37), (LOWER, 61), (UPPER, 5), (LOWER, 700)):
        aim(follower, target)
        states += run(follower, states[-1], steps)[1:]
    check(states)
    assert states[-1] == (LOWER, REST, REST)


@settings(max_examples=30, derandomize=True, deadline=None)
@given(
    parts=st.lists(st.tuples(*[st.floats(0.0, 1.0)] * 3), min_size=3, max_size=8),
    hold=st.sampled_from([1, 2, 7, 30]),
    speed=st.sampled_from([1.0, 0.3]),
)
def test_targets_at_any_rate_keep_all_limits(parts, hold, speed):
    """From every setpoint to 3 Hz, near the limits and far from them; then it comes to rest at the last one."""
    follower, states = begun(HOME, speed), [AT_HOME]
    for three in parts:
        spread = [three[n % 3] for n in range(ARM_DOF)]
        target = [low + round(part, 1) * (high - low) for low, high, part in zip(LOWER, UPPER, spread, strict=True)]
        aim(follower, (min(max(q, low), high) for q, low, high in zip(target, LOWER, UPPER, strict=True)), speed)
        states += run(follower, states[-1], hold)[1:]
    states += run(follower, states[-1], 1800)[1:]
    check(states)
    assert states[-1] == (follower.target, REST, REST)
    assert follower.faults == 0


# -------------------------------------------------------------------------------------------------------- speed


def peak(states, column: int) -> float:
    """Largest velocity (1) or acceleration (2)."""
    return max(abs(x) for state in states for x in state[column])


def test_from_rest_a_speed_factor_lowers_velocity_and_acceleration():
    """At 0.2: 0.2 rad/s and 0.6 rad/s²; and again from the next rest on."""
    follower = begun(at_home(0, 0.9), 0.2)
    states = run(follower, AT_HOME, 400)
    assert states[-1][1] == REST
    assert peak(states, 1) == pytest.approx(0.2) and peak(states, 2) == pytest.approx(0.6)
    aim(follower, HOME, 0.2)
    assert peak(run(follower, states[-1], 400), 2) == pytest.approx(0.6)


def test_in_motion_a_lower_factor_slows_down_to_its_velocity_without_dipping_below():
    """From 1 rad/s to 0.1 with the full acceleration, then steadily on; ruckig alone would swing back."""
    follower = begun(at_home(0, 1.8), 0.1)
    states = run(follower, moving(0, 0.0, 1.0), 150)
    check(states)
    velocities = [state[1][0] for state in states]
    assert peak(states, 2) == pytest.approx(A)
    assert min(velocities) > 0.1 - 1e-9
    assert max(velocities[46:]) <= 0.1 + 1e-9


@pytest.mark.parametrize("gap_rad", [0.24, 0.26, 0.3])
def test_a_target_nearer_than_slowing_down_is_not_overshot(gap_rad):
    """The stop from 1 rad/s takes 0.2417 rad: a lower factor must not make it longer than the way that is left."""
    target = at_home(0, gap_rad)
    states = run(begun(target, 0.1), moving(0, 0.0, 1.0), 400)
    check(states)
    assert max(state[0][0] for state in states) <= max(gap_rad, 0.2417) + 1e-4
    assert states[-1] == (target, REST, REST)


def test_a_bound_slows_down_as_a_lower_factor_does():
    """The same setpoints, in mid-motion; one that is above the stream's own factor changes nothing."""
    bounded, slow, free = (begun(at_home(0, 1.8), speed) for speed in (1.0, 0.1, 0.1))
    bounded.bound(0.1)
    free.bound(0.5)
    states = [run(follower, moving(0, 0.0, 1.0), 150) for follower in (bounded, slow, free)]
    assert states[0] == states[1] == states[2]


def test_a_target_behind_turns_the_joint_at_once_whatever_the_factor():
    """It brakes with the full acceleration, and comes back at the lower velocity."""
    states = run(begun(at_home(0, -0.2), 0.1), moving(0, 0.0, 1.0), 600)
    check(states)
    assert 0.2 < max(state[0][0] for state in states) < 0.2417
    assert min(state[1][0] for state in states) >= -0.1 - 1e-9
    assert states[-1][0] == at_home(0, -0.2)


def test_a_speed_of_hours_is_followed_all_the_same():
    """Beyond what ruckig can plan, what lies on the way is the target."""
    follower = begun(at_home(0, -1.8), 1e-5)
    states = run(follower, AT_HOME, 50)
    assert follower.faults == 0
    assert states[-1][1][0] == pytest.approx(-1e-5)
    assert states[-1][0][1:] == HOME[1:]


# ------------------------------------------------------------------------------------------------------- faults


def fail(*_):
    """Stand in for a solver that finds nothing."""
    raise NoPlan("error in step 1")


def test_where_ruckig_finds_no_plan_the_arm_brakes(monkeypatch):
    """No step, no jump: a stop within the limits, for as long as there is no plan; then it goes on."""
    follower = begun(at_home(0, 1.8), 0.5)
    states = run(follower, AT_HOME, 40)
    assert follower.faults == 0
    with monkeypatch.context() as patched:
        patched.setattr(module, "solve", fail)
        states += run(follower, states[-1], 60)[1:]
        assert states[-1][1:] == (REST, REST)
        assert follower.faults == 60
    states += run(follower, states[-1], 500)[1:]
    check(states)
    assert states[-1] == (at_home(0, 1.8), REST, REST)
    assert follower.faults == 60


def test_after_braking_a_slow_stream_may_accelerate_fully_until_it_rests(monkeypatch):
    """From rest it plans with 0.6 rad/s²; a stop goes beyond that, and planning below the present runs away."""
    follower = begun(at_home(0, 1.8), 0.2)
    states = run(follower, AT_HOME, 60)
    assert peak(states, 2) <= 0.6 + 1e-9
    with monkeypatch.context() as patched:
        patched.setattr(module, "solve", fail)
        states += run(follower, states[-1], 8)[1:]
    assert states[-1][2][0] < -0.6
    again = run(follower, states[-1], 30)
    assert max(state[2][0] for state in again) > 0.7
    check(states + again[1:])


def test_one_missing_plan_is_no_jump(monkeypatch):
    """At full speed towards a limit, ten single failures."""
    follower = begun(UPPER)
    states = run(follower, State(LOWER, REST, REST), 40)
    for _ in range(10):
        with monkeypatch.context() as patched:
            patched.setattr(module, "solve", fail)
            states += run(follower, states[-1], 1)[1:]
        states += run(follower, states[-1], 7)[1:]
    states += run(follower, states[-1], 700)[1:]
    check(states)
    assert states[-1] == (UPPER, REST, REST)
    assert follower.faults == 10


def test_a_plan_beyond_a_position_limit_is_not_followed():
    """With a target outside (which nobody can set from outside) the arm stops inside, at the limit."""
    follower = begun(at_home(0, 2.5))
    states = run(follower, moving(0, 1.2, 1.0), 300)
    check(states)
    assert states[-1][1:] == (REST, REST)
    assert states[-1][0][0] == pytest.approx(1.8, abs=1e-2)


# ------------------------------------------------------------------------------------------------------ limited


@pytest.mark.parametrize(
    ("rate_hz", "size_rad", "speed", "is_limited"),
    [
        (0.1, 0.5, 1.0, False),
        (0.3, 0.5, 1.0, False),  # 0.94 rad/s, 1.8 rad/s²: just within
        (0.6, 0.5, 1.0, True),  # 1.9 rad/s
        (1.0, 0.05, 1.0, False),
        (1.0, 0.2, 1.0, True),  # 7.9 rad/s²
        (0.1, 0.5, 0.2, True),  # 0.31 rad/s where 0.2 are allowed
    ],
)
def test_a_stream_is_limited_when_the_limits_do_not_allow_it(rate_hz, size_rad, speed, is_limited):
    """Sines which can be followed and sines which cannot, after one second."""
    follower, state = begun(HOME, speed), State(at_home(0, 0.0), REST, REST)
    limited = []
    for n in range(1500):
        aim(follower, at_home(0, size_rad * math.sin(2 * math.pi * rate_hz * n * DT)), speed)
        state = follower.follow(state)
        limited.append(follower.is_limited)
    share = sum(limited[100:]) / 1400
    assert share > 0.75 if is_limited else share == 0.0
