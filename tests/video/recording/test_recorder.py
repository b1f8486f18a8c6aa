"""Rules of `gateway.video.recording.recorder`: it survives being killed, a full disk and a slow one, and never blocks."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Sequence
from pathlib import Path

import av
import pytest

from gateway.sim.camera.rtp import Packetiser
from gateway.video.errors import VideoCode
from gateway.video.hevc.access_unit import AccessUnit
from gateway.video.receiving import backlog
from gateway.video.receiving.receiver import Receiver, ReceiverSettings
from gateway.video.recording import recorder as recorder_module
from gateway.video.recording.index import index_path, read_index
from gateway.video.recording.recorder import Recorder
from gateway.video.recording.take import Take
from tests.e2e.system import wait_for
from tests.video.coded import GOP, units

PACED = """
import sys, time
from dataclasses import replace
from pathlib import Path
from gateway.video.recording.recorder import Recorder
from tests.e2e.system import wait_for
from tests.video.coded import units
recorder = Recorder(Path(sys.argv[1]))
for lap in range(1000):
    for unit in units():
        seq, rtp_time = unit.seq + 40 * lap, unit.rtp_time + 80_000 * lap
        recorder(replace(unit, seq=seq, rtp_time=rtp_time, first_packet_ns=time.monotonic_ns()))
        time.sleep(0.002)
"""
"""Records for 80 s, ten times as fast as the robot."""

FULL = """
import resource, sys, time
from pathlib import Path
from gateway.video.recording.recorder import Recorder
from tests.e2e.system import wait_for
from tests.video.coded import units
resource.setrlimit(resource.RLIMIT_FSIZE, (8_000, 8_000))
recorder = Recorder(Path(sys.argv[1]))
for unit in units():
    recorder(unit)
print(recorder.stop(), recorder.error)
"""
"""Records into files that must not grow beyond 8 kB: a write fails as on a full disk."""


def lines_of(path: Path) -> int:
    """Return how many lines an index has by now."""
    return index_path(path).read_bytes().count(b"\n") if index_path(path).exists() else 0


@pytest.mark.e2e
@pytest.mark.parametrize("name", ["take.mkv", "take.mp4"])
def test_a_killed_recorder_leaves_a_readable_recording(tmp_path: Path, name: str) -> None:
    """SIGKILL at any moment costs at most what was not yet on the disk: a third of a second, or one GOP in MP4."""
    path = tmp_path / name
    process = subprocess.Popen([sys.executable, "-c", PACED, str(path)], env=os.environ | {"PYTHONPATH": os.getcwd()})
    try:
        wait_for(lambda: lines_of(path) > 105, "pictures to be recorded")
    finally:
        process.send_signal(signal.SIGKILL)
        process.wait()
    index = read_index(index_path(path))
    with av.open(str(path)) as file:
        held = sum(1 for _ in file.decode(video=0))
    assert index.end is None
    assert len(index.pictures) >= 105
    assert len(index.pictures) - held <= 2 * GOP
    assert all(picture.clean for picture in index.pictures)


@pytest.mark.e2e
def test_a_full_disk_ends_the_recording_in_words_and_leaves_it_readable(tmp_path: Path) -> None:
    """The process lives on, and says what to do."""
    path = tmp_path / "take.mkv"
    run = subprocess.run(
        [sys.executable, "-c", FULL, str(path)],
        env=os.environ | {"PYTHONPATH": os.getcwd()},
        capture_output=True,
        text=True,
        timeout=60,
        check=True,
    )
    assert run.stdout.startswith("False the recording has ended, ")
    assert "no room for" in run.stdout
    assert not run.stderr
    with av.open(str(path)) as file:
        assert sum(1 for _ in file.decode(video=0)) >= GOP


def test_a_recording_ends_before_the_disk_is_full(tmp_path: Path) -> None:
    """The host needs some room, and so does the file's own end."""
    with Recorder(tmp_path / "take.mkv", least_free_bytes=1 << 62) as recorder:
        for unit in units():
            recorder(unit)
    assert "no room for" in recorder.error
    assert list(tmp_path.iterdir()) == []


