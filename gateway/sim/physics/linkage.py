"""The gripper's linkage when closed, as points of the hand's plane: what the physics joins by pins.

One motor turns a rotor; a coupler goes from a pin on it to the short arm of each finger's crank; the finger hangs on the
crank's long arm and does not turn (manual §4.4.2). Two lengths are not published: the rotor's radius (here: the end of a
uniform coupler, at twice its centre of mass) and the second finger's coupler (here: the length with which both fingers
are open alike at a motor angle of 1 rad, as the description has it; found by search). Both are choices.

The plane: u towards the fingertips (x of the hand's base), v across (its z for the left hand, -z for the right), the
hand's own y out of it. A motor angle turns the rotor from v towards u: it is counted about +y of the left hand. Knows
nothing of MuJoCo.
"""

from __future__ import annotations

import cmath
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Final

from gateway.sim.physics.body_numbers import body_numbers

__all__ = ["OPEN_RAD", "FingerPins", "HandPins", "hand_angles", "hand_pins"]

OPEN_RAD: Final = 1.0
"""Motor angle fully open [rad] (description)."""

_SHORTEST_M, _LONGEST_M = 0.0445, 0.0465  # the second coupler is looked for between them; below, it would jam
_STEPS: Final = 50


@dataclass(frozen=True, slots=True, kw_only=True)
class FingerPins:
    """Where a finger's linkage is when closed, (u, v) from the origin of the hand's base [m].

    Attributes:
        pivot_m: The crank's pivot, fixed in the hand.
        finger_m: The finger's pin, on the crank.
        crank_pin_m: The coupler's pin on the crank.
        rotor_pin_m: The coupler's pin on the rotor.
        opens: Way of opening along v, 1 or -1.
    """

    pivot_m: tuple[float, float]
    finger_m: tuple[float, float]
    crank_pin_m: tuple[float, float]
    rotor_pin_m: tuple[float, float]
    opens: float


@dataclass(frozen=True, slots=True, kw_only=True)
class HandPins:
    """Both fingers' linkages and the rotor between them.

    Attributes:
        rotor_m: The rotor's axis [m].
        fingers: The one at positive v first.
        y_m: Where the plane is along the hand's y [m].
    """

    rotor_m: tuple[float, float]
    fingers: tuple[FingerPins, FingerPins]
    y_m: float


@lru_cache(maxsize=1)
def hand_pins() -> HandPins:
    """Return the linkage of either hand, in its own plane."""
    table = body_numbers().gripper["left"]
    rotor = _point(table["rotor"])
    first, second = _Arms(table, ""), _Arms(table, "other_")
    com_x, com_y, _ = table["coupler"]["com_m"]
    first_pin = first.crank_pin + 2.0 * complex(com_x, -com_y)
    radius_m = abs(first_pin - rotor)
    wanted_rad = -_crank_rad(rotor, first_pin, first, OPEN_RAD)
    short_m, long_m = _SHORTEST_M, _LONGEST_M
    for _ in range(60):  # the second crank turns less the longer its coupler is
        coupler_m = 0.5 * (short_m + long_m)
        second_pin = _meet(rotor, radius_m, second.crank_pin, coupler_m, near=rotor - radius_m)
        if _crank_rad(rotor, second_pin, second, OPEN_RAD) > wanted_rad:
            long_m = coupler_m
        else:
            short_m = coupler_m
    return HandPins(
        rotor_m=(rotor.real, rotor.imag),
        fingers=(_pins(first, first_pin, 1.0), _pins(second, second_pin, -1.0)),
        y_m=float(table["crank"]["xyz_m"][1]),
    )


def hand_angles(motor_rad: float) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return how far each finger's crank has turned, and its coupler against the crank, counted like u to v [rad].

    Args:
        motor_rad: Motor angle, 0 closed [rad].

    Raises:
        ValueError: The linkage cannot be there.
    """
    hand = hand_pins()
    rotor = complex(*hand.rotor_m)
    found = []
    for finger in hand.fingers:
        rotor_pin, crank_pin = complex(*finger.rotor_pin_m), complex(*finger.crank_pin_m)
        pivot = complex(*finger.pivot_m)
        pin = _crank_pin(rotor, rotor_pin, crank_pin, pivot, motor_rad)
        crank = cmath.phase((pin - pivot) / (crank_pin - pivot))
        turned = rotor + (rotor_pin - rotor) * cmath.exp(-1j * motor_rad)
        coupler = cmath.phase((turned - pin) / (rotor_pin - crank_pin))
        found.append((crank, coupler - crank))
    return found[0], found[1]


class _Arms:
    """A crank's arms; its joints' frames are turned -90 deg about x, so their y is -v."""

    def __init__(self, table: Mapping[str, Any], prefix: str) -> None:
        self.pivot = _point(table[f"{prefix}crank"])
        (short_x, short_y, _), (long_x, long_y, _) = (table[prefix + part]["xyz_m"] for part in ("coupler", "finger"))
        self.crank_pin = self.pivot + complex(short_x, -short_y)
        self.finger = self.pivot + complex(long_x, -long_y)


def _point(part: Mapping[str, Any]) -> complex:
    x, _, z = part["xyz_m"]
    return complex(x, z)


def _pins(arms: _Arms, rotor_pin: complex, opens: float) -> FingerPins:
    points = (arms.pivot, arms.finger, arms.crank_pin, rotor_pin)
    pivot, finger, crank_pin, pin = ((point.real, point.imag) for point in points)
    return FingerPins(pivot_m=pivot, finger_m=finger, crank_pin_m=crank_pin, rotor_pin_m=pin, opens=opens)


def _meet(a: complex, a_m: float, b: complex, b_m: float, near: complex) -> complex:
    """Return the point at two distances from two points, that of both which is nearer to a third.

    Raises:
        ValueError: There is none.
    """
    way = b - a
    along = (a_m * a_m - b_m * b_m + abs(way) ** 2) / (2.0 * abs(way))
    if abs(along) > a_m:
        raise ValueError(f"{1e3 * a_m:.2f} mm and {1e3 * b_m:.2f} mm do not join points {1e3 * abs(way):.2f} mm apart")
    across = cmath.sqrt(a_m * a_m - along * along)
    return min((a + way / abs(way) * (along + sign * 1j * across) for sign in (1, -1)), key=lambda p: abs(p - near))


def _crank_pin(rotor: complex, rotor_pin: complex, crank_pin: complex, pivot: complex, motor_rad: float) -> complex:
    """Return where the crank's pin is at a motor angle [m]; followed from closed in small steps.

    Raises:
        ValueError: The linkage does not get there.
    """
    pin, coupler_m, short_m = crank_pin, abs(crank_pin - rotor_pin), abs(crank_pin - pivot)
    for step in range(1, _STEPS + 1):
        turned = rotor + (rotor_pin - rotor) * cmath.exp(-1j * motor_rad * step / _STEPS)
        pin = _meet(turned, coupler_m, pivot, short_m, near=pin)
    return pin


def _crank_rad(rotor: complex, rotor_pin: complex, arms: _Arms, motor_rad: float) -> float:
    """Return how far the crank has turned at a motor angle, counted like u to v [rad]."""
    pin = _crank_pin(rotor, rotor_pin, arms.crank_pin, arms.pivot, motor_rad)
    return cmath.phase((pin - arms.pivot) / (arms.crank_pin - arms.pivot))
