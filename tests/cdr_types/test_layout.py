from dataclasses import dataclass
from typing import Annotated

import pytest
from pycdr2 import IdlStruct, make_idl_struct
from pycdr2.types import array, float32, float64, int8, int16, int32, int64, sequence, uint8, uint16, uint32, uint64

from cdr_types.errors import UnknownType
from cdr_types.layout import Number, Sequence, Struct, Text, align, layout_of
from cdr_types.messages.builtin_interfaces import Time
from cdr_types.messages.sensor_msgs import JointState
from cdr_types.messages.std_msgs import Header

INT32 = Number("int32", "i", 4)
UINT32 = Number("uint32", "I", 4)
FLOAT64 = Number("float64", "d", 8)
TIME = Struct(Time, (("sec", INT32), ("nanosec", UINT32)))
HEADER = Struct(Header, (("stamp", TIME), ("frame_id", Text())))


def test_the_layout_follows_the_annotations():
    """A joint state is a header, texts and three arrays of doubles, in this order."""
    assert layout_of(JointState) == Struct(
        JointState,
        (
            ("header", HEADER),
            ("name", Sequence(Text())),
            ("position", Sequence(FLOAT64)),
            ("velocity", Sequence(FLOAT64)),
            ("effort", Sequence(FLOAT64)),
        ),
    )


def test_every_number_of_the_wire_is_known():
    """Size, alignment and struct code of the ten CDR numbers."""

    @dataclass
    class Numbers(IdlStruct, typename="t.msg.dds_.Numbers_"):
        a: int8
        b: uint8
        c: int16
        d: uint16
        e: int32
        f: uint32
        g: int64
        h: uint64
        i: float32
        j: float64

    kinds = [kind for _, kind in layout_of(Numbers).fields]
    assert [(kind.code, kind.size) for kind in kinds] == [
        ("b", 1), ("B", 1), ("h", 2), ("H", 2), ("i", 4), ("I", 4), ("q", 8), ("Q", 8), ("f", 4), ("d", 8),
    ]  # fmt: skip


def test_the_least_size_never_promises_too_much():
    """A count may be refused on its strength, so it must be a lower bound for each element."""
    assert FLOAT64.min_size == 8
    assert Text().min_size == 5  # length, NUL
    assert Sequence(FLOAT64).min_size == 4  # count
    assert HEADER.min_size == 4 + 4 + 5


@pytest.mark.parametrize(
    ("offset", "size", "expected"),
    [(4, 8, 4), (5, 8, 12), (8, 8, 12), (12, 8, 12), (13, 4, 16), (16, 4, 16), (17, 2, 18), (19, 1, 19)],
)
def test_alignment_counts_from_byte_four(offset, size, expected):
    """Aligning from byte 0 is a frequent bug (wire.md 1.2)."""
    assert align(offset, size) == expected


@pytest.mark.parametrize(
    "hint", [float, bytes, dict, sequence[float64, 3], array[float64, 3], Annotated[list[float], "no such number"]]
)
def test_what_the_walkers_cannot_follow_is_refused(hint):
    """A message class with such a field is noticed when it is written, not when it arrives."""
    with pytest.raises(UnknownType):
        layout_of(make_idl_struct("Odd", "t.msg.dds_.Odd_", {"field": hint}))
