"""The model check: the published table is met by our numbers, and a wrong number is found."""

from __future__ import annotations

import math

import pytest

from gateway.kinematics.description import nominal
from gateway.kinematics.model_check import compared, findings
from gateway.values import Side
from tests.changed import replace
from tests.kinematics.bodies import nudged


def test_our_numbers_meet_the_manual_and_every_published_figure():
    """Head tilt, mounts, spherical joints, reach, zero pose, home, ranges for both arms, and the target of §6.1."""
    rows = findings(nominal())
    assert [row.name for row in rows if not row.is_good] == []
    assert len(rows) == 16
    assert all(math.isfinite(row.allowed) and row.expected for row in rows)


@pytest.mark.parametrize(
    ("body", "names"),
    [
        (nudged(Side.LEFT, 4, xyz_m=(0.0, 0.0, 0.001)), {"left_ee at the home of §6.6"}),
        (
            nudged(Side.RIGHT, 6, xyz_m=(0.001, 0.0, 0.0)),
            {"right axes 1, 2, 3 meet in the shoulder, 5, 6, 7 in the wrist", "right_ee at the home of §6.6"},
        ),
        (
            nudged(Side.LEFT, 7, rpy_rad=(0.0, 0.0, 0.01)),
            {"left_ee at the home of §6.6", "left_ee with all joints at zero"},
        ),
    ],
)
def test_a_wrong_number_is_found(body, names):
    """A link that is a millimetre too long, an axis beside the wrist, a turned hand: each shows in its own rows."""
    assert names <= {row.name for row in findings(body) if not row.is_good}


def test_a_range_beyond_the_robots_limits_is_found():
    """A description that would let a joint go further than the robot does (§4.13)."""
    ours = nominal()
    wide = replace(ours.joints["armR6_joint"], upper=1.5)
    bad = [row for row in findings(replace(ours, joints={**ours.joints, "armR6_joint": wide})) if not row.is_good]
    assert [row.name for row in bad] == ["right joint ranges lie inside the robot's limits"]
    assert bad[0].off == pytest.approx(0.1)


def test_rows_about_frames_that_are_not_there_are_left_out():
    """A URDF needs the arms; whether it has a head is its own affair."""
    ours = nominal()
    headless = {name: joint for name, joint in ours.joints.items() if name != "eye_joint"}
    assert len(findings(replace(ours, joints=headless))) == 15


def test_another_body_is_compared_with_ours_and_not_judged():
    """How far the hands are apart at the worst of many configurations; the untouched arm does not differ."""
    rows = compared(nudged(Side.LEFT, 5, xyz_m=(0.002, 0.0, 0.0)))
    off = {row.name.partition(":")[0] + row.unit: row.off for row in rows}
    assert off["left_eemm"] == pytest.approx(2.0, abs=1e-6)
    assert off["left_eerad"] == pytest.approx(0.0, abs=1e-9)
    assert off["right_eemm"] == off["right_eerad"] == 0.0
    assert all(row.is_good for row in rows)
