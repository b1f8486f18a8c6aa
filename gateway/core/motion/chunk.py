"""Validation of trajectories and action chunks: a whole one is judged before its first setpoint leaves.

`prepare` judges what needs no knowledge of the gateway (shape, finiteness, times, the robot's own limits) and works out
the motion through the points. It may be called ahead of the tick, in another thread: the largest chunk takes it some
milliseconds. `check_motion` and `check_jump` judge the result in the tick, against the configured limits and the
present motion; that is cheap, because the peaks were worked out with the motion.

A refusal names the first offending point, the joint, value, bound, unit and what helps; `stretch` is the factor by
which the whole chunk is too quick. Nothing is ever clipped.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

from msgspec import Struct

from gateway.core.motion.bounds import no_arm, not_finite, outside, wrong_count
from gateway.core.motion.joints.trajectory import Trajectory, interpolate, smooth
from gateway.core.motion.poses.pose_chunk import check_pose
from gateway.core.motion.poses.pose_trajectory import PoseTrajectory, interpolate_poses, with_signs
from gateway.errors import Code, Refusal
from gateway.robot.limits import JOINT_LOWER_RAD, JOINT_UPPER_RAD
from gateway.robot.topics import ARM_JOINTS
from gateway.settings.settings import ArmSettings
from gateway.values import ARM_DOF, Side, Space, Vector

__all__ = ["MAX_LEAD_NS", "MAX_POINTS", "Chunk", "check_jump", "check_motion", "check_start", "prepare"]

S = 1_000_000_000

MIN_POINTS = 2
MAX_POINTS = 450
"""10 s at the 45 Hz of the robot's data sets; for both arms this fits, with times, into the 64 KiB of a request."""

MIN_STEP_S = 0.001
"""Shortest time between two points [s]: a tenth of the time between two setpoints."""

MAX_DURATION_S = 60.0
"""Longest chunk [s]: an arm must not be bound to a plan from long ago."""

MAX_LEAD_NS = 10 * S
"""A chunk may begin at most this far in the future [ns]."""

MAX_STRETCH = 100.0
MAX_SMOOTHING_S = 1.0

JUMP_RAD = 0.1
"""How far the chunk may be from the arm's reference when it begins, per joint [rad] (BEHAVIOUR, values)."""

IN_PARTS = "send it as several chunks, each while the last runs"

SLACK = 1.0 + 1e-9
"""Rounding of what was worked out from points that lie exactly at a limit."""


class Chunk(Struct, frozen=True, kw_only=True):
    """Trajectories of one or both arms on one clock. Made by `prepare`.

    Attributes:
        trajectories: Per arm the motion through its points, all in the same space.
        offset_s: Time of the first point after the beginning [s].
        moved: How far smoothing has moved a number of a point at most [rad, m].
        space: Of the points.
    """

    trajectories: Mapping[Side, Trajectory | PoseTrajectory]
    offset_s: float
    moved: float
    space: Space = Space.JOINT

    @property
    def duration_s(self) -> float:
        """Time from the first to the last point, the same for both arms [s]."""
        return next(iter(self.trajectories.values())).duration_s


def prepare(
    points: Mapping[Side, Sequence[Sequence[float]]],
    *,
    dt_s: float | None = None,
    times_s: Sequence[float] | None = None,
    stretch: float = 1.0,
    smoothing_s: float = 0.0,
    space: Space = Space.JOINT,
) -> Chunk | Refusal:
    """Return the motion through points, or why they are none.

    Args:
        points: Per arm 2 to 450 points, shape (N, 7), N the same for both arms: joints [rad] in the order of manual §4.0.3,
            or poses x, y, z [m], qx, qy, qz, qw in the arm's shoulder frame.
        dt_s: Time from point to point [s]; the first is passed at 0. Either this or `times_s`.
        times_s: When each point is passed, shape (N,), rising, from 0 on [s].
        stretch: Factor by which everything becomes slower, 1 to 100.
        smoothing_s: Jitter is averaged over so much time on each side of a point [s], 0 to 1; needs `dt_s`.
        space: Of the points.
    """
    refusal = _check_points(points, check_pose if space is Space.POSE else _check_point)
    if refusal is not None:
        return refusal
    times = _times(len(next(iter(points.values()))), dt_s, times_s, stretch)
    if isinstance(times, Refusal):
        return times
    reach = _reach(len(times), dt_s, smoothing_s)
    if isinstance(reach, Refusal):
        return reach
    through = interpolate_poses if space is Space.POSE else interpolate
    trajectories: dict[Side, Trajectory | PoseTrajectory] = {}
    moved = 0.0
    for side in Side:
        if side in points:
            given = [tuple(point) for point in points[side]]
            given = with_signs(given) if space is Space.POSE else given
            smoothed = smooth(given, reach) if reach else given
            pairs = (pair for one, other in zip(given, smoothed, strict=True) for pair in zip(one, other, strict=True))
            moved = max(moved, max(abs(one - other) for one, other in pairs)) if reach else moved
            trajectories[side] = through(smoothed, times)
    return Chunk(trajectories=trajectories, offset_s=times[0], moved=moved, space=space)


