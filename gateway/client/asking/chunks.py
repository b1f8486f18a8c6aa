"""Trajectories and action chunks, from what a user gives: arrays in, shapes checked, and judged by the daemon if wanted."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Literal, TypedDict

from msgspec import Struct

from gateway.api import protocol
from gateway.client.asking.procedures import Procedure, request
from gateway.client.asking.requests import SIDES, number, numeric, require_sides
from gateway.client.connection.session import Session
from gateway.errors import Code, GatewayError, failure

if TYPE_CHECKING:
    from numpy.typing import ArrayLike
    from typing_extensions import Unpack

__all__ = ["FollowCheck", "Tolerance", "Wishes", "check_follow", "follow"]

Tolerance = float | Sequence[float | None] | None
"""One tolerance for all joints, or one per joint [rad]; for poses two [m, rad]. None where there is none."""


class Wishes(TypedDict, total=False):
    """How points are to be followed: the keywords of `Control.follow`, which documents them."""

    frames: Mapping[str, str] | None
    times: ArrayLike | None
    start_at: float | None
    start_in: float | None
    open_end: bool
    stretch: float
    smoothing: float
    path_tolerance: Tolerance
    goal_tolerance: Tolerance
    goal_time: float | None
    until: protocol.Until | None


class FollowCheck(Struct, frozen=True, kw_only=True):
    """Points that could be followed, as far as that can be said without moving. Made by `Robot.check_follow`.

    Attributes:
        duration: From the first point to the last [s].
        skipped: Points whose time has passed.
        moved: How far smoothing moves a number at most [rad, m].
        away: Per side how far the motion begins from where the arm is (its setpoint, or measured): per joint [rad], of poses
            two numbers, position and orientation [m, rad]. An arm whose state is not known now is missing.
    """

    duration: float
    skipped: int
    moved: float
    away: Mapping[str, tuple[float, ...]]


def check_follow(
    session: Session, points: Mapping[str, ArrayLike], dt: float | None, from_here: bool, wishes: Wishes
) -> Procedure[FollowCheck]:
    """Have points judged by the daemon, without moving anything; arguments as in `Robot.check_follow`."""
    command = protocol.CheckFollow(follow=follow(0, points, dt, **wishes), from_here=from_here)
    facts = (yield from request(session, command)).facts
    return FollowCheck(
        duration=int(facts["duration_ns"]) / 1e9,
        skipped=int(facts["skipped"]),
        moved=float(facts["moved"]),
        away={side: tuple(map(float, values)) for side, values in facts["away"].items()},
    )


def follow(
    epoch: int,
    points: Mapping[str, ArrayLike],
    dt: float | None = None,
    **wishes: Unpack[Wishes],
) -> protocol.Follow:
    """Return the request to follow points with one or both arms; arguments as in `Control.follow`.

    Raises:
        Rejected: WRONG_SHAPE, BAD_REQUEST or OUT_OF_RANGE; what the points ask for is judged by the daemon.
    """
    require_sides("points", points)
    frames, times = wishes.get("frames"), wishes.get("times")
    start_at, start_in, goal_time = wishes.get("start_at"), wishes.get("start_in"), wishes.get("goal_time")
    if start_at is not None and start_in is not None:
        raise _refused(Code.BAD_REQUEST, "start_at", "start_at and start_in cannot both be given", "", "one of the two")
    sides = [side for side in SIDES if side in points]
    return protocol.Follow(
        epoch=epoch,
        points={side: _rows(side, points[side]) for side in sides},
        space=protocol.Space.JOINT if frames is None else protocol.Space.POSE,
        frames={side: str(frames[side]) for side in sides if side in frames} if frames is not None else {},
        dt_s=None if dt is None else number("dt", dt),
        times_s=None if times is None else _times(times),
        stretch=number("stretch", wishes.get("stretch", 1.0)),
        smoothing_s=number("smoothing", wishes.get("smoothing", 0.0)),
        open_end=wishes.get("open_end", False),
        start_at_ns=None if start_at is None else _nanoseconds("start_at", start_at),
        start_in_ns=None if start_in is None else _nanoseconds("start_in", start_in),
        path_tolerance=_tolerances("path_tolerance", sides, wishes, is_pose=frames is not None),
        goal_tolerance=_tolerances("goal_tolerance", sides, wishes, is_pose=frames is not None),
        goal_time_ns=None if goal_time is None else _nanoseconds("goal_time", goal_time),
        until=wishes.get("until"),
    )


def _rows(side: str, points: ArrayLike) -> tuple[tuple[float, ...], ...]:
    try:
        array = numeric(points)
    except (TypeError, ValueError, OverflowError) as error:
        raise _refused(
            Code.WRONG_SHAPE, f"{side}_arm", f"the {side} arm's points are no array of numbers ({error})", "", "(N, 7)"
        ) from None
    if array.ndim != 2 or array.shape[1] != protocol.ARM_DOF:
        raise _refused(
            Code.WRONG_SHAPE,
            f"{side}_arm",
            f"the {side} arm's points have shape {array.shape}, (N, {protocol.ARM_DOF}) is needed",
            str(array.shape),
            f"(N, {protocol.ARM_DOF})",
        )
    return tuple(map(tuple, array.tolist()))


def _times(times: ArrayLike) -> tuple[float, ...]:
    try:
        array = numeric(times)
    except (TypeError, ValueError, OverflowError) as error:
        raise _refused(Code.WRONG_SHAPE, "times", f"the times are no row of numbers ({error})", "", "(N,)") from None
    if array.ndim != 1:
        raise _refused(Code.WRONG_SHAPE, "times", f"the times have shape {array.shape}", str(array.shape), "(N,)")
    return tuple(array.tolist())


def _tolerances(
    name: Literal["path_tolerance", "goal_tolerance"], sides: Sequence[protocol.Side], wishes: Wishes, *, is_pose: bool
) -> dict[protocol.Side, tuple[float | None, ...]]:
    if (tolerance := wishes.get(name)) is None:
        return {}
    if isinstance(tolerance, Iterable) and not isinstance(tolerance, (str, bytes)):
        values = tuple(None if value is None else number(name, value) for value in tolerance)
    else:  # one for all; a pose has two of different kinds, and one is refused
        values = (number(name, tolerance),) * (1 if is_pose else protocol.ARM_DOF)
    wanted, words = (2, "two (m, rad)") if is_pose else (protocol.ARM_DOF, f"one or {protocol.ARM_DOF}")
    if len(values) != wanted:
        message = f"{name} has {len(values)} values, {words} are needed"
        raise _refused(Code.WRONG_SHAPE, name, message, str(len(values)), str(wanted))
    return dict.fromkeys(sides, values)


def _nanoseconds(name: str, value: float) -> int:
    value_s = number(name, value)
    if not abs(value_s) <= 1e9:  # NaN compares false
        message, hint = f"{name} is {value_s} s, which is no time", "stay inside the bound"
        raise failure(Code.OUT_OF_RANGE, message, field=name, value=str(value_s), bound="finite", hint=hint)
    return round(value_s * 1e9)


def _refused(code: Code, field: str, message: str, value: str, bound: str) -> GatewayError:
    return failure(code, message, field=field, value=value, bound=bound)
