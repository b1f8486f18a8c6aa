"""Rules of `gateway.link.codec`: a sample is believed whole or refused with a code; a frame is exact or not sent."""

from __future__ import annotations

import json
import math
import random
import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cdr_types import encode
from cdr_types.messages import builtin_interfaces, geometry_msgs, sensor_msgs, std_msgs
from gateway.errors import Code
from gateway.link import codec
from gateway.link.codec import (
    FRAME_BYTES,
    MAX_MODE_CHARACTERS,
    BadFrame,
    BadSample,
    decode_sample,
    encode_frame,
    from_message,
    stamp_of,
    to_message,
)
from gateway.robot.topics import (
    ARM_JOINTS,
    CHASSIS_VELOCITY,
    COMMAND_TOPICS,
    CURRENT_MODE,
    FSM_ENABLE,
    FSM_STATE,
    JOINT_NAMES,
    JOINT_STATE,
    LIFT_COMMAND,
    STATE_TOPICS,
    TOPICS,
    arm_state,
    ee_pose,
)
from gateway.values import ArmState, CurrentMode, EePose, MotorState, Side
from tests.link.stand_in import MODE, state_message
from tests.thoroughness import either

S = 1_000_000_000
STAMP_NS = 1_784_019_894_898_864_727
JOINT_TOPICS = tuple(JOINT_NAMES)
LEFT_ARM = arm_state(Side.LEFT)
POSE = ee_pose(Side.RIGHT)
FUZZED_PAYLOADS = either(20_000, 100_000)


def refusal(topic, message) -> BadSample:
    """Return the error of a message that must be refused, and check that its payload is refused alike."""
    with pytest.raises(BadSample) as caught:
        decode_sample(topic, encode(message))
    with pytest.raises(BadSample) as direct:
        from_message(topic, message)
    assert (direct.value.code, direct.value.message) == (caught.value.code, caught.value.message)
    return caught.value


def joints(topic=LEFT_ARM, **changes) -> sensor_msgs.JointState:
    """Return a good joint state with some fields changed."""
    message = state_message(topic, STAMP_NS)
    for name, value in changes.items():
        setattr(message, name, value)
    return message


def mode(**changes) -> std_msgs.String:
    """Return a good mode with some keys changed; None removes a key."""
    fields = {key: value for key, value in {**MODE, **changes}.items() if value is not None}
    return std_msgs.String(data=json.dumps(fields))


# ------------------------------------------------------------------------------------------------------ from the robot


@pytest.mark.parametrize("topic", STATE_TOPICS)
def test_every_state_topic_is_understood(topic):
    """Each topic of the table has a value type, from bytes and from the message alike."""
    message = state_message(topic, STAMP_NS)
    value = decode_sample(topic, encode(message))
    assert value == from_message(topic, message)
    assert stamp_of(value) == (STAMP_NS if topic in JOINT_TOPICS else None)


def test_an_arm_sample_of_the_manual_is_read_exactly():
    """The sample of §4.8 (left arm), number by number."""
    position = [0.6281642913818359, 1.2304353713989258, -0.8568053245544434, 0.97955322265625]
    position += [1.116501808166504, 0.3784332275390625, 0.5717735290527344]
    velocity = [-0.046921730041503906, 0.0785074234008789, -0.24750137329101562, 0.5203323364257812]
    velocity += [0.7365226745605469, 0.23414993286132812, -0.8716392517089844]
    effort = [11.471725463867188, 0.9686431884765625, 2.859233856201172, 5.0968170166015625]
    effort += [-0.18806838989257812, 0.000213623046875, 0.6299839019775391]
    message = joints(position=position, velocity=velocity, effort=effort)
    message.header.frame_id = "left_arm"
    assert decode_sample(LEFT_ARM, encode(message)) == ArmState(
        q_rad=tuple(position), dq_radps=tuple(velocity), tau_nm=tuple(effort), stamp_ns=STAMP_NS
    )


