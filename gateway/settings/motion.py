"""Settings of the groups that move: limits, rates and tolerances. Frozen, and inside the hard limits of `robot/limits.py`."""

from __future__ import annotations

from collections.abc import Mapping

from msgspec import Struct, field

from gateway.robot.limits import (
    CHASSIS_DOWN_MPS2,
    CHASSIS_UP_MPS2,
    HARD_A_RADPS2,
    HARD_CHASSIS_V_MPS,
    HARD_CHASSIS_W_RADPS,
    HARD_J_RADPS3,
    HARD_POSE_A_MPS2,
    HARD_POSE_DDW_RADPS3,
    HARD_POSE_DW_RADPS2,
    HARD_POSE_J_MPS3,
    HARD_POSE_V_MPS,
    HARD_POSE_W_RADPS,
    HARD_V_RADPS,
    JOINT_LOWER_RAD,
    JOINT_UPPER_RAD,
    MAX_ARM_LEN_M,
)
from gateway.settings.bounds import HARD, MS, OURS, S, SettingsRefused, within
from gateway.values import ARM_DOF, Side, Vector

__all__ = ["ArmSettings", "ChassisSettings", "LiftSettings", "PoseSettings"]


class ArmSettings(Struct, frozen=True, kw_only=True):
    """Limits and tolerances of both arms in joint mode.

    Attributes:
        v_radps: Velocity limit of every joint [rad/s].
        a_radps2: Acceleration limit of every joint [rad/s²].
        j_radps3: Jerk limit of every joint [rad/s³].
        lower_rad: Lower position limit per side, shape (7,) [rad]; inside manual §4.13.
        upper_rad: Upper position limit per side, shape (7,) [rad]; inside manual §4.13.
        rate_hz: Rate of the joint stream [Hz].
        settle_rad: A move is reached when every joint is measured within this of the goal [rad] (§6.6).
        settle_ns: ... for this long [ns].
        settle_timeout_ns: A move that has not settled this long after its path ended is aborted [ns].
        tracking_rad: Distance between reference and measured that aborts [rad].
        tracking_ns: ... when it lasts this long [ns].
        target_expiry_ns: A streamed target lives this long without a successor [ns].
        start_margin_rad: A start this far outside a position limit is moved to the limit [rad].
    """

    v_radps: float = 1.0
    a_radps2: float = 3.0
    j_radps3: float = 20.0
    lower_rad: Mapping[Side, Vector] = field(default_factory=lambda: dict(JOINT_LOWER_RAD))
    upper_rad: Mapping[Side, Vector] = field(default_factory=lambda: dict(JOINT_UPPER_RAD))
    rate_hz: float = 100.0
    settle_rad: float = 0.05
    settle_ns: int = 500 * MS
    settle_timeout_ns: int = 5 * S
    tracking_rad: float = 0.3
    tracking_ns: int = 300 * MS
    target_expiry_ns: int = 1500 * MS
    start_margin_rad: float = 0.05

    def __post_init__(self) -> None:
        """Refuse limits looser than the robot's."""
        within("arm.v_radps", self.v_radps, 1e-3, HARD_V_RADPS, "rad/s", HARD)
        within("arm.a_radps2", self.a_radps2, 1e-3, HARD_A_RADPS2, "rad/s²", HARD)
        within("arm.j_radps3", self.j_radps3, 1e-2, HARD_J_RADPS3, "rad/s³", HARD)
        within("arm.rate_hz", self.rate_hz, 50.0, 200.0, "Hz", "manual §4.3: 50 Hz or more")
        within("arm.settle_rad", self.settle_rad, 1e-4, 0.2, "rad", "manual §6.6: 0.05")
        within("arm.settle_ns", self.settle_ns, 0, 5 * S, "ns", OURS)
        within("arm.settle_timeout_ns", self.settle_timeout_ns, 100 * MS, 60 * S, "ns", OURS)
        within("arm.tracking_rad", self.tracking_rad, 0.02, 0.5, "rad", HARD)
        within("arm.tracking_ns", self.tracking_ns, 20 * MS, 1 * S, "ns", OURS)
        within("arm.target_expiry_ns", self.target_expiry_ns, 50 * MS, 3 * S, "ns", HARD)
        within("arm.start_margin_rad", self.start_margin_rad, 0.0, 0.05, "rad", HARD)
        for side in Side:
            self._check_positions(side)

    def _check_positions(self, side: Side) -> None:
        bounds = {"lower_rad": self.lower_rad.get(side, ()), "upper_rad": self.upper_rad.get(side, ())}
        for name, values in bounds.items():
            if len(values) != ARM_DOF:
                rule = f"values: {ARM_DOF} are needed, in the order of manual §4.0.3"
                raise SettingsRefused(f"arm.{name}.{side}", len(values), rule=rule)
            for n, value in enumerate(values):
                hard = (JOINT_LOWER_RAD[side][n], JOINT_UPPER_RAD[side][n])
                within(f"arm.{name}.{side}[{n}]", value, *hard, "rad", f"{side} arm joint {n + 1}, manual §4.13")
        for n, (lower, upper) in enumerate(zip(bounds["lower_rad"], bounds["upper_rad"], strict=True)):
            if lower >= upper:
                rule = f"is not below the upper limit of {side} arm joint {n + 1}, {upper:g} rad"
                raise SettingsRefused(f"arm.lower_rad.{side}[{n}]", lower, unit="rad", rule=rule)


