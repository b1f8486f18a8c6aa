"""Tests of a recording, in virtual time: what is kept of times, gaps and losses, and how it ends."""

from __future__ import annotations

import json
import resource
import threading

import pytest
from mcap.reader import make_reader

from cdr_types import decode
from cdr_types.messages.std_msgs import String
from gateway.errors import Rejected
from gateway.recording import recorder as module
from gateway.recording.bag_writer import ACTIVE, bag_file
from gateway.recording.recorder import BEGIN_FREE_BYTES, LEAST_FREE_BYTES, Recorder
from gateway.recording.recovering import recover
from gateway.recording.topics import EPISODES, EVENTS, GATEWAY
from tests.recording.bags import ARM, BEGIN_NS, POSE, TOPICS, joints, payload

S, MS = 1_000_000_000, 1_000_000


class Desk:
    """A recorder with a clock, a wall clock and a disk of its own."""

    def __init__(self, folder):
        self.now_ns = 5 * S
        self.free = 100 * BEGIN_FREE_BYTES
        self.folder = folder / "bag"
        self.recorder = Recorder(
            self.folder,
            TOPICS,
            {"robot": "tcp/10.0.0.2:9000", "task": "pick"},
            wall_ns=lambda: BEGIN_NS,
            clock=lambda: self.now_ns,
            free_bytes=lambda path: self.free,
        )

    def hear(self, number, at_ns, data=None):
        self.recorder.take(number, at_ns, payload(TOPICS[number], at_ns) if data is None else data)

    def step(self, now_ns):
        self.now_ns = now_ns
        return self.recorder.step(now_ns)

    def messages(self):
        with bag_file(self.folder).open("rb") as file:
            return [(channel.topic, message) for _, channel, message in make_reader(file).iter_messages()]

    def facts(self):
        with bag_file(self.folder).open("rb") as file:
            return {k: v for record in make_reader(file).iter_metadata() for k, v in record.metadata.items()}


@pytest.fixture
def desk(tmp_path):
    """A recording that has begun, at 5 s of the monotonic clock."""
    desk = Desk(tmp_path)
    yield desk
    desk.recorder._bag.abandon()


def test_a_message_keeps_its_bytes_its_arrival_and_its_stamp(desk):
    """Arrival by the wall clock of the begin, kept by the monotonic one; the robot's stamp beside it; a pose has none."""
    desk.hear(ARM, 6 * S, joints(42 * S))
    desk.hear(POSE, 6 * S + 1)
    desk.step(7 * S)
    assert desk.recorder.finish() == bag_file(desk.folder)
    (arm, first), (pose, second) = desk.messages()
    assert (arm, first.log_time, first.publish_time, first.data) == (
        TOPICS[ARM].name,
        BEGIN_NS + S,
        42 * S,
        joints(42 * S),
    )
    assert (pose, second.log_time, second.publish_time) == (TOPICS[POSE].name, BEGIN_NS + S + 1, BEGIN_NS + S + 1)


def test_the_bag_tells_how_far_the_clocks_are_apart(desk):
    """By the smallest delay of each topic; and what it is, where and when it was recorded."""
    for after_ns in (30 * MS, 2 * MS, 9 * MS):
        desk.hear(ARM, 6 * S + after_ns, joints(BEGIN_NS + S - 100 * S))
    desk.recorder.finish()
    facts = desk.facts()
    assert facts[f"arrival_minus_stamp_ns{TOPICS[ARM].name}"] == str(100 * S + 2 * MS)
    assert (facts["robot"], facts["task"], facts["lost"], facts["error"]) == ("tcp/10.0.0.2:9000", "pick", "0", "")
    assert facts["begun_ns"] == str(BEGIN_NS) and facts["wall_minus_monotonic_ns"] == str(BEGIN_NS - 5 * S)


def test_what_cannot_be_read_is_recorded_all_the_same(desk):
    """A malformed message is what somebody wants to see later."""
    desk.hear(ARM, 6 * S, b"\x00\x01")
    desk.hear(ARM, 6 * S + 1, joints(0))  # a stamp that was never set
    desk.hear(ARM, 6 * S + 2, joints(-1))  # one before 1970
    desk.recorder.finish()
    assert [m.publish_time for _, m in desk.messages()] == [BEGIN_NS + S, BEGIN_NS + S + 1, BEGIN_NS + S + 2]
    assert not any(name.startswith("arrival_minus_stamp_ns") for name in desk.facts())


def test_what_the_gateway_tells_lies_among_the_robots_messages(desk):
    """As JSON in a ROS type, which every reader shows."""
    desk.now_ns = 6 * S
    desk.recorder.tell(EVENTS, {"code": "ESTOP", "message": "Ann's é"})
    desk.recorder.tell(GATEWAY, {"state": "HOLDING"})
    desk.recorder.finish()
    told = [(topic, json.loads(decode(m.data, String).data)) for topic, m in desk.messages()]
    assert told == [(EVENTS, {"code": "ESTOP", "message": "Ann's é"}), (GATEWAY, {"state": "HOLDING"})]


