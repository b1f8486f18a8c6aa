"""The four bytes in front of each payload, and the few that may follow it.

Only plain CDR version 1 is spoken: `00 01` little endian, `00 00` big endian. Bytes 2 and 3 are options; they may
carry a padding count and are ignored. RTPS pads a payload to a multiple of 4 and nobody cuts it off again, so up to
three bytes of any value may follow a message (wire.md 1.2). What lies between is not looked at here, except for the
stamp of a message that begins with a header.
"""

from __future__ import annotations

from struct import Struct

from cdr_types.errors import NotBytes, TrailingBytes, Truncated, WrongEncapsulation
from cdr_types.layout import HEADER_SIZE

__all__ = ["BIG", "HEADER_LITTLE", "LITTLE", "MAX_PADDING", "as_bytes", "byte_order", "check_end", "peek_stamp"]

LITTLE = "<"
BIG = ">"
"""Byte orders as the `struct` module writes them."""

HEADER_LITTLE = b"\x00\x01\x00\x00"
"""Header of everything that is encoded here."""

MAX_PADDING = 3
"""Most bytes that may follow a message [bytes]."""

_ORDERS = {b"\x00\x01": LITTLE, b"\x00\x00": BIG}
STAMP_BYTES = 8
_STAMPS = {mark: Struct(f"{order}4xiI") for mark, order in _ORDERS.items()}


def as_bytes(data: object) -> bytes:
    """Return the payload as `bytes`.

    Raises:
        NotBytes: If it is neither bytes, bytearray nor memoryview.
    """
    if isinstance(data, (bytes, bytearray, memoryview)):
        return bytes(data)
    raise NotBytes(type(data).__name__, "bytes, bytearray or memoryview")


def byte_order(data: bytes) -> str:
    """Return `<` or `>` as the header says.

    Raises:
        Truncated: If there is no room for a header.
        WrongEncapsulation: If the header announces anything but plain CDR.
    """
    if len(data) < HEADER_SIZE:
        raise Truncated(len(data), HEADER_SIZE, 0, "encapsulation header")
    order = _ORDERS.get(data[:2])
    if order is None:
        raise WrongEncapsulation(data[:2].hex(" "), "00 01 (plain CDR, little endian) or 00 00 (big endian)", 0)
    return order


def check_end(data: bytes, end: int) -> None:
    """Accept what may follow a message that ends at offset `end`.

    Raises:
        TrailingBytes: If more is left than padding can be.
    """
    rest = len(data) - end
    if rest > MAX_PADDING:
        raise TrailingBytes(rest, MAX_PADDING, end)


def peek_stamp(data: bytes) -> int:
    """Return the stamp of a message that begins with a `std_msgs/Header`, without decoding the rest.

    Meant for telling copies of one sample apart from its successors before the cost of decoding is paid. The payload
    is not checked beyond the stamp.

    Returns:
        `sec` and `nanosec` in one number [ns], of the sender's clock.

    Raises:
        DecodeError: If it is no bytes object, has a wrong header or ends before the stamp does.
    """
    if data.__class__ is not bytes:
        data = as_bytes(data)
    stamp = _STAMPS.get(data[:2])
    if stamp is None or len(data) < stamp.size:
        byte_order(data)  # raises where the header itself is wrong or cut
        raise Truncated(len(data) - HEADER_SIZE, STAMP_BYTES, HEADER_SIZE, "header.stamp")
    sec, nanosec = stamp.unpack_from(data)
    return int(sec) * 1_000_000_000 + int(nanosec)