@pytest.mark.parametrize("topic", JOINT_TOPICS)
def test_motors_are_an_arm_or_a_group_of_the_right_size(topic):
    """Arms have seven joints, grippers one motor, the chassis three (§4.1.1)."""
    value = decode_sample(topic, encode(state_message(topic, STAMP_NS)))
    assert isinstance(value, ArmState) == topic.endswith("_arm/joint_states")
    assert isinstance(value, MotorState)
    assert len(value.q_rad) == len(JOINT_NAMES[topic])


@pytest.mark.parametrize("topic", JOINT_TOPICS)
@pytest.mark.parametrize("fields", [("velocity",), ("effort",), ("velocity", "effort")])
def test_velocity_and_effort_may_be_left_out(topic, fields):
    """A robot that sends no velocities still has positions."""
    value = from_message(topic, joints(topic, **{name: [] for name in fields}))
    assert value.q_rad == (0.25,) * len(JOINT_NAMES[topic])


def test_up_to_three_bytes_of_padding_are_normal():
    """RTPS pads the payload to a multiple of four and the bridge does not cut it (wire.md 1.2)."""
    data = encode(mode())
    for padding in (b"", b"\x00", b"\xff\x01", b"abc"):
        assert decode_sample(CURRENT_MODE, data + padding) == decode_sample(CURRENT_MODE, data)
    with pytest.raises(BadSample):
        decode_sample(CURRENT_MODE, data + b"four")


def test_names_in_another_order_mean_another_robot():
    """The robot reads by index and never reorders: the same names swapped are JOINT_ORDER, with both lists told."""
    names = list(ARM_JOINTS[Side.LEFT])
    names[0], names[1] = names[1], names[0]
    error = refusal(LEFT_ARM, joints(name=names))
    assert error.code is Code.JOINT_ORDER
    assert "l_joint2" in error.message and "§4.0.3" in error.message


def test_the_names_of_the_other_arm_mean_another_robot():
    """Left names on the right arm's topic are refused as JOINT_ORDER."""
    message = joints(arm_state(Side.RIGHT), name=list(ARM_JOINTS[Side.LEFT]))
    assert refusal(arm_state(Side.RIGHT), message).code is Code.JOINT_ORDER


@pytest.mark.parametrize("topic", JOINT_TOPICS)
def test_missing_names_are_refused_as_a_bad_sample(topic):
    """Without names nothing is known of the order, but nothing contradicts it either: no JOINT_ORDER (§4.8)."""
    error = refusal(topic, joints(topic, name=[]))
    assert error.code is Code.SAMPLE_REFUSED
    assert "name has 0 entries" in error.message


@pytest.mark.parametrize("topic", JOINT_TOPICS)
@pytest.mark.parametrize("field", ["name", "position", "velocity", "effort"])
@pytest.mark.parametrize("change", [-1, 1])
def test_arrays_of_another_length_are_refused(topic, field, change):
    """One entry too few or too many in any array; names of another length are no JOINT_ORDER."""
    message = state_message(topic, STAMP_NS)
    values = getattr(message, field)
    values[:] = values[:-1] if change < 0 else [*values, values[0]]
    if field in ("velocity", "effort") and not values:
        assert from_message(topic, message)  # one motor without velocity: left out, see above
        return
    assert refusal(topic, message).code is Code.SAMPLE_REFUSED


@pytest.mark.parametrize("field", ["position", "velocity", "effort"])
@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("topic", JOINT_TOPICS)
def test_numbers_that_are_not_finite_are_refused(topic, field, value):
    """NaN or infinity in any element refuses the sample, with the element named."""
    message = state_message(topic, STAMP_NS)
    getattr(message, field)[-1] = value
    error = refusal(topic, message)
    assert error.code is Code.SAMPLE_REFUSED
    assert f"{field}[{len(JOINT_NAMES[topic]) - 1}]" in error.message


def test_a_stamp_with_a_second_of_nanoseconds_is_refused():
    """`nanosec` is below 10^9; a stamp that is not a time would upset the lag of samples."""
    message = joints()
    message.header.stamp = builtin_interfaces.Time(sec=1, nanosec=S)
    assert "nanosec" in refusal(LEFT_ARM, message).message


def test_a_stamp_before_1970_is_a_number_like_any_other():
    """The robot's clock may be off by anything; only differences are used."""
    message = joints()
    message.header.stamp = builtin_interfaces.Time(sec=-2, nanosec=5)
    assert stamp_of(from_message(LEFT_ARM, message)) == -2 * S + 5


