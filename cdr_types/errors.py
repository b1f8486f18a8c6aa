"""Everything that can be wrong with bytes, messages and names.

```
CdrError                     a ValueError; value, bound, offset, field
├─ DecodeError               the bytes are not a message of this type
│  ├─ NotBytes               the payload is not bytes, bytearray or memoryview
│  ├─ WrongEncapsulation     the header is neither 00 01 (little endian) nor 00 00 (big endian)
│  ├─ Truncated              the payload ends inside a field
│  ├─ CountOutOfBounds       a sequence announces more elements than the rest of the payload can hold
│  ├─ StringOutOfBounds      a string announces more bytes than the rest of the payload holds
│  ├─ BadString              no terminating NUL, a NUL inside, or not UTF-8
│  └─ TrailingBytes          more is left over than padding can be
├─ UnencodableValue          a field of the message cannot be written: wrong type, out of range, not text
├─ UnknownType               no such message type here
└─ BadName                   a topic, key, type name or liveliness token breaks the grammar
```

An error holds what was found (`value`), what was allowed (`bound`), where (`offset` in bytes from the start of the
payload, header included; `field` as a dotted path) and builds its message from them. All of them can be pickled.
"""

from __future__ import annotations

import reprlib

__all__ = [
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
]


class CdrError(ValueError):
    """Root of the tree.

    Args:
        value: What was found.
        bound: What is allowed: a number or a phrase.
        offset: Where [bytes from the start of the payload]; None where there are no bytes.
        field: Which field, e.g. `header.frame_id`; empty where there is none.
    """

    rule = "found {value}, allowed is {bound}"
    """How `value` and `bound` become a sentence."""

    def __init__(self, value: object, bound: object, offset: int | None = None, field: str = "") -> None:
        super().__init__(value, bound, offset, field)
        self.value = value
        self.bound = bound
        self.offset = offset
        self.field = field

    def __str__(self) -> str:
        """Return field, rule and place in one line; long values are shortened."""
        bound = self.bound if isinstance(self.bound, str) else reprlib.repr(self.bound)
        text = self.rule.format(value=reprlib.repr(self.value), bound=bound)
        where = "" if self.offset is None else f" (at byte {self.offset})"
        return f"{self.field}: {text}{where}" if self.field else f"{text}{where}"


class DecodeError(CdrError):
    """The bytes are not a message of this type."""


class NotBytes(DecodeError):
    """The payload is no bytes object; `value` is the name of its type."""

    rule = "the payload is a {value}; hand over {bound}"


class WrongEncapsulation(DecodeError):
    """The first two bytes announce another representation (XCDR2, parameter list) or are no CDR at all."""

    rule = "encapsulation header {value}; only {bound} is spoken here"


class Truncated(DecodeError):
    """The payload ends too early; `value` are the bytes left, `bound` the bytes needed."""

    rule = "the payload ends too early: {value} bytes left, {bound} needed"


class CountOutOfBounds(DecodeError):
    """A sequence's count cannot be true; `bound` is the most that the rest of the payload could hold."""

    rule = "{value} elements announced, the payload has room for at most {bound}"


class StringOutOfBounds(DecodeError):
    """A string's length cannot be true; `bound` are the bytes left. The length counts the terminating NUL."""

    rule = "a string of {value} bytes announced, {bound} are left"


class BadString(DecodeError):
    """The bytes of a string are no CDR string."""

    rule = "{value} is not a CDR string: {bound}"


class TrailingBytes(DecodeError):
    """More bytes follow the message than the 0-3 of RTPS padding."""

    rule = "{value} bytes follow the message; padding is at most {bound}"


class UnencodableValue(CdrError):
    """A field of a message holds what its ROS type cannot."""

    rule = "{value} cannot be written; it must be {bound}"


class UnknownType(CdrError):
    """A message type or type name that the registry does not hold."""

    rule = "{value} is no known message type; known are {bound}"


class BadName(CdrError):
    """A topic, key, type name or token outside its grammar."""

    rule = "{value} is no valid name: {bound}"
