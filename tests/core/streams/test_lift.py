"""The lift stream: an owner's velocity, then [0,1], and [0,0] when its use ends (manual §4.6)."""

from __future__ import annotations

from gateway.codes import Code
from gateway.core.messages.outputs import FrameKind
from gateway.core.streams.ground import LIFT_OFF
from gateway.core.streams.lift import LiftStream
from gateway.values import Vector

MS = 1_000_000
S = 1_000_000_000
T0 = 1_000 * S
STOP = (0.0, 1.0)


def driven(velocity: float = 0.3) -> LiftStream:
    """A lift that an owner drives for 0.3 s."""
    stream = LiftStream()
    assert stream.drive(velocity, epoch=7, expires_ns=T0 + 300 * MS, now_ns=T0) is None
    return stream


def run(stream: LiftStream, from_s: float, to_s: float) -> list[tuple[FrameKind, Vector]]:
    """Tick every 10 ms, as the engine does; return what left."""
    sent = []
    for now_ns in range(T0 + round(from_s * S), T0 + round(to_s * S), 10 * MS):
        stream.expire(now_ns)
        frame = stream.frame(now_ns)
        if frame is not None:
            stream.log.note(now_ns)
            sent.append((frame.kind, frame.values))
    return sent


def test_a_velocity_is_sent_as_it_is_with_the_servo_on():
    """No ramp: the manual's own example commands steps (manual §6.7)."""
    stream = driven(-0.3)
    assert (stream.commanded, stream.is_in_use) == (-0.3, True)
    assert run(stream, 0, 0.3) == [(FrameKind.MOTION, (-0.3, 1.0))] * 6


def test_an_expired_velocity_stops_the_lift_and_keeps_its_servo_on():
    """[0,1] for as long as it is in use: after 3 s of silence the robot would take the servo off by itself."""
    stream = driven()
    run(stream, 0, 0.3)
    assert set(run(stream, 0.3, 20)) == {(FrameKind.STOP, STOP)}
    assert stream.running and stream.commanded == 0.0 and stream.is_in_use


def test_a_velocity_of_zero_runs_out_in_silence():
    """Nothing was moving: there is nothing to tell."""
    stream = driven(0.0)
    assert not stream.expire(T0 + 300 * MS) and not stream.is_driven


def test_a_stop_after_an_outage_leaves_the_servo_off():
    """[0,0] has begun to end the use: a stop asked for meanwhile does not arm it again, nor end without it."""
    stream = driven()
    run(stream, 0, 2.1)
    stream.lose(T0 + 2100 * MS)
    stream.find(T0 + 5 * S)
    run(stream, 5, 5.3)
    stream.stop(T0 + 5300 * MS)
    assert set(run(stream, 5.3, 10)) == {(FrameKind.STOP, LIFT_OFF)} and not stream.running
    assert stream.drive(0.3, epoch=7, expires_ns=T0 + 11 * S, now_ns=T0 + 10 * S) is None
    stream.stop(T0 + 10 * S)
    assert set(run(stream, 10, 11)) == {(FrameKind.STOP, STOP)}


def test_the_end_of_the_use_is_servo_off():
    """After a stop has had its second; at once where the lift has stood still for longer."""
    stream = driven()
    run(stream, 0, 5)
    stream.then(LIFT_OFF)
    assert run(stream, 5, 7) == [(FrameKind.STOP, LIFT_OFF)]
    assert (stream.running, stream.is_in_use) == (False, False)
    stream = driven()
    stream.stop(T0)
    stream.then(LIFT_OFF)
    assert run(stream, 0, 3) == [*[(FrameKind.STOP, STOP)] * 21, (FrameKind.STOP, LIFT_OFF)]


def test_a_stop_between_servo_off_and_silence_leaves_it_off():
    """[0,0] has left and the stream is about to end: [0,1] would leave the servo on with nobody to take it off."""
    stream = driven()
    stream.stop(T0)
    stream.then(LIFT_OFF)
    assert run(stream, 0, 1.06)[-1] == (FrameKind.STOP, LIFT_OFF) and stream.running
    stream.stop(T0 + 1060 * MS)
    assert set(run(stream, 1.06, 5)) == {(FrameKind.STOP, LIFT_OFF)} and not stream.running


def test_a_velocity_takes_an_end_back_that_was_asked_for():
    """An owner who drives on after `disable` drives on."""
    stream = driven()
    stream.stop(T0)
    stream.then(LIFT_OFF)
    stream.drive(0.2, epoch=7, expires_ns=T0 + S, now_ns=T0)
    assert LIFT_OFF not in [values for _, values in run(stream, 0, 5)] and stream.is_in_use


def test_a_lift_that_is_let_go_falls_silent_after_its_stop():
    """The robot is somebody else's: no [0,0], and [0,1] no longer than a second."""
    stream = driven()
    stream.stop(T0)
    stream.let_go()
    assert run(stream, 0, 3) == [(FrameKind.STOP, STOP)] * 21
    assert (stream.running, stream.is_in_use) == (False, False)


def test_after_a_lost_transport_the_lift_is_taken_off_and_not_armed_anew():
    """[0,0] stops it, too; [0,1] would switch on a servo that the robot has switched off meanwhile (manual §4.6)."""
    stream = driven()
    stream.stop(T0)
    stream.lose(T0 + 2100 * MS)
    run(stream, 0, 5)
    assert stream.running and stream.is_in_use
    stream.find(T0 + 5 * S)
    assert run(stream, 5, 9) == [(FrameKind.STOP, LIFT_OFF)] * 21
    assert (stream.running, stream.is_in_use) == (False, False)
    stream.find(T0 + 9 * S)
    assert not stream.running
    stream.stop(T0 + 9 * S)
    assert set(run(stream, 9, 12)) == {(FrameKind.STOP, STOP)}, "a later stop is a stop again"


def test_a_lift_that_was_kept_on_through_a_long_outage_falls_silent():
    """The robot has taken its servo off after 3 s (manual §4.6); [0,0] would take off whoever switched it on since."""
    stream = driven()
    run(stream, 0, 2)
    stream.lose(T0 + 2 * S)
    assert set(run(stream, 2, 5)) == {(FrameKind.STOP, STOP)}, "into the void"
    stream.find(T0 + 5 * S)
    assert run(stream, 5, 9) == [] and (stream.running, stream.is_in_use) == (False, False)


def test_a_drive_that_is_over_changes_nothing():
    """The velocity of whoever did not hear of the stop is not taken."""
    stream = driven()
    stream.end(Code.STOPPED)
    stream.stop(T0)
    assert stream.drive(0.9, epoch=7, expires_ns=T0 + S, now_ns=T0, drive_id=1) is Code.STOPPED
    assert set(run(stream, 0, 2)) == {(FrameKind.STOP, STOP)}


def test_it_is_kept_on_in_another_process_place():
    """Stopped, and [0,1] goes on until the use ends."""
    stream = LiftStream()
    stream.keep(T0)
    assert set(run(stream, 0, 5)) == {(FrameKind.STOP, STOP)} and stream.is_in_use
