"""The one thread that owns the engine: an absolute grid, the only sleep, and the order of things in a cycle.

Rules it obeys
    * The grid is absolute: a late cycle never moves the next one. Whole periods that were missed are skipped and
      counted, never caught up: a burst of setpoints would compress a path in time. (Sleeping relative to now loses
      2-6 % of the rate; measured.)
    * At rest (`Engine.rest_ns`) ticks are further apart, on instants of the base grid; a request is served at its next
      instant all the same. A daemon that nobody uses costs as little as it can.
    * Streams have grids of their own. The loop wakes at the earliest of them and of its own grid. All grids lie on
      multiples of their periods, so that instants which can fall together do.
    * A stop ends the sleep: it is served at once, by a tick of its own between the instants of the grids.
    * In a cycle: stop requests first, then what came from the robot, then all other requests, so that decisions see the
      newest state. Then one tick, and its results in this order: frames, replies and notices, what must be remembered,
      the snapshot.
    * The clock is read after the polls: no event is younger than the instant at which the engine receives it.
    * An error of any part ends the loop: the engine's stop frames leave first, then the error goes on to the daemon.

It knows neither zenoh nor the client protocol; those are the ports below. Real-time measures
of its thread are taken by whoever starts it (`realtime.sharpen_timer`).
"""

from __future__ import annotations

import contextlib
import logging
import time
from collections.abc import Callable, Sequence
from typing import Protocol

from gateway.core.engine import Output
from gateway.core.messages.events import CommandRequested, Event, Suspended
from gateway.core.messages.outputs import Level, Notice, Remembered, Reply
from gateway.core.streams.gate import Cleared
from gateway.messages.requests import Estop, Stop
from gateway.messages.snapshot import Snapshot
from gateway.process.realtime import SleepWatch

__all__ = ["Engine", "Link", "Loop", "Service"]

_log = logging.getLogger(__name__)

MS = 1_000_000
PERIOD_NS = 10 * MS
"""100 Hz, the rate of the joint stream (§4.3: 50 Hz or more)."""

STOPS_APART_NS = 2 * MS
"""A stop is served at once, unless the last tick was less than this ago [ns]."""

LEVELS = {Level.INFO: logging.INFO, Level.WARNING: logging.WARNING, Level.ERROR: logging.ERROR}


class Engine(Protocol):
    """The brain, see `core/engine.py`, or the black box around it."""

    def receive(self, event: Event, now_ns: int) -> None:
        """Take an event."""

    def tick(self, now_ns: int, *, late_ns: int) -> Output:
        """Give everything that is due at `now_ns`, `late_ns` after the instant that was meant."""

    def next_due_ns(self) -> int | None:
        """Return when the earliest stream wants a tick; None when none runs."""

    @property
    def rest_ns(self) -> int:
        """How far apart ticks may be as long as no request comes [ns]; 0 when each instant of the grid counts."""

    def panic_frames(self, now_ns: int) -> Sequence[Cleared]:
        """Return stop frames for the case that the engine cannot go on."""


class Link(Protocol):
    """The robot's side; see `link/robot_link.py`."""

    def poll(self) -> Sequence[Event]:
        """Return what came since the last call. Never waits."""
        ...

    def publish(self, frame: Cleared) -> None:
        """Send a frame. Never waits."""
        ...

    def show(self, claim: int) -> None:
        """Let other gateways see a claim to command the robot; 0 for none. Never waits."""
        ...


class Service(Protocol):
    """The clients' side; see `api/service.py`. No call but `wait` and `wait_for_stop` may wait."""

    def poll(self) -> Sequence[Event]:
        """Return what came since the last call."""
        ...

    def poll_stops(self) -> Sequence[Event]:
        """Return the stops that arrived since the last call, and nothing else."""
        ...

    def wait(self, seconds: float) -> bool:
        """Wait for a request, at most so long; return whether there is one."""
        ...

    def wait_for_stop(self, seconds: float) -> bool:
        """Wait for a stop, at most so long; return whether there is one."""
        ...

    def send(self, replies: Sequence[Reply], notices: Sequence[Notice]) -> None:
        """Answer and tell."""
        ...

    def publish_snapshot(self, snapshot: Snapshot) -> None:
        """Show the state."""
        ...


