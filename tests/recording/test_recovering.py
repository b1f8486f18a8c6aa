"""Tests of bags that were cut off: what was on the disk is a bag again, wherever it was torn."""

from __future__ import annotations

import random

import pytest

from gateway.errors import Rejected
from gateway.recording.bag_check import check
from gateway.recording.bag_reader import Bag
from gateway.recording.bag_writer import ACTIVE, METADATA, OFFSET, BagWriter, bag_file
from gateway.recording.recorder import FLUSH_NS, Recorder
from gateway.recording.recovering import recover
from tests.recording.bags import ARM, BEGIN_NS, POSE, TOPICS, joints, payload


@pytest.fixture
def torn(tmp_path):
    """A folder whose recorder was killed after 20 flushes of 50 messages each."""
    bag = BagWriter(tmp_path / "bag", TOPICS)
    bag.note({"task": "pick"})
    for n in range(1000):
        bag.add(ARM, BEGIN_NS + n, n + 1, joints(n + 1))
        if n % 50 == 49:
            bag.flush()
    bag.add(ARM, BEGIN_NS + 1000, 1, joints(1))  # never flushed
    bag.abandon()
    return tmp_path / "bag"


def test_everything_that_was_flushed_is_there_again(torn):
    """A bag like any other, facts and QoS included; the torn file is gone."""
    found = recover(torn)
    assert (found.file, found.messages) == (bag_file(torn), 1000)
    assert sorted(path.name for path in torn.iterdir()) == ["bag_0.mcap", METADATA]
    with Bag(torn) as bag:
        assert [m.payload for m in bag.messages()] == [joints(n + 1) for n in range(1000)]
        assert bag.facts()["task"] == "pick"
        assert any("was killed" in finding.message for finding in check(bag).findings)


@pytest.mark.parametrize("seed", range(8))
def test_wherever_it_was_torn_what_is_whole_is_kept(torn, seed):
    """A power cut leaves any length, with rubbish in the last 4 kB: whole flushes are kept, no message is changed."""
    path = torn / f"bag_0.mcap{ACTIVE}"
    data, rng = bytearray(path.read_bytes()), random.Random(seed)
    del data[rng.randrange(len(data) // 2, len(data)) :]
    data[-4096:] = rng.randbytes(min(4096, len(data)))
    path.write_bytes(data)
    found = recover(torn)
    assert found.torn
    with Bag(torn) as bag:
        payloads = [m.payload for m in bag.messages()]
    assert len(payloads) == found.messages and payloads == [joints(n + 1) for n in range(len(payloads))]
    assert found.messages % 50 == 0 and found.messages >= 50


def test_a_recovered_bag_tells_how_far_the_clocks_are_apart(tmp_path):
    """As one that ended well: by the smallest delay of each topic that has stamps."""
    facts = {}
    for name, end in (("whole", Recorder.finish), ("killed", Recorder.abandon)):
        recorder = Recorder(tmp_path / name, TOPICS, {}, wall_ns=lambda: BEGIN_NS, clock=lambda: 0)
        for late_ns in (30, 2, 9):
            recorder.take(ARM, late_ns, joints(BEGIN_NS - 100))
            recorder.take(POSE, late_ns, payload(TOPICS[POSE], 0))
        recorder.step(FLUSH_NS)
        end(recorder)
        if name == "killed":
            recover(tmp_path / name)
        with Bag(tmp_path / name) as bag:
            facts[name] = {fact: value for fact, value in bag.facts().items() if fact.startswith(OFFSET)}
    assert facts["killed"] == facts["whole"] == {f"{OFFSET}{TOPICS[ARM].name}": "102"}


def test_what_the_disk_lost_behind_the_messages_takes_none_of_them(torn):
    """Killed while it was ending: what the end repeats, here a channel, is not needed."""
    path = recover(torn).file
    data, lost = bytearray(path.read_bytes()), 64
    summary = int.from_bytes(data[-28:-20], "little")  # its place is in the footer, before 8 bytes of magic
    begin = data.index(TOPICS[ARM].name.encode(), summary) - 8  # the channel's number, its schema's, the name's length
    data[begin : begin + lost] = bytes(lost)
    path.with_name(path.name + ACTIVE).write_bytes(data)
    assert recover(torn).messages == 1000


def test_a_file_of_nothing_is_a_bag_of_nothing(torn):
    """Killed before the first byte."""
    (torn / f"bag_0.mcap{ACTIVE}").write_bytes(b"")
    assert recover(torn).messages == 0


def test_what_is_still_being_recorded_is_not_touched(tmp_path):
    """All that followed would be lost; whatever ends the recorder gives the bag free."""
    bag = BagWriter(tmp_path / "bag", TOPICS)
    bag.add(ARM, BEGIN_NS, BEGIN_NS, joints(1))
    bag.flush()
    with pytest.raises(Rejected, match="is being recorded: end that first"):
        recover(tmp_path / "bag")
    assert [path.name for path in (tmp_path / "bag").iterdir()] == [f"bag_0.mcap{ACTIVE}"]
    bag.abandon()
    assert recover(tmp_path / "bag").messages == 1


def test_what_is_complete_is_not_touched(torn):
    """Nor is a folder without any."""
    recover(torn)
    before = bag_file(torn).read_bytes()
    with pytest.raises(Rejected, match="nothing to recover"):
        recover(torn)
    assert bag_file(torn).read_bytes() == before


def test_what_cannot_be_written_leaves_the_torn_file(torn):
    """It can be tried again elsewhere."""
    (torn / "bag_0.mcap.recovering").mkdir()
    with pytest.raises(Rejected, match="cannot be recovered"):
        recover(torn)
    assert (torn / f"bag_0.mcap{ACTIVE}").exists()
