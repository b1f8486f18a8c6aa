"""The black box: what it keeps is the same when it is run again, and whatever happens to the disk hurts nobody else."""

from __future__ import annotations

import json
import os
import shutil
import stat
import subprocess
import sys
import threading
import time
from itertools import pairwise
from pathlib import Path

import pytest

from gateway.core.engine import Engine, Output
from gateway.core.messages.events import CommandRequested, Event, SettingsRead
from gateway.core.messages.outputs import Level, Notice
from gateway.core.motion.chunk import Chunk, prepare
from gateway.core.streams.heartbeat import HeartbeatStream
from gateway.errors import Code
from gateway.incident import recorder as recorder_module
from gateway.incident import ring as ring_module
from gateway.incident.event_log import read_events
from gateway.incident.freezing import freeze
from gateway.incident.records import Start, Tick
from gateway.incident.replay import incident, replay, ticks
from gateway.incident.ring import records
from gateway.incident.timeline import joints, timeline
from gateway.messages.requests import Estop, Follow, Recover
from gateway.process.threads import take_lost
from gateway.values import Side
from tests.incident.feeling import feeling
from tests.incident.recorded import DEADLINE_S, Recorded, an_incident, record, until
from tests.pair import MS, Pair, S

ROOT = Path(__file__).parents[2]


@pytest.fixture(autouse=True)
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """Write at once: virtual time does not wait for a quarter of a second. How long this machine freezes is not the matter."""
    monkeypatch.setattr(recorder_module, "WRITTEN_S", 0.01)
    monkeypatch.setattr(recorder_module, "MOST_FREEZE_NS", S)
    monkeypatch.setattr(recorder_module, "WORST_FREEZE_NS", S)


AGAIN = "import pathlib, sys; from gateway.incident.replay import *; print(replay(incident(pathlib.Path(sys.argv[1]))))"


def test_an_incident_gives_the_same_frames_in_another_process(tmp_path: Path) -> None:
    """Whatever the order of its sets is there."""
    kept = an_incident(tmp_path)
    recorded = sum(len(tick.frames) for _, tick in ticks(incident(kept)))
    assert recorded > 100
    for seed in ("0", "4711"):
        done = subprocess.run(
            [sys.executable, "-c", AGAIN, str(kept)],
            env={**os.environ, "PYTHONHASHSEED": seed, "PYTHONPATH": str(ROOT)},
            capture_output=True,
            text=True,
            check=True,
        )
        assert f"frames={recorded}, gaps=0, difference=None" in done.stdout


def test_it_goes_back_as_far_as_the_ring_and_three_seconds_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """In pieces, the first of which begins where an engine's state is known; they follow one another without a gap.

    The ring is a tenth of the real one here.
    """
    assert ring_module.RING_NS - recorder_module.AFTER_NS > 60 * S
    monkeypatch.setattr(ring_module, "RING_NS", 6 * S)
    monkeypatch.setattr(recorder_module, "PIECE_NS", 1500 * MS)
    monkeypatch.setattr(recorder_module, "RETRY_NS", 500 * MS)
    pair = Pair()
    recorded = record(pair, tmp_path)
    epoch = pair.activate()
    for number in range(5):
        pair.move(epoch, {Side.LEFT: (0.1 * (number % 2), 0.1, 0.0, 0.3, 0.0, 0.0, 0.0)})
        pair.run(2.0)
    recorded.recorder.latch(Code.ESTOP, "by another process", pair.now_ns)
    latched_ns = pair.now_ns
    pair.run(3.5)
    assert recorded.recorder.close(DEADLINE_S, is_clean=True)
    (kept,) = (tmp_path / "kept").iterdir()
    found = incident(kept)
    times = [tick.now_ns for _, tick in ticks(found)]
    assert times[0] <= latched_ns - 3 * S and times[-1] >= latched_ns + 3 * S
    assert times[-1] - times[0] >= 6 * S and times[0] > latched_ns - 9 * S
    done = replay(found)
    assert done.difference is None and done.gaps == 0 and done.ticks == len(times) and len(found.pieces) >= 4
    assert found.causes[0].code == "ESTOP" and not list((tmp_path / "ring").iterdir())
    found.pieces[1].path.unlink()  # by somebody; here, or in the ring before it was kept
    done, found = replay(incident(kept)), incident(kept)
    assert done.difference is None and done.gaps == 1 and [is_gap for is_gap, _ in ticks(found)].count(True) == 1


