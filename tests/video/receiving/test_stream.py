"""Rules of `stream`, `depacketiser` and `picture`: datagrams become pictures, and nothing damaged is called intact."""

from __future__ import annotations

import random
from collections.abc import Iterable, Sequence
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.video.decoding.damage import Damage
from gateway.video.hevc.access_unit import AccessUnit
from gateway.video.receiving.counters import Counts
from gateway.video.receiving.reorder import HOLD_NS
from gateway.video.receiving.stream import RESTART_NS, SILENCE_NS, Stream
from tests.video.packets import (
    AUD,
    CRA,
    IDR,
    PPS,
    RASL,
    SPS,
    TICKS,
    TRAIL,
    VPS,
    Sender,
    fragments,
    picture,
    recovery_point_sei,
    rtp,
    slice_nal,
    split_annex_b,
)

ROBOT = "192.168.1.20"
MS = 1_000_000
FRAME_NS = 22_222_222


class Feed:
    """A stream that is given datagrams, at 45 pictures a second."""

    def __init__(self, **options) -> None:
        self.stream = Stream([ROBOT], **options)
        self.units: list[AccessUnit] = []
        self.now_ns = 1_000_000_000

    def give(self, pictures: Iterable[Sequence[bytes]], source: str = ROBOT) -> list[AccessUnit]:
        """Give the packets of pictures and wait for those that are held; return the pictures that came out."""
        before = len(self.units)
        for packets in pictures:
            for n, datagram in enumerate(packets):
                self.units += self.stream.receive(datagram, source, self.now_ns + n * 1000)
            self.now_ns += FRAME_NS
        self.units += self.stream.expire(self.now_ns + HOLD_NS)
        return self.units[before:]

    @property
    def counts(self) -> Counts:
        """The counters."""
        return self.stream.tally.snapshot()


def without(packets: Sequence[bytes], *lost: int) -> list[bytes]:
    """Return packets without those at some places."""
    gone = {n % len(packets) for n in lost}
    return [packet for n, packet in enumerate(packets) if n not in gone]


NALS = st.lists(
    st.builds(slice_nal, st.sampled_from([TRAIL, 0]), st.integers(4, 3000), st.integers(0, 99)), min_size=1, max_size=5
)


@given(
    pictures=st.lists(NALS, min_size=1, max_size=6),
    most=st.integers(8, 1400),
    seed=st.integers(0, 2**32),
    start=st.integers(0, 2**16 - 1),
)
def test_the_same_nal_units_come_out_whatever_the_network_swaps_and_repeats(pictures, most, seed, start) -> None:
    """Single, aggregated or fragmented (RFC 7798 section 4.4), packets up to a window late, some twice."""
    rng = random.Random(seed)
    sent = [[VPS, SPS, PPS, *nals] for nals in pictures]
    sender = Sender(seq=start, timestamp=rng.getrandbits(32), most=most)
    packets = [p for nals in sent for p in sender.send(nals)]
    packets = [p for p in packets for _ in range(1 + (rng.random() < 0.1))]
    keys = [n + rng.uniform(0, 3 if n < 3 else 12) for n in range(len(packets))]
    feed = Feed()
    units = feed.give([[packets[n] for n in sorted(range(len(packets)), key=keys.__getitem__)]])
    assert [split_annex_b(unit.data) for unit in units] == sent
    assert all(unit.is_intact and unit.lost == () for unit in units)
    assert [unit.seq for unit in units] == list(range(len(sent)))
    assert all(b.rtp_time - a.rtp_time == TICKS for a, b in pairwise(units))


