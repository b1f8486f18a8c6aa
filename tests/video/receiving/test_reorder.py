"""Rules of `gateway.video.receiving.reorder`: order restored within the window, everything else counted as what it is."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.video.receiving.counters import Tally
from gateway.video.receiving.reorder import HOLD_NS, MAX_DROPOUT, START, Ordered, Reorder
from gateway.video.receiving.rtp import RtpPacket

MS = 1_000_000


def packet(seq: int) -> RtpPacket:
    """Return a packet with a sequence number, whatever its 16 bits make of it."""
    return RtpPacket(seq % 2**16, 0, 7, False, seq.to_bytes(8, "big"))


class Feed:
    """A window that is given packets, one each millisecond tenth."""

    def __init__(self, window: int = 16, first: int = 65_500) -> None:
        self.tally = Tally()
        self.reorder = Reorder(self.tally, window)
        self.out: list[Ordered] = []
        self.now_ns = 0
        self.give(*range(first, first + START + 1))
        self.next = first + START + 1

    def give(self, *seqs: int, after_ns: int = MS // 10) -> None:
        """Give packets."""
        for seq in seqs:
            self.now_ns += after_ns
            self.out += self.reorder.put(packet(seq), self.now_ns)

    @property
    def seqs(self) -> list[int]:
        """What came out, as it was given."""
        return [int.from_bytes(ordered.packet.payload, "big") for ordered in self.out]

    def count(self, name: str) -> int:
        """Return a counter."""
        return int(getattr(self.tally.snapshot(), name))


def test_packets_in_order_pass_at_once_and_the_sequence_never_falls() -> None:
    """Across the turn of 16 bits."""
    feed = Feed()
    feed.give(*range(feed.next, feed.next + 70_000))
    numbers = [ordered.seq for ordered in feed.out]
    assert feed.seqs == list(range(65_500, 65_505 + 70_000))
    assert numbers == list(range(numbers[0], numbers[0] + len(numbers)))
    assert feed.count("lost") == feed.count("reordered") == feed.count("late") == 0


@given(data=st.data(), window=st.integers(4, 32))
def test_any_order_within_the_window_is_restored(data: st.DataObject, window: int) -> None:
    """No packet comes behind one that is more than the window later; the first ones of the stream too."""
    count = data.draw(st.integers(5, 80))
    keys = [n + data.draw(st.integers(0, min(window, START) - 1 if n < START else window - 1)) for n in range(count)]
    order = sorted(range(count), key=lambda n: (keys[n], n))
    feed = Reorder(tally := Tally(), window)
    out = [o for n, seq in enumerate(order) for o in feed.put(packet(seq), n)]
    out += feed.expire(len(order) + HOLD_NS)
    assert [int.from_bytes(o.packet.payload, "big") for o in out] == list(range(count))
    assert all(o.lost == 0 for o in out) and tally.snapshot().lost == tally.snapshot().late == 0


@given(data=st.data(), window=st.integers(4, 32))
def test_every_packet_is_either_passed_on_once_or_counted(data: st.DataObject, window: int) -> None:
    """Under loss, swaps and duplicates: what comes out rises, and each hole in it is said where it is."""
    count = 200
    kept = [n for n in range(count) if n < START + 1 or data.draw(st.integers(0, 9))]
    sent = sorted(kept + data.draw(st.lists(st.sampled_from(kept), max_size=20)), key=lambda n: n + hash((n, 3)) % 5)
    feed = Reorder(tally := Tally(), window)
    out = [o for n, seq in enumerate(sent) for o in feed.put(packet(seq), n)]
    out += feed.expire(len(sent) + HOLD_NS)
    counts, numbers = tally.snapshot(), [o.seq for o in out]
    assert all(b - a == o.lost + 1 for a, b, o in zip(numbers, numbers[1:], out[1:], strict=False))
    assert len(out) + counts.late + counts.duplicates == len(sent)
    assert counts.lost == sum(o.lost for o in out)


def test_a_gap_is_given_up_when_the_window_is_full() -> None:
    """And the packet that comes then is late."""
    feed = Feed(window=4)
    feed.give(*range(feed.next + 2, feed.next + 6))
    assert len(feed.seqs) == START + 1, "four are held"
    feed.give(feed.next + 6)
    assert feed.out[START + 1].lost == 2 and feed.count("lost") == 2
    feed.give(feed.next)
    assert feed.count("late") == 1 and feed.count("duplicates") == 0


def test_a_gap_is_given_up_when_it_was_waited_for_too_long() -> None:
    """Also while nothing comes; latency is bounded by time, not by packets alone."""
    feed = Feed()
    feed.give(feed.next + 1)
    assert feed.reorder.expire(feed.now_ns + HOLD_NS - 1) == []
    assert [o.lost for o in feed.reorder.expire(feed.now_ns + HOLD_NS)] == [1]


def test_a_packet_that_comes_again_is_a_duplicate_wherever_the_first_one_is() -> None:
    """Held, or passed on long ago."""
    feed = Feed()
    feed.give(feed.next + 1, feed.next + 1, 65_501)
    assert feed.count("duplicates") == 2 and feed.count("late") == 0


def test_a_late_packet_that_was_received_before_the_turn_is_not_taken_for_an_early_one() -> None:
    """Behind the expected number by a little: never ahead by nearly 2^16."""
    feed = Feed()
    feed.give(*range(feed.next, feed.next + 100))
    before = len(feed.out)
    feed.give(feed.next - 40)
    assert len(feed.out) == before and feed.count("strays") == 0


def test_the_very_first_packet_may_be_overtaken() -> None:
    """The parameter sets of a whole group of pictures are in it."""
    feed = Reorder(tally := Tally())
    out = [o for n, seq in enumerate([11, 10, 12, 13, 14]) for o in feed.put(packet(seq), n)]
    assert [o.packet.seq for o in out] == [10, 11, 12, 13, 14] and tally.snapshot().lost == 0


def test_a_sender_of_few_packets_does_not_wait_for_more() -> None:
    """The first packets are held for the usual time only."""
    feed = Reorder(Tally())
    assert feed.put(packet(10), 0) == []
    assert [o.packet.seq for o in feed.expire(HOLD_NS)] == [10]


def test_one_packet_far_off_is_a_stray_and_changes_nothing() -> None:
    """Whoever guesses the SSRC cannot take the sequence away with one packet."""
    feed = Feed()
    feed.give(feed.next + 20_000, feed.next, feed.next + 40_000, feed.next + 1)
    assert feed.seqs[-2:] == [feed.next, feed.next + 1]
    feed.give(feed.next + 21_000, feed.next + 31_000, feed.next + 21_002, feed.next + 2)
    assert feed.seqs[-1] == feed.next + 2
    assert feed.count("strays") == 5 and feed.count("lost") == feed.count("resyncs") == 0


@pytest.mark.parametrize("jump", [MAX_DROPOUT + 1, 30_000, -600, -20_000])
def test_two_packets_in_a_row_far_off_are_a_jump_and_are_followed(jump: int) -> None:
    """Forward or backward; nothing behind it is thrown away, and the sequence rises."""
    feed = Feed()
    feed.give(feed.next + 1)  # is held, and must not be forgotten
    start = feed.next + jump
    feed.give(*range(start, start + 3))
    assert feed.seqs[-4:] == [feed.next + 1, start, start + 1, start + 2]
    assert [o.is_jump for o in feed.out[-3:]] == [True, False, False]
    numbers = [o.seq for o in feed.out]
    assert numbers == sorted(set(numbers))
    assert feed.out[-3].lost == (jump - 2) % 2**16 and feed.count("resyncs") == 1
    assert feed.count("lost") == 1, "what a jump passes over is for the stream to judge"


@pytest.mark.parametrize("window", [3, 33])
def test_a_window_out_of_its_bounds_is_refused(window: int) -> None:
    """The error has value, bounds and unit."""
    with pytest.raises(ValueError, match=rf"{window} is outside \[4, 32\] packets"):
        Reorder(Tally(), window)


def test_what_is_held_is_bounded() -> None:
    """Whatever comes, no more than a window."""
    feed = Feed()
    for n in range(2000):
        feed.give(feed.next + 1 + 7 * n % 2999)
        assert len(feed.reorder._held) <= 16


def test_packets_that_went_by_are_known_to_have_come() -> None:
    """Over the turn of the numbers: the next one is in order, and each of them coming again is a duplicate."""
    feed = Feed()
    assert feed.reorder.is_newest(packet(feed.next - 1))
    feed.reorder.pass_over(300)
    assert feed.reorder.is_newest(packet(feed.next + 299)) and not feed.reorder.is_newest(packet(feed.next - 1))
    feed.give(feed.next + 7, feed.next + 299, feed.next + 300)
    assert feed.count("duplicates") == 2 and feed.seqs[-1] == feed.next + 300
    assert feed.out[-1].seq == feed.out[-2].seq + 301 and feed.count("lost") == 0


def test_nothing_is_the_newest_while_something_is_held_or_before_anything_came() -> None:
    """What is held may be its successor's successor."""
    assert not Reorder(Tally()).is_newest(packet(7))
    feed = Feed()
    feed.give(feed.next + 1)
    assert not feed.reorder.is_newest(packet(feed.next - 1))
