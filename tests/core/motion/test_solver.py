"""What ruckig must be helped with: profiles on the border between two shapes, and durations beyond its numbers."""

from __future__ import annotations

import math
import random

import pytest
from ruckig import InputParameter, Ruckig, RuckigError, Synchronization

from gateway.core.motion.solver import JERK_FACTORS, LONGEST_S, NoPlan, Plan, solve


def entry(q=0.0, goal=1.0, v=1.0, a=3.0, j=20.0, joints=1) -> InputParameter:
    """Joints that do the same from rest to rest."""
    made = InputParameter(joints)
    made.synchronization = Synchronization.No
    made.current_position, made.target_position = [q] * joints, [goal] * joints
    made.max_velocity, made.max_acceleration, made.max_jerk = [v] * joints, [a] * joints, [j] * joints
    return made


class Balking:
    """Stands in for ruckig: finds no plan for some of the jerk limits it is asked with."""

    def __init__(self, *, balks: int):
        self.balks = balks
        self.jerks = []

    def calculate(self, asked, trajectory):
        """Fail until it has failed often enough."""
        self.jerks.append(asked.max_jerk[0])
        if len(self.jerks) <= self.balks:
            raise RuckigError("error in step 1")


def test_a_plan_is_found():
    """The ordinary case is ruckig's own."""
    trajectory, asked = Plan(1), entry()
    solve(Ruckig(1), asked, trajectory)
    assert trajectory.duration == pytest.approx(1.0 + 1.0 / 3.0 + 3.0 / 20.0)
    assert asked.max_jerk == [20.0]


def test_a_plan_on_the_border_between_two_shapes_is_found_all_the_same():
    """From rest over 2·a³/j² (0.135 rad), where ruckig alone fails in about 1 of 50 starts, there is always a plan."""
    numbers = random.Random(3)
    planner, trajectory = Ruckig(1), Plan(1)
    for _ in range(1000):
        start = numbers.uniform(-2.0, 2.0)
        goal = start + 0.135 + numbers.randint(-20, 20) * 2.2e-16
        asked = entry(q=start, goal=goal)
        solve(planner, asked, trajectory)
        assert trajectory.duration == pytest.approx(0.6, rel=1e-6)
        assert trajectory.at_time(1.0)[0][0] == pytest.approx(goal, abs=1e-12)
        assert asked.max_jerk == [20.0]


@pytest.mark.parametrize("balks", [1, 2])
def test_a_hair_less_jerk_is_tried_when_there_is_no_plan(balks):
    """Two hairs, the thinner one first; the input is as it was afterwards."""
    balking, asked = Balking(balks=balks), entry()
    solve(balking, asked, Plan(1))
    assert balking.jerks == [20.0, *(20.0 * factor for factor in JERK_FACTORS[:balks])]
    assert asked.max_jerk == [20.0]


def test_where_there_is_no_plan_the_reason_is_ruckigs():
    """After the last try the error says what ruckig said, and the input is as it was."""
    asked = entry(goal=math.nan)
    with pytest.raises(NoPlan, match="target position nan of DoF 0 should be a valid number"):
        solve(Ruckig(1), asked, Plan(1))
    assert asked.max_jerk == [20.0]


def test_a_motion_of_hours_is_refused_in_words():
    """The bindings have no name for a duration beyond ruckig's numbers; up to `LONGEST_S` there is a plan."""
    solve(Ruckig(2), entry(goal=LONGEST_S * 1e-4, v=1e-4, joints=2), Plan(2))
    with pytest.raises(NoPlan, match="longer than ruckig can plan, about 2 h"):
        solve(Ruckig(2), entry(goal=3 * LONGEST_S * 1e-4, v=1e-4, joints=2), Plan(2))


@pytest.mark.parametrize("balking", [False, True])
def test_a_plan_can_be_found_again_from_what_it_was_made_of(balking):
    """Bit by bit, also where the first try found none: the black box keeps nothing else of it."""
    kept = Plan(1)
    solve(Ruckig(1), entry(goal=0.135 if balking else 1.0), kept)
    again = Plan(1)
    solve(Ruckig(1), kept.entry, again)
    times = [kept.duration * part / 97 for part in range(98)]
    assert [kept.at_time(time) for time in times] == [again.at_time(time) for time in times]
