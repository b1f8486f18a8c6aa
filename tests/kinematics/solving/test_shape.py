"""Shape: the closed form is found in the axes, and what keeps an arm from having one is named."""

from __future__ import annotations

import pytest

from gateway.kinematics.description import nominal
from gateway.kinematics.solving.chain import ArmChain
from gateway.kinematics.solving.shape import shape_of
from gateway.values import Side
from tests.kinematics.bodies import nudged


@pytest.mark.parametrize("side", list(Side))
def test_the_nominal_arm_has_a_spherical_shoulder_and_a_spherical_wrist(side):
    """Shoulder at the frame of the poses, wrist at the end effector, the elbow's axis 30 mm beside the line between."""
    shape = shape_of(ArmChain(nominal(), side))
    out = 1.0 if side is Side.LEFT else -1.0
    assert shape.is_exact and shape.gap < 1e-15
    assert shape.shoulder_m == (0.0, 0.0, 0.0)
    assert shape.tip.p_m == pytest.approx((0.0, 0.0, 0.0), abs=1e-15)
    assert shape.upper_m == pytest.approx((0.03, out * 0.274), abs=1e-15)
    assert shape.lower_m == pytest.approx((-0.03, out * 0.2755), abs=1e-15)


@pytest.mark.parametrize("side", list(Side))
@pytest.mark.parametrize(
    ("number", "nudge", "gap", "worst"),
    [
        (2, {"xyz_m": (0.0, 0.002, 0.0)}, 0.002, "axes 1 and"),
        (6, {"xyz_m": (0.004, 0.0, 0.0)}, 0.004, "axes 5 and"),
        (7, {"xyz_m": (0.003, 0.0, 0.0)}, 0.003, "7 are apart"),
        (4, {"rpy_rad": (0.0, 0.02, 0.0)}, 0.02, "leans"),
    ],
)
def test_an_arm_whose_axes_miss_is_near_its_shape_and_says_what_misses(side, number, nudge, gap, worst):
    """What a URDF of one robot may do: the closed form is no longer exact, and the largest miss is named."""
    shape = shape_of(ArmChain(nudged(side, number, **nudge), side))
    assert not shape.is_exact and shape.is_near
    assert shape.gap == pytest.approx(gap, rel=0.02)
    assert worst in shape.worst


def test_an_arm_of_another_kind_is_not_near():
    """With a shoulder axis turned by a radian the closed form says nothing about the arm."""
    assert not shape_of(ArmChain(nudged(Side.LEFT, 2, rpy_rad=(1.0, 0.0, 0.0)), Side.LEFT)).is_near
