"""What the owner moves from point to point: lifecycle, settling, limits, speeds, ends and reasons."""

from __future__ import annotations

import math
from itertools import pairwise

import pytest

from gateway.core.body import body
from gateway.core.messages.outputs import FrameKind
from gateway.core.motion.motion import PlanFailed
from gateway.errors import Code
from gateway.messages.incoming import OnLimit
from gateway.messages.requests import Cancel, Move
from gateway.messages.snapshot import MotionView
from gateway.values import Side
from tests.behaviour.scene import HOME, away, watched
from tests.pair import MS

LEFT, RIGHT = Side.LEFT, Side.RIGHT


# --------------------------------------------------------------------------------------------------- point to point


def test_a_motion_is_queued_then_executed_with_progress_then_reached() -> None:
    """Each stage is seen; progress rises from 0 to 1; the end is told by the *measured* state."""
    pair = watched()
    motion = pair.move(pair.epoch, HOME, "ann")
    seen: list[MotionView] = []
    while not seen or seen[-1].state in {"queued", "executing"}:
        pair.step()
        seen.append(pair.motion_view(motion))
    states = [view.state for view in seen]
    assert states == sorted(states, key=["queued", "executing", "reached"].index) and states[-1] == "reached"
    executing = [view for view in seen if view.state == "executing"]
    progress = [view.progress for view in executing]
    assert progress == sorted(progress) and 0.0 < progress[0] < 0.1 and progress[-1] == 1.0
    assert executing[0].error_rad > 0.3 and seen[-1].error_rad < 0.05 and seen[-1].code == ""
    ended = [notice for notice in pair.notices if notice.code is Code.MOTION_ENDED]
    assert [notice.facts["state"] for notice in ended] == ["reached"]


def test_a_motion_settles_for_0_5_s_within_its_tolerance() -> None:
    """0.05 rad, or what the request asks for, kept for 0.5 s."""
    pair = watched()
    facts = pair.granted(Move(epoch=pair.epoch, targets_rad=HOME), "ann")
    ends_ns = pair.now_ns + facts["duration_ns"]
    pair.run_until(lambda: pair.motion_view(facts["motion_id"]).state == "reached", 5.0)
    assert 500 * MS <= pair.now_ns - ends_ns <= 650 * MS


def test_a_motion_that_does_not_settle_is_aborted() -> None:
    """SETTLE_TIMEOUT with the error and what was asked for: this arm sags by more than the tolerance asked for."""
    pair = watched()
    goals = {LEFT: away(pair, LEFT, 0.1)}
    motion = pair.granted(Move(epoch=pair.epoch, targets_rad=goals, tolerance_rad=0.001), "ann")["motion_id"]
    pair.run(6.5)
    view = pair.motion_view(motion)
    assert (view.state, view.code) == ("aborted", "SETTLE_TIMEOUT") and "0.001 rad" in view.message
    assert pair.state == "ACTIVE"


def test_all_joints_of_both_arms_end_together() -> None:
    """Time-synchronised: no joint rests before the others do, however short its way."""
    pair = watched()
    pair.move(pair.epoch, HOME, "ann")
    pair.run(4.0)
    last = {}
    for side in Side:
        values = [frame.values for _, frame in pair.arm_frames(side)]
        for joint in range(7):
            moves = [n for n, (a, b) in enumerate(pairwise(values)) if abs(b[joint] - a[joint]) > 1e-7]
            last[side, joint] = moves[-1]
    assert max(last.values()) - min(last.values()) <= 6
    assert pair.arm_frames_now() == HOME


def test_a_relative_motion_counts_from_the_reference() -> None:
    """`move_by` adds to the setpoint, not to the measured arm: repeated, it does not ratchet down."""
    pair = watched()
    before = pair.arm_frames_now()[LEFT]
    step = (0.0, 0.0, 0.0, 0.1, 0.0, 0.0, 0.0)
    for sign in (1.0, -1.0):
        offsets = {LEFT: tuple(sign * x for x in step)}
        facts = pair.granted(Move(epoch=pair.epoch, targets_rad=offsets, relative=True), "ann")
        assert facts["q_rad"]["left"][3] == pytest.approx(before[3] + (0.1 if sign > 0 else 0.0))
        pair.run(1.5)
    assert pair.arm_frames_now()[LEFT] == pytest.approx(before, abs=1e-12)


@pytest.mark.parametrize("speed", [0.1, 0.5, 1.0])
def test_a_speed_factor_scales_the_velocity(speed: float) -> None:
    """Velocity x factor; a motion is never faster than that."""
    pair = watched()
    pair.move(pair.epoch, {LEFT: HOME[LEFT]}, "ann", speed=speed)
    pair.run(0.9 / speed)
    assert max(pair.speeds()) <= speed * 1.0 + 1e-3
    assert max(pair.speeds()) > 0.3 * speed


def test_a_slower_motion_in_mid_motion_does_not_run_away() -> None:
    """By itself ruckig would overshoot by 12 rad; here the arm ramps down to the new limit first."""
    pair = watched()
    pair.move(pair.epoch, {LEFT: HOME[LEFT]}, "ann")
    pair.run(0.6)
    goal = away(pair, LEFT, 0.05)
    pair.move(pair.epoch, {LEFT: goal}, "ann", speed=0.1)
    pair.mark()
    pair.run(8.0)
    assert pair.arm_frames_now()[LEFT] == pytest.approx(goal, abs=1e-6)
    assert max(pair.speeds()[60:]) <= 0.1 + 1e-3