def test_a_pose_keeps_its_order_and_gets_unit_norm():
    """Position xyz, orientation xyzw (§4.2); a norm within 5 % is made 1."""
    message = geometry_msgs.Pose(
        position=geometry_msgs.Point(x=0.1, y=0.2, z=0.3),
        orientation=geometry_msgs.Quaternion(x=0.0, y=0.0, z=0.6, w=0.81),
    )
    value = decode_sample(POSE, encode(message))
    norm = math.hypot(0.6, 0.81)
    assert isinstance(value, EePose)
    assert value.p_m == (0.1, 0.2, 0.3)
    assert value.quat_xyzw == pytest.approx((0.0, 0.0, 0.6 / norm, 0.81 / norm), abs=1e-15)


@pytest.mark.parametrize("quaternion", [(0.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.2), (math.nan, 0.0, 0.0, 1.0)])
def test_an_orientation_that_is_none_is_refused(quaternion):
    """All zeros, a norm far from 1, NaN."""
    message = state_message(POSE, 0)
    message.orientation = geometry_msgs.Quaternion(*quaternion)
    assert refusal(POSE, message).code is Code.SAMPLE_REFUSED


@pytest.mark.parametrize("value", [-1, 0, 1, 2, 3, 4, 5, 6, 7, 2**31 - 1, -(2**31)])
def test_the_fsm_state_is_passed_on_raw(value):
    """Unknown values are the engine's to judge, not the codec's (§4.11.1)."""
    assert decode_sample(FSM_STATE, encode(std_msgs.Int32(data=value))) == value


@pytest.mark.parametrize("yes", [1, True])
@pytest.mark.parametrize("no", [0, False])
def test_the_mode_may_be_written_with_numbers_or_booleans(yes, no):
    """§4.11.2 does not say which; unknown keys are none of our business."""
    fields = dict.fromkeys(MODE, no) | {"meta_mode": yes, "enable_left_arm": yes, "right_arm_control_mode": yes}
    text = std_msgs.String(data=json.dumps({**fields, "new_in_the_next_release": [1]}))
    assert from_message(CURRENT_MODE, text) == CurrentMode(
        api=True,
        joint_mode={Side.LEFT: False, Side.RIGHT: True},
        arm_enabled={Side.LEFT: True, Side.RIGHT: False},
        chassis_enabled=False,
        lift_enabled=False,
        collision_check=False,
    )


@pytest.mark.parametrize("key", sorted(MODE))
def test_a_mode_without_a_key_is_refused_with_the_key_named(key):
    """A part that is not mentioned must not count as switched off."""
    error = refusal(CURRENT_MODE, mode(**{key: None}))
    assert error.code is Code.SAMPLE_REFUSED
    assert key in error.message and "missing" in error.message


@pytest.mark.parametrize("key", sorted(MODE))
@pytest.mark.parametrize("value", [2, -1, 1.0, "1", [], {}, 10**40])
def test_a_mode_with_another_value_is_refused_with_the_key_named(key, value):
    """Only 0, 1, false and true are documented."""
    error = refusal(CURRENT_MODE, mode(**{key: value}))
    assert key in error.message and "0 or 1" in error.message


def test_a_null_in_the_mode_is_refused():
    """JSON's null is no flag."""
    text = json.dumps({**MODE, "meta_mode": None})
    assert "meta_mode" in refusal(CURRENT_MODE, std_msgs.String(data=text)).message


@pytest.mark.parametrize(
    "text", ["", "{", "[]", "null", "1", '"text"', "{'meta_mode': 1}", "[" * 16_000, "9" * 16_000, "\ufeff{}"]
)
def test_text_that_is_no_json_object_is_refused(text):
    """Broken, deep or endless JSON is a bad sample, not a crash."""
    assert refusal(CURRENT_MODE, std_msgs.String(data=text)).code is Code.SAMPLE_REFUSED


