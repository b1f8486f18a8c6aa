"""BEHAVIOUR, Losing: clocks that jump, a host that sleeps, ticks that come late."""

from __future__ import annotations

from itertools import pairwise

import pytest

from gateway import robot
from gateway.core.events import (
    Enable,
    Estop,
    FrameKind,
    Move,
    Suspended,
)
from gateway.errors import Code
from gateway.values import Side
from tests.behaviour.scene import HOME, scene
from tests.pair import MS, S

# --------------------------------------------------------------------------------------------------- time and host


@pytest.mark.parametrize("step_s", [3600.0, -3600.0])
@pytest.mark.parametrize("state", ["ACTIVE", "HOLDING"])
def test_a_jump_of_the_robots_clock_changes_nothing(step_s: float, state: str) -> None:
    """Ages are monotonic; stamps are compared with each other only."""
    pair = scene(state)
    pair.robot.inject({"fault": "clock_step", "step_s": step_s}, pair.now_ns)
    pair.run(0.5)
    assert pair.state == state and all(pair.gap_ms(robot.joint_command(side)) <= 11 for side in Side)
    pair.granted(Move(epoch=pair.epoch, targets_rad=HOME), "ann")


def test_enabling_works_after_a_jump_of_the_robots_clock() -> None:
    """The least lag of before the jump says nothing about the samples after it."""
    for step_s in (3600.0, -3600.0):
        pair = scene("IDLE")
        pair.robot.inject({"fault": "clock_step", "step_s": step_s}, pair.now_ns)
        pair.granted(Enable(epoch=pair.epoch), "ann")
        pair.run_until(lambda pair=pair: pair.state == "ACTIVE", 10.0)


@pytest.mark.parametrize("state", ["IDLE", "ENABLING", "ACTIVE", "HOLDING", "PAUSED", "STOPPING", "STALE"])
def test_a_suspend_frees_the_lease_and_takes_everything_down(state: str) -> None:
    """Nothing of what was held is held any more; nobody owns the robot; it is told."""
    pair = scene(state)
    pair.receive(Suspended(slept_ns=30 * S, at_ns=pair.now_ns))
    pair.run(0.5)
    assert pair.owner is None and pair.arm_frames() == [] and 1.0 not in pair.beats and pair.told(Code.SUSPENDED)
    assert state in {"IDLE", "STALE"} or pair.beats[0] == 0.0


def test_a_suspend_that_finds_only_old_state_holds_nothing_either() -> None:
    """After a sleep the newest state is old: STALE, but nothing is held there and nothing resumes."""
    pair = scene("HOLDING")
    pair.now_ns += 2 * S
    pair.receive(Suspended(slept_ns=2 * S, at_ns=pair.now_ns))
    pair.mark()
    pair.is_deaf = True
    pair.run(0.3)
    assert pair.state == "STALE" and pair.arm_frames() == [] and 1.0 not in pair.beats
    pair.is_deaf = False
    pair.run(1.0)
    assert pair.state == "READ_ONLY" and pair.arm_frames() == [] and 1.0 not in pair.beats


def test_what_was_heard_before_a_sleep_is_not_believed_after_it() -> None:
    """CLOCK_MONOTONIC stood still meanwhile, so ages say nothing: nothing is enabled before everything is heard anew."""
    pair = scene("IDLE")
    pair.receive(Suspended(slept_ns=3600 * S, at_ns=pair.now_ns))
    epoch = pair.own("bob")
    refusal = pair.refused(Enable(epoch=epoch), "bob")
    assert refusal.code in {Code.STATE_STALE, Code.MODE_UNKNOWN, Code.FSM_UNKNOWN}
    pair.run(1.1)
    pair.granted(Enable(epoch=epoch), "bob")


@pytest.mark.parametrize(("late_ms", "is_skipped"), [(20, False), (50, False), (51, True), (120, True)])
def test_a_tick_that_is_more_than_50_ms_late_is_skipped_and_told(late_ms: int, is_skipped: bool) -> None:
    """Never caught up: the next tick goes on by one period's step."""
    pair = scene("ACTIVE")
    pair.late_ns = late_ms * MS
    output = pair.step(pair.now_ns + late_ms * MS)
    assert bool(output.frames) is not is_skipped and bool(pair.told(Code.TICK_LATE)) is is_skipped
    pair.run(0.2)
    values = [frame.values for _, frame in pair.sent_on(robot.joint_command(Side.LEFT))]
    assert max(abs(b - a) for x, y in pairwise(values) for a, b in zip(x, y, strict=True)) <= 0.01 + 1e-6
    assert pair.state == "ACTIVE"


def test_after_a_gap_in_which_the_robot_stopped_the_arms_the_motion_is_over() -> None:
    """More than 0.15 s without a setpoint: zero-velocity protection (manual §4.3); one at speed must not follow it."""
    pair = scene("ACTIVE")
    pair.late_ns = 200 * MS
    pair.step(pair.now_ns + 200 * MS)
    assert pair.state == "HOLDING" and "200 ms late" in pair.told(Code.MOTION_ENDED)[-1]
    at_ns = pair.now_ns
    pair.run(0.5)
    assert FrameKind.MOTION not in pair.kinds_since(at_ns) and pair.state == "HOLDING"


def test_a_late_tick_still_sends_stop_frames() -> None:
    """0.0, chassis zeros and lift leave whatever the time is."""
    pair = scene("ACTIVE")
    pair.tell(Estop(), "bob")
    pair.late_ns = 400 * MS
    output = pair.step(pair.now_ns + 400 * MS)
    assert {frame.topic for frame in output.frames} == {robot.FSM_ENABLE, robot.CHASSIS_VELOCITY}
