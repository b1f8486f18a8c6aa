"""What a hand holds, said and shown between processes; that it is weighed well is proven in virtual time, `tests/client`."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from gateway.client import Payload
from tests.e2e.system import ROOT, System, wait_for

pytest.importorskip("pinocchio", reason="pinocchio is not installed: pip install 'teleavatar-gateway[body]'")

pytestmark = [pytest.mark.e2e, pytest.mark.sim_only("nothing of it reaches the robot")]


def test_what_a_hand_is_said_to_hold_outlives_its_owner_until_the_shell_takes_it_back(
    tmp_path: Path, systems: Callable[..., System]
) -> None:
    """Nothing moves; nobody's state but this hand's changes."""
    system = systems(tmp_path, config="[model]\ndynamics = true\n", has_guard=False)
    with system.connect("holder") as robot:
        with robot.control() as own:
            own.left_arm.payload(Payload(mass=0.3, com=(0.15, 0.0, -0.02)))
        told = wait_for(lambda: robot.state.left_arm.contact.payload, "a payload", tell=system.logs)
        assert told == Payload(mass=0.3, com=(0.15, 0.0, -0.02), frame="left_ee")
        assert robot.state.right_arm.contact.payload is None
        words = ("payload", "--arm", "left", "--none", "--yes", "--json", "--socket", system.target)
        command = [sys.executable, "-m", "gateway.cli", *words]
        done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=60.0, check=False)
        assert done.returncode == 0 and json.loads(done.stdout)["payload"] is None, done.stderr
        wait_for(lambda: robot.state.left_arm.contact.payload is None, "an empty hand", tell=system.logs)
        assert robot.state.state == "READ_ONLY" and not robot.state.left_arm.is_streaming
