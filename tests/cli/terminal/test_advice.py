"""Tests of what a person is told to do next."""

from __future__ import annotations

import pytest
from msgspec.structs import replace

from gateway.cli.terminal.advice import next_steps
from gateway.messages.snapshot import EnableView, LinkView
from tests.api.stand_in import a_snapshot
from tests.cli.views import INFO, MS, S, a_view, all_topics, owned

MODE = a_snapshot().mode


def told(**changes):
    """Return the steps for a snapshot as (level, text)."""
    return [(step.level, step.text) for step in next_steps(a_view(**changes), INFO)]


def test_a_robot_at_rest_has_one_step():
    """Nothing is wrong: who may do what, and nothing else."""
    ((level, text),) = told()
    assert level == "info" and "nobody owns" in text and "`ta2 home`" in text


@pytest.mark.parametrize(
    ("changes", "level", "words"),
    [
        ({"latches": {"ESTOP": "by hand"}}, "error", ["ESTOP", "by hand", "`ta2 recover`"]),
        ({"latches": {"LATER_CODE": "of a later release"}}, "error", ["LATER_CODE", "`ta2 recover`"]),
        (
            {"link": LinkView(up=False, router_zid="", fresh=False, age_ns=None), "state": "OFFLINE"},
            "error",
            ["no link", INFO.robot, "power"],
        ),
        ({"link": LinkView(up=True, router_zid="a", fresh=False, age_ns=None)}, "error", ["not come yet"]),
        ({"link": LinkView(up=True, router_zid="a", fresh=False, age_ns=4 * S)}, "error", ["4.0 s old", "100 ms"]),
        ({"fsm": -1}, "error", ["ERROR", "`ta2 recover`"]),
        ({"fsm": None}, "warning", ["FSM is unknown"]),
        ({"fsm": 2}, "warning", ["READY (2)", "not by us"]),
        ({"fsm": 5, "state": "IDLE"}, "warning", ["PLAY_READY"]),
        ({"mode": None}, "warning", ["mode is unknown"]),
        ({"mode": replace(MODE, api=False)}, "warning", ["VR mode", "§2.3"]),
        ({"mode": replace(MODE, arm_enabled={"left": False, "right": True})}, "warning", ["left arm is disabled"]),
        ({"mode": replace(MODE, joint_mode={"left": True, "right": False})}, "warning", ["right arm is in end-eff"]),
        (
            {"enable": EnableView(attempt=1, outcome="failed", code="ENABLE_TIMEOUT", message="no READY")},
            "warning",
            ["ENABLE_TIMEOUT", "no READY"],
        ),
        (
            {"state": "HOLDING", "fsm": 2, "lease": owned(lost_ns=S, free_in_ns=9 * S, down_in_ns=59 * S)},
            "warning",
            ["policy-a", "silent for 1.0 s", "free in 9.0 s", "59.0 s"],
        ),
        (
            {"state": "HOLDING", "fsm": 2, "lease": replace(a_snapshot().lease, down_in_ns=30 * S)},
            "warning",
            ["for nobody", "30.0 s"],
        ),
    ],
)
def test_what_stands_in_the_way_is_told_with_its_remedy(changes, level, words):
    """Each condition has one step of its level, with the figures that matter."""
    fitting = [text for found, text in told(**changes) if found == level and all(word in text for word in words)]
    assert len(fitting) == 1, told(**changes)


def test_errors_come_before_warnings_and_the_state_comes_last():
    """A person who reads one line reads the worst."""
    steps = told(latches={"ESTOP": "x"}, mode=None, fsm=-1)
    assert [level for level, _ in steps] == ["error", "error", "warning", "info"]
    assert steps[-1][1] == "only looking is possible"


def test_silent_and_repeated_topics_are_named():
    """One topic without news, one never heard, one delivered twice; nothing of it while the whole link is old."""
    topics = all_topics()
    topics["/left_gripper/joint_states"] = replace(topics["/fsm_state"], age_ns=2 * S)
    topics["/right_gripper/joint_states"] = replace(topics["/fsm_state"], age_ns=None)
    topics["/chassis/joint_states"] = replace(topics["/fsm_state"], duplicates=9)
    texts = [text for _, text in told(topics=topics)]
    assert any("/left_gripper/joint_states (2.0 s), /right_gripper/joint_states (never)" in text for text in texts)
    assert any("more than once: /chassis/joint_states" in text and "bridge" in text for text in texts)
    stale = told(topics=topics, link=LinkView(up=True, router_zid="a", fresh=False, age_ns=200 * MS))
    assert not any("gripper" in text for _, text in stale)


@pytest.mark.parametrize(
    ("state", "fsm", "owner", "words"),
    [
        ("IDLE", 0, True, "has not enabled"),
        ("ENABLING", 1, True, "READY"),
        ("ACTIVE", 2, True, "commands the arms"),
        ("HOLDING", 2, True, "may go on"),
        ("HOLDING", 2, False, "held for nobody"),
        ("PAUSED", 0, True, "policy-a"),
        ("PAUSED", 0, False, "own and enable"),
        ("STOPPING", 2, True, "coming to rest"),
        ("STALE", 0, True, "fresh state"),
        ("OFFLINE", 0, False, "waiting for the robot"),
        ("LATER", 0, False, "LATER"),
    ],
)
def test_every_state_says_what_it_means(state, fsm, owner, words):
    """The last step is about the state, also about one of a later release."""
    changes = {"lease": owned()} if owner else {}
    assert words in told(state=state, shown=state, fsm=fsm, **changes)[-1][1]


def test_the_clocks_of_the_lease_are_marked():
    """A view that shows them itself can leave these steps out."""
    view = a_view(state="HOLDING", fsm=2, lease=owned(lost_ns=S, free_in_ns=9 * S, down_in_ns=59 * S))
    assert [step.subject for step in next_steps(view, INFO)] == ["lease", ""]
