"""BEHAVIOUR, gripper: no torque before the owner's first command, and a grip that is kept through everything that holds."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from gateway.core.messages.outputs import FrameKind
from gateway.errors import Code
from gateway.messages.requests import Acquire, Disable, Enable, Estop, Move, Release, SetGripper, Stop, Take
from gateway.robot.topics import FSM_ENABLE, ee_pose, gripper_command, gripper_state, joint_command, pose_command
from gateway.sim.robot.settings import SimSettings
from gateway.values import Side
from tests.behaviour.scene import HOME, LEAN, QUICK, Scene, scene
from tests.pair import MS, S

GRIP = gripper_command(Side.LEFT)
LEFT = Side.LEFT


def grip(pair: Scene, raw: float = 0.8, side: Side = LEFT, **how: object) -> SetGripper:
    """A force input, asked for by ann."""
    return SetGripper(**{"epoch": pair.epoch, "side": side, "raw": raw, **how})


def gripping(state: str = "at rest", **options: object) -> Scene:
    """A robot whose left gripper holds something, marked. PAUSED and what else is held is reached from there."""
    sim = SimSettings(state_period_ns=10 * MS, left_object_rad=0.4)
    pair = scene("at rest", Scene(sim, **options))
    pair.topics = (*LEAN, *map(gripper_state, Side))
    pair.granted(grip(pair), "ann")
    pair.run(1.0)
    if state == "HOLDING":
        pair.granted(Stop(), "ann")
    elif state == "PAUSED":
        pair.robot.inject({"fault": "pause"}, pair.now_ns)
        pair.run_until(lambda: pair.state == "PAUSED")
    elif state == "ACTIVE":
        pair.granted(Move(epoch=pair.epoch, targets_rad=HOME), "ann")
    pair.run(0.3)
    pair.mark()
    return pair


def inputs(pair: Scene) -> set[float]:
    """What the left gripper was sent since the mark."""
    return {value for (value,) in pair.values(GRIP)}


def test_no_torque_is_sent_before_the_first_setpoint_and_until_the_first_command() -> None:
    """0.10 in the tick of the first setpoint, before it: the robot may still hold an older input (manual §4.4)."""
    pair = scene("IDLE")
    for gripper in pair.robot.grippers.values():
        gripper.command(1.0, pair.now_ns)  # what somebody sent before us
    pair.granted(Enable(epoch=pair.epoch), "ann")
    pair.run_until(lambda: pair.state == "ACTIVE")
    pair.run(0.5)
    topics = [frame.topic for at_ns, frame in pair.frames if at_ns >= pair.mark_ns]
    for side in Side:
        assert topics.index(gripper_command(side)) < topics.index(joint_command(side))
        assert {value for (value,) in pair.values(gripper_command(side))} == {0.1}
        assert pair.robot.grippers[side].effort_nm == 0.0 and pair.gap_ms(gripper_command(side)) <= 1000
    first_grip = next(at_ns for at_ns, frame in pair.sent_on(GRIP, pair.mark_ns))
    first_one = next(at_ns for at_ns, frame in pair.sent_on(FSM_ENABLE, pair.mark_ns) if frame.values == (1.0,))
    assert first_one - first_grip >= 30 * MS


def test_a_command_is_at_the_robot_within_20_ms_and_goes_on_at_50_hz() -> None:
    """On its own grid, beside the arm's (DESIGN §6)."""
    pair = scene("at rest")
    pair.granted(grip(pair, 0.55), "ann")
    pair.run(0.02)
    assert pair.robot.grippers[LEFT].effort_nm == pytest.approx(-0.8)
    pair.mark()
    pair.run(1.0)
    assert inputs(pair) == {0.55} and 49 <= len(pair.values(GRIP)) <= 51 and pair.gap_ms(GRIP) <= 21


@pytest.mark.parametrize("state", ["at rest", "ACTIVE", "HOLDING", "PAUSED"])
def test_the_value_is_kept_while_the_robot_is_held(state: str) -> None:
    """Constant, without a gap; in HOLDING the robot never cancels the torque."""
    pair = gripping(state)
    pair.run(2.0)
    assert inputs(pair) == {0.8} and pair.gap_ms(GRIP) <= 21
    if state != "PAUSED":  # the robot's own PAUSE decides about its torque there
        assert pair.robot.grippers[LEFT].effort_nm < -1.0
    assert pair.robot.journal.counts.get("GRIPPER_WATCHDOG", 0) == 0


