"""Identification: injected offsets come back as promised, and where they cannot, it refuses and says how they could.

The measurements are the simulator's own geometry, which shares nothing with ours.
"""

from __future__ import annotations

import numpy as np
import pytest

from gateway.kinematics.identification.parameters import Group
from gateway.kinematics.identify import (
    ACCURACY_M,
    ACCURACY_RAD,
    LEAST_POSTURES,
    Identification,
    Unidentified,
    Why,
    identify,
)
from gateway.values import EePose, Side
from tests.changed import replace
from tests.kinematics.bodies import ARMS
from tests.kinematics.identities import EE_M, EE_TURN_RAD, NOISE_M, OFFSETS_RAD, measured, postures
from tests.thoroughness import either

WHOLE = frozenset({Group.JOINTS, Group.EE, Group.SHOULDER})


def promised(found):
    """Assert that every number is as near to the truth as promised, and as the covariance says."""
    assert isinstance(found, Identification), found.message
    truth = dict(zip([f"joint {n} zero" for n in range(1, 8)], OFFSETS_RAD, strict=True))
    truth |= dict(zip(("ee x", "ee y", "ee z"), EE_M, strict=True))
    truth |= dict(zip(("ee turn about x", "ee turn about y"), EE_TURN_RAD[:2], strict=True))
    for row in found.estimates:
        off = abs(row.value - truth.get(row.name, 0.0))
        assert off < (ACCURACY_M if row.unit == "m" else ACCURACY_RAD), row
        assert off < 5 * row.sigma and 3 * row.sigma <= ACCURACY_RAD


@pytest.mark.parametrize("seed", range(either(1, 4)))
@pytest.mark.parametrize("side", Side)
def test_injected_offsets_come_back_as_promised(side, seed):
    """Within 0.2 mrad and 0.2 mm from 40 s of all joints in motion, with noise of 0.2 mm and 0.5 mrad in each pose."""
    found = identify(ARMS[side], measured(side, postures(side, seed=seed), seed=seed))
    promised(found)
    np.testing.assert_allclose(found.correction.offsets_rad, OFFSETS_RAD, atol=0.2e-3)
    np.testing.assert_allclose(found.correction.ee.p_m, EE_M, atol=0.2e-3)
    assert found.before.position_m > 3e-3 and found.before.angle_rad > 10e-3
    assert found.after.position_m == pytest.approx(1.54 * NOISE_M, rel=0.1), "what is left is the noise"
    assert found.validated.position_m == pytest.approx(found.after.position_m, rel=0.1)
    assert found.share == 1.0 and found.excitation.is_enough
    matrix = np.array(found.covariance)
    np.testing.assert_allclose(np.sqrt(np.diag(matrix)), [row.sigma for row in found.estimates], rtol=1e-9)
    assert np.all(np.linalg.eigvalsh(matrix) > 0.0)


@pytest.mark.parametrize("side", either((Side.LEFT,), tuple(Side)))
def test_the_shoulder_is_told_apart_too(side):
    """All seventeen parameters at once; there is nothing wrong with the shoulder here, and that is what is found."""
    promised(identify(ARMS[side], measured(side, postures(side)), WHOLE))


def test_joints_alone_are_told_with_less_motion():
    """Fewer parameters need less: half the range is enough where the end effector is known."""
    side = Side.LEFT
    pairs = measured(side, postures(side, share=0.4), ee_m=np.zeros(3), ee_turn=np.zeros(3))
    found = identify(ARMS[side], pairs, frozenset({Group.JOINTS}))
    promised(found)
    assert len(found.estimates) == 7


def test_a_robot_as_described_has_nothing_to_correct():
    """Zeros within their standard deviations."""
    side = Side.RIGHT
    none = np.zeros(3)
    found = identify(ARMS[side], measured(side, postures(side), offsets=np.zeros(7), ee_m=none, ee_turn=none))
    assert isinstance(found, Identification)
    assert all(abs(row.value) < 5 * row.sigma for row in found.estimates)


def test_a_lag_between_the_streams_is_found_along():
    """Poses of 18 ms later than they say, as an arrival that is only known roughly makes them: found, and nothing spoilt."""
    side = Side.LEFT
    pairs = measured(side, postures(side, 3500), lag_s=0.018)
    found = identify(ARMS[side], pairs)
    promised(found)
    assert found.lag_s == pytest.approx(0.018, abs=5e-4)
    unstamped = identify(ARMS[side], [replace(pair, stamp_ns=0) for pair in pairs])
    assert isinstance(unstamped, Unidentified), "without stamps nobody can know, and nobody pretends to"


@pytest.mark.thorough
def test_a_lag_that_wavers_spoils_nothing():
    """Times that scatter by 3 ms about their lag, and a host that stood still now and then: still as promised."""
    side = Side.LEFT
    rng = np.random.default_rng(3)
    pairs = measured(side, postures(side, 3500), lag_s=0.018 + 3e-3 * rng.normal(size=3500))
    whole = [pair for index, pair in enumerate(pairs) if index % 200 > 14]
    found = identify(ARMS[side], whole)
    promised(found)
    assert found.share > 0.95 and found.lag_s == pytest.approx(0.018, abs=1e-3)


