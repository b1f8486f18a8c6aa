"""The plugin of LeRobot, with LeRobot where it is installed and else with a stand-in, on the real engine in virtual time."""

from __future__ import annotations

import importlib
import importlib.util
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

from gateway.client import connect
from tests.client.robot_world import RobotWorld
from tests.plugins import lerobot_stand_in

PLUGIN = Path(__file__).resolve().parents[2] / "plugins/lerobot_robot_teleavatar"


@pytest.fixture(scope="session")
def plugin():
    """Return the plugin; nothing of it, nor of the stand-in, is left for other tests."""
    before = set(sys.modules)
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(PLUGIN)
        if importlib.util.find_spec("lerobot") is None:
            lerobot_stand_in.install()
        yield importlib.import_module("lerobot_robot_teleavatar")
    for name in [name for name in sys.modules if name not in before and name.partition("_")[0].startswith("lerobot")]:
        sys.modules.pop(name)


@pytest.fixture
def errors(plugin):
    """Return LeRobot's errors."""
    return importlib.import_module("lerobot.utils.errors")


@pytest.fixture
def place(plugin, monkeypatch):
    """Return worlds by the address of their gateways: a robot, a gateway and its clients in virtual time."""
    worlds = {}

    def connected(target, *, name):
        world = worlds.setdefault(target, RobotWorld())
        return connect(transport=world.transport(), name=name)

    for part in ("teleavatar", "teleavatar_leader"):
        monkeypatch.setattr(f"lerobot_robot_teleavatar.{part}.connect", connected)
    clock = SimpleNamespace(monotonic=lambda: max(world.now_ns() for world in worlds.values()) / 1e9)
    monkeypatch.setattr("lerobot_robot_teleavatar.device.time", clock)
    return worlds


@pytest.fixture
def world(place):
    """Return the world of the robot."""
    return place.setdefault(None, RobotWorld())


@pytest.fixture
def robot(plugin, world):
    """Return a robot that is connected; it is disconnected at the end."""
    robot = plugin.Teleavatar(plugin.TeleavatarConfig(id="r1"))
    robot.connect()
    yield robot
    if robot.is_connected:
        robot.disconnect()
