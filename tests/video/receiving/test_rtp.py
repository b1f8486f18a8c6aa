"""Rules of `video.receiving.rtp`: a datagram is a packet of the stream, or it is said why not (RFC 3550 section 5.1)."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.video.receiving.rtp import RtpFault, RtpPacket, parse, payload_type_of
from tests.video.packets import rtp

PAYLOAD = b"\x26\x01\xaf\x11\x22"
PLAIN = rtp(PAYLOAD, 65_535, 2**32 - 1, marker=True, ssrc=0xDEADBEEF)


def altered(position: int, value: int, datagram: bytes = PLAIN) -> bytes:
    """Return a datagram with another byte at a position."""
    return datagram[:position] + bytes((value,)) + datagram[position + 1 :]


def test_every_field_of_the_header_is_read() -> None:
    """RFC 3550 section 5.1."""
    assert parse(PLAIN) == RtpPacket(65_535, 2**32 - 1, 0xDEADBEEF, True, PAYLOAD)


def test_a_buffer_may_be_used_again() -> None:
    """The payload is a copy."""
    buffer = bytearray(PLAIN)
    packet = parse(memoryview(buffer))
    buffer[:] = bytes(len(buffer))
    assert isinstance(packet, RtpPacket) and packet.payload == PAYLOAD


def test_the_list_of_sources_and_the_extension_are_passed_over() -> None:
    """Two contributing sources, an extension of three words."""
    datagram = altered(0, 0x92)
    datagram = datagram[:12] + b"ABCDEFGH" + b"\xbe\xde\x00\x03" + bytes(12) + PAYLOAD
    packet = parse(datagram)
    assert isinstance(packet, RtpPacket) and packet.payload == PAYLOAD


def test_padding_is_taken_off() -> None:
    """Its last byte counts all of it."""
    packet = parse(altered(0, 0xA0) + b"\x00\x00\x03")
    assert isinstance(packet, RtpPacket) and packet.payload == PAYLOAD


@pytest.mark.parametrize(
    ("datagram", "fault"),
    [
        (b"", RtpFault.TOO_SHORT),
        (PLAIN[:11], RtpFault.TOO_SHORT),
        (altered(0, 0x40), RtpFault.BAD_VERSION),
        (altered(0, 0xC0), RtpFault.BAD_VERSION),
        (altered(1, 97), RtpFault.BAD_PAYLOAD_TYPE),
        (altered(0, 0x8F), RtpFault.BAD_HEADER),
        (altered(0, 0x90, PLAIN[:14]), RtpFault.BAD_HEADER),
        (altered(0, 0x90, PLAIN[:12] + b"\xbe\xde\xff\xff" + PAYLOAD), RtpFault.BAD_HEADER),
        (altered(0, 0xA0) + b"\x00", RtpFault.BAD_PADDING),
        (altered(0, 0xA0) + b"\x07", RtpFault.BAD_PADDING),
        (altered(0, 0xA0) + b"\x06", RtpFault.EMPTY),
        (PLAIN[:12], RtpFault.EMPTY),
    ],
)
def test_what_is_wrong_is_named(datagram: bytes, fault: RtpFault) -> None:
    """Each has a counter of its own."""
    assert parse(datagram) is fault


def test_another_payload_type_can_be_wanted_and_the_wrong_one_is_told() -> None:
    """§5.1: 96 by default."""
    datagram = rtp(PAYLOAD, 1, 2, payload_type=97)
    assert isinstance(parse(datagram, 97), RtpPacket)
    assert parse(datagram) is RtpFault.BAD_PAYLOAD_TYPE and payload_type_of(datagram) == 97


@given(st.binary(max_size=80))
def test_any_bytes_are_a_packet_or_a_named_fault(datagram: bytes) -> None:
    """Never an exception, and never a payload that was not in the datagram."""
    packet = parse(datagram)
    assert isinstance(packet, RtpFault) or (packet.payload and packet.payload in datagram)
