"""Model check: what the manual and the published figures say of the body, worked out again from a description.

Each finding has the figure from the numbers, the one it is held against with its source, and how far they may differ. A
URDF given by a user goes through the same list, and is then compared with our own numbers: what differs there is told, not
judged, because a single robot's calibrated arm is meant to differ.
"""

from __future__ import annotations

import math
import random
from collections.abc import Iterator

from msgspec import Struct

from gateway.kinematics.arm import ArmModel
from gateway.kinematics.description import Description, nominal
from gateway.kinematics.placement import Placement, turn_rad
from gateway.kinematics.solving.chain import at_zero
from gateway.kinematics.solving.inverse import Solution
from gateway.robot.limits import HOME_Q_RAD, JOINT_LOWER_RAD, JOINT_UPPER_RAD, MAX_ARM_LEN_M
from gateway.robot.topics import shoulder_frame
from gateway.values import EePose, Side, Vector

__all__ = ["Finding", "compared", "findings"]

COMMON = "virtual_base"
"""The robot's common frame, as the description calls it too."""
HEAD = "eye_Link"
"""The description's name of `head_camera_center`."""

HEAD_ROWS = ((0.0, -0.4384, 0.8988), (-1.0, 0.0, 0.0), (0.0, -0.8988, -0.4384))
"""Rotation of `virtual_base_T_head_camera_center` (manual A.3)."""

MOUNT_M = {Side.LEFT: (-0.10561, 0.22, -0.19311), Side.RIGHT: (-0.10561, -0.22, -0.19311)}
"""Origin of an arm's nominal mount in `virtual_base` (manual A.3)."""

POSE_61 = EePose(
    p_m=(-0.014433992985935767, 0.0181230355198717, -0.545),
    quat_xyzw=(-0.651863775688076, 0.260180077341881, 0.7053938323707012, 0.0989923560353721),
)
"""Target of the manual's example §6.1, left arm."""

HOME = {
    Side.LEFT: EePose(p_m=(0.37342, 0.09287, -0.35109), quat_xyzw=(-0.60615, 0.06309, -0.20164, 0.76678)),
    Side.RIGHT: EePose(p_m=(0.40409, -0.11846, -0.22319), quat_xyzw=(0.27021, 0.25035, 0.38367, 0.84682)),
}
"""Poses of the initial position of §6.6, published with the numbers."""

ZERO: Vector = (0.0,) * 7
COMPARED = 1000
"""Random configurations at which two descriptions are held against each other."""


class Finding(Struct, frozen=True, kw_only=True):
    """One line of the check.

    Attributes:
        name: What was worked out.
        found: The figure from the numbers, for people.
        expected: What it is held against, with its source; empty where it is only told.
        off: By how much it differs, in the unit.
        allowed: How much it may; infinite where it is only told.
        unit: Of both.
    """

    name: str
    found: str
    expected: str
    off: float
    allowed: float
    unit: str

    @property
    def is_good(self) -> bool:
        """Whether the figures agree."""
        return self.off <= self.allowed


def findings(description: Description) -> tuple[Finding, ...]:
    """Return what the manual and the published figures say of a body, checked."""
    arms = {side: ArmModel(description, side) for side in Side}
    return (
        *_head(description),
        *(row for side in Side for row in _arm(description, arms[side])),
        _example(arms[Side.LEFT]),
    )


def compared(description: Description) -> tuple[Finding, ...]:
    """Return how a body differs from our own numbers; told, not judged."""
    return tuple(row for side in Side for row in _differences(description, side))


def _head(description: Description) -> Iterator[Finding]:
    at = at_zero(description, HEAD, COMMON)
    if at is None:
        return
    off = max(
        abs(a - b) for row, wanted in zip(at.rows, HEAD_ROWS, strict=True) for a, b in zip(row, wanted, strict=True)
    )
    yield Finding(
        name="head camera's tilt, virtual_base_T_head_camera_center",
        found=f"{at.rows[0][1]:.5f}, {at.rows[0][2]:.5f}",
        expected=f"{HEAD_ROWS[0][1]}, {HEAD_ROWS[0][2]} (manual A.3)",
        off=off,
        allowed=1e-4,
        unit="",
    )