@given(seed=st.integers(0, 2**32), part=st.sampled_from([0.005, 0.03, 0.3]), slices=st.integers(1, 4))
def test_no_picture_is_intact_of_which_a_packet_is_missing(seed: int, part: float, slices: int) -> None:
    """Each lost packet is told at the first picture it can concern, and only what may be damaged is called so."""
    rng = random.Random(seed)
    sender, packets, places = Sender(seq=rng.getrandbits(16)), [], {}
    start = sender.seq + 2**16
    for n in range(40):
        time = sender.timestamp
        sent = sender.send(picture(n, size=rng.choice([300, 5000]), slices=slices))
        places[time] = range(len(packets), len(packets) + len(sent))
        packets += sent
    kept = [n for n in range(len(packets)) if n < 6 or n in places[time] or rng.random() >= part]
    lost = set(range(len(packets))) - set(kept)
    order = list(kept)
    for n in range(5, len(order) - 1):
        if rng.random() < 0.05:
            order[n], order[n + 1] = order[n + 1], order[n]
    feed = Feed()
    units = feed.give([[packets[n] for n in order]])
    assert len({unit.rtp_time for unit in units}) == len(units)
    told_until = 0
    for unit in units:
        place = places[unit.rtp_time]
        is_whole, is_seen_to_begin = lost.isdisjoint(place), place[0] - 1 not in lost
        assert is_whole or not unit.is_intact, "damaged, and called intact"
        assert unit.is_intact or not (is_whole and (is_seen_to_begin or unit.is_irap)), "whole, and called damaged"
        told = {n - start for first, last in unit.lost for n in range(first, last + 1)}
        assert told <= lost and {n for n in lost if told_until <= n <= place[-1]} <= told
        told_until = place[-1] + 1
    counts = feed.counts
    assert counts.lost == len(lost) and counts.late == counts.duplicates == 0
    assert counts.broken == sum(not unit.is_intact for unit in units) and counts.pictures == len(units)


@pytest.mark.parametrize("lost", [0, 1, 3, -1])
def test_a_lost_packet_is_told_with_its_number_and_breaks_its_picture(lost: int) -> None:
    """The first, in the middle, the last: all three leave different traces."""
    feed, sender = Feed(), Sender(seq=1000)
    first, second, third, fourth = sender.pictures(range(4))
    units = {unit.rtp_time: unit for unit in feed.give([first, without(second, lost), third, fourth])}
    number = 65_536 + 1000 + len(first) + lost % len(second)
    assert units[50_000].is_intact and units[50_000 + 3 * TICKS].is_intact
    damaged = units.get(50_000 + TICKS)
    assert damaged is None if lost == 0 else not damaged.is_intact and (number, number) in damaged.lost
    behind = units[50_000 + 2 * TICKS]
    assert behind.is_intact is (lost != -1)
    assert ((number, number) in behind.lost) is (lost in (0, -1))
    assert units[50_000 + 3 * TICKS].lost == () and feed.counts.lost == 1


def test_the_picture_behind_a_lost_end_is_not_trusted_unless_its_beginning_is_proven() -> None:
    """The lost packets may have been its own; parameter sets and a delimiter stand at the beginning only."""
    feed, sender = Feed(), Sender()
    key, damaged, behind, again, last, key2 = sender.pictures([0, 1, 2, 3, 4, 10])
    units = feed.give([key, without(damaged, -1), behind, again, without(last, -1), key2])
    assert [unit.is_intact for unit in units] == [True, False, False, True, False, True]
    assert units[-1].lost and units[-1].is_irap, "the loss before it is told all the same"
    assert not units[-1].follows(units[-2])


def test_of_a_picture_of_which_nothing_came_the_number_is_left_out() -> None:
    """By the time between its neighbours: whoever counts pictures sees the hole."""
    feed, sender = Feed(), Sender()
    pictures = sender.pictures(range(8))
    units = feed.give([*pictures[:4], *pictures[6:]])
    assert [unit.seq for unit in units] == [0, 1, 2, 3, 6, 7]
    assert feed.counts.pictures_lost == 2 and feed.counts.lost == len(pictures[4]) + len(pictures[5])
    assert not units[4].follows(units[3]) and units[5].follows(units[4])


