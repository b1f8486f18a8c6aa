"""The path that every message type can take: check, then let pycdr2 do the work.

Slow (tens of µs) and plain. It defines what is right: the fast paths hand over to it whenever they are not sure, and
tests hold them against it byte by byte. pycdr2 is given only payloads that `bounds` has walked and messages that
`values` has checked, so no error of its own is expected.
"""

from __future__ import annotations

from typing import TypeVar

from pycdr2 import IdlStruct

# pycdr2 imports both by name but leaves them out of its __all__.
from pycdr2._support import Buffer, Endianness

from cdr_types.bounds import check_payload
from cdr_types.layout import layout_of
from cdr_types.registry import MESSAGE_TYPES
from cdr_types.values import check_message

__all__ = ["decode_generic", "encode_generic"]

M = TypeVar("M", bound=IdlStruct)

# pycdr2 builds its tables on first use, and two threads may meet there; importing is done by one.
for _message_type in MESSAGE_TYPES:
    _message_type().serialize()


def decode_generic(data: bytes, message_type: type[M]) -> M:
    """Return the message in a payload.

    Args:
        data: The payload, header included, in either byte order.
        message_type: One of `registry.MESSAGE_TYPES`.

    Raises:
        DecodeError: If the payload is not one message of this type plus padding.
    """
    check_payload(data, layout_of(message_type))
    return message_type.deserialize(data)


def encode_generic(message: IdlStruct) -> bytes:
    """Return the payload of a message: little endian, exact length, no padding.

    Raises:
        UnencodableValue: If a field holds what its ROS type cannot.
    """
    check_message(message, layout_of(type(message)))
    # A buffer of our own: the one that pycdr2 keeps per type would be shared between threads.
    return message.serialize(buffer=Buffer(), endianness=Endianness.Little)