def _take(pair: Scene) -> None:
    pair.granted(Take(name="bob", pid=2, reason="test"), "bob")
    pair.alive.add("bob")


def _lost_and_found(pair: Scene) -> None:
    pair.kill("ann")
    pair.run(1.5)
    pair.alive.add("bob")
    pair.granted(Acquire(name="bob", pid=2), "bob")


def _stall(pair: Scene) -> None:
    pair.is_deaf = True
    pair.run(0.4)
    pair.is_deaf = False
    pair.run_until(lambda: pair.state == "HOLDING")


def _walk(pair: Scene) -> None:
    pair.granted(Stop(), "ann")
    pair.run(1.0)
    pair.push(LEFT, 0.45)
    pair.robot.clear("blocked")
    pair.run(0.04)
    pair.granted(Enable(epoch=pair.epoch), "ann")


def _pause_and_enable(pair: Scene) -> None:
    pair.robot.inject({"fault": "pause", "duration_s": 0.3}, pair.now_ns)
    pair.run_until(lambda: pair.state == "PAUSED")
    pair.run_until(lambda: pair.ask(Enable(epoch=pair.epoch), "ann").refusal is None, 5.0)
    pair.run_until(lambda: pair.state == "ACTIVE")


KEEPS: dict[str, Callable[[Scene], None]] = {
    "owner's stop": lambda pair: pair.granted(Stop(), "ann") and None,
    "other's stop": lambda pair: pair.granted(Stop(), "bob") and None,
    "take": _take,
    "client lost, another acquires": _lost_and_found,
    "short stall": _stall,
    "walk": _walk,
    "pause, then enable": _pause_and_enable,
}


@pytest.mark.parametrize("what", KEEPS)
def test_the_grip_is_kept_through(what: str) -> None:
    """Whatever ends in HOLDING, or goes on from a live stream, keeps the value (BEHAVIOUR, gripper)."""
    pair = gripping(loss=QUICK)
    KEEPS[what](pair)
    pair.run(1.0)
    assert inputs(pair) == {0.8} and Code.GATE_VIOLATION not in pair.engine.latches
    assert pair.robot.grippers[LEFT].level_01 == 0.8
    if what not in {"pause, then enable"}:
        assert pair.robot.grippers[LEFT].effort_nm < -1.0


def test_in_a_stall_at_rest_the_grip_goes_on_with_the_hold_frames() -> None:
    """For at most 0.8 s, as they do; then both are silent."""
    pair = gripping("HOLDING")
    pair.is_deaf = True
    pair.run(0.85)
    assert inputs(pair) == {0.8} and pair.robot.grippers[LEFT].effort_nm < -1.0
    pair.run(1.0)
    last_ns = pair.sent_on(GRIP)[-1][0]
    assert abs(last_ns - pair.sent_on(joint_command(LEFT))[-1][0]) <= 20 * MS and GRIP not in pair.engine.running_topics


@pytest.mark.parametrize(
    "end",
    [
        lambda pair: pair.granted(Disable(epoch=pair.epoch), "ann"),
        lambda pair: pair.granted(Release(epoch=pair.epoch), "ann"),
        lambda pair: pair.granted(Estop(), "ann"),
    ],
    ids=["disable", "release", "estop"],
)
def test_it_ends_with_the_arms_stream_and_begins_without_torque(end: Callable[[Scene], object]) -> None:
    """Nothing opens the gripper; after a new start it is 0.10 again."""
    pair = gripping()
    end(pair)
    pair.run_until(lambda: pair.state in {"IDLE", "READ_ONLY"}, 5.0)
    assert inputs(pair) <= {0.8} and GRIP not in pair.engine.running_topics
    if pair.owner != "ann":
        pair.epoch = pair.own("ann")
    if pair.engine.latches:
        return
    pair.run(0.5)
    pair.mark()
    pair.granted(Enable(epoch=pair.epoch), "ann")
    pair.run_until(lambda: pair.state == "ACTIVE")
    assert inputs(pair) == {0.1}


def test_a_command_without_its_arm_is_refused_with_the_reason() -> None:
    """Not enabled, paused, or the one arm disabled: the robot would give no torque (manual §4.4)."""
    pair = scene("IDLE")
    assert pair.refused(grip(pair), "ann").code is Code.NOT_ENABLED
    pair = gripping("PAUSED")
    assert pair.refused(grip(pair), "ann").code is Code.ROBOT_PAUSED
    pair = scene("at rest")
    pair.disable_arm(LEFT)
    pair.run(0.1)
    refusal = pair.refused(grip(pair), "ann")
    assert refusal.code is Code.NOT_ENABLED and refusal.field == "left_gripper"
    pair.granted(grip(pair, side=Side.RIGHT), "ann")
    for raw in (1.2, -0.1):
        assert pair.refused(grip(pair, raw, Side.RIGHT), "ann").code is Code.OUT_OF_RANGE


