"""Why, end to end: faults of the simulated robot, recognised by a real daemon, told to clients, to asyncio and to a shell."""

from __future__ import annotations

import asyncio
import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from gateway.client import Robot, aio
from gateway.robot.limits import HOME_Q_RAD
from tests.e2e.system import ROOT, System, wait_for
from tests.thoroughness import IS_THOROUGH

pytestmark = [pytest.mark.e2e, pytest.mark.sim_only("what the gateway tells of it is the matter")]

Systems = Callable[..., System]
HOME = {side.value: np.array(q) for side, q in HOME_Q_RAD.items()}


def codes(robot: Robot) -> set[str]:
    """Return what is found, without what a busy test machine does to our streams. Times are proven in virtual time."""
    return {finding.code for finding in robot.why().findings} - {"STREAM_LATE"}


def why_in_a_shell(system: System) -> dict:
    """Return what `ta2 why --json` prints."""
    done = subprocess.run(
        [sys.executable, "-m", "gateway.cli", "why", "--socket", system.target, "--json"],
        cwd=ROOT, capture_output=True, text=True, timeout=30, check=True,
    )  # fmt: skip
    return json.loads(done.stdout)


def test_faults_of_the_robot_are_recognised_and_told(tmp_path: Path, systems: Systems) -> None:
    """A blocked arm, a silent topic, VR mode: the right code with numbers and remedy, and nothing once it is over."""
    system = systems(tmp_path, has_guard=IS_THOROUGH)
    with system.connect("why") as robot:
        wait_for(lambda: not codes(robot), "nothing found on a healthy robot")
        assert robot.why().refusals["left_arm"].code == "NOT_OWNER"
        with robot.control() as own:
            own.enable(timeout=15.0)
            wait_for(lambda: not robot.why().refusals, "nothing refused to an owner")
            own.move_to(HOME, speed=0.2)
            wait_for(lambda: any(m.progress > 0.1 for m in robot.state.motions), "a motion under way")
            system.control.ask("fault", fault="blocked", side="left")
            wait_for(lambda: "TRACKING_STALL" in codes(robot), f"the stall ({robot.why()})")
            (stall,) = [finding for finding in robot.why().findings if finding.code == "TRACKING_STALL"]
            assert stall.facts["off_rad"] > 0.03 and "left arm joint" in stall.message and stall.hint
            system.control.ask("clear")
        wait_for(lambda: not codes(robot), f"the end of the stall ({robot.why()})")
        if robot.state.latches:
            robot.recover()

        system.control.ask("fault", fault="drop", topic="/left_gripper/joint_states")
        wait_for(lambda: "ROUTE_SUSPECT" in codes(robot), "the silent topic")
        document = why_in_a_shell(system)
        assert any("/left_gripper/joint_states" in finding["message"] for finding in document["findings"])
        system.control.ask("clear")
        wait_for(lambda: not codes(robot), "the topic again")

        system.control.ask("fault", fault="vr_mode")
        with robot.control() as own:
            wait_for(lambda: "MODE_VR" in codes(robot), "VR mode")
            wait_for(lambda: robot.why().refusals.get("enable") is not None, "what it refuses")
            assert robot.why().refusals["enable"].code == "MODE_VR"

            async def ask() -> set[str]:
                async with aio.connect(system.target, name="twin") as twin:
                    return {finding.code for finding in (await twin.why()).findings}

            assert "MODE_VR" in asyncio.run(ask())
