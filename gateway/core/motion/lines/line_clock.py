"""Line clock: when an end effector is where on its straight line, so that neither it nor any joint exceeds a limit.

How far along it is, is one number, which ruckig plans from rest to rest inside the limits of poses (those of an arm in
end-effector mode) and, where they ask for less, inside what the fastest joint allows. What then is still beyond a limit of a
joint somewhere, by velocity, acceleration or jerk, is taken off by *stretching* the whole motion in time. Near a singular
posture joints have to turn quickly for little way: there the stretch is what slows the hand down. Beyond `SLOWEST` times the
duration that poses alone would take, the line is refused, with the place and the joint that ask for it.

What joints need is not sampled but bounded, piece by piece of the curve: with the part s of the way, the joints are q(s), and

    |dq| <= |q'| |ds|,  |ddq| <= |q''| ds² + |q'| |dds|,  |dddq| <= |q'''| |ds|³ + 3 |q''| |ds dds| + |q'| |ddds|

with the largest value of each factor in the piece: nowhere between two setpoints is there more.
"""

from __future__ import annotations

from collections.abc import Generator, Mapping, Sequence
from itertools import pairwise
from typing import NamedTuple

from msgspec import Struct
from ruckig import InputParameter, Profile, Ruckig, Trajectory

from gateway.core.motion.joints.braking import JointLimits
from gateway.core.motion.lines.line import Line
from gateway.core.motion.lines.line_curve import Curve, place
from gateway.core.motion.poses.pose_state import PoseDynamics
from gateway.core.motion.solver import NoPlan, Plan, solve
from gateway.errors import Code, Refusal
from gateway.robot.topics import ARM_JOINTS
from gateway.values import ARM_DOF, Side

__all__ = ["SLOWEST", "LineClock", "Reins", "clock_for"]

SLOWEST = 10.0
"""A motion that would take so many times as long as the poses alone is refused."""

NOTHING_S = 1e-9
"""A way that takes less at full speed is none [s]."""

BOUNDED = 10
"""Pieces of a curve that are bounded at once."""
PACED = 25
"""Places whose pace is worked out at once."""

ROOM = 1.0 + 1e-6
"""For rounding of the stretch."""

UNITS = ("rad/s", "rad/s²", "rad/s³")
VERBS = ("turn at", "accelerate by", "change its acceleration by")


class Reins(NamedTuple):
    """What one arm's motion keeps to.

    Attributes:
        poses: Limits of its end effector.
        joints: Limits of its joints.
    """

    poses: PoseDynamics
    joints: JointLimits


class LineClock(Struct, frozen=True, kw_only=True):
    """When which part of the way is behind.

    Attributes:
        law: ruckig's plan of the part, from 0 to 1; None where there is no way to go.
        stretch: By which factor it is carried out more slowly.
        slowness: How many times as long as the poses alone would take.
    """

    law: Trajectory | None
    stretch: float = 1.0
    slowness: float = 1.0

    @property
    def duration_s(self) -> float:
        """Time from rest to rest [s]."""
        return 0.0 if self.law is None else self.law.duration * self.stretch

    def at(self, time_s: float) -> tuple[float, float, float]:
        """Return the part of the way, its rate [1/s] and that of its rate [1/s²], a time after the begin, before the end."""
        if self.law is None:
            return 1.0, 0.0, 0.0
        k = self.stretch
        (part,), (rate,), (force,) = self.law.at_time(time_s / k)
        return part, rate / k, force / (k * k)

    def slower(self, factor: float) -> LineClock:
        """Return the same motion at another pace."""
        return LineClock(law=self.law, stretch=factor * self.stretch, slowness=factor * self.slowness)


class _Worst(NamedTuple):
    """What asks most for a stretch.

    Attributes:
        stretch: That it asks for; at least 1.
        side: Of which arm.
        joint: Its index.
        order: 0 velocity, 1 acceleration, 2 jerk.
        part: Where on the way.
        value: Of the joint there, unstretched.
        bound: Its limit.
    """

    stretch: float
    side: Side
    joint: int
    order: int
    part: float
    value: float
    bound: float


def clock_for(
    lines: Mapping[Side, Line], curves: Mapping[Side, Curve], reins: Mapping[Side, Reins], speed: float
) -> Generator[None, None, LineClock | Refusal]:
    """Work out the clock of a motion of one or both arms, piece by piece, or the place that asks for too much.

    All curves have the same places; `speed` is a factor on velocities and accelerations of the poses, 0 < speed <= 1.
    """
    limits = _pose_limits(lines, reins, speed)
    if limits is None:
        return LineClock(law=None)
    v, a, j = limits
    fastest = {side: max(peaks[2] for peaks in curve.peaks) for side, curve in curves.items()}
    for side, rad in fastest.items():
        if rad > 0.0:
            joints = reins[side].joints
            v, a, j = min(v, joints.v_radps / rad), min(a, joints.a_radps2 / rad), min(j, joints.j_radps3 / rad)
    try:
        free_s = _law(*limits).duration
        law = _law(v, a, j)
    except NoPlan as none:
        return Refusal(code=Code.PLAN_FAILED, message=f"ruckig finds no plan along the line: {none}")
    yield
    worst = yield from _worst(law, curves, reins)
    stretch = worst.stretch * ROOM if worst.stretch > 1.0 else 1.0
    clock = LineClock(law=law, stretch=stretch, slowness=stretch * law.duration / free_s)
    return clock if clock.slowness <= SLOWEST else _too_slow(clock, worst)


