"""The state of the wire, end to end: a real daemon and a look without one, a stranger beside them, robots with a namespace."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest

from gateway.client import connect
from gateway.errors import NotReady
from gateway.robot.limits import HOME_Q_RAD
from gateway.robot.topics import joint_command
from gateway.values import Side
from tests.e2e.system import ROOT, System, wait_for
from tests.stranger import Stranger

pytestmark = [pytest.mark.e2e, pytest.mark.body_free("the wire is the matter")]

Systems = Callable[..., System]


def ta2_link(*words: str, status: int = 0) -> str:
    """Return what `ta2 link` prints; its status is judged."""
    done = subprocess.run(
        [sys.executable, "-m", "gateway.cli", "link", *words], cwd=ROOT, capture_output=True, text=True, timeout=60
    )
    assert done.returncode == status, f"{done.stdout}\n{done.stderr}"
    return done.stdout


def seen(*words: str, status: int = 0) -> dict[str, Any]:
    """Return the same as JSON."""
    return json.loads(ta2_link(*words, "--json", status=status))


def odd_rates(told: dict[str, Any]) -> dict[str, float]:
    """Return the topics whose rate is not about the robot's, and what part of it they have."""
    topics = [topic for topic in told["wire"]["topics"] if topic["is_state"]]
    parts = {topic["name"]: topic["rate_hz"] / topic["nominal_hz"] for topic in topics}
    return {name: part for name, part in parts.items() if not 0.5 < part < 1.5}


@pytest.mark.thorough
def test_the_page_of_a_gateway_and_that_of_a_look_tell_the_same_wire(tmp_path: Path, systems: Systems) -> None:
    """Each topic with its rate, the robot's versions, both gateways' sessions, and a stranger by id and address."""
    system = systems(tmp_path)
    with system.connect("link"), closing(Stranger(system.endpoint)) as stranger:
        at = ("--socket", system.target)
        wait_for(
            lambda: {"guard", "session"} <= {who["kind"] for who in seen(*at)["wire"]["neighbours"]},
            "the guard and the stranger in the list",
        )
        own = wait_for(
            lambda: (told := seen(*at))["ok"] and not odd_rates(told) and told, f"a good verdict ({ta2_link(*at)})"
        )
        odd: dict[str, float] = {}

        def looked() -> dict[str, Any] | None:
            """A topic of 1 Hz has three samples in a look: one that came late makes it a look at a late sample."""
            odd.clear()
            odd.update(odd_rates(told := seen("--robot", system.endpoint)))
            return None if odd else told

        look = wait_for(looked, "each topic at its rate", seconds=30.0, tell=lambda: f": {odd}")
        for told in (own, look):
            wire = told["wire"]
            assert {topic["route"] for topic in wire["topics"]} == {"active"} and wire["robots"] == [""]
            assert wire["bridges"][0]["version"].startswith("v1.") and wire["clock_ns"] is not None
            (beside,) = [who for who in wire["neighbours"] if who["zid"] == stranger.zid]
            assert beside["address"].startswith("tcp/127.0.0.1:") and beside["kind"] == "session"
        assert [who["kind"] for who in own["wire"]["neighbours"]] == ["self", "guard", "robot", "session"]
        assert sorted(who["kind"] for who in look["wire"]["neighbours"]) == [
            "gateway", "gateway", "robot", "self", "session",
        ]  # fmt: skip
        stranger.put(joint_command(Side.LEFT), [0.0] * 7)
        found = wait_for(
            lambda: [f for f in seen(*at)["findings"] if f["code"] == "FOREIGN_WRITER"], "the stranger's command"
        )
        assert "/api/left_arm/joint_cmd (1)" in found[0]["text"]
        assert "WHO IS THERE" in ta2_link(*at)


@pytest.mark.thorough
def test_a_robot_with_a_namespace_is_found_offered_and_driven(tmp_path: Path, systems: Systems) -> None:
    """Without the setting nothing moves and everything names it; with it the robot is like any other."""
    system = systems(tmp_path, sim_options=("--namespace", "bot1"))
    with wait_for(lambda: connect(system.target, name="offered", timeout_s=1.0), "a daemon") as robot:
        wait_for(lambda: "OTHER_NAMESPACE" in {finding.code for finding in robot.why().findings}, "the finding")
        with robot.control() as own, pytest.raises(NotReady, match="OTHER_NAMESPACE") as refused:
            own.enable(timeout=2.0)
        assert 'namespace = "bot1"' in refused.value.hint
    assert "OTHER_NAMESPACE" in {finding["code"] for finding in seen("--socket", system.target)["findings"]}
    look = seen("--robot", system.endpoint)
    assert look["wire"]["namespace"] == "bot1" and {t["route"] for t in look["wire"]["topics"]} == {"active"}

    system.daemon.end()
    system.config.write_text('[robot]\nnamespace = "/bot1"\n')
    system.daemon = system.start_daemon()
    with system.connect("named") as robot:
        with robot.control() as own:
            own.enable(timeout=15.0)
            own.move_to({"left": HOME_Q_RAD[Side.LEFT]}, speed=1.0).result(timeout=30.0)
        assert seen("--socket", system.target)["wire"]["namespace"] == "bot1"
