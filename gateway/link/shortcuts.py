"""The short way of the hot payloads: bytes straight to values, and setpoints straight to bytes, without a message between.

An arm's state arrives and a setpoint leaves a hundred times a second; of what these cost in the control loop, the
message in the middle is more than half. A shortcut gives exactly what the long way (`codec`) gives, or nothing:

* Reading: it learns the constant bytes of a topic (frame, names, first count) from a payload that the long way has
  believed, and answers only for payloads that repeat them, little endian, of the same length, with the same counts, and
  with finite numbers alone. Whatever is different, or wrong, takes the long way, which also says what is wrong.
* Writing: the constant bytes come from a payload of the long way, so they are what it writes.

Pure: no zenoh, no clock. What was learnt is swapped in by one assignment.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from struct import Struct, unpack_from

from gateway.robot.topics import Topic
from gateway.values import EePose, MotorState, Vector

__all__ = ["JointWriter", "MotorReader", "read_pose"]

S = 1_000_000_000

HEADER = b"\x00\x01"
"""Little endian; the two bytes behind it are options that nobody reads (wire.md 1.2)."""
CONSTANT_AT = 12
"""Behind encapsulation header and stamp."""
ORIGIN = 4
"""Alignment counts from behind the encapsulation header."""

_POSE = Struct("<7d")
POSE_BYTES = 60
UNIT_TOLERANCE = 0.05
"""As in `EePose`: a norm further from 1 is for the constructor to refuse."""

_new: Callable[[type[MotorState]], MotorState] = object.__new__
_set = object.__setattr__


class MotorReader:
    """Reads the motor states of one topic."""

    def __init__(self, row: Topic, value_type: type[MotorState]) -> None:
        self._width = row.width
        self._value_type = value_type
        self._learnt: tuple[int, bytes, Callable[[bytes], tuple[float, ...]]] | None = None

    def read(self, payload: bytes) -> MotorState | None:
        """Return the value in a payload, or None when the long way must look at it."""
        learnt = self._learnt
        if learnt is None:
            return None
        length, constant, unpack = learnt
        if len(payload) != length or not payload.startswith(constant, CONSTANT_AT) or not payload.startswith(HEADER):
            return None
        numbers = unpack(payload)
        width = self._width
        end = 2 + width
        if numbers[end] != width or numbers[end + 1 + width] != width or numbers[1] >= S:
            return None
        if not math.isfinite(sum(numbers)):
            return None
        # Everything that the constructor would check is known; it takes most of the time of the long way.
        value = _new(self._value_type)
        _set(value, "q_rad", numbers[2:end])
        _set(value, "dq_radps", numbers[end + 1 : end + 1 + width])
        _set(value, "tau_nm", numbers[end + 2 + width :])
        _set(value, "stamp_ns", numbers[0] * S + numbers[1])
        return value

    def learn(self, payload: bytes, value: MotorState) -> None:
        """Learn from a payload that was believed; one of another form teaches nothing."""
        width = self._width
        if not payload.startswith(HEADER) or not len(value.dq_radps) == len(value.tau_nm) == width:
            return
        at = CONSTANT_AT + 4 + int(unpack_from("<I", payload, CONSTANT_AT)[0])  # behind the frame
        at = _aligned(at, 4)
        (names,) = unpack_from("<I", payload, at)
        at += 4
        for _ in range(names):
            at = _aligned(at, 4)
            at += 4 + int(unpack_from("<I", payload, at)[0])
        end = _aligned(at, 4) + 4  # behind the count of the positions
        pad = _aligned(end, 8) - end
        between = _aligned(_aligned(end, 8) + 4, 8) - _aligned(end, 8) - 4
        form = Struct(f"<4xiI{end - CONSTANT_AT}x{pad}x{width}dI{between}x{width}dI{between}x{width}d")
        self._learnt = len(payload), payload[CONSTANT_AT:end], form.unpack_from


def read_pose(payload: bytes) -> EePose | None:
    """Return the pose in a payload, or None when the long way must look at it."""
    if len(payload) != POSE_BYTES or not payload.startswith(HEADER):
        return None
    x, y, z, qx, qy, qz, qw = _POSE.unpack_from(payload, ORIGIN)
    norm = math.sqrt(qx * qx + qy * qy + qz * qz + qw * qw)
    if not (abs(norm - 1.0) <= UNIT_TOLERANCE and math.isfinite(x + y + z)):
        return None
    pose = object.__new__(EePose)
    _set(pose, "p_m", (x, y, z))
    _set(pose, "quat_xyzw", (qx / norm, qy / norm, qz / norm, qw / norm))
    return pose


class JointWriter:
    """Writes joint setpoints of one topic.

    Args:
        payload: Any payload of the topic that the long way has written: everything but stamp and positions is constant.
        width: Number of joints.
    """

    def __init__(self, payload: bytes, width: int) -> None:
        tail = 2 * (8 + 8 * width)  # count, padding and zeros: velocities, then efforts
        positions_at = len(payload) - tail - 8 * width
        self._middle = payload[CONSTANT_AT:positions_at]
        self._tail = payload[-tail:]
        self._pack = Struct(f"<4siI{len(self._middle)}s{width}d{tail}s").pack
        self._width = width
        self._header = payload[:ORIGIN]

    def write(self, values: Vector, wall_ns: int) -> bytes | None:
        """Return the payload, or None when the long way must look at the values.

        Args:
            values: Joint positions [rad].
            wall_ns: Wall clock for the stamp [ns since 1970].
        """
        if len(values) != self._width or not math.isfinite(sum(values)):
            return None
        sec, nanosec = divmod(wall_ns, S)
        if not 0 <= sec < 2**31:
            return None
        return self._pack(self._header, sec, nanosec, self._middle, *values, self._tail)


def _aligned(offset: int, size: int) -> int:
    """Return the next offset that a number of this size may have."""
    return ORIGIN + (offset - ORIGIN + size - 1) // size * size
