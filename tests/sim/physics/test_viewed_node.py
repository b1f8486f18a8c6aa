"""The window: refused in one line without a display, shown and closed with one."""

from __future__ import annotations

import os
import subprocess
import sys
import time

import pytest

from gateway.sim.remote import SimControl
from tests.e2e.system import free_port, wait_for
from tests.sim.physics.drawing_needed import demand_screen
from tests.sim.physics.mujoco_needed import REASON

pytest.importorskip("mujoco", reason=REASON)

pytestmark = [
    pytest.mark.e2e,
    pytest.mark.skipif(not sys.platform.startswith("linux"), reason="displays of other systems cannot be taken away"),
]

WORDS = [sys.executable, "-m", "gateway.cli", "sim", "--physics", "mujoco", "--viewer", "--listen"]
BARE = {name: value for name, value in os.environ.items() if name not in {"DISPLAY", "WAYLAND_DISPLAY"}}


def test_without_a_display_there_is_one_line_and_no_robot():
    """Not a window that is waited for for ever, nor a trace."""
    ended = subprocess.run([*WORDS, "tcp/127.0.0.1:19149"], env=BARE, capture_output=True, text=True, timeout=30)
    assert ended.returncode == 1 and ended.stdout == ""
    assert "no display for a window" in ended.stderr and "--headless" in ended.stderr and ended.stderr.count("\n") == 1


def test_on_a_display_the_robot_lives_with_its_window(tmp_path):
    """Time of physics passes while it is shown; asked to end, it closes its window and ends with status 0."""
    demand_screen()
    read, write = os.pipe()
    screen = ["Xvfb", "-displayfd", str(write), "-screen", "0", "640x480x24", "-nolisten", "tcp"]
    with open(tmp_path / "xvfb.log", "w") as log:
        display = subprocess.Popen(screen, pass_fds=(write,), stdout=log, stderr=log)
    os.close(write)
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    try:
        with os.fdopen(read) as stream:
            number = stream.readline().strip()
        shown = {**BARE, "DISPLAY": f":{number}", "LIBGL_ALWAYS_SOFTWARE": "1"}
        with open(tmp_path / "sim.log", "w") as log:
            sim = subprocess.Popen([*WORDS, endpoint], env=shown, stdout=log, stderr=log)
        try:
            control = wait_for(lambda: SimControl(endpoint), "a robot with a window", 60.0)
            with control:
                physics = wait_for(lambda: control.ask("stats").get("physics"), "its physics")
                begun = time.monotonic()
                wait_for(
                    lambda: control.ask("stats")["physics"]["time_s"] > physics["time_s"] + 0.5,
                    "time that passes",
                    60.0,
                )
                assert time.monotonic() - begun < 60.0
                control.ask("shutdown")
            assert sim.wait(30.0) == 0
        finally:
            sim.kill()
            sim.wait()
    finally:
        display.kill()
        display.wait()