@pytest.mark.parametrize(
    ("changes", "code", "field"),
    [
        ({"targets_rad": {}}, Code.WRONG_SHAPE, "targets_rad"),
        ({"targets_rad": {LEFT: (0.0,) * 6}}, Code.WRONG_SHAPE, "left_arm"),
        ({"targets_rad": {LEFT: (0.0,) * 6}, "relative": True}, Code.WRONG_SHAPE, "left_arm"),
        ({"targets_rad": {LEFT: (math.nan, *HOME[LEFT][1:])}}, Code.NOT_FINITE, "left_arm[0]"),
        ({"targets_rad": {LEFT: (math.inf, *HOME[LEFT][1:])}}, Code.NOT_FINITE, "left_arm[0]"),
        ({"targets_rad": {RIGHT: (*HOME[RIGHT][:6], 0.71)}}, Code.OUT_OF_RANGE, "right_arm[6]"),
        ({"targets_rad": {LEFT: (2.0, *(0.0,) * 6)}, "relative": True}, Code.OUT_OF_RANGE, "left_arm[0]"),
        ({"speed": 0.0}, Code.OUT_OF_RANGE, "speed"),
        ({"speed": 1.01}, Code.OUT_OF_RANGE, "speed"),
        ({"speed": math.nan}, Code.NOT_FINITE, "speed"),
        ({"tolerance_rad": 0.3}, Code.OUT_OF_RANGE, "tolerance_rad"),
    ],
)
def test_a_motion_that_cannot_be_is_refused_and_the_running_one_goes_on(changes: dict, code: Code, field: str) -> None:
    """With value and bound; a refusal never touches what runs."""
    pair = watched("ACTIVE")
    arguments = {"targets_rad": {LEFT: HOME[LEFT]}, **changes}
    refusal = pair.refused(Move(epoch=pair.epoch, **arguments), "ann")
    assert refusal.code is code and refusal.field == field and refusal.message
    pair.run(0.1)
    assert pair.motion_view(1).state == "executing" and pair.arm_kinds() == {FrameKind.MOTION}


def test_a_motion_that_finds_no_path_leaves_the_running_one_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """PLAN_FAILED: nothing has changed."""

    def fails(*_: object) -> dict[Side, object]:
        raise PlanFailed("there is no plan")

    pair = watched("ACTIVE")
    monkeypatch.setattr(body, "plan", fails)
    assert pair.refused(Move(epoch=pair.epoch, targets_rad={LEFT: HOME[LEFT]}), "ann").code is Code.PLAN_FAILED
    pair.run(0.1)
    assert pair.motion_view(1).state == "executing" and pair.arm_kinds() == {FrameKind.MOTION}


def test_clipping_is_opt_in_and_reported() -> None:
    """The reply says which joints were clipped and where the motion goes."""
    pair = watched()
    far = (9.0, *HOME[LEFT][1:])
    facts = pair.granted(Move(epoch=pair.epoch, targets_rad={LEFT: far}, on_limit=OnLimit.CLIP), "ann")
    assert facts["clipped"] == {"left": [0]} and facts["q_rad"]["left"][0] == 1.8


def test_a_later_motion_supersedes_the_earlier_one_without_a_stop() -> None:
    """SUPERSEDED; the setpoints join without a step, and a motion of two arms ends for both."""
    pair = watched("ACTIVE")
    pair.mark()
    second = pair.move(pair.epoch, {LEFT: away(pair, LEFT, 0.3)}, "ann")
    pair.run(0.3)
    first = pair.motion_view(1)
    assert (first.state, first.code) == ("superseded", "SUPERSEDED")
    assert pair.motion_view(second).state == "executing"
    assert pair.arm_kinds(LEFT) == {FrameKind.MOTION}
    assert pair.arm_kinds(RIGHT) <= {FrameKind.BRAKE, FrameKind.HOLD, FrameKind.MOTION}
    assert max(abs(b - a) for a, b in pairwise(pair.speeds())) <= 100 * 3.0 * 0.01**2 + 1e-3


def test_each_arm_may_have_a_motion_of_its_own() -> None:
    """Two motions run side by side; cancelling one leaves the other alone."""
    pair = watched()
    left = pair.move(pair.epoch, {LEFT: HOME[LEFT]}, "ann")
    right = pair.move(pair.epoch, {RIGHT: HOME[RIGHT]}, "ann")
    pair.run(0.2)
    pair.granted(Cancel(epoch=pair.epoch, motion_id=left), "ann")
    assert pair.granted(Cancel(epoch=pair.epoch, motion_id=left), "ann") == {"state": "cancelled"}
    pair.run(4.0)
    assert pair.motion_view(left).code == "CANCELLED" and pair.motion_view(right).state == "reached"


def test_a_motion_to_where_the_arm_is_held_is_reached_after_settling() -> None:
    """A path of no length: nothing moves."""
    pair = watched()
    motion = pair.move(pair.epoch, pair.arm_frames_now(), "ann")
    pair.run(0.7)
    assert pair.motion_view(motion).state == "reached" and max(pair.speeds()) == 0.0


def test_a_skipped_tick_delays_a_motion_and_does_not_compress_it() -> None:
    """The path advances one period per setpoint: what was not sent comes later, at the same speed."""
    pair = watched()
    facts = pair.granted(Move(epoch=pair.epoch, targets_rad={LEFT: HOME[LEFT]}), "ann")
    pair.run(0.3)
    pair.late_ns = 80 * MS
    pair.step(pair.now_ns + 80 * MS)
    start_ns = pair.now_ns
    pair.run_until(lambda: pair.arm_frames_now()[LEFT] == HOME[LEFT], 5.0)
    assert pair.now_ns - start_ns >= facts["duration_ns"] - 300 * MS - 30 * MS
    assert max(pair.speeds()) <= 1.0 + 1e-3