class ChassisSettings(Struct, frozen=True, kw_only=True):
    """Limits of the chassis. The robot itself limits its acceleration only (manual §4.5).

    Attributes:
        v_mps: Fastest speed over the ground, whatever its direction [m/s].
        w_radps: Fastest turning [rad/s].
        up_mps2: Acceleration of each component while it grows [m/s²; rad/s² for the turning].
        down_mps2: Deceleration while it shrinks [m/s²; rad/s²].
        j_mps3: Jerk of each component [m/s³; rad/s³].
        expiry_ns: A velocity lives this long without a successor [ns]; then the chassis ramps down.
    """

    v_mps: float = 0.3
    w_radps: float = 0.5
    up_mps2: float = CHASSIS_UP_MPS2
    down_mps2: float = CHASSIS_DOWN_MPS2
    j_mps3: float = 2.0
    expiry_ns: int = 300 * MS

    def __post_init__(self) -> None:
        """Refuse speeds and ramps that are looser than the robot's."""
        within("chassis.v_mps", self.v_mps, 0.01, HARD_CHASSIS_V_MPS, "m/s", HARD)
        within("chassis.w_radps", self.w_radps, 0.01, HARD_CHASSIS_W_RADPS, "rad/s", HARD)
        within("chassis.up_mps2", self.up_mps2, 0.01, CHASSIS_UP_MPS2, "m/s²", "manual §4.5")
        within("chassis.down_mps2", self.down_mps2, 0.01, CHASSIS_DOWN_MPS2, "m/s²", "manual §4.5")
        within("chassis.j_mps3", self.j_mps3, 0.1, 100.0, "m/s³", OURS)
        within("chassis.expiry_ns", self.expiry_ns, 50 * MS, 3 * S, "ns", HARD)


class LiftSettings(Struct, frozen=True, kw_only=True):
    """Limits of the lift, on the model that has one (manual §4.6).

    Attributes:
        v_max: Fastest velocity up or down, as a part of the servo's 150 rad/s; no unit.
        expiry_ns: A velocity lives this long without a successor [ns]; then the lift stops.
    """

    v_max: float = 1.0
    expiry_ns: int = 300 * MS

    def __post_init__(self) -> None:
        """Refuse what the servo does not have."""
        within("lift.v_max", self.v_max, 0.01, 1.0, "", "manual §4.6")
        within("lift.expiry_ns", self.expiry_ns, 50 * MS, 3 * S, "ns", HARD)


class PoseSettings(Struct, frozen=True, kw_only=True):
    """Limits and tolerances of both arms in end-effector mode; limits are norms. Times are those of `ArmSettings`.

    The defaults reach full speed in about half a second, as a joint with its defaults does: v/a + a/j, with the part of
    1/√3 of a and j that one direction gets.

    Attributes:
        rate_hz: Rate of the pose stream [Hz] (§4.2).
        v_mps: Linear velocity limit [m/s].
        a_mps2: Linear acceleration limit [m/s²].
        j_mps3: Linear jerk limit [m/s³].
        w_radps: Angular velocity limit [rad/s].
        dw_radps2: Angular acceleration limit [rad/s²].
        ddw_radps3: Angular jerk limit [rad/s³].
        reach_m: Greatest distance of the end effector from the shoulder [m] (§4.0.4).
        settle_m: A move is reached when the position is measured within this of the goal [m] ...
        settle_rad: ... and the orientation within this [rad].
        tracking_m: Distance between reference and measured pose that aborts [m] ...
        tracking_rad: ... or angle between them [rad].
        start_margin_m: A start this far beyond the reach is moved to its end [m].
    """

    rate_hz: float = 70.0
    v_mps: float = 0.25
    a_mps2: float = 1.5
    j_mps3: float = 10.0
    w_radps: float = 0.8
    dw_radps2: float = 5.0
    ddw_radps3: float = 30.0
    reach_m: float = MAX_ARM_LEN_M
    settle_m: float = 0.005
    settle_rad: float = 0.05
    tracking_m: float = 0.06
    tracking_rad: float = 0.3
    start_margin_m: float = 0.01

    def __post_init__(self) -> None:
        """Refuse limits looser than the hard ones, or too weak for a turn about a changing axis."""
        within("pose.rate_hz", self.rate_hz, 50.0, 77.0, "Hz", "manual §4.2: 50 to 77 Hz")
        within("pose.v_mps", self.v_mps, 1e-3, HARD_POSE_V_MPS, "m/s", HARD)
        within("pose.a_mps2", self.a_mps2, 1e-2, HARD_POSE_A_MPS2, "m/s²", HARD)
        within("pose.j_mps3", self.j_mps3, 1e-1, HARD_POSE_J_MPS3, "m/s³", HARD)
        within("pose.w_radps", self.w_radps, 1e-2, HARD_POSE_W_RADPS, "rad/s", HARD)
        curved = "a turn about a changing axis takes w², and w·dw of jerk"
        within("pose.dw_radps2", self.dw_radps2, self.w_radps**2, HARD_POSE_DW_RADPS2, "rad/s²", curved)
        least = self.w_radps * self.dw_radps2
        within("pose.ddw_radps3", self.ddw_radps3, least, HARD_POSE_DDW_RADPS3, "rad/s³", curved)
        within("pose.reach_m", self.reach_m, 0.1, MAX_ARM_LEN_M, "m", "manual §4.0.4")
        within("pose.settle_m", self.settle_m, 1e-4, 0.05, "m", OURS)
        within("pose.settle_rad", self.settle_rad, 1e-4, 0.2, "rad", OURS)
        within("pose.tracking_m", self.tracking_m, 0.005, 0.1, "m", HARD)
        within("pose.tracking_rad", self.tracking_rad, 0.02, 0.5, "rad", HARD)
        within("pose.start_margin_m", self.start_margin_m, 0.0, 0.01, "m", HARD)
