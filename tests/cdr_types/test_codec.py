from __future__ import annotations

import math
import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pycdr2 import IdlStruct

from cdr_types.codec import decode, encode
from cdr_types.errors import NotBytes, TrailingBytes, Truncated, UnencodableValue, UnknownType, WrongEncapsulation
from cdr_types.generic import decode_generic, encode_generic
from cdr_types.messages.builtin_interfaces import Time
from cdr_types.messages.geometry_msgs import Point, Pose, Quaternion
from cdr_types.messages.sensor_msgs import JointState
from cdr_types.messages.std_msgs import (
    Float32,
    Float32MultiArray,
    Float64,
    Header,
    Int32,
    MultiArrayDimension,
    MultiArrayLayout,
    String,
)
from cdr_types.registry import MESSAGE_TYPES
from tests.cdr_types.oracle import arm_state, messages, ros_decode, ros_encode

ANY_MESSAGE = st.sampled_from(MESSAGE_TYPES).flatmap(messages)

GOLDEN = [
    (
        Float32(data=1.0),
        "00 01 00 00"  # plain CDR, little endian; options
        "00 00 80 3f",  # data
    ),
    (
        Int32(data=2),  # /fsm_state READY (manual §4.11.1)
        "00 01 00 00"
        "02 00 00 00",
    ),
    (
        Float64(data=-2.0),
        "00 01 00 00"
        "00 00 00 00 00 00 00 c0",  # aligned to 8 from byte 4: no padding in front
    ),
    (
        String(data="abc"),
        "00 01 00 00"
        "04 00 00 00"  # length, NUL included
        "61 62 63 00",
    ),
    (
        String(data=""),
        "00 01 00 00"
        "01 00 00 00"
        "00",  # only the NUL; no padding behind it
    ),
    (
        Header(stamp=Time(sec=1, nanosec=2), frame_id="left_arm"),
        "00 01 00 00"
        "01 00 00 00"  # sec
        "02 00 00 00"  # nanosec
        "09 00 00 00"  # length
        "6c 65 66 74 5f 61 72 6d 00",
    ),
    (
        Pose(position=Point(x=1.0, y=-1.0, z=0.5), orientation=Quaternion(x=0.0, y=0.0, z=0.0, w=1.0)),
        "00 01 00 00"
        "00 00 00 00 00 00 f0 3f"  # position.x
        "00 00 00 00 00 00 f0 bf"  # position.y
        "00 00 00 00 00 00 e0 3f"  # position.z
        "00 00 00 00 00 00 00 00"  # orientation.x
        "00 00 00 00 00 00 00 00"  # orientation.y
        "00 00 00 00 00 00 00 00"  # orientation.z
        "00 00 00 00 00 00 f0 3f",  # orientation.w
    ),
    (
        Float32MultiArray(data=[0.5, 0.0, -1.0]),  # chassis velocity (manual §4.5)
        "00 01 00 00"
        "00 00 00 00"  # layout.dim: none
        "00 00 00 00"  # layout.data_offset
        "03 00 00 00"  # count
        "00 00 00 3f 00 00 00 00 00 00 80 bf",
    ),
    (
        Float32MultiArray(layout=MultiArrayLayout(dim=[MultiArrayDimension(label="x", size=1, stride=1)]), data=[2.0]),
        "00 01 00 00"
        "01 00 00 00"  # layout.dim: one
        "02 00 00 00 78 00"  # label
        "00 00"  # padding to 4
        "01 00 00 00"  # size
        "01 00 00 00"  # stride
        "00 00 00 00"  # layout.data_offset
        "01 00 00 00"  # count
        "00 00 00 40",
    ),
    (
        JointState(header=Header(frame_id="g"), name=["l_joint8"], position=[0.5], velocity=[], effort=[1.0]),
        "00 01 00 00"
        "00 00 00 00 00 00 00 00"  # header.stamp
        "02 00 00 00 67 00"  # header.frame_id
        "00 00"  # padding to 4
        "01 00 00 00"  # name: count
        "09 00 00 00 6c 5f 6a 6f 69 6e 74 38 00"  # name[0]
        "00 00 00"  # padding to 4
        "01 00 00 00"  # position: count at byte 40
        "00 00 00 00 00 00 e0 3f"  # position[0] at byte 44: 40 from byte 4, so no padding
        "00 00 00 00"  # velocity: none, and no alignment for it
        "01 00 00 00"  # effort: count
        "00 00 00 00 00 00 f0 3f",
    ),
]  # fmt: skip


@pytest.mark.parametrize(("message", "expected"), GOLDEN, ids=lambda value: type(value).__name__)
def test_golden_bytes(message, expected):
    """The bytes of each field, by hand; pycdr2 and rosbags agree."""
    data = bytes.fromhex(expected)
    for _ in range(2):  # the second time a template may answer
        assert encode(message) == data
        assert decode(data, type(message)) == message
    assert data == message.serialize() == ros_encode(message)


