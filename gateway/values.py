"""Frozen domain values. A value that exists is well-formed: constructors refuse wrong shapes and non-finite numbers.

Units are in the names (rad, rad/s, N·m, m, ns); quaternions are xyzw with unit norm; left and right are `Side`.
Vectors are tuples. Nothing here knows zenoh, CDR, clocks or limits of this robot.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum, IntEnum

__all__ = [
    "ARM_DOF",
    "OWN_FSM",
    "ArmState",
    "CurrentMode",
    "EePose",
    "FsmState",
    "MotorState",
    "Role",
    "Side",
    "Space",
    "ValueRefused",
    "Vector",
    "require_finite",
]

Vector = tuple[float, ...]

ARM_DOF = 7
"""Joints per arm (manual §4.0.3)."""

QUAT_NORM_TOLERANCE = 0.05
"""A quaternion whose norm is further than this from 1 is refused; a nearer one is normalised."""


class ValueRefused(ValueError):
    """A value cannot be built: wrong length or not finite. The message says which element and why."""


class Side(str, Enum):
    """Left or right arm, gripper or wrist."""

    LEFT = "left"
    RIGHT = "right"

    def __str__(self) -> str:
        """Return `left` or `right`."""
        return self.value


class Role(str, Enum):
    """What a person may ask of the gateway. Each may do what those before may; everybody may stop."""

    VIEWER = "viewer"
    OPERATOR = "operator"
    ADMIN = "admin"

    def __str__(self) -> str:
        """Return the bare word."""
        return self.value


class Space(str, Enum):
    """What the setpoints of an arm are: joint positions, or poses of the end effector (manual §2.3, `current_mode`)."""

    JOINT = "joint"
    POSE = "pose"

    def __str__(self) -> str:
        """Return `joint` or `pose`."""
        return self.value


class FsmState(IntEnum):
    """Values of `/fsm_state` (manual §4.11.1)."""

    ERROR = -1
    PAUSE = 0
    SLOW_START = 1
    READY = 2
    LEFT_ARM_ONLY = 3
    RIGHT_ARM_ONLY = 4
    PLAY_READY = 5
    PLAY = 6

    def __str__(self) -> str:
        """Return the number, as every Python from 3.11 on does."""
        return str(self.value)


OWN_FSM = frozenset({FsmState.ERROR, FsmState.PAUSE, FsmState.SLOW_START, FsmState.READY})
"""Values that an API program meets; the others belong to VR and playback (manual §4.11.1), or to nobody we know."""


def require_finite(name: str, values: Vector, length: int) -> None:
    """Refuse a vector of another length or with an element that is NaN or infinite.

    Args:
        name: How the vector is called in the message.
        values: Any floats.
        length: Number of elements demanded.

    Raises:
        ValueRefused: With the element and its value.
    """
    if len(values) != length:
        raise ValueRefused(f"{name} has {len(values)} values, {length} are needed")
    if math.isfinite(sum(values)):  # one call instead of one for each; a sum that is not may still be an overflow
        return
    for index, value in enumerate(values):
        if not math.isfinite(value):
            raise ValueRefused(f"{name}[{index}] is {value}, a finite number is needed")


@dataclass(frozen=True, slots=True, kw_only=True)
class MotorState:
    """Measured state of a group of motors: `/x/joint_states` of arm, gripper or chassis (manual §4.8).

    Attributes:
        q_rad: Positions [rad].
        dq_radps: Velocities [rad/s]; empty when the robot sent none.
        tau_nm: Torques [N·m]; empty when the robot sent none.
        stamp_ns: Publish time on the robot's clock [ns]; not the motors' sample time (manual §4.1.1).
    """

    q_rad: Vector
    dq_radps: Vector
    tau_nm: Vector
    stamp_ns: int

    def __post_init__(self) -> None:
        """Refuse wrong shapes and non-finite numbers."""
        length = len(self.q_rad)
        if length == 0:
            raise ValueRefused("position has 0 values, at least 1 is needed")
        require_finite("position", self.q_rad, length)
        require_finite("velocity", self.dq_radps, length if self.dq_radps else 0)
        require_finite("effort", self.tau_nm, length if self.tau_nm else 0)


@dataclass(frozen=True, slots=True, kw_only=True)
class ArmState(MotorState):
    """Measured state of one arm: seven joints in the order of manual §4.0.3."""

    def __post_init__(self) -> None:
        """Refuse anything but seven finite joints."""
        require_finite("position", self.q_rad, ARM_DOF)
        MotorState.__post_init__(self)


@dataclass(frozen=True, slots=True, kw_only=True)
class EePose:
    """Pose of an arm's end effector in that arm's shoulder frame (manual §4.0.2).

    Attributes:
        p_m: Position [m], shape (3,).
        quat_xyzw: Orientation, unit norm (normalised here when within 5 %).
    """

    p_m: Vector
    quat_xyzw: Vector

    def __post_init__(self) -> None:
        """Check shapes, finiteness and norm; store the quaternion with unit norm."""
        require_finite("position", self.p_m, 3)
        require_finite("orientation", self.quat_xyzw, 4)
        norm = math.sqrt(sum(c * c for c in self.quat_xyzw))
        if abs(norm - 1.0) > QUAT_NORM_TOLERANCE:
            raise ValueRefused(f"orientation has norm {norm:.4f}, 1 is needed (xyzw)")
        object.__setattr__(self, "quat_xyzw", tuple(c / norm for c in self.quat_xyzw))

    @property
    def values(self) -> Vector:
        """Position, then orientation: x, y, z [m], qx, qy, qz, qw; shape (7,)."""
        return *self.p_m, *self.quat_xyzw


@dataclass(frozen=True, slots=True, kw_only=True)
class CurrentMode:
    """Mode and enabled parts from `/api/current_mode` (manual §4.11.2).

    Attributes:
        api: True in API mode, False in VR mode.
        joint_mode: Per side, True for joint control, False for end-effector control.
        arm_enabled: Per side.
        chassis_enabled: Whether the chassis is enabled in the system configuration.
        lift_enabled: Whether the lift servo is enabled in the system configuration.
        collision_check: Whether the robot's own collision check is configured.
    """

    api: bool
    joint_mode: dict[Side, bool]
    arm_enabled: dict[Side, bool]
    chassis_enabled: bool
    lift_enabled: bool
    collision_check: bool

    def space(self, side: Side) -> Space:
        """Return what an arm takes setpoints in."""
        return Space.JOINT if self.joint_mode[side] else Space.POSE

    @property
    def enabled_arms(self) -> tuple[Side, ...]:
        """Sides whose arm is enabled, left first."""
        return tuple(side for side in Side if self.arm_enabled[side])

    @property
    def is_posing(self) -> bool:
        """Whether an enabled arm is in end-effector mode."""
        return any([not self.joint_mode[side] for side, is_enabled in self.arm_enabled.items() if is_enabled])
