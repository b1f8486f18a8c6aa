"""RTP packets of H.265 for tests, made by an independent packetiser (RFC 3550, RFC 7798): slow and obvious."""

from __future__ import annotations

import random
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

VPS = bytes.fromhex("40010c01ffff016000000300900000030000030078ac09")
"""With emulation prevention, id 0; as an encoder writes it."""
SPS = bytes.fromhex("42010101600000030090000003000003007880a00502016965952e56")
PPS = bytes.fromhex("4401c172b46240")
AUD = bytes((35 << 1, 1, 0x50))
TRAIL, IDR, CRA, RASL = 1, 19, 21, 9
TICKS = 2000
"""From picture to picture at 45 fps (§5.1)."""


def slice_nal(kind: int, size: int, seed: int, *, is_first: bool = True) -> bytes:
    """Return a slice of random content without zeros, as no start code may be in it; its length counts the header."""
    body = random.Random(seed).randbytes(max(1, size - 2)).replace(b"\0", b"\x55")
    first = body[0] | 0x80 if is_first else body[0] & 0x7F
    return bytes((kind << 1, 1, first)) + body[1:]


def recovery_point_sei(pictures: int = 0) -> bytes:
    """Return a prefix SEI with a recovery point after so many pictures (0 to 2)."""
    code = {0: 0b1, 1: 0b010, 2: 0b00100}[pictures]
    bits = {0: 1, 1: 3, 2: 5}[pictures]
    return bytes((39 << 1, 1, 6, 1, (code << (8 - bits)) | (1 << (7 - bits)), 0x80))


def picture(number: int, *, gop: int = 10, size: int = 5000, slices: int = 1) -> list[bytes]:
    """Return the NAL units of a picture: parameter sets and IDR at the beginning of a group, else a predicted one."""
    is_key = gop > 0 and number % gop == 0
    kind = IDR if is_key else TRAIL
    each = [slice_nal(kind, size // slices, 100 * number + n, is_first=n == 0) for n in range(slices)]
    return [VPS, SPS, PPS, *each] if is_key else each


def rtp(
    payload: bytes, seq: int, timestamp: int, *, marker: bool = False, ssrc: int = 7, payload_type: int = 96
) -> bytes:
    """Return a datagram with the plain header of twelve bytes."""
    return (
        bytes((0x80, (0x80 if marker else 0) | payload_type))
        + (seq % 2**16).to_bytes(2, "big")
        + (timestamp % 2**32).to_bytes(4, "big")
        + ssrc.to_bytes(4, "big")
        + payload
    )


def payloads(nals: Sequence[bytes], most: int = 1200) -> list[bytes]:
    """Return RTP payloads: neighbours that fit together in an AP, what is too large in FUs, the rest alone."""
    result: list[bytes] = []
    small: list[bytes] = []

    def close() -> None:
        if len(small) == 1:
            result.append(small[0])
        elif small:
            body = b"".join(len(nal).to_bytes(2, "big") + nal for nal in small)
            result.append(bytes((48 << 1, 1)) + body)
        small.clear()

    for nal in nals:
        if len(nal) > most:
            close()
            result += fragments(nal, most)
            continue
        if 2 + sum(2 + len(other) for other in small) + 2 + len(nal) > most:
            close()
        small.append(nal)
    close()
    return result


def fragments(nal: bytes, most: int) -> list[bytes]:
    """Return a NAL unit as FUs of at most so many bytes."""
    kind, body, room = (nal[0] >> 1) & 0x3F, nal[2:], most - 3
    pieces = [body[at : at + room] for at in range(0, len(body), room)]
    return [
        bytes((nal[0] & 0x81 | 49 << 1, nal[1]))
        + bytes((kind | (0x80 if n == 0 else 0) | (0x40 if n == len(pieces) - 1 else 0),))
        + piece
        for n, piece in enumerate(pieces)
    ]


@dataclass(slots=True)
class Sender:
    """One life of a sender.

    Attributes:
        seq: Of the next packet.
        timestamp: Of the next picture.
    """

    seq: int = 1000
    timestamp: int = 50_000
    ssrc: int = 7
    payload_type: int = 96
    most: int = 1200

    def send(self, nals: Sequence[bytes], *, marker: bool = True, ticks: int = TICKS) -> list[bytes]:
        """Return the packets of a picture."""
        parts = payloads(nals, self.most)
        packets = [
            rtp(
                part,
                self.seq + n,
                self.timestamp,
                marker=marker and n == len(parts) - 1,
                ssrc=self.ssrc,
                payload_type=self.payload_type,
            )
            for n, part in enumerate(parts)
        ]
        self.seq += len(parts)
        self.timestamp += ticks
        return packets

    def pictures(
        self, numbers: Iterable[int], *, gop: int = 10, size: int = 5000, slices: int = 1
    ) -> list[list[bytes]]:
        """Return the packets of pictures, for each of them."""
        return [self.send(picture(n, gop=gop, size=size, slices=slices)) for n in numbers]


def split_annex_b(data: bytes) -> list[bytes]:
    """Return the NAL units of a byte stream, whose start codes may have three bytes or four (H.265 annex B.2)."""
    pieces = data.split(b"\x00\x00\x01")
    return [nal for nal in (piece.rstrip(b"\x00") for piece in pieces[1:]) if nal]
