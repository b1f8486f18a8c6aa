"""Following a streamed pose: inside every limit as a norm, to the target exactly, whatever the reach and the way round."""

from __future__ import annotations

import math
import random
from itertools import pairwise

import pytest

from gateway.core.motion import follower as module
from gateway.core.motion.poses.pose_follower import PoseFollower, followed
from gateway.core.motion.poses.pose_state import REST6, PoseDynamics
from gateway.core.motion.poses.quaternion import angle_rad, dot
from gateway.core.motion.solver import NoPlan
from tests.core.pose_judge import DT, HARD, HOME, LIMITS, WEAK, about, any_pose, judge, posed, rates

HERE = posed(HOME[:3], HOME[3:])


def begun(target, speed=1.0, limits=LIMITS, now=HERE) -> PoseFollower:
    """A follower with its first target."""
    follower = PoseFollower(PoseDynamics(limits, DT))
    follower.begin()
    follower.aim(tuple(target), speed, now)
    return follower


def run(follower, state, steps=1000):
    """All states from `state` on, until it rests at the target."""
    states = [state]
    for _ in range(steps):
        states.append(follower.follow(states[-1]))
        if states[-1].is_at_rest and states[-1].values == follower.target:
            break
    return states


def setpoints(states):
    """What a stream sends."""
    return [state.values for state in states]


def test_a_target_is_reached_exactly_and_then_nothing_moves():
    """20 cm and 1 rad; the end is the target itself, without rounding."""
    target = (0.30, -0.10, -0.20, *about((0.0, 0.0, 1.0), 1.0))
    follower = begun(target)
    states = run(follower, HERE)
    judge(setpoints([HERE, HERE, HERE, *states, states[-1], states[-1]]), LIMITS)
    assert states[-1].values == target
    assert follower.follow(states[-1]) is states[-1]
    assert len(states) * DT < 2.5


@pytest.mark.parametrize("limits", [LIMITS, HARD, WEAK])
def test_a_bound_that_changes_at_any_moment_keeps_every_limit(limits):
    """Down to a fiftieth of the speed and up again while it goes; without one it is there as soon as ever."""
    for seed in range(4):
        rng = random.Random(seed)
        start = posed(any_pose(rng)[:3], HOME[3:])
        follower, states = begun(any_pose(rng), limits=limits, now=start), [start, start, start]
        for _ in range(12):
            follower.bound(rng.choice((0.02, 0.1, 0.5, 1.0)))
            for _ in range(rng.choice((1, 5, 30))):
                states.append(follower.follow(states[-1]))
        follower.bound(1.0)
        states += run(follower, states[-1], 4000)[1:]
        assert states[-1].values == follower.target
        judge(setpoints(states), limits)
        assert follower.faults == 0


def test_a_bound_holds_until_it_is_lifted_and_a_new_stream_has_none():
    """A fifth of the linear speed, as the stream's own factor would have it; `begin` forgets it."""
    target = (-0.30, 0.10, -0.20, *HOME[3:])
    follower = begun(target)
    follower.bound(0.2)
    linear, _ = rates(setpoints(run(follower, HERE, 100)), DT)
    assert 0.17 * LIMITS.v_mps < max(math.hypot(*v) for v in linear) <= 0.2 * LIMITS.v_mps
    follower.begin()
    follower.aim(target, 1.0, HERE)
    assert setpoints(run(follower, HERE)) == setpoints(run(begun(target), HERE))


def test_what_it_wishes_for_is_full_speed_towards_the_target():
    """Linear and angular, less where it is near; nothing without a target, and at it."""
    target = (0.30, 0.10, -0.50, *about((0.0, 1.0, 0.0), 0.004))
    follower = begun(target)
    wish = follower.wish(HERE)
    assert wish[:3] == pytest.approx((0.0, 0.0, -0.999 * LIMITS.v_mps)) and wish[3:] == pytest.approx((0.0, 0.04, 0.0))
    assert begun(HERE.values).wish(HERE) == REST6
    assert PoseFollower(PoseDynamics(LIMITS, DT)).wish(HERE) == REST6


def test_a_straight_way_along_an_axis_gets_most_of_the_speed():
    """The axis with the way gets more than 85 % of the limit, not the 58 % of an even division."""
    states = run(begun((-0.30, 0.10, -0.20, *HOME[3:])), HERE)
    linear, _ = rates(setpoints(states), DT)
    assert 0.85 * LIMITS.v_mps < max(math.hypot(*v) for v in linear) <= LIMITS.v_mps


