"""Rules of `gateway.link.shortcuts`: what the long way gives, or nothing; never a value that the long way refuses."""

from __future__ import annotations

import math
import random
import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cdr_types import encode
from cdr_types.messages import geometry_msgs
from gateway.link import codec
from gateway.link.codec import BadSample, decode_sample, encode_frame, from_message, to_message
from gateway.link.shortcuts import JointWriter, MotorReader, read_pose
from gateway.robot.topics import JOINT_STATE, STATE_TOPICS, TOPICS, arm_state, ee_pose, joint_command
from gateway.values import ArmState, EePose, MotorState, Side
from tests.link.stand_in import state_message

S = 1_000_000_000
ARM = arm_state(Side.LEFT)
MOTORS = [topic for topic in STATE_TOPICS if TOPICS[topic].type_name == JOINT_STATE]
NUMBER = st.floats(allow_nan=True, allow_infinity=True)


def message_of(topic: str, numbers: list[float], stamp_ns: int = 7, frame: str = "part"):
    """Return a motor state with these positions, velocities and efforts."""
    message = state_message(topic, stamp_ns)
    width = TOPICS[topic].width
    message.header.frame_id = frame
    message.position, message.velocity, message.effort = (numbers[k * width : (k + 1) * width] for k in range(3))
    return message


def reader_of(topic: str, frame: str = "part", tail: bytes = b"") -> MotorReader:
    """Return a reader that has learnt a topic's form."""
    message = message_of(topic, [0.5] * 3 * TOPICS[topic].width, frame=frame)
    value = from_message(topic, message)
    assert isinstance(value, MotorState)
    reader = MotorReader(TOPICS[topic], type(value))
    reader.learn(encode(message) + tail, value)
    return reader


def long_way(topic: str, message) -> MotorState | None:
    """Return what the long way makes of a message; None when it refuses it."""
    try:
        value = from_message(topic, message)
    except BadSample:
        return None
    assert isinstance(value, MotorState)
    return value


@given(
    topic=st.sampled_from(MOTORS),
    numbers=st.lists(NUMBER, min_size=21, max_size=21),
    stamp_ns=st.integers(0, 2**31 * S - 1),
    frame=st.sampled_from(["", "a", "part", "left_arm", "ein Rahmen"]),
)
def test_motors_are_read_as_on_the_long_way(topic, numbers, stamp_ns, frame):
    """Equal in type and in every field; what is not finite is left to the long way, and so is nothing else of this form."""
    message = message_of(topic, numbers, stamp_ns, frame)
    expected = long_way(topic, message)
    value = reader_of(topic, frame).read(encode(message))
    if value is None:
        assert not math.isfinite(sum(numbers[: 3 * TOPICS[topic].width]))
    else:
        assert type(value) is type(expected)
        assert value == expected


@pytest.mark.parametrize("topic", MOTORS)
@pytest.mark.parametrize("padding", [0, 1, 2, 3])
def test_padding_of_the_wire_is_no_number(topic, padding):
    """Up to three bytes may follow (wire.md 1.2), as long as they always do; another number of them is another form."""
    message = message_of(topic, [0.25] * 21)
    reader = reader_of(topic, tail=bytes(padding))
    assert reader.read(encode(message) + bytes(padding)) == from_message(topic, message)
    assert reader.read(encode(message) + bytes(padding + 1)) is None


@pytest.mark.parametrize("topic", MOTORS)
def test_nothing_is_read_before_anything_was_learnt(topic):
    """The long way comes first."""
    assert MotorReader(TOPICS[topic], MotorState).read(encode(state_message(topic, 1))) is None


def test_a_form_without_all_numbers_or_of_another_byte_order_teaches_nothing():
    """They are rare: the long way serves them."""
    message = message_of(ARM, [0.5] * 21)
    message.velocity = []
    value = from_message(ARM, message)
    reader = MotorReader(TOPICS[ARM], ArmState)
    reader.learn(encode(message), value)
    assert reader.read(encode(message)) is None
    full = message_of(ARM, [0.5] * 21)
    big = b"\x00\x00" + encode(full)[2:]
    reader.learn(big, from_message(ARM, full))
    assert reader.read(big) is None


