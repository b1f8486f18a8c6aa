"""What bad networks leave in a recording, in virtual time: every picture that the index calls clean is what was sent."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache
from pathlib import Path

import av
import pytest

from gateway.sim.camera.rtp import Packetiser
from gateway.video.receiving.stream import Stream
from gateway.video.recording.container import ticks_of
from gateway.video.recording.index import Index, index_path, read_index
from gateway.video.recording.take import Take
from tests.video.bad_network import ROBOT, BadNetwork, Faults
from tests.video.coded import GOP, PERIOD_NS, units

COUNT = 200
PACKET_BYTES = 64
"""Flat pictures are small: with these, an IRAP has some fifty packets and any other two."""


@cache
def truth() -> tuple[bytes, ...]:
    """Return the pixels of every picture that is sent, as an undisturbed decoder shows it."""
    decoder = av.CodecContext.create("hevc", "r")
    shown = [picture for unit in units(COUNT) for picture in decoder.decode(av.Packet(unit.data))]
    return tuple(bytes(picture.to_ndarray(format="gray")) for picture in [*shown, *decoder.decode(None)])


def recorded(path: Path, faults: Faults, seed: int, restart_at: int | None = None) -> tuple[Index, dict[int, int]]:
    """Send all pictures over a network into a recording; return its index, and which picture has which RTP time."""
    take, stream, network = Take(path), Stream({ROBOT}), BadNetwork(faults, seed)
    packetiser, sent, start_ns = Packetiser(1, max_bytes=PACKET_BYTES), {}, 10**9
    for number, unit in enumerate(units(COUNT)):
        if number == restart_at:
            packetiser = Packetiser(2, max_bytes=PACKET_BYTES)
            start_ns += 10**9
        at_ns = start_ns + number * PERIOD_NS
        sent[(packetiser.first_timestamp + 2000 * number) % 2**32] = number
        for packet in packetiser.packets(unit.data, 2000 * number):
            for datagram in network.pass_on(packet):
                for whole in stream.receive(datagram.data, datagram.source, at_ns):
                    take.write(whole)
        for whole in stream.expire(at_ns + PERIOD_NS // 2):
            take.write(whole)
    take.end("it was ended")
    return read_index(index_path(path)), sent


def pixels_of(path: Path) -> Iterator[tuple[int, bytes]]:
    """Yield where each picture stands that can be decoded, and its pixels."""
    with av.open(str(path)) as file:
        for picture in file.decode(video=0):
            assert picture.pts is not None
            assert picture.time_base is not None
            yield ticks_of(picture.pts, picture.time_base), bytes(picture.to_ndarray(format="gray"))


@pytest.mark.parametrize("seed", [0, *(pytest.param(n, marks=pytest.mark.thorough) for n in (1, 2))])
@pytest.mark.parametrize("name", ["take.mkv", "take.mp4"])
@pytest.mark.parametrize(
    "faults",
    [
        pytest.param(Faults(loss_p=0.01), id="loss"),
        pytest.param(Faults(burst_p=0.002), id="bursts"),
        pytest.param(Faults(swap_p=0.01, duplicate_p=0.01), id="disorder"),
        pytest.param(Faults(garbage_p=0.1, spoof_p=0.1), id="strangers"),
    ],
)
def test_what_the_index_calls_clean_is_what_was_sent(tmp_path: Path, faults: Faults, name: str, seed: int) -> None:
    """Pixel by pixel; and the index knows every picture that is in the file."""
    path = tmp_path / name
    index, sent = recorded(path, faults, seed)
    by_pts = {picture.pts: picture for picture in index.pictures}
    shown = dict(pixels_of(path))
    assert shown.keys() <= by_pts.keys()
    for pts, picture in by_pts.items():
        if picture.clean:
            assert shown[pts] == truth()[sent[picture.rtp_time % 2**32]]
    clean = sum(picture.clean for picture in index.pictures)
    if faults.loss_p or faults.burst_p:
        assert 0 < clean < COUNT
    else:
        assert clean == COUNT
    if faults.loss_p:
        assert any(picture.lost for picture in index.pictures)


@pytest.mark.parametrize("restart_at", [5 * GOP, 5 * GOP + 4])
def test_a_sender_that_begins_anew_goes_on_in_the_same_recording(tmp_path: Path, restart_at: int) -> None:
    """At a key picture or in the middle of a group; what stands before its first key picture is not recorded."""
    path = tmp_path / "take.mkv"
    index, sent = recorded(path, Faults(), 0, restart_at)
    assert [picture.life for picture in index.pictures] == sorted(picture.life for picture in index.pictures)
    assert {picture.life for picture in index.pictures} == {0, 1}
    assert all(picture.clean for picture in index.pictures)
    first = next(picture for picture in index.pictures if picture.life == 1)
    begins = -(-restart_at // GOP) * GOP
    assert sent[first.rtp_time % 2**32] == begins
    waited_ticks = (begins - restart_at + 1) * 2000 + 90_000
    assert first.pts - index.pictures[first.n - 1].pts == pytest.approx(waited_ticks, abs=2)
    for pts, pixels in pixels_of(path):
        number = next(sent[picture.rtp_time % 2**32] for picture in index.pictures if picture.pts == pts)
        assert pixels == truth()[number]
