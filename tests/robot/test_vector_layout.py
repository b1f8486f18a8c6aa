"""The layout that datasets and policies share, and a gripper's curve in it."""

from __future__ import annotations

import pytest

from gateway.robot.limits import gripper_torque_nm
from gateway.robot.vector_layout import STATE_NAMES, STATE_WIDTHS, command_of_effort, effort_of_command


def test_names_stand_where_the_vendors_readers_look_for_them() -> None:
    """Readers address dims by number: each landmark of the vendor's table is at its own."""
    assert len(STATE_NAMES) == len(set(STATE_NAMES)) == STATE_WIDTHS[-1] == 72
    landmarks = {
        0: "left_joint1_position",
        7: "left_gripper_position",
        14: "right_joint7_position",
        15: "right_gripper_position",
        16: "left_joint1_velocity",
        31: "right_gripper_velocity",
        39: "left_gripper_effort",
        47: "right_gripper_effort",
        48: "left_ee_position_x",
        54: "left_ee_orientation_w",
        55: "right_ee_position_x",
        61: "right_ee_orientation_w",
        62: "chassis_motor1_position",
        65: "chassis_motor1_velocity",
        70: "chassis_motor3_effort",
        71: "kinco_velocity",
    }
    assert {n: STATE_NAMES[n] for n in landmarks} == landmarks


@pytest.mark.parametrize(
    ("command", "effort"), [(0.0, 2.0), (0.05, 1.0), (0.10, 0.0), (0.20, -0.178), (0.55, -0.80), (1.0, -1.6)]
)
def test_a_command_has_the_effort_of_the_manuals_table(command: float, effort: float) -> None:
    """The curve goes through the table of §4.4, and the vendor's value where that table is rounded."""
    assert effort_of_command(command) == pytest.approx(effort, abs=3e-4)
    assert gripper_torque_nm(command) == pytest.approx(effort, abs=3e-3)


def test_there_and_back_is_where_it_began() -> None:
    """A recorded command comes out of its effort again; a neutral one has no negative zero."""
    for hundredth in range(101):
        assert command_of_effort(effort_of_command(hundredth / 100)) == pytest.approx(hundredth / 100, abs=1e-12)
    assert str(effort_of_command(0.1)) == "0.0"


def test_an_effort_beyond_the_curve_gives_its_end() -> None:
    """A policy may overshoot: the command is clipped to what may be sent (§4.4)."""
    assert command_of_effort(2.5) == 0.0
    assert command_of_effort(-9.0) == 1.0


def test_no_number_is_refused() -> None:
    """NaN, and a command that cannot be one."""
    with pytest.raises(ValueError, match="not nan"):
        command_of_effort(float("nan"))
    for command in (-0.01, 1.01, float("nan")):
        with pytest.raises(ValueError, match="from 0 to 1"):
            effort_of_command(command)
