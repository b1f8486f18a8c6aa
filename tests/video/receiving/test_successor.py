"""Rules of `gateway.video.receiving.successor`: a whole key picture with parameter sets is a proof, nothing less."""

from __future__ import annotations

import random

import pytest

from gateway.video.receiving.rtp import RtpPacket, parse
from gateway.video.receiving.successor import MAX_PACKETS, Successor
from tests.video.packets import CRA, IDR, PPS, SPS, TRAIL, VPS, Sender, picture, slice_nal

OTHER = (9, "192.168.1.20")


def packets(nals: list[bytes], sender: Sender | None = None) -> list[RtpPacket]:
    """Return a picture's packets."""
    found = [parse(datagram) for datagram in (sender or Sender(ssrc=9, seq=65_534)).send(nals)]
    return [packet for packet in found if isinstance(packet, RtpPacket)]


def kept(sent: list[RtpPacket]) -> Successor:
    """Return what has been given packets."""
    successor = Successor()
    for n, packet in enumerate(sent):
        successor.keep(packet, OTHER, n)
    return successor


@pytest.mark.parametrize("kind", [IDR, CRA])
@pytest.mark.parametrize("size", [500, 9000])
def test_a_whole_key_picture_is_a_proof(kind, size) -> None:
    """In one packet or in many, and not before its last one; all of it is kept as it came."""
    sent = packets([VPS, SPS, PPS, slice_nal(kind, size, 1)])
    for count in range(len(sent)):
        assert not kept(sent[:count]).is_ready
    successor = kept(sent)
    assert successor.is_ready and successor.sender == OTHER
    assert successor.packets == [(packet, n) for n, packet in enumerate(sent)]


def test_a_picture_without_a_marker_ends_with_the_next_one() -> None:
    """As it does for the depacketiser."""
    sender = Sender(ssrc=9)
    sent = [packet._replace(is_marked=False) for n in range(2) for packet in packets(picture(n), sender)]
    count = len(sent) // 2
    assert not kept(sent[: count - 1]).is_ready and kept(sent).is_ready


@pytest.mark.parametrize(
    "nals",
    [
        [VPS, SPS, PPS, slice_nal(TRAIL, 900, 1)],
        [VPS, SPS, slice_nal(IDR, 900, 1)],
        [SPS, PPS, slice_nal(IDR, 900, 1)],
        [slice_nal(IDR, 900, 1)],
        [VPS, SPS, PPS],
    ],
    ids=["no key picture", "no PPS", "no VPS", "no parameter sets", "no picture"],
)
def test_anything_less_is_none(nals) -> None:
    """It could not be shown."""
    assert not kept(packets(nals)).is_ready


def test_what_is_swapped_or_comes_twice_is_sorted_out() -> None:
    """By its number: the first one kept is that with the VPS, and what was before it is of no use."""
    sent = packets(picture(0, size=20_000))
    order = [sent[0], *random.Random(1).sample(sent[1:], len(sent) - 1)]
    successor = kept([*order[:5], order[2], order[0], *order[5:]])
    assert successor.is_ready and len(successor.packets) == len(sent)
    before = sent[1]._replace(seq=sent[0].seq - 1)
    assert successor.keep(before, OTHER, 99) == 1 and successor.is_ready


def test_a_gap_is_no_proof_whenever_it_comes() -> None:
    """Neither in the picture nor behind it."""
    sender = Sender(ssrc=9)
    first, second = packets(picture(0), sender), packets(picture(1), sender)
    assert not kept([*first[:1], *first[2:], *second]).is_ready
    assert not kept([*first, *second[1:]]).is_ready


def test_others_and_what_comes_before_a_key_picture_are_counted_as_of_no_use() -> None:
    """Each packet once; who begins with a VPS takes the place of who did before."""
    sender, successor = Sender(ssrc=9), Successor()
    middle, key, third = packets(picture(1), sender), packets(picture(0), sender), packets(picture(0), Sender(ssrc=5))
    assert [successor.keep(packet, OTHER, 0) for packet in middle] == [1] * len(middle)
    assert [successor.keep(packet, OTHER, 0) for packet in key] == [0] * len(key)
    assert successor.keep(third[1], (5, OTHER[1]), 0) == 1 and successor.is_ready
    assert successor.keep(third[0], (5, OTHER[1]), 0) == len(key) and not successor.is_ready
    assert successor.forget() == 1 and successor.forget() == 0


def test_what_is_kept_is_bounded() -> None:
    """A stranger cannot fill the memory; each packet is counted in the end."""
    successor, dropped = Successor(), 0
    first, *_ = packets(picture(0))
    for n in range(3 * MAX_PACKETS):
        more = first._replace(seq=(first.seq + n) % 2**16, payload=first.payload if not n else b"\x02\x01\x80")
        dropped += successor.keep(more, OTHER, 0)
        assert len(successor.packets) <= MAX_PACKETS
    assert dropped + successor.forget() == 3 * MAX_PACKETS


@pytest.mark.parametrize(
    "payload", [b"\x60", b"\x60\x01", b"\x60\x01\x00\x05", b"\x62\x01", b"\x62", b"\x00", bytes(9)]
)
def test_payloads_that_are_nothing_are_nothing(payload) -> None:
    """Aggregation packets and fragments without a content raise nothing."""
    assert Successor().keep(RtpPacket(0, 0, 9, True, payload), OTHER, 0) == 1
