"""Tests of episodes that buttons mark, in bags of the robot's own recorder."""

from __future__ import annotations

import numpy as np
import pytest
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from gateway.dataset.vendor_marks import BUTTONS, all_episodes
from gateway.recording.bag_reader import Bag
from gateway.recording.episodes import EpisodeEvent, as_message
from gateway.recording.topics import EPISODES, TEXT, RecordedTopic
from gateway.robot.topics import arm_state
from gateway.values import Side
from tests.dataset.motion import BEGIN_NS, moving
from tests.recording.bags import joints

STORE = get_typestore(Stores.ROS2_HUMBLE)
JOY = STORE.types["sensor_msgs/msg/Joy"]
HEADER = STORE.types["std_msgs/msg/Header"](
    stamp=STORE.types["builtin_interfaces/msg/Time"](sec=0, nanosec=0), frame_id=""
)


def pressed(folder, presses, plugin=StoragePlugin.MCAP):
    """Write a bag of the robot's own in which buttons are as given: a string per second, of `x`, `y` or nothing."""
    with Writer(folder, version=8, storage_plugin=plugin) as writer:
        states = writer.add_connection(arm_state(Side.LEFT), "sensor_msgs/msg/JointState", typestore=STORE)
        joy = writer.add_connection(BUTTONS, "sensor_msgs/msg/Joy", typestore=STORE)
        for n, held in enumerate(presses):
            buttons = [0, 0, int("x" in held), int("y" in held)] if held != "-" else [1]
            message = JOY(header=HEADER, axes=np.zeros(0, np.float32), buttons=np.array(buttons, np.int32))
            writer.write(joy, BEGIN_NS + n * 10**9, STORE.serialize_cdr(message, "sensor_msgs/msg/Joy"))
            writer.write(states, BEGIN_NS + n * 10**9, joints(1))
    return folder


def seen(folder):
    """Return begin and end [s] of each episode, and whether it is to be used."""
    with Bag(folder) as bag:
        return [
            ((e.begin_ns - BEGIN_NS) // 10**9, (e.end_ns - BEGIN_NS) // 10**9, not e.is_discarded)
            for e in all_episodes(bag)
        ]


@pytest.mark.parametrize("plugin", [StoragePlugin.MCAP, StoragePlugin.SQLITE3])
def test_x_begins_and_y_ends_an_episode(tmp_path, plugin):
    """Held buttons count once, those with too few buttons not at all."""
    presses = ["", "x", "x", "", "y", "y", "-", "", "x", "", "y"]
    assert seen(pressed(tmp_path / "bag", presses, plugin)) == [(1, 4, True), (8, 10, True)]


def test_x_again_throws_away_what_was_begun(tmp_path):
    """As the maker's converter does."""
    assert seen(pressed(tmp_path / "bag", ["", "x", "", "x", "", "y"])) == [(1, 3, False), (3, 5, True)]


def test_what_is_still_open_at_the_end_is_not_used(tmp_path):
    """Nor is a button that was held from the begin on."""
    assert seen(pressed(tmp_path / "bag", ["x", "", "x", ""])) == [(2, 3, False)]
    assert seen(pressed(tmp_path / "held", ["x", "y", ""])) == [(0, 2, True)]


def test_what_was_said_while_recording_counts_before_buttons(tmp_path):
    """And a bag without either is one episode."""
    topic = RecordedTopic(name=EPISODES, type_name=TEXT)
    words = [("start", 1.0), ("stop", 2.0)]
    more = [
        (topic, round(s * 1e9), as_message(EpisodeEvent(event=event, episode=1, at_ns=BEGIN_NS + round(s * 1e9))))
        for event, s in words
    ]
    assert seen(moving(tmp_path / "bag", more=more)) == [(1, 2, True)]
    assert len(seen(moving(tmp_path / "whole"))) == 1
