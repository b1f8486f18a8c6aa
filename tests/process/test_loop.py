"""The loop in virtual time: an absolute grid that skips and never bursts, the order of a cycle, and its end."""

from __future__ import annotations

import ast
import inspect
import logging
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.core.messages.events import ClientSeen, CommandRequested, Event, ExitRequested, SampleArrived, Suspended
from gateway.core.messages.outputs import Frame, FrameKind, Level, Notice, Remembered, Reply
from gateway.errors import Code
from gateway.messages.requests import Enable, Estop, Recover, Request, Stop
from gateway.messages.snapshot import Snapshot
from gateway.process import loop as loop_module
from gateway.process.loop import Loop

MS = 1_000_000
PERIOD = 10 * MS
START = 12_340 * MS
"""The first instant of the base grid: a multiple of the period."""


class VirtualTime:
    """A clock that only sleeping, and work in the test's hand, moves. The sleep up to the first instant is exact."""

    def __init__(self) -> None:
        self.now = START - 3 * MS
        self.slept: list[int] = []
        self.stop_at: list[int] = []  # when stops come that end a sleep
        self.oversleep: Callable[[int], int] = lambda n: 0

    def clock(self) -> int:
        return self.now

    def sleep(self, seconds: float) -> bool:
        ns = round(seconds * 1e9)
        if self.stop_at and self.stop_at[0] <= self.now + ns:
            self.now = max(self.now, self.stop_at.pop(0))
            return True
        assert ns > 0, "the loop must not sleep for nothing"
        if self.now < START:
            self.now += ns
            return False
        self.now += ns + self.oversleep(len(self.slept))
        self.slept.append(ns)
        return False


@dataclass
class Out:
    """What a tick gives."""

    frames: Sequence[Frame] = ()
    replies: Sequence[Reply] = ()
    notices: Sequence[Notice] = ()
    remembered: Remembered | None = None
    snapshot: Snapshot | None = None
    done: bool = False
    claim: int = 0


@dataclass
class Bench:
    """An engine, a link, a service and a watch that write down what happens to them, in one list."""

    time: VirtualTime = field(default_factory=VirtualTime)
    log: list[tuple[object, ...]] = field(default_factory=list)
    ticks: list[tuple[int, int]] = field(default_factory=list)
    received: list[Event] = field(default_factory=list)
    from_robot: list[Event] = field(default_factory=list)
    from_clients: list[Event] = field(default_factory=list)
    stops: list[Event] = field(default_factory=list)
    on_tick: Callable[[int, int], Out] = lambda n, now_ns: Out()
    due: Callable[[int], int | None] = lambda now_ns: None
    panic: Sequence[Frame] = ()
    sleeps: list[int] = field(default_factory=list)
    rest: Callable[[int], int] = lambda now_ns: 0
    asked_at: list[int] = field(default_factory=list)
    """When requests come that end a rest."""
    claims: list[int] = field(default_factory=list)
    is_watched: bool = False
    """Whether somebody must know of every cycle."""
    is_guarded: bool = False
    """Whether what is shown to a guard is written down, too."""
    broken: dict[str, BaseException] = field(default_factory=dict)

    def _note(self, what: str, *facts: object) -> None:
        self.log.append((what, *facts))
        if what in self.broken:
            raise self.broken[what]

    # the engine
    def receive(self, event: Event, now_ns: int) -> None:
        self.received.append(event)
        self._note("receive", type(event).__name__, now_ns)

    def tick(self, now_ns: int, *, late_ns: int) -> Out:
        self.ticks.append((now_ns, late_ns))
        self._note("tick")
        return self.on_tick(len(self.ticks), now_ns)

    def next_due_ns(self) -> int | None:
        return self.due(self.time.now)

    @property
    def rest_ns(self) -> int:
        return self.rest(self.time.now)

    def panic_frames(self, now_ns: int) -> Sequence[Frame]:
        self._note("panic_frames", now_ns)
        return self.panic

    # the link
    def publish(self, frame: Frame) -> None:
        self._note(f"publish {frame.topic}")

    # the service
    def wait(self, seconds: float) -> bool:
        until = self.time.now + round(seconds * 1e9)
        self._note("wait", until)
        if self.asked_at and self.asked_at[0] <= until:
            self.time.now = max(self.time.now, self.asked_at.pop(0))
            return True
        self.time.now = until
        return False

    def send(self, replies: Sequence[Reply], notices: Sequence[Notice]) -> None:
        self._note("send", tuple(replies), tuple(notices))

    def publish_snapshot(self, snapshot: Snapshot) -> None:
        self._note("snapshot", snapshot)

    # the rest
    def remember(self, remembered: Remembered) -> None:
        self._note("remember", remembered)

    def show(self, now_ns: int) -> None:
        if self.is_guarded:
            self._note("show", now_ns)

    def slept_ns(self) -> int:
        return self.sleeps.pop(0) if self.sleeps else 0

    def loop(self, period_ns: int = PERIOD) -> Loop[Frame]:
        bench = self

        class Link:
            def poll(self) -> Sequence[Event]:
                bench._note("poll link")
                taken, bench.from_robot = bench.from_robot, []
                return taken

            def publish(self, frame: Frame) -> None:
                bench.publish(frame)

            def show(self, claim: int) -> None:
                bench.claims.append(claim)

        class Service:
            def poll(self) -> Sequence[Event]:
                bench._note("poll service")
                taken, bench.from_clients = bench.from_clients, []
                return taken

            def poll_stops(self) -> Sequence[Event]:
                bench.log.append(("poll stops",))
                taken, bench.stops = bench.stops, []
                return taken

            def wait(self, seconds: float) -> bool:
                return bench.wait(seconds)

            def wait_for_stop(self, seconds: float) -> bool:
                time.sleep(seconds)
                return False

            def send(self, replies: Sequence[Reply], notices: Sequence[Notice]) -> None:
                bench.send(replies, notices)

            def publish_snapshot(self, snapshot: Snapshot) -> None:
                bench.publish_snapshot(snapshot)

        return Loop(
            self,
            Link(),
            Service(),
            on_remembered=self.remember,
            on_sending=self.show,
            on_cycle=(lambda now_ns: self._note("cycle", now_ns)) if self.is_watched else None,
            period_ns=period_ns,
            clock=self.time.clock,
            sleep=self.time.sleep,
            sleep_watch=self,
        )

    def run(self, ticks: int, period_ns: int = PERIOD) -> Loop[Frame]:
        """Run for a number of ticks and return the loop."""
        loop = self.loop(period_ns)
        loop.run(lambda: len(self.ticks) >= ticks)
        return loop

    def names(self) -> list[object]:
        """Return what happened, without the facts."""
        return [entry[0] for entry in self.log]


