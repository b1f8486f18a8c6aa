"""A world that the solver loses ends its robot, in one line."""

from __future__ import annotations

import math

import pytest

from gateway.sim.node import SimNode, main_sim
from gateway.sim.robot.settings import SimSettings
from tests.e2e.system import free_port
from tests.sim.physics.mujoco_needed import REASON

pytest.importorskip("mujoco", reason=REASON)

pytestmark = pytest.mark.e2e


def test_a_lost_world_is_one_line_and_exit_status_1(capsys):
    """Not a trace, and never a robot that begins anew at zero without a word."""

    def spoiled(settings: SimSettings, listen: str) -> SimNode:
        node = SimNode(settings, listen)
        node.robot.dynamics.world.data.qvel[9] = math.inf
        return node

    listen = f"tcp/127.0.0.1:{free_port()}"
    assert main_sim(listen, SimSettings(physics="mujoco"), make=spoiled) == 1
    said = capsys.readouterr()
    assert "s of physics: mjWARN_BADQVEL; start the simulation again" in said.err and said.err.count("\n") == 1
    assert said.out == f"listening on {listen}\n"