@pytest.mark.parametrize("header", [b"\x7e\x01", b"\x60\x01", b"\x64\x01", b"\x62\x00"])
def test_a_picture_of_which_nothing_can_be_read_is_missing(header: bytes) -> None:
    """No packet is lost: no type that is any, an AP that does not add up, PACI, fragments that are none."""
    feed, sender = Feed(), Sender()
    pictures = sender.pictures(range(8))
    pictures[4] = [packet[:12] + header + packet[14:] for packet in pictures[4]]
    units = feed.give(pictures)
    assert [unit.seq for unit in units] == [0, 1, 2, 3, 5, 6, 7] and feed.counts.lost == 0
    assert feed.counts.pictures_lost == 1 and not units[4].follows(units[3]) and units[5].follows(units[4])
    damage = Damage()
    assert [damage.judge(unit).clean for unit in units] == [True] * 4 + [False] * 3


def test_what_came_of_a_slice_before_a_loss_is_kept_and_what_came_behind_is_not() -> None:
    """The upper part of the picture can be shown, flagged."""
    feed, sender = Feed(), Sender()
    nal = slice_nal(TRAIL, 6000, 1)
    feed.give(sender.pictures(range(2)))
    (unit,) = feed.give([without(sender.send([nal]), 2)])
    assert unit.data == b"\0\0\0\1" + nal[: 2 + 2 * 1197]


def test_a_key_picture_without_parameter_sets_gets_those_that_were_sent_once() -> None:
    """Nobody knows whether the robot repeats them; the delimiter stays in front."""
    feed, sender = Feed(), Sender()
    key = slice_nal(IDR, 4000, 5)
    units = feed.give([sender.send(nals) for nals in (picture(0), picture(1), [key], picture(1), [AUD, PPS, key])])
    assert split_annex_b(units[2].data) == [VPS, SPS, PPS, key]
    assert split_annex_b(units[4].data) == [AUD, VPS, SPS, PPS, key]
    assert units[2].has_parameter_sets and units[4].has_parameter_sets
    assert feed.counts.parameter_sets_added == 2 and feed.counts.idrs == 3


def test_parameter_sets_sent_on_their_own_are_no_picture_and_are_remembered() -> None:
    """With a marker and a time of their own."""
    feed, sender = Feed(), Sender()
    units = feed.give([sender.send([VPS, SPS, PPS], ticks=0), sender.send([slice_nal(IDR, 3000, 1)])])
    assert [split_annex_b(unit.data)[:3] for unit in units] == [[VPS, SPS, PPS]]
    assert units[0].is_intact and units[0].has_parameter_sets and feed.counts.early_markers == 0


def test_a_key_picture_before_any_parameter_set_says_that_it_has_none() -> None:
    """A decoder waits for the next one."""
    feed, sender = Feed(), Sender()
    (unit,) = feed.give([sender.send([AUD, slice_nal(IDR, 3000, 1)])])
    assert unit.is_irap and unit.is_intact and not unit.has_parameter_sets
    assert feed.counts.parameter_sets_missing == 1 and not feed.stream.facts().knows_parameter_sets


def test_a_stream_of_cra_pictures_can_be_entered_at_each_of_them() -> None:
    """And a picture that refers to before it is known as such."""
    feed, sender = Feed(), Sender()
    nals = [[VPS, SPS, PPS, slice_nal(CRA, 900, 1)], [slice_nal(RASL, 900, 2)], [slice_nal(TRAIL, 900, 3)]]
    units = feed.give([sender.send(each) for each in nals])
    assert [unit.is_entry for unit in units] == [True, False, False]
    assert [unit.is_rasl for unit in units] == [False, True, False]
    assert (feed.counts.cras, feed.counts.idrs) == (1, 0)


def test_a_recovery_point_of_an_intra_refreshed_stream_is_named_and_gets_parameter_sets() -> None:
    """Decoding can begin there, and is right after so many pictures (H.265 section D.3.8)."""
    feed, sender = Feed(), Sender()
    sei, part = recovery_point_sei(2), slice_nal(TRAIL, 900, 3)
    units = feed.give([sender.send(nals) for nals in ([VPS, SPS, PPS, part], [part], [sei, part])])
    assert [unit.recovers_after for unit in units] == [None, None, 2]
    assert split_annex_b(units[2].data) == [VPS, SPS, PPS, sei, part]
    assert units[2].is_entry and not units[2].is_irap and feed.counts.recovery_points == 1


