"""Stop frames of chassis and lift: at once, for at least a second, and then the end that was asked for."""

from __future__ import annotations

from itertools import pairwise

import pytest

from gateway.codes import Code
from gateway.core.messages.outputs import Frame, FrameKind
from gateway.core.streams.chassis import ChassisStream
from gateway.core.streams.ground import LIFT_OFF, GroundStream
from gateway.core.streams.lift import LiftStream
from gateway.robot.topics import CHASSIS_VELOCITY
from gateway.settings.settings import ChassisSettings

MS = 1_000_000
S = 1_000_000_000
T0 = 1_000 * S
ZEROS, LIFT_STOP = (0.0, 0.0, 0.0), (0.0, 1.0)
SERVO_OFF = (0.0, 0.0)


def run(stream: GroundStream, from_ns: int, to_ns: int) -> list[tuple[int, Frame]]:
    """Tick every 10 ms, as the engine does; return what left and when [ms since T0]."""
    sent = []
    for now_ns in range(from_ns, to_ns, 10 * MS):
        frame = stream.frame(now_ns) if stream.running else None
        if frame is not None:
            stream.log.note(now_ns)
            sent.append(((now_ns - T0) // MS, frame))
    return sent


def test_nothing_is_sent_before_the_first_stop():
    """Chassis and lift belong to others until a stop of ours is asked for."""
    stream = ChassisStream(ChassisSettings())
    assert (stream.running, stream.next_due_ns(), stream.frame(T0)) == (False, None, None)


@pytest.mark.parametrize("phase_ms", range(0, 50, 10))
@pytest.mark.parametrize(("group", "values"), [("chassis", ZEROS), ("lift", LIFT_STOP)])
def test_a_stop_leaves_at_once_and_for_at_least_a_second_at_20_hz(group, values, phase_ms):
    """Wherever in the grid it begins, first and last stop frame are a second apart or more (manual §4.5, §4.6)."""
    stream = ChassisStream(ChassisSettings()) if group == "chassis" else LiftStream()
    start_ns = T0 + phase_ms * MS
    stream.stop(start_ns)
    sent = run(stream, start_ns, start_ns + 3 * S)
    assert {frame.values for _, frame in sent} == {values}
    times_ms = [at_ms for at_ms, _ in sent]
    assert times_ms[0] == phase_ms
    assert 1000 <= times_ms[-1] - times_ms[0] <= 1100
    assert max(b - a for a, b in pairwise(times_ms)) <= 50
    assert (stream.running, stream.next_due_ns()) == (False, None)


def test_stop_frames_are_stop_frames_of_nobodys_epoch():
    """The gate lets this kind pass in any state, fresh or not."""
    stream = ChassisStream(ChassisSettings())
    stream.stop(T0 + 30 * MS)
    assert stream.next_due_ns() == T0
    assert stream.frame(T0 + 30 * MS) == Frame(
        topic=CHASSIS_VELOCITY, values=ZEROS, kind=FrameKind.STOP, epoch=0, due_ns=T0
    )
    assert (stream.frame(T0 + 40 * MS), stream.next_due_ns()) == (None, T0 + 50 * MS)


def test_a_further_stop_begins_the_second_anew():
    """Whoever stops last gets his full second."""
    stream = ChassisStream(ChassisSettings())
    stream.stop(T0)
    first = run(stream, T0, T0 + 800 * MS)
    stream.stop(T0 + 800 * MS)
    again = run(stream, T0 + 800 * MS, T0 + 4 * S)
    assert first[-1][0] == 750 and (again[0][0], again[-1][0]) == (800, 1800)


def test_the_servo_goes_off_once_after_the_lift_has_stopped():
    """[0,1] for a second, then one [0,0] (manual §4.6)."""
    stream = LiftStream()
    stream.stop(T0)
    stream.then(LIFT_OFF)
    sent = run(stream, T0, T0 + 3 * S)
    assert [frame.values for _, frame in sent] == [LIFT_STOP] * (len(sent) - 1) + [SERVO_OFF]
    assert (sent[-2][0], sent[-1][0]) == (1000, 1050)
    assert not stream.running


def test_a_further_stop_does_not_keep_the_servo_on():
    """After an e-stop the lift ends with [0,0], whoever stops it once more meanwhile (DESIGN §8.8)."""
    stream = LiftStream()
    stream.stop(T0)
    stream.then(LIFT_OFF)
    run(stream, T0, T0 + 500 * MS)
    stream.stop(T0 + 500 * MS)
    sent = run(stream, T0 + 500 * MS, T0 + 3 * S)
    assert [frame.values for _, frame in sent][-2:] == [LIFT_STOP, SERVO_OFF]
    assert sent[-1][0] == 1550


def test_the_servo_can_still_be_taken_off_when_the_second_is_just_over():
    """As long as the stream counts as running, the end that is asked for is sent."""
    stream = LiftStream()
    stream.stop(T0)
    run(stream, T0, T0 + 1040 * MS)
    assert stream.running
    stream.then(LIFT_OFF)
    assert [(at_ms, frame.values) for at_ms, frame in run(stream, T0 + 1040 * MS, T0 + 2 * S)] == [(1050, SERVO_OFF)]


@pytest.mark.parametrize("end", [None, LIFT_OFF], ids=["plain", "servo off"])
def test_a_stream_that_has_ended_is_shown_as_silent(end):
    """The silence after the last frame was meant: it is no gap when the next stop comes."""
    stream = LiftStream()
    stream.stop(T0)
    if end is not None:
        stream.then(end)
    run(stream, T0, T0 + 3 * S)
    assert not stream.log.view(T0 + 3 * S).running
    stream.stop(T0 + 5 * S)
    run(stream, T0 + 5 * S, T0 + 6 * S)
    assert stream.log.view(T0 + 6 * S).worst_gap_ns <= 50 * MS


# ------------------------------------------------------------------------------------------------ drives


@pytest.mark.parametrize("group", ["chassis", "lift"])
def test_a_drive_goes_on_under_its_number_until_something_ends_it(group):
    """The number of a drive that is over is refused with what ended it; 0 begins another (BEHAVIOUR, explicitly)."""
    stream, wanted = (ChassisStream(ChassisSettings()), (0.1, 0.0, 0.0)) if group == "chassis" else (LiftStream(), 0.5)

    def drive(drive_id: int, at_ns: int = T0) -> Code | None:
        return stream.drive(wanted, epoch=3, expires_ns=at_ns + 300 * MS, now_ns=at_ns, drive_id=drive_id)

    assert drive(1) is Code.UNKNOWN_STREAM and not stream.running
    stream.end(Code.CLIENT_LOST)
    assert (drive(0), stream.drive_id, stream.code, stream.is_driven) == (None, 1, None, True)
    assert drive(1) is None and drive(2) is Code.UNKNOWN_STREAM
    stream.end(Code.STOPPED)
    stream.end(Code.CLIENT_LOST)
    stream.stop(T0)
    assert drive(1) is Code.STOPPED and not stream.is_driven, "the first reason counts, and nothing is driven again"
    assert (drive(0), stream.drive_id, stream.code) == (None, 2, None)
    assert drive(1) is Code.SUPERSEDED and stream.is_driven


@pytest.mark.parametrize("group", ["chassis", "lift"])
def test_a_velocity_counts_until_it_expires(group):
    """What is left of it is shown; a later one counts anew; it runs out once."""
    stream, wanted = (ChassisStream(ChassisSettings()), (0.1, 0.0, 0.0)) if group == "chassis" else (LiftStream(), 0.5)
    assert stream.left_ns(T0) is None and not stream.expire(T0)
    stream.drive(wanted, epoch=3, expires_ns=T0 + 300 * MS, now_ns=T0)
    assert stream.left_ns(T0 + 100 * MS) == 200 * MS and not stream.expire(T0 + 299 * MS)
    stream.drive(wanted, epoch=3, expires_ns=T0 + 500 * MS, now_ns=T0 + 200 * MS)
    assert not stream.expire(T0 + 499 * MS) and stream.left_ns(T0 + 600 * MS) == 0
    assert stream.expire(T0 + 500 * MS) and not stream.expire(T0 + 510 * MS)
    assert stream.left_ns(T0 + 510 * MS) is None and stream.code is None, "its drive may go on"


@pytest.mark.parametrize("end", ["cut", "expiry"])
@pytest.mark.parametrize("group", ["chassis", "lift"])
def test_a_drive_of_which_nothing_has_left_ends_without_a_word(group, end):
    """The group may be another's, who must not be stopped by us; once a frame is out, stop frames follow."""
    stream, wanted = (ChassisStream(ChassisSettings()), (0.1, 0.0, 0.0)) if group == "chassis" else (LiftStream(), 0.5)
    for begins in (False, True):
        stream.drive(wanted, epoch=3, expires_ns=T0 + 100 * MS, now_ns=T0)
        assert not begins or stream.frame(T0) is not None
        assert stream.is_on_wire is begins
        if end == "cut":
            stream.cut(Code.OTHER_GATEWAY, T0 + 10 * MS)
            assert stream.code is Code.OTHER_GATEWAY and not stream.is_driven
        else:
            assert stream.expire(T0 + 100 * MS) and stream.code is None
        assert bool(run(stream, T0 + 110 * MS, T0 + 3 * S)) is begins and stream.running is (begins and group == "lift")
    stream.cut(Code.STOPPED, T0 + 4 * S)
    assert stream.code is not Code.STOPPED or end == "expiry", "the first reason counts"


def test_a_stop_is_sent_although_nothing_of_the_drive_has_left():
    """Whoever stops explicitly is not held back, and a drive begun in that very moment does not change it."""
    stream = ChassisStream(ChassisSettings())
    stream.drive((0.1, 0.0, 0.0), epoch=3, expires_ns=T0 + S, now_ns=T0)
    stream.stop(T0)
    stream.drive((0.1, 0.0, 0.0), epoch=3, expires_ns=T0 + S, now_ns=T0)
    assert stream.is_on_wire
    stream.cut(Code.CLIENT_LOST, T0)
    sent = run(stream, T0, T0 + 3 * S)
    assert {frame.values for _, frame in sent} == {ZEROS} and sent[-1][0] - sent[0][0] >= 1000


def test_commands_at_any_rate_leave_the_grid_as_it_is():
    """Fifty velocities a second are still sent at 20 Hz."""
    stream = LiftStream()
    times = []
    for now_ns in range(T0 + 10 * MS, T0 + S, 10 * MS):
        if now_ns % (20 * MS) == 0:
            stream.drive(0.5, epoch=3, expires_ns=now_ns + 300 * MS, now_ns=now_ns)
        frame = stream.frame(now_ns)
        if frame is not None:
            assert (frame.kind, frame.epoch, frame.values) == (FrameKind.MOTION, 3, (0.5, 1.0))
            times.append(frame.due_ns)
    assert {b - a for a, b in pairwise(times)} == {50 * MS}


@pytest.mark.parametrize("group", ["chassis", "lift"])
def test_a_drive_in_the_tick_of_a_stop_begins_after_a_stop_frame(group):
    """The stop is heard, at once, and the velocities begin from rest: else the robot would be told to jump."""
    stream = ChassisStream(ChassisSettings()) if group == "chassis" else LiftStream()
    values = (0.2, 0.0, 0.0) if group == "chassis" else 0.5
    stream.drive(values, epoch=1, expires_ns=T0 + 5 * S, now_ns=T0)
    assert run(stream, T0, T0 + S)[-1][1].kind is FrameKind.MOTION
    stop_ns = T0 + S + 10 * MS
    stream.stop(stop_ns)
    stream.drive(values, epoch=1, expires_ns=T0 + 5 * S, now_ns=stop_ns)
    assert stream.is_driven and stream.is_stopping, "so that not even a late tick holds it back"
    (at_ms, first), (_, second), *_ = run(stream, stop_ns, stop_ns + S)
    assert (at_ms, first.kind, first.epoch) == (1010, FrameKind.STOP, 0)
    assert first.values == (ZEROS if group == "chassis" else LIFT_STOP)
    assert second.kind is FrameKind.MOTION
    assert group == "lift" or 0.0 < second.values[0] <= 0.3 * 0.05


def test_stop_frames_that_may_not_have_arrived_are_sent_again_when_the_transport_is_back():
    """For a full second; where nothing ran, nothing is owed."""
    stream = ChassisStream(ChassisSettings())
    stream.lose(T0)
    stream.find(T0)
    assert not stream.running
    stream.stop(T0)
    run(stream, T0, T0 + 200 * MS)
    stream.lose(T0 + 200 * MS)
    run(stream, T0 + 200 * MS, T0 + 1190 * MS)
    stream.find(T0 + 1190 * MS)
    sent = run(stream, T0 + 1190 * MS, T0 + 6 * S)
    assert {frame.values for _, frame in sent} == {ZEROS} and sent[-1][0] - sent[0][0] >= 1000
    stream.find(T0 + 6 * S)
    assert not stream.running


@pytest.mark.parametrize(("stream", "watchdog_ns"), [(ChassisStream(ChassisSettings()), S), (LiftStream(), 3 * S)])
def test_after_an_outage_longer_than_the_robots_watchdog_nothing_is_sent_again(stream, watchdog_ns):
    """The robot has ended the drive by itself (manual §4.5, §4.6), and may be somebody else's by now."""
    for outage_ns, is_sent in ((watchdog_ns - 1, True), (watchdog_ns, False)):
        stream.stop(T0)
        run(stream, T0, T0 + 200 * MS)
        stream.lose(T0 + 200 * MS)
        run(stream, T0 + 200 * MS, T0 + 4 * S)
        back_ns = T0 + 200 * MS + outage_ns
        stream.find(back_ns)
        assert bool(run(stream, back_ns, back_ns + 5 * S)) is is_sent and not stream.running


def test_a_lift_in_use_is_stopped_for_as_long_as_it_is_kept():
    """[0,1] goes on after its second, until the use ends."""
    stream = LiftStream()
    stream.drive(0.5, epoch=3, expires_ns=T0, now_ns=T0)
    stream.stop(T0)
    assert {frame.values for _, frame in run(stream, T0, T0 + 5 * S)} == {LIFT_STOP} and stream.running
    stream.let_go()
    assert run(stream, T0 + 5 * S, T0 + 7 * S) == [] and not stream.running