def test_a_chunk_that_was_worked_out_before_is_run_again(tmp_path: Path) -> None:
    """It comes with its request, and is a part of every state behind it."""
    pair = Pair()
    recorded = record(pair, tmp_path)
    epoch = pair.activate()
    q = pair.see().arms["left"].q_ref_rad
    points = {Side.LEFT: [tuple(a + 0.002 * n for a in q) for n in range(100)]}
    chunk = prepare(points, dt_s=0.1)
    assert isinstance(chunk, Chunk)
    pair.tell(Follow(epoch=epoch, points=points, dt_s=0.1), chunk=chunk)
    pair.run(16.0)
    recorded.recorder.latch(Code.ESTOP, "by another process", pair.now_ns)
    pair.run(4.0)
    assert recorded.recorder.close(DEADLINE_S, is_clean=True)
    (kept,) = (tmp_path / "kept").iterdir()
    assert replay(incident(kept)).difference is None


def test_settings_that_were_read_anew_are_run_again(tmp_path: Path) -> None:
    """They come as an event in the midst of a motion, and are a part of every state behind it."""
    pair = Pair()
    recorded = record(pair, tmp_path)
    epoch = pair.activate()
    for q_rad in (0.3, 0.5):
        pair.move(epoch, {Side.LEFT: (q_rad,) * 7})
        pair.run(0.5)
        values = {"arm.v_radps": 0.2, "local.audit_log_mb": 20}
        pair.receive(SettingsRead(values=values, message="arm.v_radps = 0.2", at_ns=pair.now_ns))
    pair.ask(Estop(reason="something fell"))
    pair.run(3.5)
    assert recorded.recorder.close(DEADLINE_S, is_clean=True)
    (kept,) = (tmp_path / "kept").iterdir()
    done = replay(incident(kept))
    assert done.difference is None and done.frames > 100


def test_an_incident_of_a_robot_that_feels_is_run_again(tmp_path: Path) -> None:
    """With `model.dynamics`."""
    pair = feeling()
    recorded = record(pair, tmp_path)
    epoch = pair.activate()
    pair.move(epoch, {Side.LEFT: (0.3, 0.3, 0.3, 0.3, 0.3, 0.3, 0.3)})
    pair.run(1.0)
    pair.ask(Estop(reason="something fell"))
    pair.run(3.5)
    assert recorded.recorder.close(DEADLINE_S, is_clean=True)
    (kept,) = (tmp_path / "kept").iterdir()
    done = replay(incident(kept))
    assert done.difference is None and done.frames > 100


