from __future__ import annotations

import sys
from concurrent.futures import ThreadPoolExecutor

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cdr_types.errors import DecodeError, Truncated, UnencodableValue
from cdr_types.generic import decode_generic, encode_generic
from cdr_types.messages.sensor_msgs import JointState
from cdr_types.messages.std_msgs import Float32, Header, String
from cdr_types.registry import MESSAGE_TYPES
from tests.cdr_types.oracle import arm_state, messages, ros_decode, ros_encode

ANY_MESSAGE = st.sampled_from(MESSAGE_TYPES).flatmap(messages)


@given(ANY_MESSAGE)
def test_the_bytes_are_those_of_pycdr2_and_of_rosbags(message):
    """Three writers, one payload."""
    data = encode_generic(message)
    assert data == message.serialize() == ros_encode(message)


@given(ANY_MESSAGE, st.booleans())
def test_what_another_writer_wrote_is_read_back(message, little_endian):
    """Both byte orders give the message that went in, and the one that rosbags reads."""
    data = ros_encode(message, little_endian=little_endian)
    assert decode_generic(data, type(message)) == message
    assert ros_decode(ros_encode(message), type(message)) == message


@pytest.mark.parametrize("cls", MESSAGE_TYPES)
def test_an_empty_payload_is_no_message(cls):
    """pycdr2 alone decodes it into a default message (wire.md 1.2)."""
    assert isinstance(cls.deserialize(b""), cls)
    with pytest.raises(Truncated):
        decode_generic(b"", cls)


def test_a_broken_payload_never_reaches_pycdr2():
    """The walk refuses it first, with a typed error."""
    with pytest.raises(DecodeError):
        decode_generic(b"\x00\x01\x00\x00\xff\xff\xff\xff", String)


def test_a_broken_message_never_reaches_pycdr2():
    """The check refuses it first, with a typed error."""
    with pytest.raises(UnencodableValue):
        encode_generic(Float32(data="1"))


def test_threads_do_not_see_each_other():
    """pycdr2's own buffer is shared per type; four writers at once still write what one writes."""
    inputs = [arm_state(frame_id=f"frame{'x' * number}") for number in range(8)]
    expected = [ros_encode(message) for message in inputs]
    interval = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    try:
        with ThreadPoolExecutor(4) as pool:
            written = list(pool.map(encode_generic, inputs * 50))
            read = list(pool.map(lambda data: decode_generic(data, JointState), expected * 20))
    finally:
        sys.setswitchinterval(interval)
    assert written == expected * 50
    assert read == inputs * 20


def test_the_result_is_little_endian_and_exact():
    """Header `00 01 00 00`, no padding behind the text of five bytes."""
    assert encode_generic(Header(frame_id="abcd")) == (
        b"\x00\x01\x00\x00"  # plain CDR, little endian
        b"\x00\x00\x00\x00\x00\x00\x00\x00"  # stamp
        b"\x05\x00\x00\x00abcd\x00"  # length with NUL, text, NUL
    )
