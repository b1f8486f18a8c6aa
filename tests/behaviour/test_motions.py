"""What the owner moves: point-to-point motions and streams of targets, their limits, their ends and their reasons."""

from __future__ import annotations

import math
from itertools import pairwise

import pytest

from gateway import robot
from gateway.core import moves
from gateway.core.events import (
    Cancel,
    CloseStream,
    FrameKind,
    Hold,
    Move,
    OnLimit,
    OpenStream,
    TargetArrived,
)
from gateway.core.motion import PlanFailed
from gateway.core.snapshot import MotionView, Snapshot, TargetView
from gateway.errors import Code
from gateway.settings import ArmSettings
from gateway.values import Side, Vector
from tests.behaviour.scene import HOME, Scene, away, scene
from tests.pair import MS, S

LEFT, RIGHT = Side.LEFT, Side.RIGHT


def watched(state: str = "at rest", **options: object) -> Scene:
    """Return a scene whose snapshots come at 50 Hz."""
    return scene(state, Scene(snapshot_hz=50, **options))


def motion_of(snapshot: Snapshot, motion_id: int) -> MotionView:
    """Return what a snapshot says about a motion."""
    return next(motion for motion in snapshot.motions if motion.motion_id == motion_id)


def target_of(snapshot: Snapshot, stream_id: int) -> TargetView:
    """Return what a snapshot says about a stream of targets."""
    return next(target for target in snapshot.targets if target.stream_id == stream_id)


def speeds(pair: Scene, side: Side = LEFT) -> list[float]:
    """Largest joint speed between consecutive setpoints since the mark [rad/s]."""
    values = [frame.values for _, frame in pair.arm_frames(side)]
    return [100.0 * max(abs(b - a) for a, b in zip(x, y, strict=True)) for x, y in pairwise(values)]


# --------------------------------------------------------------------------------------------------- point to point


def test_a_motion_is_queued_then_executed_with_progress_then_reached() -> None:
    """Each stage is seen; progress rises from 0 to 1; the end is told by the *measured* state."""
    pair = watched()
    motion = pair.move(pair.epoch, HOME, "ann")
    seen: list[MotionView] = []
    while not seen or seen[-1].state in {"queued", "executing"}:
        pair.step()
        seen.append(motion_of(pair.see(), motion))
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
    pair.run_until(lambda: motion_of(pair.see(), facts["motion_id"]).state == "reached", 5.0)
    assert 500 * MS <= pair.now_ns - ends_ns <= 650 * MS


def test_a_motion_that_does_not_settle_is_aborted() -> None:
    """SETTLE_TIMEOUT with the error and what was asked for: this arm sags by more than the tolerance asked for."""
    pair = watched()
    goals = {LEFT: away(pair, LEFT, 0.1)}
    motion = pair.granted(Move(epoch=pair.epoch, targets_rad=goals, tolerance_rad=0.001), "ann")["motion_id"]
    pair.run(6.5)
    view = motion_of(pair.see(), motion)
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
    assert max(speeds(pair)) <= speed * 1.0 + 1e-3
    assert max(speeds(pair)) > 0.3 * speed


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
    assert max(speeds(pair)[60:]) <= 0.1 + 1e-3


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
    assert motion_of(pair.see(), 1).state == "executing" and pair.arm_kinds() == {FrameKind.MOTION}


def test_a_motion_that_finds_no_path_leaves_the_running_one_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """PLAN_FAILED: nothing has changed."""

    def fails(*_: object) -> dict[Side, object]:
        raise PlanFailed("there is no plan")

    pair = watched("ACTIVE")
    monkeypatch.setattr(moves, "plan", fails)
    assert pair.refused(Move(epoch=pair.epoch, targets_rad={LEFT: HOME[LEFT]}), "ann").code is Code.PLAN_FAILED
    pair.run(0.1)
    assert motion_of(pair.see(), 1).state == "executing" and pair.arm_kinds() == {FrameKind.MOTION}


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
    first = motion_of(pair.see(), 1)
    assert (first.state, first.code) == ("superseded", "SUPERSEDED")
    assert motion_of(pair.see(), second).state == "executing"
    assert pair.arm_kinds(LEFT) == {FrameKind.MOTION}
    assert pair.arm_kinds(RIGHT) <= {FrameKind.BRAKE, FrameKind.HOLD, FrameKind.MOTION}
    assert max(abs(b - a) for a, b in pairwise(speeds(pair))) <= 100 * 3.0 * 0.01**2 + 1e-3


