"""Domain values <-> the robot's messages <-> bytes. Every quirk of this robot is translated here and nowhere else.

Rules on the way in: a sample is believed whole or not at all. Arrays have the documented length, names included; joint
names are those of manual §4.0.3 in that order (the robot itself never looks at names and never reorders, so as many
other names mean another robot: JOINT_ORDER); numbers are finite; orientations have unit norm; the mode's JSON has
every documented key. Anything else is a `BadSample` with its code.

Rules on the way out: the robot and its bridge check nothing (manual §4.10; wire.md 3.2), so a frame has exactly the
documented number of finite values and its payload exactly the documented length, or `BadFrame` is raised.
Joint commands carry names, and zeros as velocity and effort, as the manual's programs send them (§6.5); the robot
ignores all three (§4.3).

Message-level twins (`from_message`, `to_message`) serve whoever has messages already. Hot payloads have a shorter way with
the same results (`shortcuts`). Pure: no zenoh, no clock.
"""

from __future__ import annotations

import json
import math
import reprlib
from collections.abc import Callable, Mapping
from typing import Final, cast

from pycdr2 import IdlStruct

from cdr_types import CdrError, decode, encode, message_type
from cdr_types.messages import builtin_interfaces, geometry_msgs, sensor_msgs, std_msgs
from gateway.core.messages.events import StateValue
from gateway.errors import Code
from gateway.link.shortcuts import JointWriter, MotorReader, read_pose
from gateway.robot.topics import (
    COMMAND_TOPICS,
    FLOAT32,
    FLOAT32_ARRAY,
    INT32,
    JOINT_STATE,
    POSE,
    STATE_TOPICS,
    STRING,
    TOPICS,
    Topic,
    arm_state,
)
from gateway.values import ArmState, CurrentMode, EePose, MotorState, Side, ValueRefused, Vector

__all__ = [
    "FRAME_BYTES",
    "MAX_MODE_CHARACTERS",
    "BadFrame",
    "BadSample",
    "decode_sample",
    "encode_frame",
    "from_message",
    "stamp_of",
    "to_message",
]

S = 1_000_000_000

MAX_MODE_CHARACTERS = 16_384
"""Longest `/api/current_mode` that is parsed; the documented one has about 250 characters."""
MAX_SAMPLE_BYTES: Final = {STRING: 4 * MAX_MODE_CHARACTERS + 64}
MAX_OTHER_BYTES: Final = 4096
"""Longest payloads that are read, by type, and of every other type; the robot's have some 400. A megabyte of empty names, from
whoever reaches its port, would be read for a second, in the loop."""

_COMMAND_ROWS: Final = {name: TOPICS[name] for name in COMMAND_TOPICS}
_ARM_TOPICS: Final = frozenset(arm_state(side) for side in Side)
_NAMES: Final = {name: list(row.names) for name, row in TOPICS.items()}


_Read = Callable[[Topic, IdlStruct], StateValue]


class BadSample(ValueError):
    """A sample that cannot be believed.

    Args:
        code: JOINT_ORDER when as many names as needed are others than manual §4.0.3 has, else SAMPLE_REFUSED.
        message: What was found, what was expected, and where the manual says so.
    """

    def __init__(self, code: Code, message: str) -> None:
        super().__init__(code, message)
        self.code = code
        self.message = message

    def __str__(self) -> str:
        """Return the message."""
        return self.message


class BadFrame(ValueError):
    """A frame that must not reach the robot: unknown topic, wrong number of values, not finite, wrong size.

    The gate lets none through; this is the last look.
    """


# ------------------------------------------------------------------------------------------------------ from the robot


def decode_sample(topic: str, payload: bytes) -> StateValue:
    """Return the value in a payload.

    Args:
        topic: ROS name of a state topic.
        payload: As it came from zenoh, encapsulation header included.

    Raises:
        BadSample: If it cannot be believed.
    """
    motors = _MOTORS.get(topic)
    value: StateValue | None = None
    if motors is not None:
        value = motors.read(payload)
    elif topic in _POSES:
        value = read_pose(payload)
    if value is not None:
        return value
    row, cls, read = _reader_of(topic)
    most = MAX_SAMPLE_BYTES.get(row.type_name, MAX_OTHER_BYTES)
    if len(payload) > most:
        raise BadSample(Code.SAMPLE_REFUSED, f"{len(payload)} bytes of a {row.type_name}, at most {most} are read")
    try:
        message = decode(payload, cls)
    except CdrError as error:
        raise BadSample(Code.SAMPLE_REFUSED, f"{len(payload)} bytes are no {row.type_name}: {error}") from error
    value = read(row, message)
    if motors is not None and isinstance(value, MotorState):
        motors.learn(payload, value)
    return value