def _arm(description: Description, arm: ArmModel) -> Iterator[Finding]:
    side = arm.side
    mount = at_zero(description, shoulder_frame(side), COMMON)
    if mount is not None:
        yield Finding(
            name=f"{side} mount, virtual_base_T_{side}_base_virtual",
            found=_millimetres(mount.p_m),
            expected=f"{_millimetres(MOUNT_M[side])} mm (manual A.3)",
            off=1e3 * math.dist(mount.p_m, MOUNT_M[side]),
            allowed=1.0,
            unit="mm",
        )
    shape = arm.shape
    yield Finding(
        name=f"{side} axes 1, 2, 3 meet in the shoulder, 5, 6, 7 in the wrist",
        found="all meet" if shape.is_exact else shape.worst,
        expected="spherical shoulder and wrist (vendor's description)",
        off=1e3 * shape.gap,
        allowed=1e-6,
        unit="mm",
    )
    yield Finding(
        name=f"{side} shoulder is the frame of the poses, and {side}_ee the wrist",
        found=f"{_millimetres(shape.shoulder_m)}; {_millimetres(shape.tip.p_m)}",
        expected="both zero (vendor's description)",
        off=1e3 * max(math.hypot(*shape.shoulder_m), math.hypot(*shape.tip.p_m)),
        allowed=1e-6,
        unit="mm",
    )
    if shape.is_exact:
        near, far = arm.reach_m()
        yield Finding(
            name=f"{side} reach inside the limits",
            found=f"{near:.4f} to {far:.4f} m",
            expected=f"max_arm_len {MAX_ARM_LEN_M} m (manual §4.0.4)",
            off=1e3 * abs(far - MAX_ARM_LEN_M),
            allowed=5.0,
            unit="mm",
        )
    yield from _poses(arm)
    yield _ranges(description, side)


def _poses(arm: ArmModel) -> Iterator[Finding]:
    side = arm.side
    out = 1.0 if side is Side.LEFT else -1.0
    zero = arm.chain.forward(ZERO)
    x, _, z = zip(*zero.rows, strict=True)
    yield Finding(
        name=f"{side}_ee with all joints at zero",
        found=f"{_millimetres(zero.p_m)}; +X ({x[0]:.0f}, {x[1]:.0f}, {x[2]:.0f}), +Z ({z[0]:.0f}, {z[1]:.0f}, {z[2]:.0f})",
        expected="+X outboard, +Z up (published)",
        off=max(math.dist(x, (0.0, out, 0.0)), math.dist(z, (0.0, 0.0, 1.0))),
        allowed=1e-6,
        unit="",
    )
    home, wanted = arm.chain.forward(HOME_Q_RAD[side]), Placement.of(HOME[side])
    off = max(math.dist(home.p_m, wanted.p_m), 0.3 * math.hypot(*turn_rad(home.rows, wanted.rows)))
    yield Finding(
        name=f"{side}_ee at the home of §6.6",
        found=_millimetres(home.p_m),
        expected=f"{_millimetres(wanted.p_m)} mm and quaternion (published)",
        off=1e3 * off,
        allowed=0.02,
        unit="mm",
    )


def _ranges(description: Description, side: Side) -> Finding:
    """Return how far a description's ranges reach beyond the robot's limits: inside is good, and some are narrower."""
    rows = list(zip(description.arm(side), JOINT_LOWER_RAD[side], JOINT_UPPER_RAD[side], strict=True))
    beyond = max(max(low - joint.lower, joint.upper - high) for joint, low, high in rows)
    narrower = [
        f"{joint.name} {joint.lower:g}..{joint.upper:g}"
        for joint, low, high in rows
        if joint.lower > low or joint.upper < high
    ]
    return Finding(
        name=f"{side} joint ranges lie inside the robot's limits",
        found="narrower: " + ", ".join(narrower) if narrower else "the same",
        expected="software limits (manual §4.13)",
        off=max(beyond, 0.0),
        allowed=1e-9,
        unit="rad",
    )


def _example(arm: ArmModel) -> Finding:
    target = Placement.of(POSE_61)
    solved = arm.inverse(POSE_61, HOME_Q_RAD[Side.LEFT])
    if isinstance(solved, Solution):
        found = ", ".join(f"{q:.5f}" for q in solved.q_rad)
        at = arm.chain.forward(solved.q_rad)
        off = max(math.dist(at.p_m, target.p_m), math.hypot(*turn_rad(at.rows, target.rows)))
    else:
        found, off = solved.message, math.inf
    return Finding(
        name="target of §6.1, solved inside the limits",
        found=found,
        expected="exact solution exists (manual §6.1)",
        off=off,
        allowed=1e-8,
        unit="m, rad",
    )


def _differences(description: Description, side: Side) -> Iterator[Finding]:
    theirs, ours = ArmModel(description, side).chain, ArmModel(nominal(), side).chain
    rng = random.Random(0)
    way = turn = 0.0
    for _ in range(COMPARED):
        q = [rng.uniform(a, b) for a, b in zip(JOINT_LOWER_RAD[side], JOINT_UPPER_RAD[side], strict=True)]
        here, there = theirs.forward(q), ours.forward(q)
        way = max(way, math.dist(here.p_m, there.p_m))
        turn = max(turn, math.hypot(*turn_rad(here.rows, there.rows)))
    for name, off, unit in (("position", 1e3 * way, "mm"), ("orientation", turn, "rad")):
        yield Finding(
            name=f"{side}_ee: {name} against our own numbers",
            found=f"differs by up to {off:.3g} {unit} at {COMPARED} configurations",
            expected="",
            off=off,
            allowed=math.inf,
            unit=unit,
        )


def _millimetres(v: Vector) -> str:
    return "(" + ", ".join(f"{1e3 * c + 0.0:.3f}" for c in v) + ")"
