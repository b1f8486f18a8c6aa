"""Tests of `Video` from the network to the pixels: the simulated robot's pictures, real sockets and threads."""

from __future__ import annotations

import importlib
import subprocess
import sys
import threading
import time
from itertools import pairwise
from pathlib import Path

import pytest

from gateway import video
from gateway.video import Video, VideoCode, VideoError, VideoTimeout
from gateway.video.decoding.views import COMPOSITE, VIEWS
from gateway.video.receiving.udp import UdpSocket
from tests.video.code_reader import read_code, read_composite
from tests.video.stage import GOP, HOST, LENGTH, free_udp_port, sending, until

pytestmark = pytest.mark.e2e
ROOT = Path(__file__).resolve().parents[2]


def a_video(**options):
    """Return one that listens to this host on a free port."""
    return Video(HOST, **{"port": 0, "host": HOST, "decoder": "software", **options})


def ahead(earlier, later):
    """Return by how many pictures of the loop one is ahead of another."""
    return (read_composite(later.rgb) - read_composite(earlier.rgb)) % LENGTH


def test_frames_come_clean_in_order_with_all_six_views():
    """Each crop bears the code of its picture; numbers, times and counters rise together (§5.2)."""
    with a_video() as video, sending(video.port):
        frames = [frame for frame, _ in zip(video.frames(), range(40), strict=False)]
        skipped = video.counts.skipped  # on a machine that is too busy
    assert all(frame.clean and frame.lost == () for frame in frames)
    for frame in frames:
        counter = read_composite(frame.rgb)
        assert counter is not None and [read_code(frame[name]) for name in VIEWS] == [counter] * 6
        assert frame[COMPOSITE] is frame.rgb or (frame[COMPOSITE] == frame.rgb).all()
        assert not frame.rgb.flags.writeable and frame.received_ns <= frame.published_ns
    for earlier, later in pairwise(frames):
        assert ahead(earlier, later) == later.seq - earlier.seq >= 1 or skipped
        ticks = later.rtp_time - earlier.rtp_time
        assert ticks % 2000 == 0 and ticks >= 2000 * ahead(earlier, later)
        assert later.received_ns > earlier.received_ns


def test_a_slow_reader_is_given_the_newest_frame():
    """Never a backlog: what it missed is gone (notes §8)."""
    with a_video() as video, sending(video.port):
        frames = video.frames(max_rate=5.0)
        first, second = next(frames), next(frames)
        assert second.published_ns - first.published_ns > 100_000_000
        assert video.wait_frame(second.seq).seq > second.seq
        assert video.latest.seq >= second.seq


def test_a_restarted_sender_is_followed_without_doing_anything():
    """Another SSRC, another sequence, another time: the same iteration goes on, at a key picture (notes §11)."""
    with a_video() as video, sending(video.port, seed=1) as sender:
        frames = video.frames()
        life = next(frames).life
        sender.is_silent = True
        until(lambda: video.latest.age > 0.5, "silence")
        sender.restart(at_key_frame=False)
        sender.is_silent = False
        found = next(frame for frame in frames if frame.life != life)
        assert found.clean and read_composite(found.rgb) % GOP == 0
        assert video.health.counts.lives == 2 and video.health.reading.errors == 0


def test_it_says_why_nothing_comes():
    """A wait ends in an error that names the cause: here nobody sends."""
    with a_video() as video:
        with pytest.raises(VideoTimeout) as caught:
            next(video.frames(timeout=0.05))
        assert isinstance(caught.value, TimeoutError) and "0.05 s" in str(caught.value)
        assert video.wait_frame(timeout=0.01) is None and video.latest is None
        assert video.health.age_s is None and video.health.reading.frames == 0


def test_pictures_from_elsewhere_are_refused():
    """Only the robot may put pictures before a policy (§2.6.3)."""
    with a_video() as video, sending(video.port, bind="127.0.0.2"):
        until(lambda: video.counts.bad_source > 20, "refused packets")
        assert video.latest is None
    with Video(None, port=0, host=HOST) as video, sending(video.port, bind="127.0.0.2"):
        assert video.wait_frame(timeout=20.0).clean


def test_health_has_rate_latency_and_counters():
    """What `ta2 video check` shows."""
    with a_video() as video, sending(video.port):
        until(lambda: video.health.reading.frames > 60, "sixty frames")
        health = video.health
    assert 0 < health.reading.fps < 60 and 0 < health.reading.latency_ms
    assert health.counts.packets >= health.reading.frames and health.age_s >= 0
    assert health.decoder.startswith("software") and health.granted_bytes > 0
    assert health.reading.damaged == health.reading.errors == 0


def test_a_gpu_is_not_taken_by_hope():
    """With `auto` a key picture decides; either way the reason stands in the health, and pictures come meanwhile."""
    with a_video(decoder="auto") as video, sending(video.port):
        assert read_composite(video.wait_frame(timeout=20.0).rgb) is not None
        until(lambda: "yet" not in video.health.decoder_note, "the proof's end")
        health = video.health
    if health.decoder.startswith("nvdec"):
        assert "exactly" in health.decoder_note
    else:
        assert health.decoder_note.startswith("NVDEC is not used: hevc on cuda: ")


