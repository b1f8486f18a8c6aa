"""Dynamics are loaded when somebody asks for them, and cost nothing before."""

from __future__ import annotations

import subprocess
import sys

import pytest

from gateway.errors import Code, ConfigError
from gateway.kinematics.dynamics.loading import load_dynamics
from gateway.settings.settings import ModelSettings, Settings
from gateway.values import Side

ON = Settings(model=ModelSettings(dynamics=True))

SCRIPT = """
import sys
from gateway.process import daemon
from gateway.settings.settings import Settings
assert daemon._model(Settings()).contacts is None
import gateway.client, gateway.cli.main
print(" ".join(sorted(sys.modules)))
"""


def test_both_arms_are_loaded_with_what_nobody_has_identified():
    """From the description that the settings name."""
    pytest.importorskip("pinocchio", reason="pinocchio is not installed: pip install 'teleavatar-gateway[body]'")
    arms = load_dynamics(ON)
    assert [arms[side].frame for side in Side] == ["left_shoulder_base", "right_shoulder_base"]
    assert {arms[side].drives.source for side in Side} == {"nominal"}


def test_without_pinocchio_the_daemon_does_not_start_and_says_what_to_install(monkeypatch):
    """It was asked for something that it cannot do."""
    monkeypatch.setitem(sys.modules, "pinocchio", None)
    monkeypatch.delitem(sys.modules, "gateway.kinematics.dynamics.arm_dynamics", raising=False)
    monkeypatch.delitem(sys.modules, "gateway.kinematics.pin_model", raising=False)
    monkeypatch.delattr("gateway.kinematics.dynamics.arm_dynamics", raising=False)
    with pytest.raises(ConfigError) as caught:
        load_dynamics(ON)
    assert caught.value.code is Code.BAD_CONFIG and caught.value.field == "model.dynamics"
    assert "teleavatar-gateway[body]" in caught.value.hint


def test_where_it_is_off_nothing_of_it_is_loaded():
    """Neither pinocchio nor our own part of it: not by the daemon with its model, the client or the commands."""
    found = subprocess.run([sys.executable, "-c", SCRIPT], capture_output=True, text=True, check=True, timeout=120)
    modules = set(found.stdout.split())
    assert "gateway.core.robot_state.body_model" in modules
    loaded = {name for name in modules if name.startswith(("pinocchio", "gateway.kinematics.dynamics."))}
    assert loaded <= {"gateway.kinematics.dynamics.parameters"}, "plain values, as a calibration file has them"
    assert "gateway.core.robot_state.contact" not in modules
