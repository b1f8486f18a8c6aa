"""The simulated chassis: three omni wheels under ramped body velocities.

Rules (§4.5): a command sets the target at once; each component ramps at 0.3 up and 0.6 down; after more than 1 s
without a command the target becomes zero; no heartbeat, no limit, no normalisation. A wrong length may end the
chassis node: here it does. NaN or inf may spoil the speed state: here it does; both last until the fault is cleared
(a restart of the node).

Wheel positions and radius: the vendor's published description (wheel layout, axle height). Axles point to the
centre.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gateway.sim.robot.journal import Journal
from gateway.sim.robot.manual import CHASSIS_ACCEL, CHASSIS_DECEL, CHASSIS_WATCHDOG_NS, S

__all__ = ["SimChassis", "ramp", "wheel_matrix"]

Array = NDArray[np.float64]

WHEEL_RADIUS_M: Final = 0.0897
# x, y of the wheel centre [m] and yaw of its joint frame [rad]; roll is +-90 deg, the axis is -z of that frame.
_WHEELS: Final = (
    (0.14484, -0.25087, -math.pi / 2, -2.6179938779914944),
    (0.14484, 0.25087, -math.pi / 2, -0.5235987755982988),
    (-0.35666, 0.0, math.pi / 2, -math.pi / 2),
)


def wheel_matrix() -> Array:
    """Return the map from body velocity (m/s, m/s, rad/s) to wheel speeds (rad/s), shape (3, 3)."""
    rows = []
    for x, y, roll, yaw in _WHEELS:
        # -z of the joint frame in the base: Rz(yaw) Rx(roll) (0, 0, -1).
        axle_y = math.sin(roll)
        axle = (-math.sin(yaw) * axle_y, math.cos(yaw) * axle_y)
        # Rolling without slip about `axle` moves the wheel centre along axle x z_up, one radius per radian.
        along = (axle[1], -axle[0])
        rows.append([along[0], along[1], x * along[1] - y * along[0]])
    return np.array(rows) / WHEEL_RADIUS_M


def ramp(v: float, target: float, duration_s: float) -> tuple[float, float]:
    """Return speed and way after a time of ramping towards a target, exactly.

    Args:
        v: Speed at the beginning [m/s or rad/s].
        target: Wanted speed, same unit.
        duration_s: Time [s].
    """
    way, left_s = 0.0, duration_s
    while left_s > 0.0 and v != target:
        goal = target if v * target >= 0.0 else 0.0
        rate = CHASSIS_DECEL if abs(goal) < abs(v) else CHASSIS_ACCEL
        needed_s = abs(goal - v) / rate
        step_s = min(needed_s, left_s)
        reached = goal if step_s == needed_s else v + math.copysign(rate * step_s, goal - v)
        way += 0.5 * (v + reached) * step_s
        v = reached
        left_s -= step_s
    return v, way + v * left_s


class SimChassis:
    """State and rules of the chassis.

    Attributes:
        velocity: Body velocity vx, vy, wz [m/s, m/s, rad/s].
        travel: Integral of `velocity` per component [m, m, rad].
        target: What it ramps towards.
        is_enabled: Configuration switch of §2.3.
        is_dead: The control node has ended after a command of wrong length.
        is_spoiled: The speed state has become invalid after a non-finite command.
    """

    def __init__(self, journal: Journal, *, is_enabled: bool) -> None:
        self.velocity = [0.0, 0.0, 0.0]
        self.travel = [0.0, 0.0, 0.0]
        self.target = [0.0, 0.0, 0.0]
        self.is_enabled = is_enabled
        self.is_dead = False
        self.is_spoiled = False
        self._journal = journal
        self._last_ns: int | None = None
        self._matrix = wheel_matrix()

    def command(self, data: Sequence[float], now_ns: int) -> bool:
        """Take a velocity command; return whether it was accepted.

        Args:
            data: vx, vy [m/s], wz [rad/s].
            now_ns: Arrival [ns].
        """
        subject = "chassis velocity"
        if self.is_dead or self.is_spoiled:
            self._journal.note(now_ns, "CHASSIS_DOWN", subject, "ignored until the node is restarted (fault cleared)")
            return False
        if len(data) != 3:
            self.is_dead = True
            self.target = [0.0, 0.0, 0.0]
            self._journal.note(now_ns, "CHASSIS_NODE_DIED", subject, f"{len(data)} values, 3 needed (§4.5)")
            return False
        if not all(map(math.isfinite, data)):
            self.is_spoiled = True
            self.target = [0.0, 0.0, 0.0]
            self._journal.note(now_ns, "CHASSIS_SPEED_INVALID", subject, f"{list(data)} (§4.5)")
            return False
        self.target = [float(value) for value in data]
        self._last_ns = now_ns
        return True

    def restart(self) -> None:
        """Start the control node anew."""
        self.is_dead = self.is_spoiled = False

    @property
    def deadline_ns(self) -> int | None:
        """When a silent stream ends: the first instant more than 1 s after the last command [ns]."""
        return None if self._last_ns is None else self._last_ns + CHASSIS_WATCHDOG_NS + 1

    def expire(self, now_ns: int) -> None:
        """Set the target to zero when the deadline has passed."""
        deadline_ns = self.deadline_ns
        if deadline_ns is not None and now_ns >= deadline_ns:
            self._last_ns = None
            if any(self.target):
                self._journal.note(now_ns, "CHASSIS_WATCHDOG", "chassis", "no command for 1 s, stopping (§4.5)")
            self.target = [0.0, 0.0, 0.0]

    def move(self, duration_ns: int) -> None:
        """Let time pass."""
        if not any(self.velocity) and not any(self.target):
            return
        for axis in range(3):
            self.velocity[axis], way = ramp(self.velocity[axis], self.target[axis], duration_ns / S)
            self.travel[axis] += way

    def wheels(self) -> tuple[Array, Array]:
        """Return wheel angles [rad] and speeds [rad/s], shape (3,) each; speeds are NaN while the state is spoiled."""
        speeds = self._matrix @ self.velocity
        if self.is_spoiled:
            speeds = np.full(3, np.nan)
        return self._matrix @ self.travel, speeds