def from_message(topic: str, message: IdlStruct) -> StateValue:
    """Return the value in a message.

    Raises:
        BadSample: If it cannot be believed.
    """
    row, cls, read = _reader_of(topic)
    if not isinstance(message, cls):
        raise BadSample(Code.SAMPLE_REFUSED, f"{topic} carries {row.type_name}, not {type(message).__name__}")
    return read(row, message)


def stamp_of(value: StateValue) -> int | None:
    """Return the robot's publish time of a value [ns of the robot's clock], or None where the type has none (§4.8)."""
    return value.stamp_ns if isinstance(value, MotorState) else None


def _reader_of(topic: str) -> tuple[Topic, type[IdlStruct], _Read]:
    reader = _READER_OF.get(topic)
    if reader is None:
        raise BadSample(Code.SAMPLE_REFUSED, f"{topic!r} is no state topic of this robot (manual §4.8, §4.11)")
    return reader


def _read_motors(row: Topic, message: IdlStruct) -> MotorState:
    joints = cast("sensor_msgs.JointState", message)
    for what, length in (("name", len(joints.name)), ("position", len(joints.position))):
        if length != row.width:
            raise BadSample(Code.SAMPLE_REFUSED, f"{what} has {length} entries, {row.width} are needed (manual §4.8)")
    if joints.name != _NAMES[row.name]:
        raise BadSample(
            Code.JOINT_ORDER, f"names are {reprlib.repr(joints.name)}, not {', '.join(row.names)} (manual §4.0.3)"
        )
    stamp = joints.header.stamp
    if not 0 <= stamp.nanosec < S:
        raise BadSample(Code.SAMPLE_REFUSED, f"header.stamp.nanosec is {stamp.nanosec}, below {S} is needed")
    try:
        return _motor_type(row.name)(
            q_rad=tuple(joints.position),
            dq_radps=tuple(joints.velocity),
            tau_nm=tuple(joints.effort),
            stamp_ns=stamp.sec * S + stamp.nanosec,
        )
    except ValueRefused as error:
        raise BadSample(Code.SAMPLE_REFUSED, f"{error} (manual §4.8)") from error


def _motor_type(topic: str) -> type[MotorState]:
    return ArmState if topic in _ARM_TOPICS else MotorState


def _read_pose(row: Topic, message: IdlStruct) -> EePose:
    pose = cast("geometry_msgs.Pose", message)
    p, q = pose.position, pose.orientation
    try:
        return EePose(p_m=(p.x, p.y, p.z), quat_xyzw=(q.x, q.y, q.z, q.w))
    except ValueRefused as error:
        raise BadSample(Code.SAMPLE_REFUSED, f"{error} (manual {row.section})") from error


def _read_fsm(_row: Topic, message: IdlStruct) -> int:
    return int(cast("std_msgs.Int32", message).data)


def _read_mode(_row: Topic, message: IdlStruct) -> CurrentMode:
    text = cast("std_msgs.String", message).data
    if len(text) > MAX_MODE_CHARACTERS:
        raise BadSample(
            Code.SAMPLE_REFUSED, f"{len(text)} characters of JSON, at most {MAX_MODE_CHARACTERS} are read (§4.11.2)"
        )
    try:
        fields = json.loads(text)
    except (ValueError, RecursionError) as error:  # RecursionError: brackets in brackets
        raise BadSample(Code.SAMPLE_REFUSED, f"not JSON: {error} (manual §4.11.2)") from error
    if not isinstance(fields, dict):
        raise BadSample(Code.SAMPLE_REFUSED, f"JSON holds a {type(fields).__name__}, not an object (manual §4.11.2)")
    return CurrentMode(
        api=_flag(fields, "meta_mode"),
        joint_mode={side: _flag(fields, f"{side}_arm_control_mode") for side in Side},
        arm_enabled={side: _flag(fields, f"enable_{side}_arm") for side in Side},
        chassis_enabled=_flag(fields, "enable_chassis"),
        lift_enabled=_flag(fields, "enable_lift_servo"),
        collision_check=_flag(fields, "enable_collision_check"),
    )


def _flag(fields: Mapping[str, object], key: str) -> bool:
    """Return a field that the robot may write as 0, 1, false or true."""
    if key not in fields:
        raise BadSample(Code.SAMPLE_REFUSED, f"key {key!r} is missing (manual §4.11.2)")
    value = fields[key]
    if not isinstance(value, int) or value not in (0, 1):
        raise BadSample(Code.SAMPLE_REFUSED, f"{key} is {reprlib.repr(value)}, 0 or 1 is needed (manual §4.11.2)")
    return bool(value)