class SlowDisk:
    """A disk that takes nothing before it may, and a receiver of pictures that keeps 15 for it."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(backlog, "KEPT_UNITS", 15)
        monkeypatch.setattr(backlog, "BLIND_NS", 1 << 60)
        monkeypatch.setattr(recorder_module, "STOP_S", 0.05)
        self.may_write, self._is_asked = threading.Event(), threading.Event()
        write = Take.write

        def slowly(take: Take, unit: AccessUnit) -> None:
            self._is_asked.set()
            assert self.may_write.wait(20.0)
            write(take, unit)

        monkeypatch.setattr(Take, "write", slowly)
        self.receiver = Receiver(ReceiverSettings(source="127.0.0.1", host="127.0.0.1", port=0))
        self._packetiser = Packetiser(1)

    def send(self, pictures: Sequence[AccessUnit]) -> None:
        """Send pictures to the receiver; return when they have come, and the first of all waits for the disk."""
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as out:
            for unit in pictures:
                came = self.receiver.counts.pictures
                for packet in self._packetiser.packets(unit.data, unit.rtp_time):
                    out.sendto(packet, ("127.0.0.1", self.receiver.port))
                wait_for(lambda came=came: self.receiver.counts.pictures > came, "a picture to come")
                assert self._is_asked.wait(20.0)


@pytest.mark.e2e
def test_what_a_slow_disk_does_not_take_is_dropped_counted_and_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Up to the next key picture; the receiver says so while it happens, and the file in the end."""
    disk = SlowDisk(monkeypatch)
    with disk.receiver as receiver, Recorder(tmp_path / "take.mkv") as recorder:
        with recorder.taking(receiver):
            disk.send(units()[:25])
            wait_for(lambda: receiver.counts.recorder_dropped == 25 - 16, "what has no room to be dropped")
            assert VideoCode.RECORDER_SLOW in [finding.code for finding in receiver.why()]
            monkeypatch.setattr(recorder_module, "STOP_S", 20.0)
            disk.may_write.set()
            wait_for(lambda: recorder.counts.pictures == 16, "what waits to be written")
            disk.send(units()[25:])
            wait_for(lambda: recorder.counts.dropped == 14, "the drops to be noted at the next picture")
    assert recorder.error == ""
    assert (recorder.counts.pictures, recorder.counts.dropped) == (26, 14)
    index = read_index(index_path(tmp_path / "take.mkv"))
    assert [(lost.count, "too slow" in lost.why) for lost in index.dropped] == [(14, True)]
    assert [picture.seq for picture in index.pictures] == [*range(16), *range(30, 40)]
    assert all(picture.clean for picture in index.pictures)


@pytest.mark.e2e
def test_drops_at_the_very_end_are_told_too_and_what_waits_is_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """No later picture brings them along."""
    disk = SlowDisk(monkeypatch)
    with disk.receiver as receiver, Recorder(tmp_path / "take.mkv") as recorder:
        with recorder.taking(receiver):
            disk.send(units()[:20])
            monkeypatch.setattr(recorder_module, "STOP_S", 20.0)
            disk.may_write.set()
    end = read_index(index_path(tmp_path / "take.mkv")).end
    assert end is not None
    assert (end.pictures, end.dropped, recorder.error) == (16, 4, "")


@pytest.mark.e2e
def test_a_disk_that_does_not_answer_holds_up_no_end(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It is told; once the disk answers, the file is ended after what it was writing."""
    disk, path = SlowDisk(monkeypatch), tmp_path / "take.mkv"
    recorder = Recorder(path)
    with disk.receiver as receiver:
        with recorder.taking(receiver):
            disk.send(units()[:5])
    assert "has not ended after 0.05 s" in recorder.error
    assert not recorder.stop(0.05)
    assert "has not answered for 0.05 s" in recorder.error
    disk.may_write.set()
    wait_for(lambda: b'"end"' in index_path(path).read_bytes(), "the file to be ended")
    assert len(read_index(index_path(path)).pictures) == 1


def test_a_recorder_that_never_began_leaves_nothing(tmp_path: Path) -> None:
    """Its file was only a claim on the name."""
    assert Recorder(tmp_path / "take.mkv").stop()
    assert list(tmp_path.iterdir()) == []


def test_pictures_after_the_end_are_ignored(tmp_path: Path) -> None:
    """A receiver may still hold the tap."""
    with Recorder(tmp_path / "take.mkv") as recorder:
        for unit in units():
            recorder(unit)
    recorder(units()[0])
    assert recorder.counts.pictures == 40
    assert recorder.path == tmp_path / "take.mkv"