def test_without_markers_a_picture_ends_with_the_next_one_and_is_intact() -> None:
    """It costs a picture of latency, and is counted."""
    feed, sender = Feed(), Sender()
    units = feed.give([sender.send(picture(n), marker=False) for n in range(5)])
    assert [split_annex_b(unit.data) for unit in units] == [picture(n) for n in range(4)]
    assert all(unit.is_intact for unit in units) and feed.counts.no_marker == 4


def test_markers_on_every_slice_are_believed_no_longer() -> None:
    """Some senders set them; after a few pictures in pieces, none of them intact but the first piece, all are whole."""
    feed, sender = Feed(), Sender()
    sent = [picture(n, slices=3) for n in range(10)]
    packets = []
    for nals in sent:
        packets += [sender.send([nal], ticks=0) for nal in nals]
        sender.timestamp += TICKS
    units = feed.give(packets)
    assert [split_annex_b(unit.data) for unit in units[-6:]] == sent[3:9]
    assert all(unit.is_intact for unit in units[-6:])
    assert feed.counts.early_markers == 3


@pytest.mark.parametrize(
    "body",
    [b"", b"\x00", b"\x00\x09" + VPS, b"\x00\x00" + VPS, b"\x00\x04\x60\x01\xaa\xbb", b"\x00\x16" + VPS[:22] + b"\x00"],
)
def test_a_malformed_ap_is_counted_and_breaks_its_picture(body: bytes) -> None:
    """Nothing in it, sizes beyond its end or of nothing, another packet inside, a rest."""
    feed, sender = Feed(), Sender()
    feed.give(sender.pictures(range(2)))
    packets = [rtp(b"\x60\x01" + body, sender.seq, sender.timestamp)]
    packets.append(rtp(slice_nal(TRAIL, 500, 1), sender.seq + 1, sender.timestamp, marker=True))
    (unit,) = feed.give([packets])
    assert not unit.is_intact and unit.lost == () and feed.counts.malformed_ap == 1


@pytest.mark.parametrize(
    "order",
    [
        [1, 2, 3],  # no beginning
        [0, 1],  # no end
        [0, 1, 0, 1, 2, 3],  # begins again
    ],
)
def test_fragments_that_do_not_fit_together_break_their_picture(order: list[int]) -> None:
    """Though no packet is lost."""
    feed, sender = Feed(), Sender()
    feed.give(sender.pictures(range(2)))
    parts = fragments(slice_nal(TRAIL, 4000, 1), 1200)
    assert len(parts) == 4
    payloads = [slice_nal(TRAIL, 300, 2), *(parts[n] for n in order)]
    packets = [
        rtp(part, sender.seq + n, sender.timestamp, marker=n == len(payloads) - 1) for n, part in enumerate(payloads)
    ]
    (unit,) = feed.give([packets])
    assert not unit.is_intact and feed.counts.malformed_fu == 1


def test_a_fragment_of_another_unit_does_not_go_on_with_this_one() -> None:
    """Type, layer and temporal id are those of the first fragment."""
    for at, value in ((0, 0x63), (1, 2), (2, 19)):
        feed, sender = Feed(), Sender()
        feed.give(sender.pictures(range(2)))
        packets = sender.send([slice_nal(TRAIL, 5000, 1)])
        wrong = bytearray(packets[2])
        wrong[12 + at] = value
        (unit,) = feed.give([[*packets[:2], bytes(wrong), *packets[3:]]])
        assert not unit.is_intact and feed.counts.malformed_fu == 1


def test_a_fragment_without_content_is_none() -> None:
    """Wherever it stands."""
    for at in (0, 2, 4):
        feed, sender = Feed(), Sender()
        feed.give(sender.pictures(range(2)))
        packets = sender.send([slice_nal(TRAIL, 5000, 1)])
        packets[at] = packets[at][:15]
        feed.give([packets])
        assert feed.counts.broken == (at > 0) and feed.counts.malformed_fu + feed.counts.cut_short == 1


