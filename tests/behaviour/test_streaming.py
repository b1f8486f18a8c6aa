"""Streams of the owner's targets: any rate, expiry, limits, order, ends and reasons."""

from __future__ import annotations

import math
from itertools import pairwise

import pytest

from gateway.core.messages.events import TargetArrived
from gateway.core.messages.outputs import FrameKind
from gateway.errors import Code
from gateway.messages.incoming import OnLimit
from gateway.messages.requests import CloseStream, Hold, Move, OpenStream
from gateway.robot.limits import JOINT_LOWER_RAD, JOINT_UPPER_RAD
from gateway.robot.topics import joint_command
from gateway.settings.settings import ArmSettings
from gateway.values import Side, Vector
from tests.behaviour.scene import HOME, away, watched
from tests.pair import MS, S

LEFT, RIGHT = Side.LEFT, Side.RIGHT


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
    assert pair.gap_ms(joint_command(LEFT)) <= 11 and max(pair.speeds()) <= 1.0 + 1e-3
    assert max(abs(b - a) for a, b in pairwise(pair.speeds())) <= 100 * 3.0 * 0.01**2 + 1e-3
    assert not pair.told(Code.TARGET_EXPIRED) and pair.target_view(stream).seq == sent
    pair.run(1.0)
    assert pair.arm_frames_now()[LEFT] == pytest.approx(target, abs=1e-6)


def test_a_stream_starts_at_the_present_reference() -> None:
    """The reply says where; nothing moves before the first target."""
    pair = watched()
    facts = pair.granted(OpenStream(epoch=pair.epoch, side=LEFT), "ann")
    assert tuple(facts["values"]) == pair.arm_frames_now()[LEFT] and pair.state == "ACTIVE"
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
    assert pair.arm_frames(LEFT)[-1][1].kind is FrameKind.HOLD and pair.target_view(stream).open
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
    view = pair.target_view(strict)
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
    assert pair.arm_frames_now()[LEFT][0] > 1.0 and pair.target_view(clip).refused == 0


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
    assert pair.target_view(stream).refusal_code in {"NOT_FINITE", "WRONG_SHAPE"}


def test_an_older_target_is_never_followed() -> None:
    """Sequence numbers rise; of several in one tick the newest counts."""
    pair = watched()
    stream = pair.stream(pair.epoch, LEFT, "ann")
    pair.target(pair.epoch, stream, HOME[LEFT], "ann", seq=10)
    pair.target(pair.epoch, stream, away(pair, LEFT, 0.4), "ann", seq=9)
    pair.run(0.1)
    pair.target(pair.epoch, stream, away(pair, LEFT, 0.4), "ann", seq=10)
    pair.run(1.4)
    assert pair.target_view(stream).refusal_code == "BAD_REQUEST" and pair.target_view(stream).seq == 10
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
            values=away(pair, LEFT, 0.4),
            received_ns=pair.now_ns,
        )
    )
    pair.run(3.0)
    view = pair.target_view(stream)
    assert pair.arm_frames_now()[LEFT] == HOME[LEFT] and (view.seq, view.refused) == (1, 0)


def test_a_target_under_another_epoch_is_refused() -> None:
    """LEASE_STALE, with both epochs."""
    pair = watched()
    stream = pair.stream(pair.epoch, LEFT, "ann")
    pair.target(pair.epoch - 1, stream, HOME[LEFT], "ann")
    pair.run(0.1)
    view = pair.target_view(stream)
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
    view = pair.target_view(stream)
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
    assert pair.motion_view(1).state == "superseded"
    assert pair.arm_kinds(RIGHT) == {FrameKind.BRAKE, FrameKind.HOLD}


@pytest.mark.parametrize("speed", [0.2, 1.0])
def test_a_streams_speed_factor_scales_the_velocity(speed: float) -> None:
    """Velocity x factor, for streamed targets as well."""
    pair = watched()
    stream = pair.granted(OpenStream(epoch=pair.epoch, side=LEFT, speed=speed), "ann")["stream_id"]
    pair.target(pair.epoch, stream, HOME[LEFT], "ann")
    pair.run(1.4)
    assert 0.3 * speed < max(pair.speeds()) <= speed + 1e-3


def test_a_stream_says_when_its_targets_ask_for_too_much() -> None:
    """`limited`: the reference lags because of the limits, not for want of targets."""
    pair = watched()
    stream = pair.granted(OpenStream(epoch=pair.epoch, side=LEFT), "ann")["stream_id"]
    start = pair.arm_frames_now()[LEFT]
    limited = []
    for n in range(300):
        q_rad = tuple(q + 0.4 * math.sin(2 * math.pi * 1.5 * n / 100) for q in start)
        inside = zip(JOINT_LOWER_RAD[LEFT], q_rad, JOINT_UPPER_RAD[LEFT], strict=True)
        pair.target(pair.epoch, stream, tuple(min(max(q, low), high) for low, q, high in inside), "ann")
        pair.step()
        limited.append(pair.target_view(stream).limited if n % 10 == 9 else False)
    assert any(limited)


def test_tighter_limits_of_the_configuration_hold() -> None:
    """Velocity, acceleration and position limits come from the settings."""
    lower, upper = dict(JOINT_LOWER_RAD), dict(JOINT_UPPER_RAD)
    upper[LEFT] = (0.3, *upper[LEFT][1:])
    pair = watched(arm=ArmSettings(v_radps=0.4, a_radps2=1.0, j_radps3=8.0, lower_rad=lower, upper_rad=upper))
    refusal = pair.refused(Move(epoch=pair.epoch, targets_rad={LEFT: HOME[LEFT]}), "ann")
    assert refusal.code is Code.OUT_OF_RANGE and refusal.bound == "[-1.8, 0.3]"
    pair.move(pair.epoch, {LEFT: (0.3, *HOME[LEFT][1:])}, "ann")
    pair.run(3.0)
    assert max(pair.speeds()) <= 0.4 + 1e-3
    assert max(abs(b - a) for a, b in pairwise(pair.speeds())) <= 100 * 1.0 * 0.01**2 + 1e-3
