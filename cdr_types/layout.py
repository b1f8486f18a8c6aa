"""What a message class looks like on the wire: its fields in order, as a small tree that walkers follow.

```
Kind = Number   int8 ... uint64, float32, float64: size = alignment
     | Text     length with terminating NUL (uint32), UTF-8, NUL
     | Sequence count (uint32), elements
     | Struct   fields in order; itself not aligned
```

Alignment (CDR, version 1): each number is aligned to its size counted from byte 4 of the payload, behind the
encapsulation header. An empty sequence is its count alone; no alignment of the missing elements follows.
The tree is derived from the class's annotations, so class, walkers and `.msg` text cannot disagree. It knows no bytes.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import get_args, get_type_hints

from pycdr2 import IdlStruct
from pycdr2.types import sequence

from cdr_types.errors import UnknownType

__all__ = ["HEADER_SIZE", "Kind", "Number", "Sequence", "Struct", "Text", "align", "layout_of"]

HEADER_SIZE = 4
"""Bytes of the encapsulation header; alignment counts from here (wire.md 1.2)."""


@dataclass(frozen=True, slots=True)
class Number:
    """A primitive number.

    Attributes:
        name: ROS name, e.g. `float64`.
        code: Character of the `struct` module.
        size: Size and alignment [bytes].
    """

    name: str
    code: str
    size: int

    @property
    def min_size(self) -> int:
        """Fewest bytes that an element of this kind takes."""
        return self.size


@dataclass(frozen=True, slots=True)
class Text:
    """A string."""

    @property
    def min_size(self) -> int:
        """Fewest bytes that an element of this kind takes: the length and the NUL."""
        return 5


@dataclass(frozen=True, slots=True)
class Sequence:
    """A list of any length.

    Attributes:
        element: What it is a list of.
    """

    element: Kind

    @property
    def min_size(self) -> int:
        """Fewest bytes that an element of this kind takes: the count."""
        return 4


@dataclass(frozen=True, slots=True)
class Struct:
    """A message, or a message within one.

    Attributes:
        message_type: Its class.
        fields: Name and kind of each field, in order of the wire.
    """

    message_type: type[IdlStruct]
    fields: tuple[tuple[str, Kind], ...]

    @property
    def min_size(self) -> int:
        """Fewest bytes that an element of this kind takes, alignment left out."""
        return sum(kind.min_size for _, kind in self.fields)


Kind = Number | Text | Sequence | Struct

_NUMBERS = {
    number.name: number
    for number in (
        Number("int8", "b", 1),
        Number("uint8", "B", 1),
        Number("int16", "h", 2),
        Number("uint16", "H", 2),
        Number("int32", "i", 4),
        Number("uint32", "I", 4),
        Number("int64", "q", 8),
        Number("uint64", "Q", 8),
        Number("float32", "f", 4),
        Number("float64", "d", 8),
    )
}


def align(offset: int, size: int) -> int:
    """Return the first offset at or behind `offset` that is a multiple of `size` counted from byte 4."""
    return offset + (HEADER_SIZE - offset) % size


@cache
def layout_of(message_type: type[IdlStruct]) -> Struct:
    """Return the layout of a message class.

    Raises:
        UnknownType: If an annotation is none of the kinds above.
    """
    hints = get_type_hints(message_type, include_extras=True)
    return Struct(message_type, tuple((name, _kind(hint)) for name, hint in hints.items()))


def _kind(hint: object) -> Kind:
    if hint is str:
        return Text()
    if isinstance(hint, type) and issubclass(hint, IdlStruct):
        return layout_of(hint)
    # pycdr2's types are Annotated[<what Python sees>, <what the wire sees>].
    wire = get_args(hint)[1:]
    if wire and isinstance(wire[0], sequence) and wire[0].max_length is None:
        return Sequence(_kind(wire[0].subtype))
    if wire and wire[0] in _NUMBERS:
        return _NUMBERS[wire[0]]
    raise UnknownType(hint, "str, a message class, a number of pycdr2.types and an unbounded sequence of these")
