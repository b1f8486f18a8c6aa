"""200,000 mutated packets through the whole receiving side: no exception, bounded memory, pictures that hold together."""

from __future__ import annotations

import random
from collections import deque
from collections.abc import Sequence
from pathlib import Path

from gateway.video.hevc.nal import START_CODE
from gateway.video.hevc.picture import MAX_PICTURE_BYTES
from gateway.video.receiving.stream import Stream
from tests.thoroughness import either
from tests.video.packets import Sender

PACKETS = either(20_000, 200_000)
ROBOT = "192.168.1.20"
MS = 1_000_000
MAX_GROWTH_BYTES = 16 << 20


def resident_bytes() -> int:
    """Return the memory of this process."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * 4096


def mutated(packet: bytes, others: Sequence[bytes], rng: random.Random) -> bytes:
    """Return a packet with one to three things wrong; half of them behind the RTP header, so that they get far."""
    data = bytearray(packet)
    for _ in range(rng.randint(1, 3)):
        start = rng.choice((0, 12))
        match rng.randrange(9):
            case 0 if len(data) > start:
                data[rng.randrange(start, len(data))] ^= 1 << rng.randrange(8)
            case 1 if len(data) > start:
                data[rng.randrange(start, min(len(data), start + 6))] = rng.randrange(256)
            case 2:
                del data[rng.randrange(len(data) + 1) :]
            case 3:
                data += rng.randbytes(rng.randrange(40))
            case 4:
                data[12:] = rng.choice(others)[rng.randrange(4) :]
            case 5:
                data[2:12] = rng.choice(others)[2:12]
            case 6:
                data[12:14] = bytes((rng.choice((48, 49, 50, 19, 1, 33, 39, 63)) << 1, 1))
            case 7 if data:
                data[0] ^= 1 << rng.randrange(8)
            case _:
                data[2:8] = rng.randbytes(6)
    return bytes(data)


def test_mutated_packets_raise_nothing_fill_nothing_and_leave_the_order_of_pictures() -> None:
    """Every second packet is as it was sent: what the mutations leave behind meets what is right."""
    rng = random.Random(20_261_122)
    sender, stream = Sender(most=700), Stream([ROBOT])
    originals = [packet for packets in sender.pictures(range(60), size=9000, slices=2) for packet in packets]
    now_ns, at, seen, last = 0, 0, 0, None
    settled_bytes, shift, recent = 0, 0, deque(maxlen=40)
    for n in range(PACKETS):
        if at == len(originals):
            at, shift = 0, shift + 60
        # As sent on and on: sequence and time go on from round to round.
        packet = originals[at]
        seq = int.from_bytes(packet[2:4], "big") + len(originals) * (shift // 60)
        time = int.from_bytes(packet[4:8], "big") + 2000 * shift
        packet = packet[:2] + (seq % 2**16).to_bytes(2, "big") + (time % 2**32).to_bytes(4, "big") + packet[8:]
        recent.append(packet)
        if n % 2:
            packet = mutated(packet, recent, rng)
        else:
            at += 1
        now_ns += rng.choice((MS // 10, MS, MS, 30 * MS)) if rng.random() < 0.999 else 400 * MS
        for unit in stream.receive(packet, ROBOT, now_ns) + (stream.expire(now_ns) if n % 17 == 0 else []):
            seen += 1
            assert unit.data.startswith(START_CODE) and len(unit.data) < MAX_PICTURE_BYTES + 70_000
            assert unit.first_packet_ns <= unit.complete_ns <= now_ns
            assert all(first <= past for first, past in unit.lost)
            if last is not None:
                assert unit.seq > last.seq and unit.life >= last.life
                assert unit.life > last.life or unit.rtp_time >= last.rtp_time
            last = unit
        if n == PACKETS // 4:
            settled_bytes = resident_bytes()
    counts = stream.tally.snapshot()
    assert resident_bytes() - settled_bytes < MAX_GROWTH_BYTES
    assert counts.datagrams == PACKETS and seen == counts.pictures > PACKETS // 80
    reached = {name for name in counts.__slots__ if getattr(counts, name)}
    assert reached >= {
        *("too_short", "bad_version", "bad_payload_type", "bad_header", "bad_padding", "bad_ssrc", "lost", "late"),
        *("duplicates", "strays", "lives", "malformed_ap", "malformed_fu", "malformed_nal", "paci", "broken"),
    }, "the mutations do not get everywhere"
