"""Limits as norms, the chart, and stops of an end effector."""

from __future__ import annotations

import math
import random

import pytest

from gateway.core.motion.poses.pose_state import REST6, PoseDynamics, carry, share
from gateway.core.motion.poses.quaternion import dot, exp, multiply, turn, unit
from gateway.core.motion.space import PlanFailed
from tests.core.pose_judge import DT, HARD, HOME, LIMITS, WEAK, about, judge, posed

DYNAMICS = PoseDynamics(LIMITS, DT)
HERE = posed(HOME[:3], HOME[3:])


def moving(v, a=REST6, p_m=HOME[:3]):
    """A state in motion."""
    return posed(p_m, HOME[3:], tuple(v), tuple(a))


def setpoints(start, stop):
    """What a stream sends: two held setpoints are left out, since the start is in motion."""
    return [start.values, *(state.values for state in stop.states)]


# ------------------------------------------------------------------------------------------------------- limits


@pytest.mark.parametrize("period_s", [0.0, math.nan, -0.1])
def test_a_period_must_be_a_time(period_s):
    """Nothing can be planned for it else."""
    with pytest.raises(ValueError, match="period"):
        PoseDynamics(LIMITS, period_s)


def test_three_axes_at_their_shares_stay_inside_the_norms():
    """√3 times the share of one axis is below the limit, for position and orientation."""
    for limits in (LIMITS, HARD, WEAK):
        dynamics = PoseDynamics(limits, DT)
        for n, v, a, j in ((0, limits.v_mps, limits.a_mps2, limits.j_mps3),
                           (5, limits.w_radps, limits.dw_radps2, limits.ddw_radps3)):  # fmt: skip
            axis = dynamics.axis(n)
            assert 0.0 < axis.speed < v
            assert 0.0 < math.sqrt(3.0) * axis.a < a
            assert 0.0 < math.sqrt(3.0) * axis.j < j


# ------------------------------------------------------------------------------------------------------- shares


def test_wishes_that_fit_are_granted():
    """Nobody goes short when there is enough."""
    assert share((0.1, 0.0, 0.0), (0.5, 0.3, 0.2), 1.0) == (0.5, 0.3, 0.2)
    assert share((0.6, 0.0, 0.0), (0.5, 0.3, 0.2), 1.0) == (0.6, 0.3, 0.2)


def test_what_is_needed_comes_before_what_is_wished():
    """Each gets what it has at least, and the squares add up to the whole."""
    need, want = (0.8, 0.1, 0.0), (0.3, 0.9, 0.3)
    given = share(need, want, 1.0)
    assert given[0] == pytest.approx(0.8)
    assert all(g >= n for g, n in zip(given, need, strict=True))
    assert dot(given, given) == pytest.approx(1.0)


def test_needs_beyond_the_whole_are_reduced_alike():
    """A lower speed was asked for in motion: the direction stays."""
    assert share((0.6, 0.8, 0.0), (0.1, 0.1, 0.1), 0.5) == pytest.approx((0.3, 0.4, 0.0))


# ------------------------------------------------------------------------------------------------------- the chart


def test_the_chart_gives_the_velocity_and_acceleration_of_the_body():
    """Against central differences of the orientation itself, for a motion about a changing axis."""
    v, a = (0.0, 0.0, 0.0, 0.9, -0.5, 0.3), (0.0, 0.0, 0.0, -2.0, 4.0, 1.0)

    def at(time_s):
        place = tuple(time_s * x + 0.5 * time_s**2 * y for x, y in zip(v, a, strict=True))
        rate = tuple(x + time_s * y for x, y in zip(v, a, strict=True))
        return carry(HOME[3:], place, rate, a)

    def omega(time_s, h=1e-5):
        return tuple(c / (2 * h) for c in turn(at(time_s - h).values[3:], at(time_s + h).values[3:]))

    state, h = at(0.03), 1e-3
    assert state.v[3:] == pytest.approx(omega(0.03), abs=1e-7)
    measured = tuple((y - x) / (2 * h) for x, y in zip(omega(0.03 - h), omega(0.03 + h), strict=True))
    assert state.a[3:] == pytest.approx(measured, abs=1e-4)