@pytest.mark.parametrize("limits", [LIMITS, HARD, WEAK])
def test_random_targets_at_random_moments_keep_every_limit(limits):
    """Targets anywhere in the reach, half of them at its end, before the last one is reached; each last one is."""
    for seed in range(6):
        rng = random.Random(seed)
        start = posed(any_pose(rng)[:3], HOME[3:])
        follower, states = begun(any_pose(rng), limits=limits, now=start), [start, start, start]
        for _ in range(10):
            target = any_pose(rng)
            follower.aim(target, rng.choice((1.0, 1.0, 0.3)), states[-1])
            for _ in range(rng.choice((1, 5, 30))):
                states.append(follower.follow(states[-1]))
        states += run(follower, states[-1], 4000)[1:]
        assert states[-1].is_at_rest and states[-1].values == follower.target
        judge(setpoints(states), limits)
        assert follower.faults == 0


def test_a_way_around_the_end_of_the_reach_is_found():
    """Two places at 0.54 m whose straight axes-wise way would leave the reach: it goes through the inside, and arrives."""
    start = posed((0.385, 0.385, 0.0), HOME[3:])
    target = (0.2, 0.505, 0.0, *HOME[3:])
    states = run(begun(target, now=start), start)
    judge(setpoints([start, start, start, *states]), LIMITS)
    assert states[-1].values == target


def test_a_lower_speed_in_motion_is_ramped_down_to():
    """From the full speed to a fifth, along the way and without stopping; not below it."""
    far = (-0.40, 0.10, -0.20, *HOME[3:])
    follower = begun(far)
    states = [HERE]
    for _ in range(50):
        states.append(follower.follow(states[-1]))
    follower.aim(far, 0.2, states[-1])
    slow = [states[-1]]
    for _ in range(60):
        slow.append(follower.follow(slow[-1]))
    judge(setpoints(slow), LIMITS)
    speeds = [math.hypot(*state.v[:3]) for state in slow]
    assert speeds[0] > 0.2 and min(speeds) > 0.03
    assert speeds[-1] <= 0.2 * LIMITS.v_mps + 1e-9


def test_a_near_target_comes_before_a_lower_speed():
    """One that must brake for its target brakes harder than a ramp to the lower speed would."""
    follower = begun((-0.40, 0.10, -0.20, *HOME[3:]))
    state = HERE
    for _ in range(50):
        state = follower.follow(state)
    near = (state.values[0] - 0.045, *state.values[1:3])
    follower.aim((*near, *HOME[3:]), 0.9, state)
    states = run(follower, state)
    judge(setpoints(states), LIMITS)
    assert states[-1].values == follower.target
    assert min(s.values[0] for s in states) > near[0] - 0.03


def test_a_slow_stream_from_rest_accelerates_gently_too():
    """The factor counts for the acceleration from rest on."""
    target = (-0.30, 0.10, -0.20, *HOME[3:])
    slow = [math.hypot(*s.a[:3]) for s in run(begun(target, speed=0.2), HERE, 40)]
    assert max(slow) <= 0.2 * LIMITS.a_mps2


def test_the_shorter_way_round_is_taken():
    """Three quarters of a turn about z are a quarter the other way; the sign of the target does not matter."""
    quat = about((0.0, 0.0, 1.0), 1.5 * math.pi)
    for sign in (1.0, -1.0):
        states = run(begun((*HOME[:3], *(sign * c for c in quat))), HERE)
        assert angle_rad(states[-1].values[3:], quat) < 1e-9
        _, angular = rates(setpoints(states), DT)
        assert sum(w[2] for w in angular) * DT == pytest.approx(-0.5 * math.pi, abs=1e-6)
        assert all(dot(a.values[3:], b.values[3:]) > 0.99 for a, b in pairwise(states))


def test_noise_around_half_a_turn_does_not_change_the_way():
    """A target that wavers by 0.1 rad around half a turn is approached without turning back."""
    follower, states = begun((*HOME[:3], *about((0.0, 0.0, 1.0), math.pi - 0.05))), [HERE]
    for n in range(60):
        quat = about((0.0, 0.0, 1.0), math.pi + 0.05 * (-1) ** n)
        follower.aim((*HOME[:3], *quat), 1.0, states[-1])
        states.append(follower.follow(states[-1]))
    assert min(state.v[5] for state in states) >= 0.0
    assert states[-1].v[5] > 0.5


