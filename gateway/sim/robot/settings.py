"""What can be chosen about a simulated robot: model, modes, enabled parts, dynamics, noise, clock.

Everything has a default that makes a healthy standard robot in API mode with both arms enabled in joint mode.
"""

from __future__ import annotations

import re
from argparse import Namespace
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

from gateway.sim.robot.manual import MS, ArmMode, S, Side

__all__ = ["HANGING_RAD", "PHYSICS", "POSE_SILENCE", "SimSettings", "settings_of"]

PHYSICS: Final = ("kinematic", "mujoco")
"""How a robot can move: as lags and speeds, or with forces; the first is the default."""

POSE_SILENCE: Final = ("stops", "pursues")
"""What an arm in end-effector mode can do when poses cease; the first is the default."""

HANGING_RAD: Final = {
    Side.LEFT: (0.05, 1.35, -0.08, 0.55, 0.10, 0.06, -0.05),
    Side.RIGHT: (-0.05, -1.35, 0.08, -0.55, -0.10, -0.06, 0.05),
}
"""Where the arms hang when the robot starts [rad] (choice): inside §4.13, hands beside and a little before the hips.

The right arm is the mirror image of the left: every joint angle negated.
"""

_HOLDING_NM: Final = (3.0, -2.0, 0.5, 2.0, -0.3, -0.3, -0.2)
"""Torques that hold the left arm up, wherever it is [N·m] (choice); mirrored on the right. A round figure for the kinematic
robot; with `physics` the torques are those of the bodies."""
_NAMESPACE: Final = re.compile(r"/?[A-Za-z0-9_]+(/[A-Za-z0-9_]+)*")
_MODELS: Final = ("lite", "standard", "lift")
_MODES: Final = {"joint": ArmMode.JOINT, "pose": ArmMode.POSE}


