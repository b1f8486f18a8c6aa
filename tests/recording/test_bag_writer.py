"""Tests of bags that are written: other people's readers find in them what was put in, and half a bag is no bag."""

from __future__ import annotations

import os
import sys

import pytest
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore
from ruamel.yaml import YAML

from gateway.errors import Rejected
from gateway.recording import bag_writer as module
from gateway.recording.bag_writer import ACTIVE, METADATA, BagWriter, bag_file, needed
from gateway.robot.topics import arm_state
from gateway.values import Side
from tests.recording.bags import ARM, BEGIN_NS, POSE, TOPICS, joints, payload, written


def test_rosbags_reads_folder_and_bare_file_and_decodes_each_message(tmp_path):
    """With types of its own: it knows nothing of ours."""
    folder = written(tmp_path / "bag", 0.5)
    store = get_typestore(Stores.ROS2_HUMBLE)
    for path in (folder, bag_file(folder)):
        with AnyReader([path], default_typestore=store) as reader:
            assert {c.topic: c.msgcount for c in reader.connections if c.msgcount}[arm_state(Side.LEFT)] == 100
            for connection, at_ns, raw in reader.messages():
                message = reader.deserialize(raw, connection.msgtype)
                assert BEGIN_NS <= at_ns < BEGIN_NS + 500_000_000
                if connection.topic == arm_state(Side.LEFT):
                    assert list(message.position) == [0.5] * 7


def test_mcap_finds_profile_schemas_qos_and_both_times(tmp_path):
    """As Foxglove and `ros2 bag` look for them; a message is byte for byte what it was."""
    bag = BagWriter(tmp_path / "bag", TOPICS)
    bag.add(ARM, BEGIN_NS + 5, 77, joints(77))
    bag.note({"task": "pick"})
    with bag.finish().open("rb") as file:
        reader = make_reader(file)
        assert reader.get_header().profile == "ros2"
        ((schema, channel, message),) = reader.iter_messages()
        assert (schema.name, schema.encoding) == ("sensor_msgs/msg/JointState", "ros2msg")
        assert (channel.topic, channel.message_encoding) == (arm_state(Side.LEFT), "cdr")
        assert YAML(typ="safe").load(channel.metadata["offered_qos_profiles"])[0]["reliability"] == 1
        assert (message.log_time, message.publish_time, message.data) == (BEGIN_NS + 5, 77, joints(77))
        assert [record.metadata for record in reader.iter_metadata()] == [{"task": "pick"}]


def test_metadata_is_of_version_5(tmp_path):
    """The one that Humble reads: QoS as a string; topics of which nothing came are left out."""
    folder = written(tmp_path / 'a "bag"', 0.5)
    facts = YAML(typ="safe").load((folder / METADATA).read_text())["rosbag2_bagfile_information"]
    assert facts["version"] == 5 and facts["storage_identifier"] == "mcap"
    assert facts["relative_file_paths"] == [bag_file(folder).name] == [facts["files"][0]["path"]]
    assert facts["starting_time"]["nanoseconds_since_epoch"] == BEGIN_NS
    topics = {row["topic_metadata"]["name"]: row for row in facts["topics_with_message_count"]}
    assert topics[arm_state(Side.LEFT)]["message_count"] == 100
    assert isinstance(topics[arm_state(Side.LEFT)]["topic_metadata"]["offered_qos_profiles"], str)
    assert "/api/fsm/enable" not in topics
    assert facts["message_count"] == sum(row["message_count"] for row in topics.values())


def test_a_bag_without_messages_is_a_bag(tmp_path):
    """Nothing came: readers say so, and do not fail."""
    bag = BagWriter(tmp_path / "bag", TOPICS)
    bag.finish()
    facts = YAML(typ="safe").load((tmp_path / "bag" / METADATA).read_text())["rosbag2_bagfile_information"]
    assert facts["message_count"] == 0 and facts["topics_with_message_count"] == []


