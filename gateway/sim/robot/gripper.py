"""One simulated gripper: a force input becomes motor torque while the arm's command stream lives.

Rules (§4.4): the input 0..1 maps to feed-forward torque by a table, positive opens; the last valid input is kept;
100 ms after the arm's command stream ends the torque is cancelled; ending the gripper's own messages changes
nothing. The motor angle is 0 when closed (kinematics facts: stroke about 1 rad).

Choices: a pose that the arm's IK cannot solve is not passed on (§4.10), so it does not keep the stream of §4.4 alive; a
non-finite or out-of-range input is refused; the motor creeps at torque over a fixed damping; without
torque it stays where it is.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Final

import numpy as np

from gateway.sim.robot.journal import Journal
from gateway.sim.robot.manual import GRIPPER_TORQUE_NM, GRIPPER_WATCHDOG_NS, S, Side
from gateway.sim.robot.settings import SimSettings

__all__ = ["OPEN_RAD", "SimGripper", "torque_nm"]

OPEN_RAD: Final = 1.0
"""Motor angle fully open [rad] (published description)."""

_DAMPING_NMSPRAD: Final = 1.0  # 2 N·m open the gripper in half a second (choice)
_INPUTS: Final = tuple(row[0] for row in GRIPPER_TORQUE_NM)
_TORQUES: Final = tuple(row[1] for row in GRIPPER_TORQUE_NM)


@lru_cache(maxsize=256)  # an input is repeated at 50 Hz
def torque_nm(level_01: float) -> float:
    """Return the feed-forward motor torque of an input [N·m], positive opens (table of §4.4)."""
    return float(np.interp(level_01, _INPUTS, _TORQUES))


class SimGripper:
    """State and rules of one gripper.

    Attributes:
        angle_rad: Motor angle, 0 closed [rad].
        v_radps: Motor speed, positive opens [rad/s].
        effort_nm: Motor torque now [N·m].
        level_01: The last valid input, None before the first.
        object_rad: Angle at which the fingers meet an object when closing, None without one [rad].
        is_engaged: Whether the torque is applied.
    """

    def __init__(self, side: Side, settings: SimSettings, journal: Journal) -> None:
        self.side = side
        self.angle_rad = 0.5 * OPEN_RAD
        self.v_radps = 0.0
        self.level_01: float | None = None
        self._torque_nm = 0.0
        self.object_rad = settings.object_rad(side)
        self.is_engaged = False
        self._survives_pause = settings.grip_survives_pause
        self._journal = journal
        self._arm_ns: int | None = None

    def command(self, level_01: float, now_ns: int) -> bool:
        """Take a force input; return whether it was accepted.

        Args:
            level_01: Normalised force input.
            now_ns: Arrival [ns].
        """
        if not (math.isfinite(level_01) and 0.0 <= level_01 <= 1.0):
            self._journal.note(
                now_ns, "REFUSED_RANGE", f"{self.side.value} gripper cmd", f"{level_01} not in [0, 1] (§4.4)"
            )
            return False
        self.level_01 = level_01
        self._torque_nm = torque_nm(level_01)
        return True

    def arm_commanded(self, now_ns: int) -> None:
        """Note a valid command of the arm: its stream lives."""
        self._arm_ns = now_ns

    @property
    def deadline_ns(self) -> int | None:
        """When the torque is cancelled for want of arm commands [ns]: the first instant more than 100 ms after one."""
        return None if self._arm_ns is None else self._arm_ns + GRIPPER_WATCHDOG_NS + 1

    def expire(self, now_ns: int) -> None:
        """Cancel the torque when the deadline has passed."""
        deadline_ns = self.deadline_ns
        if deadline_ns is not None and now_ns >= deadline_ns:
            self._arm_ns = None
            if self.is_engaged:
                text = "arm stream silent for 0.1 s, torque cancelled (§4.4)"
                self._journal.note(now_ns, "GRIPPER_WATCHDOG", f"{self.side.value} gripper", text)

    def engage(self, *, is_started: bool, is_paused: bool, is_enabled: bool) -> None:
        """Decide whether the torque applies.

        Args:
            is_started: The state machine is in SLOW_START or READY.
            is_paused: It is in PAUSE.
            is_enabled: The arm is enabled and takes API commands.
        """
        lives = self._arm_ns is not None and is_enabled
        kept = self.is_engaged and is_paused and self._survives_pause
        self.is_engaged = lives and (is_started or kept)

    @property
    def effort_nm(self) -> float:
        """Motor torque now [N·m], positive opens."""
        return self._torque_nm if self.is_engaged else 0.0

    def place(self, angle_rad: float, v_radps: float) -> None:
        """Say where the motor got to [rad, rad/s]; instead of `move`, by whoever simulates forces."""
        self.angle_rad, self.v_radps = angle_rad, v_radps

    def move(self, duration_ns: int) -> None:
        """Let time pass: the motor turns under its torque until a stop or an object."""
        speed = self.effort_nm / _DAMPING_NMSPRAD
        if speed == 0.0:
            self.v_radps = 0.0
            return
        wanted = self.angle_rad + speed * duration_ns / S
        lowest = 0.0 if self.object_rad is None else min(self.object_rad, self.angle_rad)
        self.angle_rad = min(max(wanted, lowest), OPEN_RAD)
        self.v_radps = speed if self.angle_rad == wanted else 0.0
