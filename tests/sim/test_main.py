"""Rules of `python -m gateway.sim`."""

from __future__ import annotations

import pytest

from gateway.sim import __main__ as program
from gateway.sim import starting
from gateway.sim.robot.manual import MS
from gateway.sim.robot.settings import SimSettings


@pytest.fixture
def started(monkeypatch):
    """What the program would run."""
    calls: list[tuple[str, SimSettings]] = []
    monkeypatch.setattr(starting, "main_sim", lambda listen, settings: calls.append((listen, settings)) or 7)
    return calls


def test_without_arguments_it_is_the_default_robot_on_the_default_port(started):
    """Standard model, joint mode, tcp/127.0.0.1:9000; the exit code is passed on."""
    assert program.main([]) == 7
    assert started == [("tcp/127.0.0.1:9000", SimSettings())]


def test_every_argument_reaches_the_settings(started):
    """Modes of both arms or of each, model, seed, endpoint, namespace, disabled parts, clock."""
    words = "--listen tcp/127.0.0.1:9 --mode pose --right-mode joint --model lift --seed 4 --namespace bot1 --disable left_arm"
    clock = "--clock-offset-s -0.05 --clock-drift-ppm 40"
    program.main([*words.split(), "--disable", "chassis", "--physics", "mujoco", "--differs", "8", *clock.split()])
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
    )
    assert started == [("tcp/127.0.0.1:9", expected)]


def test_an_unknown_mode_is_refused(started, capsys):
    """Argparse names the possibilities."""
    with pytest.raises(SystemExit):
        program.main(["--mode", "force"])
    assert "pose" in capsys.readouterr().err
    assert started == []