def test_a_frame_that_is_not_the_same_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The first of them, with both."""
    kept = an_incident(tmp_path)

    monkeypatch.setattr(HeartbeatStream, "frame", lambda self, now_ns: None)
    difference = replay(incident(kept)).difference
    assert difference is not None and difference.what == "frames" and difference.recorded != difference.replayed


def test_nobody_else_may_read_it(tmp_path: Path) -> None:
    """Names of people and programs are in it."""
    an_incident(tmp_path / "box")
    for path in (tmp_path / "box").rglob("*"):
        assert stat.S_IMODE(path.stat().st_mode) == (0o700 if path.is_dir() else 0o600), path


def test_a_process_that_died_has_left_its_last_minute(tmp_path: Path) -> None:
    """The next one keeps it, without the half block that its end has cut."""
    pair = Pair()
    recorded = record(pair, tmp_path)
    pair.activate()
    pair.run(1.0)
    assert recorded.recorder.close(DEADLINE_S, is_clean=False)
    (left,) = (tmp_path / "ring").iterdir()
    with left.open("ab") as file:
        file.write(b"\0\0\1\0half")
    after = record(Pair(), tmp_path)
    assert after.recorder.close(DEADLINE_S, is_clean=True)
    (kept,) = (tmp_path / "kept").iterdir()
    found = incident(kept)
    assert found.causes[0].code == "DIED" and kept.name.endswith("-DIED")
    done = replay(found)
    assert done.difference is None and done.frames > 0


@pytest.mark.parametrize("where", ["tick", "receive"])
def test_what_the_engine_raised_at_is_kept_and_raises_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, where: str
) -> None:
    """The request that brings a bug about is the last thing in the box, with the stop frames that left; a replay says what."""
    pair = Pair()
    recorded = record(pair, tmp_path)
    pair.activate()
    pair.run(0.5)
    asked: list[object] = []
    receive, tick = Engine.receive, Engine.tick

    def failing_receive(engine: Engine, event: Event, now_ns: int) -> None:
        asked.extend([event.request] if isinstance(event, CommandRequested) else [])
        receive(engine, event, now_ns)
        if where == "receive" and any(isinstance(each, Recover) for each in asked):
            raise ZeroDivisionError("a bug")

    def failing_tick(engine: Engine, now_ns: int, late_ns: int = 0) -> Output:
        if any(isinstance(each, Recover) for each in asked):
            raise ZeroDivisionError("a bug")
        return tick(engine, now_ns, late_ns)

    monkeypatch.setattr(Engine, "receive", failing_receive)
    monkeypatch.setattr(Engine, "tick", failing_tick)
    with pytest.raises(ZeroDivisionError):
        pair.ask(Recover(reason="go on"))
    asked.clear()
    frames = recorded.recorder.panic_frames(pair.now_ns)
    assert recorded.recorder.close(DEADLINE_S, is_clean=False)
    assert record(Pair(), tmp_path).recorder.close(DEADLINE_S, is_clean=True)
    (kept,) = (tmp_path / "kept").iterdir()
    *_, (_, last) = ticks(incident(kept))
    assert [event.request for event in last.heard if isinstance(event, CommandRequested)] == [Recover(reason="go on")]
    assert last.frames == frames and frames and last.now_ns == pair.now_ns
    difference = replay(incident(kept)).difference
    assert difference == (last.now_ns, "raised", "it raised", "ZeroDivisionError: a bug")


def test_a_disk_that_hangs_holds_nobody_up_and_leaves_a_gap(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What was left out is not shown as if nothing had been there; what follows begins anew and can be run."""
    monkeypatch.setattr(recorder_module, "MOST_WAITING", 50)
    hangs, goes_on = threading.Event(), threading.Event()
    write = ring_module.Ring.write

    def hanging(ring, packed):
        if hangs.is_set():
            assert goes_on.wait(DEADLINE_S)
        write(ring, packed)

    monkeypatch.setattr(ring_module.Ring, "write", hanging)
    pair = Pair()
    recorded = record(pair, tmp_path)
    pair.activate()
    pair.run(1.0)
    until(lambda: not recorded.recorder._waiting)
    hangs.set()
    recorded.is_waited_for = False
    pair.run(3.0)  # in virtual time at once: it waits for nothing
    assert recorded.recorder.left_out > 100 and len(recorded.recorder._waiting) <= 51
    goes_on.set()
    until(lambda: not recorded.recorder._waiting)
    recorded.is_waited_for = True
    pair.run(8.0)
    recorded.recorder.latch(Code.ESTOP, "by another process", pair.now_ns)
    pair.run(4.0)
    assert recorded.recorder.close(DEADLINE_S, is_clean=True)
    (kept,) = (tmp_path / "kept").iterdir()
    done = replay(incident(kept))
    assert done.gaps == 1 and done.difference is None
    assert [moment.kind for moment in timeline(incident(kept))].count("gap") == 1