_READERS: Final[Mapping[str, _Read]] = {
    JOINT_STATE: _read_motors,
    POSE: _read_pose,
    INT32: _read_fsm,
    STRING: _read_mode,
}
_READER_OF: Final = {
    name: (TOPICS[name], message_type(TOPICS[name].type_name), _READERS[TOPICS[name].type_name])
    for name in STATE_TOPICS
}

_MOTORS: Final = {
    name: MotorReader(row, _motor_type(name)) for name, (row, _, read) in _READER_OF.items() if read is _read_motors
}
_POSES: Final = frozenset(name for name, (_, _, read) in _READER_OF.items() if read is _read_pose)

# -------------------------------------------------------------------------------------------------------- to the robot


def encode_frame(topic: str, values: Vector, wall_ns: int) -> bytes:
    """Return the payload of a frame.

    Args:
        topic: ROS name of a command topic.
        values: As many as the topic's width: joint positions [rad], pose (p [m], xyzw), or the floats of the array.
        wall_ns: Wall clock for the header's stamp [ns since 1970]; ignored where the type has no header.

    Returns:
        Exactly `FRAME_BYTES[topic]` bytes.

    Raises:
        BadFrame: If the frame must not reach the robot.
    """
    writer = _JOINT_WRITERS.get(topic)
    if writer is not None:
        quick = writer.write(values, wall_ns)
        if quick is not None:
            return quick
    try:
        payload = encode(to_message(topic, values, wall_ns))
    except CdrError as error:  # beyond single precision
        raise BadFrame(f"{topic}: {error}") from error
    if len(payload) != FRAME_BYTES[topic]:
        raise BadFrame(f"{topic}: {len(payload)} bytes, {FRAME_BYTES[topic]} are right")
    return payload


def to_message(topic: str, values: Vector, wall_ns: int) -> IdlStruct:
    """Return the message of a frame; arguments and errors as in `encode_frame`."""
    row = _COMMAND_ROWS.get(topic)
    if row is None:
        raise BadFrame(f"{topic!r} is no command topic of this robot (manual §4)")
    if len(values) != row.width:
        raise BadFrame(f"{topic}: {len(values)} values, {row.width} are needed (manual {row.section})")
    for index, value in enumerate(values):
        if not math.isfinite(value):
            raise BadFrame(f"{topic}: value {index} is {value}, a finite number is needed (manual {row.section})")
    return _WRITERS[row.type_name](row, values, wall_ns)


def _write_joints(row: Topic, values: Vector, wall_ns: int) -> IdlStruct:
    sec, nanosec = divmod(wall_ns, S)
    # The stamp's seconds are an int32. The robot does not read it: a clock beyond 2038 must not stop the stream.
    sec = (sec + 2**31) % 2**32 - 2**31
    return sensor_msgs.JointState(
        header=std_msgs.Header(stamp=builtin_interfaces.Time(sec=sec, nanosec=nanosec), frame_id=""),
        name=list(row.names),
        position=list(values),
        velocity=[0.0] * row.width,
        effort=[0.0] * row.width,
    )


def _write_pose(_row: Topic, values: Vector, _wall_ns: int) -> IdlStruct:
    return geometry_msgs.Pose(
        position=geometry_msgs.Point(*values[:3]), orientation=geometry_msgs.Quaternion(*values[3:])
    )


def _write_float(_row: Topic, values: Vector, _wall_ns: int) -> IdlStruct:
    return std_msgs.Float32(data=values[0])


def _write_array(_row: Topic, values: Vector, _wall_ns: int) -> IdlStruct:
    return std_msgs.Float32MultiArray(layout=std_msgs.MultiArrayLayout(dim=[], data_offset=0), data=list(values))


_WRITERS: Final[Mapping[str, Callable[[Topic, Vector, int], IdlStruct]]] = {
    JOINT_STATE: _write_joints,
    POSE: _write_pose,
    FLOAT32: _write_float,
    FLOAT32_ARRAY: _write_array,
}

_TYPE_BYTES: Final[Mapping[str, Callable[[int], int]]] = {
    JOINT_STATE: lambda _width: 324,  # seven names of 8 characters, 21 doubles, empty frame
    POSE: lambda _width: 60,
    FLOAT32: lambda _width: 8,
    FLOAT32_ARRAY: lambda width: 16 + 4 * width,  # header, no dimensions, offset, count, floats
}

FRAME_BYTES: Final[Mapping[str, int]] = {
    name: _TYPE_BYTES[row.type_name](row.width) for name, row in _COMMAND_ROWS.items()
}
"""Length of a command's payload, encapsulation header included [bytes] (wire.md 1.2)."""

_JOINT_WRITERS: Final = {
    name: JointWriter(encode(_write_joints(row, (0.0,) * row.width, 0)), row.width)
    for name, row in _COMMAND_ROWS.items()
    if row.type_name == JOINT_STATE
}
