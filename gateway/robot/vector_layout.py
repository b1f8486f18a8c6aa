"""The 72 numbers that datasets and policies of this robot speak of: their names in order, and a gripper's command as effort.

State and action share the layout. Shorter vectors are its prefixes: 48 are joints and grippers, 62 have the end effectors too.
Source: the vendor's public converter and policy (`rosbag_to_dataset_TA2`, `openpi/examples/teleavatar_v2`). Pure.
"""

from __future__ import annotations

from gateway.robot.limits import GRIPPER_CLOSE_NM, GRIPPER_OPEN_NM, GRIPPER_RELAXED
from gateway.values import Side

__all__ = ["EYES", "STATE_NAMES", "STATE_WIDTHS", "command_of_effort", "effort_of_command"]


def _names() -> tuple[str, ...]:
    names = [
        f"{side}_{part}_{quantity}"
        for quantity in ("position", "velocity", "effort")
        for side in Side
        for part in (*(f"joint{n}" for n in range(1, 8)), "gripper")
    ]
    for side in Side:
        names += [f"{side}_ee_position_{axis}" for axis in "xyz"]
        names += [f"{side}_ee_orientation_{axis}" for axis in "xyzw"]
    names += [f"chassis_motor{n}_{quantity}" for quantity in ("position", "velocity", "effort") for n in range(1, 4)]
    return (*names, "kinco_velocity")


STATE_NAMES: tuple[str, ...] = _names()
"""Names of the 72 dims in order: rad, rad/s and N·m; metres and quaternions (x, y, z, w) in the arm's own shoulder frame."""

STATE_WIDTHS: tuple[int, ...] = (48, 62, 72)
"""Widths in use: each is a prefix of the next."""


EYES: dict[str, dict[str, str]] = {
    "vendor_openpi": {
        "head_camera": "head_left_eye",
        "left_color": "left_wrist_right_eye",
        "right_color": "right_wrist_left_eye",
    },
    "left_eyes": {
        "head_camera": "head_left_eye",
        "left_color": "left_wrist_left_eye",
        "right_color": "right_wrist_left_eye",
    },
}
"""Which view of the composite (§5.2) each camera of a dataset is: of the wrists the inner eyes, or the left ones."""


def effort_of_command(c: float) -> float:
    """Return the effort [N·m] that a dataset has for a gripper's command 0..1; positive opens, negative closes.

    The vendor's own two lines, to the last digit; the manual's table (§4.4, `limits.gripper_torque_nm`) is these, rounded.

    Raises:
        ValueError: Not a number from 0 to 1.
    """
    if not 0.0 <= c <= 1.0:
        raise ValueError(f"a gripper's command is a number from 0 to 1, not {c:g}")
    if c < GRIPPER_RELAXED:
        return GRIPPER_OPEN_NM * (1.0 - c / GRIPPER_RELAXED)
    return 0.0 - GRIPPER_CLOSE_NM * (c - GRIPPER_RELAXED) / (1.0 - GRIPPER_RELAXED)


def command_of_effort(e: float) -> float:
    """Return the command 0..1 that stands for an effort [N·m]; an effort beyond the curve's ends gives its end.

    Raises:
        ValueError: Not a number.
    """
    if e != e:
        raise ValueError("a gripper's effort is a number [N·m], not nan")
    if e > 0.0:
        command = GRIPPER_RELAXED * (1.0 - e / GRIPPER_OPEN_NM)
    else:
        command = GRIPPER_RELAXED - e * (1.0 - GRIPPER_RELAXED) / GRIPPER_CLOSE_NM
    return min(1.0, max(0.0, command))
