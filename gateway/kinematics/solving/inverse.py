"""Inverse: joint angles for a pose, in closed form: the solution nearest to a seed, or all that there are.

A pose leaves one angle open, the arm angle (`circle.py`); limits leave sectors of it (`sectors.py`). Within those the
solution is chosen whose joints are nearest to the seed: from the seed's own arm angle downhill, to where the distance falls
no further. Followed point by point along a path, that is the motion with the least joint travel. A far away seed may have
a second valley that is a little lower; it is not looked for.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

from gateway.kinematics.placement import Placement
from gateway.kinematics.solving.circle import Circle, arm_angle_rad, elbows, wrist_of
from gateway.kinematics.solving.sectors import SLACK_RAD, Sector, Window, points, sectors, straight, turned_to, windows
from gateway.kinematics.solving.shape import ArmShape
from gateway.values import ARM_DOF, Side, Vector

__all__ = ["Branch", "ClosedForm", "Solution", "Swivel"]

ENOUGH = 1e-2
"""A step whose joint travel is this part of the distance to the seed changes that by its square: not worth taking."""
TINY_RAD = 1e-6
"""Nor is one of this travel."""
FURTHEST_RAD = 1.5
"""Joint travel of the longest step."""
MOST_STEPS = 20
NARROW_RAD = 0.15
"""Below this angle of joint 2 in the seed axes 1 and 3 are so near to one line that the valley to go down is narrow."""
WIDENED_RAD = 1e-8
"""How exactly a refusal knows what is missing."""
KEPT_RAD = 2e-10
"""Rounding at the end of a sector: a joint beyond its limit by less is put on it."""
NOTHING: Vector = (0.0,) * ARM_DOF
"""What is added to joint angles that are right as they are [rad]."""


class Solution(NamedTuple):
    """Joint angles for a pose.

    Attributes:
        q_rad: Shape (7,) [rad], inside the limits.
        arm_angle_rad: How far the elbow is lifted outward from where it hangs below the line to the wrist, in [-π, π].
    """

    q_rad: Vector
    arm_angle_rad: float


class Branch(NamedTuple):
    """One of at most eight ways to reach a pose with a given arm angle.

    Attributes:
        q_rad: Shape (7,) [rad], in (-π, π].
        beyond_rad: How far the joint that is furthest beyond its limit is beyond it; 0 inside the limits [rad].
        joint: Index of that joint; -1 inside the limits.
    """

    q_rad: Vector
    beyond_rad: float
    joint: int


class Swivel:
    """The joint angles for one pose as a function of the arm angle, bent as a neighbour is: smooth in both.

    Args:
        circle: Of the pose.
        signs: Of the joint angles against the angles of the circle.
        shoulder: Sign of the sine of a2.
        wrist: Sign of the cosine of a6.
        off_rad: What is added to each joint angle, shape (7,) [rad].
    """

    __slots__ = ("_circle", "_off_rad", "_shoulder", "_signs", "_wrist")

    def __init__(self, circle: Circle, signs: Vector, shoulder: float, wrist: float, off_rad: Vector) -> None:
        self._circle, self._signs, self._shoulder, self._wrist = circle, signs, shoulder, wrist
        self._off_rad = off_rad

    def at(self, arm_angle_rad: float) -> Vector:
        """Return the joint angles, shape (7,) [rad]; not judged by limits."""
        angles, _ = self._circle.at(arm_angle_rad, self._shoulder, self._wrist)
        return tuple([s * a + off for s, a, off in zip(self._signs, angles, self._off_rad, strict=True)])


class _Best(NamedTuple):
    distance: float
    arm_angle_rad: float
    angles: Vector


NONE = _Best(math.inf, 0.0, ())


class ClosedForm:
    """Inverse kinematics of an arm with two spherical joints and an elbow.

    Args:
        shape: Of the arm; poses are reached as if it were exact.
        side: Which arm.
        lower_rad: Lowest joint angles, shape (7,) [rad]; less than -π counts as -π.
        upper_rad: Highest joint angles, shape (7,) [rad]; more than π counts as π.

    Attributes:
        limits_rad: Lowest and highest angle of each joint [rad].
    """

    def __init__(self, shape: ArmShape, side: Side, lower_rad: Vector, upper_rad: Vector) -> None:
        self._shape, self._side = shape, side
        self.limits_rad = tuple(zip(lower_rad, upper_rad, strict=True))
        ends = [sorted(row) for row in zip(self._turned(lower_rad), self._turned(upper_rad), strict=True)]
        self._lower = tuple([max(low, -math.pi) for low, _ in ends])
        self._upper = tuple([min(high, math.pi) for _, high in ends])
        self._windows = windows(self._lower, self._upper)

    def nearest(self, target: Placement, seed_rad: Sequence[float]) -> Solution | None:
        """Return the solution inside the limits that is nearest to a seed in joint angles; None when there is none.

        Args:
            target: End effector in the shoulder frame.
            seed_rad: Joint angles, shape (7,) [rad], order of §4.0.3; may be outside the limits.
        """
        seed = self._turned(seed_rad)
        begin = arm_angle_rad(self._shape, self._side, seed)
        best = NONE
        for circle in self._circles(target):
            circle.free_a1 = min(max(seed[0], self._lower[0]), self._upper[0])
            for window in self._windows:
                best = min(best, _nearest(circle, window, seed, begin))
                if abs(seed[1]) < NARROW_RAD:
                    for other in turned_to(circle, window, seed[0]):
                        best = min(best, _nearest(circle, window, seed, other))
        if best is NONE:
            return None
        q_rad = [min(max(q, a), b) for q, (a, b) in zip(self._joints(best.angles), self.limits_rad, strict=True)]
        return Solution(tuple(q_rad), math.remainder(best.arm_angle_rad, math.tau))

    def swivel(self, target: Placement, seed_rad: Sequence[float], off_rad: Vector = NOTHING) -> Swivel | None:
        """Return the joint angles for a pose by arm angle, elbow, shoulder and wrist bent as a seed's are.

        Args:
            target: End effector in the shoulder frame.
            seed_rad: Joint angles, shape (7,) [rad].
            off_rad: What is added to each joint angle, shape (7,) [rad].

        Returns:
            None when the wrist is out of reach of the bare bones.
        """
        seed = self._turned(seed_rad)
        circles = self._circles(target, is_bare=True)
        if not circles:
            return None
        circle = min(circles, key=lambda one: abs(one.elbow.a4 - seed[3]))
        circle.free_a1 = seed[0]
        shoulder = math.copysign(1.0, seed[1] or self._lower[1] + self._upper[1])
        off_rad = tuple([off - zero for off, zero in zip(off_rad, self._shape.zeros_rad, strict=True)])
        return Swivel(circle, self._shape.signs, shoulder, math.copysign(1.0, math.cos(seed[5])), off_rad)

    def branches(self, target: Placement, arm_angle_rad: float) -> tuple[Branch, ...]:
        """Return every way to reach a pose with an arm angle, those inside the limits first.

        Args:
            target: End effector in the shoulder frame.
            arm_angle_rad: Any [rad].

        Returns:
            Eight; none when the wrist is out of reach of the bare bones.
        """
        found: list[Branch] = []
        for circle in self._circles(target, is_bare=True):
            circle.free_a1 = min(max(0.0, self._lower[0]), self._upper[0])
            for shoulder in (1.0, -1.0):
                for wrist in (1.0, -1.0):
                    angles, _ = circle.at(arm_angle_rad, shoulder, wrist)
                    found.append(self._branch(angles))
        return tuple(sorted(found, key=lambda branch: branch.beyond_rad))

    def sectors(self, target: Placement) -> tuple[Sector, ...]:
        """Return the arm angles at which a pose can be reached inside the limits, as begins and ends, begins first.

        Args:
            target: End effector in the shoulder frame.

        Returns:
            Sectors of all ways to bend elbow, shoulder and wrist; empty when the pose cannot be reached.
        """
        found = [s for circle in self._circles(target) for window in self._windows for s in sectors(circle, window)]
        return tuple(sorted(found))

    def least_beyond(self, target: Placement) -> tuple[Branch, float]:
        """Return what comes nearest to being inside the limits, and its arm angle [rad]. Takes some milliseconds.

        All limits are widened alike until the first sector opens: that is where the least is missing.

        Args:
            target: End effector in the shoulder frame, within reach of the bare bones and of no solution.
        """
        low, high = 0.0, math.pi
        lower, upper = zip(*self.limits_rad, strict=True)
        opened: tuple[Sector, ...] = ((-math.pi, math.pi),)
        while high - low > WIDENED_RAD:
            by = 0.5 * (low + high)
            wider = ClosedForm(self._shape, self._side, tuple([v - by for v in lower]), tuple([v + by for v in upper]))
            found = wider.sectors(target)
            low, high = (low, by) if found else (by, high)
            opened = found or opened
        at = max(
            (0.5 * (begin + end) for begin, end in opened), key=lambda one: -self.branches(target, one)[0].beyond_rad
        )
        return self.branches(target, at)[0], math.remainder(at, math.tau)

    def reach_m(self) -> tuple[float, float]:
        """Return the least and the greatest distance from shoulder to wrist that the elbow's limits leave [m]."""
        (ux, uy), (fx, fy) = self._shape.upper_m, self._shape.lower_m
        along, across = ux * fx + uy * fy, uy * fx - ux * fy
        middle, low, high = math.atan2(across, along), self._lower[3], self._upper[3]
        inner = [a for a in (middle, middle + math.pi, middle - math.pi) if low <= a <= high]
        cosines = [math.cos(a - middle) for a in (low, high, *inner)]
        squares = ux * ux + uy * uy + fx * fx + fy * fy
        k = 2.0 * math.hypot(along, across)
        return math.sqrt(max(squares + k * min(cosines), 0.0)), math.sqrt(squares + k * max(cosines))

    def arm_angle_rad(self, q_rad: Sequence[float]) -> float:
        """Return the arm angle of a configuration, shape (7,) [rad]; in [-π, π]."""
        return arm_angle_rad(self._shape, self._side, self._turned(q_rad))

    def distance_m(self, target: Placement) -> float:
        """Return the distance from shoulder to wrist [m]."""
        return math.hypot(*wrist_of(self._shape, target)[0])

    def _turned(self, q_rad: Sequence[float]) -> Vector:
        """Return joint angles as angles about the coordinate axes."""
        shape = self._shape
        return tuple([s * (q + zero) for s, q, zero in zip(shape.signs, q_rad, shape.zeros_rad, strict=True)])

    def _joints(self, angles: Sequence[float]) -> Vector:
        """Return angles about the coordinate axes as joint angles."""
        shape = self._shape
        return tuple([s * a - zero for s, a, zero in zip(shape.signs, angles, shape.zeros_rad, strict=True)])

    def _circles(self, target: Placement, *, is_bare: bool = False) -> list[Circle]:
        """Return the circles of a pose, of all bends of the elbow that its limits leave, or of both."""
        line, wrist = wrist_of(self._shape, target)
        x, y, z = line
        low, high = self._lower[3] - KEPT_RAD, self._upper[3] + KEPT_RAD
        return [
            Circle(self._shape, self._side, line, wrist, elbow)
            for elbow in elbows(self._shape, math.sqrt(x * x + y * y + z * z))
            if is_bare or low <= elbow.a4 <= high
        ]

    def _branch(self, angles: Vector) -> Branch:
        beyond = [max(low - a, a - high) for a, low, high in zip(angles, self._lower, self._upper, strict=True)]
        most = max(beyond)
        if most <= SLACK_RAD:
            return Branch(self._joints(angles), 0.0, -1)
        return Branch(self._joints(angles), most, beyond.index(most))