def test_what_a_loss_leaves_behind_ends_with_its_picture() -> None:
    """Fragments without a beginning in the next one are another fault, and break that one."""
    feed, sender = Feed(), Sender()
    feed.give(sender.pictures(range(2)))
    damaged, orphans = sender.send([slice_nal(TRAIL, 4000, 1)]), fragments(slice_nal(TRAIL, 4000, 1), 1200)
    packets = [
        rtp(part, sender.seq + n, sender.timestamp, marker=n == 2)
        for n, part in enumerate([*orphans[1:3], slice_nal(TRAIL, 300, 2)])
    ]
    (unit,) = feed.give([damaged[1:], packets])
    assert not unit.is_intact and feed.counts.malformed_fu == 1 and feed.counts.lost == 1


def test_a_fragment_that_begins_and_ends_is_malformed() -> None:
    """RFC 7798 section 4.4.3 forbids it."""
    feed, sender = Feed(), Sender()
    feed.give(sender.pictures(range(1)))
    feed.give([[rtp(b"\x62\x01\xc1" + bytes(20), sender.seq, sender.timestamp, marker=True)]])
    assert feed.counts.malformed_fu == 1


@pytest.mark.parametrize(
    ("payload", "counter"),
    [(b"\x64\x01\x00\x00", "paci"), (b"\x7e\x01\x00", "malformed_nal"), (b"\x02", "malformed_nal")],
)
def test_what_is_no_payload_of_this_receiver_is_counted(payload: bytes, counter: str) -> None:
    """PACI, a type that is none, too short."""
    feed, sender = Feed(), Sender()
    feed.give(sender.pictures(range(1)))
    feed.give([[rtp(payload, sender.seq, sender.timestamp, marker=True)]])
    assert getattr(feed.counts, counter) == 1


def with_donl(packets: Sequence[bytes], number: int) -> list[bytes]:
    """Return packets with DONL and DOND fields, as RFC 7798 section 4.4 puts them when sprop-max-don-diff is above 0."""
    result = []
    for packet in packets:
        header, payload, donl = packet[:12], packet[12:], number.to_bytes(2, "big")
        kind = payload[0] >> 1
        if kind == 48:
            body, at = donl, 2
            while at < len(payload):
                size = int.from_bytes(payload[at : at + 2], "big")
                body += (b"" if at == 2 else b"\x00") + payload[at : at + 2 + size]
                at += 2 + size
            payload = payload[:2] + body
        elif kind == 49:
            payload = payload[:3] + (donl if payload[2] & 0x80 else b"") + payload[3:]
        else:
            payload = payload[:2] + donl + payload[2:]
        result.append(header + payload)
    return result


@pytest.mark.parametrize("gop", [1, 1000])
def test_a_stream_with_donl_fields_ends_in_unsupported_and_no_picture_of_it_is_intact(gop: int) -> None:
    """They cannot be told from the packets, only from what goes on being malformed."""
    feed, sender = Feed(), Sender()
    units = feed.give([with_donl(sender.send(picture(n, gop=gop)), n) for n in range(12)])
    assert feed.stream.facts().unsupported in {"ap", "head"}
    assert not any(unit.is_intact for unit in units)


def test_a_stream_of_paci_packets_is_unsupported() -> None:
    """RFC 7798 section 4.4.4."""
    feed, sender = Feed(), Sender()
    for n in range(4):
        feed.give([[rtp(b"\x64\x01\x02\x00" + bytes(99), sender.seq + n, n * TICKS, marker=True)]])
    assert feed.stream.facts().unsupported == "paci"


def test_a_stream_that_is_right_again_is_supported_again() -> None:
    """What was malformed once is not held against it."""
    feed, sender = Feed(), Sender()
    feed.give([with_donl(sender.send(picture(n, gop=1)), n) for n in range(12)])
    feed.give(sender.pictures(range(20)))
    assert feed.stream.facts().unsupported == ""


def test_lossy_streams_are_not_called_unsupported() -> None:
    """What a loss leaves behind does not count as malformed."""
    feed, sender, rng = Feed(), Sender(), random.Random(1)
    for packets in sender.pictures(range(300), slices=2):
        feed.give([[p for p in packets if rng.random() > 0.1]])
        assert feed.stream.facts().unsupported == ""
    assert feed.counts.malformed_ap == feed.counts.malformed_fu == feed.counts.headless == 0
    assert feed.counts.broken > 100