def test_postures_that_are_held_have_no_lag():
    """One pair of each, seconds apart: nobody knows how fast the arm was, and it does not matter."""
    side = Side.LEFT
    q = postures(side)[::4]
    pairs = [replace(pair, stamp_ns=100 * pair.stamp_ns) for pair in measured(side, q, noise=0.3)]
    found = identify(ARMS[side], pairs)
    promised(found)
    assert found.lag_s == 0.0


def test_outliers_are_left_out():
    """A fifth of the poses of another posture: still as promised, and told."""
    side = Side.LEFT
    pairs = measured(side, postures(side, 3500))
    pairs = [
        replace(pair, pose=pairs[index - 500].pose) if index % 5 == 0 else pair for index, pair in enumerate(pairs)
    ]
    found = identify(ARMS[side], pairs)
    promised(found)
    assert 0.75 < found.share < 0.85


@pytest.mark.parametrize("still", either((1, 4, 7), range(1, 8)))
def test_one_joint_that_stands_still_is_never_guessed_over(still):
    """Either the rest tells it, as promised, or it refuses; with joint 7 still nobody can tell, and it says so."""
    side = Side.LEFT
    q = postures(side)
    q[:, still - 1] = q[0, still - 1]
    found = identify(ARMS[side], measured(side, q))
    if still == 7:
        assert isinstance(found, Unidentified) and found.why is Why.BLURRED
        assert (
            "joint 6 zero with ee turn about" in found.message or "ee turn about y with joint 6 zero" in found.message
        )
        assert "joint 7" in found.hint
    elif isinstance(found, Identification):
        promised(found)
    else:
        assert found.why is Why.NOISY


@pytest.mark.parametrize("moving", range(1, 8))
def test_one_joint_alone_is_not_enough(moving):
    """However long it moves; the hint names other joints."""
    side = Side.RIGHT
    q = np.tile(postures(side)[:1], (1500, 1))
    q[:, moving - 1] = postures(side)[:1500, moving - 1]
    found = identify(ARMS[side], measured(side, q))
    assert isinstance(found, Unidentified) and found.why is Why.BLURRED and found.before is not None
    assert "cannot be told apart: " in found.message and "at least 0.05 is needed" in found.message
    assert found.hint.startswith("move, beside what has moved") and f"joint {moving} " not in found.hint


def test_an_arm_that_stands_still_tells_nothing():
    """Ten thousand pairs of one posture are one posture, and none is none."""
    side = Side.LEFT
    one = measured(side, postures(side)[:1])
    found = identify(ARMS[side], one * 10_000)
    assert isinstance(found, Unidentified) and found.why is Why.FEW
    assert "1 different postures in 10000 pairs" in found.message and str(LEAST_POSTURES) in found.message
    nothing = identify(ARMS[side], [])
    assert isinstance(nothing, Unidentified) and nothing.why is Why.FEW and nothing.excitation is None


def test_too_much_scatter_is_refused():
    """Enough motion, but the worst parameter is known too badly: which, and how badly."""
    side = Side.LEFT
    found = identify(ARMS[side], measured(side, postures(side), noise=4.0))
    assert isinstance(found, Unidentified) and found.why is Why.NOISY
    assert "(3 sigma), 0.2 is promised" in found.message and found.missing is not None and found.missing > 1.5
    assert f"take more pairs, some {found.missing:.1f} times as many" in found.hint


def test_the_other_arms_poses_are_refused():
    """Nothing about zeros and mounts explains them."""
    found = identify(ARMS[Side.RIGHT], measured(Side.LEFT, postures(Side.RIGHT)))
    assert isinstance(found, Unidentified) and found.why is Why.UNEXPLAINED and "of this arm" in found.hint


def test_another_body_is_refused():
    """A forearm that is 40 mm longer is not made of joint zeros."""
    side = Side.LEFT
    pairs = []
    for pair in measured(side, postures(side)):
        x, y, z = pair.pose.p_m
        pairs.append(replace(pair, pose=EePose(p_m=(1.08 * x, 1.08 * y, 1.08 * z), quat_xyzw=pair.pose.quat_xyzw)))
    found = identify(ARMS[side], pairs)
    assert isinstance(found, Unidentified) and found.why is Why.UNEXPLAINED


def test_an_arm_that_slips_on_the_way_does_not_pass():
    """A zero that jumps by 20 mrad half way: no one correction holds for all of it, and it is not averaged over."""
    side = Side.LEFT
    q = postures(side)
    slipped = OFFSETS_RAD + np.array([0, 0.02, 0, 0.02, 0, 0, 0])
    pairs = [*measured(side, q[:1000]), *measured(side, q[1000:], offsets=slipped)]
    found = identify(ARMS[side], pairs)
    assert isinstance(found, Unidentified) and found.why in (Why.OVERFITTED, Why.NOISY, Why.UNEXPLAINED)