def test_a_target_far_beyond_half_a_turn_is_reached_the_other_way():
    """The way is kept for 0.3 rad beyond half a turn only."""
    follower = begun((*HOME[:3], *about((0.0, 0.0, 1.0), math.pi - 0.1)))
    state = follower.follow(HERE)
    for angle in (math.pi, math.pi + 0.2, math.pi + 0.5):
        follower.aim((*HOME[:3], *about((0.0, 0.0, 1.0), angle)), 1.0, state)
        state = follower.follow(state)
    states = run(follower, state)
    _, angular = rates(setpoints(states), DT)
    assert sum(w[2] for w in angular) < 0.0


def test_where_ruckig_finds_no_plan_the_stop_is_taken(monkeypatch):
    """The fault is counted; the arm brakes inside the limits, and from rest it stays."""
    follower = begun((-0.30, 0.10, -0.20, *HOME[3:]))
    states = [HERE]
    for _ in range(20):
        states.append(follower.follow(states[-1]))

    def none(*_):
        raise NoPlan("no plan today")

    monkeypatch.setattr(module, "solve", none)
    for _ in range(60):
        states.append(follower.follow(states[-1]))
    judge(setpoints(states), LIMITS)
    assert states[-1].is_at_rest
    assert follower.faults == 60


def test_from_a_state_that_cannot_stop_inside_the_stop_is_taken():
    """Nothing else is as short; a reference never gets there by itself."""
    state = posed((0.55, 0.0, 0.0), HOME[3:], (0.2, 0.0, 0.0, 0.0, 0.0, 0.0), REST6)
    follower = begun((0.3, 0.0, 0.0, *HOME[3:]), now=state)
    assert follower.follow(state) == PoseDynamics(LIMITS, DT).halt(state).states[0]


def test_targets_that_ask_for_more_than_the_limits_allow_are_told():
    """A target that runs away at four times the speed limit, not one that moves at half of it."""
    for speed_mps, limited in ((1.0, True), (0.1, False)):
        follower, state = begun(HOME), posed((-0.3, 0.0, 0.0), HOME[3:])
        for n in range(int(0.6 / speed_mps / DT)):
            follower.aim((-0.3 + speed_mps * n * DT, 0.0, 0.0, *HOME[3:]), 1.0, state)
            state = follower.follow(state)
        assert follower.is_limited is limited
    follower.forget_lateness()
    assert not follower.is_limited


# ------------------------------------------------------------------------------------------------ what can be followed


@pytest.mark.parametrize("direction", [(1.0, 0.0, 0.0), (0.0, -1.0, 1.0), (1.0, 1.0, 1.0), (0.2, 0.9, 0.1)])
@pytest.mark.parametrize("limits", [LIMITS, HARD])
def test_a_target_that_moves_as_fast_as_is_followed_does_not_leave_the_arm_behind(limits, direction):
    """In any direction, position and orientation: the distance is the way to stop from that speed, and stays that."""
    dynamics = PoseDynamics(limits, DT)
    reach_m, v_mps, _, w_radps, _ = followed(dynamics)
    assert reach_m == limits.reach_m
    along = tuple(c / math.hypot(*direction) for c in direction)
    start = tuple(-0.2 * c for c in along)
    follower, state, behind = PoseFollower(dynamics), posed(start, HOME[3:]), []
    follower.begin()
    for n in range(60):
        p_m = tuple(x + v_mps * n * DT * c for x, c in zip(start, along, strict=True))
        quat = about(along, w_radps * n * DT)
        follower.aim((*p_m, *quat), 1.0, state)
        state = follower.follow(state)
        behind.append((math.dist(p_m, state.values[:3]), angle_rad(quat, state.values[3:])))
    for late, later in zip(behind[50], behind[-1], strict=True):
        assert later <= late * 1.02


def test_a_lower_speed_lowers_what_a_moving_target_may_ask_for():
    """Its velocities; not how quickly it may change them."""
    reach_m, v_mps, a_mps2, w_radps, dw_radps2 = followed(PoseDynamics(LIMITS, DT))
    assert followed(PoseDynamics(LIMITS, DT), 0.5) == pytest.approx(
        (reach_m, 0.5 * v_mps, a_mps2, 0.5 * w_radps, dw_radps2)
    )
