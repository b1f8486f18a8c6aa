"""`ta2 view` as a process beside a robot that moves: it sees all of it, and changes nothing."""

from __future__ import annotations

import signal
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.cli.scene.rrd import read
from tests.e2e.system import Process, System, wait_for

pytestmark = [
    pytest.mark.thorough,
    pytest.mark.e2e,
    pytest.mark.sim_only("what is drawn is the matter, not how the body moves"),
]

MOVER = """
with robot.control() as own:
    own.enable(timeout=12.0)
    print("driving", flush=True)
    own.move_to({side: HOME[side] * 0.8 for side in HOME}, speed=0.5).result(timeout=60.0)
    own.move_to(HOME, speed=0.5).result(timeout=60.0)
    print("done", flush=True)
"""


def test_a_view_of_a_motion_holds_joints_hands_and_body(tmp_path: Path, systems: Callable[..., System]) -> None:
    """While a client moves the arms; ended by a signal, the file is whole."""
    system = systems(tmp_path, has_guard=False)
    file = tmp_path / "a.rrd"
    with system.connect("watcher") as watcher:
        words = ["-m", "gateway.cli", "view", "--socket", system.target, "--save", str(file)]
        view = Process("view", words, tmp_path)
        system.clients.append(view)
        wait_for(lambda: "showing" in view.text(), "a view", 60.0, tell=view.text)
        mover = system.client("mover", MOVER)
        wait_for(lambda: "done" in mover.text(), "a motion", 60.0, tell=mover.text)
        measured = {side: watcher.state.arm(side).q for side in ("left", "right")}
    view.send(signal.SIGINT)
    assert view.wait(60.0) == 0, view.text()
    found = read(file)
    for side, q_rad in measured.items():
        rows = found[f"joints/{side}/measured"]["scalars"]
        assert len(rows) > 10 and max(row[3] for row in rows) - min(row[3] for row in rows) > 0.05
        assert rows[-1] == pytest.approx(q_rad, abs=0.1)
        assert found[f"joints/{side}/setpoint"]["scalars"]
        mount = f"virtual_base/{side}_base_virtual"
        assert len(found[f"{mount}/{side}_shoulder_base/measured"]["translation"]) > 10
        assert len(found[f"{mount}/{side}_ee"]["translation"]) > 10
    assert len(found["virtual_base/chest/body"]["translations"]) > 10
    assert any("LEASE_CHANGED" in text for (text,) in found["events"]["text"])
