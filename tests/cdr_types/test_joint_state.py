from __future__ import annotations

import math
import struct
from concurrent.futures import ThreadPoolExecutor

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cdr_types import joint_state
from cdr_types.errors import BadString, CdrError, CountOutOfBounds, TrailingBytes, UnencodableValue
from cdr_types.generic import decode_generic, encode_generic
from cdr_types.joint_state import MAX_TEMPLATE_SIZE, MAX_TEMPLATES, decode_joint_state, encode_joint_state
from cdr_types.messages.builtin_interfaces import Time
from cdr_types.messages.sensor_msgs import JointState
from cdr_types.messages.std_msgs import Header
from tests.cdr_types.oracle import FLOATS, arm_state, messages, ros_decode, ros_encode

# Few names, frames and lengths, so that messages meet the templates of earlier ones, and of equally long others.
TEXT = st.sampled_from(["", "a", "ab", "left", "l_joint1", "r_joint1", "关"])
ARRAY = st.lists(FLOATS["float64"], max_size=3)
REPEATING = st.builds(
    JointState,
    header=st.builds(Header, stamp=messages(Time), frame_id=TEXT),
    name=st.lists(TEXT, max_size=3),
    position=ARRAY,
    velocity=ARRAY,
    effort=ARRAY,
)


@pytest.fixture(autouse=True)
def forget():
    """Begin and end without templates, so that no test lives on another's."""
    joint_state._readers.clear()
    joint_state._writers.clear()
    yield
    joint_state._readers.clear()
    joint_state._writers.clear()


def templates():
    """Return how many templates there are for reading and for writing."""
    return sum(map(len, joint_state._readers.values())), len(joint_state._writers)


def outcome(function, *arguments):
    """What a path answers: the message as text (NaN compares), or the whole error."""
    try:
        return repr(function(*arguments))
    except CdrError as error:
        return type(error), str(error)


def assert_paths_agree(data):
    """Twice: without a template and with the one that the first time left."""
    expected = outcome(decode_generic, data, JointState)
    assert outcome(decode_joint_state, data) == expected
    assert outcome(decode_joint_state, data) == expected


@pytest.mark.parametrize(
    "message",
    [
        JointState(),
        arm_state(),
        arm_state(frame_id=""),
        JointState(name=["l_joint8"], position=[0.5], velocity=[0.1], effort=[0.2]),
        JointState(name=["a"], position=[1.0]),
        JointState(name=["a", "bc"], velocity=[1.0]),
        JointState(effort=[math.nan, math.inf]),
        JointState(position=[-0.0], effort=[1.0, 2.0]),
        JointState(header=Header(stamp=Time(sec=-1, nanosec=2**32 - 1), frame_id="关节")),
    ],
)
def test_each_of_three_times_the_answer_is_that_of_the_generic_path(message):
    """The first teaches, the others are answered by a template."""
    expected = encode_generic(message)
    assert expected == message.serialize() == ros_encode(message)
    for _ in range(3):
        assert encode_joint_state(message) == expected
        assert repr(decode_joint_state(expected)) == repr(message) == repr(ros_decode(expected, JointState))
    assert templates() == (1, 1)


@given(st.lists(REPEATING, min_size=1, max_size=6), st.binary(max_size=3))
def test_templates_write_and_read_what_pycdr2_and_rosbags_do(states, padding):
    """Whatever came before, each message gets its own bytes, and each payload its own message."""
    for message in states + states:
        data = encode_joint_state(message)
        assert data == message.serialize() == ros_encode(message)
        assert decode_joint_state(data + padding) == message == decode_generic(data, JointState)


@given(messages(JointState))
def test_any_joint_state_makes_the_round_trip(message):
    """Not only those that repeat."""
    data = encode_joint_state(message)
    assert data == message.serialize() == ros_encode(message)
    assert decode_joint_state(data) == decode_joint_state(data) == message


@given(REPEATING, st.lists(st.tuples(st.integers(0, 400), st.integers(0, 255)), max_size=4))
def test_changed_bytes_get_the_answer_of_the_generic_path(message, changes):
    """A template was learnt from the intact payload; the changed one is answered as if there were none."""
    data = bytearray(encode_generic(message))
    decode_joint_state(bytes(data))
    for position, value in changes:
        data[position % len(data)] = value
    assert_paths_agree(bytes(data))


def test_every_single_changed_byte_gets_the_answer_of_the_generic_path():
    """All 332 bytes of an arm's state, each with three other values, against the template of the intact one."""
    intact = encode_generic(arm_state())
    for position in range(len(intact)):
        for flip in (0x01, 0x80, 0xFF):
            joint_state._readers.clear()
            decode_joint_state(intact)
            data = bytearray(intact)
            data[position] ^= flip
            assert_paths_agree(bytes(data))


