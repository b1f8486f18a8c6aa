"""Rules of `python -m gateway.sim.camera` and of `ta2 sim --camera-to`: pictures arrive, and nobody is left behind."""

from __future__ import annotations

import importlib.util
import json
import os
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from gateway.cli import main as cli
from gateway.cli.command_line.arguments import parse
from gateway.sim import starting
from gateway.sim.camera import __main__ as camera
from gateway.sim.camera import camera_process
from gateway.sim.camera.camera_process import CameraProcess
from gateway.sim.camera.handover import HandOvers
from gateway.sim.camera.hevc import EncoderMissing
from tests.e2e.system import ROOT, Process, free_port, wait_for

pytest.importorskip("av")

SMALL = ["--size", "160x340", "--mbps", "2", "--gop", "15", "--pictures", "15"]


@pytest.fixture
def receiver() -> Iterator[socket.socket]:
    """A UDP socket of loopback."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as receiver:
        receiver.bind(("127.0.0.1", 0))
        receiver.settimeout(20.0)
        yield receiver


def place(receiver: socket.socket) -> str:
    """Return where a socket receives."""
    return f"127.0.0.1:{receiver.getsockname()[1]}"


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A cache folder of this test's own, also for the processes that it starts."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    return tmp_path / "cache" / "ta2"


def is_alive(pid: int) -> bool:
    """Return whether a process runs, and is not a corpse."""
    try:
        return " Z " not in Path(f"/proc/{pid}/stat").read_text()
    except OSError:
        return False


@pytest.mark.e2e
def test_pictures_arrive_for_the_time_asked_for(receiver, cache, tmp_path, capsys):
    """In this process: RTP of type 96 from one sender, the hand-over table filled, the counts told."""
    table = tmp_path / "table"
    words = ["--to", place(receiver), *SMALL, "--source", "loop", "--for", "0.5", "--table", str(table)]
    before = signal.getsignal(signal.SIGTERM)
    assert camera.main(words) == 0
    assert signal.getsignal(signal.SIGTERM) is before
    packet = receiver.recv(2048)
    assert packet[:1] == b"\x80" and packet[1] & 0x7F == 96
    said = capsys.readouterr().out.splitlines()
    assert "encoding a loop of 15 pictures" in said[0] and "160x340 at 45 Hz" in said[1]
    counts = json.loads(said[2].removeprefix("camera: "))
    assert counts["pictures"] >= 5 and counts["refused"] == 0
    with HandOvers(table) as handed:
        assert handed.count == counts["pictures"] and handed.find(0) is not None
    assert len(list(cache.iterdir())) == 1


@pytest.mark.e2e
def test_auto_plays_a_loop_that_is_there_and_encodes_live_where_that_is_fast(receiver, cache, capsys, monkeypatch):
    """Where it is not, it makes the loop: no machine sends fewer pictures than it should."""
    words = ["--to", place(receiver), *SMALL, "--for", "0.1"]
    monkeypatch.setattr(camera, "HEADROOM", 1e-6)
    assert camera.main(words) == 0
    monkeypatch.setattr(camera, "HEADROOM", 1e6)
    assert camera.main(words) == 0
    monkeypatch.setattr(camera, "HEADROOM", 1e-6)
    assert camera.main(words) == 0
    told = [line for line in capsys.readouterr().out.splitlines() if "SSRC" in line]
    assert ["live" if "encoded live" in line else "loop" for line in told] == ["live", "loop", "loop"]


@pytest.mark.e2e
def test_it_ends_with_its_parent(receiver, cache, tmp_path):
    """Killed, so that it can tell nobody."""
    words = ["-m", "gateway.sim.camera", "--to", place(receiver), *SMALL]
    text = (
        "import os, subprocess, sys, time\n"
        f"words = [*{words!r}, '--parent', str(os.getpid())]\n"
        "print(subprocess.Popen([sys.executable, *words]).pid, flush=True)\n"
        "time.sleep(60)\n"
    )
    parent = subprocess.Popen([sys.executable, "-c", text], cwd=ROOT, stdout=subprocess.PIPE)
    assert parent.stdout is not None
    pid = int(parent.stdout.readline())
    receiver.recv(2048)
    parent.kill()
    parent.wait()
    wait_for(lambda: not is_alive(pid), "the end of the camera")
    parent.stdout.close()


@pytest.mark.e2e
def test_a_simulated_robot_sends_its_pictures_and_takes_its_camera_along(receiver, cache, tmp_path):
    """Both are there; SIGTERM to the robot ends both."""
    listen = f"tcp/127.0.0.1:{free_port()}"
    _small_camera_in(tmp_path)
    environment = {"PYTHONPATH": f"{tmp_path}{os.pathsep}{ROOT}"}
    words = ["-m", "gateway.cli", "sim", "--listen", listen, "--camera-to", place(receiver)]
    robot = Process("sim", words, tmp_path, environment)
    try:
        assert receiver.recv(2048)[1] & 0x7F == 96
        wait_for(lambda: "listening on" in robot.text(), "the robot", tell=robot.text)
        (child,) = Path(f"/proc/{robot.pid}/task/{robot.pid}/children").read_text().split()
        robot.send(signal.SIGTERM)
        assert robot.wait() == 0
        assert not is_alive(int(child))
    finally:
        robot.end()


def _small_camera_in(folder: Path) -> None:
    """Let programs started with this folder on their path send small pictures: full-size ones take long to encode."""
    (folder / "sitecustomize.py").write_text(
        f"import gateway.sim.camera.camera_process as process\nprocess.SETTINGS = (*process.SETTINGS, *{SMALL!r})\n"
    )


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--size", "100x100"], "160x340"),
        (["--rate", "0"], "rate_hz 0"),
        (["--spread", "2", "--source", "live", "--size", "160x340"], "spread 2.0"),
        (["--bind", "203.0.113.1", "--source", "live", "--size", "160x340"], "assign requested address"),
    ],
)
def test_what_cannot_be_is_told_in_a_line(words, message, capsys, cache):
    """With status 1."""
    assert camera.main(words) == 1
    said = capsys.readouterr().err
    assert said.startswith("camera: ") and message in said and said.count("\n") == 1


@pytest.mark.parametrize("words", [["--to", "8890"], ["--size", "big"], ["--key-frames", "none"]])
def test_words_that_mean_nothing_are_refused(words, capsys):
    """By argparse, with the usage."""
    with pytest.raises(SystemExit):
        camera.main(words)
    assert "usage" in capsys.readouterr().err


def test_without_pyav_no_robot_is_started(monkeypatch, capsys):
    """The remedy is told instead: at once, not after a minute without pictures."""
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    monkeypatch.setattr(starting, "main_sim", lambda *_, **__: pytest.fail("the robot was started"))
    with pytest.raises(EncoderMissing, match=r"teleavatar-gateway\[video\]"):
        CameraProcess("127.0.0.1:8890")
    for words in (["--camera-to", "127.0.0.1:8890"], ["--camera"]):
        assert cli.main(["sim", *words]) == 1
        assert "teleavatar-gateway[video]" in capsys.readouterr().err


def test_a_scene_without_what_draws_it_is_one_line(monkeypatch, capsys):
    """The name of what is missing and the extras that have it; nothing is asked of anybody."""
    monkeypatch.setitem(sys.modules, "mujoco", None)
    for name in [name for name in sys.modules if name.startswith("gateway.sim.physics.")]:
        monkeypatch.delitem(sys.modules, name)
    assert camera.main(["--scene", "tcp/127.0.0.1:19147", "--to", "127.0.0.1:19146"]) == 1
    said = capsys.readouterr().err
    assert said == "camera: --scene needs mujoco: pip install 'teleavatar-gateway[sim,video]'\n"


def test_an_address_that_is_none_is_refused_before_anything_is_started():
    """With an example."""
    with pytest.raises(ValueError, match="HOST:PORT"):
        CameraProcess("8890")


def test_the_cache_is_where_the_user_keeps_caches(monkeypatch, tmp_path):
    """The base directory specification ignores relative paths."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert camera.cache_folder() == tmp_path / "ta2"
    monkeypatch.setenv("XDG_CACHE_HOME", "relative")
    assert camera.cache_folder() == Path.home() / ".cache" / "ta2"


@pytest.mark.e2e
def test_a_camera_that_does_not_end_is_killed(monkeypatch):
    """It must not outlive its robot."""
    monkeypatch.setattr(camera_process, "_PATIENCE_S", 0.05)
    with CameraProcess("127.0.0.1:8890") as process:
        assert process.pid is not None
        os.kill(process.pid, signal.SIGSTOP)
        pid = process.pid
    assert not is_alive(pid) and process.pid is None


def test_the_camera_is_off_unless_asked_for():
    """`--camera-to` asks for it too."""
    assert not parse(["sim"]).camera and parse(["sim"]).camera_to is None
    assert parse(["sim", "--camera"]).camera
    assert parse(["sim", "--camera-to", "10.0.0.5:8890"]).camera_to == "10.0.0.5:8890"
