"""Rules of `gateway.link.mailbox`: newest only, copies skipped and counted, nothing lost between threads."""

from __future__ import annotations

import sys
import threading

import pytest

from cdr_types import encode
from gateway.link.mailbox import CAPACITY, SKIMMED, Mailbox, Tray
from gateway.robot.topics import CHASSIS_STATE
from tests.link.stand_in import Keepsake, state_message

MS = 1_000_000
TOPIC = CHASSIS_STATE


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


# ---------------------------------------------------------------------------------------------------------------- trays


class Ring:
    """What zenoh keeps for a tray, in the test's hand."""

    def __init__(self) -> None:
        self.kept: list[Keepsake] = []

    def drain(self) -> list[Keepsake]:
        kept, self.kept = self.kept, []
        return kept

    def add(self, *stamps_ns: int) -> None:
        self.kept += [Keepsake(payload(stamp_ns)) for stamp_ns in stamps_ns]


@pytest.fixture
def ring() -> Ring:
    """An empty ring."""
    return Ring()


@pytest.fixture
def tray(ring) -> Tray:
    """A tray of a type with a stamp, filled from the ring since 100 ms."""
    tray = Tray(is_stamped=True)
    tray.attach(ring.drain, 100 * MS)
    return tray


def test_a_tray_without_a_source_or_a_sample_gives_nothing(tray):
    """Before anything was declared, and before anything came."""
    assert Tray(is_stamped=False).look(1 * MS) is None
    assert tray.look(110 * MS) is None
    assert tray.newest_ns is None


def test_a_tray_gives_the_newest_and_counts_all(tray, ring):
    """As a mailbox does: latest only, and the number of samples behind it."""
    ring.add(1, 2, 3)
    arrival = tray.look(120 * MS)
    assert arrival.payload == payload(3)
    assert (arrival.samples, arrival.duplicates) == (3, 0)
    assert tray.look(130 * MS) is None


def test_a_sample_in_a_tray_counts_as_old_as_it_can_be(tray, ring):
    """It came after the look before: then, and not now, is its arrival, so no state looks younger than it is."""
    ring.add(1)
    assert tray.look(120 * MS).received_ns == 100 * MS
    assert tray.look(150 * MS) is None
    ring.add(2)
    assert tray.look(160 * MS).received_ns == 150 * MS
    assert tray.newest_ns == 150 * MS


def test_a_tray_skips_and_counts_copies_across_looks(tray, ring):
    """Copies alone are no sample, but the route carried them; they are told with the next sample."""
    ring.add(1, 1)
    assert tray.look(120 * MS).duplicates == 1
    ring.add(1)
    assert tray.look(130 * MS) is None
    assert tray.newest_ns == 120 * MS
    ring.add(2, 1, 3)
    arrival = tray.look(140 * MS)
    assert (arrival.samples, arrival.duplicates) == (2, 2)


def test_what_was_skimmed_is_as_old_as_the_skim_says_and_read_by_the_next_look(tray, ring):
    """Who only wants to know when samples come need not read them; whoever reads them later knows when they came."""
    ring.add(1)
    tray.skim(120 * MS)
    assert tray.newest_ns == 100 * MS
    ring.add(2)
    tray.skim(140 * MS)
    tray.skim(160 * MS)
    assert tray.newest_ns == 120 * MS
    arrival = tray.look(180 * MS)
    assert (arrival.payload, arrival.received_ns, arrival.samples) == (payload(2), 120 * MS, 2)
    assert tray.look(190 * MS) is None
    tray.skim(200 * MS)
    ring.add(2, 3)
    arrival = tray.look(210 * MS)
    assert (arrival.payload, arrival.received_ns, arrival.duplicates) == (payload(3), 200 * MS, 1)