class Loop:
    """Runs the engine until it is done.

    Args:
        engine: The brain; nobody else may call it.
        link: The robot's side.
        service: The clients' side.
        on_remembered: Takes what must survive a restart; must not wait for the disk.
        on_sending: Called in every cycle before its frames leave, with its time [ns]: whoever goes on when this process
            dies between the two takes a frame for sent that is lost, never a sent one, or a 1.0, for unsent.
        on_cycle: Called at the end of every cycle, with its time [ns], for whoever must know that there was one.
        period_ns: Period of the base grid [ns].
        clock: Monotonic clock [ns].
        sleep: Sleeps for a time [s]; may end early, and says whether it did so for a stop. None waits for one.
        sleep_watch: Tells of suspends; None for the host's clocks.
    """

    def __init__(
        self,
        engine: Engine,
        link: Link,
        service: Service,
        *,
        on_remembered: Callable[[Remembered], None],
        on_sending: Callable[[int], None] = lambda now_ns: None,
        on_cycle: Callable[[int], None] | None = None,
        period_ns: int = PERIOD_NS,
        clock: Callable[[], int] = time.monotonic_ns,
        sleep: Callable[[float], bool | None] | None = None,
        sleep_watch: SleepWatch | None = None,
    ) -> None:
        self._engine = engine
        self._link = link
        self._service = service
        self._on_remembered = on_remembered
        self._on_sending = on_sending
        self._on_cycle = on_cycle
        self._period_ns = period_ns
        self._clock = clock
        self._sleep = service.wait_for_stop if sleep is None else sleep
        self._ticked_ns = 0
        self._watch = SleepWatch() if sleep_watch is None else sleep_watch
        self.ticks = 0
        """Ticks run."""
        self.skipped = 0
        """Periods of the base grid that passed without a tick of their own."""
        self.worst_late_ns = 0
        """Worst lateness of a tick since the start [ns]."""

    def run(self, stop: Callable[[], bool]) -> None:
        """Run until the engine is done, or `stop` says so.

        Args:
            stop: Asked before every cycle; True ends the loop at once, without another tick. A clean end is an
                `ExitRequested` event instead, after which the engine says when it is done.

        Raises:
            BaseException: Whatever a part raised, after the engine's stop frames left.
        """
        try:
            self._run(stop)
        except BaseException as error:  # noqa: BLE001  any bug, a panic of a compiled part too: stop, raise it again
            _log.exception("the control loop ends by an error; its stop frames leave now")
            try:
                self._publish_panic_frames()
            finally:
                raise error  # the first error is the one to look at; a second one stays visible as its context

    def _run(self, stop: Callable[[], bool]) -> None:
        grid_ns = (self._clock() // self._period_ns + 1) * self._period_ns
        deadline_ns = grid_ns
        done = is_resting = False
        while not done and not stop():
            if is_resting:
                deadline_ns = grid_ns = self._rest_until(grid_ns)
            is_early = self._sleep_until(deadline_ns)
            urgent, others = self._poll(is_early)
            now_ns = self._ticked_ns = self._clock()
            if now_ns >= grid_ns:
                missed = (now_ns - grid_ns) // self._period_ns
                self.skipped += missed
                grid_ns += (missed + 1) * self._period_ns
            done = self._cycle(urgent + others, now_ns, max(now_ns - deadline_ns, 0))
            rest_ns = self._engine.rest_ns // self._period_ns * self._period_ns
            is_resting = rest_ns > self._period_ns
            if is_resting:
                grid_ns = (now_ns // rest_ns + 1) * rest_ns
            deadline_ns = self._next_deadline_ns(now_ns, grid_ns)

    def _rest_until(self, deadline_ns: int) -> int:
        """Wait until then, or for a request; return the instant of the base grid at which to tick."""
        while (rest_ns := deadline_ns - self._clock()) > 0:
            if self._service.wait(rest_ns / 1e9):
                return min(deadline_ns, (self._clock() // self._period_ns + 1) * self._period_ns)
        return deadline_ns

    def _sleep_until(self, deadline_ns: int) -> bool:
        """Sleep until then, or until a stop comes; return whether one did.

        Stops that come one upon the other are served together: a flood of them must not keep this thread from all else.
        """
        until_ns = deadline_ns
        while (rest_ns := until_ns - self._clock()) > 0:
            if self._sleep(rest_ns / 1e9):
                until_ns = min(self._ticked_ns + STOPS_APART_NS, deadline_ns)
        return self._clock() < deadline_ns

    def _poll(self, is_early: bool) -> tuple[list[Event], list[Event]]:
        """Return stop requests, and everything else in the order in which it is to be received.

        Args:
            is_early: Whether a stop ended the sleep: other requests wait for the instant of the grid.
        """
        requests = self._service.poll_stops() if is_early else self._service.poll()
        urgent = [event for event in requests if _is_stop(event)]
        return urgent, [*self._link.poll(), *(event for event in requests if not _is_stop(event))]

    def _cycle(self, events: Sequence[Event], now_ns: int, late_ns: int) -> bool:
        """Receive, tick and hand out; return whether the engine is done."""
        engine = self._engine
        slept_ns = self._watch.slept_ns()
        if slept_ns > 0:  # before anything else: all that was believed before is old now
            engine.receive(Suspended(slept_ns=slept_ns, at_ns=now_ns), now_ns)
        for event in events:
            engine.receive(event, now_ns)
        output = engine.tick(now_ns, late_ns=late_ns)
        self.ticks += 1
        self.worst_late_ns = max(self.worst_late_ns, late_ns)
        self._on_sending(now_ns)
        for frame in output.frames:
            self._link.publish(frame)
        self._link.show(output.claim)
        for notice in output.notices:
            facts = {"code": notice.code.value, "facts": dict(notice.facts)}
            _log.log(LEVELS[notice.level], "%s: %s", notice.code, notice.message, extra=facts)
        if output.replies or output.notices:
            self._service.send(output.replies, output.notices)
        if output.remembered is not None:
            self._on_remembered(output.remembered)
        if output.snapshot is not None:
            self._service.publish_snapshot(output.snapshot)
        if self._on_cycle is not None:
            self._on_cycle(now_ns)
        return output.done

    def _next_deadline_ns(self, now_ns: int, grid_ns: int) -> int:
        """Return when to tick again: at the base grid, or earlier for a stream.

        An instant that this tick already covered is not waited for: the loop must not spin on a stream that stays due.
        """
        due_ns = self._engine.next_due_ns()
        return grid_ns if due_ns is None or due_ns <= now_ns else min(grid_ns, due_ns)

    def _publish_panic_frames(self) -> None:
        """Send the engine's stop frames, each of them whatever happens to the others."""
        now_ns = self._clock()
        frames = self._engine.panic_frames(now_ns)
        with contextlib.ExitStack() as every_one:  # runs all of them, the last pushed first
            for frame in reversed(frames):
                every_one.callback(self._link.publish, frame)
            every_one.callback(self._on_sending, now_ns)


def _is_stop(event: Event) -> bool:
    return isinstance(event, CommandRequested) and isinstance(event.request, (Stop, Estop))