def test_only_the_robots_address_is_listened_to() -> None:
    """§2.6.3 asks the same of the firewall."""
    feed, sender = Feed(), Sender()
    assert feed.give(sender.pictures(range(3)), source="192.168.1.66") == []
    assert feed.counts.bad_source == feed.counts.datagrams > 0
    assert feed.stream.facts().wrong_source == "192.168.1.66" and feed.stream.facts().packet_ns is None


def test_another_ssrc_cannot_take_the_stream_over_while_the_first_is_heard() -> None:
    """200 packets a second of somebody else change nothing, even from the robot's own address."""
    feed, sender, spoof = Feed(), Sender(), Sender(ssrc=666)
    units = []
    for n in range(100):
        units += feed.give([sender.send(picture(n)), spoof.send(picture(0, size=500))])
    units += feed.give([sender.send(picture(100))])
    assert len(units) == 101 and all(unit.is_intact and unit.ssrc == 7 and unit.life == 0 for unit in units)
    assert feed.counts.bad_ssrc == 100 and feed.counts.lives == 1


def test_a_new_ssrc_is_taken_after_the_old_one_was_silent_from_its_first_packet_on() -> None:
    """No probation: its parameter sets are in the first packet, and a whole group of pictures would be lost."""
    feed, sender = Feed(), Sender(seq=65_000)
    old = feed.give(sender.pictures(range(5)))
    feed.give([without(sender.send(picture(5)), -1)])
    feed.now_ns += SILENCE_NS
    new = Sender(ssrc=9, seq=3, timestamp=12)
    units = feed.give(new.pictures(range(3)))
    assert [(unit.life, unit.ssrc, unit.is_intact) for unit in units] == [(1, 9, True)] * 3
    assert [unit.seq for unit in units] == [5, 6, 7] and units[0].lost == ()
    assert not units[0].follows(old[-1]) and units[0].is_irap
    assert feed.counts.lives == 2 and feed.counts.abandoned == 1


@pytest.mark.parametrize("gap_ms", [0, 60, 150])
def test_a_sender_that_restarts_is_taken_from_its_first_key_picture_on(gap_ms) -> None:
    """After 0.1 s of the old one's silence: nothing is lost, and nothing is called another sender's."""
    feed = Feed()
    feed.give(Sender().pictures(range(5)))
    feed.now_ns += gap_ms * MS
    new = Sender(ssrc=9, seq=65_530, timestamp=12)
    taken = [len(feed.give([packets])) for packets in new.pictures(range(9))]
    waits = sum(gap_ms * MS + FRAME_NS * (n + 1) < RESTART_NS for n in range(9))
    assert taken == [0] * waits + [waits + 1] + [1] * (8 - waits)
    assert [(unit.life, unit.is_intact, unit.lost) for unit in feed.units[5:]] == [(1, True, ())] * 9
    assert all(
        a.first_packet_ns < b.first_packet_ns and a.complete_ns <= b.complete_ns for a, b in pairwise(feed.units)
    )
    assert feed.counts.bad_ssrc == 0 and feed.counts.packets == feed.counts.datagrams and feed.counts.lives == 2


def test_the_last_packets_of_the_old_sender_may_come_behind_the_first_of_the_new_one() -> None:
    """The network overtakes by some milliseconds; later ones are a stranger's and change nothing."""
    feed, old = Feed(), Sender()
    feed.give(old.pictures(range(5)))
    last, new = old.send(picture(5)), Sender(ssrc=9)
    first = new.send(picture(0))
    feed.give([[*last[:-1], *first[:2], last[-1], *first[2:]]])
    feed.give(new.pictures(range(1, 6)))
    assert [(unit.ssrc, unit.is_intact) for unit in feed.units] == [(7, True)] * 6 + [(9, True)] * 6
    assert feed.give([[last[-1]], *new.pictures(range(6, 8)), old.send(picture(6)), *new.pictures(range(8, 9))])
    assert feed.units[-1].life == 1 and feed.counts.lives == 2 and feed.counts.bad_ssrc == 1 + len(last)


