"""How a recording is followed: which arms, in which space, at which pace, and cut into how many requests.

Pure: files and what was asked for in, parts of requests out, and refusals of points led back to their place in the file.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from gateway.cli.motion.recording import Recording
from gateway.client.asking.chunks import Tolerance
from gateway.errors import Code, GatewayError, Rejected, failure, to_exception

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

__all__ = ["Part", "Passing", "chosen", "cut", "dt_of", "located", "space_of"]

PART_POINTS = 300
"""Points of one request, below the 450 that the gateway takes."""
PART_S = 30.0
"""Longest part [s], below the 60 s that the gateway takes."""
SHARED_POINTS = 6
"""A part begins this many points before the one before it ends: it takes over while that goes on."""
LEAST_POINTS = 3 * SHARED_POINTS
"""No part has fewer, unless it is all there is."""

POINT = re.compile(r"(?P<what>left_arm|right_arm|times_s)\[(?P<index>\d+)\]")
"""How a refusal names a point."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Passing:
    """How a recording is followed.

    Attributes:
        arm: `left`, `right`, or `both`; empty for what the file holds.
        space: `joint` or `pose`; empty for what the file says, joints if it says nothing.
        dt_s: Time from point to point [s]; None for the file's own.
        stretch: Factor by which all of it becomes slower.
        smoothing_s: Jitter is averaged over so much time on each side of a point [s].
        start_at_s: When it begins, on the monotonic clock of the gateway's host [s]; None for at once ...
        start_in_s: ... or so long after it was enabled [s].
        path_tolerance: As in `Control.follow`.
        goal_tolerance: As in `Control.follow`.
        approach: Factor on the velocity limit with which the arms are moved to the first point before; None for not at all.
    """

    arm: str = ""
    space: str = ""
    dt_s: float | None = None
    stretch: float = 1.0
    smoothing_s: float = 0.0
    start_at_s: float | None = None
    start_in_s: float | None = None
    path_tolerance: Tolerance = None
    goal_tolerance: Tolerance = None
    approach: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Part:
    """Some points of it, for one request.

    Attributes:
        first: Index of the first one.
        points: Per side, shape (N, 7).
        times_s: When each is passed after the first one of the part, stretched not yet [s]; None where `dt_s` says it.
        begins_s: When the first one is passed after the first one of all, stretched [s].
        is_last: Whether it ends at rest.
    """

    first: int
    points: Mapping[str, NDArray[np.float64]]
    times_s: NDArray[np.float64] | None
    begins_s: float
    is_last: bool


def cut(
    points: Mapping[str, NDArray[np.float64]], times_s: NDArray[np.float64] | None, dt_s: float | None, stretch: float
) -> Iterator[Part]:
    """Yield what goes into each request.

    Points have shape (N, 7) per side; without times, shape (N,) [s], they are `dt_s` apart.
    """
    count, first = len(next(iter(points.values()))), 0
    while True:
        if times_s is None:
            fitting = int(PART_S / max(1e-9, (dt_s or 0.0) * stretch)) + 1  # in this order NaN, which is refused later
            after_s = first * (dt_s or 0.0)
        else:
            fitting = int((times_s[first:] - times_s[first] <= PART_S / stretch).sum())
            after_s = float(times_s[first] - times_s[0])
        end = first + max(min(PART_POINTS, fitting), LEAST_POINTS)
        if count - end < LEAST_POINTS:  # no crumb at the end
            end = count
        yield Part(
            first=first,
            points={side: rows[first:end] for side, rows in points.items()},
            times_s=None if times_s is None else times_s[first:end] - times_s[first],
            begins_s=after_s * stretch,
            is_last=end == count,
        )
        if end == count:
            return
        first = end - SHARED_POINTS


def chosen(recording: Recording, arm: str) -> dict[str, NDArray[np.float64]]:
    """Return the points of the arms that were asked for, per side.

    Raises:
        Rejected: BAD_REQUEST, the file has none for an arm, or does not say for which.
    """
    points = dict(recording.points)
    if "" in points:
        if arm not in ("left", "right"):
            raise _unfit(
                recording, "holds the points of one arm and does not say of which", "--arm left or --arm right"
            )
        return {arm: points[""]}
    missing = [side for side in (("left", "right") if arm == "both" else (arm,)) if side and side not in points]
    if missing:
        raise _unfit(recording, f"has no points for the {missing[0]} arm", f"it has some for: {', '.join(points)}")
    return points if arm in ("", "both") else {arm: points[arm]}


def space_of(recording: Recording, space: str) -> str:
    """Return the space of the points, `joint` or `pose`; what was asked for must not be another than the file's.

    Raises:
        Rejected: BAD_REQUEST.
    """
    if space and recording.space and space != recording.space:
        raise _unfit(recording, f"says that its points are of space {recording.space}", "leave out --space")
    return space or recording.space or "joint"


def dt_of(recording: Recording, dt_s: float | None) -> float | None:
    """Return the time from point to point [s]; None where the file says when each is passed.

    Raises:
        Rejected: BAD_REQUEST, nobody says it, or both do.
    """
    if recording.times_s is None and recording.dt_s is None and dt_s is None:
        raise _unfit(recording, "does not say when its points are passed", "say how far apart they are with --dt S")
    if recording.times_s is not None and dt_s is not None:
        raise _unfit(recording, "says itself when its points are passed", "leave out --dt; --stretch makes it slower")
    return recording.dt_s if dt_s is None else dt_s


def _unfit(recording: Recording, message: str, hint: str) -> GatewayError:
    return failure(Code.BAD_REQUEST, f"{recording.path} {message}", field="file", hint=hint)


@contextmanager
def located(recording: Recording, first: int) -> Iterator[None]:
    """Say in a refusal where in the file the point stands, and count it from the file's first one."""
    try:
        yield
    except Rejected as error:
        refusal = error.refusal
        found = POINT.match(refusal.field)
        if found is None or refusal.code is Code.JUMP_TOO_FAR:  # which is about the arm
            raise
        index = first + int(found["index"])
        message = re.sub(rf"\bpoint {found['index']}\b", f"point {index}", refusal.message)
        field = f"{found['what']}[{index}]{refusal.field[found.end() :]}"
        raise to_exception(replace(refusal, message=f"{recording.place(index)}: {message}", field=field)) from None