def test_stopping_while_decoding_never_hangs():
    """Twenty times, each at another moment; the same one can be started again, and its numbers go on."""
    seqs = []
    port = free_udp_port()
    video = a_video(port=port)
    with sending(port):
        for turn in range(20):
            with video:
                for _ in range(turn % 4):
                    seqs.append(video.wait_frame(seqs[-1] if seqs else -1, timeout=20.0).seq)
            assert not video.is_running
        video.stop()
    assert seqs == sorted(set(seqs)) and len(seqs) == 30
    assert video.latest.clean  # the newest one remains


def test_a_stop_ends_every_iteration():
    """Readers in other threads are not left waiting, nor is an error raised in them."""
    ended = []
    with a_video() as video, sending(video.port):
        video.wait_frame(timeout=20.0)
        threads = [
            threading.Thread(target=lambda: ended.append(sum(1 for _ in video.frames(timeout=600.0)))) for _ in range(3)
        ]
        for thread in threads:
            thread.start()
        until(lambda: video.latest.seq > 5, "frames")
        video.stop()
        for thread in threads:
            thread.join(20.0)
    assert len(ended) == 3


def test_a_port_that_is_taken_is_a_clear_error():
    """It names the port and leaves nothing running; the one that has it is not disturbed."""
    with a_video() as video, sending(video.port):
        other = a_video(port=video.port)
        with pytest.raises(VideoError, match=str(video.port)) as caught:
            other.start()
        assert caught.value.code is VideoCode.PORT_BUSY and not other.is_running
        assert video.wait_frame(timeout=20.0).clean


def test_a_program_that_forgets_to_stop_ends_nevertheless():
    """Its threads do not hold it, and its decoder is not waited for."""
    program = (
        "from gateway.video import Video\n"
        "import sys\n"
        "video = Video('127.0.0.1', port=int(sys.argv[1]), host='127.0.0.1')\n"
        "video.start()\n"
        "assert video.wait_frame(timeout=30.0) is not None\n"
    )
    port = free_udp_port()
    with sending(port):
        subprocess.run([sys.executable, "-c", program, str(port)], cwd=ROOT, timeout=60, check=True)


def test_importing_the_package_does_not_load_av():
    """The client and `ta2 --help` work where it is not installed; what needs it says how to get it."""
    program = (
        "import sys\n"
        "sys.modules['av'] = None\n"
        "import gateway.video as video\n"
        "from gateway.video import Frame, VideoError, VIEWS\n"
        "try:\n"
        "    video.Video\n"
        "except VideoError as error:\n"
        "    print(error)\n"
    )
    ended = subprocess.run(
        [sys.executable, "-c", program], cwd=ROOT, timeout=60, check=True, capture_output=True, text=True
    )
    assert ended.stdout.startswith("NO_DECODER: ") and "pip install 'teleavatar-gateway[video]'" in ended.stdout


def test_a_full_size_stream_of_the_simulated_robot(tmp_path):
    """The robot's own size and rate, from a process of its own: six views as §5.2 has them, all clean."""
    log = (tmp_path / "camera.log").open("w")
    with a_video() as video, log:
        command = [sys.executable, "-m", "gateway.sim.camera", "--to", f"{HOST}:{video.port}"]
        command += ["--source", "loop", "--pictures", "15", "--gop", "15"]  # encoded within seconds
        camera = subprocess.Popen(command, cwd=ROOT, stdout=log, stderr=log)
        try:
            frame = video.wait_frame(timeout=120.0)
            assert frame is not None, (tmp_path / "camera.log").read_text()
            began = time.monotonic()
            seen = [frame]
            for frame in video.frames(timeout=30.0):
                seen.append(frame)
                if time.monotonic() - began > 1.0:
                    break
        finally:
            camera.terminate()
            camera.wait(20.0)
    assert {name: view.shape for name, view in seen[-1].views.items()} == {
        name: (960, 960, 3) if name.startswith("head") else (400, 640, 3) for name in VIEWS
    }
    assert all(frame.clean for frame in seen)
    assert all(read_composite(frame.rgb) is not None for frame in seen[::10])


@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")
def test_one_that_failed_is_started_again(monkeypatch):
    """Whoever waits is told why; starting it once more is all it takes, also while its threads still end."""

    def broken(_):
        raise OSError(100, "Network is down")

    with a_video() as video, sending(video.port):
        first = video.wait_frame()
        monkeypatch.setattr(UdpSocket, "receive", broken)
        with pytest.raises(VideoError, match="Network is down"):
            while True:
                first = video.wait_frame(first.seq)
        monkeypatch.undo()
        video.start()
        with sending(video.port):
            assert video.wait_frame(first.seq).seq > first.seq


def test_the_old_place_gives_the_same_and_says_where_it_went():
    """For one release: who imports from there is told, and gets what there is."""
    with pytest.warns(DeprecationWarning, match="gateway.video"):
        old = importlib.import_module("gateway.apps.video")
    assert all(getattr(old, name) is getattr(video, name) for name in video.__all__)
