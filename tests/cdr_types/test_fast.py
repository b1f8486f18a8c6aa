from __future__ import annotations

import math
import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cdr_types import fast
from cdr_types.errors import CdrError, TrailingBytes, Truncated, UnencodableValue
from cdr_types.generic import decode_generic, encode_generic
from cdr_types.messages.geometry_msgs import Point, Pose, Quaternion
from cdr_types.messages.std_msgs import Float32, Float32MultiArray, Int32, MultiArrayDimension, MultiArrayLayout
from tests.cdr_types.oracle import messages, ros_decode, ros_encode

PATHS = {
    Float32: (fast.decode_float32, fast.encode_float32),
    Float32MultiArray: (fast.decode_float32_array, fast.encode_float32_array),
    Int32: (fast.decode_int32, fast.encode_int32),
    Pose: (fast.decode_pose, fast.encode_pose),
}
SAMPLES = [
    Float32(data=-0.5),
    Float32(data=math.nan),
    Float32MultiArray(data=[0.25, -0.5, 0.0]),
    Float32MultiArray(data=[math.inf, math.nan]),
    Float32MultiArray(),
    Float32MultiArray(layout=MultiArrayLayout(dim=[MultiArrayDimension(label="a", size=2, stride=2)]), data=[1.0, 2.0]),
    Float32MultiArray(layout=MultiArrayLayout(data_offset=7), data=[1.0]),
    Int32(data=-1),
    Pose(position=Point(0.3, -0.2, 0.1), orientation=Quaternion(0.0, 0.0, -0.6, 0.8)),
    Pose(position=Point(math.nan, math.inf, -0.0)),
]
ANY_MESSAGE = st.sampled_from(list(PATHS)).flatmap(messages)
ANY_BYTES = st.one_of(
    st.binary(max_size=80),
    st.binary(max_size=80).map(lambda rest: b"\x00\x01\x00\x00" + rest),
    # Float32MultiArray without dimensions, with a count that may be true
    st.tuples(st.integers(0, 6), st.binary(max_size=32)).map(
        lambda pair: b"\x00\x01\x00\x00" + bytes(8) + struct.pack("<I", pair[0]) + pair[1]
    ),
)


def outcome(function, *arguments):
    """What a path answers: the message as text (NaN compares), or the whole error."""
    try:
        return repr(function(*arguments))
    except CdrError as error:
        return type(error), str(error)


@pytest.mark.parametrize("message", SAMPLES)
def test_fast_and_generic_paths_agree_on_samples(message):
    """Bytes, fields, both byte orders, padding: nothing but the clock tells the paths apart."""
    cls = type(message)
    decode, encode = PATHS[cls]
    data = encode(message)
    assert data == encode_generic(message) == message.serialize() == ros_encode(message)
    for payload in (data, data + b"\x01\x02\x03", ros_encode(message, little_endian=False)):
        assert repr(decode(payload)) == repr(decode_generic(payload, cls)) == repr(message)


@given(ANY_MESSAGE)
def test_fast_paths_write_what_pycdr2_and_rosbags_write(message):
    """Byte-identical for any message."""
    _, encode = PATHS[type(message)]
    assert encode(message) == message.serialize() == ros_encode(message)


@given(ANY_MESSAGE, st.binary(max_size=3))
def test_fast_paths_read_what_others_wrote(message, padding):
    """Little endian with padding and big endian give the message that went in."""
    decode, _ = PATHS[type(message)]
    data = ros_encode(message)
    assert decode(data + padding) == message == ros_decode(data, type(message))
    assert decode(ros_encode(message, little_endian=False)) == message


@given(st.sampled_from(list(PATHS)), ANY_BYTES)
def test_fast_and_generic_paths_agree_on_any_bytes(cls, data):
    """Same message or same error, word by word."""
    decode, _ = PATHS[cls]
    assert outcome(decode, data) == outcome(decode_generic, data, cls)


@pytest.mark.parametrize("message", SAMPLES)
def test_every_length_gets_the_answer_of_the_generic_path(message):
    """Cut short, padded and too long: the length rules are the same."""
    cls = type(message)
    decode, encode = PATHS[cls]
    data = encode(message) + bytes(8)
    for size in range(len(data) + 1):
        assert outcome(decode, data[:size]) == outcome(decode_generic, data[:size], cls)


@pytest.mark.parametrize("message", [Float32(data=0.5), Int32(data=-3), Pose(), Float32MultiArray(data=[0.5, 1.0])])
def test_a_healthy_message_does_not_need_the_generic_path(message, monkeypatch):
    """Otherwise the answers would be right and the speed gone."""
    monkeypatch.setattr(fast, "encode_generic", None)
    monkeypatch.setattr(fast, "decode_generic", None)
    decode, encode = PATHS[type(message)]
    assert decode(encode(message)) == decode(encode(message) + b"\x00") == message


def test_a_float32_of_eight_bytes():
    """The golden bytes of wire.md 1.2."""
    data = bytes.fromhex("00 01 00 00 00 00 80 3f")
    assert fast.encode_float32(Float32(data=1.0)) == data
    assert fast.decode_float32(data) == Float32(data=1.0)
    with pytest.raises(Truncated):
        fast.decode_float32(data[:6])  # Fast DDS would decode this as 7.2e-43
    with pytest.raises(TrailingBytes):
        fast.decode_float32(data + bytes(4))


@pytest.mark.parametrize(
    "message",
    [
        Float32(data="1"),
        Float32(data=1e39),
        Int32(data=2**31),
        Int32(data=0.5),
        Int32(data=None),
        Pose(position=Point(x="left")),
        Pose(position=Point(x=10**400)),
        Pose(position=Quaternion()),
        Pose(orientation=None),
        Pose(orientation=type("Quaternion", (), {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0})()),
        Float32MultiArray(data=[1e39]),
        Float32MultiArray(data=["1"]),
        Float32MultiArray(data="12"),
        Float32MultiArray(data=5),
        Float32MultiArray(data={1.0: 2.0}),
        Float32MultiArray(layout=None),
        Float32MultiArray(layout=MultiArrayLayout(dim=())),
        Float32MultiArray(layout=MultiArrayLayout(dim=None)),
        Float32MultiArray(layout=MultiArrayLayout(data_offset=-1)),
    ],
)
def test_what_cannot_be_written_is_worded_by_the_generic_path(message):
    """Same error; or the same bytes, for the empty tuple that the generic path takes."""
    _, encode = PATHS[type(message)]
    assert outcome(encode, message) == outcome(encode_generic, message)


@pytest.mark.parametrize(
    ("cls", "field"), [(Float32, "data"), (Int32, "data"), (Pose, "position"), (Float32MultiArray, "data")]
)
def test_a_missing_field_is_a_typed_error(cls, field):
    """Also where the fast path stumbles over it first."""
    message = cls()
    setattr(message, field, None)
    with pytest.raises(UnencodableValue):
        PATHS[cls][1](message)
    if cls in (Pose, Float32MultiArray):
        delattr(message, field)
        with pytest.raises(UnencodableValue):
            PATHS[cls][1](message)