def test_a_tray_that_is_only_skimmed_keeps_the_newest_samples(tray, ring):
    """However long nobody reads, a few are enough to know the state and its copies."""
    for n in range(1, 100):
        ring.add(n)
        tray.skim((100 + n) * MS)
    arrival = tray.look(300 * MS)
    assert (arrival.payload, arrival.received_ns, arrival.samples) == (payload(99), 198 * MS, SKIMMED)


def test_samples_without_a_stamp_are_never_copies_in_a_tray(ring):
    """A pose that does not change is a state that is alive."""
    tray = Tray(is_stamped=False)
    tray.attach(ring.drain, 0)
    ring.add(1, 1, 1)
    assert tray.look(5 * MS).samples == 3


def test_a_steady_topic_shows_its_period_as_gap_however_seldom_it_is_looked_at(tray, ring):
    """200 Hz looked at every 40 ms has no gap of 40 ms."""
    gaps_ns = []
    for n in range(4):
        ring.add(*range(8 * n + 1, 8 * n + 9))
        gaps_ns.append(tray.look((140 + 40 * n) * MS).worst_gap_ns)
    assert gaps_ns == [0, 5 * MS, 5 * MS, 5 * MS]


def test_a_silence_between_looks_is_a_gap(tray, ring):
    """From the look that found the last sample to the last look that found none: that long it was silent for sure."""
    ring.add(1)
    tray.look(110 * MS)
    for at_ms in (120, 130, 140, 150):
        assert tray.look(at_ms * MS) is None
    ring.add(2, 3)
    assert tray.look(160 * MS).worst_gap_ns == 40 * MS


def test_a_new_subscription_takes_over_and_nothing_of_it_is_older_than_itself(tray):
    """A route that was declared again goes on in the same tray; the silence before it stays a gap."""
    first, second = Ring(), Ring()
    tray.attach(first.drain, 100 * MS)
    first.add(1)
    tray.look(110 * MS)
    first.add(2)
    second.add(3)
    tray.attach(second.drain, 900 * MS)
    arrival = tray.look(905 * MS)
    assert (arrival.payload, arrival.received_ns, arrival.worst_gap_ns) == (payload(3), 900 * MS, 790 * MS)
    tray.attach(second.drain, 902 * MS)
    second.add(4)
    assert tray.look(910 * MS).received_ns == 905 * MS


@pytest.mark.parametrize("data", [b"", b"\x00\x01\x00\x00", payload(0)])
def test_payloads_without_a_stamp_pass_a_tray(tray, ring, data):
    """Too short for one, or it was never set: never a copy, and what is wrong with it is for decoding to say."""
    ring.kept = [Keepsake(payload(9)), Keepsake(data), Keepsake(data)]
    arrival = tray.look(120 * MS)
    assert (arrival.payload, arrival.samples, arrival.duplicates) == (data, 3, 0)


@pytest.mark.parametrize("kind", [Mailbox, Tray])
def test_the_tally_counts_all_that_was_taken(kind):
    """Samples without copies, copies apart, the arrival of the newest; what nobody took is not counted yet."""
    box = kind(is_stamped=True)
    kept = []
    if isinstance(box, Tray):
        box.attach(lambda: [kept.pop(0) for _ in range(len(kept))], 0)

    def come(now_ns, *stamps):
        if isinstance(box, Tray):
            kept.extend(Keepsake(payload(stamp)) for stamp in stamps)
            box.look(now_ns)
            return
        for stamp in stamps:
            box.put(payload(stamp), now_ns)
        box.take()

    assert box.tally == (0, 0, None)
    come(10 * MS, 1, 2, 3)
    come(20 * MS, 3, 4, 4, 4)
    assert (box.tally.samples, box.tally.copies) == (4, 3)
    assert box.tally.last_ns == (10 * MS if kind is Tray else 20 * MS)  # a tray says the look before
    before = box.tally
    come(30 * MS, 4)
    assert box.tally == before
    come(40 * MS, 5)
    assert (box.tally.samples, box.tally.copies) == (5, 4)