def test_each_arm_may_have_a_motion_of_its_own() -> None:
    """Two motions run side by side; cancelling one leaves the other alone."""
    pair = watched()
    left = pair.move(pair.epoch, {LEFT: HOME[LEFT]}, "ann")
    right = pair.move(pair.epoch, {RIGHT: HOME[RIGHT]}, "ann")
    pair.run(0.2)
    pair.granted(Cancel(epoch=pair.epoch, motion_id=left), "ann")
    assert pair.granted(Cancel(epoch=pair.epoch, motion_id=left), "ann") == {"state": "cancelled"}
    pair.run(4.0)
    assert motion_of(pair.see(), left).code == "CANCELLED" and motion_of(pair.see(), right).state == "reached"


def test_a_motion_to_where_the_arm_is_held_is_reached_after_settling() -> None:
    """A path of no length: nothing moves."""
    pair = watched()
    motion = pair.move(pair.epoch, pair.arm_frames_now(), "ann")
    pair.run(0.7)
    assert motion_of(pair.see(), motion).state == "reached" and max(speeds(pair)) == 0.0


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
    assert max(speeds(pair)) <= 1.0 + 1e-3


# ------------------------------------------------------------------------------------------------ streamed targets


@pytest.mark.parametrize("rate_hz", [1.0, 2.5, 10.0, 33.0, 50.0, 100.0])
def test_targets_of_any_rate_become_a_smooth_100_hz_stream(rate_hz: float) -> None:
    """1-100 Hz: within velocity and acceleration limits, without a gap, and the arm follows."""
    pair = watched()
    stream = pair.stream(pair.epoch, LEFT, "ann")
    start = pair.arm_frames_now()[LEFT]
    start_ns, sent = pair.now_ns, 0
    target: Vector = start
    while pair.now_ns - start_ns < 4 * S:
        if pair.now_ns - start_ns >= sent * S / rate_hz:
            sent += 1
            phase = 2 * math.pi * 0.2 * (pair.now_ns - start_ns) / S
            target = tuple(q + 0.15 * math.sin(phase) * (-1 if n == 1 else 1) for n, q in enumerate(start))
            pair.target(pair.epoch, stream, target, "ann")
        pair.step()
    assert pair.gap_ms(robot.joint_command(LEFT)) <= 11 and max(speeds(pair)) <= 1.0 + 1e-3
    assert max(abs(b - a) for a, b in pairwise(speeds(pair))) <= 100 * 3.0 * 0.01**2 + 1e-3
    assert not pair.told(Code.TARGET_EXPIRED) and target_of(pair.see(), stream).seq == sent
    pair.run(1.0)
    assert pair.arm_frames_now()[LEFT] == pytest.approx(target, abs=1e-6)


def test_a_stream_starts_at_the_present_reference() -> None:
    """The reply says where; nothing moves before the first target."""
    pair = watched()
    facts = pair.granted(OpenStream(epoch=pair.epoch, side=LEFT), "ann")
    assert tuple(facts["q_rad"]) == pair.arm_frames_now()[LEFT] and pair.state == "ACTIVE"
    pair.run(5.0)
    assert FrameKind.MOTION not in pair.arm_kinds() and not pair.told(Code.TARGET_EXPIRED)


@pytest.mark.parametrize(("expiry_s", "asked"), [(1.5, None), (0.2, 200 * MS), (3.0, 3 * S)])
def test_a_target_without_a_successor_expires(expiry_s: float, asked: int | None) -> None:
    """1.5 s unless asked for otherwise: the arm brakes and holds, told once; the next target goes on."""
    pair = watched()
    stream = pair.granted(OpenStream(epoch=pair.epoch, side=LEFT, speed=0.1, expiry_ns=asked), "ann")["stream_id"]
    far = away(pair, LEFT, 0.5)
    pair.target(pair.epoch, stream, far, "ann")
    sent_ns = pair.now_ns
    pair.run_until(lambda: bool(pair.told(Code.TARGET_EXPIRED)), 3.5)
    assert expiry_s * S <= pair.now_ns - sent_ns <= expiry_s * S + 20 * MS
    pair.run(2.0)
    assert pair.state == "ACTIVE" and len(pair.told(Code.TARGET_EXPIRED)) == 1
    assert pair.arm_frames(LEFT)[-1][1].kind is FrameKind.HOLD and target_of(pair.see(), stream).open
    pair.target(pair.epoch, stream, far, "ann")
    pair.run(0.1)
    assert pair.arm_frames(LEFT)[-1][1].kind is FrameKind.MOTION


