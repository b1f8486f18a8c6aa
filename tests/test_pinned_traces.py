"""Traces that once broke an invariant, shrunk, and a trace that must: they cost a second and leave nothing to luck."""

from __future__ import annotations

from typing import Any

import pytest

from gateway.values import Side
from tests.test_invariants import Trace, lean_pair, run_trace

BOTH = tuple(Side)
NONE = [0.0] * 7

BRAKED_ON_A_LINE = [(False, ("move", "ann", [*BOTH], NONE, 0.1), 0.0, [(("stream", "ann", Side.LEFT, NONE, 8), 0.0)])]
"""Three axes accelerate alike towards a target when the daemon is told to end: the stop overshot the speed limit."""


def test_an_end_effector_that_accelerates_along_all_axes_stays_below_its_speed_limit() -> None:
    """A stop may need what all three axes can do, even where they move along one line."""
    run_trace(BRAKED_ON_A_LINE, BOTH)


STOPPED_AFTER_AN_OUTAGE = [
    (
        False,
        ("lift", "ann", 0.3, 2),
        0.0,
        [
            (("drive", "ann", (0.3, 0.0, 0.0), 1), 0.0),
            (("link", "freeze", 1.2), 0.0),
            (("ask", "ann", "stop lift"), 0.0),
        ],
    ),
    (False, ("drive", "ann", (0.3, 0.0, 0.0), 1), 0.0, [(("ask", "ann", "stop chassis"), 0.0)]),
]
"""The link is back, [0,0] is being sent; a stop made [0,1] of it, and nothing else followed: the servo stayed on."""


@pytest.mark.parametrize("poses", [(), (Side.RIGHT,)])
def test_a_lift_that_is_stopped_after_an_outage_ends_with_its_servo_off(poses: tuple[Side, ...]) -> None:
    """[0,0] is the last word on it (§4.6)."""
    run_trace(STOPPED_AFTER_AN_OUTAGE, poses)


FAR = [1.0, 0.0, 0.0, 1.0, 1.0, 1.0, 1.0]
BEYOND_THE_IK = [
    (False, ("move", "ann", [*BOTH], NONE, 0.1), 0.0, [(("stream", "ann", Side.LEFT, NONE, 1), 0.6)]),
    (False, ("stream", "ann", Side.LEFT, NONE, 1), 0.0, [(("move", "ann", [*BOTH], FAR, 1.0), 0.6)]),
]
"""On its way to a pose in the reach the arm comes to poses that the robot's IK cannot solve."""


def test_a_grip_that_the_robots_ik_lets_go_is_nobodys_fault() -> None:
    """No pose is passed on to the motors (§4.10), and their stream keeps the torque (§4.4): the monitor knows that."""
    player = run_trace(BEYOND_THE_IK, BOTH)
    assert player.pair.robot.arms[Side.LEFT].unsolved > 0
    assert player.pair.robot.journal.counts["GRIPPER_WATCHDOG"] > 0


@pytest.mark.parametrize("poses", [(), BOTH])
def test_a_grip_that_is_lost_while_every_setpoint_is_solved_is_seen(
    poses: tuple[Side, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The monitor would tell: here the gripper hears nothing of its arm."""
    pair = lean_pair(poses)
    player = Trace(pair, poses)
    player.epoch["ann"] = pair.activate("ann")
    player.play(("grip", "ann", Side.LEFT, 0.6))
    pair.run(0.5)
    monkeypatch.setattr(pair.robot.grippers[Side.LEFT], "arm_commanded", lambda now_ns: None)
    with pytest.raises(AssertionError, match="the left gripper lost its torque in ACTIVE"):
        pair.run(0.2)


def test_the_monitor_sees_a_jump_of_an_end_effector(monkeypatch: pytest.MonkeyPatch) -> None:
    """The gate, or the monitor itself: a setpoint a centimetre away never passes unseen."""
    pair = lean_pair(BOTH)
    player: Any = Trace(pair, BOTH)
    player.epoch["ann"] = pair.activate("ann")
    stream = pair.engine._coordinator.body.arms[Side.LEFT]
    x, *rest = stream.values
    monkeypatch.setattr(stream.reference, "step", lambda: (x - 0.01, *rest))
    with pytest.raises(AssertionError, match=r"the gate had to refuse|\(1\)"):
        pair.run(0.1)


HELD_A_TICK_TOO_SHORT = [
    (
        True,
        ("move", "bob", [*BOTH], [0.66, 0.42, 0.32, 0.09, 0.0, 0.0, 0.0], 1.0),
        0.3,
        [(("link", "freeze", 0.3), 0.0), (("link", "freeze", 0.15), 0.03), (("link", "freeze", 0.15), 0.6)],
    )
]
"""The 0.8 s of a hold end one tick before HOLDING: the arms were seeded where they sagged to, 20 ms after the last setpoint."""


def test_a_hold_that_ends_just_before_holding_goes_on_without_a_jump() -> None:
    """The robot has noticed nothing, and the arms are under torque."""
    run_trace(HELD_A_TICK_TOO_SHORT)
