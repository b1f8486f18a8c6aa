"""Bytes <-> messages: the two functions that everybody calls.

`decode` accepts plain CDR in either byte order with 0-3 bytes of padding and refuses everything else; `encode` writes
little endian, exactly as long as the message. Each type has its path here: the hot ones their fast one, the others
the generic one; callers cannot tell the difference except by the clock. Numbers are not judged: NaN and infinity
pass both ways, limits are the business of the layers above. No state that a caller could see, safe from any thread.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any, TypeVar

from pycdr2 import IdlStruct

from cdr_types.encapsulation import as_bytes
from cdr_types.errors import UnknownType
from cdr_types.fast import (
    decode_float32,
    decode_float32_array,
    decode_int32,
    decode_pose,
    encode_float32,
    encode_float32_array,
    encode_int32,
    encode_pose,
)
from cdr_types.generic import decode_generic, encode_generic
from cdr_types.joint_state import decode_joint_state, encode_joint_state
from cdr_types.messages import geometry_msgs, sensor_msgs, std_msgs
from cdr_types.registry import KNOWN_NAMES, MESSAGE_TYPES

__all__ = ["decode", "encode"]

M = TypeVar("M", bound=IdlStruct)

# Any: the tables join types that only their keys tell apart.
_DECODERS: dict[type[IdlStruct], Callable[[bytes], Any]] = {
    **{cls: partial(decode_generic, message_type=cls) for cls in MESSAGE_TYPES},
    geometry_msgs.Pose: decode_pose,
    sensor_msgs.JointState: decode_joint_state,
    std_msgs.Float32: decode_float32,
    std_msgs.Float32MultiArray: decode_float32_array,
    std_msgs.Int32: decode_int32,
}
_ENCODERS: dict[type[IdlStruct], Callable[[Any], bytes]] = {
    **dict.fromkeys(MESSAGE_TYPES, encode_generic),
    geometry_msgs.Pose: encode_pose,
    sensor_msgs.JointState: encode_joint_state,
    std_msgs.Float32: encode_float32,
    std_msgs.Float32MultiArray: encode_float32_array,
    std_msgs.Int32: encode_int32,
}


def decode(data: bytes, message_type: type[M]) -> M:
    """Return the message in a payload.

    Args:
        data: The payload as it came, header included; bytearray and memoryview are copied first.
        message_type: A class of `cdr_types.messages`.

    Returns:
        A message of its own: nothing in it is shared with another one.

    Raises:
        DecodeError: If the payload is not exactly one message of this type plus 0-3 bytes of padding.
        UnknownType: If the class is none of ours.
    """
    try:
        decoder = _DECODERS[message_type]
    except (KeyError, TypeError):  # TypeError: not even hashable
        raise UnknownType(message_type, KNOWN_NAMES) from None
    if data.__class__ is not bytes:
        data = as_bytes(data)
    message: M = decoder(data)
    return message


def encode(message: IdlStruct) -> bytes:
    """Return the payload of a message: header `00 01 00 00`, little endian, no padding.

    Args:
        message: An instance of a class of `cdr_types.messages`.

    Raises:
        UnencodableValue: If a field holds what its ROS type cannot.
        UnknownType: If the class is none of ours.
    """
    encoder = _ENCODERS.get(message.__class__)
    if encoder is None:
        raise UnknownType(message.__class__, KNOWN_NAMES)
    return encoder(message)
