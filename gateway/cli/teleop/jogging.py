"""Jogging in numbers: what a person wishes becomes small steps of a target. Pure: no clock, no device, no robot.

A wish is a part of full speed for each axis, -1 to 1. It lasts as long as the deadman says, and is taken up and let go along a
ramp, let go more quickly. No vector is longer than full speed.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from gateway.api.protocol import Info
from gateway.values import Vector

__all__ = ["AXES", "HAND", "LEVELS", "Demand", "KeyDeadman", "Ramp", "apart", "full_speeds", "moved"]

Demand = Mapping[str, float]
"""Axis -> part of full speed, -1 to 1. Axes that are left out are let go."""
HAND = ("x", "y", "z", "roll", "pitch", "yaw")
GROUPS = (HAND[:3], HAND[3:], ("joint",), ("vx", "vy"), ("wz",), ("lift",))
"""Axes, those of one vector together."""
AXES = tuple(axis for group in GROUPS for axis in group)
LEVELS = (0.05, 0.1, 0.2, 0.4, 0.7, 1.0)
"""Parts of the greatest speeds to choose from."""

TAP_LEVEL, TAP_NS = 0.15, 600_000_000
"""Of a key that was pressed once: its part of full speed, so little that the wait for its repetition (250 to 500 ms) may be
moved through; and for how long [ns]."""
REPEAT_NS, HELD_NS = 150_000_000, 250_000_000
"""Terminals repeat 10 to 40 times a second, fingers do not; a key counts as held for so long after its last repetition [ns]."""
RISE_PER_S, FALL_PER_S = 4.0, 10.0
"""How quickly a part of full speed is taken up and let go [1/s]."""


def full_speeds(info: Info, level: int) -> dict[str, float]:
    """Return full speed of every axis inside the gateway's limits [m/s, rad/s; the lift as a part], at one of `LEVELS`."""
    linear, angular = min(0.25, info.pose_v_mps), min(1.0, info.pose_w_radps)
    chassis, turn = min(0.3, info.chassis_v_mps), min(0.6, info.chassis_w_radps)
    joint, lift = min(0.6, info.v_radps), min(0.6, info.lift_v_max)
    # A sum of squares is rounded, too: no diagonal may be above the bound.
    part = LEVELS[level] * (1.0 - 1e-9)
    greatest = (*[linear] * 3, *[angular] * 3, joint, chassis, chassis, turn, lift)
    return {axis: part * speed for axis, speed in zip(AXES, greatest, strict=True)}


class KeyDeadman:
    """Keys of a terminal, which tells only that one is pressed or repeated, never that it is let go.

    A first press moves slowly: a tap is a small step, and a key that is held begins at once, without a jerk when it is
    repeated. Repetitions move at full speed. A terminal repeats only the key that was pressed last.
    """

    def __init__(self) -> None:
        self._key, self._at_ns, self._until_ns, self._is_held = "", 0, 0, False

    def press(self, key: str, now_ns: int) -> None:
        """Take a key that arrived; an empty one lets go of any."""
        is_same = key == self._key and now_ns < self._until_ns
        self._is_held = is_same and (self._is_held or now_ns - self._at_ns <= REPEAT_NS)
        self._key, self._at_ns = key, now_ns
        self._until_ns = now_ns + (HELD_NS if self._is_held else TAP_NS)

    def level(self, now_ns: int) -> tuple[str, float]:
        """Return the key that counts now, and its part of full speed; an empty one while none does."""
        if now_ns >= self._until_ns:
            return "", 0.0
        return self._key, 1.0 if self._is_held else TAP_LEVEL


class Ramp:
    """Takes up and lets go what is wished for."""

    def __init__(self) -> None:
        self._now = dict.fromkeys(AXES, 0.0)

    def step(self, wish: Demand, dt_s: float) -> dict[str, float]:
        """Return the part of full speed of every axis, so long [s] after the last step."""
        wanted = _inside({axis: wish.get(axis, 0.0) for axis in AXES})
        for axis, now in self._now.items():
            gap = wanted[axis] - now
            most = min(FALL_PER_S * dt_s, abs(now)) if now * gap < 0.0 else RISE_PER_S * dt_s
            self._now[axis] = now + min(max(gap, -most), most)
        self._now = _inside(self._now)
        return dict(self._now)


def _inside(parts: dict[str, float]) -> dict[str, float]:
    """Return parts of full speed no vector of which is longer than 1."""
    for group in GROUPS:
        length = math.hypot(*(parts[axis] for axis in group))
        if not length <= 1.0:  # a device that says NaN wishes nothing
            parts |= {axis: parts[axis] / length if length < math.inf else 0.0 for axis in group}
    return parts


def moved(pose: Sequence[float], twist: Sequence[float], dt_s: float, *, in_hand: bool) -> Vector:
    """Return a pose, x, y, z [m], qx, qy, qz, qw, after a step: its twist [m/s, rad/s] along its frame's axes or the hand's."""
    q, linear, angular = tuple(pose[3:]), tuple(twist[:3]), tuple(twist[3:])
    if in_hand:
        linear = _times(_times(q, (*linear, 0.0)), (-q[0], -q[1], -q[2], q[3]))[:3]
    rate = math.hypot(*angular)
    if rate > 0.0:
        half = 0.5 * rate * dt_s
        turn = (*(math.sin(half) * w / rate for w in angular), math.cos(half))
        q = _times(q, turn) if in_hand else _times(turn, q)
        norm = math.hypot(*q)
        q = tuple(c / norm for c in q)
    return (*(p + v * dt_s for p, v in zip(pose[:3], linear, strict=True)), *q)


def _times(a: Sequence[float], b: Sequence[float]) -> Vector:
    """Return the product of two quaternions, xyzw."""
    (ax, ay, az, aw), (bx, by, bz, bw) = a, b
    return (
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
        aw * bw - ax * bx - ay * by - az * bz,
    )


def apart(pose: Sequence[float], other: Sequence[float]) -> tuple[float, float]:
    """Return how far two poses are apart [m], [rad]."""
    x, y, z, _ = _times(pose[3:], (-other[3], -other[4], -other[5], other[6]))
    return math.dist(pose[:3], other[:3]), 2.0 * math.asin(min(math.hypot(x, y, z), 1.0))