def test_the_chart_never_makes_a_turn_faster():
    """The Jacobian only shortens."""
    rng = random.Random(1)
    for _ in range(100):
        r, dr = ([rng.uniform(-0.05, 0.05) for _ in range(3)] for _ in range(2))
        state = carry(HOME[3:], (0.0, 0.0, 0.0, *r), (0.0, 0.0, 0.0, *dr), REST6)
        assert math.hypot(*state.v[3:]) <= math.hypot(*dr) + 1e-15


def test_without_a_turn_the_orientation_stays_the_same_number():
    """No rounding creeps in."""
    quat = unit((0.1, 0.2, 0.3, 0.4))
    assert carry(quat, (0.1, 0.2, 0.3, 0.0, 0.0, 0.0), REST6, REST6).values[3:] == quat


# ------------------------------------------------------------------------------------------------------- stops


def test_what_rests_needs_no_stop():
    """There is nothing to hand out."""
    stop = DYNAMICS.halt(HERE)
    assert (stop.states, stop.duration_s, stop.at(DT)) == ((), 0.0, HERE)


def test_a_motion_along_a_line_stops_on_that_line():
    """Position on its straight line, orientation about its axis, whatever the direction."""
    line, axis = (0.6, 0.0, -0.8), (0.0, 0.6, 0.8)
    start = moving((*(0.2 * c for c in line), *(0.7 * c for c in axis)),
                   (*(0.5 * c for c in line), *(-2.0 * c for c in axis)))  # fmt: skip
    stop = DYNAMICS.halt(start)
    assert stop.end.is_at_rest
    for state in stop.states:
        way = tuple(b - a for a, b in zip(start.values[:3], state.values[:3], strict=True))
        assert dot(way, line) == pytest.approx(math.hypot(*way), abs=1e-12)
        turned = turn(start.values[3:], state.values[3:])
        assert dot(turned, axis) == pytest.approx(math.hypot(*turned), abs=1e-9)


def at_its_share(dynamics, first, direction):
    """Velocity and acceleration of three axes: one at its share, and as fast as still lets them take that back."""
    axis, most = dynamics.axis(first), max(map(abs, direction))
    force = [axis.a * c / most for c in direction]
    slow, fast = 0.0, axis.speed
    for _ in range(50):
        middle = 0.5 * (slow + fast)
        peaks = (middle * c + 0.5 * f * abs(f) / axis.j for c, f in zip(direction, force, strict=True))
        slow, fast = (middle, fast) if math.hypot(*peaks) <= axis.speed else (slow, middle)
    assert slow > 0.0
    return [slow * c for c in direction], force


@pytest.mark.parametrize("direction", [(1.0, -1.0, 1.0), (0.0, 1.0, 1.0), (0.3, -0.6, 0.9), (-1.0, 0.0, 0.0)])
@pytest.mark.parametrize("limits", [LIMITS, HARD, WEAK])
def test_axes_that_happen_to_move_along_a_line_stop_below_the_speed_limit(limits, direction):
    """Together they accelerate more than a path may; their stop takes that back in time."""
    dynamics = PoseDynamics(limits, DT)
    (v_mps, a_mps2), (w_radps, dw_radps2) = (at_its_share(dynamics, first, direction) for first in (0, 3))
    start = moving((*v_mps, *w_radps), (*a_mps2, *dw_radps2), (0.0, 0.0, 0.0))
    stop = dynamics.halt(start)
    assert stop.end.is_at_rest
    judge(setpoints(start, stop), limits, reach_m=5.0)


def test_an_acceleration_without_velocity_is_stopped_too():
    """It is what a motion that begins has."""
    stop = DYNAMICS.halt(moving(REST6, (0.0, 0.3, 0.0, 0.0, 0.0, 0.0)))
    assert stop.end.is_at_rest
    assert stop.end.values[1] > HOME[1]