def test_a_full_disk_ends_the_recording_until_there_is_room(tmp_path: Path) -> None:
    """And the log says so once."""
    pair = Pair()
    recorded = record(pair, tmp_path)
    recorded.recorder._ring.spare_bytes = 2**62
    pair.activate()
    pair.run(6.0)
    until(lambda: not recorded.recorder._waiting)
    recorded.recorder._ring.spare_bytes = 0
    pair.run(6.0)
    recorded.recorder.latch(Code.ESTOP, "by another process", pair.now_ns)
    pair.run(4.0)
    assert recorded.recorder.close(DEADLINE_S, is_clean=True)
    (kept,) = (tmp_path / "kept").iterdir()
    done = replay(incident(kept))
    assert done.difference is None and done.ticks > 0


def test_a_folder_that_cannot_be_made_hurts_nobody(tmp_path: Path) -> None:
    """A file lies where it would be."""
    (tmp_path / "box").write_text("")
    pair = Pair()
    recorded = record(pair, tmp_path / "box")
    pair.activate()
    pair.run(1.0)
    assert pair.state == "ACTIVE" and recorded.recorder.close(DEADLINE_S, is_clean=True)


def test_an_engine_that_cannot_be_frozen_goes_on_unrecorded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Whatever is in the way."""

    def broken(engine):
        raise RecursionError("too deep")

    monkeypatch.setattr(recorder_module, "freeze", broken)
    pair = Pair()
    recorded = record(pair, tmp_path)
    pair.activate()
    assert pair.state == "ACTIVE" and not recorded.recorder._is_on
    until(lambda: not recorded.recorder._waiting)
    assert recorded.recorder.close(DEADLINE_S, is_clean=True)


@pytest.mark.parametrize("is_frozen", [True, False])
def test_an_engine_that_takes_long_to_freeze_is_frozen_seldom(
    is_frozen: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """The loop comes first, from the second time on, whether it came to anything or not. It records on; told once."""
    tries: list[int] = []

    def slow(engine):
        tries.append(pair.now_ns)
        end_ns = time.thread_time_ns() + recorder_module.MOST_FREEZE_NS
        while time.thread_time_ns() <= end_ns:
            pass
        if not is_frozen:
            raise recorder_module.Unfrozen("generator")
        return freeze(engine)

    monkeypatch.setattr(recorder_module, "PIECE_NS", 500 * MS)
    monkeypatch.setattr(recorder_module, "RETRY_NS", 500 * MS)
    monkeypatch.setattr(recorder_module, "MOST_FREEZE_NS", 5 * MS)
    monkeypatch.setattr(recorder_module, "SELDOM_NS", 2 * S)
    pair = Pair()
    recorded = record(pair, tmp_path)
    pair.run(0.6)
    monkeypatch.setattr(recorder_module, "freeze", slow)
    pair.run(8.0)
    first, *rest = (b - a for a, b in pairwise(tries))
    assert first < 2 * S <= min(rest)
    assert len([entry for entry in caplog.records if "control loop" in entry.message]) == 1
    recorded.recorder.latch(Code.ESTOP, "by another process", pair.now_ns)
    pair.run(3.5)
    assert recorded.recorder.close(DEADLINE_S, is_clean=True)
    (kept,) = (tmp_path / "kept").iterdir()
    done = replay(incident(kept))
    assert done.difference is None and done.gaps == 0 and done.ticks > 300


@pytest.mark.parametrize("is_frozen", [True, False])
def test_an_engine_that_takes_two_ticks_to_freeze_is_recorded_no_more(
    is_frozen: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """The loop comes first: one time may be, a second in a row is the last, whether it came to anything or not."""
    tries: list[int] = []

    def very_slow(engine):
        tries.append(pair.now_ns)
        end_ns = time.thread_time_ns() + 20 * MS
        while time.thread_time_ns() <= end_ns:
            pass
        if not is_frozen:
            raise recorder_module.Unfrozen("generator")
        return freeze(engine)

    monkeypatch.setattr(recorder_module, "PIECE_NS", 500 * MS)
    monkeypatch.setattr(recorder_module, "RETRY_NS", 500 * MS)
    monkeypatch.setattr(recorder_module, "MOST_FREEZE_NS", 5 * MS)
    monkeypatch.setattr(recorder_module, "WORST_FREEZE_NS", 20 * MS)
    pair = Pair()
    recorded = record(pair, tmp_path)
    pair.run(0.6)
    monkeypatch.setattr(recorder_module, "freeze", very_slow)
    pair.run(3.0)
    assert len(tries) == 2 and not recorded.recorder._is_on
    assert len([entry for entry in caplog.records if "control loop" in entry.message]) == 1
    assert recorded.recorder.close(DEADLINE_S, is_clean=True)


def test_a_latch_before_the_engine_could_be_frozen_no_more_is_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The loop switches off, the writer writes on what waits, and keeps what it has seen."""
    pair = Pair()
    recorded = record(pair, tmp_path)
    pair.activate()
    pair.ask(Estop(reason="something fell"))

    def broken(engine):
        raise RecursionError("too deep")

    monkeypatch.setattr(recorder_module, "freeze", broken)
    pair.run(0.2)
    recorded.recorder._due_ns = 0
    pair.run(6.0)
    assert not recorded.recorder._is_on
    until(lambda: any((tmp_path / "kept").glob("*-ESTOP")))
    assert recorded.recorder._thread.is_alive() and recorded.recorder.close(DEADLINE_S, is_clean=True)