# ---------------------------------------------------------------------------------------------- the input itself


def _check_points(
    points: Mapping[Side, Sequence[Sequence[float]]],
    check: Callable[[Side, int, Sequence[float]], Refusal | None],
) -> Refusal | None:
    if not points:
        return no_arm("points")
    counts = {side: len(rows) for side, rows in points.items()}
    for side, count in counts.items():
        if not MIN_POINTS <= count <= MAX_POINTS:
            message = f"the {side} arm got {count} points, {MIN_POINTS} to {MAX_POINTS} are needed"
            wrong = _shape(f"{side}_arm", message, str(count), f"[{MIN_POINTS}, {MAX_POINTS}]", "points")
            return _hinted(wrong, "give two points at least" if count < MIN_POINTS else IN_PARTS)
    if len(set(counts.values())) > 1:
        both = " and ".join(str(counts[side]) for side in counts)
        return _shape("points", f"the arms got {both} points: both need the same number", both, "equal", "points")
    for side, rows in points.items():
        for index, point in enumerate(rows):
            refusal = check(side, index, point)
            if refusal is not None:
                return refusal
    return None


def _check_point(side: Side, index: int, point: Sequence[float]) -> Refusal | None:
    if len(point) != ARM_DOF:
        field = f"{side}_arm[{index}]"
        return wrong_count(f"{side} arm point {index}", len(point), ARM_DOF, field, "its joints (manual §4.0.3)")
    for n, (q, low, high) in enumerate(zip(point, JOINT_LOWER_RAD[side], JOINT_UPPER_RAD[side], strict=True)):
        if low <= q <= high:
            continue
        if math.isfinite(q):
            return _outside(side, index, n, q, low, high)
        return not_finite(_joint(side, index, n), q, f"{side}_arm[{index}][{n}]", f"[{low}, {high}]", "rad")
    return None


def _times(count: int, dt_s: float | None, times_s: Sequence[float] | None, stretch: float) -> list[float] | Refusal:
    """Return when each point is passed [s], or what is wrong with the times."""
    if (dt_s is None) == (times_s is None):
        return Refusal(
            code=Code.BAD_REQUEST, message="either dt or times is needed", field="dt_s", hint="give one of the two"
        )
    if not 1.0 <= stretch <= MAX_STRETCH:
        return outside("stretch", stretch, 1.0, MAX_STRETCH, "")
    if dt_s is not None:
        if not MIN_STEP_S <= dt_s <= MAX_DURATION_S:
            return outside("dt_s", dt_s, MIN_STEP_S, MAX_DURATION_S, "s")
        times = [n * dt_s * stretch for n in range(count)]
    else:
        times = [t * stretch for t in times_s or ()]
        if len(times) != count:
            return _shape("times_s", f"{len(times)} times for {count} points", str(len(times)), str(count), "times")
        for index, time_s in enumerate(times):
            low_s = times[index - 1] + MIN_STEP_S * SLACK**-1 if index else 0.0
            if not low_s <= time_s <= MAX_DURATION_S:
                return outside(f"times_s[{index}]", time_s / stretch, low_s / stretch, MAX_DURATION_S / stretch, "s")
    if times[-1] > MAX_DURATION_S * SLACK:
        return _hinted(outside("duration", times[-1], 0.0, MAX_DURATION_S, "s"), IN_PARTS)
    return times


def _reach(count: int, dt_s: float | None, smoothing_s: float) -> int | Refusal:
    """Return over how many neighbours a point is averaged on each side."""
    if smoothing_s == 0.0:
        return 0
    if not 0.0 <= smoothing_s <= MAX_SMOOTHING_S:
        return outside("smoothing_s", smoothing_s, 0.0, MAX_SMOOTHING_S, "s")
    if dt_s is None:
        return Refusal(
            code=Code.BAD_REQUEST,
            message="smoothing needs points that are evenly spaced in time",
            field="smoothing_s",
            hint="give dt instead of times",
        )
    reach = round(smoothing_s / dt_s)
    if not 1 <= reach < count:
        return outside("smoothing_s", smoothing_s, dt_s, min((count - 1) * dt_s, MAX_SMOOTHING_S), "s")
    return reach


# ---------------------------------------------------------------------------------------------- the motion


