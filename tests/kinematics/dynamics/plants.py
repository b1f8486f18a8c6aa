"""An arm that is easily worked out by hand: seven masses of their own, each held up against a weight."""

from __future__ import annotations

import numpy as np

from gateway.kinematics.dynamics.observer import Terms
from gateway.kinematics.dynamics.parameters import DriveParameters

__all__ = ["JACOBIAN", "WEIGHT", "Plant", "moved"]

MASS = np.arange(1.0, 8.0) / 10.0
WEIGHT = np.linspace(4.0, -2.0, 7)
JACOBIAN = np.eye(7)[:6]


class Plant:
    """What an observer asks of an arm, of masses that do not feel each other; the base's speed along x shows as momentum."""

    frame, point, load = "left_shoulder_base", "left_ee", None

    def __init__(self, jacobian=JACOBIAN, **drives):
        self.drives = DriveParameters(**drives)
        self._jacobian = jacobian

    def terms(self, q_rad, dq_radps, base):
        """Momentum is mass times velocity."""
        drift = sum(base[:1]) * MASS
        return Terms(MASS * dq_radps + drift, -WEIGHT, WEIGHT, np.diag(MASS))

    def carry(self, load):
        """It is no part of the terms."""
        self.load = load

    def load_columns(self, q_rad):
        """A mass turns each joint by its lever, a first moment the joint of its axis; the third as the first joint turns."""
        columns = np.zeros((7, 4))
        columns[:, 0], columns[4, 1], columns[5, 2], columns[6, 3] = (
            -np.linspace(3.0, 0.5, 7),
            -9.8,
            -9.8,
            9.8 * q_rad[0],
        )
        return columns

    def jacobian(self, q_rad):
        """The first six joints push along the hand's axes."""
        return self._jacobian


def moved(observer, plant, *, seconds, external, period_ns=5_000_000, start_ns=0, noise_nm=0.0, dq0=0.0, seed=0):
    """Let motors hold the weights and shake the masses, while something pulls; return the estimates, shape (n, 7)."""
    rng, found, dq, dt = np.random.default_rng(seed), [], np.full(7, dq0), period_ns / 1e9
    for number in range(round(seconds / dt)):
        shake = 0.5 * np.sin(2.0 * np.pi * (number + 0.5) * dt) * np.ones(7)
        torque = WEIGHT + shake + plant.drives.friction_nm(dq)
        dq = dq + dt * (shake + external) / MASS
        efforts = (torque + rng.normal(0.0, 1.0, 7) * noise_nm) / np.array(plant.drives.scale)
        at_ns = start_ns + number * period_ns
        observer.update(at_ns, (0.0,) * 7, tuple(dq.tolist()), tuple(efforts.tolist()))
        found.append(observer.torque_nm.copy())
    return np.array(found)