def test_a_restart_without_a_key_picture_waits_for_one_or_for_the_long_silence() -> None:
    """Whichever comes first: what cannot be decoded is no proof."""
    feed = Feed()
    feed.give(Sender().pictures(range(5)))
    assert feed.give(Sender(ssrc=9).pictures(range(5, 10))) == []
    feed = Feed()
    feed.give(Sender().pictures(range(5)))
    units = feed.give(Sender(ssrc=9).pictures(range(4, 13)))
    assert units[0].is_irap and units[0].is_intact and len(units) == 3 and feed.counts.bad_ssrc > 0


@pytest.mark.parametrize("lost", [0, 2, -1])
def test_a_restart_whose_first_picture_is_not_whole_waits_for_the_next_one(lost) -> None:
    """A stranger has to send a stream that can be shown, and so has a sender."""
    feed, new = Feed(), Sender(ssrc=9)
    feed.give(Sender().pictures(range(5)))
    assert feed.give([without(new.send(picture(0)), lost), *new.pictures(range(1, 10))]) == []
    (unit,) = feed.give(new.pictures([10]))
    assert unit.is_irap and unit.is_intact and unit.lost == ()


def test_another_sender_elsewhere_has_to_wait_for_the_long_silence() -> None:
    """Also where packets are taken from anywhere: a restart has the same address."""
    feed = Feed()
    feed.stream = Stream(None)
    feed.give(Sender().pictures(range(5)))
    new = Sender(ssrc=9)
    assert feed.give(new.pictures(range(12)), source="192.168.1.66") == []
    feed.give(new.pictures(range(12, 16)), source="192.168.1.66")
    assert feed.stream.facts().source == "192.168.1.66"


def test_a_stranger_at_the_robots_address_cannot_take_over_a_sender_that_is_heard_now_and_then() -> None:
    """A packet each 90 ms is enough, also while the stranger sends whole streams beside it."""
    feed, sender, stranger = Feed(), Sender(), Sender(ssrc=9)
    feed.give(sender.pictures(range(5)))
    for n in range(5, 40):
        feed.give([sender.send(picture(n, size=500)), *stranger.pictures(range(3), size=500)])
    assert feed.counts.lives == 1 and {unit.ssrc for unit in feed.units} == {7}


def test_a_new_sender_does_not_inherit_parameter_sets() -> None:
    """They may differ; a decoder would be given nonsense."""
    feed = Feed()
    feed.give(Sender().pictures(range(2)))
    feed.now_ns += SILENCE_NS
    (unit,) = feed.give([Sender(ssrc=9).send([AUD, slice_nal(IDR, 3000, 1)])])
    assert not unit.has_parameter_sets


def test_a_sender_that_restarts_with_its_old_ssrc_is_a_new_life() -> None:
    """Time and sequence jump together; it may send at once."""
    feed, sender = Feed(), Sender(seq=30_000, timestamp=10_000_000)
    feed.give(sender.pictures(range(5)))
    units = feed.give(Sender(seq=0, timestamp=0).pictures(range(3)))
    assert [(unit.life, unit.is_intact, unit.lost) for unit in units] == [(1, True, ())] * 3
    assert feed.counts.lost == 0 and feed.counts.resyncs == 1


def test_an_outage_is_a_loss_and_no_new_life() -> None:
    """Sequence and time went on together: the pictures between are lost, the parameter sets still hold."""
    feed, sender = Feed(), Sender()
    feed.give(sender.pictures(range(5)))
    sender.seq += 9000
    sender.timestamp += 220 * TICKS
    feed.now_ns += 220 * FRAME_NS
    units = feed.give(sender.pictures(range(1, 12)))
    assert {unit.life for unit in units} == {0} and units[0].seq == 5 + 220
    assert not units[0].is_intact and units[1].is_intact
    assert feed.counts.lost == 9000 and feed.counts.pictures_lost == 220


