"""Rules of `gateway.video.recording.recorder`: it survives being killed, a full disk and a slow one, and never blocks."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import av
import pytest

from gateway.video.recording.index import index_path, read_index
from gateway.video.recording.recorder import Recorder
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
recorder.start()
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
recorder.start()
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


def test_what_a_slow_disk_does_not_take_is_dropped_counted_and_told(tmp_path: Path) -> None:
    """The tap returns at once; pictures after the gap are marked until the next IRAP."""
    recorder = Recorder(tmp_path / "take.mkv", queue_units=15)
    for unit in units()[:25]:
        recorder(unit)  # nobody writes yet
    recorder.start()
    wait_for(lambda: recorder.counts.pictures == 15, "the queue to be written")
    for unit in units()[25:]:
        recorder(unit)
    assert recorder.stop()
    assert (recorder.counts.pictures, recorder.counts.dropped) == (30, 10)
    index = read_index(index_path(tmp_path / "take.mkv"))
    assert [(lost.count, "too slow" in lost.why) for lost in index.dropped] == [(10, True)]
    assert [picture.seq for picture in index.pictures if not picture.clean] == list(range(25, 30))


def test_drops_at_the_very_end_are_told_too(tmp_path: Path) -> None:
    """No later picture brings them along."""
    recorder = Recorder(tmp_path / "take.mkv", queue_units=15)
    for unit in units()[:20]:
        recorder(unit)
    recorder.start()
    assert recorder.stop()
    assert recorder.counts.dropped == 5


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