@dataclass(frozen=True, slots=True, kw_only=True)
class SimSettings:
    """Settings of a simulated robot.

    Attributes:
        model: `lite`, `standard` or `lift` (§1.2); only `lift` has `/api/servo/cmd`.
        left_mode: `joint` or `pose`, the left arm's control mode (§2.3).
        right_mode: The same of the right arm.
        api_mode: API mode; False is VR mode (§2.3).
        enable_left_arm: Whether the left arm is enabled in the configuration (§2.3).
        enable_right_arm: The same of the right arm.
        enable_chassis: The same of the chassis.
        enable_lift_servo: The same of the lift; without effect on models that have none.
        enable_collision_check: Only reported in `/api/current_mode`.
        namespace: Of its bridge: put before every topic's key on the wire; empty for none.
        seed: Seed of the measurement noise.
        lag_s: Time constant of an arm following its target [s] (choice; §6.1 must arrive before the 0.15 s are over).
        brake_s: Time constant with which an arm comes to rest under a zero-velocity command [s] (choice).
        compliance_radpnm: How far a held joint stays below its target per N·m that gravity asks of its motor [rad/(N·m)].
            0: the servos carry gravity, as those of the vendor's MuJoCo example do, and stand on their targets. The manual
            does not say so (assumption), but §6.2 holds both arms by echoing what is measured: were that below the target
            by any constant, each echo would let the arm down by it once more.
        creep_radps: How fast an arm without position hold sinks under gravity [rad/s] (choice, §4.10).
        noise_rad: Standard deviation of the measured positions [rad].
        noise_radps: Standard deviation of the measured velocities [rad/s].
        state_period_ns: Period of the 200 Hz topics; longer ones make long runs in virtual time cheaper [ns].
        clock_offset_ns: How far the robot's clock is ahead of its host's wall clock at the start [ns].
        clock_drift_ppm: How much faster than it the robot's clock runs [ppm].
        physics: `kinematic`: each part follows as a lag or at a speed; `mujoco`: as a body with forces, contacts and
            things on a table (extra `sim`). Then what only the lag needs has no effect: `lag_s`, `brake_s`,
            `compliance_radpnm`, `creep_radps`.
        differs_percent: How far the arms of a robot with `physics` are from their published numbers [%]: masses and friction
            of each link and joint by half of it to all of it, drawn with `seed`; efforts are told with noise, a thousandth of
            the motor's greatest torque for each percent.
        left_object_rad: Motor angle at which the left gripper meets an object; None when empty [rad].
        right_object_rad: The same of the right gripper.
        start_rad: Where the arms are at the start, per side seven joints [rad].
        start_lowered_m: Where the lift is at the start, below its top [m].
        start_x_m: How far ahead of the scene's origin the robot stands at the start [m]; only with `physics`.
        grip_survives_pause: Whether the gripper keeps its torque in PAUSE while the arm's stream goes on. §4.4 ties the
            torque to that stream only, so the default is True; False is the careful reading of §4.1.
        gripper_zero_rad: What a closed gripper's motor angle is told as [rad]: 0 in §4.4.2, but §4.8 shows one of 1.13, beyond
            the stroke.
        pose_silence: What an arm in end-effector mode does when poses cease: `stops` as one in joint mode, at zero velocity
            after 0.15 s; `pursues` its last pose as long as the FSM lets it. The manual has that watchdog for joint commands
            alone (§4.3, §4.10); §4.2 says nothing.
        ready_needs_commands: Whether READY waits for a valid command of each enabled arm since the slow start began. The
            vendor's own simulator asks for one of both arms (§6.10); §6.1 becomes READY without any, so the default is False.
    """

    model: str = "standard"
    left_mode: str = "joint"
    right_mode: str = "joint"
    api_mode: bool = True
    enable_left_arm: bool = True
    enable_right_arm: bool = True
    enable_chassis: bool = True
    enable_lift_servo: bool = True
    enable_collision_check: bool = True
    namespace: str = ""
    seed: int = 0
    lag_s: float = 0.04
    brake_s: float = 0.02
    compliance_radpnm: float = 0.0
    creep_radps: float = 0.0
    noise_rad: float = 2e-4
    noise_radps: float = 2e-3
    state_period_ns: int = 5 * MS
    clock_offset_ns: int = 0
    clock_drift_ppm: float = 0.0
    physics: str = "kinematic"
    differs_percent: float = 0.0
    left_object_rad: float | None = None
    right_object_rad: float | None = None
    start_rad: Mapping[Side, tuple[float, ...]] = field(default_factory=lambda: HANGING_RAD)
    start_lowered_m: float = 0.30
    start_x_m: float = 0.0
    grip_survives_pause: bool = True
    gripper_zero_rad: float = 0.0
    pose_silence: str = "stops"
    ready_needs_commands: bool = False

    def __post_init__(self) -> None:
        """Refuse names and numbers that mean nothing."""
        if self.model not in _MODELS:
            raise ValueError(f"model {self.model!r} is not one of {', '.join(_MODELS)}")
        if self.physics not in PHYSICS:
            raise ValueError(f"physics {self.physics!r} is not one of {', '.join(PHYSICS)}")
        if not 0.0 <= self.differs_percent <= (0.0 if self.physics == "kinematic" else 30.0):
            raise ValueError(f"differs {self.differs_percent:g} % is outside [0, 30] %, and needs physics 'mujoco'")
        if self.pose_silence not in POSE_SILENCE:
            raise ValueError(f"pose_silence {self.pose_silence!r} is not one of {', '.join(POSE_SILENCE)}")
        for name in ("left_mode", "right_mode"):
            if getattr(self, name) not in _MODES:
                raise ValueError(f"{name} {getattr(self, name)!r} is not one of {', '.join(_MODES)}")
        if self.namespace and _NAMESPACE.fullmatch(self.namespace) is None:
            raise ValueError(f"namespace {self.namespace!r} is not made of words of letters, digits and _, joined by /")
        if not 0.0 <= self.compliance_radpnm <= 0.01:
            raise ValueError(f"compliance_radpnm {self.compliance_radpnm} is outside [0, 0.01] rad/(N·m)")
        if not abs(self.clock_drift_ppm) <= 1000.0:  # NaN compares false
            raise ValueError(f"clock_drift_ppm {self.clock_drift_ppm} is outside [-1000, 1000] ppm")
        if not (0.0 < self.lag_s <= 0.05 and 0.0 < self.brake_s <= 0.05):
            raise ValueError(f"lag_s {self.lag_s} and brake_s {self.brake_s} must lie in (0, 0.05] s")
        if self.state_period_ns < MS:
            raise ValueError(f"state_period_ns {self.state_period_ns} is below 1 ms")

    @property
    def has_lift(self) -> bool:
        """Whether this model has a lift (§1.2)."""
        return self.model == "lift"

    def arm_mode(self, side: Side) -> ArmMode:
        """Return the configured control mode of an arm."""
        return _MODES[self.left_mode if side is Side.LEFT else self.right_mode]

    def offers(self, topic: str) -> bool:
        """Return whether a topic is visible: those of a part that is switched off are not (§2.7.1)."""
        parts = {
            "/left_": self.enable_left_arm,
            "/right_": self.enable_right_arm,
            "/chassis/": self.enable_chassis,
            "/servo/": self.enable_lift_servo,
        }
        name = topic.removeprefix("/api")
        return all(is_on for begin, is_on in parts.items() if name.startswith(begin))

    def arm_enabled(self, side: Side) -> bool:
        """Return whether an arm is enabled in the configuration."""
        return self.enable_left_arm if side is Side.LEFT else self.enable_right_arm

    def object_rad(self, side: Side) -> float | None:
        """Return the motor angle at which a gripper meets an object, if there is one [rad]."""
        return self.left_object_rad if side is Side.LEFT else self.right_object_rad

    def holding_nm(self, side: Side) -> tuple[float, ...]:
        """Return the torques that hold an arm up, per joint [N·m]."""
        return _HOLDING_NM if side is Side.LEFT else tuple(-torque_nm for torque_nm in _HOLDING_NM)

    def sag_rad(self, side: Side) -> tuple[float, ...]:
        """Return how far from its target a held arm stays under gravity, per joint [rad]."""
        return tuple(-torque_nm * self.compliance_radpnm for torque_nm in self.holding_nm(side))


def settings_of(options: Namespace) -> SimSettings:
    """Return the settings that the command line asks for.

    Args:
        options: With model, mode, left_mode, right_mode, namespace, seed, physics, differs, clock_offset_s, clock_drift_ppm,
            gripper_zero_rad, pose_silence, ready_needs_commands and disable (names of disabled parts).

    Raises:
        ValueError: They mean nothing together.
    """
    return SimSettings(
        model=options.model,
        left_mode=options.left_mode or options.mode,
        right_mode=options.right_mode or options.mode,
        namespace=options.namespace,
        seed=options.seed,
        physics=options.physics,
        differs_percent=options.differs,
        clock_offset_ns=round(options.clock_offset_s * S),
        clock_drift_ppm=options.clock_drift_ppm,
        gripper_zero_rad=options.gripper_zero_rad,
        pose_silence=options.pose_silence,
        ready_needs_commands=options.ready_needs_commands,
        enable_left_arm="left_arm" not in options.disable,
        enable_right_arm="right_arm" not in options.disable,
        enable_chassis="chassis" not in options.disable,
        enable_lift_servo="lift_servo" not in options.disable,
    )