def test_a_jump_within_a_picture_is_a_loss_too() -> None:
    """The same time before and behind it: no new sender begins in the middle of a picture."""
    feed, sender = Feed(), Sender()
    feed.give(sender.pictures(range(2)))
    parts = fragments(slice_nal(TRAIL, 6000, 1), 1000)
    packets = [
        rtp(part, sender.seq + n + (5000 if n > 2 else 0), sender.timestamp, marker=n == len(parts) - 1)
        for n, part in enumerate(parts)
    ]
    (unit,) = feed.give([packets])
    assert not unit.is_intact and unit.life == 0 and feed.counts.lost == 5000


def test_behind_a_lost_delimiter_a_picture_is_not_known_to_have_begun() -> None:
    """Where a sender sends delimiters, parameter sets alone are no proof."""
    feed, sender = Feed(), Sender(most=40)
    nals = [AUD + bytes(20), VPS, SPS, PPS, slice_nal(IDR, 500, 1)]
    first, second, third = (sender.send(nals) for _ in range(3))
    units = feed.give([first, without(second, -1), without(third, 0)])
    assert [unit.is_intact for unit in units] == [True, False, False]


def test_a_step_of_the_senders_clock_is_no_new_life() -> None:
    """The sequence is unbroken: nothing is missing, and time goes on by a usual step."""
    feed, sender = Feed(), Sender(timestamp=50_000_000)
    sent = sender.pictures(range(5))
    sender.timestamp -= 3 * 90_000
    units = feed.give([*sent, *sender.pictures(range(5, 9))])
    assert all(unit.is_intact and unit.life == 0 for unit in units)
    assert {b.rtp_time - a.rtp_time for a, b in pairwise(units)} == {TICKS}
    assert feed.counts.time_jumps == 1


def test_times_are_of_the_first_packet_and_of_the_last() -> None:
    """Whoever measures latency counts from the first."""
    feed, sender = Feed(), Sender()
    feed.give(sender.pictures(range(1)))
    packets = sender.send(picture(1))
    swapped = [packets[1], packets[0], *packets[2:]]
    begin_ns = feed.now_ns
    (unit,) = feed.give([swapped])
    assert unit.first_packet_ns == begin_ns
    assert unit.complete_ns == begin_ns + 1000 * (len(packets) - 1)


def test_a_picture_that_never_ends_is_cut_off() -> None:
    """A flood with one timestamp cannot fill the memory."""
    feed, sender = Feed(), Sender(most=60_000)
    feed.give(sender.pictures(range(1)))
    part = slice_nal(TRAIL, 60_000, 1)
    for n in range(300):
        feed.stream.receive(rtp(part, sender.seq + n, 999), ROBOT, feed.now_ns)
    (unit,) = feed.give([[rtp(part, sender.seq + 300, 999, marker=True)]])
    assert len(unit.data) < 9 << 20 and not unit.is_intact and feed.counts.oversize == 1


def test_the_facts_say_when_what_was_seen() -> None:
    """Diagnosis is made of them."""
    feed, sender = Feed(payload_type=98), Sender()
    assert feed.stream.facts().datagram_ns is None
    feed.give(sender.pictures(range(1)))
    facts = feed.stream.facts()
    assert facts.wrong_payload_type == 96 and facts.packet_ns is None and facts.datagram_ns is not None
    feed.give(Sender(payload_type=98).pictures(range(2)))
    facts = feed.stream.facts()
    assert (facts.life, facts.ssrc, facts.source) == (0, 7, ROBOT)
    assert facts.idr_ns == facts.entry_ns and facts.knows_parameter_sets


def test_what_is_held_is_given_up_in_time_while_only_others_are_heard() -> None:
    """Garbage and strangers do not keep the last picture back."""
    feed, sender = Feed(), Sender()
    feed.give(sender.pictures(range(2)))
    for packet in without(sender.send(picture(2)), 1):
        assert feed.stream.receive(packet, ROBOT, feed.now_ns) == []
    assert feed.stream.receive(b"?", ROBOT, feed.now_ns + HOLD_NS - 1) == []
    (unit,) = feed.stream.receive(b"?", "192.168.1.66", feed.now_ns + HOLD_NS)
    assert not unit.is_intact