@pytest.mark.parametrize("expiry_ns", [0, 49 * MS, 3 * S + 1])
def test_an_expiry_outside_its_bounds_is_refused(expiry_ns: int) -> None:
    """0.05 to 3 s."""
    pair = watched()
    assert pair.refused(OpenStream(epoch=pair.epoch, side=LEFT, expiry_ns=expiry_ns), "ann").field == "expiry_ns"


def test_targets_outside_the_limits_are_refused_or_clipped_as_asked() -> None:
    """The stream says which target was refused and why; a clipped one is followed to the limit."""
    pair = watched()
    bad = (9.0, *HOME[LEFT][1:])
    strict = pair.stream(pair.epoch, LEFT, "ann")
    pair.target(pair.epoch, strict, HOME[LEFT], "ann")
    pair.run(0.1)
    pair.target(pair.epoch, strict, bad, "ann")
    pair.run(0.1)
    view = target_of(pair.see(), strict)
    assert (view.refused, view.refusal_code, view.seq) == (
        1,
        "OUT_OF_RANGE",
        1,
    ) and "9.0000 rad" in view.refusal_message
    pair.run(1.5)
    assert pair.arm_frames_now()[LEFT] == HOME[LEFT]
    clip = pair.granted(OpenStream(epoch=pair.epoch, side=LEFT, on_limit=OnLimit.CLIP), "ann")["stream_id"]
    pair.target(pair.epoch, clip, bad, "ann")
    pair.run(2.9)
    assert pair.arm_frames_now()[LEFT][0] > 1.0 and target_of(pair.see(), clip).refused == 0


@pytest.mark.parametrize("bad", [(math.nan,) * 7, (math.inf,) * 7, (0.1,) * 6, ()])
def test_a_target_that_is_no_target_is_refused(bad: Vector) -> None:
    """NaN, infinite, wrong length: counted with its reason, and the arm goes on to the last good one."""
    pair = watched()
    stream = pair.stream(pair.epoch, LEFT, "ann")
    pair.target(pair.epoch, stream, HOME[LEFT], "ann")
    pair.run(0.05)
    pair.target(pair.epoch, stream, bad, "ann")
    pair.run(3.0)
    assert pair.arm_frames_now()[LEFT] == HOME[LEFT]
    assert target_of(pair.see(), stream).refusal_code in {"NOT_FINITE", "WRONG_SHAPE"}


def test_an_older_target_is_never_followed() -> None:
    """Sequence numbers rise; of several in one tick the newest counts."""
    pair = watched()
    stream = pair.stream(pair.epoch, LEFT, "ann")
    pair.target(pair.epoch, stream, HOME[LEFT], "ann", seq=10)
    pair.target(pair.epoch, stream, away(pair, LEFT, 0.4), "ann", seq=9)
    pair.run(0.1)
    pair.target(pair.epoch, stream, away(pair, LEFT, 0.4), "ann", seq=10)
    pair.run(1.4)
    assert target_of(pair.see(), stream).refusal_code == "BAD_REQUEST" and target_of(pair.see(), stream).seq == 10
    pair.run(1.0)
    assert pair.arm_frames_now()[LEFT] == HOME[LEFT]


def test_another_client_cannot_push_a_target_out_of_its_slot() -> None:
    """Whoever guesses a stream's number neither moves it nor blocks it."""
    pair = watched()
    stream = pair.stream(pair.epoch, LEFT, "ann")
    pair.target(pair.epoch, stream, HOME[LEFT], "ann", seq=1)
    pair.receive(
        TargetArrived(
            client_id="mallory",
            stream_id=stream,
            epoch=pair.epoch,
            seq=99,
            q_rad=away(pair, LEFT, 0.4),
            received_ns=pair.now_ns,
        )
    )
    pair.run(3.0)
    view = target_of(pair.see(), stream)
    assert pair.arm_frames_now()[LEFT] == HOME[LEFT] and (view.seq, view.refused) == (1, 0)


def test_a_target_under_another_epoch_is_refused() -> None:
    """LEASE_STALE, with both epochs."""
    pair = watched()
    stream = pair.stream(pair.epoch, LEFT, "ann")
    pair.target(pair.epoch - 1, stream, HOME[LEFT], "ann")
    pair.run(0.1)
    view = target_of(pair.see(), stream)
    assert view.refusal_code == "LEASE_STALE" and FrameKind.MOTION not in pair.arm_kinds()


