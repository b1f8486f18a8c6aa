"""What followers of joints and of poses share: streams, bounds, lateness and faults."""

from __future__ import annotations

import pytest

from gateway.core.motion import follower as module
from gateway.core.motion.joints.braking import REST, Braking, JointLimits
from gateway.core.motion.joints.follower import JointFollower
from gateway.core.motion.poses.pose_follower import PoseFollower
from gateway.core.motion.poses.pose_state import PoseDynamics
from gateway.core.motion.solver import NoPlan
from gateway.core.motion.space import State
from gateway.robot.limits import JOINT_LOWER_RAD, JOINT_UPPER_RAD
from gateway.values import Side
from tests.core import pose_judge

LOWER, UPPER = JOINT_LOWER_RAD[Side.LEFT], JOINT_UPPER_RAD[Side.LEFT]
JOINTS = JointLimits(v_radps=1.0, a_radps2=3.0, j_radps3=20.0, lower_rad=LOWER, upper_rad=UPPER)
BRAKING = Braking(JOINTS, 0.01)
DYNAMICS = PoseDynamics(pose_judge.LIMITS, pose_judge.DT)
HERE = pose_judge.posed((0.30, 0.10, -0.20))


@pytest.fixture(params=["joints", "poses"])
def led(request):
    """A follower that has begun, where its arm is, and a target far away."""
    if request.param == "joints":
        follower, state, far = JointFollower(BRAKING), State(LOWER, REST, REST), UPPER
    else:
        follower, state, far = PoseFollower(DYNAMICS), HERE, (-0.30, 0.10, -0.20, *HERE.values[3:])
    follower.begin()
    return follower, state, far


def run(follower, state, steps):
    """The states from one on."""
    states = [state]
    for _ in range(steps):
        states.append(follower.follow(states[-1]))
    return states


def fastest(states):
    """The highest speed of the axis with the way."""
    return max(abs(state.v[0]) for state in states)


def test_a_far_target_is_told_until_it_is_reached_or_forgotten(led):
    """Arriving ends it, and so does a new stream."""
    follower, state, far = led
    assert not follower.is_limited
    follower.aim(far, 1.0, state)
    states = run(follower, state, 80)
    assert follower.is_limited
    states = run(follower, states[-1], 600)
    assert states[-1].values == far and not follower.is_limited
    follower.aim(state.values, 1.0, states[-1])
    states = run(follower, states[-1], 80)
    assert follower.is_limited
    follower.forget_lateness()
    assert not follower.is_limited


def test_the_lower_of_factor_and_bound_counts_until_the_next_stream(led):
    """In mid-motion; a new stream begins without a bound."""
    follower, state, far = led
    follower.aim(far, 0.5, state)
    half = fastest(run(follower, state, 80))
    follower.bound(0.1)
    slow = run(follower, run(follower, state, 80)[-1], 60)
    assert abs(slow[-1].v[0]) == pytest.approx(0.2 * half, rel=0.02)
    follower.begin()
    assert follower.target == ()
    follower.aim(far, 0.5, state)
    assert fastest(run(follower, state, 80)) == pytest.approx(half)


def test_a_slow_stream_accelerates_gently_from_rest_until_it_is_disturbed(led):
    """Then with all that the limits allow: a plan below the present acceleration would run away."""
    follower, state, far = led
    follower.aim(far, 0.2, state)
    states = run(follower, state, 5)
    follower.disturb()
    again = run(follower, states[-1], 12)
    gently, fully = (max(abs(s.a[0]) for s in some) for some in (run(follower, state, 12), again))
    assert fully > 1.2 * gently


def test_what_ruckig_complains_of_is_counted(led, monkeypatch):
    """The arm brakes for those setpoints, and goes on after them."""
    follower, state, far = led
    follower.aim(far, 1.0, state)
    states = run(follower, state, 30)

    def none(*_):
        raise NoPlan("no plan today")

    with monkeypatch.context() as patched:
        patched.setattr(module, "solve", none)
        states = run(follower, states[-1], 90)
    assert states[-1].is_at_rest and states[-1].values != far
    assert follower.faults == 90
    assert run(follower, states[-1], 600)[-1].values == far