def test_what_was_flushed_is_on_the_disk_however_little_it_is(tmp_path):
    """A chunk is closed by time, too: a robot that says little would leave minutes in memory."""
    bag = BagWriter(tmp_path / "bag", TOPICS)
    path = tmp_path / "bag" / f"bag_0.mcap{ACTIVE}"
    sizes = []
    for n in range(3):
        bag.add(POSE, BEGIN_NS + n, BEGIN_NS + n, payload(TOPICS[POSE], 0))
        bag.flush()
        sizes.append(path.stat().st_size)
    assert sizes == sorted(set(sizes)) and bag.size_bytes == sizes[-1]
    assert not bag_file(tmp_path / "bag").exists() and not (tmp_path / "bag" / METADATA).exists()
    bag.finish()
    assert not path.exists() and bag.size_bytes == bag_file(tmp_path / "bag").stat().st_size


def test_a_folder_that_holds_anything_is_refused(tmp_path):
    """No recording is ever overwritten, and nothing is left where it cannot be made."""
    (tmp_path / "bag").mkdir()
    (tmp_path / "bag" / "notes.txt").touch()
    with pytest.raises(Rejected, match=r"is not empty.*bags are never overwritten"):
        BagWriter(tmp_path / "bag", TOPICS)
    assert os.listdir(tmp_path / "bag") == ["notes.txt"]
    with pytest.raises(Rejected, match="cannot be written"):
        BagWriter(tmp_path / "bag" / "notes.txt" / "bag", TOPICS)


def test_without_the_packages_it_says_what_to_install(monkeypatch):
    """A base installation has none of them."""
    monkeypatch.setitem(sys.modules, "mcap.writer", None)
    with pytest.raises(Rejected, match=r"pip install 'teleavatar-gateway\[record\]'"):
        needed("mcap.writer")


def test_mcap_still_closes_chunks_as_we_ask(tmp_path):
    """It has no public way to: a release without this name must not be taken silently."""
    bag = BagWriter(tmp_path / "bag", TOPICS)
    assert callable(bag._writer._Writer__finalize_chunk)
    assert module.CHUNK_BYTES == 512 * 1024
    bag.abandon()


def test_where_chunks_are_is_kept_on_the_disk_until_the_end(tmp_path):
    """So memory stays flat; the file has no name, and every chunk is found by its topic afterwards."""
    bag = BagWriter(tmp_path / "bag", TOPICS)
    for n in range(50):
        bag.add(ARM, BEGIN_NS + n, n, joints(n))
        bag.flush()
    assert not isinstance(bag._writer._Writer__chunk_indices, list)
    assert [path.suffix for path in (tmp_path / "bag").iterdir()] == [ACTIVE]
    with bag.finish().open("rb") as file:
        reader = make_reader(file)
        chunks = reader.get_summary().chunk_indexes
        assert [(chunk.message_start_time, len(chunk.message_index_offsets)) for chunk in chunks] == [
            (BEGIN_NS + n, 1) for n in range(50)
        ]
        assert [message.publish_time for _, _, message in reader.iter_messages(arm_state(Side.LEFT))] == [*range(50)]


def test_a_disk_that_is_full_keeps_what_is_known_of_earlier_chunks(tmp_path, monkeypatch):
    """What was written in part is written over: nothing of it is taken for where a chunk is."""
    bag = BagWriter(tmp_path / "bag", TOPICS)
    bag.add(ARM, BEGIN_NS, 0, joints(0))
    bag.flush()
    spilled, kept = bag._indices, bag._indices._file

    class Full:
        """Takes a few bytes more."""

        def write(self, data):
            return kept.write(data[:5])

        def seek(self, place):
            return kept.seek(place)

    spilled._file = Full()
    bag.add(ARM, BEGIN_NS + 1, 1, joints(1))
    with pytest.raises(OSError, match="No space left"):
        bag.flush()
    spilled._file = kept
    spilled.append("another")
    found = list(spilled)
    assert found[0].message_start_time == BEGIN_NS and found[1:] == ["another"]
    bag.abandon()
    bag.abandon()
