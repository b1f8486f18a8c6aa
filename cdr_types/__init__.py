"""ROS 2 messages without ROS: the bytes that zenoh-bridge-ros2dds puts on the wire, and the names it gives them.

`decode(data, message_type)` and `encode(message)` translate, `messages` holds the classes, `registry` their ROS
names, `schemas` their `.msg` text, `keys` the zenoh keys and liveliness tokens. Every failure is a `CdrError`.
The package knows the wire format and nothing about any robot. Read first: `codec`.
"""

from __future__ import annotations

from cdr_types.codec import decode, encode
from cdr_types.encapsulation import peek_stamp
from cdr_types.errors import (
    BadName,
    BadString,
    CdrError,
    CountOutOfBounds,
    DecodeError,
    NotBytes,
    StringOutOfBounds,
    TrailingBytes,
    Truncated,
    UnencodableValue,
    UnknownType,
    WrongEncapsulation,
)
from cdr_types.registry import MESSAGE_TYPES, message_type, type_name

__all__ = [
    "MESSAGE_TYPES",
    "BadName",
    "BadString",
    "CdrError",
    "CountOutOfBounds",
    "DecodeError",
    "NotBytes",
    "StringOutOfBounds",
    "TrailingBytes",
    "Truncated",
    "UnencodableValue",
    "UnknownType",
    "WrongEncapsulation",
    "decode",
    "encode",
    "message_type",
    "peek_stamp",
    "type_name",
]