def test_a_black_box_that_panics_ends_the_recording_and_nothing_else(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As zenoh's panics, none of Python's own errors: the daemon hears nothing of it but a line of the log."""

    class Panic(BaseException):
        pass

    def panicking(recorder):
        raise Panic

    monkeypatch.setattr(recorder_module.Recorder, "_write", panicking)
    pair = Pair()
    recorded = record(pair, tmp_path)
    pair.activate()
    until(lambda: not (recorded.recorder._is_on or recorded.recorder._waiting))
    pair.run(0.5)
    assert pair.state == "ACTIVE" and not recorded.recorder._waiting and not take_lost()
    assert recorded.recorder.close(DEADLINE_S, is_clean=True)


def test_the_oldest_incidents_are_let_go(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """By number, and by what they take together."""
    monkeypatch.setattr(ring_module, "KEPT_INCIDENTS", 2)
    ring = ring_module.Ring(tmp_path)
    ring.spare_bytes = 0
    ring.open()
    names = []
    for code in ("AA", "BB", "CC", "CC"):
        ring.begin({"form": 1}, 0)
        names.append(ring.keep([(code, "", 0)]).name)
    ring.close()
    assert sorted(path.name for path in (tmp_path / "kept").iterdir()) == sorted(names)[-2:]


def test_minor_incidents_never_push_a_latch_out(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """They make room for one another, and for it; what does not say how grave it is may be."""
    monkeypatch.setattr(ring_module, "KEPT_INCIDENTS", 2)
    ring = ring_module.Ring(tmp_path)
    ring.spare_bytes = 0
    ring.open()
    ring.begin({"form": 1}, 0)
    grave = ring.keep([("ESTOP", "", 0)])
    minor = [ring.keep([(code, "", 0)], is_grave=False) for code in ("AA", "BB", "CC")]
    assert [path.exists() for path in (grave, *minor)] == [True, False, False, True]
    other = ring.keep([("ESTOP", "", 0)])
    (other / "incident.json").write_text("[]")
    assert not ring.keep([("STALLED", "", 9)], is_grave=False).exists()
    ring.close()
    assert set((tmp_path / "kept").iterdir()) == {grave, other}


def test_each_incident_of_a_second_has_a_name_of_its_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Also when an older one of it was let go."""
    monkeypatch.setattr(ring_module.time, "gmtime", lambda: time.struct_time((2026, 1, 1, 0, 0, 0, 3, 1, 0)))
    ring = ring_module.Ring(tmp_path)
    ring.spare_bytes = 0
    ring.open()
    ring.begin({"form": 1}, 0)
    first, second = (ring.keep([("ESTOP", "", 0)]) for _ in range(2))
    shutil.rmtree(first)
    assert ring.keep([("ESTOP", "", 0)]) not in (second,) and second.exists()
    ring.close()


def test_of_what_anybody_can_bring_about_one_a_minute_is_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A latch is kept whenever it comes, however many others came before it. The minute is a third of the real one here."""
    pair = Pair()
    recorded = record(pair, tmp_path)

    def told(event: Code, seconds: float, count: int = 1, **facts: str) -> None:
        level = Level.ERROR if event is Code.LATCH_CHANGED else Level.WARNING
        notice = Notice(level=level, code=event, message="", at_ns=pair.now_ns, facts=facts)
        pair.engine.engine._coordinator.notices.extend([notice] * count)
        pair.run(seconds)

    assert recorder_module.MINOR_NS == 60 * S
    monkeypatch.setattr(recorder_module, "MINOR_NS", 20 * S)
    pair.run(0.5)
    for _ in range(3):
        told(Code.MOTION_ENDED, 4.0, state="aborted", code="STALLED")
    told(Code.MOTION_ENDED, 0.5, 500, state="aborted", code="STALLED")
    told(Code.LATCH_CHANGED, 4.0, code="ESTOP")
    told(Code.MOTION_ENDED, 8.0, state="aborted", code="STALLED")
    told(Code.MOTION_ENDED, 4.0, state="aborted", code="STALLED")
    assert recorded.recorder.close(DEADLINE_S, is_clean=True)
    causes = [[cause.code for cause in incident(kept).causes] for kept in sorted((tmp_path / "kept").iterdir())]
    assert len(causes) == 3 and {code for codes in causes for code in codes} == {"ESTOP", "STALLED"}
    assert max(map(len, causes)) <= recorder_module.MOST_CAUSES


def test_what_was_told_and_refused_is_a_line_each(tmp_path: Path) -> None:
    """And a file that grows too large is put aside once."""
    an_incident(tmp_path)
    events = list(read_events(tmp_path, 0.0))
    assert {"STATE_CHANGED", "LATCH_CHANGED", "LINK_UP"} <= {event["code"] for event in events}
    assert all(
        line == json.dumps(json.loads(line), ensure_ascii=False)
        for line in (tmp_path / "events.jsonl").read_text().splitlines()
    )
    assert not list(read_events(tmp_path, float("inf")))


def test_a_request_is_told_by_the_name_that_came_along(tmp_path: Path) -> None:
    """Of who has never asked for the robot no other one is known."""
    pair = Pair()
    recorded = record(pair, tmp_path)
    pair.activate()
    pair.receive(CommandRequested(client_id="0a", name="bob", request_id=9, request=Estop(), received_ns=pair.now_ns))
    pair.run(3.5)
    assert recorded.recorder.close(DEADLINE_S, is_clean=True)
    (kept,) = (tmp_path / "kept").iterdir()
    assert "Estop by bob" in [moment.text for moment in timeline(incident(kept))]


def test_what_was_told_is_a_line_where_there_is_no_room_for_a_piece(tmp_path: Path, monkeypatch) -> None:
    """The lines of a pass are few bytes, and stand nowhere else."""

    def full(*_: object) -> None:
        raise OSError(28, "little room is left on the disk")

    monkeypatch.setattr(recorder_module, "PIECE_NS", 100 * MS)
    pair = Pair()
    pair.engine = recorded = Recorded(pair.engine, tmp_path)  # type: ignore[assignment]  # as much of one as a pair needs
    recorded.is_waited_for, recorder = False, recorded.recorder
    recorder._is_on = True
    monkeypatch.setattr(recorder._ring, "begin", full)
    pair.activate()
    while recorder._waiting:
        recorder._write()
    assert {"STATE_CHANGED", "LINK_UP"} <= {event["code"] for event in read_events(tmp_path, 0.0)}


def test_a_piece_begins_with_a_state_and_joints_can_be_drawn(tmp_path: Path) -> None:
    """What was sent and what was measured, of both arms."""
    found = incident(an_incident(tmp_path))
    first, second = list(records(found.pieces[0].path))[:2]
    assert isinstance(first, Start) and isinstance(second, Tick)
    asked, measured = joints(found)
    assert all(asked[side] and measured[side] for side in Side)