def _frame(topic: str) -> Frame:
    return Frame(topic=topic, values=(0.0,), kind=FrameKind.STOP, epoch=0, due_ns=0)


def _request(request: Request, n: int = 0) -> CommandRequested:
    return CommandRequested(client_id="a", request_id=n, request=request, received_ns=n)


SAMPLE = SampleArrived(topic="/fsm_state", value=2, received_ns=0)
NOTICE = Notice(code=Code.TICK_LATE, level=Level.WARNING, message="late", at_ns=0, facts={"late_ms": "60"})
REPLY = Reply(client_id="a", request_id=1)


# ------------------------------------------------------------------------------------------------------------- the grid


@pytest.mark.parametrize("begun_ns", [0, 1, PERIOD - 1, PERIOD, 123_456_789])
def test_the_grid_lies_on_multiples_of_the_period(begun_ns: int) -> None:
    """Streams do the same with theirs, so that instants which can fall together do: one wake-up serves them all."""
    bench = Bench()
    bench.time.now = begun_ns
    bench.run(3)
    first = (begun_ns // PERIOD + 1) * PERIOD
    assert bench.ticks == [(first + n * PERIOD, 0) for n in range(3)]


def test_ticks_lie_on_an_absolute_grid() -> None:
    """Without load every tick is on its instant, and none is late."""
    bench = Bench()
    loop = bench.run(100)
    assert bench.ticks == [(START + n * PERIOD, 0) for n in range(100)]
    assert (loop.ticks, loop.skipped, loop.worst_late_ns) == (100, 0, 0)


@given(st.lists(st.integers(0, PERIOD - 1), min_size=1, max_size=40))
def test_a_late_tick_never_moves_the_next_one(late: list[int]) -> None:
    """Lateness below a period is told and forgotten: the rate stays exact (re-anchoring on now loses 2-6 %)."""
    bench = Bench()
    bench.time.oversleep = lambda n: late[n % len(late)]
    bench.run(80)
    expected = [START] + [START + n * PERIOD + late[(n - 1) % len(late)] for n in range(1, 80)]
    assert [now for now, _ in bench.ticks] == expected
    assert [late_ns for _, late_ns in bench.ticks] == [0] + [late[(n - 1) % len(late)] for n in range(1, 80)]


@given(st.lists(st.integers(0, 5 * PERIOD), min_size=1, max_size=30))
def test_missed_periods_are_skipped_and_counted_never_caught_up(stalls: list[int]) -> None:
    """After any stalls: one tick per instant of the grid at most, and ticks plus skipped instants are all of them."""
    bench = Bench()
    bench.time.oversleep = lambda n: stalls[n % len(stalls)]
    loop = bench.run(60)
    instants = [(now - START) // PERIOD for now, _ in bench.ticks]
    assert all(b > a for a, b in pairwise(instants))
    assert loop.ticks + loop.skipped == instants[-1] + 1
    assert loop.worst_late_ns == max(late for _, late in bench.ticks)


def test_a_long_stall_ends_in_one_tick_and_not_in_a_burst() -> None:
    """2 s away: one late tick, 200 skipped periods, then the old grid."""
    bench = Bench()
    bench.time.oversleep = lambda n: 2000 * MS if n == 4 else 0
    loop = bench.run(8)
    late_at = START + 5 * PERIOD + 2000 * MS
    assert bench.ticks[4:8] == [
        (START + 4 * PERIOD, 0),
        (late_at, 2000 * MS),
        (late_at + PERIOD, 0),
        (late_at + 2 * PERIOD, 0),
    ]
    assert loop.skipped == 200


def test_a_tick_that_computes_too_long_delays_nothing_but_itself() -> None:
    """Work of 25 ms in one tick: the next is late by 5 ms and two periods are gone, the one after is on the grid."""
    bench = Bench()

    def work(n: int, now_ns: int) -> Out:
        bench.time.now += 25 * MS if n == 3 else 0
        return Out()

    bench.on_tick = work
    loop = bench.run(6)
    at = [START + n * PERIOD for n in range(8)]
    assert bench.ticks == [(at[0], 0), (at[1], 0), (at[2], 0), (at[2] + 25 * MS, 15 * MS), (at[5], 0), (at[6], 0)]
    assert loop.skipped == 1


def test_a_sleep_that_ends_early_is_slept_to_its_end() -> None:
    """A signal may wake the thread: no tick comes before its instant."""
    bench = Bench()
    bench.time.oversleep = lambda n: -4 * MS if n % 2 == 0 else 0
    bench.run(5)
    assert bench.ticks == [(START + n * PERIOD, 0) for n in range(5)]
    assert len(bench.time.slept) > 4


# --------------------------------------------------------------------------------------------------- streams' own grids


def test_the_loop_wakes_for_a_stream_between_its_own_instants() -> None:
    """A stream at 70 Hz ticks every 14.29 ms, not at 10 or 20 ms, and the base grid stays where it is."""
    stream_ns = 1_000_000_000 // 70
    bench = Bench()
    bench.due = lambda now_ns: START + ((now_ns - START) // stream_ns + 1) * stream_ns
    loop = bench.run(41)
    base = {START + n * PERIOD for n in range(30)}
    stream = {START + n * stream_ns for n in range(30)}
    seen = [now for now, _ in bench.ticks]
    assert seen == sorted(base | stream)[:41]
    assert all(late == 0 for _, late in bench.ticks)
    assert loop.skipped == 0


@given(st.lists(st.integers(1, 40 * MS), min_size=1, max_size=20), st.lists(st.integers(0, 25 * MS), min_size=1))
def test_lateness_is_against_the_instant_that_was_meant(dues: list[int], stalls: list[int]) -> None:
    """Whatever streams ask for, no tick comes early, time goes on, and lateness tells which instant was meant."""
    bench = Bench()
    bench.time.oversleep = lambda n: stalls[n % len(stalls)]
    wanted: list[int] = [START]

    def due(now_ns: int) -> int:
        wanted.append(now_ns + dues[len(wanted) % len(dues)])
        return wanted[-1]

    bench.due = due
    bench.run(40)
    for n, (now, late) in enumerate(bench.ticks):
        assert late >= 0
        meant = now - late
        assert meant == wanted[n] or (meant - START) % PERIOD == 0
        assert meant <= wanted[n]
    assert all(b[0] > a[0] for a, b in pairwise(bench.ticks))


@pytest.mark.parametrize("behind_ns", [0, 1, 5 * MS])
def test_a_stream_that_stays_due_does_not_make_the_loop_spin(behind_ns: int) -> None:
    """An instant that the last tick covered is not waited for: a bug there costs a frame and no processor."""
    bench = Bench()
    bench.due = lambda now_ns: now_ns - behind_ns
    bench.run(20)
    assert bench.ticks == [(START + n * PERIOD, 0) for n in range(20)]


def test_a_late_wake_for_a_stream_skips_the_base_instants_it_passed() -> None:
    """One tick serves them all."""
    bench = Bench()
    bench.due = lambda now_ns: START + 4 * MS if now_ns == START else None
    bench.time.oversleep = lambda n: 30 * MS if n == 0 else 0
    loop = bench.run(3)
    assert bench.ticks == [(START, 0), (START + 34 * MS, 30 * MS), (START + 40 * MS, 0)]
    assert loop.skipped == 2


# ------------------------------------------------------------------------------------------------- the order of a cycle


def test_stops_come_first_then_the_robot_then_requests() -> None:
    """A stop waits for nobody; decisions about requests see the newest state. Inside each group the order stays."""
    bench = Bench()
    stop, estop = _request(Stop(), 2), _request(Estop(), 4)
    enable, recover = _request(Enable(epoch=1), 1), _request(Recover(), 3)
    seen = ClientSeen(client_id="a", at_ns=0)
    bench.from_clients = [enable, stop, seen, recover, estop]
    bench.from_robot = [SAMPLE, SAMPLE]
    bench.run(1)
    assert bench.received == [stop, estop, SAMPLE, SAMPLE, enable, seen, recover]


def test_every_event_is_received_once_before_the_tick_of_its_cycle() -> None:
    """Nothing is lost, nothing comes twice, nothing waits for the next cycle."""
    bench = Bench()
    bench.from_clients = [_request(Recover(), 1)]
    bench.from_robot = [SAMPLE]
    bench.run(2)
    assert bench.names() == [
        *("poll service", "poll link", "receive", "receive", "tick"),
        *("poll service", "poll link", "tick"),
    ]


def test_no_event_is_younger_than_the_instant_of_its_reception() -> None:
    """The clock is read after the polls: ages are never negative, and the lateness holds the polls too."""
    bench = Bench()

    class SlowLink:
        def poll(self) -> Sequence[Event]:
            bench.time.now += 3 * MS
            return [SampleArrived(topic="/fsm_state", value=2, received_ns=bench.time.now)]

        def publish(self, frame: Frame) -> None:
            raise AssertionError("nothing to publish")

        def show(self, claim: int) -> None:
            assert claim == 0

    loop = bench.loop()
    loop._link = SlowLink()
    loop.run(lambda: len(bench.ticks) >= 3)
    assert [now - START for now, _ in bench.ticks] == [3 * MS, 13 * MS, 23 * MS]
    assert [late for _, late in bench.ticks] == [3 * MS] * 3
    instants = [entry[2] for entry in bench.log if entry[0] == "receive"]
    assert all(event.received_ns <= now for event, now in zip(bench.received, instants, strict=True))


def test_the_claim_of_every_tick_is_shown() -> None:
    """Also that of a tick without frames: others must see it before the first one."""
    bench = Bench()
    bench.on_tick = lambda n, now_ns: Out(claim=n // 2, done=n == 4)
    bench.loop().run(lambda: False)
    assert bench.claims == [0, 1, 1, 2]


def test_the_results_of_a_tick_leave_in_their_order() -> None:
    """Frames as given, then replies and notices, then what must be remembered, then the snapshot."""
    bench = Bench()
    remembered, snapshot = Remembered(epoch=1), object()
    bench.on_tick = lambda n, now_ns: Out(
        frames=[_frame("arm"), _frame("gripper"), _frame("fsm")],
        replies=[REPLY],
        notices=[NOTICE],
        remembered=remembered,
        snapshot=snapshot,
    )
    bench.run(1)
    assert bench.log[3:] == [
        ("publish arm",),
        ("publish gripper",),
        ("publish fsm",),
        ("send", (REPLY,), (NOTICE,)),
        ("remember", remembered),
        ("snapshot", snapshot),
    ]


def test_who_must_know_of_every_cycle_is_told_at_its_end() -> None:
    """A watchdog proves that the cycle came to its end: with its time, after the last result, and not when it broke."""
    bench = Bench(is_watched=True)
    bench.on_tick = lambda n, now_ns: Out(frames=[_frame("arm")], snapshot=object())
    bench.run(3)
    assert [entry for entry in bench.log if entry[0] == "cycle"] == [("cycle", START + n * PERIOD) for n in range(3)]
    assert bench.names()[4:6] == ["snapshot", "cycle"] and bench.names()[-1] == "cycle"
    broken = Bench(is_watched=True, broken={"tick": ZeroDivisionError()})
    with pytest.raises(ZeroDivisionError):
        broken.run(1)
    assert "cycle" not in broken.names()


@pytest.mark.parametrize("out", [Out(replies=[REPLY]), Out(notices=[NOTICE])])
def test_replies_go_without_notices_and_notices_without_replies(out: Out) -> None:
    """Either alone is enough."""
    bench = Bench()
    bench.on_tick = lambda n, now_ns: out
    bench.run(1)
    assert bench.log[3:] == [("send", tuple(out.replies), tuple(out.notices))]


def test_a_tick_without_results_tells_nobody() -> None:
    """Most ticks have nothing for the clients."""
    bench = Bench()
    bench.run(1)
    assert bench.names() == ["poll service", "poll link", "tick"]


@pytest.mark.parametrize("level", Level)
def test_notices_are_logged_with_code_and_facts(level: Level, caplog: pytest.LogCaptureFixture) -> None:
    """The core does not log: the loop does it, as loud as the notice is."""
    bench = Bench()
    notice = Notice(code=Code.WALK, level=level, message="100 % done", at_ns=0, facts={"side": "left"})
    bench.on_tick = lambda n, now_ns: Out(notices=[notice])
    with caplog.at_level(logging.DEBUG, logger="gateway.process.loop"):
        bench.run(1)
    (record,) = caplog.records
    assert record.levelname == level.name
    assert record.getMessage() == "WALK: 100 % done"
    assert (record.code, record.facts) == ("WALK", {"side": "left"})


def test_a_suspend_is_received_before_anything_else() -> None:
    """All that was believed before is old: even a stop is judged after it."""
    bench = Bench()
    bench.sleeps = [0, 7_000 * MS]
    bench.on_tick = lambda n, now_ns: bench.from_clients.append(_request(Stop())) or Out()
    bench.run(3)
    assert bench.received[0] == Suspended(slept_ns=7_000 * MS, at_ns=START + PERIOD)
    assert [type(event).__name__ for event in bench.received] == ["Suspended", "CommandRequested", "CommandRequested"]


# -------------------------------------------------------------------------------------------------------------- the end


def test_the_loop_ends_when_the_engine_is_done_after_its_last_results_left() -> None:
    """The last stop frames, replies and the last snapshot are not lost."""
    bench = Bench()
    last = Out(frames=[_frame("fsm")], replies=[REPLY], remembered=Remembered(), snapshot=object(), done=True)
    bench.on_tick = lambda n, now_ns: last if n == 3 else Out()
    bench.loop().run(lambda: False)
    assert len(bench.ticks) == 3
    assert bench.names()[-4:] == ["publish fsm", "send", "remember", "snapshot"]


def test_the_loop_ends_before_the_next_cycle_when_told() -> None:
    """`stop` is the hard end: no further tick, no further poll."""
    bench = Bench()
    bench.loop().run(lambda: True)
    assert bench.log == []


def test_a_clean_end_is_an_event_like_any_other() -> None:
    """`ExitRequested` comes through the service; the engine decides when it is done."""
    bench = Bench()
    bench.from_clients = [ExitRequested(at_ns=0)]
    bench.on_tick = lambda n, now_ns: Out(done=n == 5 and isinstance(bench.received[0], ExitRequested))
    bench.loop().run(lambda: False)
    assert len(bench.ticks) == 5


BUG = ZeroDivisionError("a bug")
PLACES = ["poll service", "poll link", "receive", "tick", "publish arm", "send", "remember", "snapshot"]


@pytest.mark.parametrize("place", PLACES)
def test_an_error_anywhere_sends_the_stop_frames_and_goes_on_to_the_daemon(
    place: str, caplog: pytest.LogCaptureFixture
) -> None:
    """The robot is stopped before anybody looks at the error; nothing is swallowed."""
    bench = Bench(panic=[_frame("chassis"), _frame("lift"), _frame("fsm")])
    bench.from_robot = [SAMPLE]
    bench.on_tick = lambda n, now_ns: Out(
        frames=[_frame("arm")], replies=[REPLY], remembered=Remembered(), snapshot=object()
    )
    bench.broken[place] = BUG
    with caplog.at_level(logging.ERROR, logger="gateway.process.loop"), pytest.raises(ZeroDivisionError) as raised:
        bench.run(5)
    assert raised.value is BUG
    assert bench.names()[-5:] == [place, "panic_frames", "publish chassis", "publish lift", "publish fsm"]
    assert len(bench.ticks) <= 1
    assert [record.exc_info[1] for record in caplog.records] == [BUG]


def test_what_leaves_is_shown_to_the_guard_before_it_leaves() -> None:
    """Killed between the two, a sent setpoint or a sent 1.0 is never taken for unsent: a lost one is no harm."""
    bench = Bench(is_guarded=True, panic=[_frame("fsm")])
    bench.on_tick = lambda n, now_ns: Out(frames=[_frame("arm"), _frame("fsm")])
    bench.run(1)
    assert bench.log[-3:] == [("show", START), ("publish arm",), ("publish fsm",)]
    bench.broken["tick"] = BUG
    with pytest.raises(ZeroDivisionError):
        bench.run(5)
    assert bench.names()[-3:] == ["panic_frames", "show", "publish fsm"]


class Panic(BaseException):
    """What a panic in a compiled extension looks like (pyo3's `PanicException`): no `Exception`."""


@pytest.mark.parametrize("place", PLACES)
def test_a_panic_of_an_extension_sends_the_stop_frames_too(place: str) -> None:
    """What is no `Exception` leaves a robot in motion behind just the same."""
    bench = Bench(panic=[_frame("fsm")])
    bench.from_robot = [SAMPLE]
    bench.on_tick = lambda n, now_ns: Out(
        frames=[_frame("arm")], replies=[REPLY], remembered=Remembered(), snapshot=object()
    )
    bench.broken[place] = Panic("unwrap on a None value")
    with pytest.raises(Panic):
        bench.run(5)
    assert bench.names()[-2:] == ["panic_frames", "publish fsm"]


def test_a_stop_frame_that_cannot_be_sent_does_not_keep_the_others_back() -> None:
    """Each is tried, in order; the first error is the one that is raised, the other stays visible behind it."""
    bench = Bench(panic=[_frame("chassis"), _frame("lift"), _frame("fsm")])
    bench.broken = {"tick": BUG, "publish chassis": OSError("no link"), "publish fsm": OSError("no link")}
    with pytest.raises(ZeroDivisionError) as raised:
        bench.run(1)
    assert raised.value is BUG
    assert bench.names()[-3:] == ["publish chassis", "publish lift", "publish fsm"]
    assert isinstance(raised.value.__context__, OSError)


def test_an_engine_that_cannot_even_give_stop_frames_does_not_hide_the_first_error() -> None:
    """The first error is the one to look at."""
    bench = Bench()
    bench.broken = {"tick": BUG, "panic_frames": RuntimeError("again")}
    with pytest.raises(ZeroDivisionError):
        bench.run(1)


def test_an_error_in_the_question_whether_to_stop_stops_the_robot_too() -> None:
    """No part of the loop is outside of the guard."""
    bench = Bench(panic=[_frame("fsm")])

    def ask() -> bool:
        raise BUG

    with pytest.raises(ZeroDivisionError):
        bench.loop().run(ask)
    assert bench.names() == ["panic_frames", "publish fsm"]


# -------------------------------------------------------------------------------------------------------------- rest


def test_at_rest_ticks_are_as_far_apart_as_the_engine_allows() -> None:
    """On instants of its grid that are multiples of the rest; none of those in between counts as skipped."""
    bench = Bench()
    bench.rest = lambda now_ns: 50 * MS
    loop = bench.run(5)
    later = (START // (50 * MS) + 1) * 50 * MS
    assert bench.ticks == [(START, 0)] + [(later + n * 50 * MS, 0) for n in range(4)]
    assert loop.skipped == 0


@pytest.mark.parametrize("after_ms", [0, 3, 10, 27, 44])
def test_a_request_ends_the_rest_at_the_next_instant_of_the_grid(after_ms: int) -> None:
    """It waits as long as ever: at most one period, and a flood of requests makes no more ticks than there are instants."""
    bench = Bench()
    bench.rest = lambda now_ns: 50 * MS
    asked = START + 10 * MS + after_ms * MS  # behind the first instant of the rest
    bench.asked_at = [asked, asked + 1, asked + 2]
    bench.run(3)
    assert bench.ticks[2] == ((asked // PERIOD + 1) * PERIOD, 0)


def test_the_rest_ends_when_the_engine_says_so() -> None:
    """From the tick on that begins to do something, every instant counts again."""
    bench = Bench()
    bench.rest = lambda now_ns: 50 * MS if len(bench.ticks) < 2 else 0
    bench.run(5)
    woken = bench.ticks[1][0]
    assert [now_ns for now_ns, _ in bench.ticks[1:]] == [woken + n * PERIOD for n in range(4)]


@pytest.mark.parametrize("rest_ms", [0, 5, 10, 14])
def test_a_rest_of_no_more_than_a_period_is_none(rest_ms: int) -> None:
    """The base grid is kept, and nobody waits for requests."""
    bench = Bench()
    bench.rest = lambda now_ns: rest_ms * MS
    bench.run(4)
    assert bench.ticks == [(START + n * PERIOD, 0) for n in range(4)]
    assert "wait" not in bench.names()


def test_a_late_tick_at_rest_is_late_against_the_instant_that_was_meant() -> None:
    """A rest is no lateness; what comes after it is."""
    bench = Bench()
    bench.rest = lambda now_ns: 50 * MS
    wait = bench.wait

    def oversleep(seconds: float) -> bool:
        woken = wait(seconds)
        bench.time.now += 7 * MS
        return woken

    bench.wait = oversleep  # type: ignore[method-assign]  # a service that wakes late
    bench.run(3)
    assert [late_ns for _, late_ns in bench.ticks] == [0, 7 * MS, 7 * MS]


# ----------------------------------------------------------------------------------------------------- the real clock


def test_a_stop_is_served_at_once_between_the_instants_of_the_grid() -> None:
    """A tick of its own, which is not late, with stops alone; the grid stays where it was. One right behind it waits 2 ms."""
    bench = Bench()
    first = (START // PERIOD + 3) * PERIOD
    bench.time.stop_at = [first + 3 * MS, first + 3 * MS + 100_000, first + 3 * MS + 200_000]
    bench.run(8)
    instants = [at for at, _ in bench.ticks]
    assert all(late == 0 for _, late in bench.ticks)
    assert [at for at in instants if at % PERIOD] == [first + 3 * MS, first + 5 * MS]
    assert first in instants and first + PERIOD in instants
    assert bench.names().count("poll stops") == 2


def test_with_the_real_clock_the_grid_is_kept_on_the_whole() -> None:
    """Defaults for clock, sleep and watch: every tick is on it, and those that it skipped are counted, however late it came."""
    bench = Bench()
    loop = Loop(bench, bench.loop()._link, bench.loop()._service, on_remembered=bench.remember, period_ns=5 * MS)
    begun = time.monotonic_ns()
    loop.run(lambda: time.monotonic_ns() - begun > 300 * MS)
    ended = time.monotonic_ns()
    assert bench.received == [] and loop.ticks == len(bench.ticks)
    assert all(late >= 0 for _, late in bench.ticks)
    instants = [at - late for at, late in bench.ticks]
    periods = [(after - before) / (5 * MS) for before, after in pairwise(instants)]
    assert all(count >= 1 and count == int(count) for count in periods), periods
    assert sum(periods) <= loop.ticks + loop.skipped - 1 <= (ended - instants[0]) / (5 * MS)


def test_the_loop_runs_in_any_thread_and_ends_there() -> None:
    """The daemon starts it in a thread of its own."""
    bench = Bench()
    bench.on_tick = lambda n, now_ns: Out(done=n == 3)
    thread = threading.Thread(target=bench.loop().run, args=(lambda: False,))
    thread.start()
    thread.join(10)
    assert not thread.is_alive()
    assert len(bench.ticks) == 3


def test_the_loop_has_the_only_sleep() -> None:
    """One call of the injected sleep in the module, and the real one is only its default."""
    calls = [
        ast.unparse(n.func) for n in ast.walk(ast.parse(inspect.getsource(loop_module))) if isinstance(n, ast.Call)
    ]
    assert calls.count("self._sleep") == 1
    assert "time.sleep" not in calls
