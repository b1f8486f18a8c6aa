"""Is it this robot's body, end to end: joints of the simulated robot whose zeros are off, told, identified and corrected."""

from __future__ import annotations

import json
import random
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from gateway.cli.body.calibration_writing import write_arms
from gateway.client import Control, Robot
from gateway.codes import Code
from gateway.errors import GatewayError
from gateway.kinematics.calibration import RobotIdentity
from gateway.kinematics.calibration_file.arm_section import ArmCalibration, fingerprint
from gateway.kinematics.correction import ArmCorrection
from gateway.kinematics.description import nominal
from gateway.robot.limits import JOINT_LOWER_RAD, JOINT_UPPER_RAD
from gateway.values import Side
from tests.e2e.system import ATTEMPTS, ROOT, STALLED, System, wait_for
from tests.thoroughness import IS_THOROUGH

pytestmark = pytest.mark.e2e

Systems = Callable[..., System]
WITHIN_S = 5.0
ZEROS_RAD = (0.02, -0.03, 0.05, 0.04, -0.06, 0.03, 0.05)
"""What the left arm's joints are off by."""
SERIAL = "TA2-0042"


def verdicts(robot: Robot) -> dict[str, str]:
    """Return what is known of the model of each arm."""
    return {
        side: "none" if (model := robot.state.arm(side).model) is None else model.state for side in ("left", "right")
    }


def told(robot: Robot) -> str:
    """Return the same with figures, for failure messages."""
    return "; ".join(f"{side}: {robot.state.arm(side).model}" for side in ("left", "right"))


def ta2(system: System, *words: str, seconds: float = 30.0) -> subprocess.CompletedProcess[str]:
    """Run a command of the shell."""
    command = [sys.executable, "-m", "gateway.cli", *words]
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=seconds, check=False)


def displace(system: System) -> None:
    """Put the left arm's joints elsewhere than they say."""
    for joint, delta_rad in enumerate(ZEROS_RAD, start=1):
        system.control.ask("fault", fault="joint_zero", side="left", joint=joint, delta_rad=delta_rad)


def goals(seed: int) -> Iterator[dict[str, list[float]]]:
    """Yield postures in most of the range of both arms."""
    rng = random.Random(seed)
    while True:
        yield {
            side.value: [
                rng.uniform(0.9 * low + 0.1 * high, 0.1 * low + 0.9 * high)
                for low, high in zip(JOINT_LOWER_RAD[side], JOINT_UPPER_RAD[side], strict=True)
            ]
            for side in Side
        }


@contextmanager
def wandering(own: Control, speed: float) -> Iterator[None]:
    """Let both arms go from posture to posture meanwhile."""
    is_over = threading.Event()

    def wander() -> None:
        for goal in goals(5):
            if is_over.is_set():
                return
            try:
                own.move_to(goal, speed=speed).result(timeout=60.0)
            except GatewayError as ended:  # this host stood still for a moment: on with the next one
                if ended.code is Code.NOT_ENABLED:  # for so long that nothing was held any more
                    own.enable(timeout=15.0)
                elif ended.code.value not in STALLED:
                    raise
                time.sleep(0.2)

    walker = threading.Thread(target=wander)
    walker.start()
    try:
        yield
    finally:
        is_over.set()
        walker.join(60.0)