def test_gaps_are_counted_and_the_one_that_goes_on_is_seen(desk):
    """Five periods of a slow topic, 0.1 s of a fast one; nothing at all is silence, not a gap."""
    for at_ns in (6 * S, 6 * S + 99 * MS, 6 * S + 250 * MS):
        desk.hear(ARM, at_ns)
    progress = desk.step(6 * S + 300 * MS)
    assert progress.gaps == {TOPICS[ARM].name: (1, 151 * MS)}
    assert TOPICS[POSE].name in progress.silent and TOPICS[ARM].name not in progress.silent
    assert desk.step(6 * S + 751 * MS).gaps == {TOPICS[ARM].name: (2, 501 * MS)}


def test_what_came_is_on_the_disk_within_half_a_second(desk):
    """Whatever ends the process then."""
    path = desk.folder / f"bag_0.mcap{ACTIVE}"
    before = path.stat().st_size
    desk.hear(ARM, 6 * S)
    desk.step(5 * S + 400 * MS)
    assert path.stat().st_size == before
    desk.step(5 * S + 500 * MS)
    assert path.stat().st_size > before


def test_nobody_waits_for_a_disk_that_does_not_keep_up(desk, monkeypatch):
    """The queue is bounded, and what it does not hold is counted and told."""
    monkeypatch.setattr(module, "MOST_WAITING", 10)
    for n in range(25):
        desk.hear(ARM, 6 * S + n)
    progress = desk.step(7 * S)
    assert (progress.messages, progress.lost) == (10, 15)
    desk.recorder.finish()
    assert desk.facts()["lost"] == "15"


def test_a_nearly_full_disk_ends_a_recording_well(desk):
    """What was recorded is complete, and says why it ended."""
    desk.hear(ARM, 6 * S)
    desk.free = LEAST_FREE_BYTES - 1
    assert "nearly full" in desk.step(7 * S).error
    desk.hear(ARM, 8 * S)
    assert desk.step(9 * S).messages == 1  # nothing is written any more
    assert desk.recorder.finish() is not None and "nearly full" in desk.facts()["error"]


def test_none_begins_on_a_nearly_full_disk(tmp_path):
    """Nothing is made there."""
    with pytest.raises(Rejected, match=r"2\.1 GB are free there, 2\.1 GB are needed.*record elsewhere"):
        Recorder(tmp_path / "a" / "bag", TOPICS, {}, free_bytes=lambda path: BEGIN_FREE_BYTES - 1)
    assert not (tmp_path / "a").exists()


def test_a_disk_that_fails_ends_it_in_words(desk, monkeypatch):
    """The file stays as it is, to be recovered."""

    def fail():
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(desk.recorder._bag, "flush", fail)
    desk.hear(ARM, 6 * S)
    assert desk.step(7 * S).error == "the disk does not take it: No space left on device"
    monkeypatch.setattr(desk.recorder._bag, "finish", fail)
    assert desk.recorder.finish() is None
    assert (desk.folder / f"bag_0.mcap{ACTIVE}").exists()


def test_a_disk_that_takes_no_more_ends_it_in_words_whatever_still_waits(desk):
    """As a quota does: what is in the file's buffer then is tried once more when that is closed. The bag is recovered."""
    desk.hear(ARM, 6 * S)
    desk.step(6 * S)
    desk.hear(ARM, 7 * S)
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    try:  # Python ignores SIGXFSZ
        resource.setrlimit(resource.RLIMIT_FSIZE, ((desk.folder / f"bag_0.mcap{ACTIVE}").stat().st_size + 8, hard))
        error, file = desk.step(8 * S).error, desk.recorder.finish()
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert error == "the disk does not take it: File too large" and file is None
    assert recover(desk.folder).messages == 1


def test_a_recording_of_nothing_is_taken_away(desk):
    """With the folder that was made for it."""
    desk.recorder.discard()
    assert not desk.folder.exists()


def test_threads_may_take_while_it_writes(desk):
    """Each message once, those of one thread in their order."""

    def feed(number):
        for n in range(2000):
            desk.hear(number, 6 * S + n)

    threads = [threading.Thread(target=feed, args=(number,)) for number in (ARM, POSE)]
    for thread in threads:
        thread.start()
    while any(thread.is_alive() for thread in threads):
        desk.recorder.step(7 * S)
    desk.recorder.finish()
    messages = desk.messages()
    for number in (ARM, POSE):
        times = [m.log_time for topic, m in messages if topic == TOPICS[number].name]
        assert times == [BEGIN_NS + S + n for n in range(2000)]


def test_what_is_said_of_episodes_lies_at_its_time(desk, monkeypatch):
    """By the clock of the bag's arrivals; where there is no room for it, whoever said it hears of that."""
    desk.now_ns = 6 * S
    assert desk.recorder.tell(EPISODES, {"event": "start", "episode": 1})
    desk.step(7 * S)
    monkeypatch.setattr(module, "MOST_WAITING", 0)
    assert not desk.recorder.tell(EPISODES, {"event": "stop", "episode": 1})
    desk.recorder.finish()
    ((topic, message),) = desk.messages()
    assert topic == EPISODES and message.log_time == BEGIN_NS + S
    assert json.loads(decode(message.data, String).data) == {"event": "start", "episode": 1, "at_ns": BEGIN_NS + S}