@pytest.mark.parametrize("limits", [LIMITS, HARD, WEAK])
def test_every_stop_keeps_the_limits_as_norms(limits):
    """From random motions, position and orientation about changing axes, down to rest."""
    rng = random.Random(7)
    dynamics = PoseDynamics(limits, DT)
    for _ in range(20):
        v = [rng.uniform(-1.0, 1.0) * dynamics.axis(n).speed / math.sqrt(3.0) for n in range(6)]
        a = [rng.uniform(-1.0, 1.0) * dynamics.axis(n).a for n in range(6)]
        # The acceleration must still be taken back below the limit of the speed: what a reference never breaks.
        peaks = [x + y * abs(y) / (2 * dynamics.axis(n).j) for n, (x, y) in enumerate(zip(v, a, strict=True))]
        if math.hypot(*peaks[:3]) > limits.v_mps or math.hypot(*peaks[3:]) > limits.w_radps:
            continue
        start = posed((0.0, 0.0, 0.0), HOME[3:], tuple(v), tuple(a))
        stop = dynamics.halt(start)
        assert stop.end.is_at_rest
        judge(setpoints(start, stop), limits, reach_m=5.0)


def test_the_rest_of_a_stop_is_the_stop_of_its_states():
    """Whoever stops twice stops at the same place."""
    start = moving((0.1, -0.05, 0.02, 0.0, 0.0, 0.0), (-0.3, 0.5, 0.1, 0.0, 0.0, 0.0))
    stop = DYNAMICS.halt(start)
    again = DYNAMICS.halt(stop.states[4])
    assert len(again.states) == len(stop.states) - 5
    assert again.end.values[:3] == pytest.approx(stop.end.values[:3], abs=1e-12)


def test_a_state_can_stop_when_its_stop_stays_in_the_reach():
    """Outwards near the end only when it is slow; whoever turns back inwards may be fast."""
    outwards = moving((0.25, 0.0, 0.0, 0.0, 0.0, 0.0), p_m=(0.53, 0.0, 0.0))
    assert not DYNAMICS.can_stop(outwards)
    assert DYNAMICS.can_stop(moving((0.02, 0.0, 0.0, 0.0, 0.0, 0.0), p_m=(0.53, 0.0, 0.0)))
    assert DYNAMICS.can_stop(moving((-0.25, 0.0, 0.0, 0.0, 0.0, 0.0), p_m=(0.55, 0.0, 0.0)))
    assert DYNAMICS.can_stop(posed((0.55, 0.0, 0.0), HOME[3:]))
    assert not DYNAMICS.can_stop(posed((0.551, 0.0, 0.0), HOME[3:]))
    assert DYNAMICS.can_stop(moving((0.25, 0.0, 0.0, 0.0, 0.0, 0.0), p_m=(0.1, 0.0, 0.0)))


def test_values_are_position_then_orientation():
    """As the robot takes them (manual §4.2)."""
    assert HERE.values == HOME
    assert HERE.is_at_rest
    assert not moving((0.1, 0.0, 0.0, 0.0, 0.0, 0.0)).is_at_rest
    assert multiply(exp((0.0, 0.0, 0.0)), HOME[3:]) == HOME[3:]


def test_a_stop_is_a_course():
    """A setpoint for each period, and at rest from its duration on: where it was said that it would end."""
    start = moving((0.1, -0.05, 0.02, 0.0, 0.0, 0.0))
    stop = DYNAMICS.halt(start)
    assert stop.at(0.0) == stop.start == start
    assert [stop.at((n + 1) * DT) for n in range(len(stop.states))] == list(stop.states)
    assert stop.at(stop.duration_s + 1.0) == stop.end and stop.end.values == DYNAMICS.halted(start)


# ------------------------------------------------------------------------------------------------------- checks