def test_a_mode_longer_than_ours_is_refused_before_it_is_parsed():
    """Megabytes of JSON would stall the loop."""
    text = json.dumps({**MODE, "filler": "x" * MAX_MODE_CHARACTERS})
    assert str(MAX_MODE_CHARACTERS) in refusal(CURRENT_MODE, std_msgs.String(data=text)).message


@pytest.mark.parametrize("topic", [topic for topic in STATE_TOPICS if TOPICS[topic].type_name == JOINT_STATE])
def test_a_sample_larger_than_ours_is_refused_before_it_is_read(topic, monkeypatch):
    """A megabyte of empty names is well formed, and would keep the loop for a second."""
    monkeypatch.setattr(codec, "decode", lambda payload, cls: pytest.fail("it was read"))
    large = encode(sensor_msgs.JointState(name=[""] * 2000))
    with pytest.raises(BadSample, match="bytes of a sensor_msgs/msg/JointState, at most 4096 are read") as caught:
        decode_sample(topic, large)
    assert caught.value.code is Code.SAMPLE_REFUSED


@pytest.mark.parametrize("data", [b"", b"\x00", b"\x00\x01\x00\x00", b"\xff\xff\xff\xff" + bytes(60)])
@pytest.mark.parametrize("topic", STATE_TOPICS)
def test_what_is_no_cdr_is_refused(topic, data):
    """An empty payload (a foreign delete), a header alone, another encapsulation."""
    with pytest.raises(BadSample) as caught:
        decode_sample(topic, data)
    assert caught.value.code is Code.SAMPLE_REFUSED
    assert str(caught.value) == caught.value.message


@pytest.mark.parametrize("topic", ["/api/fsm/enable", "/nothing", "left_arm/joint_states", ""])
def test_a_topic_that_is_no_state_is_refused(topic):
    """Commands and unknown names have no value here."""
    with pytest.raises(BadSample, match="no state topic"):
        decode_sample(topic, b"")


def test_a_message_of_another_type_is_refused():
    """A Pose on a joint state topic is not ours to guess at."""
    with pytest.raises(BadSample, match=r"sensor_msgs/msg/JointState, not Pose"):
        from_message(LEFT_ARM, geometry_msgs.Pose())


# -------------------------------------------------------------------------------------------------------- to the robot


def frame_values(topic):
    """Return some values of the right number that single precision holds exactly."""
    return tuple(0.125 * (n + 1) for n in range(TOPICS[topic].width))


@pytest.mark.parametrize(
    ("topic", "size"),
    [
        ("/api/left_arm/joint_cmd", 324),
        ("/api/right_arm/joint_cmd", 324),
        ("/api/left_arm/target_pose", 60),
        ("/api/right_arm/target_pose", 60),
        ("/api/left_gripper/cmd", 8),
        ("/api/right_gripper/cmd", 8),
        ("/api/chassis/velocity", 28),
        ("/api/servo/cmd", 24),
        ("/api/fsm/enable", 8),
    ],
)
def test_every_command_has_its_exact_length(topic, size):
    """A bridge writes whatever it is given: a wrong length stalls a topic or is decoded as garbage (wire.md 3.2)."""
    assert FRAME_BYTES[topic] == size
    assert len(encode_frame(topic, frame_values(topic), STAMP_NS)) == size
    assert set(FRAME_BYTES) == set(COMMAND_TOPICS)


def test_a_joint_command_has_names_positions_zeros_and_the_wall_clock():
    """As the manual's programs send it (§6.5); only the positions count (§4.3)."""
    message = to_message("/api/right_arm/joint_cmd", frame_values("/api/right_arm/joint_cmd"), STAMP_NS)
    assert isinstance(message, sensor_msgs.JointState)
    assert message.name == [f"r_joint{n}" for n in range(1, 8)]
    assert message.position == [0.125 * n for n in range(1, 8)]
    assert message.velocity == message.effort == [0.0] * 7
    assert (message.header.stamp.sec, message.header.stamp.nanosec) == divmod(STAMP_NS, S)
    assert message.header.frame_id == ""


def test_the_bytes_of_the_heartbeat_are_known():
    """Float32 1.0 and 0.0 (wire.md 1.2)."""
    assert encode_frame(FSM_ENABLE, (1.0,), 0).hex() == "000100000000803f"
    assert encode_frame(FSM_ENABLE, (0.0,), 0).hex() == "0001000000000000"


