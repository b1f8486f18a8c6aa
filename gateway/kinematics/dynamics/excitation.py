"""Motions from which dynamics are told best: sums of sines (Swevers et al., 1997) inside the limits, clear of the body.

Many are drawn, and the best of those that are allowed is taken: that whose columns of the regression differ most. Each joint
swings about a middle of its own with five harmonics, at 80 % of the limits of speed and acceleration at most; both ends are
at rest.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gateway.kinematics.dynamics.parameters import STICK_RADPS
from gateway.values import ARM_DOF

__all__ = ["DT_S", "Excitation", "excite"]

Array = NDArray[np.float64]

DT_S: Final = 0.02
"""Time between points [s]."""
LASTS_S, BASIS_HZ, HARMONICS, EASE_S = 40.0, 0.1, 5, 2.0
TRIES: Final = 100
LIMIT_PART: Final = 0.8
SHOULDER: Final = 4
"""Joints that carry an arm towards the body; the wrist's may always swing widely."""
LOOKED_AT: Final = 10
"""Whether it is clear is asked of each so many-th point: 0.2 s."""


class Excitation(NamedTuple):
    """A motion.

    Attributes:
        q_rad: Points `DT_S` apart, shape (n, 7) [rad].
        condition: Largest condition number of a joint's load, friction and rotor: the smaller, the better told.
    """

    q_rad: Array
    condition: float


def excite(
    lower_rad: Array,
    upper_rad: Array,
    v_radps: float,
    a_radps2: float,
    loads: Callable[[Array, Array, Array], Array],
    is_clear: Callable[[Array], bool],
    seed: int = 0,
) -> Excitation | None:
    """Return the best motion of those that were drawn; None when every one comes too near something.

    Args:
        lower_rad: Limits of the joints, shape (7,) [rad].
        upper_rad: Likewise.
        v_radps: Limit of their speeds [rad/s].
        a_radps2: Limit of their accelerations [rad/s²].
        loads: Gives torques of positions, velocities and accelerations, shape (7,) each [N·m].
        is_clear: Says whether a posture, shape (7,) [rad], is clear of everything.
        seed: Of what is drawn.
    """
    rng, best = np.random.default_rng(seed), None
    t = np.arange(0.0, LASTS_S + DT_S / 2, DT_S)
    ease = np.clip(np.minimum(t, t[-1] - t) / EASE_S, 0.0, 1.0)
    ease = ease**3 * (10.0 - 15.0 * ease + 6.0 * ease**2)
    part = 1.0
    for _ in range(TRIES):
        phases = rng.uniform(0.0, 2.0 * np.pi, (HARMONICS, ARM_DOF))
        sizes = rng.uniform(0.2, 1.0, (HARMONICS, ARM_DOF))
        turns = 2.0 * np.pi * BASIS_HZ * np.arange(1, HARMONICS + 1)[:, None] * t
        swing = np.einsum("ht,hj->tj", np.sin(turns), sizes * np.cos(phases))
        swing = (swing + np.einsum("ht,hj->tj", np.cos(turns), sizes * np.sin(phases))) * ease[:, None]
        speed = np.gradient(swing, DT_S, axis=0)
        middle = lower_rad + rng.uniform(0.3, 0.7, ARM_DOF) * (upper_rad - lower_rad)
        widest = np.where(np.arange(ARM_DOF) < SHOULDER, part, 1.0) * np.minimum(middle - lower_rad, upper_rad - middle)
        pairs = ((widest, swing), (v_radps, speed), (a_radps2, np.gradient(speed, DT_S, axis=0)))
        size = LIMIT_PART * np.min([most / np.abs(values).max(axis=0) for most, values in pairs], axis=0)
        q = middle + swing * size
        if not all(is_clear(posture) for posture in q[::LOOKED_AT]):
            part = max(0.4, 0.95 * part)  # the wider, the better: less wide only where it must be
            continue
        found = Excitation(q, _condition(q, loads))
        if best is None or found.condition < best.condition:
            best = found
    return best


def _condition(q: Array, loads: Callable[[Array, Array, Array], Array]) -> float:
    dq = np.gradient(q, DT_S, axis=0)
    rows = [values[::LOOKED_AT] for values in (q, dq, np.gradient(dq, DT_S, axis=0))]
    load = np.array([loads(*row) for row in zip(*rows, strict=True)])
    columns = np.stack((load, np.tanh(rows[1] / STICK_RADPS), rows[1], rows[2]), axis=1)
    return float(np.linalg.cond((columns / np.linalg.norm(columns, axis=0)).transpose(2, 0, 1)).max())
