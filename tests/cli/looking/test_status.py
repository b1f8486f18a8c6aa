"""Tests of `ta2 status`."""

from __future__ import annotations

import pytest
from msgspec.structs import replace

from gateway.cli.looking.status import lines
from gateway.messages.snapshot import GuardView, MotionView, StreamView
from tests.api.stand_in import START_Q, a_snapshot
from tests.cli.views import INFO, MS, S, a_view, owned


def text_of(**changes):
    """Return the screen as a person reads it."""
    return "\n".join(line.plain for line in lines(INFO, a_view(**changes)))


def test_status_is_one_screen_with_everything_a_person_asks_first(shell):
    """Gateway, robot, state, FSM, modes, owner, arms, streams, and what to do next; within 24 lines."""
    ended = shell.run("status")
    assert ended.status == 0 and not ended.err and ended.out.count("\n") <= 24
    for fact in ("pid 4711", "tcp/127.0.0.1:9000 (standard)", "READ_ONLY", "PAUSE (0)", "API, left arm joint mode"):
        assert fact in ended.out
    for fact in ("owner      nobody", "+0.100 +0.500 -0.300", "right no state yet", "fsm/enable 20.0 Hz, gap 51 ms"):
        assert fact in ended.out
    assert "`ta2 home`" in ended.out and shell.names == ["ta2 status"]


def test_status_as_json_has_the_whole_snapshot(shell):
    """Scripts get health, facts, snapshot and the next steps."""
    document = shell.run("status", "--json").json
    assert document["ok"] is True and document["health"]["fsm"] == "PAUSE"
    assert document["snapshot"]["arms"]["left"]["measured"]["q_rad"] == list(START_Q)
    assert document["info"]["model"] == "standard" and document["next"][-1]["level"] == "info"


def test_what_moves_is_told():
    """Owner and time, setpoints beside measured joints, running streams, the latest motions with progress."""
    snapshot = a_snapshot()
    arm = replace(snapshot.arms["left"], streaming=True, q_ref_rad=START_Q, tracking_rad=0.004)
    motion = MotionView(
        motion_id=5,
        sides=("left", "right"),
        state="executing",
        progress=0.5,
        error_rad=0.2,
        duration_ns=S,
        code="",
        message="",
        space="joint",
        error_m=None,
    )
    ended = replace(motion, motion_id=4, state="aborted", code="STOPPED", error_rad=None)
    text = text_of(
        state="ACTIVE",
        shown="ACTIVE",
        fsm=2,
        lease=owned(),
        arms={"left": arm, "right": replace(arm, measured=None)},
        streams={"/api/left_arm/joint_cmd": StreamView(running=True, sent=1, rate_hz=100.0, worst_gap_ns=11 * MS)},
        motions=(ended, motion),
    )
    assert "policy-a (pid 123) for 10.0 s, epoch 4, on loss: hold" in text
    assert "  setpoint +0.100" in text and "off by 0.004" in text and "right arm  no state yet" in text
    assert "left_arm/joint_cmd 100 Hz, gap 11 ms" in text
    assert "motion 4   left and right aborted: STOPPED\n" in text
    assert "motion 5   left and right executing 50%, 0.200 rad from the goal" in text


def test_what_is_wrong_is_told():
    """A latched state shows both names; a robot that is away is told as such; modes that are off are named."""
    text = text_of(shown="FAULT", latches={"TRACKING_ERROR": "far off"}, link=replace(a_snapshot().link, up=False))
    assert "FAULT (READ_ONLY)" in text and "!! TRACKING_ERROR: far off" in text and "no link" in text
    mode = replace(
        a_snapshot().mode,
        api=False,
        arm_enabled={"left": False, "right": True},
        joint_mode={"left": True, "right": False},
        chassis_enabled=False,
    )
    assert "VR, left arm disabled, right arm end-effector mode, chassis off, lift off" in text_of(mode=mode)
    assert "mode       unknown" in text_of(mode=None)


@pytest.mark.parametrize(
    ("guard", "said"),
    [
        ({}, "pid 43, watches"),
        ({"lost": 2}, "pid 43, watches, 2 lost before"),
        ({"linked": False}, "pid 43, does not reach the robot"),
        ({"pid": 0, "linked": False, "lost": 1}, "gone; another one is being started, 1 lost before"),
        ({"expected": False, "pid": 0, "linked": False}, "none (--no-guard)"),
        ({"earlier_holds": True}, "the guard of an earlier daemon holds the robot"),
    ],
)
def test_status_shows_the_guard(shell, guard, said):
    """Its pid and health, and what follows where there is none."""
    facts = {"expected": True, "pid": 43, "linked": True, "lost": 0, "earlier_holds": False}
    shell.world.engine.show(guard=GuardView(**(facts | guard)))
    assert said in shell.run("status").out


def test_the_body_model_is_told_for_each_arm():
    """Verdict and figures; coloured by the worse one; and that there is none."""
    arm = a_snapshot().arms["left"]
    states = {
        "left": arm,
        "right": replace(arm, model=replace(arm.model, state="differs", position_m=0.0071)),
    }
    assert "body model left agrees (0.20 mm, 1.00 mrad), right differs (7.10 mm, 1.00 mrad)" in text_of(arms=states)
    (row,) = [line for line in lines(INFO, a_view(arms=states)) if line.plain.startswith("body model")]
    assert row.spans[-1].style == "red"
    unknown = replace(arm, model=replace(arm.model, state="unknown", position_m=None, angle_rad=None, pairs=0))
    assert "body model left unknown, right unknown\n" in text_of(arms={"left": unknown, "right": unknown})
    none = replace(arm, model=None)
    assert "body model none (model.check = false)" in text_of(arms={"left": none, "right": none})