def test_a_pose_command_is_position_then_xyzw():
    """Seven doubles after the header, nothing else (§4.2)."""
    values = frame_values("/api/left_arm/target_pose")
    assert struct.unpack_from("<7d", encode_frame("/api/left_arm/target_pose", values, 0), 4) == values


@pytest.mark.parametrize("topic", [CHASSIS_VELOCITY, LIFT_COMMAND])
def test_an_array_command_has_an_empty_layout(topic):
    """No dimensions, no offset, then the floats (§4.5, §4.6)."""
    values = frame_values(topic)
    data = encode_frame(topic, values, 0)
    assert struct.unpack_from("<III", data, 4) == (0, 0, len(values))
    assert struct.unpack_from(f"<{len(values)}f", data, 16) == values


@pytest.mark.parametrize("topic", COMMAND_TOPICS)
@pytest.mark.parametrize("change", [-1, 1])
def test_another_number_of_values_is_never_sent(topic, change):
    """The chassis node may end on a wrong length (§4.5)."""
    values = frame_values(topic)
    wrong = values[:-1] if change < 0 else (*values, 0.0)
    with pytest.raises(BadFrame, match=f"{len(wrong)} values"):
        encode_frame(topic, wrong, 0)


@pytest.mark.parametrize("topic", COMMAND_TOPICS)
@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_nothing_but_finite_numbers_is_ever_sent(topic, value):
    """The bridge delivers NaN as NaN (wire.md 3.2)."""
    with pytest.raises(BadFrame, match="finite"):
        encode_frame(topic, (*frame_values(topic)[:-1], value), 0)


@pytest.mark.parametrize("topic", [FSM_ENABLE, CHASSIS_VELOCITY])
def test_a_number_beyond_single_precision_is_never_sent(topic):
    """It would become infinity on the way."""
    with pytest.raises(BadFrame):
        encode_frame(topic, (*frame_values(topic)[:-1], 1e39), 0)


@pytest.mark.parametrize("topic", ["/left_arm/joint_states", "/api/current_mode", "/nothing"])
def test_what_is_no_command_topic_is_never_sent(topic):
    """The robot's own topics are not ours to write."""
    with pytest.raises(BadFrame, match="no command topic"):
        encode_frame(topic, (0.0,), 0)


def test_a_payload_of_another_length_is_never_sent(monkeypatch):
    """The length is compared with the table even when encoding found nothing wrong."""
    monkeypatch.setitem(FRAME_BYTES, FSM_ENABLE, 12)
    with pytest.raises(BadFrame, match="8 bytes, 12 are right"):
        encode_frame(FSM_ENABLE, (1.0,), 0)


