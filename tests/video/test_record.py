"""Rules of `gateway.cli.cameras.record` and `live_split`: a recording ends well, whoever ends it."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from gateway.cli.cameras import record as record_module
from gateway.cli.cameras.info import info_of
from gateway.cli.cameras.record import default_path, record
from gateway.cli.terminal.ending import ExitStatus
from gateway.errors import Rejected
from gateway.video.decoding.views import VIEWS
from gateway.video.errors import VideoTimeout
from gateway.video.receiving.receiver import ReceiverSettings
from gateway.video.recording.index import index_path, read_index
from tests.e2e.system import wait_for
from tests.video.sending import camera, udp_port

pytestmark = pytest.mark.e2e


@pytest.fixture(autouse=True)
def cache(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """A cache folder of the tests' own for the camera's loop."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path_factory.getbasetemp() / "cache"))
    yield


def settings(port: int) -> ReceiverSettings:
    """Return how to receive from this host."""
    return ReceiverSettings(source="127.0.0.1", port=port)


@pytest.mark.parametrize("name", ["take.mkv", "take.mp4"])
def test_a_recording_of_some_seconds_is_split_while_it_is_made(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Seven files; a split that lags behind is told, and nothing of it is lost."""
    monkeypatch.setattr(record_module, "BEHIND_S", -1.0)
    port, path = udp_port(), tmp_path / name
    with camera(port):
        status = record(settings(port), path, seconds=2.0, first_s=20.0, is_split=True, as_json=True)
    told = capsys.readouterr()
    recorded = json.loads(told.out)
    assert status is ExitStatus.OK
    assert recorded["ok"] is True
    assert recorded["duration_s"] >= 2.0
    assert 20.0 < recorded["fps"] < 45.5  # a camera that gets no processor skips periods
    info = info_of(path)
    assert (info.timing.pictures, info.damaged, info.robot) == (recorded["pictures"], 0, "127.0.0.1")
    for view in VIEWS:
        assert info_of(tmp_path / "take" / f"{view}.mp4").timing.pictures == recorded["pictures"]
    assert recorded["split"]["is_whole"] is True
    assert "splits more slowly" in told.err


@pytest.mark.parametrize(("number", "status"), [(signal.SIGINT, 0), (signal.SIGTERM, 143)])
def test_a_signal_ends_a_recording_well(tmp_path: Path, number: signal.Signals, status: int) -> None:
    """Ctrl-C is how it is ended; SIGTERM ends it as well, and the shell is told."""
    port, path = udp_port(), tmp_path / "take.mkv"
    words = ["video", "record", "--robot", "127.0.0.1", "--port", str(port), "--out", str(path), "--json"]
    with camera(port):
        process = subprocess.Popen(
            [sys.executable, "-m", "gateway.cli", *words],
            env=os.environ | {"PYTHONPATH": os.getcwd()},
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        try:
            index = index_path(path)
            wait_for(lambda: index.exists() and index.read_bytes().count(b"\n") > 45, "pictures to be recorded")
            process.send_signal(number)
            said, trouble = process.communicate(timeout=30)
        finally:
            process.kill()
    assert process.returncode == status, trouble
    recorded = json.loads(said)
    end = read_index(index).end
    assert end is not None
    assert info_of(path).timing.pictures == recorded["pictures"] == end.pictures >= 45


@pytest.mark.thorough
def test_a_stream_that_pauses_is_told_and_recorded_on(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The sender ends, another one begins: one recording, the pause in its times."""
    monkeypatch.setattr(record_module, "STALL_S", 0.5)
    port, path = udp_port(), tmp_path / "take.mkv"
    done: list[ExitStatus] = []
    with camera(port, "--for", "2"):
        thread = threading.Thread(
            target=lambda: done.append(
                record(settings(port), path, seconds=5.0, first_s=30.0, is_split=False, as_json=False)
            )
        )
        thread.start()
        wait_for(lambda: "no picture for 0.5 s" in capsys.readouterr().err, "the pause to be told")
    with camera(port):
        thread.join(60)
    assert done == [ExitStatus.OK]
    info = info_of(path)
    assert info.senders == 2
    assert info.timing.interval_max_ms > 500
    assert info.damaged == 0


def test_without_a_picture_to_begin_with_it_says_so_and_leaves_nothing(tmp_path: Path) -> None:
    """No empty file that looks like a recording."""
    with pytest.raises(VideoTimeout, match=r"in 0\.5 s"):
        record(settings(udp_port()), tmp_path / "take.mkv", seconds=1.0, first_s=0.5, is_split=True, as_json=False)
    assert list(tmp_path.iterdir()) == []


def test_a_file_in_the_way_is_refused_before_anything_is_received(tmp_path: Path) -> None:
    """Neither a recording nor a view is overwritten."""
    (tmp_path / "take.mkv").touch()
    with pytest.raises(Rejected, match="exists"):
        record(settings(udp_port()), tmp_path / "take.mkv", seconds=1.0, first_s=0.5, is_split=False, as_json=False)
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / f"{VIEWS[0]}.mp4").touch()
    with pytest.raises(Rejected, match="is there"):
        record(settings(udp_port()), tmp_path / "other.mkv", seconds=1.0, first_s=0.5, is_split=True, as_json=False)
    assert not (tmp_path / "other.mkv").exists()
    assert not index_path(tmp_path / "other.mkv").exists()


def test_a_recording_that_nobody_named_is_named_by_its_time() -> None:
    """The safest format, and no two on the same second."""
    assert default_path().suffix == ".mkv"
    assert default_path().name.startswith("ta2-20")
