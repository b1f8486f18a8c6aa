"""Tests of the judgement of bags: each fault is found, at its topic, and a bag without one is told so."""

from __future__ import annotations

import pytest

from cdr_types import encode
from cdr_types.messages.geometry_msgs import Point, Pose
from cdr_types.messages.std_msgs import String
from gateway.recording.bag_check import check
from gateway.recording.bag_reader import Bag
from gateway.recording.bag_writer import METADATA, BagWriter
from gateway.recording.topics import EPISODES
from gateway.robot.topics import FSM_STATE, arm_state, ee_pose, joint_command
from gateway.values import Side
from tests.recording.bags import ARM, BEGIN_NS, TOPICS, WORDS, joints, said, written

S, MS = 1_000_000_000, 1_000_000
LEFT, POSE_TOPIC = arm_state(Side.LEFT), ee_pose(Side.LEFT)
TOLD = next(n for n, topic in enumerate(TOPICS) if topic.name == joint_command(Side.LEFT))


def found(folder):
    """Return the findings: level, topic, message."""
    with Bag(folder) as bag:
        return [(f.level, f.topic, f.message) for f in check(bag).findings]


def between(at_ns, begin_s, end_s):
    """Whether a time lies between two times of the bag."""
    return BEGIN_NS + begin_s * S <= at_ns < BEGIN_NS + end_s * S


def test_nothing_is_wrong_with_a_good_bag(tmp_path):
    """Its rates are measured, and progress is told to the end."""
    shares = []
    with Bag(written(tmp_path / "bag")) as bag:
        checked = check(bag, shares.append)
        assert checked.messages == bag.message_count
    assert checked.ok and checked.findings == []
    assert checked.rates_hz[LEFT] == pytest.approx(200.0)
    assert shares[0] == 0.0 and shares[-1] == 1.0


def shifted(topic, at_ns, data):
    """The robot's clock goes back by an hour."""
    late = at_ns - BEGIN_NS >= S
    return at_ns, joints(at_ns - late * 3600 * S) if topic.is_stamped and topic.name == LEFT else data


