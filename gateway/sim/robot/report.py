"""What there is to tell about a simulated robot: the modes it publishes, its true state, what it saw of its users.

Reads the model and changes nothing. Everything returned is JSON-able, except `content`'s argument.
"""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

from pycdr2 import IdlStruct

from cdr_types.messages import geometry_msgs, sensor_msgs, std_msgs
from gateway.sim.robot.geometry import EePose
from gateway.sim.robot.manual import S, Side

if TYPE_CHECKING:
    from gateway.sim.robot.model import SimRobot

__all__ = ["content", "ee_pose", "mode_json", "sent_ns", "state", "stats"]


def mode_json(robot: SimRobot) -> str:
    """Return the content of `/api/current_mode`: compact JSON with the fields of §4.11.2."""
    left, right = robot.arms[Side.LEFT], robot.arms[Side.RIGHT]
    fields = {
        "meta_mode": int(robot.api_mode),
        "left_arm_control_mode": int(left.mode),
        "right_arm_control_mode": int(right.mode),
        "enable_left_arm": left.is_enabled,
        "enable_right_arm": right.is_enabled,
        "enable_chassis": robot.chassis.is_enabled,
        "enable_lift_servo": robot.lift is not None and robot.lift.is_configured,
        "enable_collision_check": robot.settings.enable_collision_check,
    }
    return json.dumps(fields, separators=(",", ":"))


def stats(robot: SimRobot) -> dict[str, object]:
    """Return what the robot saw of its users since the start or the last reset."""
    return {
        "now_ns": robot.now_ns,
        "commands": {topic: meter.as_dict(robot.now_ns) for topic, meter in robot.meters.items() if meter.count},
        "arms": {
            side.value: {
                "commanded": robot.setpoints[side].as_dict(),
                "moved": robot.motions[side].as_dict(),
                "accepted": arm.accepted,
                "clips": arm.clips,
                "stream_losses": arm.stream_losses,
            }
            for side, arm in robot.arms.items()
        },
        "counts": dict(robot.journal.counts),
        **_physics(robot.dynamics.pace()),
    }


def state(robot: SimRobot) -> dict[str, object]:
    """Return the true state of the robot; more than any topic tells."""
    lift = robot.lift
    return {
        "now_ns": robot.now_ns,
        "fsm": robot.fsm.published,
        "mode": json.loads(mode_json(robot)),
        "arms": {
            side.value: {
                "q_rad": arm.q_rad.tolist(),
                "v_radps": arm.v_radps.tolist(),
                "target_rad": arm.target_rad.tolist(),
                "drive": arm.drive.value,
                "is_streamed": arm.is_streamed,
            }
            for side, arm in robot.arms.items()
        },
        "grippers": {
            side.value: {"angle_rad": gripper.angle_rad, "level_01": gripper.level_01, "effort_nm": gripper.effort_nm}
            for side, gripper in robot.grippers.items()
        },
        "chassis": {"velocity": list(robot.chassis.velocity), "travel": list(robot.chassis.travel)},
        "lift": None
        if lift is None
        else {"lowered_m": lift.lowered_m, "motor_radps": lift.motor_radps, "is_powered": lift.is_powered},
        "faults": [fault.name for fault in robot.faults.active()],
        **_physics(robot.dynamics.report()),
    }


def _physics(told: dict[str, object] | None) -> dict[str, object]:
    return {} if told is None else {"physics": told}


def ee_pose(message: geometry_msgs.Pose) -> EePose:
    """Return the pose that a message holds."""
    p, o = message.position, message.orientation
    return EePose(position_m=(p.x, p.y, p.z), quat_xyzw=(o.x, o.y, o.z, o.w))


def content(message: IdlStruct) -> object:
    """Return the values of a command message."""
    if isinstance(message, sensor_msgs.JointState):
        return list(message.position)
    if isinstance(message, geometry_msgs.Pose):
        pose = ee_pose(message)
        return [*pose.position_m, *pose.quat_xyzw]
    if isinstance(message, std_msgs.Float32MultiArray):
        return list(message.data)
    return message.data if isinstance(message, std_msgs.Float32) else None


def sent_ns(message: IdlStruct) -> int | None:
    """Return when a command was sent, by its sender's clock [ns since 1970]; None where the type has no stamp."""
    if not isinstance(message, sensor_msgs.JointState):
        return None
    return message.header.stamp.sec * S + message.header.stamp.nanosec
