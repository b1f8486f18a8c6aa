"""Tests of bags that are read: ours and others', and what is no bag."""

from __future__ import annotations

import contextlib
import sqlite3

import pytest
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from gateway.errors import Rejected
from gateway.recording.bag_reader import Bag
from gateway.recording.bag_writer import METADATA, BagWriter, bag_file
from gateway.robot.topics import FSM_STATE, arm_state
from gateway.values import Side
from tests.recording.bags import BEGIN_NS, TOPICS, joints, written


@pytest.fixture
def folder(tmp_path):
    """A bag of half a second."""
    return written(tmp_path / "bag", 0.5)


def test_it_tells_what_it_holds(folder):
    """By its folder and by its file alike."""
    for path in (folder, bag_file(folder)):
        with Bag(path) as bag:
            counts = {topic.name: topic.count for topic in bag.topics if topic.count}
            assert (counts[arm_state(Side.LEFT)], counts[FSM_STATE]) == (100, 10)
            assert bag.message_count == sum(counts.values()) == len(list(bag.messages()))
            assert bag.begin_ns == BEGIN_NS and bag.duration_s == pytest.approx(0.495, abs=0.01)
            assert bag.size_bytes >= bag_file(folder).stat().st_size
            assert bag.facts()["model"] == "standard"


def test_messages_come_in_the_order_of_their_arrival(folder):
    """All of them, or those of some topics; of an unknown one none."""
    with Bag(folder) as bag:
        times = [message.log_ns for message in bag.messages()]
        assert times == sorted(times)
        assert {message.topic for message in bag.messages([FSM_STATE])} == {FSM_STATE}
        assert list(bag.messages(["/nobody"])) == []


@pytest.mark.parametrize("plugin", list(StoragePlugin))
def test_bags_of_other_recorders_are_read(tmp_path, plugin):
    """MCAP and SQLite, as `ros2 bag record` writes them (manual §5.4): bytes as they came, no facts of ours."""
    store = get_typestore(Stores.ROS2_HUMBLE)
    with Writer(tmp_path / "other", version=8, storage_plugin=plugin) as writer:
        connection = writer.add_connection(arm_state(Side.LEFT), "sensor_msgs/msg/JointState", typestore=store)
        writer.write(connection, BEGIN_NS, joints(5))
    with Bag(tmp_path / "other") as bag:
        assert [(m.topic, m.log_ns, m.payload) for m in bag.messages()] == [(arm_state(Side.LEFT), BEGIN_NS, joints(5))]
        assert bag.facts() == {}


def test_bags_without_definitions_are_read(tmp_path):
    """Humble's SQLite holds the names of types alone (manual §5.4); one that nobody knows is named when it is needed."""
    folder, store = tmp_path / "humble", get_typestore(Stores.ROS2_HUMBLE)
    with Writer(folder, version=8, storage_plugin=StoragePlugin.SQLITE3) as writer:
        connection = writer.add_connection(arm_state(Side.LEFT), "sensor_msgs/msg/JointState", typestore=store)
        writer.write(connection, BEGIN_NS, joints(5))
    for type_name in ("sensor_msgs/msg/JointState", "nobody_msgs/msg/Secret"):
        with contextlib.closing(sqlite3.connect(next(folder.glob("*.db3")))) as database:
            database.execute("DELETE FROM message_definitions")
            database.execute("UPDATE topics SET type = ?", [type_name])
            database.commit()
        metadata = folder / METADATA
        metadata.write_text(metadata.read_text().replace("sensor_msgs/msg/JointState", type_name))
        with Bag(folder) as bag:
            assert [m.payload for m in bag.messages()] == [joints(5)]
            if type_name.startswith("sensor"):
                (topic,) = bag.recorded_topics()
                assert "float64[] position" in topic.definition and topic.encoding == "ros2msg"
                assert list(bag.decode(type_name, joints(5)).position) == [0.5] * 7
                assert bag.copies().__next__().publish_ns == BEGIN_NS
                with pytest.raises(ValueError, match="JointState"):
                    bag.decode(type_name, b"")
            else:
                with pytest.raises(Rejected, match="nobody knows the definition of nobody_msgs/msg/Secret"):
                    bag.recorded_topics()


def test_a_span_of_it_is_read(folder):
    """Its begin is in it, its end is not; copies have the times of their senders."""
    with Bag(folder) as bag:
        begin_ns, end_ns = BEGIN_NS + 100_000_000, BEGIN_NS + 200_000_000
        times = [message.log_ns for message in bag.messages([arm_state(Side.LEFT)], begin_ns, end_ns)]
        assert (times[0], len(times)) == (begin_ns, 20)
        assert {copy.log_ns for copy in bag.copies(begin_ns, end_ns)} == set(times) | {BEGIN_NS + 100_000_000}
        assert bag.end_ns == max(m.log_ns for m in bag.messages()) + 1


def test_an_empty_bag_has_no_begin(tmp_path):
    """And no length."""
    BagWriter(tmp_path / "bag", TOPICS).finish()
    with Bag(tmp_path / "bag") as bag:
        assert (bag.message_count, bag.begin_ns, bag.duration_s, list(bag.messages())) == (0, 0, 0.0, [])


def test_what_is_no_bag_is_named(tmp_path):
    """Nothing there, an empty folder, rubbish; what is still being recorded, with the way out."""
    (tmp_path / "empty").mkdir()
    (tmp_path / "rubbish.mcap").write_bytes(b"rubbish" * 100)
    for name, why in (("nothing", "there is no"), ("empty", "cannot be read"), ("rubbish.mcap", "cannot be read")):
        with pytest.raises(Rejected, match=why):
            Bag(tmp_path / name)
    BagWriter(tmp_path / "bag", TOPICS).abandon()
    with pytest.raises(Rejected, match=r"still being recorded, or its recorder was killed.*ta2 record recover"):
        Bag(tmp_path / "bag")
