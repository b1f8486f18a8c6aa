"""Stop frames of chassis and lift: at once, for at least a second, and then the end that was asked for."""

from __future__ import annotations

from itertools import pairwise

import pytest

from gateway import robot
from gateway.core.events import Frame, FrameKind
from gateway.core.streams.ground import LIFT_OFF, StopRepeater

MS = 1_000_000
S = 1_000_000_000
T0 = 1_000 * S
ZEROS, LIFT_STOP = (0.0, 0.0, 0.0), (0.0, 1.0)
SERVO_OFF = (0.0, 0.0)


def run(stream: StopRepeater, from_ns: int, to_ns: int) -> list[tuple[int, Frame]]:
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
    stream = StopRepeater(robot.CHASSIS_VELOCITY)
    assert (stream.running, stream.next_due_ns(), stream.frame(T0)) == (False, None, None)


@pytest.mark.parametrize("phase_ms", range(0, 50, 10))
@pytest.mark.parametrize(
    ("topic", "values"), [(robot.CHASSIS_VELOCITY, ZEROS), (robot.LIFT_COMMAND, LIFT_STOP)], ids=["chassis", "lift"]
)
def test_a_stop_leaves_at_once_and_for_at_least_a_second_at_20_hz(topic, values, phase_ms):
    """Wherever in the grid it begins, first and last stop frame are a second apart or more (manual §4.5, §4.6)."""
    stream = StopRepeater(topic)
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
    stream = StopRepeater(robot.CHASSIS_VELOCITY)
    stream.stop(T0 + 30 * MS)
    assert stream.next_due_ns() == T0
    assert stream.frame(T0 + 30 * MS) == Frame(
        topic=robot.CHASSIS_VELOCITY, values=ZEROS, kind=FrameKind.STOP, epoch=0, due_ns=T0
    )
    assert (stream.frame(T0 + 40 * MS), stream.next_due_ns()) == (None, T0 + 50 * MS)


def test_a_further_stop_begins_the_second_anew():
    """Whoever stops last gets his full second."""
    stream = StopRepeater(robot.CHASSIS_VELOCITY)
    stream.stop(T0)
    first = run(stream, T0, T0 + 800 * MS)
    stream.stop(T0 + 800 * MS)
    again = run(stream, T0 + 800 * MS, T0 + 4 * S)
    assert first[-1][0] == 750 and (again[0][0], again[-1][0]) == (800, 1800)


def test_the_servo_goes_off_once_after_the_lift_has_stopped():
    """[0,1] for a second, then one [0,0] (manual §4.6)."""
    stream = StopRepeater(robot.LIFT_COMMAND)
    stream.stop(T0)
    stream.then(LIFT_OFF)
    sent = run(stream, T0, T0 + 3 * S)
    assert [frame.values for _, frame in sent] == [LIFT_STOP] * (len(sent) - 1) + [SERVO_OFF]
    assert (sent[-2][0], sent[-1][0]) == (1000, 1050)
    assert not stream.running


def test_a_further_stop_does_not_keep_the_servo_on():
    """After an e-stop the lift ends with [0,0], whoever stops it once more meanwhile (DESIGN §8.8)."""
    stream = StopRepeater(robot.LIFT_COMMAND)
    stream.stop(T0)
    stream.then(LIFT_OFF)
    run(stream, T0, T0 + 500 * MS)
    stream.stop(T0 + 500 * MS)
    sent = run(stream, T0 + 500 * MS, T0 + 3 * S)
    assert [frame.values for _, frame in sent][-2:] == [LIFT_STOP, SERVO_OFF]
    assert sent[-1][0] == 1550


def test_the_servo_can_still_be_taken_off_when_the_second_is_just_over():
    """As long as the stream counts as running, the end that is asked for is sent."""
    stream = StopRepeater(robot.LIFT_COMMAND)
    stream.stop(T0)
    run(stream, T0, T0 + 1040 * MS)
    assert stream.running
    stream.then(LIFT_OFF)
    assert [(at_ms, frame.values) for at_ms, frame in run(stream, T0 + 1040 * MS, T0 + 2 * S)] == [(1050, SERVO_OFF)]


@pytest.mark.parametrize("end", [None, LIFT_OFF], ids=["plain", "servo off"])
def test_a_stream_that_has_ended_is_shown_as_silent(end):
    """The silence after the last frame was meant: it is no gap when the next stop comes."""
    stream = StopRepeater(robot.LIFT_COMMAND)
    stream.stop(T0)
    if end is not None:
        stream.then(end)
    run(stream, T0, T0 + 3 * S)
    assert not stream.log.view(T0 + 3 * S).running
    stream.stop(T0 + 5 * S)
    run(stream, T0 + 5 * S, T0 + 6 * S)
    assert stream.log.view(T0 + 6 * S).worst_gap_ns <= 50 * MS