@pytest.mark.parametrize(
    ("ending", "code"), [("close", "CANCELLED"), ("hold", "CANCELLED"), ("move", "SUPERSEDED"), ("open", "SUPERSEDED")]
)
def test_a_stream_that_ended_takes_no_targets_and_says_why(ending: str, code: str) -> None:
    """Closed, held, or superseded by a motion or another stream; the arm brakes or goes on with its successor."""
    pair = watched()
    stream = pair.stream(pair.epoch, LEFT, "ann")
    pair.target(pair.epoch, stream, HOME[LEFT], "ann")
    pair.run(0.3)
    requests = {
        "close": CloseStream(epoch=pair.epoch, stream_id=stream),
        "hold": Hold(epoch=pair.epoch, sides=(LEFT,)),
        "move": Move(epoch=pair.epoch, targets_rad={LEFT: away(pair, LEFT)}),
        "open": OpenStream(epoch=pair.epoch, side=LEFT),
    }
    pair.granted(requests[ending], "ann")
    pair.mark()
    pair.target(pair.epoch, stream, HOME[LEFT], "ann")
    pair.run(0.6)
    view = target_of(pair.see(), stream)
    assert (view.open, view.code, view.refusal_code) == (False, code, "STREAM_ENDED")
    expected = {FrameKind.MOTION} if ending == "move" else {FrameKind.BRAKE, FrameKind.HOLD}
    assert pair.arm_kinds(LEFT) - {FrameKind.HOLD} == expected - {FrameKind.HOLD}
    if ending == "close":
        assert pair.granted(requests["close"], "ann") == {"code": "CANCELLED"}


def test_a_stream_takes_its_arm_out_of_a_motion_of_two() -> None:
    """The motion is superseded for both; the other arm brakes and holds."""
    pair = watched("ACTIVE")
    pair.granted(OpenStream(epoch=pair.epoch, side=LEFT), "ann")
    pair.mark()
    pair.run(1.0)
    assert motion_of(pair.see(), 1).state == "superseded"
    assert pair.arm_kinds(RIGHT) == {FrameKind.BRAKE, FrameKind.HOLD}


@pytest.mark.parametrize("speed", [0.2, 1.0])
def test_a_streams_speed_factor_scales_the_velocity(speed: float) -> None:
    """Velocity x factor, for streamed targets as well."""
    pair = watched()
    stream = pair.granted(OpenStream(epoch=pair.epoch, side=LEFT, speed=speed), "ann")["stream_id"]
    pair.target(pair.epoch, stream, HOME[LEFT], "ann")
    pair.run(1.4)
    assert 0.3 * speed < max(speeds(pair)) <= speed + 1e-3


def test_a_stream_says_when_its_targets_ask_for_too_much() -> None:
    """`limited`: the reference lags because of the limits, not for want of targets."""
    pair = watched()
    stream = pair.granted(OpenStream(epoch=pair.epoch, side=LEFT), "ann")["stream_id"]
    start = pair.arm_frames_now()[LEFT]
    limited = []
    for n in range(300):
        q_rad = tuple(q + 0.4 * math.sin(2 * math.pi * 1.5 * n / 100) for q in start)
        inside = zip(robot.JOINT_LOWER_RAD[LEFT], q_rad, robot.JOINT_UPPER_RAD[LEFT], strict=True)
        pair.target(pair.epoch, stream, tuple(min(max(q, low), high) for low, q, high in inside), "ann")
        pair.step()
        limited.append(target_of(pair.see(), stream).limited if n % 10 == 9 else False)
    assert any(limited)


def test_tighter_limits_of_the_configuration_hold() -> None:
    """Velocity, acceleration and position limits come from the settings."""
    lower, upper = dict(robot.JOINT_LOWER_RAD), dict(robot.JOINT_UPPER_RAD)
    upper[LEFT] = (0.3, *upper[LEFT][1:])
    pair = watched(arm=ArmSettings(v_radps=0.4, a_radps2=1.0, j_radps3=8.0, lower_rad=lower, upper_rad=upper))
    refusal = pair.refused(Move(epoch=pair.epoch, targets_rad={LEFT: HOME[LEFT]}), "ann")
    assert refusal.code is Code.OUT_OF_RANGE and refusal.bound == "[-1.8, 0.3]"
    pair.move(pair.epoch, {LEFT: (0.3, *HOME[LEFT][1:])}, "ann")
    pair.run(3.0)
    assert max(speeds(pair)) <= 0.4 + 1e-3
    assert max(abs(b - a) for a, b in pairwise(speeds(pair))) <= 100 * 1.0 * 0.01**2 + 1e-3
