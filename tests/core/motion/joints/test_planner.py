"""Plans of one and two arms: from rest and from motion, within every limit, stoppable everywhere, ending together."""

from __future__ import annotations

import contextlib
import gc
import math
import random
from itertools import pairwise
from types import SimpleNamespace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec import structs
from ruckig import InputParameter, Ruckig, Trajectory

from gateway.core.motion.joints.braking import REST, Braking, JointLimits
from gateway.core.motion.joints.path import Path
from gateway.core.motion.joints.planner import CHECKED_STEPS, _objection, _turned_s, plan_paths
from gateway.core.motion.space import PlanFailed, Start, State
from gateway.robot.limits import HOME_Q_RAD, JOINT_LOWER_RAD, JOINT_UPPER_RAD
from gateway.values import ARM_DOF, Side

V, A, J, DT = 1.0, 3.0, 20.0, 0.01
LEFT, RIGHT = Side.LEFT, Side.RIGHT
HOME = HOME_Q_RAD


def braking(side: Side, v=V, a=A, j=J, period_s=DT) -> Braking:
    """One arm with the robot's own position limits."""
    return Braking(
        JointLimits(
            v_radps=v,
            a_radps2=a,
            j_radps3=j,
            lower_rad=JOINT_LOWER_RAD[side],
            upper_rad=JOINT_UPPER_RAD[side],
        ),
        period_s,
    )


BRAKES = {side: braking(side) for side in Side}


def start(side: Side, q=None, v=(), a=(), brakes=None) -> Start[Braking]:
    """An arm at home, or where said; `v` and `a` give the moving joints by index."""
    rates, forces = (tuple(dict(row).get(n, 0.0) for n in range(ARM_DOF)) for row in (v, a))
    return Start(State(HOME[side] if q is None else tuple(q), rates, forces), brakes or BRAKES[side])


def at_home(index: int, value: float, side: Side = LEFT) -> tuple[float, ...]:
    """The home position with one joint elsewhere."""
    return (*HOME[side][:index], value, *HOME[side][index + 1 :])


def setpoints(path: Path) -> list:
    """All states that a reference would hand out, the one before the first included."""
    return [path.at(n * DT) for n in range(math.ceil(path.duration_s / DT) + 1)]


def check(path: Path, brakes: Braking = BRAKES[LEFT]) -> None:
    """Every setpoint is inside the position limits and stoppable, and their differences keep the other limits."""
    limits, states, dt = brakes.limits, setpoints(path), DT
    for q_rad, dq_radps, ddq_radps2 in states:
        for n, joint in enumerate(zip(q_rad, dq_radps, ddq_radps2, strict=True)):
            assert limits.lower_rad[n] - 1e-11 <= joint[0] <= limits.upper_rad[n] + 1e-11
            assert brakes.can_stop(n, *joint) or joint[1:] == (0.0, 0.0)
    for n in range(ARM_DOF):
        q = [state[0][n] for state in states]
        first = [y - x for x, y in pairwise(q)]
        second = [y - x for x, y in pairwise(first)]
        third = [y - x for x, y in pairwise(second)]
        assert max(map(abs, first), default=0.0) <= limits.v_radps * dt * (1 + 1e-6)
        assert max(map(abs, second), default=0.0) <= limits.a_radps2 * dt**2 * (1 + 1e-6)
        assert max(map(abs, third), default=0.0) <= limits.j_radps3 * dt**3 * (1 + 1e-6)


# --------------------------------------------------------------------------------------------------- bad inputs


@pytest.mark.parametrize(
    ("starts", "goals"), [([], []), ([LEFT], []), ([LEFT], [RIGHT]), ([LEFT], [LEFT, RIGHT]), ([LEFT, RIGHT], [LEFT])]
)
def test_goals_are_for_the_arms_that_take_part(starts, goals):
    """No arm without a goal, no goal without an arm, and at least one of them."""
    with pytest.raises(PlanFailed, match="do not fit references of"):
        plan_paths({side: start(side) for side in starts}, {side: HOME[side] for side in goals}, 1.0)


def test_goals_and_speed_are_checked_for_every_arm():
    """With the arm's name, for the second one too."""
    starts = {side: start(side) for side in Side}
    with pytest.raises(PlanFailed, match=r"right arm joint 4: 0\.9 rad is outside") as failed:
        plan_paths(starts, {LEFT: HOME[LEFT], RIGHT: at_home(3, 0.9, RIGHT)}, 1.0)
    assert (failed.value.joint, failed.value.value, failed.value.bound) == ("right arm joint 4", 0.9, "[-2.2, -0.25]")
    with pytest.raises(PlanFailed, match="left arm position has 1 values"):
        plan_paths({LEFT: starts[LEFT]}, {LEFT: (0.3,)}, 1.0)
    with pytest.raises(PlanFailed, match="speed is 0"):
        plan_paths({LEFT: starts[LEFT]}, {LEFT: HOME[LEFT]}, 0)


