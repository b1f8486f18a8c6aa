"""What a daemon says about itself and its ways to the robot when it is asked, as structs.

Tolerant, as all that comes out: a later daemon may add fields. Import these names from
`gateway.api.protocol`.
"""

from __future__ import annotations

from msgspec import Struct

from gateway.messages.wire import Wire

__all__ = ["Info", "Routes"]


class Routes(Struct, frozen=True, kw_only=True):
    """How the robot's bridge stands to each topic, as discovery knows it: the answer to a query on the routes key.

    Attributes:
        routes: Per topic of this model, a few words: `ready`, or what is missing.
        bridge_version: Version of the robot's bridge; empty until it has said it.
        undelivered: Frames that were not handed to zenoh because there was no transport.
        wire: Everything that is known of the wire; null when the daemon is of an earlier release.
    """

    routes: dict[str, str]
    bridge_version: str
    undelivered: int
    wire: Wire | None = None


class Info(Struct, frozen=True, kw_only=True):
    """What does not change while a daemon runs: the answer to a query on the info key.

    Attributes:
        version: Release of the daemon.
        protocol: `PROTOCOL_VERSION` of the daemon.
        pid: Process id of the daemon.
        socket: Path of its unix socket.
        robot: Endpoint of the robot's router.
        namespace: Namespace of its bridge; empty for none.
        model: `lite`, `standard` or `lift` (manual §1.2).
        has_lift: Whether this model has the lift.
        config_hash: Changes with any setting.
        joint_names: Per side, the seven joints in their order (manual §4.0.3).
        lower_rad: Per side, the configured lower position limits [rad].
        upper_rad: Per side, the configured upper position limits [rad].
        v_radps: Velocity limit of every joint [rad/s].
        a_radps2: Acceleration limit [rad/s²].
        j_radps3: Jerk limit [rad/s³].
        arm_rate_hz: Rate of the joint stream to the robot [Hz].
        snapshot_hz: Rate of published snapshots [Hz].
        settle_rad: Default tolerance of a move [rad].
        settle_ns: How long a move must stay within it [ns].
        tracking_rad: Distance between setpoint and measured that aborts when it lasts [rad].
        pose_rate_hz: Rate of the pose stream to the robot [Hz].
        pose_v_mps: Linear velocity limit of an end effector [m/s].
        pose_w_radps: Angular velocity limit [rad/s].
        reach_m: Greatest distance of an end effector from its shoulder [m].
        settle_pose_m: Default tolerance of a pose motion's position [m].
        settle_pose_rad: Default tolerance of its orientation [rad].
        tracking_pose_m: Distance between setpoint and measured pose that aborts when it lasts [m].
        tracking_pose_rad: Angle between them that aborts [rad].
        target_expiry_ns: Default life of a streamed target [ns].
        chassis_v_mps: Fastest speed of the chassis over the ground [m/s].
        chassis_w_radps: Its fastest turning [rad/s].
        chassis_expiry_ns: Default life of a velocity of the chassis [ns].
        lift_v_max: Fastest velocity of the lift, as a part of full speed.
        lift_expiry_ns: Default life of a velocity of the lift [ns].
        keepalive_ns: Silence after which an owner counts as lost [ns].
        free_after_ns: The lease is free this long after the loss [ns].
        down_after_ns: Everything goes down this long after the loss [ns].
    """

    version: str
    protocol: int
    pid: int
    socket: str
    robot: str
    namespace: str = ""
    model: str
    has_lift: bool
    config_hash: str
    joint_names: dict[str, tuple[str, ...]]
    lower_rad: dict[str, tuple[float, ...]]
    upper_rad: dict[str, tuple[float, ...]]
    v_radps: float
    a_radps2: float
    j_radps3: float
    arm_rate_hz: float
    snapshot_hz: float
    settle_rad: float
    settle_ns: int
    tracking_rad: float
    pose_rate_hz: float
    pose_v_mps: float
    pose_w_radps: float
    reach_m: float
    settle_pose_m: float
    settle_pose_rad: float
    tracking_pose_m: float
    tracking_pose_rad: float
    target_expiry_ns: int
    chassis_v_mps: float
    chassis_w_radps: float
    chassis_expiry_ns: int
    lift_v_max: float
    lift_expiry_ns: int
    keepalive_ns: int
    free_after_ns: int
    down_after_ns: int
