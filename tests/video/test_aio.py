"""Tests of the asyncio twin: the same frames, and an event loop that is never held up."""

from __future__ import annotations

import asyncio
import threading
import time

import pytest

from gateway.video import AsyncVideo, VideoTimeout
from tests.video.code_reader import read_composite
from tests.video.sending import udp_port
from tests.video.stage import HOST, sending

pytestmark = pytest.mark.e2e


def a_video(**options):
    """Return one that listens to this host on a free port."""
    return AsyncVideo(HOST, **{"port": 0, "host": HOST, "decoder": "software", **options})


def test_several_tasks_are_given_frames_while_the_loop_runs_on():
    """A task that ticks beside them is never held up for long."""

    async def main():
        ticks = []

        async def tick():
            while True:
                ticks.append(time.monotonic())
                await asyncio.sleep(0.005)

        async def read(video, count, **options):
            frames = []
            async for frame in video.frames(**options):
                frames.append(frame)
                if len(frames) == count:
                    return frames
            raise AssertionError("it ended")

        async with a_video() as video:
            with sending(video.video.port):
                ticking = asyncio.create_task(tick())
                found = await asyncio.gather(read(video, 30), read(video, 30), read(video, 4, max_rate=10.0))
                ticking.cancel()
                assert (
                    video.latest.seq >= found[0][-1].seq
                    and video.health.reading.frames >= 30
                    and video.why() is not None
                )
        return found, ticks

    found, ticks = asyncio.run(main())
    for frames in found:
        assert all(frame.clean and read_composite(frame.rgb) is not None for frame in frames)
        assert [frame.seq for frame in frames] == sorted({frame.seq for frame in frames})
    assert found[2][-1].published_ns - found[2][0].published_ns > 200_000_000
    assert len(ticks) > 20


def test_leaving_the_block_ends_the_iterations():
    """A task that waits for a frame is told, and no error is raised in it."""

    async def main():
        async with a_video() as video:
            reading = asyncio.create_task(count(video))
            await asyncio.sleep(0)
        return await asyncio.wait_for(reading, 20.0)

    async def count(video):
        return [frame async for frame in video.frames(timeout=600.0)]

    assert asyncio.run(main()) == []


def test_a_wait_ends_in_time_and_says_why():
    """As in the twin for threads."""

    async def main():
        async with a_video() as video:
            assert await video.wait_frame(timeout=0.01) is None
            with pytest.raises(VideoTimeout, match=r"0\.02 s"):
                async for _ in video.frames(timeout=0.02):
                    raise AssertionError("nobody sends")

    asyncio.run(main())


def test_a_start_that_fails_leaves_nothing_behind():
    """The port is somebody else's: the error is the twin's."""

    async def main():
        async with a_video() as video:
            with pytest.raises(Exception, match="PORT_BUSY"):
                async with a_video(port=video.video.port):
                    raise AssertionError("both listen")

    asyncio.run(main())


def test_a_start_that_is_cancelled_gives_the_port_back():
    """However often, while its thread still asks for the robot's address."""
    begun, may_go, ended, port = threading.Event(), threading.Event(), threading.Event(), udp_port()

    async def main():
        video = a_video(port=port)
        start = video.video.start

        def slowly():
            begun.set()
            assert may_go.wait(20.0)
            start()
            ended.set()

        video.video.start = slowly
        starting = asyncio.create_task(video.__aenter__())
        assert await asyncio.to_thread(begun.wait, 20.0)
        for _ in range(2):
            starting.cancel()
            await asyncio.sleep(0)
        may_go.set()
        with pytest.raises(asyncio.CancelledError):
            await starting
        assert await asyncio.to_thread(ended.wait, 20.0)
        assert not video.video.is_running
        async with a_video(port=port) as other:
            assert other.video.is_running

    asyncio.run(main())
