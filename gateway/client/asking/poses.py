"""Poses of end effectors as a user says them: shape, numbers, norm, frame and reach checked before anything is sent.

Pure, as `requests.py`: the same mistake is the same exception here and in the daemon. A pose is a position [m] and a
quaternion in xyzw, in the arm's own shoulder frame, which must be named (manual §4.0.1, §4.2).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Protocol

from msgspec import Struct

from gateway.api import protocol
from gateway.client.asking.requests import SIDES, chosen, number, require_sides, row
from gateway.errors import Code, failure

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

__all__ = [
    "Axes",
    "PoseLike",
    "PoseTarget",
    "admittance",
    "frame_of",
    "move_pose",
    "numbers",
    "require_space",
    "within_reach",
]

Axes = float | Iterable[float | None] | None
"""A number for each of three axes, x, y, z, or one for all of them; None where there is none."""

NORM_TOLERANCE = 1e-3
"""How far the norm of a quaternion may be from 1; the daemon normalises it."""


class PoseLike(Protocol):
    """A pose in a frame: `PoseTarget`, or a measured one as `state.left_arm.pose`."""

    @property
    def p(self) -> ArrayLike:
        """Position [m], shape (3,)."""

    @property
    def quat_xyzw(self) -> ArrayLike:
        """Orientation, shape (4,)."""

    @property
    def frame(self) -> str:
        """Name of the frame."""


class PoseTarget(Struct, frozen=True):
    """Where an end effector shall be.

    Attributes:
        p: Position [m], anything that numpy takes as shape (3,).
        quat_xyzw: Orientation, norm 1, shape (4,); either sign.
        frame: `left_shoulder_base` or `right_shoulder_base`: that of the arm (manual §4.0.1).
    """

    p: ArrayLike
    quat_xyzw: ArrayLike
    frame: str


def numbers(side: str, p: ArrayLike, quat_xyzw: ArrayLike) -> tuple[float, ...]:
    """Return a pose as seven finite numbers with a unit quaternion: x, y, z [m], qx, qy, qz, qw.

    Args:
        side: `left` or `right`.
        p: Position [m], shape (3,).
        quat_xyzw: Orientation, shape (4,).

    Raises:
        Rejected: WRONG_SHAPE, NOT_FINITE, or OUT_OF_RANGE for the norm.
    """
    values = (
        *row(f"the position for the {side} arm", p, 3, f"{side}_arm.p_m", "x, y, z", "m"),
        *row(f"the quaternion for the {side} arm", quat_xyzw, 4, f"{side}_arm.quat_xyzw", "x, y, z, w"),
    )
    norm = math.hypot(*values[3:])
    if abs(norm - 1.0) > NORM_TOLERANCE:
        raise failure(
            Code.OUT_OF_RANGE,
            f"the quaternion for the {side} arm has norm {norm:.6g}, 1 is needed (xyzw, manual §4.2)",
            field=f"{side}_arm.quat_xyzw",
            value=f"{norm:.6g}",
            bound=f"[{1.0 - NORM_TOLERANCE}, {1.0 + NORM_TOLERANCE}]",
            hint="give the quaternion as x, y, z, w with norm 1",
        )
    return values


def frame_of(side: str, frame: str | None) -> str:
    """Return the name of the frame of a pose, if it is the arm's own.

    Raises:
        Rejected: WRONG_FRAME: none, or another one.
    """
    wanted = f"{side}_shoulder_base"
    if frame == wanted:
        return wanted
    said = f"is in frame {frame!r}" if frame else "has no frame"
    raise failure(
        Code.WRONG_FRAME,
        f"the pose for the {side} arm {said}, {wanted!r} is needed (manual §4.0.1)",
        field=f"{side}_arm.frame",
        value=frame or "",
        bound=wanted,
    )


def require_space(space: str, *, yields: bool = False) -> None:
    """Refuse what is no kind of stream, and a hand that shall yield in one that leads it.

    Raises:
        Rejected: BAD_REQUEST.
    """
    if space not in ("joint", "pose", "admittance"):
        raise failure(
            Code.BAD_REQUEST,
            f"there are streams of 'joint' and of 'pose' targets and of 'admittance', none of {space!r}",
            field="space",
            value=str(space),
            bound="joint, pose, admittance",
        )
    if yields and space != "admittance":
        raise failure(
            Code.BAD_REQUEST,
            f"a stream of {space!r} targets leads the hand, which cannot yield as a mass meanwhile",
            field="space",
            value=space,
            bound="admittance",
        )


def admittance(shifts: Mapping[str, Axes], turns: Mapping[str, Axes]) -> protocol.Admittance:
    """Return how a hand yields; what is within bounds, the daemon judges.

    Args:
        shifts: Mass, damping and stiffness by their keywords, in this order: a number for all three axes, three of them ...
        turns: ... and the same about the axes. A mass of None locks an axis, or all of them.

    Raises:
        Rejected: WRONG_SHAPE, with the keyword.
    """
    mass, damping, stiffness = (
        _axes(*shift) + _axes(*turn) for shift, turn in zip(shifts.items(), turns.items(), strict=True)
    )
    given = [tuple(0.0 if value is None else value for value in values) for values in (damping, stiffness)]
    return protocol.Admittance(mass=mass, damping=given[0], stiffness=given[1])


def _axes(name: str, given: Axes) -> tuple[float | None, ...]:
    values = tuple(given) if isinstance(given, Iterable) and not isinstance(given, (str, bytes)) else (given,) * 3
    if len(values) != 3:
        raise failure(
            Code.WRONG_SHAPE,
            f"{name} has {len(values)} values, one or three are needed: x, y, z",
            field=name,
            value=str(len(values)),
            bound="1 or 3",
        )
    return tuple(None if value is None else number(name, value) for value in values)


def within_reach(
    side: str, values: tuple[float, ...], info: protocol.Info, on_limit: protocol.OnLimitName
) -> tuple[float, ...]:
    """Return a pose inside the configured reach: as it is, or moved to its end when that was asked for.

    Values are x, y, z [m], qx, qy, qz, qw.

    Raises:
        Rejected: OUT_OF_RANGE, with value and bound.
    """
    reach_m = math.hypot(*values[:3])
    if reach_m <= info.reach_m:
        return values
    if on_limit == "clip":
        factor = info.reach_m / reach_m * (1.0 - 1e-12)  # rounding must not put it outside again
        return (*(x * factor for x in values[:3]), *values[3:])
    raise failure(
        Code.OUT_OF_RANGE,
        f"the pose for the {side} arm is {reach_m:.4f} m from its shoulder, outside [0, {info.reach_m}] m "
        "(manual §4.0.4 or tighter configuration)",
        field=f"{side}_arm.p_m",
        value=f"{reach_m:.6g}",
        bound=f"[0, {info.reach_m}]",
        unit="m",
    )


def move_pose(
    epoch: int,
    targets: Mapping[str, PoseLike],
    *,
    straight: bool = False,
    speed: float,
    tolerance_m: float | None,
    tolerance_rad: float | None,
    on_limit: protocol.OnLimitName,
    until: protocol.Until | None = None,
) -> protocol.MovePose:
    """Return the request for a motion of one or both end effectors to poses, in joint mode straight or not.

    Raises:
        Rejected: WRONG_SHAPE (no arm, an unknown one, not a pose), NOT_FINITE, OUT_OF_RANGE or WRONG_FRAME.
    """
    require_sides("targets", targets)
    named = {side: targets[side] for side in SIDES if side in targets}
    for side, pose in named.items():
        if not all(hasattr(pose, name) for name in ("p", "quat_xyzw", "frame")):
            message = f"the {side} arm's goal is a {type(pose).__name__}: p, quat_xyzw and frame are needed"
            raise failure(Code.WRONG_SHAPE, message, field=f"{side}_arm", hint="give a PoseTarget(p, quat_xyzw, frame)")
    return protocol.MovePose(
        epoch=epoch,
        targets={side: numbers(side, pose.p, pose.quat_xyzw) for side, pose in named.items()},
        frames={side: frame_of(side, pose.frame) for side, pose in named.items()},
        speed=number("speed", speed),
        tolerance_m=None if tolerance_m is None else number("tolerance_m", tolerance_m),
        tolerance_rad=None if tolerance_rad is None else number("tolerance_rad", tolerance_rad),
        on_limit=chosen(protocol.OnLimit, "on_limit", on_limit),
        straight=straight,
        until=until,
    )