def test_every_length_gets_the_answer_of_the_generic_path():
    """Cut anywhere or padded: templates belong to one length."""
    intact = encode_generic(arm_state())
    decode_joint_state(intact)
    for size in range(len(intact)):
        assert_paths_agree(intact[:size])
    for padding in (b"\x01", b"\x02\x03", b"\xff\xff\xff"):
        assert decode_joint_state(intact + padding) == decode_joint_state(intact + padding) == arm_state()
    with pytest.raises(TrailingBytes):
        decode_joint_state(intact + bytes(4))


def test_the_generic_path_is_asked_once(monkeypatch):
    """Otherwise the answers would be right and the speed gone."""
    states = [arm_state(), arm_state(frame_id="righ_arm", side="r"), JointState(name=["a"], velocity=[1.0])]
    payloads = [encode_joint_state(message) for message in states]
    for data in payloads:
        decode_joint_state(data)
    monkeypatch.setattr(joint_state, "encode_generic", None)
    monkeypatch.setattr(joint_state, "decode_generic", None)
    assert [encode_joint_state(message) for message in states] == payloads
    assert [decode_joint_state(data) for data in payloads] == states


def test_equally_long_states_of_two_arms_are_not_mixed_up():
    """Same length, other names: the constant bytes decide."""
    left, right = arm_state(side="l"), arm_state(frame_id="righ_arm", side="r")
    payloads = [encode_joint_state(message) for message in (left, right)]
    assert len(payloads[0]) == len(payloads[1])
    for _ in range(2):
        assert [decode_joint_state(data) for data in payloads] == [left, right]
    assert templates() == (2, 2)


def test_equally_long_states_with_other_counts_are_not_mixed_up():
    """Same length and constant bytes, two velocities and one effort or the other way round: the counts decide."""
    first = JointState(position=[1.0], velocity=[2.0, 3.0], effort=[4.0])
    second = JointState(position=[1.0], velocity=[2.0], effort=[3.0, 4.0])
    payloads = [encode_joint_state(message) for message in (first, second)]
    assert len(payloads[0]) == len(payloads[1])
    for _ in range(2):
        assert [decode_joint_state(data) for data in payloads] == [first, second]


def test_a_count_that_lies_is_refused_in_spite_of_a_template():
    """The counts between the arrays are part of the comparison."""
    intact = encode_joint_state(arm_state())
    decode_joint_state(intact)
    for count_at in (204, 268):  # velocities and efforts; test_codec.py pins these places
        data = bytearray(intact)
        assert data[count_at : count_at + 4] == struct.pack("<I", 7)
        data[count_at : count_at + 4] = struct.pack("<I", 0xFFFFFFFF)
        with pytest.raises(CountOutOfBounds):
            decode_joint_state(bytes(data))


def test_padding_in_front_of_numbers_carries_nothing():
    """Any value there is accepted, with and without a template."""
    intact = encode_joint_state(arm_state())
    for first, second in ((25, 28), (45, 48), (208, 212), (272, 276)):  # behind texts, in front of doubles
        joint_state._readers.clear()
        decode_joint_state(intact)
        data = bytearray(intact)
        assert not any(data[first:second])
        data[first:second] = b"\xab" * (second - first)
        for _ in range(2):
            assert decode_joint_state(bytes(data)) == arm_state()


def test_big_endian_is_read_but_never_learnt():
    """A template of swapped bytes would never answer; the cache does not fill with them."""
    data = ros_encode(arm_state(), little_endian=False)
    for _ in range(3):
        assert decode_joint_state(data) == arm_state()
    assert templates() == (0, 0)


def test_a_header_of_another_representation_is_refused_in_spite_of_a_template():
    """Only the first two bytes differ from what was learnt."""
    data = encode_joint_state(arm_state())
    decode_joint_state(data)
    for header in (b"\x00\x07", b"\x00\x00", b"\x01\x01", b"\xff\x01"):
        assert_paths_agree(header + data[2:])
    assert decode_joint_state(data[:2] + b"\xab\x03" + data[4:]) == arm_state()  # options say nothing


def test_results_share_nothing():
    """Changing a decoded message changes neither the next one nor the template."""
    data = encode_joint_state(arm_state())
    for _ in range(3):
        message = decode_joint_state(data)
        assert message == arm_state()
        message.name.append("extra")
        message.position.clear()
        message.header.stamp.sec = 0
        message.header.frame_id = "elsewhere"


