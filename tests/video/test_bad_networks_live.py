"""The same with real sockets, threads and clocks: sender, bad relay, receiver, decoder, and what a user is told."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from gateway.sim.camera.sender import Sender
from gateway.video import Frame, Video, VideoCode
from tests.video.bad_network import BadNetwork, Faults, Relay, relay
from tests.video.code_reader import read_composite
from tests.video.stage import GOP, HOST, sending, until

pytestmark = pytest.mark.e2e


@contextmanager
def stage(**faults: object) -> Iterator[tuple[Video, Relay, Sender]]:
    """Run a receiver, a relay that does this to packets, and a sender, while a block lasts."""
    with (
        Video(HOST, port=0, host=HOST, decoder="software") as video,
        relay(BadNetwork(Faults(**faults), seed=4), video.port) as between,  # type: ignore[arg-type]
        sending(between.port) as sender,
    ):
        yield video, between, sender


def told(video: Video) -> set[VideoCode]:
    """Return the codes of what is wrong."""
    return {finding.code for finding in video.why()}


def heal(video: Video, between: Relay) -> list[Frame]:
    """Let the network be good; return a second's frames from the next clean one on."""
    between.network.faults = Faults()
    last = video.latest.seq if video.latest is not None else -1
    frames = video.frames()
    first = next(frame for frame in frames if frame.seq > last and frame.clean)
    return [first, *(frame for frame, _ in zip(frames, range(2 * GOP), strict=False))]


def assert_whole(frames: list[Frame]) -> None:
    """Assert that frames are clean, and that the pixels agree."""
    assert all(frame.clean and read_composite(frame.rgb) is not None for frame in frames)


def test_everything_at_once_and_nothing_damaged_is_called_clean():
    """Loss, swaps, duplicates, garbage and a spoofer: the codes of clean frames agree in all six crops; then all is well."""
    words = {"loss_p": 0.01, "swap_p": 0.02, "duplicate_p": 0.02, "garbage_p": 0.1, "spoof_p": 0.1}
    with stage(**words) as (video, between, _):
        until(lambda: video.counts.lost >= 3, "losses")
        frames = [frame for frame, _ in zip(video.frames(), range(60), strict=False)]
        assert_whole([frame for frame in frames if frame.clean])
        assert any(not frame.clean and frame.lost for frame in frames)
        wrong = {VideoCode.LOSS, VideoCode.SECOND_SENDER, VideoCode.NOT_RTP}
        until(lambda: wrong <= told(video), "everything that is wrong is told")
        assert_whole(heal(video, between))


def test_silence_is_told_and_ended_by_the_next_idr():
    """`why` says since when; the same frames() goes on."""
    with stage() as (video, between, _):
        assert_whole([next(video.frames())])
        between.set(is_silent=True)
        until(lambda: VideoCode.STREAM_STOPPED in told(video), "the silence is told")
        assert_whole(heal(video, between))
        assert video.counts.lives == 1


def test_a_wrong_payload_type_is_told_with_its_number():
    """Packets arrive, and no picture does."""
    with stage(payload_type=97) as (video, between, _):
        finding = until(lambda: [one for one in video.why() if one.code is VideoCode.WRONG_PAYLOAD_TYPE], "the type")[0]
        assert "97" in finding.message and video.latest is None
        assert_whole(heal(video, between))


def test_a_sender_that_restarts_on_a_bad_network_is_followed():
    """In mid-group, while packets are lost."""
    with stage(loss_p=0.005, spoof_p=0.1) as (video, between, sender):
        life = next(video.frames()).life
        sender.is_silent = True
        until(lambda: video.latest.age > 0.5, "silence")
        sender.restart(at_key_frame=False)
        sender.is_silent = False
        found = next(frame for frame in video.frames() if frame.life != life)
        assert found.life == life + 1
        assert VideoCode.SENDER_RESTARTED in told(video)
        assert_whole(heal(video, between))
        assert video.counts.lives == 2