def check_motion(side: Side, trajectory: Trajectory, settings: ArmSettings) -> Refusal | None:
    """Refuse a motion that leaves the configured limits of position, velocity, acceleration or jerk anywhere."""
    kinds = (
        (trajectory.speed, settings.v_radps, "rad/s", 1.0),
        (trajectory.a, settings.a_radps2, "rad/s²", 1.0 / 2.0),
        (trajectory.j, settings.j_radps3, "rad/s³", 1.0 / 3.0),
    )
    offences: list[tuple[int, int, Refusal]] = []
    stretch = 1.0
    for order, (_, bound, _, power) in enumerate(kinds):
        stretch = max(stretch, (max(peaks[2 + order] for peaks in trajectory.peaks) / bound) ** power)
    hint = f"stretch={math.ceil(stretch * 1000.0 - 1e-6) / 1000.0:g} is slow enough; against jitter ask for smoothing"
    for n, (lowest, highest, *most) in enumerate(trajectory.peaks):
        low, high = settings.lower_rad[side][n], settings.upper_rad[side][n]
        if lowest < low or highest > high:
            index, q = _first_outside(trajectory, n, low, high)
            offences.append((index, 0, _outside(side, index, n, q, low, high)))
        for order, (peak, (columns, bound, unit, _)) in enumerate(zip(most, kinds, strict=True), 1):
            if peak > bound * SLACK:
                index, value = next((i, abs(x)) for i, x in enumerate(columns[n]) if abs(x) > bound * SLACK)
                offences.append((index, order, _too_fast(side, index, n, value, bound, unit, hint)))
    return min(offences, key=lambda offence: offence[:2])[2] if offences else None


def _first_outside(trajectory: Trajectory, joint: int, low: float, high: float) -> tuple[int, float]:
    """Return the first point at which, or on the way from which, a joint leaves its range, and where it is then."""
    pieces = enumerate(zip(trajectory.low[joint], trajectory.high[joint], strict=True))
    index, turn = next((i, lo if lo < low else hi) for i, (lo, hi) in pieces if lo < low or hi > high)
    for point in (index, index + 1):
        q = trajectory.q[joint][point]
        if not low <= q <= high:
            return point, q
    return index, turn


def check_jump(side: Side, position: Vector, time_s: float, reference_rad: Vector) -> Refusal | None:
    """Refuse a chunk that is too far from the arm's reference where it begins."""
    gaps = [abs(q - ref) for q, ref in zip(position, reference_rad, strict=True)]
    most = max(gaps)
    if most <= JUMP_RAD * SLACK:
        return None
    n = gaps.index(most)
    where = "at its first point," if time_s <= 0.0 else f"{time_s:.3f} s after its first point, which is now,"
    return Refusal(
        code=Code.JUMP_TOO_FAR,
        message=f"{side} arm joint {n + 1} ({ARM_JOINTS[side][n]}): the chunk is {most:.4f} rad from the arm's "
        f"reference {where} {JUMP_RAD} rad is the bound",
        field=f"{side}_arm[0][{n}]",
        value=f"{most:.6g}",
        bound=str(JUMP_RAD),
        unit="rad",
    )


def check_start(into_ns: int, duration_s: float) -> Refusal | None:
    """Refuse a chunk that is over already, or begins too far in the future.

    Args:
        into_ns: Time since its first point [ns]; negative before it.
        duration_s: Time from its first to its last point [s].
    """
    if into_ns >= duration_s * S:
        return Refusal(
            code=Code.TOO_LATE,
            message=f"the chunk ended {into_ns / S - duration_s:.3f} s ago: the time of every point has passed",
            field="start",
            value=f"{into_ns / S:.6g}",
            bound=f"{duration_s:.6g}",
            unit="s",
        )
    if into_ns < -MAX_LEAD_NS:
        return outside("start", -into_ns / S, 0.0, MAX_LEAD_NS / S, "s")
    return None


# ---------------------------------------------------------------------------------------------- words


def _joint(side: Side, index: int, n: int) -> str:
    return f"{side} arm point {index} joint {n + 1} ({ARM_JOINTS[side][n]})"


def _outside(side: Side, index: int, n: int, q: float, low: float, high: float) -> Refusal:
    return Refusal(
        code=Code.OUT_OF_RANGE,
        message=f"{_joint(side, index, n)}: {q:.4f} rad is outside [{low:.2f}, {high:.2f}] rad, there or on the way to the "
        "next point (manual §4.13 or tighter configuration)",
        field=f"{side}_arm[{index}][{n}]",
        value=f"{q:.6g}",
        bound=f"[{low}, {high}]",
        unit="rad",
        hint="stay inside the bound; chunks are never clipped",
    )


def _too_fast(side: Side, index: int, n: int, value: float, bound: float, unit: str, hint: str) -> Refusal:
    return Refusal(
        code=Code.TOO_FAST,
        message=f"{_joint(side, index, n)}: {value:.4g} {unit} there or on the way to the next point, {bound:g} {unit} is "
        "the limit",
        field=f"{side}_arm[{index}][{n}]",
        value=f"{value:.6g}",
        bound=f"{bound:g}",
        unit=unit,
        hint=hint,
    )


def _shape(field: str, message: str, value: str, bound: str, unit: str) -> Refusal:
    return Refusal(code=Code.WRONG_SHAPE, message=message, field=field, value=value, bound=bound, unit=unit)


def _hinted(refusal: Refusal, hint: str) -> Refusal:
    return replace(refusal, hint=hint)
