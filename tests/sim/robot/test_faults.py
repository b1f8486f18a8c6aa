"""Rules of the fault grammar and of the faults on topics."""

from __future__ import annotations

import math

import pytest

from cdr_types.messages import geometry_msgs, sensor_msgs, std_msgs
from gateway.sim.robot.faults import FAULTS, DelayLine, FaultBook, FaultError, parse_fault
from gateway.sim.robot.manual import MS, STATE_TOPICS, S

STATE = "/left_arm/joint_states"
ENOUGH = {
    "topic": STATE,
    "delay_s": 0.1,
    "copies": 3,
    "value": 4,
    "side": "left",
    "mode": "pose",
    "joint": 2,
    "delta_rad": 0.5,
    "margin_rad": 0.3,
    "kg": 0.3,
    "step_s": 3600.0,
    "drift_ppm": -500.0,
}


def state(number: float = 0.0) -> sensor_msgs.JointState:
    """A joint state with recognisable content."""
    values = [number] * 7
    return sensor_msgs.JointState(
        name=[f"l_joint{n}" for n in range(1, 8)], position=list(values), velocity=list(values), effort=list(values)
    )


@pytest.mark.parametrize("name", FAULTS)
def test_every_known_fault_can_be_written_down(name):
    """Each fault is understood with its required parameters, with and without a duration, as text and as mapping."""
    command = {"fault": name, **{key: ENOUGH[key] for key in FAULTS[name].required}}
    assert parse_fault(command).name == name
    assert parse_fault({**command, "duration_s": 2}).duration_s == 2.0
    assert FAULTS[name].help


def test_a_fault_is_json():
    """The text form is a JSON object."""
    fault = parse_fault('{"fault":"jump","side":"right","joint":3,"delta_rad":-0.2,"duration_s":0.5}')
    assert (fault.side, fault.joint, fault.number, fault.duration_s) == ("right", 3, -0.2, 0.5)
    assert fault.details == "side right, joint 3, number -0.2, for 0.5 s"
    assert parse_fault({"fault": "vr_mode"}).details == "until cleared"


@pytest.mark.parametrize(
    ("command", "named"),
    [
        ("{", "not JSON"),
        ("[1]", "object"),
        ('{"do":"x"}', "known: drop"),
        ('{"fault":"explode"}', "known: drop"),
        ('{"fault":["drop"]}', "known: drop"),
        ('{"fault":"drop"}', "missing"),
        ('{"fault":"drop","topic":"/nothing"}', "/left_arm/joint_states"),
        ('{"fault":"freeze","topic":"/api/fsm/enable"}', "not one of"),
        ('{"fault":"nan","topic":"/fsm_state"}', "not one of"),
        ('{"fault":"short","topic":"*"}', "not one of"),
        ('{"fault":"drop","topic":7}', "not one of"),
        ('{"fault":"vr_mode","speed":1}', "unknown parameter"),
        ('{"fault":"arm_disabled","side":"up"}', "left, right"),
        ('{"fault":"control_mode","side":"left","mode":"force"}', "joint, pose"),
        ('{"fault":"delay","topic":"/fsm_state","delay_s":"long"}', "finite number"),
        ('{"fault":"delay","topic":"/fsm_state","delay_s":-1}', "positive"),
        ('{"fault":"duplicate","topic":"/fsm_state","copies":0}', "positive"),
        ('{"fault":"fsm_value","value":true}', "finite number"),
        ('{"fault":"vr_mode","duration_s":0}', "positive"),
        ('{"fault":"jump","side":"left","joint":8,"delta_rad":1}', "1 to 7"),
        ('{"fault":"tight_limit","side":"left","joint":0,"margin_rad":1}', "1 to 7"),
        ('{"fault":"tight_limit","side":"left","joint":2,"margin_rad":-1}', "positive"),
    ],
)
def test_what_is_not_understood_says_what_is_known(command, named):
    """Every mistake is an error that names it or lists the possibilities."""
    with pytest.raises(FaultError, match=named):
        parse_fault(command)


def book(*commands: dict) -> FaultBook:
    """A book with faults that act from time 0."""
    faults = FaultBook()
    for command in commands:
        faults.add(parse_fault(command), 0)
    return faults


def test_without_faults_messages_pass():
    """The same object at the same time."""
    message = state()
    assert FaultBook().pass_through(STATE, message, 5) == [(5, message)]


def test_drop_silences_one_topic_only():
    """Other topics go on; a star silences every state topic and no command."""
    faults = book({"fault": "drop", "topic": STATE})
    assert faults.pass_through(STATE, state(), 0) == []
    assert len(faults.pass_through("/right_arm/joint_states", state(), 0)) == 1
    everything = book({"fault": "drop", "topic": "*"})
    assert all(everything.pass_through(topic, state(), 0) == [] for topic in STATE_TOPICS)
    assert len(everything.pass_through("/api/fsm/enable", std_msgs.Float32(data=1.0), 0)) == 1