def test_a_motion_of_hours_is_refused():
    """Where ruckig has no plan the error says why, and nothing is handed out."""
    with pytest.raises(PlanFailed, match="ruckig finds no plan: the motion would take longer than"):
        plan_paths({LEFT: start(LEFT)}, {LEFT: at_home(0, -1.8)}, 1e-5)


def test_a_refusal_leaves_nothing_to_the_garbage_collector():
    """The daemon runs without one: a failure that its own traceback keeps would keep all of that tick for ever."""
    gc.collect()
    gc.disable()
    try:
        for _ in range(3):
            with contextlib.suppress(PlanFailed):
                plan_paths({LEFT: start(LEFT)}, {LEFT: at_home(0, -1.8)}, 1e-5)
        assert gc.collect() == 0
    finally:
        gc.enable()


# ---------------------------------------------------------------------------------------------------- from rest


def test_both_arms_end_together_exactly_at_their_goals():
    """One trajectory for fourteen joints: the same duration, every joint moving until the end."""
    goals = {LEFT: JOINT_UPPER_RAD[LEFT], RIGHT: at_home(2, 0.6, RIGHT)}
    paths = plan_paths({side: start(side) for side in Side}, goals, 1.0)
    assert paths[LEFT].trajectory is paths[RIGHT].trajectory
    assert paths[LEFT].duration_s == paths[RIGHT].duration_s > 1.0
    for side, path in paths.items():
        check(path, BRAKES[side])
        assert path.at(path.duration_s) == (goals[side], REST, REST)
    almost = paths[RIGHT].at(0.97 * paths[RIGHT].duration_s)[0]
    assert 0.0 < abs(almost[2] - 0.6) < 0.01


def test_a_plan_from_rest_is_a_straight_line_in_joint_space():
    """All joints have covered the same part of their way at any time, so none overshoots."""
    goal = (1.8, 0.0, 1.3, 0.25, -1.8, 1.4, -0.7)
    path = plan_paths({LEFT: start(LEFT)}, {LEFT: goal}, 1.0)[LEFT]
    for time_s in (0.1, 0.5, 1.0, 2.0):
        q_rad = path.at(time_s)[0]
        parts = [(q - home) / (end - home) for q, home, end in zip(q_rad, HOME[LEFT], goal, strict=True)]
        assert parts == pytest.approx([parts[0]] * ARM_DOF, abs=1e-9)


def test_the_slowest_joint_sets_the_duration():
    """One radian at 1 rad/s, 3 rad/s², 20 rad/s³: v/a + a/j more than at constant velocity."""
    path = plan_paths({LEFT: start(LEFT)}, {LEFT: at_home(0, 1.41)}, 1.0)[LEFT]
    assert path.duration_s == pytest.approx(1.0 / V + V / A + A / J)


@pytest.mark.parametrize("speed", [0.01, 0.1, 0.5])
def test_speed_lowers_velocity_and_from_rest_acceleration_but_never_jerk(speed):
    """The duration is that of limits v·speed, a·speed, j."""
    path = plan_paths({LEFT: start(LEFT)}, {LEFT: at_home(0, 1.41)}, speed)[LEFT]
    assert path.duration_s == pytest.approx(1.0 / (V * speed) + V / A + A * speed / J)


def test_an_arm_that_is_there_has_a_path_without_duration():
    """Goal and present are the same: nothing to do, and no error."""
    path = plan_paths({LEFT: start(LEFT)}, {LEFT: HOME[LEFT]}, 1.0)[LEFT]
    assert (path.duration_s, path.duration_ns, path.at(0.0)) == (0.0, 0, (HOME[LEFT], REST, REST))


def test_limits_are_starts_and_goals_like_any_others():
    """From one end of every range to the other."""
    lower, upper = JOINT_LOWER_RAD[LEFT], JOINT_UPPER_RAD[LEFT]
    path = plan_paths({LEFT: start(LEFT, lower)}, {LEFT: upper}, 1.0)[LEFT]
    check(path)
    assert path.end_rad == upper


def test_no_distance_is_without_a_plan():
    """Neither 0.135 rad, where ruckig alone fails now and then, nor the smallest."""
    numbers = random.Random(1)
    for distance in (0.135, 1e-3, 1e-6, 1e-9, 1e-12, 1e-15):
        for _ in range(100):
            q = numbers.uniform(-1.5, 1.5)
            path = plan_paths({LEFT: start(LEFT, at_home(0, q))}, {LEFT: at_home(0, q + distance)}, 1.0)[LEFT]
            assert path.end_rad[0] == pytest.approx(q + distance, abs=1e-14)