def _nearest(circle: Circle, window: Window, seed: Vector, begin: float) -> _Best:
    """Return the solution downhill from an arm angle; where that leads beyond a limit, the best one of all sectors."""
    downhill = _descended(circle, window, seed, begin, (-math.inf, math.inf))
    angles = _kept(window, downhill.angles, SLACK_RAD)
    if angles:
        return downhill if angles is downhill.angles else downhill._replace(angles=angles)
    at = downhill.arm_angle_rad
    best = _best_of(sectors(circle, window), circle, window, seed, at)
    if best is NONE:
        best = _best_of(points(circle, window), circle, window, seed, at)
    if best is NONE:
        best = _aligned(circle, window, seed)
    return best


def _aligned(circle: Circle, window: Window, seed: Vector) -> _Best:
    """Return the solution with axes 1 and 3 in one line and a1 chosen so that a3 is inside its limits, if there is one."""
    best = NONE
    at = straight(circle)
    angles, _ = circle.at(at, window.shoulder, window.wrist)
    for a3 in (window.lower[2], window.upper[2]):
        circle.free_a1 = math.remainder(angles[0] + angles[2] - a3, math.tau)
        found = _best_of([(at, at)], circle, window, seed, at)
        best = min(best, found)
    return best


def _best_of(choice: list[Sector], circle: Circle, window: Window, seed: Vector, begin: float) -> _Best:
    """Return the best solution in some sectors, each searched from where it is nearest to an arm angle."""
    best = NONE
    for low, high in choice:
        arm_angle = low + (begin - low) % math.tau
        if arm_angle > high:
            arm_angle = high if arm_angle - high < low + math.tau - arm_angle else low
        found = _descended(circle, window, seed, arm_angle, (low, high))
        angles = _kept(window, found.angles, KEPT_RAD)
        if angles and found.distance < best.distance:
            best = found._replace(angles=angles)
    return best