def _pose_limits(
    lines: Mapping[Side, Line], reins: Mapping[Side, Reins], speed: float
) -> tuple[float, float, float] | None:
    """Return what poses allow of the part's velocity, acceleration and jerk [1/s ...]; None where there is no way."""
    limits: list[tuple[float, float, float]] = []
    for side, line in lines.items():
        poses = reins[side].poses
        for group, length in ((poses.linear, line.length_m), (poses.angular, line.angle_rad)):
            if length > NOTHING_S * group.speed:
                limits.append((speed * group.speed / length, speed * group.a / length, group.j / length))
    if not limits:
        return None
    v, a, j = (min(row) for row in zip(*limits, strict=True))
    return v, a, j


def _law(v: float, a: float, j: float) -> Trajectory:
    """Return the quickest way of the part from 0 to 1.

    Raises:
        NoPlan: ruckig finds none.
    """
    entry, law = InputParameter(1), Plan(1)
    entry.current_position, entry.target_position = [0.0], [1.0]
    entry.max_velocity, entry.max_acceleration, entry.max_jerk = [v], [a], [j]
    solve(Ruckig(1), entry, law)
    return law


def _worst(law: Trajectory, curves: Mapping[Side, Curve], reins: Mapping[Side, Reins]) -> Generator[None, None, _Worst]:
    """Return what asks for the greatest stretch: of all arms, pieces and joints."""
    parts = next(iter(curves.values())).times_s
    paces = yield from _paces(law, parts)
    side = next(iter(curves))
    worst = _Worst(1.0, side, 0, 0, 0.0, 0.0, reins[side].joints.v_radps)
    for side, curve in curves.items():
        limits = reins[side].joints
        bounds = limits.v_radps, limits.a_radps2, limits.j_radps3
        for n, (s1, s2, s3) in enumerate(paces):
            for joint in range(ARM_DOF):
                q1, q3, a = curve.speed[joint][n], abs(curve.j[joint][n]), curve.a[joint]
                q2 = max(abs(a[n]), abs(a[n + 1]))
                values = q1 * s1, q2 * s1 * s1 + q1 * s2, (q3 * s1 * s1 + 3.0 * q2 * s2) * s1 + q1 * s3
                for order, (value, bound) in enumerate(zip(values, bounds, strict=True)):
                    if value > bound * worst.stretch ** (order + 1):
                        stretch = (value / bound) ** (1.0 / (order + 1))
                        worst = _Worst(stretch, side, joint, order, parts[n], value, bound)
            if n % BOUNDED == 0:
                yield
    return worst


_Pace = tuple[float, float, float]


def _paces(law: Trajectory, parts: Sequence[float]) -> Generator[None, None, list[_Pace]]:
    """Return for each piece the greatest rate of the part, of its rate and of that one [1/s, 1/s², 1/s³].

    The rate rises, stays and falls, and its own rate is linear in each phase of the law: both are greatest at an end of a
    phase or of the piece.
    """
    profile: Profile = law.profiles[0][0]
    phases = [n for n, time_s in enumerate(profile.t) if time_s > 0.0]
    places = [0.0, *(profile.p[n + 1] for n in phases)]
    rates = [(profile.v[n + 1], abs(profile.a[n + 1])) for n in phases]
    rows: list[tuple[float, float]] = []
    for number, part in enumerate(parts, start=1):
        (_,), (rate,), (force,) = law.at_time(_time_s(law, part))
        rows.append((rate, abs(force)))
        if number % PACED == 0:
            yield
    paces: list[_Pace] = []
    for (low, high), begin, end in zip(pairwise(parts), rows, rows[1:], strict=False):
        inner = [rate for rate, at in zip(rates, places[1:], strict=True) if low <= at <= high]
        passed = [
            n for n, before, after in zip(phases, places, places[1:], strict=False) if before <= high and after >= low
        ]
        s1 = max(begin[0], end[0], *(rate for rate, _ in inner), 0.0)
        s2 = max(begin[1], end[1], *(force for _, force in inner), 0.0)
        paces.append((s1, s2, max(abs(profile.j[n]) for n in passed)))
        if len(paces) % PACED == 0:
            yield
    return paces


def _time_s(law: Trajectory, part: float) -> float:
    """Return when a part of the way is behind [s]; where rounding lets the law end a hair before it, when that ends."""
    time_s: float | None = law.get_first_time_at_position(0, part)
    return float(law.duration) if time_s is None else time_s


def _too_slow(clock: LineClock, worst: _Worst) -> Refusal:
    joint = f"{worst.side} arm joint {worst.joint + 1} ({ARM_JOINTS[worst.side][worst.joint]})"
    return Refusal(
        code=Code.NO_STRAIGHT_WAY,
        message=(
            f"{place(worst.part)} {joint} would have to {VERBS[worst.order]} up to {worst.value:.3g} {UNITS[worst.order]} to "
            f"keep the hand on the line, {worst.bound:g} {UNITS[worst.order]} is the limit: slowed down to fit, the motion "
            f"would take {clock.slowness:.1f} times as long, {SLOWEST:g} times is the bound"
        ),
        field=f"{worst.side}_arm[{worst.joint}]",
        value=f"{worst.value:.6g}",
        bound=f"{worst.bound:g}",
        unit=UNITS[worst.order],
    )
