"""Generalised-momentum observer (De Luca, Mattone, IROS 2005): external torques of an arm's joints from its efforts alone.

With momentum p = M v, and dp/dt = tau + C'v - g - friction + external, the residual

    r = K (p - integral of (tau + C'v - g - friction + r))

follows the external torques as a low pass of time constant 1 / K, without accelerations. Steps are implicit: stable whatever
the time between samples. How sure it is comes from the noise of the samples themselves (their second differences, in which
motion hardly shows), and from what the parameters do not know: masses, scale, friction. Pure arithmetic, no pinocchio.
"""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from gateway.kinematics.dynamics.parameters import DriveParameters, Load
from gateway.values import ARM_DOF, Vector

__all__ = ["Dynamics", "MomentumObserver", "Terms"]

Array = NDArray[np.float64]

MS = 1_000_000
LEAST_SD_NM = 1e-3
"""No estimate is surer than this [N·m], whatever parameters say and however quiet it is."""
GAP_NS = 150 * MS
"""Samples further apart are no continuation: the observer begins anew [ns]. At rest they come 50 ms apart."""
TIME_CONSTANT_NS = 30 * MS
"""1 / K [ns]."""
CONVERGED = 6.0
"""After so many time constants what was there at the beginning is forgotten to 0.25 %."""
NOISE_SAMPLES = 100
"""The noise is that of about the last so many samples."""
OF_SECOND_DIFFERENCE = 6.0
"""Variance of x - 2x' + x'' per variance of white noise x."""


class Terms(NamedTuple):
    """What a posture and its velocities give.

    Attributes:
        momentum_nms: Generalised momentum of the joints, shape (7,) [N·m·s].
        drift_nm: Its change without drives, friction and touch: dT/dq - gravity, shape (7,) [N·m].
        gravity_nm: Torques that hold the arm up, shape (7,) [N·m].
        masses_kgm2: Mass matrix of the joints, shape (7, 7) [kg·m²].
    """

    momentum_nms: Array
    drift_nm: Array
    gravity_nm: Array
    masses_kgm2: Array


class Dynamics(Protocol):
    """What an observer needs of an arm; see `arm_dynamics.ArmDynamics`."""

    drives: DriveParameters
    frame: str
    point: str
    load: Load | None

    def carry(self, load: Load | None) -> None:
        """Hold a load from now on; None for nothing."""
        ...

    def load_columns(self, q_rad: Array) -> Array:
        """Return what a load pulls the joints with per mass and first moments in the hand's frame, shape (7, 4)."""
        ...

    def terms(self, q_rad: Array, dq_radps: Array, base: Vector) -> Terms:
        """Return what a posture and velocities give."""
        ...

    def jacobian(self, q_rad: Array) -> Array:
        """Return the hand's Jacobian in the axes of `frame`, shape (6, 7)."""
        ...


class MomentumObserver:
    """Follows one arm.

    Args:
        dynamics: The arm.
        time_constant_ns: Of the estimate [ns].

    Attributes:
        time_constant_ns: Of the estimate [ns].
        torque_nm: External torques, shape (7,) [N·m]: what pushes towards positive positions is positive.
        q_rad: Joint positions of the newest sample, shape (7,) [rad].
    """

    def __init__(self, dynamics: Dynamics, time_constant_ns: int = TIME_CONSTANT_NS) -> None:
        self._dynamics = dynamics
        self.time_constant_ns = time_constant_ns
        self.torque_nm: Array = np.zeros(ARM_DOF)
        self.q_rad: Array = np.zeros(ARM_DOF)
        self.restart()

    def restart(self) -> None:
        """Forget everything: what comes next is no continuation."""
        self._at_ns: int | None = None
        self._since_ns = 0
        self._count = 0
        self._noise: Array = np.zeros((2, ARM_DOF))  # variances of torques and velocities
        self._before: list[Array] = []
        self._kept = self._dt_s = 0.0
        self._dq = self._momentum = self._drive = self._load = np.zeros(ARM_DOF)
        self._masses: Array = np.zeros((ARM_DOF, ARM_DOF))
        self.torque_nm = np.zeros(ARM_DOF)

    @property
    def settled_ns(self) -> int:
        """How long samples have followed each other [ns]; 0 before the second one."""
        return 0 if self._at_ns is None else self._at_ns - self._since_ns

    @property
    def is_converged(self) -> bool:
        """Whether the estimate says what is, not how the observer began."""
        return self.settled_ns >= CONVERGED * self.time_constant_ns

    def update(self, at_ns: int, q_rad: Vector, dq_radps: Vector, tau_nm: Vector, base: Vector = ()) -> None:
        """Take a sample; the same one again is passed over, and one from before the last is a new beginning.

        Args:
            at_ns: Its time on any clock, the robot's stamp for choice [ns].
            q_rad: Joint positions, shape (7,) [rad].
            dq_radps: Joint velocities, shape (7,) [rad/s].
            tau_nm: Efforts as the robot reports them (§4.8), shape (7,) [N·m].
            base: Velocities of the base: x, y [m/s], yaw [rad/s].
        """
        if at_ns == self._at_ns:
            return
        if self._at_ns is None or not 0 < at_ns - self._at_ns <= GAP_NS:
            self.restart()
            self._since_ns = self._at_ns = at_ns
        drives, dq = self._dynamics.drives, np.array(dq_radps)
        self.q_rad, self._dq = np.array(q_rad), dq
        torque = np.array(tau_nm) * drives.scale
        terms = self._dynamics.terms(self.q_rad, dq, base)
        drive = torque - drives.friction_nm(dq) + terms.drift_nm
        load = np.maximum(np.abs(torque), np.abs(terms.gravity_nm))
        dt_s = (at_ns - self._at_ns) / 1e9
        if dt_s > 0.0:
            gain = 1e9 / self.time_constant_ns
            gone = terms.momentum_nms - self._momentum - 0.5 * dt_s * (drive + self._drive)
            self._kept = 1.0 / (1.0 + gain * dt_s)
            self.torque_nm = self._kept * (self.torque_nm + gain * gone)
            load = self._load + (1.0 - self._kept) * (load - self._load)
            self._dt_s = dt_s
        self._momentum, self._drive, self._load, self._masses = terms.momentum_nms, drive, load, terms.masses_kgm2
        self._at_ns = at_ns
        self._measure_noise(np.array((torque, dq)))

    def variance_nm2(self) -> Array:
        """Return the variance of each joint's torque, shape (7,) [N²·m²]; of use once it is converged."""
        kept, gain = self._kept, 1e9 / self.time_constant_ns
        of_torque, of_velocity = self._noise
        of_torque = of_torque * (kept * gain * self._dt_s) ** 2 / (1.0 - kept**2)
        of_velocity = np.square(self._masses) @ of_velocity * (kept * gain) ** 2 * 2.0 / (1.0 + kept)
        drives = self._dynamics.drives
        unsure = np.square(drives.unsure_part * self._load) + np.square(drives.unknown_friction_nm(self._dq))
        variance: Array = of_torque + of_velocity + unsure + LEAST_SD_NM**2
        return variance

    def _measure_noise(self, sample: Array) -> None:
        """Take a sample of torques and velocities, shape (2, 7), for how noisy they are."""
        if len(self._before) == 2:
            older, old = self._before
            found = np.square(sample - 2.0 * old + older) / OF_SECOND_DIFFERENCE
            self._count = min(self._count + 1, NOISE_SAMPLES)
            self._noise += (found - self._noise) / self._count
            self._before = [old, sample]
        else:
            self._before.append(sample)