# -------------------------------------------------------------------------------------------------- from motion


def test_a_plan_from_motion_goes_on_from_there():
    """Joint 1 moves on to its goal without a stop, while joint 2 turns and comes back; there is no lead."""
    moving = start(LEFT, v={0: 0.6, 1: -0.9}, a={0: 2.0})
    path = plan_paths({LEFT: moving}, {LEFT: at_home(0, 1.8)}, 1.0)[LEFT]
    assert path.lead is None
    assert path.at(0.0) == moving.state
    check(path)
    assert path.end_rad == pytest.approx(at_home(0, 1.8), abs=3e-8)
    assert all(dq_radps[0] > 0.0 for _, dq_radps, _ in setpoints(path)[:-1])


def test_a_speed_factor_leaves_the_acceleration_of_a_moving_arm_alone():
    """From 0.2 rad/s to 0.5 with up to 2.4 rad/s², not 1.5: ruckig runs away below the present acceleration."""
    path = plan_paths({LEFT: start(LEFT, v={0: 0.2})}, {LEFT: at_home(0, 1.8)}, 0.5)[LEFT]
    assert max(ddq_radps2[0] for _, _, ddq_radps2 in setpoints(path)) > 2.0
    check(path)


def test_a_lower_speed_first_slows_down_and_never_dips_below_its_limit():
    """From 1 rad/s to 0.1: ruckig alone would swing back to -0.13 rad/s before it goes on."""
    moving = start(LEFT, at_home(0, -1.0), v={0: 1.0})
    path = plan_paths({LEFT: moving}, {LEFT: at_home(0, 1.0)}, 0.1)[LEFT]
    assert path.lead is not None and path.lead_s == pytest.approx(0.45)
    check(path)
    cruise = [dq_radps[0] for _, dq_radps, _ in setpoints(path)]
    assert min(cruise[:-100]) > 0.1 - 1e-9
    assert max(cruise[46:]) <= 0.1 + 1e-9


def test_the_other_arm_waits_out_the_lead_and_ends_at_the_same_time():
    """An arm at rest has a lead in which it does not move."""
    starts = {LEFT: start(LEFT, v={0: 1.0}), RIGHT: start(RIGHT)}
    goals = {LEFT: at_home(0, 1.5), RIGHT: at_home(0, 0.3, RIGHT)}
    paths = plan_paths(starts, goals, 0.2)
    assert paths[LEFT].duration_s == paths[RIGHT].duration_s
    assert paths[RIGHT].at(paths[RIGHT].lead_s - 0.01) == (HOME[RIGHT], REST, REST)
    for side, path in paths.items():
        check(path, BRAKES[side])
        assert path.end_rad == pytest.approx(goals[side], abs=3e-8)


TOO_LATE = start(LEFT, at_home(5, 1.27), v={5: 0.85}, a={5: -2.0})
"""0.13 rad before its limit: slowed to 0.8 rad/s only, it could not turn any more."""


@pytest.mark.parametrize(
    ("moving", "goal", "speed"),
    [
        (TOO_LATE, at_home(5, -1.4), 0.8),  # would move over the limit
        (start(LEFT, at_home(5, -1.14), v={5: -0.92, 0: 0.6}, a={5: 1.1}), at_home(0, -0.4), 0.8),  # could not stop
        (start(LEFT, v={0: 0.3}, brakes=braking(LEFT, a=0.1, j=0.1)), at_home(0, -1.0), 1.0),  # turns for too long
    ],
)
def test_a_plan_that_would_not_stay_inside_is_led_in_by_a_full_stop(moving, goal, speed):
    """The arm comes to rest first, and goes to its goal from there."""
    if goal[5] == HOME[LEFT][5]:
        goal = (*goal[:5], 1.4, goal[6])
    path = plan_paths({LEFT: moving}, {LEFT: goal}, speed)[LEFT]
    stop = moving.space.halt(moving.state)
    assert path.lead == stop
    assert path.at(path.lead_s)[1:] == (REST, REST)
    check(path, moving.space)
    assert path.end_rad == pytest.approx(goal, abs=3e-8)


def test_the_check_of_a_plan_is_bounded():
    """The last row above is what it says: it would turn for longer than is checked."""
    slow = braking(LEFT, a=0.1, j=0.1)
    assert 0.3 / 0.1 / slow.period_s > CHECKED_STEPS