def test_a_learnt_message_may_change_afterwards():
    """The writer's template holds bytes of its own."""
    message = arm_state()
    encode_joint_state(message)
    message.name[0] = "r_joint1"
    message.position.append(9.0)
    assert encode_joint_state(message) == ros_encode(message)


def test_fields_are_those_of_a_constructed_message():
    """Built without the constructor, but with nothing missing and nothing more."""
    data = encode_joint_state(arm_state())
    decode_joint_state(data)
    message = decode_joint_state(data)
    assert vars(message).keys() == vars(arm_state()).keys()
    assert vars(message.header).keys() == vars(Header()).keys()
    assert vars(message.header.stamp) == vars(arm_state().header.stamp)


def test_the_caches_are_bounded():
    """However many frames are seen, at most 64 templates of each direction are kept, and answers stay right."""
    for number in range(3 * MAX_TEMPLATES):
        message = arm_state(frame_id=f"frame{number}")
        data = encode_joint_state(message)
        assert data == ros_encode(message)
        assert decode_joint_state(data) == message
        assert max(templates()) <= MAX_TEMPLATES
    assert min(templates()) > 0


def test_long_payloads_leave_no_template():
    """Memory of the caches is bounded too: 2 x 64 x 4 KiB."""
    message = JointState(position=[0.5] * (MAX_TEMPLATE_SIZE // 8))
    for _ in range(2):
        assert decode_joint_state(encode_joint_state(message)) == message
    assert templates() == (0, 0)


@pytest.mark.parametrize(
    "change",
    [
        {"header": None},
        {"header": Header(stamp=None)},
        {"header": Header(stamp=Time(sec=0.5))},
        {"header": Header(stamp=Time(nanosec=-1))},
        {"header": Header(frame_id=["left_arm"])},
        {"header": Header(frame_id=b"left_arm")},
        {"header": type("Header", (), {"stamp": Time(), "frame_id": "left_arm"})()},
        {"header": Header(stamp=type("Time", (), {"sec": 0, "nanosec": 0})(), frame_id="left_arm")},
        {"name": "l_joint1"},
        {"name": None},
        {"name": [1, 2, 3, 4, 5, 6, 7]},
        {"name": ["l_joint1", []]},
        {"name": ["a\x00b"]},
        {"position": None},
        {"position": "1234567"},
        {"position": [0.0] * 6 + ["1.0"]},
        {"position": [0.0] * 6 + [10**400]},
        {"velocity": [None] * 7},
        {"position": dict.fromkeys(map(float, range(7)))},
        {"velocity": dict.fromkeys(map(float, range(7)))},
        {"effort": set(map(float, range(7)))},
        {"effort": 7},
        {"effort": [1j] * 7},
    ],
)
def test_what_cannot_be_written_is_worded_by_the_generic_path(change):
    """A template for the healthy message is there; the error is the same as without it."""
    encode_joint_state(arm_state())
    message = arm_state()
    for field, value in change.items():
        setattr(message, field, value)
    assert outcome(encode_joint_state, message) == outcome(encode_generic, message)
    with pytest.raises(UnencodableValue):
        encode_joint_state(message)


def test_the_letters_of_a_text_are_not_its_names():
    """Names given as one text are refused even where a template for its letters exists."""
    encode_joint_state(JointState(name=["a", "b", "c"]))
    with pytest.raises(UnencodableValue):
        encode_joint_state(JointState(name="abc"))


def test_tuples_are_written_like_lists():
    """Slower, and the same bytes."""
    message = arm_state()
    expected = encode_joint_state(message)
    message.name, message.position = tuple(message.name), tuple(message.position)
    assert encode_joint_state(message) == encode_joint_state(message) == expected


def test_a_missing_field_is_a_typed_error():
    """Dataclass instances are open; the fast path stumbles first and leaves the word to the generic one."""
    message = arm_state()
    encode_joint_state(message)
    del message.effort
    with pytest.raises(UnencodableValue):
        encode_joint_state(message)


def test_a_bad_name_is_refused_in_spite_of_a_template():
    """Names are compared as bytes, not by their length."""
    data = encode_joint_state(arm_state())
    decode_joint_state(data)
    with pytest.raises(BadString):
        decode_joint_state(data.replace(b"l_joint5", b"l_joint\xff"))


def test_threads_may_learn_at_the_same_time():
    """Readers see whole templates only; every answer is right."""
    states = [arm_state(frame_id=f"f{number}") for number in range(2 * MAX_TEMPLATES)]
    with ThreadPoolExecutor(4) as pool:
        results = list(pool.map(lambda message: decode_joint_state(encode_joint_state(message)), states * 3))
    assert results == states * 3
    assert max(templates()) <= MAX_TEMPLATES
