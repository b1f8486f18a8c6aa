"""Two robots on one zenoh router: found, moved and stopped from there; what happens there changes nothing here."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from gateway.client import connect
from gateway.errors import GatewayError
from tests.e2e.system import ATTEMPTS, ROOT, STALLED, Process, free_port, wait_for
from tests.fleet.fleets import router

pytestmark = [
    pytest.mark.e2e,
    pytest.mark.sim_only("a fleet is a matter of clients and daemons"),
    pytest.mark.timeout(500),
]

LONG_S = 60.0


def ta2(locator, *words):
    """Carry out a command of `ta2`; return its status and what it printed as JSON."""
    command = [sys.executable, "-m", "gateway.cli", "fleet", *words, "--fleet", locator, "--json"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=LONG_S, check=False)
    rows = json.loads(done.stdout or "{}").get("robots", [])
    return done.returncode, {row["name"]: row for row in rows}


def moved(robot, own):
    """Move a wrist a little and return the error; begun again where this machine stood still."""
    for attempt in range(ATTEMPTS):
        try:
            own.enable(timeout=30.0)
            goal = robot.state.left_arm.q.copy()
            goal[6] += 0.05
            return own.move_to({"left": goal}, speed=0.5).result(timeout=LONG_S).error
        except GatewayError as error:
            if error.code not in STALLED or attempt == ATTEMPTS - 1:
                raise


def test_a_fleet_is_found_moved_and_stopped_and_its_router_may_die(systems, tmp_path: Path, monkeypatch):
    """An owner in the fleet is lost with the router; one on the robot's host goes on; a frozen member keeps no other's stop."""
    locator = f"tcp/127.0.0.1:{free_port()}"
    monkeypatch.setitem(os.environ, "TA2_FLEET", locator)
    running, members, made = router(locator), [], []
    try:
        for name in ("robot-1", "robot-2"):
            (tmp_path / name).mkdir()
            made.append(systems(tmp_path / name, has_guard=False))
            words = ["fleet", "join", name, "--socket", made[-1].target, "--open-to-every-user-of-this-host"]
            members.append(Process("member", ["-m", "gateway.cli", *words], tmp_path / name))
        near = made[1].connect()
        made[0].connect().close()

        def both():
            status, found = ta2(locator, "list")
            return status == 0 and len(found) == 2 and all(row.get("linked") for row in found.values()) and found

        assert {row["gateways"] for row in wait_for(both, "both robots in the fleet", LONG_S).values()} == {1}
        far = wait_for(lambda: connect("robot-1", timeout_s=5.0), "the robot by its name", LONG_S)
        with far, near, far.control(on_exit="hold") as own, near.control() as here:
            own.enable(timeout=30.0)
            running.close()
            wait_for(lambda: not far.health().ok, "the end of the router", LONG_S)
            with connect(made[0].target) as beside:
                wait_for(lambda: beside.state.state != "ACTIVE", "a held robot", LONG_S)
            assert moved(near, here) < 0.1
            running = router(locator)
            wait_for(both, "both robots again", LONG_S)
            members[1].send(signal.SIGSTOP)
            status, stopped = ta2(locator, "stop", "robot-1", "robot-2", "robot-3", "--timeout", "3")
            assert status == 4 and [row["confirmed"] for row in stopped.values()] == [True, False, False]
            members[1].send(signal.SIGCONT)
            with connect(made[0].target) as beside:
                assert "STOPPED_BY_OTHER" in beside.state.latches

            def all_of_them():
                status, stopped = ta2(locator, "stop", "--all")
                return status == 0 and set(stopped) == {"robot-1", "robot-2"}

            wait_for(all_of_them, "both stopped", LONG_S)
            assert "STOPPED_BY_OTHER" in near.state.latches
    finally:
        for member in members:
            member.end()
        running.close()