@pytest.mark.thorough
@pytest.mark.sim_only("a minute of motion, of which another wire to the robot changes nothing")
def test_a_body_that_is_not_the_models_is_told_identified_and_corrected(tmp_path: Path, systems: Systems) -> None:
    """Nominal: agrees, in motion too. Zeros off: differs within 5 s. Identified from its own motion: agrees again."""
    system = systems(tmp_path, has_guard=IS_THOROUGH, config=f'[robot]\nserial = "{SERIAL}"\n')
    own_file = tmp_path / "own.json"
    with system.connect("model") as robot:
        wait_for(lambda: set(verdicts(robot).values()) == {"agrees"}, "agreement", WITHIN_S, lambda: told(robot))
        with robot.control() as own:
            own.enable(timeout=15.0)
            seen: set[str] = set()
            with wandering(own, speed=1.0):
                until = time.monotonic() + 8.0
                while time.monotonic() < until:
                    seen.update(verdicts(robot).values())
                    time.sleep(0.05)
            assert seen == {"agrees"}, told(robot)
            displace(system)
            expected = {"left": "differs", "right": "agrees"}
            wait_for(lambda: verdicts(robot) == expected, "the difference", WITHIN_S, lambda: told(robot))
            wait_for(lambda: "MODEL_DIFFERS" in {finding.code for finding in robot.why().findings}, "the finding")
            why = json.loads(ta2(system, "why", "--socket", system.target, "--json").stdout)
            (finding,) = [finding for finding in why["findings"] if finding["code"] == "MODEL_DIFFERS"]
            assert finding["facts"]["angle_rad"] > 0.02 and "ta2 identify" in finding["hint"]
            attempts = max(ATTEMPTS, 2)  # a host that stands still for seconds may take it two sessions
            for _ in range(attempts):
                with wandering(own, speed=0.6):
                    # All twelve numbers of the arm; it ends by itself, after some 30 s.
                    words = ["--live", "--seconds", "90", "--arm", "left", "--json"]
                    words += ["--out", str(own_file), "--serial", SERIAL, "--socket", system.target]
                    done = ta2(system, "identify", *words, seconds=120.0)
                if done.returncode == 0:
                    break
            assert done.returncode == 0, f"{done.stdout}{done.stderr}"
            found = json.loads(done.stdout)["arms"]["left"]
            assert len(found["parameters"]) == 12
            for value, offset in zip(found["joint_zero_offsets_rad"], ZEROS_RAD, strict=True):
                assert abs(value - offset) < 0.2e-3, found["parameters"]
            assert all(abs(row["value"]) < 0.2e-3 for row in found["parameters"][7:]), "the hand is as described"

    strict = f'[model]\ncalibration = "{own_file}"\nposition_tolerance_m = 0.002\nangle_tolerance_rad = 0.006\n'
    system.config.write_text(f"{system.config.read_text()}{strict}")
    checked = ta2(system, "config", "--check", str(system.config))
    assert checked.returncode == 0 and f"corrected by {own_file}" in checked.stdout, checked.stderr
    system.daemon.end()
    system.daemon = system.start_daemon()
    with system.connect("corrected") as robot:
        wait_for(lambda: set(verdicts(robot).values()) == {"agrees"}, "agreement again", WITHIN_S, lambda: told(robot))
        left = robot.state.left_arm.model
        assert left is not None and left.position_m is not None and left.position_m < 0.001, left
        system.control.ask("clear")
        wait_for(
            lambda: verdicts(robot)["left"] == "differs", "what the correction is of", WITHIN_S, lambda: told(robot)
        )


@pytest.mark.sim_only("a file is the matter")
def test_a_daemon_does_not_start_with_another_robots_calibration(tmp_path: Path, systems: Systems) -> None:
    """It ends with the reason and the remedy before anything is opened."""
    system = systems(tmp_path, has_guard=IS_THOROUGH)
    with system.connect("first") as robot:
        wait_for(lambda: set(verdicts(robot).values()) == {"agrees"}, "agreement", WITHIN_S, lambda: told(robot))
    system.daemon.end()
    other = tmp_path / "other.json"
    arm = ArmCalibration(
        side=Side.LEFT,
        correction=ArmCorrection(offsets_rad=ZEROS_RAD),
        description=nominal().source,
        numbers=fingerprint(nominal(), Side.LEFT),
        note="",
    )
    write_arms(other, RobotIdentity(serial="TA2-0001", model="standard"), [arm])
    with system.config.open("a") as file:
        file.write(f'[robot]\nserial = "{SERIAL}"\n[model]\ncalibration = "{other}"\n')
    system.daemon = system.start_daemon()
    assert system.daemon.wait() == 2
    assert "FOREIGN_CALIBRATION: " in system.daemon.text() and "TA2-0001" in system.daemon.text()
