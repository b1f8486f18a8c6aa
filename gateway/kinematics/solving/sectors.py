"""Sectors: the arm angles of a pose at which every joint keeps inside its limits, in closed form.

Along the circle each joint angle is the direction of a vector whose two components are waves of the arm angle, or has such
a wave as its sine or cosine. It passes a limit at the roots of one wave, at most two, and the wave's slope there says
whether it comes in or goes out. Sorted around the circle, the passages leave the sectors in which nothing is out.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from gateway.kinematics.solving.circle import Circle, Wave
from gateway.values import Vector

__all__ = ["SLACK_RAD", "Sector", "Window", "points", "sectors", "straight", "turned_to", "windows"]

SLACK_RAD = 1e-11
"""Rounding: a joint beyond its limit by less than this is at its limit."""

TOUCH = 1e-12
"""A wave that misses zero by less than the square root of this, of its height, touches it."""

Sector = tuple[float, float]
"""Arm angles from one to another, begin in [-π, π), end not before the begin and at most 2π after it [rad]."""

# Joint -> which waves are sine and cosine of its angle, with the second one's sign, times the branch's sign.
SHOULDER_TURNS = ((0, 0, 1, 1.0), (2, 3, 4, -1.0))
WRIST_TURNS = ((4, 5, 6, 1.0), (6, 8, 9, 1.0))
COSINE_2 = 2
MINUS_SINE_6 = 7


class _Turning(NamedTuple):
    """A limit of a joint whose angle is the direction of two waves.

    Attributes:
        joint: Its index.
        first: Index of the wave that is the sine of the angle, but for a sign.
        second: Index of the one that is its cosine.
        p: With `q`: factors of both waves whose sum is the sine of how far the joint is beyond the limit ...
        q: ... but for a positive factor.
        u: With `v`: factors for the cosine of it; negative at the root that is half a turn away from the limit.
        v: See `u`.
        comes_in: 1 at a lower limit, where the joint comes in as the sine rises; -1 at an upper one.
    """

    joint: int
    first: int
    second: int
    p: float
    q: float
    u: float
    v: float
    comes_in: float


class _Bounded(NamedTuple):
    """A limit of a joint that is where a wave has a value.

    Attributes:
        joint: Its index.
        wave: Index of the wave.
        value: Of the wave at the limit.
        comes_in: 1 where the joint comes in as the wave rises, -1 where it goes out.
    """

    joint: int
    wave: int
    value: float
    comes_in: float


class Window(NamedTuple):
    """One way for shoulder and wrist to do it, as far as limits leave it open.

    Attributes:
        shoulder: Sign of the sine of a2.
        wrist: Sign of the cosine of a6.
        lower: Lowest a1 to a7 of this way, shape (7,) [rad].
        upper: Highest a1 to a7 of this way, shape (7,) [rad].
        turning: Limits of joints that are the direction of two waves.
        bounded: Limits of joints of which a wave is the sine or cosine.
    """

    shoulder: float
    wrist: float
    lower: Vector
    upper: Vector
    turning: tuple[_Turning, ...]
    bounded: tuple[_Bounded, ...]


def windows(lower: Vector, upper: Vector) -> tuple[Window, ...]:
    """Return the ways that limits leave open, at most six: the wrist bent over either way lies in two pieces.

    Args:
        lower: Lowest a1 to a7, shape (7,) [rad], in [-π, π].
        upper: Highest a1 to a7, shape (7,) [rad].
    """
    found: list[Window] = []
    for shoulder, (low2, high2) in ((1.0, (0.0, math.pi)), (-1.0, (-math.pi, 0.0))):
        for wrist, (low6, high6) in (
            (1.0, (-math.pi / 2, math.pi / 2)),
            (-1.0, (math.pi / 2, math.pi)),
            (-1.0, (-math.pi, -math.pi / 2)),
        ):
            low, high = list(lower), list(upper)
            low[1], high[1] = max(low[1], low2), min(high[1], high2)
            low[5], high[5] = max(low[5], low6), min(high[5], high6)
            if low[1] < high[1] and low[5] < high[5]:
                found.append(_window(shoulder, wrist, tuple(low), tuple(high)))
    return tuple(found)


def _window(shoulder: float, wrist: float, lower: Vector, upper: Vector) -> Window:
    turning: list[_Turning] = []
    for sign, turns in ((shoulder, SHOULDER_TURNS), (wrist, WRIST_TURNS)):
        for joint, sine, cosine, sense in turns:
            if upper[joint] - lower[joint] < math.tau - SLACK_RAD:
                for limit, comes_in in ((lower[joint], 1.0), (upper[joint], -1.0)):
                    c, s = sign * math.cos(limit), sign * math.sin(limit)
                    turning.append(_Turning(joint, sine, cosine, c, -sense * s, s, sense * c, comes_in))
    bounded: list[_Bounded] = []
    cosines = (math.cos(lower[1]), math.cos(upper[1]))
    sines = (-math.sin(lower[5]), -math.sin(upper[5]))
    for joint, wave, values in ((1, COSINE_2, cosines), (5, MINUS_SINE_6, sines)):
        for value, comes_in in ((min(values), 1.0), (max(values), -1.0)):
            if abs(value) < 1.0 - SLACK_RAD * SLACK_RAD:
                bounded.append(_Bounded(joint, wave, value, comes_in))
    return Window(shoulder, wrist, lower, upper, tuple(turning), tuple(bounded))


def sectors(circle: Circle, window: Window) -> list[Sector]:
    """Return where on a pose's circle all joints keep inside their limits; the elbow is not looked at.

    Returns:
        Sectors in order; a single one from -π to π where there is no passage at all.
    """
    return _between(circle, window, _passages(circle, window))


def points(circle: Circle, window: Window) -> list[Sector]:
    """Return the arm angles at which some joint is at a limit, or axes 1 and 3 are one, as sectors without width.

    A pose of a configuration in a corner, with several joints at their limits, has no sector with a width: one of these
    may be all there is.
    """
    return [(at, at) for at in (straight(circle), *(passage[0] for passage in _passages(circle, window)))]


def straight(circle: Circle) -> float:
    """Return the arm angle at which axes 1 and 3 are nearest to being one line [rad]."""
    _, b, d = circle.waves[COSINE_2]
    return math.atan2(d, b)


def turned_to(circle: Circle, window: Window, a1: float) -> list[float]:
    """Return the arm angles at which joint 1 has an angle [rad]; one or none.

    Near a shoulder with axes 1 and 3 in one line, where joint 1 turns fast, this finds what going downhill would miss.
    """
    (a, b, d), (e, f, g) = circle.waves[0], circle.waves[1]
    x, z = window.shoulder * math.sin(a1), window.shoulder * math.cos(a1)
    return [
        math.atan2(s, c)
        for c, s, _ in _roots((z * a - x * e, z * b - x * f, z * d - x * g))
        if x * (a + b * c + d * s) + z * (e + f * c + g * s) > 0.0
    ]


def _passages(circle: Circle, window: Window) -> list[tuple[float, int, float]]:
    """Return where joints pass their limits: arm angle, joint, 1 in or -1 out; in order."""
    waves = circle.waves
    passages: list[tuple[float, int, float]] = []
    for joint, first, second, p, q, u, v, comes_in in window.turning:
        a, b, d = waves[first]
        e, f, g = waves[second]
        for c, s, rises in _roots((p * a + q * e, p * b + q * f, p * d + q * g)):
            if u * (a + b * c + d * s) + v * (e + f * c + g * s) > 0.0:
                passages.append((math.atan2(s, c), joint, comes_in * rises))
    for joint, index, value, comes_in in window.bounded:
        a, b, d = waves[index]
        for c, s, rises in _roots((a - value, b, d)):
            passages.append((math.atan2(s, c), joint, comes_in * rises))
    passages.sort()
    return passages


def _roots(wave: Wave) -> tuple[tuple[float, float, float], ...]:
    """Return cosine and sine of the angles at which a wave is zero, with 1 where it rises and -1 where it falls."""
    a, b, d = wave
    square = b * b + d * d
    rest = square - a * a
    if rest < -TOUCH * square or square <= 0.0:
        return ()
    root = math.sqrt(max(rest, 0.0))
    return (
        ((-a * b + d * root) / square, (-a * d - b * root) / square, 1.0),
        ((-a * b - d * root) / square, (-a * d + b * root) / square, -1.0),
    )


def _between(circle: Circle, window: Window, passages: list[tuple[float, int, float]]) -> list[Sector]:
    """Return the sectors that passages leave."""
    start = 0.5 * (passages[0][0] + passages[-1][0] + math.tau) if passages else 0.0
    first: dict[int, float] = {}
    for _, joint, comes_in in passages:
        first.setdefault(joint, comes_in)
    angles, _ = circle.at(start, window.shoulder, window.wrist)
    out = 0
    for joint, (angle, low, high) in enumerate(zip(angles, window.lower, window.upper, strict=True)):
        comes_in = first.get(joint, 0.0)
        if comes_in > 0.0:
            out += 1
        elif comes_in == 0.0 and joint != 3 and not low - SLACK_RAD <= angle <= high + SLACK_RAD:
            return []
    if not passages:
        return [(-math.pi, math.pi)]
    found: list[Sector] = []
    begin = passages[-1][0]
    for arm_angle, _, comes_in in passages:
        if comes_in > 0.0:
            out -= 1
            begin = arm_angle
        else:
            if out == 0:
                found.append((begin, arm_angle if arm_angle >= begin else arm_angle + math.tau))
            out += 1
    return found
