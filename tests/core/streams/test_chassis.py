"""The chassis stream: an owner's velocity on its ramp, zeros at the end."""

from __future__ import annotations

from itertools import pairwise

from gateway.codes import Code
from gateway.core.messages.outputs import Frame, FrameKind
from gateway.core.streams.chassis import ChassisStream
from gateway.robot.topics import CHASSIS_VELOCITY
from gateway.settings.settings import ChassisSettings

MS = 1_000_000
S = 1_000_000_000
T0 = 1_000 * S
ZEROS = (0.0, 0.0, 0.0)
FAST = (0.3, 0.0, -0.5)


def drive(stream: ChassisStream, wanted=FAST, now_ns: int = T0, for_ns: int = 10 * S, drive_id: int = 0) -> Code | None:
    """The owner of epoch 7 asks for a velocity."""
    return stream.drive(wanted, epoch=7, expires_ns=now_ns + for_ns, now_ns=now_ns, drive_id=drive_id)


def run(stream: ChassisStream, from_ns: int, to_ns: int) -> list[Frame]:
    """Tick every 10 ms, as the engine does; return what left."""
    sent = []
    for now_ns in range(from_ns, to_ns, 10 * MS):
        stream.expire(now_ns)
        frame = stream.frame(now_ns)
        if frame is not None:
            stream.log.note(now_ns)
            sent.append(frame)
    return sent


def test_a_velocity_is_ramped_to_and_then_kept():
    """Inside the robot's 0.3 up (manual §4.5), each component on its own, under the owner's epoch, from the first tick on."""
    stream = ChassisStream(ChassisSettings())
    assert drive(stream) is None and stream.is_driven
    sent = run(stream, T0, T0 + 3 * S)
    assert sent[0].due_ns == T0 and {(frame.kind, frame.epoch) for frame in sent} == {(FrameKind.MOTION, 7)}
    for before, after in pairwise([ZEROS, *[frame.values for frame in sent]]):
        assert all(abs(b - a) <= 0.3 * 0.05 + 1e-9 for a, b in zip(before, after, strict=True))
    assert sent[-1].values == stream.commanded == stream.wanted == FAST
    assert all(frame.topic == CHASSIS_VELOCITY and len(frame.values) == 3 for frame in sent)


def test_an_expired_velocity_ramps_down_and_ends_with_a_second_of_zeros():
    """Not a step: 0.6 down; the zeros are stop frames, and then there is silence."""
    stream = ChassisStream(ChassisSettings())
    drive(stream, for_ns=2 * S)
    run(stream, T0, T0 + 2 * S)
    assert stream.commanded == FAST
    assert stream.expire(T0 + 2 * S) and stream.wanted == ZEROS and stream.is_driven
    sent = run(stream, T0 + 2 * S, T0 + 6 * S)
    moving = [frame.values for frame in sent if frame.kind is FrameKind.MOTION]
    for before, after in pairwise([FAST, *moving]):
        assert all(abs(b - a) <= 0.6 * 0.05 + 1e-9 for a, b in zip(before, after, strict=True))
    zeros = [frame for frame in sent if frame.kind is FrameKind.STOP]
    assert {frame.values for frame in zeros} == {ZEROS} and zeros[-1].due_ns - zeros[0].due_ns >= S
    assert sent[-len(zeros) :] == zeros and not stream.running


def test_a_stop_is_zeros_at_once():
    """The robot brakes by its own ramp: no velocity follows a stop (manual §4.5)."""
    stream = ChassisStream(ChassisSettings())
    drive(stream)
    run(stream, T0, T0 + 2 * S)
    stream.stop(T0 + 2 * S)
    sent = run(stream, T0 + 2 * S, T0 + 4 * S)
    assert {(frame.kind, frame.values) for frame in sent} == {(FrameKind.STOP, ZEROS)}
    assert (stream.commanded, stream.wanted, stream.is_driven) == (ZEROS, ZEROS, False)


def test_zero_that_is_asked_for_is_ramped_to():
    """And where the chassis rests already it is a second of zeros; asking again and again adds none beside the grid."""
    stream = ChassisStream(ChassisSettings())
    drive(stream, (0.1, 0.0, 0.0))
    run(stream, T0, T0 + 2 * S)
    drive(stream, ZEROS, T0 + 2 * S, drive_id=1)
    kinds = [frame.kind for frame in run(stream, T0 + 2 * S, T0 + 6 * S)]
    assert kinds[0] is FrameKind.MOTION and kinds[-1] is FrameKind.STOP and not stream.running
    assert not stream.expire(T0 + 20 * S), "nothing was moving: nothing to tell"
    drive(stream, ZEROS, T0 + 20 * S)
    sent = run(stream, T0 + 20 * S, T0 + 20 * S + 500 * MS)
    drive(stream, ZEROS, T0 + 20 * S + 500 * MS, for_ns=100 * MS)
    assert not stream.expire(T0 + 20 * S + 600 * MS), "a zero that runs out ends no motion"
    sent += run(stream, T0 + 20 * S + 610 * MS, T0 + 24 * S)
    assert {frame.values for frame in sent} == {ZEROS} and not stream.running


def test_a_velocity_after_a_stop_begins_at_rest():
    """What was told last is zero, whatever the wheels still do."""
    stream = ChassisStream(ChassisSettings())
    drive(stream)
    run(stream, T0, T0 + 2 * S)
    stream.stop(T0 + 2 * S)
    run(stream, T0 + 2 * S, T0 + 2 * S + 200 * MS)
    drive(stream, now_ns=T0 + 2 * S + 200 * MS)
    first = run(stream, T0 + 2 * S + 200 * MS, T0 + 2 * S + 260 * MS)[0]
    assert first.kind is FrameKind.MOTION and 0.0 < first.values[0] <= 0.015


def test_a_drive_that_is_over_changes_nothing():
    """The velocity of whoever did not hear of the stop is not taken."""
    stream = ChassisStream(ChassisSettings())
    drive(stream)
    stream.end(Code.STOPPED)
    stream.stop(T0)
    assert drive(stream, drive_id=1) is Code.STOPPED and stream.wanted == ZEROS
    assert {frame.values for frame in run(stream, T0, T0 + 2 * S)} == {ZEROS}
