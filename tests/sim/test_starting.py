"""From options to a robot: what is refused before anything listens, and that nothing is imported that is not asked for."""

from __future__ import annotations

import sys

import pytest

from gateway.cli.command_line.arguments import parse
from gateway.cli.main import main
from gateway.sim import starting
from gateway.sim.robot.manual import MS
from gateway.sim.robot.settings import SimSettings
from gateway.sim.starting import CannotStart, start


@pytest.fixture
def started(monkeypatch):
    """What would run."""
    calls: list[tuple[str, SimSettings]] = []
    monkeypatch.setattr(starting, "main_sim", lambda listen, settings, **more: calls.append((listen, settings)) or 3)
    return calls


def options(*words: str):
    """Parsed words."""
    return parse(["sim", *words])


def test_without_arguments_it_is_the_default_robot_on_the_default_port(started):
    """Standard model, joint mode, tcp/127.0.0.1:9000."""
    start(options())
    assert started == [("tcp/127.0.0.1:9000", SimSettings())]


def test_every_argument_reaches_the_settings(started):
    """Modes of both arms or of each, model, seed, endpoint, namespace, disabled parts, clock, readings of the manual."""
    words = "--listen tcp/127.0.0.1:9 --mode pose --right-mode joint --model lift --seed 4 --namespace bot1 --disable left_arm"
    more = "--clock-offset-s -0.05 --clock-drift-ppm 40 --ready-needs-commands --pose-silence pursues --gripper-zero-rad 0.13"
    start(options(*words.split(), "--disable", "chassis", "--physics", "mujoco", "--differs", "8", *more.split()))
    expected = SimSettings(
        model="lift",
        left_mode="pose",
        right_mode="joint",
        seed=4,
        physics="mujoco",
        differs_percent=8.0,
        namespace="bot1",
        enable_left_arm=False,
        enable_chassis=False,
        clock_offset_ns=-50 * MS,
        clock_drift_ppm=40.0,
        ready_needs_commands=True,
        pose_silence="pursues",
        gripper_zero_rad=0.13,
    )
    assert started == [("tcp/127.0.0.1:9", expected)]


def test_a_window_without_physics_is_refused(started):
    """There are no bodies to show; the words to add are told."""
    with pytest.raises(CannotStart, match="add --physics mujoco"):
        start(options("--viewer"))
    assert started == []


def test_a_window_without_its_library_is_refused(started, monkeypatch):
    """The name of what is missing, and the extra that has it."""
    monkeypatch.setitem(sys.modules, "glfw", None)
    monkeypatch.delitem(sys.modules, "gateway.sim.physics.viewed_node", raising=False)
    with pytest.raises(CannotStart, match=r"--viewer needs glfw: pip install 'teleavatar-gateway\[sim\]'"):
        start(options("--viewer", "--physics", "mujoco"))
    assert started == []


def test_physics_that_is_missing_is_one_line_and_exit_status_1(monkeypatch, capsys):
    """Nothing listens then."""
    monkeypatch.setitem(sys.modules, "mujoco", None)
    for name in [name for name in sys.modules if name.startswith("gateway.sim.physics.")]:
        monkeypatch.delitem(sys.modules, name)
    assert main(["sim", "--physics", "mujoco", "--listen", "tcp/127.0.0.1:19148"]) == 1
    said = capsys.readouterr()
    assert "MuJoCo, which is not installed" in said.err and said.out == "" and said.err.count("\n") == 1


def test_a_film_needs_physics_and_a_folder(started, tmp_path):
    """Before the robot listens: there is a scene to film, and a place for the file."""
    with pytest.raises(CannotStart, match="add --physics mujoco"):
        start(options("--record", str(tmp_path / "a.mp4")))
    for wrong in ("nowhere/a.mp4", str(tmp_path / "a.avi")):
        with pytest.raises(CannotStart, match=r"an \.mp4 file in a folder that exists, not "):
            start(options("--physics", "mujoco", "--record", wrong))
    assert started == []


def test_a_camera_s_address_that_is_none_is_refused(started):
    """Before the robot listens."""
    with pytest.raises(CannotStart, match="nowhere"):
        start(options("--camera-to", "nowhere"))
    assert started == []


def test_what_means_nothing_together_is_refused(started):
    """What settings refuse is told as it is."""
    with pytest.raises(CannotStart, match="needs physics 'mujoco'"):
        start(options("--differs", "8"))
    assert started == []


def test_the_exit_status_is_passed_on(started):
    """Of whatever ran."""
    assert start(options("--physics", "mujoco")) == 3
    assert started == [("tcp/127.0.0.1:9000", SimSettings(physics="mujoco"))]
