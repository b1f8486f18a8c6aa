"""One arm's part of a straight motion: from rest to rest, straight, inside the limits by differences, stoppable throughout."""

from __future__ import annotations

import math
import random

import pytest

from gateway.core.motion.joints.braking import REST, Braking
from gateway.core.motion.lines.line import line_to
from gateway.core.motion.lines.line_path import LinePath, unstoppable
from gateway.errors import Refusal
from gateway.robot.limits import HOME_Q_RAD
from gateway.values import Side
from tests.changed import replace
from tests.core.lines import DT_S, HOME, LIMITS, beside, finished, off_line, planned, random_way, setpoints, used
from tests.kinematics.bodies import ARMS
from tests.thoroughness import either

L = Side.LEFT

BRAKING = Braking(LIMITS[L], DT_S)


def test_it_begins_and_ends_at_rest_in_exactly_the_joints_asked_for():
    """At time 0 the reference's own state, from the duration on the last place, without a residue of motion."""
    path = planned(beside(L, (0.05, 0.0, 0.1)))
    q_rad, v, a = path.at(0.0)
    assert (q_rad, tuple(map(abs, v)), tuple(map(abs, a))) == (HOME_Q_RAD[L], REST, REST)
    for time_s in (path.duration_s, path.duration_s + 1.0):
        assert path.at(time_s) == (path.end_rad, REST, REST)
    assert path.duration_ns == round(path.duration_s * 1e9)
    assert ARMS[L].forward(path.end_rad).p_m == pytest.approx(beside(L, (0.05, 0.0, 0.1)).p_m, abs=1e-9)


@pytest.mark.parametrize("side", list(Side))
def test_setpoints_are_straight_and_keep_the_limits(side):
    """FK of every setpoint within 0.1 mm and 0.1 mrad of line and arc, at one part of both; differences inside v, a, j."""
    rng, found = random.Random(6), 0
    for _ in range(either(15, 150)):
        q_rad, target = random_way(rng, side)
        path = planned(target, q_rad, side)
        if isinstance(path, Refusal):
            continue
        found += 1
        line = line_to(ARMS[side].forward(q_rad), target)
        sent = setpoints(path)
        assert max(used(sent, LIMITS[side])) <= 1.0 + 1e-6
        for n, q in enumerate(sent[3:], start=1):
            part = path.clock.at(n * DT_S)[0] if n * DT_S < path.duration_s else 1.0
            assert off_line(side, q, line.at(part)) < 1e-4
    assert found > 7


def test_a_stop_from_anywhere_on_the_way_stays_inside_the_limits():
    """What `unstoppable` looks for is not there: braking from every setpoint ends inside."""
    rng, found = random.Random(9), 0
    for _ in range(either(15, 100)):
        q_rad, target = random_way(rng, L)
        path = planned(target, q_rad)
        if isinstance(path, Refusal):
            continue
        found += 1
        for n in range(1, math.ceil(path.duration_s / DT_S)):
            state = path.at(n * DT_S)
            for joint, (q, v, a) in enumerate(zip(*state, strict=True)):
                assert BRAKING.can_stop(joint, q, v, a)
                rest = BRAKING.rest(q, v, a)
                assert LIMITS[L].lower_rad[joint] - 1e-9 <= rest <= LIMITS[L].upper_rad[joint] + 1e-9
    assert found > 7


def test_a_setpoint_from_which_a_joint_cannot_stop_is_found():
    """A path pushed to a quarter of its time runs out of room where a joint turns back near its limit."""
    rng = random.Random(2)
    for _ in range(200):
        q_rad, target = random_way(rng, L)
        path = planned(target, q_rad)
        if isinstance(path, Refusal):
            continue
        hasty = replace(path, clock=path.clock.slower(0.25))
        found, _ = finished(unstoppable(hasty, BRAKING))
        if found is not None:
            state = hasty.at(next(n * DT_S for n in range(1, 9999) if hasty.clock.at(n * DT_S)[0] == found.part))
            assert (state[0][found.joint], state[1][found.joint]) == (found.q_rad, found.dq_radps)
            assert not BRAKING.can_stop(found.joint, *(row[found.joint] for row in state))
            return
    pytest.fail("no path that must brake near a limit was found")


def test_a_path_far_from_all_limits_is_not_looked_at():
    """Where no joint comes near a limit every setpoint is stoppable at any speed: one piece of work."""
    q_rad = tuple((a + b) / 2 for a, b in zip(ARMS[L].lower_rad, ARMS[L].upper_rad, strict=True))
    line = line_to(ARMS[L].forward(q_rad), replace(HOME[L], p_m=ARMS[L].forward(q_rad).p_m))
    there = line.at(0.02).pose
    path = planned(there, q_rad)
    wide = replace(LIMITS[L], lower_rad=(-9.0,) * 7, upper_rad=(9.0,) * 7)
    assert isinstance(path, LinePath)
    assert finished(unstoppable(path, Braking(wide, DT_S))) == (None, 1)
