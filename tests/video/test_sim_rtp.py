"""Rules of `gateway.sim.camera.rtp`: RFC 3550 headers, RFC 7798 payloads, and nothing lost or added between them."""

from __future__ import annotations

import struct
from collections.abc import Iterable

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.sim.camera.annexb import joined, nal_units
from gateway.sim.camera.rtp import Packetiser

SMALL = b"\x40\x01small"


def unit(size: int, kind: int = 1, layer: int = 0, temporal: int = 1) -> bytes:
    """Return a NAL unit of a size in bytes, without zeros."""
    header = struct.pack("!H", kind << 9 | layer << 3 | temporal)
    return header + bytes(1 + number % 255 for number in range(size - 2))


def carried(payloads: Iterable[bytes]) -> list[bytes]:
    """Take the NAL units out of payloads, as a receiver would."""
    units: list[bytes] = []
    for payload in payloads:
        kind = payload[0] >> 1 & 0x3F
        if kind == 48:
            rest = payload[2:]
            while rest:
                (size,) = struct.unpack_from("!H", rest)
                units.append(rest[2 : 2 + size])
                rest = rest[2 + size :]
        elif kind == 49:
            flags = payload[2]
            if flags & 0x80:
                units.append(bytes((payload[0] & 0x81 | (flags & 0x3F) << 1, payload[1])))
            units[-1] += payload[3:]
        else:
            units.append(payload)
    return units


@given(
    st.lists(
        st.builds(unit, st.integers(3, 4000), st.integers(0, 40), st.integers(0, 63), st.integers(1, 7)), min_size=1
    ),
    st.integers(64, 1500),
)
def test_every_nal_unit_arrives_whole_and_in_order(units: list[bytes], max_bytes: int) -> None:
    """Whatever their sizes, and no packet is larger than asked for."""
    packets = Packetiser(1, max_bytes=max_bytes).packets(joined(units), 0)
    assert carried(packet[12:] for packet in packets) == units
    assert max(map(len, packets)) <= max_bytes


def test_the_marker_is_on_the_last_packet_of_a_picture_only() -> None:
    """RFC 7798 §4.1."""
    packets = Packetiser(1).packets(joined([SMALL, unit(5000)]), 0)
    assert [packet[1] >> 7 for packet in packets] == [0] * (len(packets) - 1) + [1]
    assert len(packets) == 5


def test_sequence_numbers_go_on_over_pictures_and_wrap() -> None:
    """One for each packet, 16 bits."""
    sender = Packetiser(1)
    sender.sequence = 65_534
    packets = [packet for tick in range(4) for packet in sender.packets(joined([SMALL]), 2000 * tick)]
    assert [struct.unpack_from("!H", packet, 2)[0] for packet in packets] == [65_534, 65_535, 0, 1]


def test_the_timestamp_counts_from_a_random_beginning_and_wraps() -> None:
    """2000 ticks per picture at 45 Hz; all packets of a picture have the same."""
    sender = Packetiser(1)
    sender.first_timestamp = 0xFFFFFFFF - 1999
    stamps = [
        {struct.unpack_from("!I", p, 4)[0] for p in sender.packets(joined([unit(3000)]), tick)} for tick in (0, 2000)
    ]
    assert stamps == [{0xFFFFF830}, {0}]


def test_two_senders_have_nothing_in_common() -> None:
    """SSRC, sequence number and timestamp are drawn; the same seed draws the same."""
    one, other, again = Packetiser(1), Packetiser(2), Packetiser(1)
    for name in ("ssrc", "sequence", "first_timestamp"):
        assert getattr(one, name) != getattr(other, name)
        assert getattr(one, name) == getattr(again, name)
    assert Packetiser().ssrc != Packetiser().ssrc


def test_version_and_payload_type_are_in_the_header() -> None:
    """Version 2, no padding, no extension, no CSRC; 96 unless told otherwise (§5.1)."""
    assert Packetiser(1).packets(joined([SMALL]), 0)[0][:2] == b"\x80\xe0"
    assert Packetiser(1, payload_type=97).packets(joined([SMALL]), 0)[0][:2] == b"\x80\xe1"


def test_small_units_share_a_packet_and_a_lone_one_has_its_own() -> None:
    """An aggregation packet has at least two; its layer and temporal id are the lowest of them (RFC 7798 §4.4.2)."""
    low, high = unit(20, layer=33, temporal=2), unit(30, layer=35, temporal=4)
    (together,) = Packetiser(1).packets(joined([high, low]), 0)
    header = struct.unpack_from("!H", together, 12)[0]
    assert (header >> 9 & 63, header >> 3 & 63, header & 7) == (48, 33, 2)
    (alone,) = Packetiser(1).packets(joined([low]), 0)
    assert alone[12:] == low


def test_only_the_first_and_the_last_fragment_say_so() -> None:
    """S and E bits, the unit's own type beside them (RFC 7798 §4.4.3)."""
    packets = Packetiser(1).packets(joined([unit(4000, kind=19)]), 0)
    assert [packet[14] for packet in packets] == [0x80 | 19, 19, 0x40 | 19]


@pytest.mark.parametrize(("name", "value"), [("payload_type", 128), ("payload_type", -1), ("max_bytes", 63)])
def test_numbers_out_of_range_are_refused(name: str, value: int) -> None:
    """With the bounds."""
    with pytest.raises(ValueError, match=r"outside \["):
        Packetiser(1, **{name: value})


def test_a_unit_without_a_whole_header_is_refused() -> None:
    """It could not be fragmented, nor told from others."""
    with pytest.raises(ValueError, match="NAL unit of 1 bytes"):
        Packetiser(1).packets(b"\x00\x00\x01\x40", 0)
    assert nal_units(b"\x00\x00\x01\x40") == [b"\x40"]
