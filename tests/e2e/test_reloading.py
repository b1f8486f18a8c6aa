"""The settings file is changed under a running gateway, which is told by SIGHUP; what reads the file is lost in mid-motion."""

from __future__ import annotations

import contextlib
import json
import signal
from collections.abc import Callable
from pathlib import Path

import pytest

from gateway.client import Control, connect
from gateway.errors import GatewayError
from tests.e2e.system import STALLED, System, wait_for
from tests.e2e.test_threads import Ending

pytestmark = [pytest.mark.e2e, pytest.mark.sim_only("a file is read anew, whatever the robot is")]

ENDED = (*STALLED, "LEASE_LOST", "STREAM_ENDED", "NO_LINK")
"""How a motion rightly ends on a machine that stood still for a moment."""


def test_a_limit_is_lowered_in_mid_motion_and_a_broken_file_changes_nothing(
    tmp_path: Path, systems: Callable[..., System], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The motion goes on to its goal, the next velocity is judged by the new bound; the audit log has all of it."""
    ending = Ending(tmp_path, monkeypatch)
    audit = tmp_path / "audit"
    system = systems(tmp_path, config=f'[local]\naudit_log = "{audit}"\n', has_guard=False)
    robot, begun = system.connect(), system.config.read_text()

    def read_anew(text: str) -> str:
        """Have a file read; return why it was refused."""
        before = robot.state.view.settings_read_ns
        system.config.write_text(begun + text)
        system.daemon.send(signal.SIGHUP)
        wait_for(lambda: robot.state.view.settings_read_ns > before, "a reading", tell=system.logs)
        return str(robot.state.view.settings_refused)

    def told_of_chassis() -> float:
        with connect(system.target, name="asker", timeout_s=5.0) as asker:
            return float(asker.info.chassis_v_mps)

    def driven() -> str:
        """Drive at a velocity that was allowed at the start; return with what code that is refused."""
        try:
            with robot.control() as next_one:
                next_one.chassis.set_velocity(0.2, 0.0, 0.0)
        except GatewayError as error:
            return error.code.value
        return "driven"

    assert told_of_chassis() == 0.3
    own = robot.control(on_loss="hold").acquire()
    wait_for(lambda: is_enabled(own), "an enabled robot", tell=system.logs)
    motion = own.move_by({"left": [0.6, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]}, speed=0.2)
    wait_for(
        lambda: motion.done or any(abs(v) > 0.1 for v in robot.state.view.arms["left"].dq_ref_radps), "motion at speed"
    )
    assert read_anew("[arm]\nv_radps = 0.1\n[chassis]\nv_mps = 0.1\n") == ""
    ending.end(system.daemon.pid, "settings")
    wait_for(lambda: "the thread settings ended unasked" in robot.state.view.settings_refused, "word of the thread")
    wait_for(lambda: motion.done, "the end of the motion", tell=system.logs)
    (view,) = robot.state.view.motions
    assert view.state == "reached" or view.code in ENDED, view
    arm = system.stats()["arms"]["left"]
    assert not arm["clips"] and max(arm["commanded"]["peak_radps"]) < 0.25, arm
    with contextlib.suppress(GatewayError):  # it may have lost the robot
        own.release()
    refused = wait_for(lambda: (code := driven()) not in (*ENDED, "LEASE_HELD") and code, "an answer", tell=system.logs)
    assert refused == "OUT_OF_RANGE" and told_of_chassis() == 0.1
    assert "is not TOML" in read_anew("[arm")
    assert "needs a restart: arm.rate_hz;" in read_anew("[arm]\nrate_hz = 90.0\n[chassis]\nv_mps = 0.25\n")
    assert told_of_chassis() == 0.1 and system.daemon.is_running
    lines = [json.loads(line) for line in audit.read_text().splitlines()]
    answers = [line["answer"] for line in lines if line["request"] == "Reload"]
    assert answers == ["ok", *["SETTINGS_REFUSED"] * 3] and "GATEWAY_BROKEN" not in system.daemon.text()


def is_enabled(own: Control) -> bool:
    """Enable; a busy machine may have let the robot's state grow old just now."""
    try:
        own.enable(timeout=15.0)
    except GatewayError as error:
        if error.code.value in STALLED:
            return False
        raise
    return True