@pytest.mark.parametrize("wall_ns", [0, -1, 2**31 * S - 1, 2**31 * S, 2**32 * S, -(2**31) * S - 1, 10**30])
def test_no_wall_clock_stops_a_stream(wall_ns):
    """The robot does not read the stamp; a clock beyond 2038 or before 1901 wraps around."""
    topic = "/api/left_arm/joint_cmd"
    message = to_message(topic, frame_values(topic), wall_ns)
    assert len(encode_frame(topic, frame_values(topic), wall_ns)) == FRAME_BYTES[topic]
    assert (message.header.stamp.sec - wall_ns // S) % 2**32 == 0
    assert message.header.stamp.nanosec == wall_ns % S


@given(values=st.lists(st.floats(allow_nan=False, allow_infinity=False), min_size=7, max_size=7))
def test_joint_positions_arrive_bit_by_bit(values):
    """What the gate cleared is what the robot reads."""
    data = encode_frame("/api/left_arm/joint_cmd", tuple(values), STAMP_NS)
    assert struct.pack("<7d", *values) in data


# --------------------------------------------------------------------------------------------------------------- fuzz


@given(topic=st.sampled_from(STATE_TOPICS), data=st.binary(max_size=400))
def test_any_bytes_are_a_value_or_a_bad_sample(topic, data):
    """No other exception ever comes out."""
    try:
        decode_sample(topic, data)
    except BadSample as error:
        assert error.code in (Code.SAMPLE_REFUSED, Code.JOINT_ORDER)


def mutated(data: bytes, rng: random.Random) -> bytes:
    """Return a payload with some of its bytes, counts, numbers or its length changed."""
    changed = bytearray(data)
    for _ in range(rng.randint(1, 3)):
        at = rng.randrange(len(changed)) if changed else 0
        match rng.randrange(7):
            case 0 if changed:
                changed[at] ^= 1 << rng.randrange(8)
            case 1 if changed:
                changed[at] = rng.randrange(256)
            case 2:
                del changed[at:]
            case 3:
                changed += rng.randbytes(rng.randint(1, 9))
            case 4 if len(changed) >= at // 4 * 4 + 4:  # a count or a length
                value = rng.choice([0, 1, 6, 8, 0x7FFFFFFF, 0x80000000, 0xFFFFFFFF, len(data)])
                struct.pack_into("<I", changed, at // 4 * 4, value)
            case 5 if len(changed) >= at // 8 * 8 + 12:  # a number
                value = rng.choice([math.nan, math.inf, -math.inf, 1e308, 0.0])
                struct.pack_into("<d", changed, at // 8 * 8 + 4, value)
            case 6 if changed:
                other = rng.randrange(len(changed))
                changed[min(at, other) : max(at, other)] = b""
    return bytes(changed)


@pytest.mark.slow
def test_mutated_payloads_are_values_or_bad_samples():
    """20,000 damaged payloads, or 100,000: typed refusals only, and what is believed is finite and of the right size."""
    rng = random.Random(20260801)
    originals = [(topic, encode(state_message(topic, STAMP_NS))) for topic in STATE_TOPICS]
    counts = {"believed": 0, Code.SAMPLE_REFUSED: 0, Code.JOINT_ORDER: 0}
    for _ in range(FUZZED_PAYLOADS):
        topic, data = rng.choice(originals)
        try:
            value = decode_sample(topic, mutated(data, rng))
        except BadSample as error:
            assert error.message
            counts[error.code] += 1
            continue
        counts["believed"] += 1
        if isinstance(value, MotorState):
            assert len(value.q_rad) == TOPICS[topic].width
            assert all(map(math.isfinite, (*value.q_rad, *value.dq_radps, *value.tau_nm)))
        elif isinstance(value, EePose):
            assert math.isclose(math.hypot(*value.quat_xyzw), 1.0)
    # Each of the three outcomes is common: the damage neither always hits nor always misses.
    assert sum(counts.values()) == FUZZED_PAYLOADS
    assert all(number > FUZZED_PAYLOADS // 1000 for number in counts.values()), counts


@pytest.mark.parametrize(
    ("wrong", "sentence"),
    [
        (
            lambda: refusal(CURRENT_MODE, std_msgs.String(data="[]")),
            "JSON holds a list, not an object (manual §4.11.2)",
        ),
        (lambda: refusal(CURRENT_MODE, std_msgs.String(data="{}")), "key 'meta_mode' is missing (manual §4.11.2)"),
        (
            lambda: refusal(CURRENT_MODE, std_msgs.String(data=json.dumps({**MODE, "meta_mode": 2}))),
            "meta_mode is 2, 0 or 1 is needed (manual §4.11.2)",
        ),
        (
            lambda: refusal(LEFT_ARM, joints(position=[0.0] * 6)),
            "position has 6 entries, 7 are needed (manual §4.8)",
        ),
        (
            lambda: refusal(LEFT_ARM, joints(name=["l_joint1"])),
            "name has 1 entries, 7 are needed (manual §4.8)",
        ),
    ],
)
def test_a_bad_sample_is_told_in_one_sentence(wrong, sentence):
    """What it was, what it must be, and where that stands."""
    found = wrong()
    assert (found.code, found.message, str(found)) == (Code.SAMPLE_REFUSED, sentence, sentence)


def test_a_number_beyond_single_precision_is_told_with_its_topic():
    """Whoever reads the log sees which frame it was."""
    with pytest.raises(BadFrame, match=f"^{FSM_ENABLE}: .*1e[+]39 cannot be written"):
        encode_frame(FSM_ENABLE, (1e39,), 0)