def test_a_goal_at_a_limit_is_approached_from_motion_without_crossing_it():
    """Goals are inset by more than ruckig's own error."""
    moving = start(LEFT, v={n: 0.3 for n in range(ARM_DOF)})
    for goal in (JOINT_LOWER_RAD[LEFT], JOINT_UPPER_RAD[LEFT]):
        path = plan_paths({LEFT: moving}, {LEFT: goal}, 1.0)[LEFT]
        check(path)
        assert path.end_rad == pytest.approx(goal, abs=3e-8)


@settings(max_examples=60, derandomize=True, deadline=None)
@given(data=st.data(), speed=st.sampled_from([1.0, 0.7, 0.1]), is_dual=st.booleans())
def test_any_stoppable_state_has_a_plan_to_any_goal(data, speed, is_dual):
    """Whatever an arm does that it may do, there is a plan which keeps all limits and ends at the goal."""
    sides = list(Side) if is_dual else [LEFT]
    starts, goals = {}, {}
    for side in sides:
        joints, goal = [], []
        lower, upper = JOINT_LOWER_RAD[side], JOINT_UPPER_RAD[side]
        for n in range(ARM_DOF):
            v = data.draw(st.floats(-1.0, 1.0))
            a = data.draw(st.floats(-3.0, 3.0))
            if BRAKES[side].is_over(v, a, V):
                v, a = 0.4 * v, 0.4 * a
            q = lower[n] + data.draw(st.floats(0.0, 1.0)) * (upper[n] - lower[n])
            if not BRAKES[side].can_stop(n, q, v, a):
                q = 0.5 * (lower[n] + upper[n])
            joints.append((q, v, a))
            goal.append(data.draw(st.sampled_from([lower[n], upper[n], 0.5 * (lower[n] + upper[n]), q])))
        starts[side] = Start(State(*zip(*joints, strict=True)), BRAKES[side])
        goals[side] = tuple(goal)
    for side, path in plan_paths(starts, goals, speed).items():
        check(path, BRAKES[side])
        assert path.end_rad == pytest.approx(goals[side], abs=3e-8)


# ---------------------------------------------------------------------------------------------------- last look


@pytest.mark.parametrize(("end", "value"), [(2.0, 2.0), (-2.5, -2.5)])
def test_a_path_beyond_a_limit_is_never_handed_out(end, value):
    """Whatever ruckig may come to plan: the extrema of every path are looked at, those from rest too."""
    inside = plan_paths({LEFT: start(LEFT)}, {LEFT: HOME[LEFT]}, 1.0)[LEFT]
    entry, trajectory = InputParameter(ARM_DOF), Trajectory(ARM_DOF)
    entry.current_position, entry.target_position = HOME[LEFT], at_home(0, end)
    entry.max_velocity, entry.max_acceleration, entry.max_jerk = [V] * ARM_DOF, [A] * ARM_DOF, [J] * ARM_DOF
    Ruckig(ARM_DOF).calculate(entry, trajectory)
    path = structs.replace(inside, trajectory=trajectory, duration_s=trajectory.duration)
    objection = _objection(LEFT, BRAKES[LEFT], path, may_turn=False)
    assert (objection.joint, objection.bound) == ("left arm joint 1", "[-1.8, 1.8]")
    assert objection.value == pytest.approx(value)
    assert _objection(LEFT, BRAKES[LEFT], inside, may_turn=False) is None


# ------------------------------------------------------------------------------------------------- turning back


def profile(v, a, j, t, brake_s=0.0):
    """A profile as ruckig shows it."""
    return SimpleNamespace(v=v, a=a, j=j, t=t, brake=SimpleNamespace(duration=brake_s))


def test_a_joint_that_only_moves_on_never_turns():
    """Not even with a braking phase before, which is counted as such; nor does one at rest."""
    on = profile([0.5, 0.4, 0.3, 0.2, 0.2, 0.1, 0.05, 0.0], [0.0] * 8, [0.0] * 7, [0.1] * 7)
    assert _turned_s(on) == 0.0
    on.brake.duration = 0.2
    assert _turned_s(on) == 0.2
    assert _turned_s(profile([0.0] * 8, [0.0] * 8, [0.0] * 7, [0.1] * 7)) == 0.0


def test_a_joint_turns_until_the_phase_in_which_it_comes_about():
    """Whether it is on its way back at the end of a phase, or only within it."""
    back = profile([0.5, 0.4, 0.0, -0.2, -0.2, -0.1, -0.05, 0.0], [0.0] * 8, [0.0] * 7, [0.1] * 7)
    assert _turned_s(back) == pytest.approx(0.2)
    dips = profile(
        [0.1, 0.1, 0.3, 0.4, 0.4, 0.2, 0.1, 0.0], [-2.0, 2.0] + [0.0] * 6, [10.0] + [0.0] * 6, [0.4] + [0.1] * 6
    )
    assert _turned_s(dips) == pytest.approx(0.4)
