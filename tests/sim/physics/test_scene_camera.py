"""The scene through the robot's camera stream, as processes: drawn, stitched, encoded, sent, received and cut into crops."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest

from gateway.sim.remote import SimControl
from tests.e2e.system import free_port, wait_for
from tests.sim.physics.drawing_needed import demand_drawing
from tests.sim.physics.mujoco_needed import REASON
from tests.video.sending import udp_port

pytest.importorskip("mujoco", reason=REASON)
pytest.importorskip("av")

from gateway.video import Video

pytestmark = pytest.mark.e2e


def red(picture: np.ndarray) -> int:
    """How many pixels are as red as the block."""
    r, g, b = (picture[..., channel].astype(int) for channel in range(3))
    return int(((r > 90) & (r > 2 * g) & (r > 2 * b)).sum())


@pytest.fixture
def endpoint():
    """Where a simulation may listen, if something draws here."""
    demand_drawing()
    return f"tcp/127.0.0.1:{free_port()}"


def test_a_robot_with_forces_and_a_camera_shows_its_scene(endpoint, tmp_path):
    """One command gives both: crops of the full stream show the block to the head's eyes, not to a hanging hand's."""
    port, log = udp_port(), tmp_path / "sim.log"
    words = [
        "-m",
        "gateway.cli",
        "sim",
        "--physics",
        "mujoco",
        "--listen",
        endpoint,
        "--camera-to",
        f"127.0.0.1:{port}",
    ]
    with Video("127.0.0.1", port=port) as video, open(log, "w") as stream:
        sim = subprocess.Popen([sys.executable, *words], stdout=stream, stderr=stream)
        try:
            frame = next(iter(video.frames(timeout=120.0)))
            sim.terminate()
            assert sim.wait(30.0) == 0
        finally:
            sim.kill()
            sim.wait()
    assert "1280x2720 at 45 Hz, the scene, drawn by " in log.read_text() and "Traceback" not in log.read_text()
    assert frame["head_left_eye"].shape == (960, 960, 3)
    assert red(np.asarray(frame["head_left_eye"])) > 50 and red(np.asarray(frame["head_right_eye"])) > 50
    assert red(np.asarray(frame["left_wrist_left_eye"])) == 0


def test_a_camera_of_its_own_shows_the_scene_of_a_robot_that_runs(endpoint, tmp_path):
    """Of any size, beside a simulation that was started without one; it ends orderly when the robot has ended."""
    port, log = udp_port(), tmp_path / "camera.log"
    words = ["-m", "gateway.cli", "sim", "--physics", "mujoco", "--model", "lift", "--listen", endpoint]
    sim = subprocess.Popen([sys.executable, *words], stdout=subprocess.DEVNULL)
    eyes = ["-m", "gateway.sim.camera", "--scene", endpoint, "--to", f"127.0.0.1:{port}", "--size", "320x680"]
    with open(log, "w") as stream:
        camera = subprocess.Popen([sys.executable, *eyes, "--nice", "10"], stdout=stream, stderr=stream)
    try:
        wait_for(lambda: "the scene, drawn by" in log.read_text(), "a camera", 60.0, log.read_text)
        with Video("127.0.0.1", port=port) as video:
            frame = next(iter(video.frames(timeout=60.0)))
        assert red(np.asarray(frame["head_left_eye"])) > 5
        with SimControl(endpoint) as control:
            control.ask("shutdown")
        assert sim.wait(20.0) == 0
        camera.wait(20.0)
        assert "did not answer" in log.read_text() and "Traceback" not in log.read_text()
    finally:
        for process in (sim, camera):
            process.kill()
            process.wait()
