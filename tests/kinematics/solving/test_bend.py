"""How an arm is bent: every way to hold a pose bent as a posture, smoothly; corrected where the shape is only near."""

from __future__ import annotations

import math

import pytest

from gateway.kinematics.arm import ArmModel, NotClosed
from gateway.robot.limits import HOME_Q_RAD
from gateway.values import Side
from tests.kinematics.bodies import ARMS, difference, nudged, samples
from tests.thoroughness import either

L = Side.LEFT
NEAR = ArmModel(nudged(L, 5, xyz_m=(0.002, 0.001, -0.003), rpy_rad=(0.004, -0.003, 0.002)), L)
"""An arm of nearly the shape."""


@pytest.mark.parametrize("side", list(Side))
def test_a_swivel_is_every_way_to_hold_a_pose_bent_as_the_posture(side):
    """All its joint angles take the pose; at the posture's own arm angle they are the posture."""
    arm = ARMS[side]
    for q in samples(side, either(50, 500), seed=12):
        target, bend = arm.chain.forward(q), arm.bend(q)
        swivel = bend.swivel(target)
        assert bend.arm_angle_rad == arm.arm_angle_rad(q)
        assert swivel.at(bend.arm_angle_rad) == pytest.approx(q, abs=1e-7)
        for by in (-0.3, 0.01, 1.0):
            assert max(difference(arm.chain.forward(swivel.at(bend.arm_angle_rad + by)), target)) < 1e-9
        assert bend.refined(target, q) == q


@pytest.mark.parametrize("arm", [ARMS[L], NEAR])
def test_a_swivel_ends_where_the_wrist_is_out_of_reach(arm):
    """A pose four times as far: no arm angle does it."""
    home = arm.chain.forward(HOME_Q_RAD[L])
    assert arm.bend(HOME_Q_RAD[L]).swivel(home._replace(p_m=tuple(4.0 * c for c in home.p_m))) is None


def test_an_arm_of_nearly_the_shape_goes_on_from_exactly_its_posture():
    """At the posture itself nothing is off; beside it the rest is corrected to a nanometre, smoothly."""
    q = HOME_Q_RAD[L]
    target, bend = NEAR.chain.forward(q), NEAR.bend(q)
    assert not bend.is_exact
    assert bend.swivel(target).at(bend.arm_angle_rad) == pytest.approx(q, abs=1e-12)
    rows = []
    for n in range(6):
        there = target._replace(p_m=(target.p_m[0] - 0.003 * n, *target.p_m[1:]))
        guess = bend.swivel(there).at(bend.arm_angle_rad)
        rows.append(bend.refined(there, guess))
        assert max(difference(NEAR.chain.forward(rows[-1]), there)) < 2e-9
        assert math.dist(rows[-1], guess) < 0.01
    for a, b, c, d in zip(rows, rows[1:], rows[2:], rows[3:], strict=False):
        third = [w - 3 * z + 3 * y - x for x, y, z, w in zip(a, b, c, d, strict=True)]
        assert max(map(abs, third)) < 1e-3


def test_what_cannot_be_corrected_inside_the_limits_is_none():
    """Another pose far away, from joints that do not take it."""
    q = HOME_Q_RAD[L]
    target = NEAR.chain.forward(q)
    assert NEAR.bend(q).refined(target._replace(p_m=tuple(4.0 * c for c in target.p_m)), q) is None


def test_an_arm_of_another_shape_has_no_bend():
    """Axes that do not meet at all: said so."""
    arm = ArmModel(nudged(L, 5, xyz_m=(0.1, 0.05, 0.0), rpy_rad=(0.5, 0.0, 0.0)), L)
    with pytest.raises(NotClosed):
        arm.bend(HOME_Q_RAD[L])