FAULTS = {
    "gap": (
        lambda topic, at_ns, data: None if topic.name == LEFT and between(at_ns, 1, 1.2) else (at_ns, data),
        ("warning", LEFT, "1 gaps, the longest of 205 ms after 0.99 s"),
    ),
    "ends early": (
        lambda topic, at_ns, data: None if topic.name == LEFT and between(at_ns, 2.75, 3) else (at_ns, data),
        ("warning", LEFT, "1 gaps, the longest of 245 ms after 2.75 s"),
    ),
    "begins late": (
        lambda topic, at_ns, data: None if topic.name == LEFT and between(at_ns, 0, 0.25) else (at_ns, data),
        ("warning", LEFT, "1 gaps, the longest of 250 ms after 0.00 s"),
    ),
    "late, and a gap": (
        lambda topic, at_ns, data: (
            None if topic.name == LEFT and (between(at_ns, 0, 0.05) or between(at_ns, 1, 1.1)) else (at_ns, data)
        ),
        ("warning", LEFT, "1 gaps, the longest of 105 ms after 0.99 s"),
    ),
    "slow": (
        lambda topic, at_ns, data: None if topic.name == LEFT and at_ns // (5 * MS) % 2 else (at_ns, data),
        ("warning", LEFT, "100.2 Hz over the whole bag, 200 Hz are the rule"),
    ),
    "missing": (
        lambda topic, at_ns, data: None if topic.name == LEFT else (at_ns, data),
        ("error", LEFT, "nothing of it came, though every robot of this model has it"),
    ),
    "malformed": (
        lambda topic, at_ns, data: (at_ns, data[:-9] if topic.name == LEFT and between(at_ns, 1, 1.01) else data),
        ("error", LEFT, "2 of 600 messages cannot be decoded: "),
    ),
    "not finite": (
        lambda topic, at_ns, data: (at_ns, joints(at_ns, value=float("nan")) if topic.name == LEFT else data),
        ("error", LEFT, "600 of 600 messages hold NaN or infinity"),
    ),
    "pose not finite": (
        lambda topic, at_ns, data: (
            at_ns, encode(Pose(position=Point(x=float("inf")))) if topic.name == POSE_TOPIC else data
        ),
        ("error", POSE_TOPIC, "600 of 600 messages hold NaN or infinity"),
    ),
    "no position": (
        lambda topic, at_ns, data: (at_ns, joints(at_ns, width=0) if topic.name == LEFT else data),
        ("error", LEFT, "600 of 600 messages hold no position"),
    ),
    "twice": (
        lambda topic, at_ns, data: (at_ns, joints(at_ns // (10 * MS) * 10 * MS) if topic.name == LEFT else data),
        ("warning", LEFT, "300 messages have the stamp of the one before"),
    ),
    "clock set": (shifted, ("warning", LEFT, "1 stamps go back: the robot's clock was set")),
}  # fmt: skip


@pytest.mark.parametrize("fault", FAULTS)
def test_each_fault_is_found_where_it_is_and_nothing_else(tmp_path, fault):
    """One finding, of the topic that has it."""
    change, (level, topic, message) = FAULTS[fault]
    ((got_level, got_topic, got_message),) = found(written(tmp_path / "bag", 3.0, change))
    assert (got_level, got_topic) == (level, topic) and got_message.startswith(message)


@pytest.mark.parametrize(
    ("name", "end_s", "is_said"), [(LEFT, 1.2, True), (LEFT, 1.15, False), (FSM_STATE, 1.5, False)]
)
def test_that_no_rows_are_made_is_said_only_of_gaps_that_no_row_spans(tmp_path, name, end_s, is_said):
    """Rows are made across up to 0.2 s, and hold no FSM state."""
    folder = written(
        tmp_path / "bag",
        change=lambda topic, at_ns, data: None if topic.name == name and between(at_ns, 1, end_s) else (at_ns, data),
    )
    with Bag(folder) as bag:
        (finding,) = (one for one in check(bag).findings if "1 gaps" in one.message)
    assert finding.topic == name and ("rows of a dataset" in finding.hint) == is_said


def test_clocks_that_go_apart_are_found(tmp_path):
    """By the smallest delays, which a busy network does not change."""

    def drift(topic, at_ns, data):
        if topic.name != LEFT:
            return None
        return at_ns, joints(at_ns - 5 * MS - (at_ns - BEGIN_NS) // 1000)

    assert ("warning", LEFT, "the robot's clock goes apart from the recorder's by 1000 ppm") in found(
        written(tmp_path / "bag", 45.0, drift)
    )


@pytest.mark.parametrize(("ahead_ms", "which"), [(400, "+400"), (-4, None)])
@pytest.mark.parametrize(
    ("topic", "was_set"),
    [
        (ARM, "the robot's clock was set"),
        (TOLD, "its sender's clock was set, or another one sent"),
    ],
)
def test_a_clock_that_jumps_ahead_is_found_as_a_dataset_finds_it(tmp_path, topic, was_set, ahead_ms, which):
    """Stamps go back only where it is set back; what is less than a step is nothing."""
    bag = BagWriter(tmp_path / "bag", TOPICS)
    for n in range(1600):
        at_ns = BEGIN_NS + n * 5 * MS
        bag.add(topic, at_ns, at_ns, joints(at_ns + (ahead_ms * MS if n >= 800 else 0)))
    bag.finish()
    name = TOPICS[topic].name
    expected = [] if which is None else [("warning", name, f"stamps jump by {which} ms: {was_set}")]
    assert [one for one in found(tmp_path / "bag") if one[1] == name] == expected


def test_what_the_recorder_noted_of_itself_is_told(tmp_path):
    """What it lost is an error, why it ended by itself a warning."""
    bag = BagWriter(tmp_path / "bag", TOPICS)
    for n in range(10):
        bag.add(ARM, BEGIN_NS + n * 5 * MS, BEGIN_NS, joints(BEGIN_NS + n))
    bag.note({"lost": "3", "error": "the disk is nearly full"})
    bag.finish()
    messages = [(level, message) for level, _, message in found(tmp_path / "bag")]
    assert ("error", "the recorder lost 3 messages: its disk was too slow") in messages
    assert ("warning", "the recording ended by itself: the disk is nearly full") in messages


def test_what_is_announced_and_not_there_is_found(tmp_path):
    """A copy that was edited, say."""
    folder = written(tmp_path / "bag", 1.0)
    path = folder / METADATA
    with Bag(folder) as bag:
        count = bag.message_count
    path.write_text(path.read_text().replace(f"message_count: {count}\n", f"message_count: {count + 5}\n"))
    assert found(folder) == [("error", "", f"{count} messages can be read, {count + 5} are announced")]


def test_an_empty_bag_is_not_fit_for_use(tmp_path):
    """It says so once."""
    BagWriter(tmp_path / "bag", TOPICS).finish()
    assert found(tmp_path / "bag") == [("error", "", "it holds no message")]


@pytest.mark.parametrize(
    ("words", "why"),
    [
        ((said("start", 1, 1),), "episode 1 was never stopped: it ends with the bag"),
        ((said("start", 1, 1), said("stop", 1, 1)), "episode 1 is empty: nothing of the robot came in it"),
        (
            (said("start", 1, 0), said("start", 2, 1), said("stop", 2, 1.5), said("stop", 1, 2)),
            "episode 2 begins 0.50 s before the end of episode 1",
        ),
    ],
)
def test_episodes_that_cannot_be_used_as_they_are_are_named(tmp_path, words, why):
    """Unfinished, empty, two at once; good ones are no finding."""
    assert found(written(tmp_path / "bag", words=words)) == [("warning", EPISODES, why)]
    good = (said("start", 1, 0), said("stop", 1, 1), said("start", 2, 1), said("stop", 2, 2), said("success", 1, 2.5))
    assert found(written(tmp_path / "good", words=good)) == []


def test_what_nobody_can_read_of_episodes_is_counted(tmp_path):
    """It may have been the end of one."""
    bag = BagWriter(tmp_path / "bag", TOPICS)
    bag.add(ARM, BEGIN_NS, BEGIN_NS, joints(1))
    bag.add(WORDS, BEGIN_NS, BEGIN_NS, encode(String(data="start")))
    bag.finish()
    assert ("warning", EPISODES, "1 of 1 messages say nothing of an episode that can be read") in found(
        tmp_path / "bag"
    )