@pytest.mark.parametrize(
    ("values", "blamed"),
    [
        ((0.1, 0.2), ""),
        ((math.nan, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0), ""),
        ((0.5, 0.5, 0.0, 0.0, 0.0, 0.0, 1.0), "arm reach"),
        ((0.1, 0.0, 0.0, 0.0, 0.0, 0.0, 1.2), "arm orientation"),
        ((0.1, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0), "arm orientation"),
    ],
)
def test_a_place_that_is_none_is_refused(values, blamed):
    """Wrong shape, not finite, beyond the reach, or no orientation; with what is to blame."""
    with pytest.raises(PlanFailed) as caught:
        DYNAMICS.check_place("arm", values)
    assert caught.value.joint == blamed


def test_a_place_gets_its_quaternion_normalised():
    """Rounding of six digits is no fault; it is at rest there."""
    state = DYNAMICS.check_place("arm", (0.1, 0.0, 0.0, 0.0, 0.0, 0.7072, 0.7072))
    quat = state.values[3:]
    assert math.hypot(*quat) == pytest.approx(1.0, abs=1e-15) and state.is_at_rest
    assert turn(quat, about((0.0, 0.0, 1.0), math.pi / 2)) == pytest.approx((0.0, 0.0, 0.0), abs=1e-12)


def test_home_is_a_place():
    """What is held before a seed is inside the limits."""
    assert DYNAMICS.check_place("home", DYNAMICS.home.values) == DYNAMICS.home


def test_a_setpoint_goes_on_in_the_sign_of_the_last_one():
    """Either sign is the same orientation; the robot shall not be told the other one."""
    other = posed(HOME[:3], tuple(-c for c in HOME[3:]), (0.1, *REST6[1:]))
    assert DYNAMICS.settle(other, HERE) == other._replace(values=HERE.values)
    assert DYNAMICS.settle(HERE, HERE) is HERE


def test_an_entry_is_repeated_to_the_last_bit():
    """In its sign, and not normalised anew, which would round it; only one that is off is."""
    quat = (0.28062750292422917, 0.09557118569993164, -0.7530281712979346, 0.5874205702034183)
    for n in range(200):
        held = (*HOME[:3], *((-1) ** n * c * (1.0 + (n - 100) * 1e-16) for c in quat))
        assert DYNAMICS.check_entry(held, REST6, REST6).values == held
    off = DYNAMICS.check_entry((*HOME[:3], *(c * 1.0001 for c in quat)), REST6, REST6).values
    assert math.hypot(*off[3:]) == pytest.approx(1.0, abs=1e-15)


@pytest.mark.parametrize(
    ("rates", "forces", "blamed"),
    [
        ((0.3, 0.0, 0.0, 0.0, 0.0, 0.0), REST6, "linear velocity"),
        ((0.0, 0.0, 0.0, 0.6, 0.6, 0.0), REST6, "angular velocity"),
        (REST6, (0.0, 2.0, 0.0, 0.0, 0.0, 0.0), "linear acceleration"),
        (REST6, (0.0, 0.0, 0.0, 0.0, 0.0, 6.0), "angular acceleration"),
        ((math.nan, 0.0, 0.0, 0.0, 0.0, 0.0), REST6, ""),
        (REST6, (0.0,) * 5, ""),
    ],
)
def test_an_entry_outside_the_limits_is_refused(rates, forces, blamed):
    """It cannot be ours."""
    with pytest.raises(PlanFailed) as caught:
        DYNAMICS.check_entry(HOME, rates, forces)
    assert caught.value.joint == blamed


def test_an_entry_that_would_leave_the_reach_is_refused():
    """No setpoint of ours is one that cannot stop inside; at the end of the reach, at rest, one may be."""
    edge = (0.55 + 1e-10, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)
    with pytest.raises(PlanFailed, match="cannot stop"):
        DYNAMICS.check_entry(edge, (0.2, 0.0, 0.0, 0.0, 0.0, 0.0), REST6)
    assert DYNAMICS.check_entry(edge, REST6, REST6).values == edge
