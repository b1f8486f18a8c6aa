"""Linkage: one finger's four-bar, closed in one step, with the Jacobian of its tip by implicit differentiation.

The manual's §4.4.2: a plane {b} with z out of the page, motor angle q (0 closed, growing as it opens), rotor {0} turned by
R_z(−q), coupler {1} turned against it by φ, crank {2'} against the coupler by θ; all of them are parallel to {b} when the
gripper is closed, so φ = θ = 0 there. The loop must close, g(q, φ, θ) = 0, and the finger's pin is at x = F(q, φ, θ):

    J = ∂F/∂q − ∂F/∂α (∂g/∂α)⁻¹ ∂g/∂q,   α = (φ, θ)

The finger hangs on its pin by a parallelogram and does not turn, so every point of it moves like the pin. In {b} x points to
the finger tips and y across; the rotor's axis is the origin. Left and right gripper are mirror images with one linkage.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from gateway.values import ValueRefused

__all__ = ["Branch", "Closure"]

Array = NDArray[np.float64]

STRAIGHT: Final = 0.02
"""Sine of the angle between coupler and crank below which the linkage counts as stretched out: it would jam (ours)."""


class Closure(Struct, frozen=True, kw_only=True):
    """The linkage at one motor angle.

    Attributes:
        q_rad: Motor angle [rad].
        phi_rad: Coupler against rotor [rad].
        theta_rad: Crank against coupler [rad].
        finger_m: The finger's pin in {b}, shape (2,) [m].
        jacobian_m: How it moves by the motor angle, shape (2,) [m/rad].
    """

    q_rad: float
    phi_rad: float
    theta_rad: float
    finger_m: Array
    jacobian_m: Array

    @property
    def crank_rad(self) -> float:
        """Crank against {b} [rad]."""
        return self.phi_rad + self.theta_rad - self.q_rad


class Branch(Struct, frozen=True, kw_only=True):
    """One finger's linkage, by where things are when the gripper is closed.

    Attributes:
        pivot_m: The crank's pivot in {b}, shape (2,) [m].
        short_arm_m: From there to the coupler's pin, shape (2,) [m].
        long_arm_m: From there to the finger's pin, shape (2,) [m].
        rotor_radius_m: From the rotor's axis to the coupler's other pin [m].
        coupler_m: Length of the coupler [m].
    """

    pivot_m: tuple[float, float]
    short_arm_m: tuple[float, float]
    long_arm_m: tuple[float, float]
    rotor_radius_m: float
    coupler_m: float

    def __post_init__(self) -> None:
        """Refuse lengths that cannot be joined."""
        if min(self.rotor_radius_m, self.coupler_m) <= 0.0:
            raise ValueRefused(
                f"rotor radius {1e3 * self.rotor_radius_m:g} mm and coupler {1e3 * self.coupler_m:g} mm must be above 0"
            )
        if not abs(self.rotor_radius_m - self.coupler_m) < abs(self._crank_pin) < self.rotor_radius_m + self.coupler_m:
            raise ValueRefused(
                f"a rotor radius of {1e3 * self.rotor_radius_m:g} mm and a coupler of {1e3 * self.coupler_m:g} mm do not "
                f"reach the crank's pin, {1e3 * abs(self._crank_pin):.1f} mm from the rotor's axis"
            )

    # Points and turns of the plane as complex numbers: a turn by an angle is a product.

    @property
    def _crank_pin(self) -> complex:
        return complex(*self.pivot_m) + complex(*self.short_arm_m)

    @property
    def _rotor_pin(self) -> complex:
        """The coupler's pin on the rotor, closed: the one from which opening, clockwise, pulls the crank's short arm."""
        return _joined(0j, self.rotor_radius_m, self._crank_pin, self.coupler_m, sign=-1.0)

    def close(self, q_rad: float) -> Closure:
        """Return the linkage at a motor angle.

        Args:
            q_rad: Motor angle [rad], 0 closed.

        Raises:
            ValueRefused: The linkage cannot be there, or is stretched out there so that it would jam.
        """
        pivot, short, far = complex(*self.pivot_m), complex(*self.short_arm_m), complex(*self.long_arm_m)
        closed_pin = self._rotor_pin
        bar = self._crank_pin - closed_pin
        rotor = _turn(-q_rad)
        pin = rotor * closed_pin
        side = math.copysign(1.0, _cross(pivot - closed_pin, bar))
        try:
            crank_pin = _joined(pin, self.coupler_m, pivot, abs(short), sign=side)
        except ValueRefused:
            raise _jammed(q_rad) from None
        coupler, crank = (crank_pin - pin) / bar, (crank_pin - pivot) / short
        phi, theta = _angle(coupler / rotor), _angle(crank / coupler)
        # The manual's chain from {b} to the pivot and to the finger, differentiated: i times a part is its turn.
        after_rotor, after_coupler = coupler * bar, -crank * short
        g_q = -1j * (pin + after_rotor + after_coupler)
        g_phi, g_theta = 1j * (after_rotor + after_coupler), 1j * after_coupler
        tip = after_coupler + crank * far
        f_q, f_phi, f_theta = -1j * (pin + after_rotor + tip), 1j * (after_rotor + tip), 1j * tip
        determinant = _cross(g_phi, g_theta)
        if abs(determinant) < STRAIGHT * self.coupler_m * abs(short):
            raise _jammed(q_rad)
        phi_q, theta_q = -_cross(g_q, g_theta) / determinant, -_cross(g_phi, g_q) / determinant
        finger, jacobian = pivot + crank * far, f_q + f_phi * phi_q + f_theta * theta_q
        return Closure(
            q_rad=q_rad,
            phi_rad=phi,
            theta_rad=theta,
            finger_m=np.array([finger.real, finger.imag]),
            jacobian_m=np.array([jacobian.real, jacobian.imag]),
        )


def _jammed(q_rad: float) -> ValueRefused:
    return ValueRefused(
        f"the gripper's linkage cannot be at a motor angle of {q_rad:.3f} rad: it is stretched out before"
    )


def _turn(angle_rad: float) -> complex:
    return complex(math.cos(angle_rad), math.sin(angle_rad))


def _angle(turn: complex) -> float:
    return math.atan2(turn.imag, turn.real)


def _cross(a: complex, b: complex) -> float:
    return a.real * b.imag - a.imag * b.real


def _joined(a: complex, a_m: float, b: complex, b_m: float, *, sign: float) -> complex:
    """Return the point at two distances from two points; `sign` chooses: positive to the left of the way from a to b.

    Raises:
        ValueRefused: There is none.
    """
    way = b - a
    along = (a_m * a_m - b_m * b_m + abs(way) ** 2) / (2.0 * abs(way))
    across_squared = a_m * a_m - along * along
    if across_squared < 0.0:
        raise ValueRefused("the circles do not meet")
    return a + way / abs(way) * complex(along, sign * math.sqrt(across_squared))
