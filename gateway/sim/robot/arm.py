"""One simulated arm: what it accepts, what it follows, where it is.

Rules: only `position` counts and only by index (§4.3, §4.10); fewer than seven values or NaN are refused; values
outside §4.13 are clipped silently; a gap of more than 0.15 s, an invalid IK result, PAUSE and ERROR put it under a
zero-velocity command, which is no position hold (§4.10). In SLOW_START the followed target approaches the commanded
one at 0.5 rad/s; in READY it is the commanded one. Each joint follows as a first-order lag, solved exactly for any
step, onto its target: the servos carry gravity (`SimSettings.compliance_radpnm` says why). Or `gateway.sim.physics` moves
it, by what `guide` says that the servos follow.

Choices, where the manual is silent: an infinite value is refused; of more than seven values the first seven count; a
zero or non-finite quaternion or position is an invalid IK input.

Knows nothing of the state machine, the heartbeat or messages' layout: the model tells it how it is driven.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from enum import Enum
from operator import le
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gateway.sim.robot.geometry import EePose, arm_geometry
from gateway.sim.robot.journal import Journal
from gateway.sim.robot.manual import ARM_WATCHDOG_NS, DOF, LOWER_RAD, SLOW_START_RADPS, UPPER_RAD, ArmMode, S, Side
from gateway.sim.robot.settings import SimSettings

__all__ = ["Drive", "SimArm"]

Array = NDArray[np.float64]

_REST_RADPS: Final = 1e-12
"""Slower than this an arm under a zero-velocity command counts as standing [rad/s]."""


class Drive(Enum):
    """How the motors are commanded."""

    STILL = "zero velocity"
    APPROACH = "slow start"
    FOLLOW = "follow"


class SimArm:
    """State and rules of one arm.

    Attributes:
        q_rad: True joint positions, shape (7,) [rad].
        v_radps: True joint velocities, shape (7,) [rad/s].
        target_rad: What it was last told to reach, clipped, or where it was when it was started [rad].
        is_enabled: Configuration switch of §2.3.
        mode: Control mode of §2.3.
        is_blocked: Something holds the arm mechanically (fault).
        has_ik: Whether the robot's IK works (fault).
        margin_rad: How much tighter than §4.13 this robot clips (fault), shape (7,) [rad].
        zero_rad: By how much the joints really are beyond the angles that are told and taken (fault), shape (7,) [rad].
        measured_offset_rad: Added to what the encoders say (fault), shape (7,) [rad].
        stuck: Joints of which what was told last is told again and again (fault): the stamp is that of the node which gathers
            two CAN lines, not of the motor's own sample (§4.1.1, §4.8), shape (7,).
        load_kg: What its hand holds (fault) [kg]; only where somebody simulates forces.
        effort_noise_nm: Standard deviation of what its motors' efforts are told with, shape (7,) [N·m].
        is_told: Whether a valid command has come since the slow start began.
        accepted: Number of valid commands so far.
        unsolved: Number of poses so far for which its IK found nothing.
        effort_nm: Torques of the motors, shape (7,) [N·m]; None unless somebody simulates forces.
    """

    def __init__(self, side: Side, settings: SimSettings, journal: Journal) -> None:
        self.side = side
        self.q_rad = np.array(settings.start_rad[side])
        self.v_radps = np.zeros(DOF)
        self.target_rad = self.q_rad.copy()
        self.is_enabled = settings.arm_enabled(side)
        self.mode = settings.arm_mode(side)
        self.is_blocked = False
        self.has_ik = True
        self.margin_rad = np.zeros(DOF)
        self.zero_rad = np.zeros(DOF)
        self.measured_offset_rad = np.zeros(DOF)
        self.stuck = np.zeros(DOF, dtype=bool)
        self.load_kg = 0.0
        self.effort_noise_nm = np.zeros(DOF)
        self.is_told = False
        self.accepted = 0
        self.unsolved = 0
        self.clips = 0
        self.stream_losses = 0
        self.effort_nm: Array | None = None
        self._journal = journal
        self._geometry = arm_geometry(side)
        self._lower, self._upper = LOWER_RAD[side], UPPER_RAD[side]
        self._sag = np.array(settings.sag_rad(side))
        self._creep = -np.sign(settings.holding_nm(side)) * settings.creep_radps
        self._creeps = settings.creep_radps != 0.0
        self._is_resting = False
        self._pursues = settings.pose_silence == "pursues"
        self._lag_s, self._brake_s = settings.lag_s, settings.brake_s
        self._reference = self.q_rad.copy()
        self.drive = Drive.STILL
        """How the motors are driven now."""
        self._last_ns: int | None = None
        self._is_protected = False

    # ------------------------------------------------------------------------------------------------------ commands

    def command_joints(self, position: Sequence[float], now_ns: int) -> bool:
        """Take a joint target; return whether it was accepted.

        Args:
            position: Target positions by index [rad]; names never reach this far (§4.10).
            now_ns: Arrival [ns].
        """
        subject = f"{self.side.value} arm joint_cmd"
        if len(position) < DOF:
            self._journal.note(now_ns, "REFUSED_SHORT", subject, f"{len(position)} values, {DOF} needed (§4.10)")
            return False
        if len(position) > DOF:
            self._journal.note(now_ns, "EXTRA_VALUES", subject, f"{len(position)} values, first {DOF} read")
        target = [float(value) for value in position[:DOF]]
        if not all(map(math.isfinite, target)):
            self._journal.note(now_ns, "REFUSED_NOT_FINITE", subject, f"{target} (§4.10)")
            return False
        clipped = target
        if self.margin_rad.any() or not (all(map(le, self._lower, target)) and all(map(le, target, self._upper))):
            clipped = [
                min(max(q, low + margin), high - margin)
                for q, low, high, margin in zip(target, self._lower, self._upper, self.margin_rad.tolist(), strict=True)
            ]
        if clipped != target:
            self.clips += 1
            worst = max(range(DOF), key=lambda index: abs(clipped[index] - target[index]))
            text = f"joint {worst + 1}: {target[worst]:.4f} rad cut to {clipped[worst]:.4f} (§4.13)"
            self._journal.note(now_ns, "CLIPPED", subject, text)
        self._accept(np.array(clipped), now_ns)
        return True

    def command_pose(self, pose: EePose, now_ns: int) -> bool:
        """Take an end-effector target; return whether the robot's own IK found joint angles for it (§4.2, §4.10).

        Args:
            pose: Target in the arm's shoulder frame.
            now_ns: Arrival [ns].
        """
        numbers = (*pose.position_m, *pose.quat_xyzw)
        solution = None
        if self.has_ik and all(map(math.isfinite, numbers)) and any(pose.quat_xyzw):
            start = self.target_rad if self.is_streamed else self.q_rad
            solution = self._geometry.inverse(pose, start + self.zero_rad)
        if solution is None:
            self.unsolved += 1
            self._is_protected = True
            self._last_ns = now_ns
            self._journal.note(now_ns, "IK_INVALID", f"{self.side.value} arm target_pose", f"{numbers} (§4.10)")
            return False
        self._accept(solution - self.zero_rad, now_ns)
        return True

    def _accept(self, target: Array, now_ns: int) -> None:
        self.target_rad = target
        self.is_told = True
        self.accepted += 1
        self._is_protected = False
        self._last_ns = now_ns

    # ------------------------------------------------------------------------------------------------------- stream

    @property
    def is_streamed(self) -> bool:
        """Whether commands count as coming: no gap of more than 0.15 s so far (§4.10), or the last pose is pursued."""
        return self._last_ns is not None

    @property
    def deadline_ns(self) -> int | None:
        """When the stream counts as interrupted [ns]: the first instant more than 0.15 s after the last command, if ever."""
        pursues = self._pursues and self.mode is ArmMode.POSE
        return None if self._last_ns is None or pursues else self._last_ns + ARM_WATCHDOG_NS + 1

    def expire(self, now_ns: int) -> None:
        """End the stream when its deadline has passed."""
        deadline_ns = self.deadline_ns
        if deadline_ns is not None and now_ns >= deadline_ns:
            self._last_ns = None
            self._is_protected = False
            self.stream_losses += 1
            self._journal.note(now_ns, "ARM_STREAM_LOST", f"{self.side.value} arm", "no command for 0.15 s (§4.10)")

    def drop_stream(self) -> None:
        """Forget the stream without a complaint: its mode or enabling has changed."""
        self._last_ns = None
        self._is_protected = False

    # ------------------------------------------------------------------------------------------------------- motion

    def start(self) -> None:
        """Begin a slow start: unless a stream already says where to, the target is the pose of this moment (§4.7)."""
        self.is_told = False
        self._reference = self.q_rad.copy()
        if not self.is_streamed or self._is_protected:
            self.target_rad = self.q_rad.copy()

    @property
    def deviation_rad(self) -> float:
        """Largest distance of a joint from the commanded target [rad]."""
        return float(np.max(np.abs(self.q_rad - self.target_rad)))

    def set_drive(self, wanted: Drive) -> None:
        """Drive the motors as wanted, or hold them at zero velocity when nothing valid is commanded."""
        can_follow = self.is_enabled and self.is_streamed and not self._is_protected and not self.is_blocked
        drive = wanted if can_follow else Drive.STILL
        if drive is Drive.APPROACH and self.drive is Drive.STILL:
            self._reference = self.q_rad.copy()
        self.drive = drive
        self._is_resting = self._is_resting and drive is Drive.STILL

    def guide(self, duration_ns: int) -> Array | None:
        """Let the motors follow for a time; return what they hold, shape (7,) [rad], None at zero velocity (§4.10)."""
        if self.drive is Drive.STILL:
            return None
        if self.drive is Drive.FOLLOW:
            self._reference = self.target_rad
        elif duration_ns:
            step = SLOW_START_RADPS * duration_ns / S
            self._reference = self._reference + np.clip(self.target_rad - self._reference, -step, step)
        return self._reference

    def place(self, q_rad: Array, v_radps: Array, effort_nm: Array) -> None:
        """Say where the arm got to; instead of `move`, by whoever simulates forces.

        Args:
            q_rad: Joint positions, shape (7,) [rad].
            v_radps: Joint velocities, shape (7,) [rad/s].
            effort_nm: Torques of the motors, shape (7,) [N·m].
        """
        self.q_rad, self.v_radps, self.effort_nm = q_rad, v_radps, effort_nm

    def move(self, duration_ns: int) -> None:
        """Let time pass under the present drive, exactly."""
        dt_s = duration_ns / S
        if self.drive is Drive.FOLLOW:
            self._reference = self.target_rad
            rest = self._reference + self._sag
            gap = (self.q_rad - rest) * math.exp(-dt_s / self._lag_s)
            self.q_rad = rest + gap
            self.v_radps = gap * (-1.0 / self._lag_s)
        elif self.drive is Drive.APPROACH:
            rest_s = self._approach(dt_s)
            rest = self._reference + self._sag
            gap = (self.q_rad - rest) * np.exp(-rest_s / self._lag_s)
            self.q_rad = rest + gap
            self.v_radps = np.where(rest_s > 0.0, -gap / self._lag_s, self.v_radps)
        elif not self._is_resting:
            decay = math.exp(-dt_s / self._brake_s)
            self.q_rad = self.q_rad + self.v_radps * (self._brake_s * (1.0 - decay)) + self._creep * dt_s
            self.v_radps = self.v_radps * decay
            self._is_resting = not self._creeps and float(np.max(np.abs(self.v_radps))) < _REST_RADPS

    def _approach(self, dt_s: float) -> Array:
        """Follow the reference of the slow start towards the target; return the time left after it got there [s]."""
        way = self.target_rad - self._reference
        ramp_s = np.minimum(np.abs(way) / SLOW_START_RADPS, dt_s)
        speed = np.sign(way) * SLOW_START_RADPS
        self._lag_behind_ramp(speed, ramp_s)
        self._reference = np.where(ramp_s < dt_s, self.target_rad, self._reference + speed * ramp_s)
        return np.asarray(dt_s - ramp_s)

    def _lag_behind_ramp(self, speed: Array, ramp_s: Array) -> None:
        """Follow a reference that moves at constant speed for `ramp_s`, per joint, from the present reference on."""
        decay = np.exp(-ramp_s / self._lag_s)
        begin = self._reference + self._sag
        behind = self.q_rad - begin + speed * self._lag_s
        self.q_rad = begin + speed * (ramp_s - self._lag_s) + behind * decay
        self.v_radps = speed - behind * decay / self._lag_s
