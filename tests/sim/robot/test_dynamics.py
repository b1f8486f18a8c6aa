"""Which dynamics a robot gets, and what is said where MuJoCo is missing."""

from __future__ import annotations

import sys

import pytest

from gateway.sim.robot.dynamics import FirstOrder, PhysicsMissing
from gateway.sim.robot.manual import S
from gateway.sim.robot.model import SimRobot
from gateway.sim.robot.settings import SimSettings


@pytest.fixture
def no_mujoco(monkeypatch):
    """An interpreter without MuJoCo."""
    monkeypatch.setitem(sys.modules, "mujoco", None)
    for name in [name for name in sys.modules if name.startswith("gateway.sim.physics.")]:
        monkeypatch.delitem(sys.modules, name)


def test_without_a_wish_there_is_no_physics_and_nothing_of_it_is_imported(no_mujoco):
    """The kinematic robot needs no MuJoCo, has no time of its own and nothing more to tell."""
    robot = SimRobot()
    robot.dynamics.shed(10 * S)
    robot.advance(1 * S, latest_only=True)
    assert isinstance(robot.dynamics, FirstOrder)
    assert robot.dynamics.pace() is None and robot.dynamics.report() is None
    assert not [name for name in sys.modules if name.startswith("gateway.sim.physics.")]


def test_physics_without_mujoco_is_refused_with_the_remedy(no_mujoco):
    """One line: what is missing and how to get it."""
    with pytest.raises(
        PhysicsMissing, match=r"MuJoCo, which is not installed: pip install 'teleavatar-gateway\[sim\]'"
    ):
        SimRobot(SimSettings(physics="mujoco"))


def test_another_missing_module_is_not_taken_for_mujoco(monkeypatch, no_mujoco):
    """A broken installation is told as what it is."""
    monkeypatch.setitem(sys.modules, "gateway.sim.physics.world", None)
    with pytest.raises(ModuleNotFoundError) as caught:
        SimRobot(SimSettings(physics="mujoco"))
    assert not isinstance(caught.value, PhysicsMissing)


def test_settings_know_the_kinds_of_physics():
    """Another word means nothing."""
    with pytest.raises(ValueError, match="physics 'bullet' is not one of kinematic, mujoco"):
        SimSettings(physics="bullet")
