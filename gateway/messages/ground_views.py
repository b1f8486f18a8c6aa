"""What the outside may see of grippers, chassis and lift. Part of the snapshot; import these names from `snapshot.py`."""

from __future__ import annotations

from msgspec import Struct

from gateway.values import Vector

__all__ = ["ChassisView", "GripView", "LiftView"]


class GripView(Struct, frozen=True, kw_only=True):
    """What a gripper is told, and an estimate of what comes of it.

    Attributes:
        streaming: Whether it is being sent anything: exactly while its arm is.
        input_ratio: Its force input, 0 (opens most) to 1 (closes most); None while off.
        torque_nm: The feed-forward torque of that input [N·m], positive opens (manual §4.4); None while off.
        holding: An estimate whether it holds something (`core/supervision/grip.py` says how); None when nobody can tell.
    """

    streaming: bool
    input_ratio: float | None
    torque_nm: float | None
    holding: bool | None


class ChassisView(Struct, frozen=True, kw_only=True):
    """What the chassis is told. What it does, nobody measures: there is no odometry (manual §4.12).

    Attributes:
        driven: Whether an owner's velocity is being sent, or ramped down.
        drive_id: Number of the latest drive; 0 before the first. `code`: why it ended; empty while it may go on.
        wanted_mps: What the owner asked for last: vx, vy [m/s]; `wanted_radps` around z [rad/s].
        commanded_mps: What was sent last, on its ramp: vx, vy [m/s]; `commanded_radps` around z [rad/s].
        left_ns: How long the wanted velocity still counts [ns]; None when none does.
    """

    driven: bool
    drive_id: int
    code: str
    wanted_mps: Vector
    wanted_radps: float
    commanded_mps: Vector
    commanded_radps: float
    left_ns: int | None


class LiftView(Struct, frozen=True, kw_only=True):
    """What the lift is told. Where it is, nobody knows: the robot publishes no position of it (manual §4.12).

    Attributes:
        driven: Whether an owner's velocity is being sent.
        drive_id: Number of the latest drive; 0 before the first. `code`: why it ended; empty while it may go on.
        velocity_ratio: What is sent: -1 (down) to 1 (up), a part of full speed.
        servo_on: Whether the servo was asked to stay on, and not to be off since.
        left_ns: How long the velocity still counts [ns]; None when none does.
    """

    driven: bool
    drive_id: int
    code: str
    velocity_ratio: float
    servo_on: bool
    left_ns: int | None
