"""Fast paths for the hot types of fixed or nearly fixed layout: Float32, Int32, Pose, Float32MultiArray.

Rules: a fast path answers only when it is sure (little endian, plausible length, plain containers); everything else,
and every error, is left to the generic path, which also words it. Results are the same, byte by byte and field by
field. The joint state, whose layout depends on its texts, has a module of its own.
"""

from __future__ import annotations

from struct import Struct, pack, unpack_from

from cdr_types.encapsulation import HEADER_LITTLE, MAX_PADDING
from cdr_types.generic import decode_generic, encode_generic
from cdr_types.messages.geometry_msgs import Point, Pose, Quaternion
from cdr_types.messages.std_msgs import Float32, Float32MultiArray, Int32, MultiArrayLayout
from cdr_types.values import UNPACKABLE

__all__ = [
    "decode_float32",
    "decode_float32_array",
    "decode_int32",
    "decode_pose",
    "encode_float32",
    "encode_float32_array",
    "encode_int32",
    "encode_pose",
]

_LITTLE = HEADER_LITTLE[:2]
_NOT_SURE = (AttributeError, *UNPACKABLE)

_FLOAT32 = Struct("<4sf")
_INT32 = Struct("<4si")
_POSE = Struct("<4s7d")
_ARRAY_HEAD = Struct("<4sIII")  # header, number of dimensions, data_offset, number of elements


def decode_float32(data: bytes) -> Float32:
    """Return the Float32 in a payload; errors as in `decode_generic`."""
    if 0 <= len(data) - _FLOAT32.size <= MAX_PADDING and data[:2] == _LITTLE:
        return Float32(_FLOAT32.unpack_from(data)[1])
    return decode_generic(data, Float32)


def encode_float32(message: Float32) -> bytes:
    """Return the payload of a Float32; errors as in `encode_generic`."""
    try:
        return _FLOAT32.pack(HEADER_LITTLE, message.data)
    except _NOT_SURE:
        return encode_generic(message)


def decode_int32(data: bytes) -> Int32:
    """Return the Int32 in a payload; errors as in `decode_generic`."""
    if 0 <= len(data) - _INT32.size <= MAX_PADDING and data[:2] == _LITTLE:
        return Int32(_INT32.unpack_from(data)[1])
    return decode_generic(data, Int32)


def encode_int32(message: Int32) -> bytes:
    """Return the payload of an Int32; errors as in `encode_generic`."""
    try:
        return _INT32.pack(HEADER_LITTLE, message.data)
    except _NOT_SURE:
        return encode_generic(message)


def decode_pose(data: bytes) -> Pose:
    """Return the Pose in a payload; errors as in `decode_generic`."""
    if 0 <= len(data) - _POSE.size <= MAX_PADDING and data[:2] == _LITTLE:
        _, px, py, pz, qx, qy, qz, qw = _POSE.unpack_from(data)
        return Pose(Point(px, py, pz), Quaternion(qx, qy, qz, qw))
    return decode_generic(data, Pose)


def encode_pose(message: Pose) -> bytes:
    """Return the payload of a Pose; errors as in `encode_generic`."""
    try:
        p, q = message.position, message.orientation
        if p.__class__ is Point and q.__class__ is Quaternion:
            return _POSE.pack(HEADER_LITTLE, p.x, p.y, p.z, q.x, q.y, q.z, q.w)
    except _NOT_SURE:
        pass
    return encode_generic(message)


def decode_float32_array(data: bytes) -> Float32MultiArray:
    """Return the Float32MultiArray in a payload; errors as in `decode_generic`.

    Fast for an array without dimensions, which is all that the robot's topics carry (manual §4.5, §4.6).
    """
    if len(data) >= _ARRAY_HEAD.size and data[:2] == _LITTLE:
        _, dimensions, data_offset, count = _ARRAY_HEAD.unpack_from(data)
        if dimensions == 0 and 0 <= len(data) - _ARRAY_HEAD.size - 4 * count <= MAX_PADDING:
            numbers = unpack_from(f"<{count}f", data, _ARRAY_HEAD.size)
            return Float32MultiArray(MultiArrayLayout([], data_offset), list(numbers))
    return decode_generic(data, Float32MultiArray)


def encode_float32_array(message: Float32MultiArray) -> bytes:
    """Return the payload of a Float32MultiArray; errors as in `encode_generic`."""
    try:
        layout, numbers = message.layout, message.data
        if layout.__class__ is MultiArrayLayout and layout.dim == [] and numbers.__class__ is list:
            return pack(f"<4sIII{len(numbers)}f", HEADER_LITTLE, 0, layout.data_offset, len(numbers), *numbers)
    except _NOT_SURE:
        pass
    return encode_generic(message)