def test_drop_acts_on_commands_too():
    """A black-holed command route."""
    faults = book({"fault": "drop", "topic": "/api/fsm/enable"})
    assert faults.pass_through("/api/fsm/enable", std_msgs.Float32(data=1.0), 0) == []


def test_freeze_repeats_the_first_message():
    """The rate goes on, the content does not; afterwards a new freeze takes a new message."""
    faults = book({"fault": "freeze", "topic": STATE, "duration_s": 1.0})
    first = state(1.0)
    faults.pass_through(STATE, first, 0)
    assert faults.pass_through(STATE, state(2.0), 5 * MS) == [(5 * MS, first)]
    assert faults.expire(1 * S)
    faults.add(parse_fault({"fault": "freeze", "topic": STATE}), 1 * S)
    assert faults.pass_through(STATE, state(3.0), 1 * S)[0][1].position[0] == 3.0


def test_delay_shifts_and_duplicate_repeats():
    """Both together give late copies."""
    faults = book(
        {"fault": "delay", "topic": STATE, "delay_s": 0.3}, {"fault": "duplicate", "topic": STATE, "copies": 3}
    )
    message = state()
    assert faults.pass_through(STATE, message, 0) == [(300 * MS, message)] * 3


def test_reordered_messages_come_in_pairs_the_later_one_first():
    """Nothing is made up; with the fault's end the order is right again, and the one that was held back is lost."""
    faults = book({"fault": "reorder", "topic": STATE, "duration_s": 1.0})
    came = [m for n in range(5) for _, m in faults.pass_through(STATE, state(float(n)), 0)]
    assert [message.position[0] for message in came] == [1.0, 0.0, 3.0, 2.0]
    assert faults.expire(1 * S)
    faults.add(parse_fault({"fault": "reorder", "topic": STATE}), 1 * S)
    assert faults.pass_through(STATE, state(9.0), 1 * S) == []


def test_corrupted_states_leave_the_original_alone():
    """NaN, a missing joint and reversed names are made on a copy."""
    original = state(0.5)
    spoiled = book({"fault": "nan", "topic": STATE}).pass_through(STATE, original, 0)[0][1]
    assert all(map(math.isnan, spoiled.position))
    short = book({"fault": "short", "topic": STATE}).pass_through(STATE, original, 0)[0][1]
    assert [len(values) for values in (short.name, short.position, short.velocity, short.effort)] == [6] * 4
    renamed = book({"fault": "wrong_names", "topic": STATE}).pass_through(STATE, original, 0)[0][1]
    assert renamed.name == original.name[::-1]
    assert original == state(0.5)


def test_a_pose_can_be_nan():
    """The pose topic has no joints but a position."""
    topic = "/left_arm/current_ee_pose"
    spoiled = book({"fault": "nan", "topic": topic}).pass_through(topic, geometry_msgs.Pose(), 0)[0][1]
    assert math.isnan(spoiled.position.x)


def test_a_fault_ends_after_its_duration():
    """Its end is known beforehand and exact."""
    faults = book({"fault": "drop", "topic": STATE, "duration_s": 0.5})
    assert faults.deadline_ns == 500 * MS
    assert not faults.expire(500 * MS - 1)
    assert faults.expire(500 * MS)
    assert faults.deadline_ns is None
    assert faults.active() == []


def test_faults_can_be_cleared_by_name_by_topic_or_all():
    """What is not meant stays."""
    commands = [
        {"fault": "drop", "topic": STATE},
        {"fault": "nan", "topic": STATE},
        {"fault": "drop", "topic": "/fsm_state"},
        {"fault": "vr_mode"},
    ]
    faults = book(*commands)
    assert faults.clear("drop", STATE) == 1
    assert faults.clear(topic="/fsm_state") == 1
    assert faults.clear("vr_mode") == 1
    assert [fault.name for fault in faults.active()] == ["nan"]
    assert len(faults.active("nan")) == 1
    assert faults.clear() == 1


def test_delayed_messages_leave_in_time_and_order():
    """A delay line gives back what is due, first in first out."""
    line = DelayLine()
    assert line.next_ns is None
    for number, due_ns in enumerate((20, 10, 10)):
        line.push(due_ns, f"/{number}", std_msgs.Int32(data=number))
    assert line.next_ns == 10
    assert [topic for topic, _ in line.pop_due(10)] == ["/1", "/2"]
    assert [topic for topic, _ in line.pop_due(30)] == ["/0"]