@pytest.mark.parametrize(
    "change",
    [
        lambda data: b"\x00\x00" + data[2:],
        lambda data: data[:8] + struct.pack("<I", S) + data[12:],
        lambda data: data.replace(b"l_joint3", b"l_joint9"),
        lambda data: data[:-4],
        lambda data: data + b"\0",
        lambda data: data[: -2 * 64] + struct.pack("<I", 6) + data[-2 * 64 + 4 :],
        lambda data: data[:-64] + struct.pack("<I", 8) + data[-64 + 4 :],
    ],
    ids=["big endian", "nanoseconds", "name", "shorter", "longer", "velocities", "efforts"],
)
def test_whatever_is_different_takes_the_long_way(change):
    """Another order, name, length, count, or a stamp that cannot be."""
    data = encode(message_of(ARM, [0.5] * 21))
    reader = reader_of(ARM)
    assert reader.read(data) is not None
    changed = change(data)
    assert changed != data
    assert reader.read(changed) is None


def test_damaged_payloads_are_read_as_on_the_long_way():
    """Of 20,000 payloads with changed bytes each gives what a codec that has learnt nothing gives, or is left to it."""
    rng = random.Random(20261121)
    reader = reader_of(ARM)
    good = encode(message_of(ARM, [0.1 * k for k in range(21)]))
    read = 0
    for _ in range(20_000):
        data = bytearray(good)
        for _ in range(rng.randint(1, 2)):
            data[rng.randrange(len(data))] = rng.randrange(256)
        value = reader.read(bytes(data))
        if value is not None:
            read += 1
            assert value == from_message(ARM, codec.decode(bytes(data), type(state_message(ARM, 1))))
    assert 5_000 < read < 20_000


@given(numbers=st.lists(NUMBER, min_size=3, max_size=3), q=st.lists(st.floats(-1.1, 1.1), min_size=4, max_size=4))
def test_poses_are_read_as_on_the_long_way(numbers, q):
    """The same position and the same unit quaternion; another norm, or what is not finite, is left to the long way."""
    message = geometry_msgs.Pose(position=geometry_msgs.Point(*numbers), orientation=geometry_msgs.Quaternion(*q))
    pose = read_pose(encode(message))
    try:
        expected = from_message(ee_pose(Side.LEFT), message)
    except BadSample:
        expected = None
    if pose is not None:
        assert type(pose) is EePose
        assert pose == expected
    else:
        assert expected is None or not math.isfinite(sum(numbers))


def test_payloads_that_are_no_pose_are_left_to_the_long_way():
    """Another length or another byte order."""
    data = encode(state_message(ee_pose(Side.LEFT), 1))
    assert read_pose(data) is not None
    assert read_pose(data + b"\0") is None
    assert read_pose(b"\x00\x00" + data[2:]) is None


@pytest.mark.parametrize("side", Side)
@given(values=st.lists(st.floats(-3.0, 3.0), min_size=7, max_size=7), wall_ns=st.integers(0, 2**31 * S - 1))
def test_setpoints_are_written_byte_by_byte_as_on_the_long_way(side, values, wall_ns):
    """Names, stamp, positions, and zeros as velocity and effort (manual §6.5)."""
    topic = joint_command(side)
    assert encode_frame(topic, tuple(values), wall_ns) == encode(to_message(topic, tuple(values), wall_ns))


@pytest.mark.parametrize(
    ("values", "wall_ns"),
    [
        ((0.0,) * 6, 1),
        ((0.0,) * 8, 1),
        ((math.nan,) * 7, 1),
        ((math.inf,) * 7, 1),
        ((0.0,) * 7, 2**31 * S),
        ((0.0,) * 7, -1),
    ],
)
def test_setpoints_that_are_wrong_or_of_another_age_take_the_long_way(values, wall_ns):
    """It says what is wrong; and a clock beyond 2038 does not stop the stream."""
    topic = joint_command(Side.LEFT)
    writer = JointWriter(encode(to_message(topic, (0.5,) * 7, 1)), 7)
    assert writer.write((0.5,) * 7, 1) == encode(to_message(topic, (0.5,) * 7, 1))
    assert writer.write(values, wall_ns) is None


def test_the_codec_takes_the_shortcut_from_the_second_sample_on(monkeypatch):
    """Of a stream of payloads of one form only the first is decoded as a message."""
    decoded = []
    decode = codec.decode
    monkeypatch.setattr(codec, "decode", lambda data, kind: decoded.append(data) or decode(data, kind))
    payloads = [encode(message_of(ARM, [0.01 * n] * 21, stamp_ns=n, frame="a frame of its own")) for n in range(5)]
    for payload in payloads:
        assert decode_sample(ARM, payload).stamp_ns == payloads.index(payload)
    assert decoded == payloads[:1]
