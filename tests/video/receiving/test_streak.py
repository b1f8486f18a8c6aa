"""Rules of `gateway.video.receiving.streak`: it takes only what is just what is expected, and changes nothing but the cost."""

from __future__ import annotations

import random
import struct

import pytest

from gateway.video.hevc.access_unit import AccessUnit
from gateway.video.receiving.counters import Counts
from gateway.video.receiving.rtp import RtpPacket, parse
from gateway.video.receiving.streak import MAX_BYTES, Streak
from gateway.video.receiving.stream import Stream
from tests.video.bad_network import ROBOT, BadNetwork, Faults
from tests.video.packets import IDR, Sender, fragments, picture, rtp, slice_nal, split_annex_b

FRAME_NS = 22_222_222
PARTS = fragments(slice_nal(IDR, 6000, 1), 1000)
AWAITS = PARTS[1][:3]


def streak(seq: int = 100) -> Streak:
    """Return one that began with the first fragment of a NAL unit."""
    first = parse(rtp(PARTS[0], seq, 5000))
    assert isinstance(first, RtpPacket)
    return Streak(first, AWAITS, ROBOT, 96)


def test_what_follows_is_taken_without_its_headers() -> None:
    """In the order of the sequence numbers, over their turn to 0."""
    going = streak(2**16 - 2)
    for n, part in enumerate(PARTS[1:4], start=1):
        assert going.takes(memoryview(rtp(part, 2**16 - 2 + n, 5000)), ROBOT)
    assert going.pieces == [part[3:] for part in PARTS[1:4]]


@pytest.mark.parametrize(
    "datagram",
    [
        rtp(PARTS[1], 102, 5000),
        rtp(PARTS[1], 100, 5000),
        rtp(PARTS[1], 101, 5001),
        rtp(PARTS[1], 101, 5000, ssrc=8),
        rtp(PARTS[1], 101, 5000, marker=True),
        rtp(PARTS[1], 101, 5000, payload_type=97),
        b"\x90" + rtp(PARTS[1], 101, 5000)[1:],
        rtp(PARTS[1][:-1], 101, 5000),
        rtp(PARTS[1] + b"x", 101, 5000),
        rtp(PARTS[0], 101, 5000),
        rtp(PARTS[1][:2] + bytes((PARTS[1][2] | 0x40,)) + PARTS[1][3:], 101, 5000),
        rtp(PARTS[1], 101, 5000)[:14],
        b"",
    ],
    ids="a gap,again,time,ssrc,marker,type,extension,short,long,a start,an end,headers only,nothing".split(","),
)
def test_anything_else_is_not_taken(datagram: bytes) -> None:
    """It goes through all layers; what is expected stays the same."""
    going = streak()
    assert not going.takes(datagram, ROBOT) and going.pieces == []
    assert going.takes(rtp(PARTS[1], 101, 5000), ROBOT)


def test_nothing_of_another_address_is_taken() -> None:
    """Not even what is right in every bit."""
    assert not streak().takes(rtp(PARTS[1], 101, 5000), "192.168.1.66")


def test_a_streak_has_an_end() -> None:
    """A megabyte: then the layers see it, and cut off a picture that never ends."""
    going, taken = streak(), 0
    while going.takes(rtp(PARTS[1], 101 + taken, 5000), ROBOT):
        taken += 1
    assert 0.99 * MAX_BYTES < taken * going.size <= MAX_BYTES


def received(datagrams: list[tuple[bytes, str, int]]) -> tuple[list[AccessUnit], Counts]:
    """Return what becomes of datagrams: bytes, address, time."""
    stream, units = Stream([ROBOT]), []
    for data, source, now_ns in datagrams:
        units += stream.receive(data, source, now_ns) if data is not SILENCE else stream.expire(now_ns)
    return units, stream.tally.snapshot()


SILENCE = bytes(1)
FAULTS = (
    Faults(),
    Faults(loss_p=0.02),
    Faults(swap_p=0.1, duplicate_p=0.05),
    Faults(garbage_p=0.1, spoof_p=0.1, spoofs_address=True),
    Faults(truncate_p=0.05),
    Faults(loss_p=0.02, burst_p=0.002, swap_p=0.1, duplicate_p=0.1, truncate_p=0.02, garbage_p=0.05, spoof_p=0.05),
)


@pytest.mark.parametrize("faults", FAULTS, ids=str)
@pytest.mark.parametrize("seed", [1, 2])
def test_pictures_and_counters_are_the_same_without_it(faults: Faults, seed: int, monkeypatch) -> None:
    """On every network, with silence and restarts between: it is no more than a short way through the layers."""
    network, chance, now_ns, datagrams = BadNetwork(faults, seed), random.Random(seed), 10**9, []
    sender = Sender(seq=65_000)
    for n in range(120):
        if chance.random() < 0.02:
            sender = Sender(ssrc=n, seq=chance.getrandbits(16), timestamp=chance.getrandbits(32))
            now_ns += chance.choice((0, 10**9))
        size = chance.choice((300, 3000, 30_000))
        packets = sender.send(picture(n, size=size, slices=chance.choice((1, 1, 3))), marker=chance.random() < 0.95)
        for place, packet in enumerate(packets):
            arriving = [(one.data, one.source) for one in network.pass_on(packet)]
            datagrams += [(data, source, now_ns + 1000 * place) for data, source in arriving]
        now_ns += FRAME_NS
        if chance.random() < 0.2:
            datagrams.append((SILENCE, ROBOT, now_ns))
    datagrams.append((SILENCE, ROBOT, now_ns + 10**9))
    shortened = received(datagrams)
    monkeypatch.setattr(Streak, "takes", lambda *_: False)
    assert shortened == received(datagrams)


def test_most_packets_of_a_good_network_take_the_short_way(monkeypatch) -> None:
    """All but the first ones and the last one of a picture."""
    sender, layered = Sender(), []
    monkeypatch.setattr("gateway.video.receiving.stream.parse", lambda *words: layered.append(1) or parse(*words))
    datagrams = [packet for n in range(20) for packet in sender.send(picture(n, size=50_000))]
    _, counts = received([(packet, ROBOT, 10**9 + n) for n, packet in enumerate(datagrams)])
    assert counts.packets == len(datagrams) > 20 * 40
    assert len(layered) < 20 * 4


def test_what_was_put_aside_is_counted_as_soon_as_nothing_comes_any_more() -> None:
    """Whoever asks is told of all that came; the picture goes on where it was."""
    nals, stream = picture(0, size=30_000), Stream([ROBOT])
    packets = Sender().send(nals)
    for packet in packets[:10]:
        stream.receive(packet, ROBOT, 10**9)
    stream.expire(10**9 + 1)
    counts = stream.tally.snapshot()
    assert counts.packets == counts.datagrams == 10 and counts.datagram_bytes == sum(map(len, packets[:10]))
    (unit,) = [unit for packet in packets[10:] for unit in stream.receive(packet, ROBOT, 2 * 10**9)]
    assert unit.is_intact and split_annex_b(unit.data) == nals


def test_headers_are_those_of_the_standards() -> None:
    """RFC 3550 section 5.1, RFC 7798 section 4.4.3: written out once more."""
    going = streak()
    header = struct.pack("!BBHIIBBB", 2 << 6, 96, 101, 5000, 7, 49 << 1, 1, IDR)
    assert going.takes(header + bytes(going.size - 15), ROBOT)
