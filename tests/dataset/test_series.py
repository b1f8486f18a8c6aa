"""Tests of reading fields: at which instant a message counts, and which numbers of it do."""

from __future__ import annotations

import numpy as np
import pytest

from cdr_types import encode
from cdr_types.messages.sensor_msgs import JointState
from gateway.dataset.series import read_series
from gateway.recording.bag_reader import Bag
from gateway.recording.topics import recorded_topics
from gateway.robot.topics import CHASSIS_STATE, arm_state, ee_pose, joint_command
from gateway.settings.settings import LinkSettings
from gateway.values import Side
from tests.dataset.motion import BEGIN_NS, CLOCK_NS, DELAY_NS, NAMESPACE, moving, position
from tests.recording.bags import TOPICS, joints

LEFT, POSE = arm_state(Side.LEFT), ee_pose(Side.LEFT)
TOPIC = {topic.name: topic for topic in TOPICS}
NAMED = recorded_topics(LinkSettings(namespace=NAMESPACE), aliases=True)
TOLD = "/left_arm/joint_cmd"
"""How the names of a left arm's joint commands end, both of them."""


def read(folder, *wanted, **options):
    """Return the series of a bag."""
    with Bag(folder) as bag:
        return read_series(bag, wanted, **options)


def test_a_stamped_message_counts_at_its_stamp_by_this_hosts_clock(tmp_path):
    """Arrivals that are up to 4 ms late do not show; the robot's clock is 5 s behind."""
    series = read(moving(tmp_path / "bag"), (LEFT, "position"))[LEFT, "position"]
    off_ns = series.times_ns - (BEGIN_NS + np.arange(600) * 5_000_000)
    assert abs(int(off_ns.max()) - int(off_ns.min())) < 1000 and 0 <= off_ns.min() < 100_000
    expected = [[position(LEFT, joint, n * 0.005) for joint in range(7)] for n in range(600)]
    assert series.values == pytest.approx(np.array(expected))
    late = read(tmp_path / "bag", (LEFT, "position"), by_arrival=True)[LEFT, "position"]
    assert int((late.times_ns - (BEGIN_NS + np.arange(600) * 5_000_000)).max()) > 3_000_000


@pytest.mark.parametrize("behind_ns", [CLOCK_NS, -CLOCK_NS])
@pytest.mark.parametrize("topics", [TOPICS, NAMED])
def test_what_is_told_counts_beside_what_is_seen_whatever_the_robots_clock_says(tmp_path, behind_ns, topics):
    """A command has its sender's clock, a state the robot's; so has a command under its name inside the robot."""
    moving(tmp_path / "bag", 1.0, topics=topics, clock_ns=behind_ns)
    names = [topic.name for topic in topics if topic.name.endswith((LEFT, TOLD))]
    found = read(tmp_path / "bag", *((name, "position") for name in names))
    assert len(found) == len(names) >= 2
    for series in found.values():
        count = len(series.times_ns)
        off_ns = series.times_ns - BEGIN_NS - np.arange(count) * (1_000_000_000 // count)
        assert count >= 100 and int(np.abs(off_ns).max()) < 5_000_000


def test_a_pose_counts_at_its_arrival(tmp_path):
    """It has no stamp; its numbers come in the order of the message."""
    folder = moving(tmp_path / "bag")
    found = read(folder, (POSE, "position"), (POSE, "orientation"), (LEFT, "position"))
    assert np.array_equal(found[POSE, "position"].times_ns, BEGIN_NS + np.arange(600) * 5_000_000)
    assert found[POSE, "position"].values[200] == pytest.approx([1.0, 0.1, 0.2])
    assert found[POSE, "orientation"].values[0] == pytest.approx([0.0, 0.0, 0.0, 1.0])


def stamped(folder, seconds, ahead_ns, name=LEFT):
    """Write a bag with one stamped topic, 200 a second, each 1 ms late by a clock so far ahead at a time [s]; its arrivals."""
    sent = [BEGIN_NS + n * 5_000_000 for n in range(int(seconds * 200))]
    more = [
        (TOPIC[name], at_ns + DELAY_NS - BEGIN_NS, joints(at_ns + ahead_ns((at_ns - BEGIN_NS) / 1e9))) for at_ns in sent
    ]
    moving(folder, seconds, is_there=lambda topic, t_s: False, more=more)
    return np.array(sent) + DELAY_NS


@pytest.mark.parametrize(
    ("seconds", "at_s", "by_ns", "name"),
    [
        (8, 4, 400_000_000, LEFT),
        (8, 4, -400_000_000, LEFT),
        (8, 4, 400_000_000, joint_command(Side.LEFT)),
        (25, 4, 400_000_000, LEFT),
        (25, 22, -400_000_000, LEFT),
    ],
)
def test_where_a_clock_was_set_or_another_one_sends_arrival_counts(tmp_path, seconds, at_s, by_ns, name):
    """A step would put one part of the recording elsewhere: also in a short one, and near its ends."""
    arrivals = stamped(tmp_path / "bag", seconds, lambda t_s: by_ns if t_s >= at_s else 0, name)
    series = read(tmp_path / "bag", (name, "position"))[name, "position"]
    assert np.array_equal(series.times_ns, arrivals)


@pytest.mark.parametrize("number", [0, 300])
def test_a_single_stamp_of_the_future_moves_no_other_message(tmp_path, number):
    """It counts at its arrival itself: others stay where they were."""
    arrivals = stamped(tmp_path / "bag", 3.0, lambda t_s: 10**10 if round(t_s * 200) == number else 10**9)
    series = read(tmp_path / "bag", (LEFT, "position"))[LEFT, "position"]
    assert int(np.abs(series.times_ns - arrivals).max()) < 1000


def test_messages_without_the_field_with_another_width_or_no_number_are_left_out_and_counted(tmp_path):
    """One that is not of its type, too."""
    stamp = BEGIN_NS - 5_000_000_000
    bad = [
        joints(stamp, width=6),
        joints(stamp, value=float("nan")),
        encode(JointState()),
        b"\x00\x01\x00\x00\x01",
    ]
    more = [(TOPIC[LEFT], 4_000_000_000 + n, data) for n, data in enumerate(bad)]
    series = read(moving(tmp_path / "bag", more=more), (LEFT, "position"), by_arrival=True)[LEFT, "position"]
    assert (len(series.times_ns), series.rejected) == (600, 4)


def test_of_messages_of_one_instant_the_last_counts(tmp_path):
    """Times ascend."""
    more = [(TOPIC[LEFT], 4_000_000_000, joints(0, value=value)) for value in (0.1, 0.2)]
    series = read(moving(tmp_path / "bag", more=more), (LEFT, "position"))[LEFT, "position"]
    assert np.all(np.diff(series.times_ns) > 0) and series.values[-1] == pytest.approx([0.2] * 7)


def test_what_a_bag_does_not_have_is_left_out(tmp_path):
    """A topic, and a field."""
    folder = moving(tmp_path / "bag", is_there=lambda topic, t_s: topic.name != CHASSIS_STATE)
    found = read(folder, (CHASSIS_STATE, "position"), (LEFT, "torque"), (LEFT, "name"), (LEFT, "effort"))
    assert set(found) == {(LEFT, "effort")}


def test_a_field_inside_a_field_is_found(tmp_path):
    """By its path."""
    found = read(moving(tmp_path / "bag"), (LEFT, "header.stamp.sec"), (POSE, "position.x"))
    assert found[LEFT, "header.stamp.sec"].values.shape == (600, 1)
    assert found[POSE, "position.x"].values[100] == pytest.approx([0.5])
