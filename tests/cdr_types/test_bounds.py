from __future__ import annotations

import struct
import tracemalloc

import pytest

from cdr_types.bounds import check_payload
from cdr_types.errors import (
    BadString,
    CountOutOfBounds,
    StringOutOfBounds,
    TrailingBytes,
    Truncated,
    WrongEncapsulation,
)
from cdr_types.layout import layout_of
from cdr_types.messages.geometry_msgs import Pose
from cdr_types.messages.sensor_msgs import JointState
from cdr_types.messages.std_msgs import Float32MultiArray, Header, String
from cdr_types.registry import MESSAGE_TYPES
from tests.cdr_types.oracle import arm_state, ros_encode

LITTLE = b"\x00\x01\x00\x00"
BIG = b"\x00\x00\x00\x00"


def check(data, message_type):
    """Walk over a payload."""
    check_payload(data, layout_of(message_type))


def refusal(data, message_type, error_type):
    """Return the error that the walk must raise."""
    with pytest.raises(error_type) as caught:
        check(data, message_type)
    return caught.value


def text(raw, announced=None, order="<"):
    """Return the payload of a String of these bytes, with a length that may lie."""
    return (
        (LITTLE if order == "<" else BIG) + struct.pack(f"{order}I", len(raw) if announced is None else announced) + raw
    )


@pytest.mark.parametrize("little_endian", [True, False])
@pytest.mark.parametrize("cls", MESSAGE_TYPES)
def test_the_payload_of_a_fresh_message_passes(cls, little_endian):
    """Both byte orders, every type."""
    check(ros_encode(cls(), little_endian=little_endian), cls)


def test_a_message_ends_where_its_last_field_does():
    """Cut anywhere, a joint state is refused; with four bytes more it is refused too."""
    data = ros_encode(arm_state())
    for size in range(4, len(data)):
        with pytest.raises((Truncated, CountOutOfBounds, StringOutOfBounds)):
            check(data[:size], JointState)
    for padding in range(4):
        check(data + b"\xee" * padding, JointState)
    assert refusal(data + bytes(4), JointState, TrailingBytes).value == 4


def test_numbers_say_where_and_how_much_is_missing():
    """Field, offset, bytes left and bytes needed."""
    error = refusal(LITTLE + bytes(50), Pose, Truncated)
    assert (error.field, error.offset, error.value, error.bound) == ("orientation.w", 52, 2, 8)


def test_a_number_behind_the_end_has_nothing_left():
    """Alignment may step over the end; what is left is then zero, not less."""
    payload = LITTLE + bytes(8) + struct.pack("<I", 2) + b"a\x00"  # stamp and frame, 18 bytes
    error = refusal(payload, JointState, Truncated)
    assert (error.field, error.offset, error.value, error.bound) == ("name", 20, 0, 4)


def test_a_hostile_count_is_refused_before_anything_is_allocated():
    """Four billion elements in a few bytes: an error, at once, whatever they are elements of."""
    header = bytes(8) + struct.pack("<I", 1) + b"\x00" + bytes(3)
    tracemalloc.start()
    error = refusal(LITTLE + header + b"\xff\xff\xff\xff", JointState, CountOutOfBounds)
    assert (error.field, error.value, error.bound, error.offset) == ("name", 0xFFFFFFFF, 0, 20)
    error = refusal(LITTLE + header + bytes(4) + b"\xff\xff\xff\xff" + bytes(16), JointState, CountOutOfBounds)
    assert (error.field, error.bound, error.offset) == ("position", 2, 24)
    error = refusal(LITTLE + b"\xff\xff\xff\xff" + bytes(40), Float32MultiArray, CountOutOfBounds)
    assert (error.field, error.bound) == ("layout.dim", 3)
    assert tracemalloc.get_traced_memory()[1] < 200_000
    tracemalloc.stop()


def test_the_room_behind_a_count_is_its_bound():
    """Two positions and two empty arrays leave room for three doubles: a fourth is not believed, a third not found."""
    data = bytearray(ros_encode(JointState(position=[1.0, 2.0])))
    assert (len(data), data[24:28]) == (52, struct.pack("<I", 2))
    data[24:28] = struct.pack("<I", 4)
    error = refusal(bytes(data), JointState, CountOutOfBounds)
    assert (error.field, error.value, error.bound, error.offset) == ("position", 4, 3, 24)
    data[24:28] = struct.pack("<I", 3)
    assert refusal(bytes(data), JointState, Truncated).field == "velocity"


def test_a_count_at_the_end_has_room_for_nothing():
    """Where the first element would be aligned beyond the end, the room is zero, not less."""
    data = ros_encode(JointState(header=Header(frame_id="abcd")))
    error = refusal(data[:28] + struct.pack("<I", 1), JointState, CountOutOfBounds)
    assert (error.field, error.value, error.bound, error.offset) == ("position", 1, 0, 28)


def test_a_hostile_string_length_is_refused():
    """The length is held against the bytes that are left."""
    error = refusal(text(b"ab\x00", announced=0xFFFFFFFF), String, StringOutOfBounds)
    assert (error.field, error.value, error.bound, error.offset) == ("data", 0xFFFFFFFF, 3, 4)
    assert refusal(text(b"ab\x00", announced=4), String, StringOutOfBounds).bound == 3


@pytest.mark.parametrize("order", ["<", ">"])
def test_a_string_ends_with_its_nul(order):
    """A string without NUL, and the empty length that has no room for one, are refused."""
    check(text(b"\x00", order=order), String)
    check(text(b"ab\x00", order=order), String)
    assert str(refusal(text(b"abc", order=order), String, BadString)) == (
        "data: b'abc' is not a CDR string: the terminating NUL is missing (at byte 8)"
    )
    assert "terminating" in str(refusal(text(b"", order=order), String, BadString))


def test_a_string_has_no_nul_inside():
    """What encode would refuse to write, decode refuses to read."""
    assert str(refusal(text(b"a\x00b\x00"), String, BadString)) == (
        "data: b'a\\x00b\\x00' is not a CDR string: there is a NUL inside (at byte 8)"
    )


@pytest.mark.parametrize("raw", [b"\xff\x00", b"ok\xc3\x00", b"\xed\xa0\x80\x00", b"\xc0\xaf\x00"])
def test_a_string_is_utf8(raw):
    """Broken, truncated, surrogate and overlong sequences are refused; the offset is that of the bad byte."""
    error = refusal(text(raw), String, BadString)
    assert error.offset == 8 + len(raw) - len(raw.lstrip(b"ok"))
    assert (error.value, error.field) == (raw, "data")
    check(text("关节\x00".encode()), String)


def test_elements_are_named_by_their_index():
    """Among seven names the broken one is told."""
    data = bytearray(ros_encode(arm_state()))
    data[data.index(b"l_joint3")] = 0xFF
    assert refusal(bytes(data), JointState, BadString).field == "name[2]"


def test_the_encapsulation_is_checked_first():
    """A header that is not plain CDR ends the walk before it begins."""
    refusal(b"\x00\x07\x00\x00" + bytes(20), Header, WrongEncapsulation)
    refusal(b"", Header, Truncated)
