"""Rules of `gateway.link.mailbox`: newest only, copies skipped and counted, nothing lost between threads."""

from __future__ import annotations

import sys
import threading

import pytest

from cdr_types import encode
from gateway import robot
from gateway.link.mailbox import CAPACITY, Mailbox
from tests.link.stand_in import state_message

MS = 1_000_000
TOPIC = robot.CHASSIS_STATE


def payload(stamp_ns: int) -> bytes:
    """Return a joint state with this stamp."""
    return encode(state_message(TOPIC, stamp_ns))


@pytest.fixture
def box() -> Mailbox:
    """A mailbox of a type that carries a stamp."""
    return Mailbox(is_stamped=True)


def test_an_empty_mailbox_gives_nothing(box):
    """Nothing came, nothing is taken, no arrival is known."""
    assert box.take() is None
    assert box.newest_ns is None


def test_only_the_newest_sample_is_taken_and_all_are_counted(box):
    """The loop sees the latest value; the number of samples behind it tells the rate."""
    for n in range(1, 6):
        box.put(payload(n), n * MS)
    arrival = box.take()
    assert arrival.payload == payload(5)
    assert (arrival.received_ns, arrival.samples, arrival.duplicates) == (5 * MS, 5, 0)
    assert box.take() is None


@pytest.mark.parametrize("distance", [1, 2, 3, 4])
def test_a_copy_of_one_of_the_last_four_stamps_is_skipped(box, distance):
    """A bridge may deliver a sample again after up to three successors (wire.md 3.1 f)."""
    for n in range(1, 5):
        box.put(payload(n), n * MS)
    box.put(payload(5 - distance), 9 * MS)
    arrival = box.take()
    assert (arrival.samples, arrival.duplicates, arrival.received_ns) == (4, 1, 4 * MS)
    assert arrival.payload == payload(4)


def test_an_older_stamp_than_the_last_four_is_a_sample(box):
    """Only four stamps are remembered: what comes later counts as new."""
    for n in range(1, 6):
        box.put(payload(n), n * MS)
    box.put(payload(1), 6 * MS)
    assert box.take().samples == 6


def test_copies_are_recognised_across_takes(box):
    """The memory of stamps does not end with a tick."""
    box.put(payload(1), 1 * MS)
    assert box.take().samples == 1
    box.put(payload(1), 2 * MS)
    assert box.take() is None
    box.put(payload(2), 3 * MS)
    assert box.take().duplicates == 1
    box.put(payload(3), 4 * MS)
    assert box.take().duplicates == 0


def test_each_sample_n_times_is_counted_n_minus_one_times_as_duplicate(box):
    """The factor that a person must read, "state arrives N times", follows from the two counters."""
    for n in range(1, 101):
        for _ in range(3):
            box.put(payload(n), n * MS)
    arrival = box.take()
    assert (arrival.samples, arrival.duplicates) == (100, 200)


@pytest.mark.parametrize("stamp_ns", [0])
def test_a_stamp_that_was_never_set_makes_no_copies(box, stamp_ns):
    """A robot that leaves the stamp zero still has a state."""
    box.put(payload(stamp_ns), 1 * MS)
    box.put(payload(stamp_ns), 2 * MS)
    assert box.take().samples == 2


@pytest.mark.parametrize(
    "data", [b"", b"\x00\x01\x00\x00", b"\x00\x01\x00\x00" + bytes(7), b"junk, longer than a stamp"]
)
def test_payloads_without_a_stamp_reach_the_decoder(box, data):
    """What is wrong with a payload is for decoding to say; a short one is never taken for a copy."""
    box.put(data, 1 * MS)
    if len(data) < 12:
        box.put(data, 2 * MS)
    assert box.take().payload == data


def test_types_without_a_stamp_are_never_skipped():
    """Pose, Int32 and String carry no stamp: equal samples are samples."""
    box = Mailbox(is_stamped=False)
    for n in range(1, 4):
        box.put(payload(1), n * MS)
    arrival = box.take()
    assert (arrival.samples, arrival.duplicates) == (3, 0)


def test_the_worst_gap_is_the_longest_interval_between_samples(box):
    """Copies do not shorten a gap, and the interval across two takes counts."""
    for stamp, at_ms in [(1, 0), (2, 5), (2, 12), (3, 17), (4, 20)]:
        box.put(payload(stamp), at_ms * MS + 1)
    assert box.take().worst_gap_ns == 12 * MS
    box.put(payload(5), 60 * MS + 1)
    assert box.take().worst_gap_ns == 40 * MS


def test_the_first_sample_has_no_gap(box):
    """Before the first sample nothing is known: 0."""
    box.put(payload(1), 5 * MS)
    assert box.take().worst_gap_ns == 0


def test_the_newest_arrival_is_known_without_taking(box):
    """Whoever watches the route reads it from another thread; copies count, since the route carried them."""
    box.put(payload(1), 5 * MS)
    box.put(payload(1), 6 * MS)
    assert box.newest_ns == 6 * MS
    box.take()
    assert box.newest_ns == 6 * MS


def test_a_mailbox_that_nobody_empties_stays_bounded(box):
    """The oldest payloads go, the newest stays; the counter becomes a lower bound."""
    for n in range(1, CAPACITY + 500):
        box.put(payload(n), n * MS)
    arrival = box.take()
    assert arrival.samples == CAPACITY
    assert arrival.payload == payload(CAPACITY + 499)


@pytest.mark.parametrize("writers", [1, 2])
def test_no_sample_is_lost_or_taken_twice_between_threads(box, writers):
    """Samples and duplicates that are taken add up to what was put, with the loop taking all the time."""
    each = 6000
    taken = duplicates = 0
    interval_s = sys.getswitchinterval()
    sys.setswitchinterval(1e-5)

    def write(first: int) -> None:
        for n in range(first, first + each):
            # Never more than half full, so that nothing is forgotten however the threads are scheduled.
            while len(box._inbox) > CAPACITY // 2:
                pass
            data = payload(n + 1)
            box.put(data, n + 1)
            box.put(data, n + 1)

    threads = [threading.Thread(target=write, args=(k * each,)) for k in range(writers)]
    try:
        for thread in threads:
            thread.start()
        while any(thread.is_alive() for thread in threads) or box._inbox:
            arrival = box.take()
            if arrival is not None:
                taken += arrival.samples
                duplicates += arrival.duplicates
    finally:
        sys.setswitchinterval(interval_s)
        for thread in threads:
            thread.join()
    duplicates += box._duplicates
    assert taken + duplicates == 2 * each * writers
    if writers == 1:
        assert (taken, duplicates) == (each, each)