def test_a_command_of_before_a_stop_changes_nothing() -> None:
    """It arrived in time, but had not left: the value of before stays (DESIGN §8.5)."""
    pair = gripping()
    pair.step()
    pair.tell(grip(pair, 0.0), "ann")
    pair.now_ns += 1
    pair.tell(Stop(), "ann")
    pair.run(0.5)
    assert inputs(pair) == {0.8}
    pair.run(0.013)
    pair.granted(grip(pair, 0.3), "ann")
    if pair.values(GRIP)[-1] == (0.8,):  # not due in that tick: the stop takes it back
        pair.tell(Stop(), "bob")
        pair.run(0.2)
        assert inputs(pair) == {0.8}


def test_whether_something_is_held_is_estimated_and_shown() -> None:
    """Told to close, standing still short of closed for 0.3 s; an empty gripper closes, and an open one holds nothing."""
    pair = gripping(snapshot_hz=50)
    assert pair.see().grips["left"].holding is True
    pair.granted(grip(pair, 0.0), "ann")
    pair.run(0.5)
    assert pair.see().grips["left"].holding is False
    pair.granted(grip(pair, 0.8, Side.RIGHT), "ann")
    pair.run(2.0)
    seen = pair.see().grips["right"]
    assert (seen.holding, seen.input_ratio, round(seen.torque_nm or 0.0, 2)) == (False, 0.8, -1.24)
    pair.granted(Disable(epoch=pair.epoch), "ann")
    pair.run_until(lambda: pair.state == "IDLE", 5.0)
    assert pair.see().grips["left"].holding is None


def test_frames_of_grippers_are_holds_but_for_the_owners() -> None:
    """One MOTION frame per command, with the owner's epoch; an echo at the start; the rest repeats."""
    pair = gripping()
    pair.granted(grip(pair, 0.3), "ann")
    pair.run(0.5)
    kinds = [frame.kind for _, frame in pair.sent_on(GRIP)]
    assert kinds[0] is FrameKind.ECHO and kinds.count(FrameKind.ECHO) == 1 and kinds.count(FrameKind.MOTION) == 2
    assert {frame.epoch for _, frame in pair.sent_on(GRIP) if frame.kind is FrameKind.MOTION} == {pair.epoch}


def test_a_restart_of_the_stream_within_a_second_is_a_new_start() -> None:
    """Only a short stall keeps the value: an arm that was let go and joins again begins without torque."""
    pair = gripping()
    pair.disable_arm(LEFT)
    pair.run(0.3)
    assert pair.state == "HOLDING" and GRIP not in pair.engine.running_topics
    pair.robot.clear("arm_disabled")
    pair.tell_mode(arm_enabled=dict.fromkeys(Side, True))
    pair.run(0.5)
    pair.mark()
    pair.granted(Enable(epoch=pair.epoch), "ann")
    pair.run(1 * 0.5)
    assert inputs(pair) == {0.1} and pair.now_ns - pair.mark_ns < 1 * S


def test_a_gripper_goes_with_an_arm_in_end_effector_mode_as_well() -> None:
    """What carries the torque is the arm's stream, whatever it is made of (manual §4.4, §6.3)."""
    pair = scene("IDLE", Scene(SimSettings(state_period_ns=10 * MS, left_mode="pose")))
    pair.topics = (*LEAN, *map(gripper_state, Side), *map(ee_pose, Side))
    pair.run(0.5)
    pair.granted(Enable(epoch=pair.epoch), "ann")
    pair.run_until(lambda: pair.state == "ACTIVE")
    assert pose_command(LEFT) in pair.engine.running_topics
    pair.granted(grip(pair), "ann")
    pair.run(0.1)
    assert pair.robot.grippers[LEFT].effort_nm < -1.0
    pair.granted(Stop(), "ann")
    pair.mark()
    pair.run(2.0)
    assert inputs(pair) == {0.8} and pair.robot.grippers[LEFT].effort_nm < -1.0
    assert pair.robot.journal.counts.get("GRIPPER_WATCHDOG", 0) == 0