def _kept(window: Window, angles: Vector, slack: float) -> Vector:
    """Return angles put inside the limits, or nothing when one is beyond by more than a slack."""
    beyond = False
    for angle, low, high in zip(angles, window.lower, window.upper):  # noqa: B905  seven each; checking costs
        if angle < low or angle > high:
            if angle < low - slack or angle > high + slack:
                return ()
            beyond = True
    if beyond:
        return tuple([min(max(a, b), c) for a, b, c in zip(angles, window.lower, window.upper, strict=True)])
    return angles


def _descended(circle: Circle, window: Window, seed: Vector, begin: float, sector: Sector) -> _Best:
    """Return where the distance to a seed falls no further, from an arm angle on, without leaving a sector.

    The first step is Gauss and Newton's, later ones follow the slope's change between two points; a step that leads
    uphill is cut.
    """
    low, high = sector
    shoulder, wrist = window.shoulder, window.wrist
    angles, rates = circle.at(begin, shoulder, wrist)
    at, (square, slope, speed) = begin, _downhill(angles, rates, seed)
    step = -slope / speed
    for _ in range(MOST_STEPS):
        furthest = FURTHEST_RAD / math.sqrt(speed)
        step = min(max(step, -furthest), furthest)
        to = min(max(at + step, low), high)
        step = to - at
        if step * step * speed < ENOUGH * ENOUGH * square + TINY_RAD * TINY_RAD:
            break
        to_angles, to_rates = circle.at(to, shoulder, wrist)
        to_square, to_slope, to_speed = _downhill(to_angles, to_rates, seed)
        bend = (to_slope - slope) / step
        if to_square > square:
            step = -slope / bend if to_slope * slope < 0.0 else 0.3 * step
            continue
        at, angles, square, slope, speed = to, to_angles, to_square, to_slope, to_speed
        step = -slope / (bend if bend > 0.2 * speed else speed)
    return _Best(square, at, angles)


def _downhill(angles: Vector, rates: Vector, seed: Vector) -> tuple[float, float, float]:
    """Return the squared distance to a seed, half its slope along the circle, and the square of the joints' speed."""
    a1, a2, a3, a4, a5, a6, a7 = angles
    r1, r2, r3, _, r5, r6, r7 = rates
    s1, s2, s3, s4, s5, s6, s7 = seed
    d1, d2, d3, d4, d5, d6, d7 = a1 - s1, a2 - s2, a3 - s3, a4 - s4, a5 - s5, a6 - s6, a7 - s7
    return (
        d1 * d1 + d2 * d2 + d3 * d3 + d4 * d4 + d5 * d5 + d6 * d6 + d7 * d7,
        d1 * r1 + d2 * r2 + d3 * r3 + d5 * r5 + d6 * r6 + d7 * r7,
        r1 * r1 + r2 * r2 + r3 * r3 + r5 * r5 + r6 * r6 + r7 * r7,
    )
