"""The check of a message before it is written: does each field hold what its ROS type can?

Accepted are: for a number whatever the `struct` module packs as one (so a Python or numpy scalar; a float for an
integer field is refused), for a string `str` without NUL and without lone surrogates, for a sequence a list or tuple,
for a nested message exactly its class. NaN and infinity are legal here, as they are on the wire; whoever sends to a
robot refuses them above this layer. A double too large for a float32 field is refused, never rounded to infinity.
"""

from __future__ import annotations

import struct

from cdr_types.errors import UnencodableValue
from cdr_types.layout import Kind, Number, Sequence, Struct, Text

__all__ = ["UNPACKABLE", "check_message"]

UNPACKABLE = (struct.error, OverflowError, TypeError, ValueError)
"""What `struct` raises for a value that it cannot pack."""

_MISSING = object()


def check_message(message: object, layout: Struct) -> None:
    """Accept exactly the messages that can be written.

    Raises:
        UnencodableValue: With the path of the field, its value and what it must be.
    """
    _check(message, layout, "")


def _check(value: object, kind: Kind, path: str) -> None:
    if isinstance(kind, Number):
        _check_number(value, kind, path)
    elif isinstance(kind, Text):
        _check_text(value, path)
    elif isinstance(kind, Sequence):
        if not isinstance(value, (list, tuple)):
            raise UnencodableValue(value, "a list or tuple", field=path)
        for index, element in enumerate(value):
            _check(element, kind.element, f"{path}[{index}]")
    else:
        if value.__class__ is not kind.message_type:
            raise UnencodableValue(value, f"a {kind.message_type.__name__}", field=path)
        prefix = f"{path}." if path else ""
        for name, field_kind in kind.fields:
            _check(getattr(value, name, _MISSING), field_kind, prefix + name)


def _check_number(value: object, kind: Number, path: str) -> None:
    try:
        # Little endian, not native: the native mode rounds a float32 overflow to infinity without a word.
        struct.pack(f"<{kind.code}", value)
    except UNPACKABLE as error:
        raise UnencodableValue(value, f"a number that fits {kind.name} ({error})", field=path) from None


def _check_text(value: object, path: str) -> None:
    if not isinstance(value, str):
        raise UnencodableValue(value, "a str", field=path)
    if "\x00" in value:
        raise UnencodableValue(value, "a str without NUL: it would end the string early", field=path)
    try:
        value.encode("utf-8")
    except UnicodeEncodeError as error:
        raise UnencodableValue(value, f"a str that UTF-8 can write ({error.reason})", field=path) from None
