"""The walk over a payload that believes nothing: every length is held against the bytes that are really there.

It must come before pycdr2, which decodes an empty payload into a default message and allocates what a count says.
The walk allocates nothing but the text it checks, and its time is bounded by the length of the payload: a count is
refused unless its elements could fit. It returns no values; what passes is safe to hand to pycdr2.
"""

from __future__ import annotations

import struct

from cdr_types.encapsulation import byte_order, check_end
from cdr_types.errors import BadString, CountOutOfBounds, StringOutOfBounds, Truncated
from cdr_types.layout import HEADER_SIZE, Kind, Number, Sequence, Struct, Text, align

__all__ = ["check_payload"]


def check_payload(data: bytes, layout: Struct) -> None:
    """Accept exactly the payloads that are one message of this layout plus padding.

    Raises:
        DecodeError: The leaf that says what is wrong, where, and what would have been right.
    """
    walk = _Walk(data, struct.Struct(f"{byte_order(data)}I"))
    walk.fields(layout, "")
    check_end(data, walk.offset)


class _Walk:
    """A cursor over one payload."""

    __slots__ = ("_data", "_uint32", "offset")

    def __init__(self, data: bytes, uint32: struct.Struct) -> None:
        self._data = data
        self._uint32 = uint32  # in the payload's byte order
        self.offset = HEADER_SIZE

    def fields(self, layout: Struct, path: str) -> None:
        prefix = f"{path}." if path else ""
        for name, kind in layout.fields:
            self._element(kind, prefix + name)

    def _element(self, kind: Kind, path: str) -> None:
        if isinstance(kind, Number):
            self._take(kind.size, path)
        elif isinstance(kind, Text):
            self._text(path)
        elif isinstance(kind, Sequence):
            self._sequence(kind.element, path)
        else:
            self.fields(kind, path)

    def _take(self, size: int, path: str) -> None:
        """Step over one number of this size."""
        start = align(self.offset, size)
        if start + size > len(self._data):
            raise Truncated(max(0, len(self._data) - start), size, start, path)
        self.offset = start + size

    def _length(self, path: str) -> int:
        """Step over a uint32 and return it."""
        self._take(4, path)
        (length,) = self._uint32.unpack_from(self._data, self.offset - 4)
        return int(length)

    def _text(self, path: str) -> None:
        length = self._length(path)
        start = self.offset
        left = len(self._data) - start
        if length > left:
            raise StringOutOfBounds(length, left, start - 4, path)
        raw = self._data[start : start + length]
        if not raw.endswith(b"\x00"):
            raise BadString(raw, "the terminating NUL is missing", start, path)
        if raw.find(b"\x00") != length - 1:
            raise BadString(raw, "there is a NUL inside", start, path)
        try:
            raw.decode("utf-8")
        except UnicodeDecodeError as error:
            raise BadString(raw, f"not UTF-8, {error.reason}", start + error.start, path) from None
        self.offset = start + length

    def _sequence(self, element: Kind, path: str) -> None:
        count = self._length(path)
        start = self.offset
        if isinstance(element, Number):
            first = align(start, element.size)
            self._believe(count, (len(self._data) - first) // element.size, path)
            if count:
                self.offset = first + count * element.size
        else:
            self._believe(count, (len(self._data) - start) // element.min_size, path)
            for index in range(count):
                self._element(element, f"{path}[{index}]")

    def _believe(self, count: int, room: int, path: str) -> None:
        """Refuse a count that the rest of the payload cannot hold."""
        if count > max(0, room):
            raise CountOutOfBounds(count, max(0, room), self.offset - 4, path)