@pytest.mark.parametrize(
    ("message", "size"),
    [
        (Float32(data=1.0), 8),
        (Pose(), 60),
        (arm_state(frame_id=""), 324),
        (arm_state(frame_id="left_arm"), 332),
        (Float32MultiArray(data=[0.0, 0.0, 0.0]), 28),
    ],
)
def test_sizes_are_those_of_the_reference(message, size):
    """Header included (wire.md 1.2)."""
    assert len(encode(message)) == len(encode(message)) == size


def test_the_places_of_an_arm_state():
    """Where each part of the 332 bytes lies; other tests point into them."""
    data = encode(arm_state())
    assert data[4:12] == struct.pack("<iI", 1_700_000_000, 123_456_789)  # stamp
    assert data[12:25] == b"\x09\x00\x00\x00left_arm\x00"  # frame
    assert data[28:32] == b"\x07\x00\x00\x00"  # names
    assert data[32:45] == b"\x09\x00\x00\x00l_joint1\x00"
    assert data[144:148] == b"\x07\x00\x00\x00"  # positions
    assert data[148:204] == struct.pack("<7d", *arm_state().position)
    assert data[204:208] == b"\x07\x00\x00\x00"  # velocities
    assert data[208:212] == bytes(4)  # alignment to 8
    assert data[212:268] == struct.pack("<7d", *arm_state().velocity)
    assert data[268:272] == b"\x07\x00\x00\x00"  # efforts
    assert data[276:332] == struct.pack("<7d", *arm_state().effort)


@given(ANY_MESSAGE, st.binary(max_size=3))
def test_every_type_makes_the_round_trip_with_padding(message, padding):
    """Decode undoes encode; pycdr2 and rosbags write the same bytes and rosbags reads the same message."""
    cls = type(message)
    data = encode(message)
    assert data == message.serialize() == ros_encode(message)
    assert decode(data + padding, cls) == message
    assert ros_decode(data, cls) == message


@given(ANY_MESSAGE)
def test_big_endian_is_decoded(message):
    """The twin of each payload, as a big-endian writer would send it."""
    assert decode(ros_encode(message, little_endian=False), type(message)) == message


@given(ANY_MESSAGE)
def test_the_path_makes_no_difference(message):
    """Fast or generic: the same bytes, the same fields."""
    data = encode(message)
    assert data == encode_generic(message)
    assert repr(decode(data, type(message))) == repr(decode_generic(data, type(message)))


@pytest.mark.parametrize("cls", MESSAGE_TYPES)
def test_every_type_refuses_what_is_no_payload(cls):
    """Nothing, too little, another representation, too much."""
    data = encode(cls())
    with pytest.raises(Truncated):
        decode(b"", cls)
    with pytest.raises(Truncated):
        decode(data[:3], cls)
    with pytest.raises(WrongEncapsulation):
        decode(b"\x00\x07" + data[2:], cls)
    with pytest.raises(TrailingBytes):
        decode(data + bytes(4), cls)
    assert decode(data + b"\xff\xff\xff", cls) == cls()


@pytest.mark.parametrize("convert", [bytearray, memoryview, lambda data: type("Sub", (bytes,), {})(data)])
def test_every_kind_of_bytes_is_decoded(convert):
    """Whatever the transport hands out."""
    assert decode(convert(encode(arm_state())), JointState) == arm_state()
    assert decode(convert(encode(String(data="x"))), String) == String(data="x")


@pytest.mark.parametrize("data", [None, "text", 8, [0, 1, 0, 0]])
def test_what_is_no_bytes_is_refused(data):
    """A typed error, not what `bytes()` would make of it."""
    with pytest.raises(NotBytes):
        decode(data, Float32)


@pytest.mark.parametrize("cls", [IdlStruct, dict, None, [], type("Float32", (Float32,), {})])
def test_unknown_classes_are_refused(cls):
    """Only the registered classes are decoded and encoded; a subclass may have other fields."""
    with pytest.raises(UnknownType):
        decode(b"\x00\x01\x00\x00\x00\x00\x80\x3f", cls)


@pytest.mark.parametrize("message", [None, 1.0, {"data": 1.0}, type("Float32", (Float32,), {})(data=1.0), Float32])
def test_unknown_messages_are_refused(message):
    """The class itself is no message either."""
    with pytest.raises(UnknownType):
        encode(message)


def test_unencodable_fields_are_refused():
    """One of each path."""
    for message in (
        Float32(data=1e39),
        String(data=5),
        JointState(name=["a\x00"]),
        Int32(data=2**31),
        Pose(position=1),
    ):
        with pytest.raises(UnencodableValue):
            encode(message)


@pytest.mark.parametrize("number", [math.nan, math.inf, -math.inf, -0.0, 5e-324])
def test_numbers_are_not_judged(number):
    """NaN, infinities, signed zero and denormals pass both ways; limits are not this layer's business."""
    message = JointState(position=[number], effort=[number])
    assert repr(decode(encode(message), JointState)) == repr(message)
    assert repr(decode(encode(Pose(position=Point(x=number))), Pose).position.x) == repr(number)
