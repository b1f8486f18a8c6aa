"""A film of a running simulation, as programs."""

from __future__ import annotations

import signal
import subprocess
import sys
import time

import pytest

from tests.e2e.system import free_port, wait_for
from tests.sim.physics.drawing_needed import demand_drawing
from tests.sim.physics.mujoco_needed import REASON

pytest.importorskip("mujoco", reason=REASON)
av = pytest.importorskip("av")

pytestmark = pytest.mark.e2e


@pytest.mark.thorough
def test_a_film_lasts_as_long_as_the_clock_says_and_is_whole_when_the_robot_has_ended(tmp_path):
    """`--record` beside a robot: pictures with times of their own, the last one near the end, however few there are."""
    demand_drawing()
    endpoint, film, log = f"tcp/127.0.0.1:{free_port()}", tmp_path / "a.mp4", tmp_path / "sim.log"
    words = ["-m", "gateway.cli", "sim", "--physics", "mujoco", "--listen", endpoint, "--record", str(film)]
    with open(log, "w") as stream:
        sim = subprocess.Popen([sys.executable, *words], stdout=stream, stderr=stream)
    try:
        wait_for(lambda: "film: 960x544" in log.read_text(), "a film", 60.0, log.read_text)
        begun = time.monotonic()
        time.sleep(4.0)
        sim.send_signal(signal.SIGINT)
        assert sim.wait(30.0) == 0
        lasted = time.monotonic() - begun
    finally:
        sim.kill()
        sim.wait()
    assert "pictures in" in log.read_text()
    with av.open(str(film)) as container:
        (video,) = container.streams.video
        times = [float(picture.pts * picture.time_base) for picture in container.decode(video)]
    assert (video.width, video.height) == (960, 544)
    assert times == sorted(set(times))  # few on a machine that is busy: it leaves the processor to the robot
    assert 1.0 < times[-1] < lasted + 1.0
