"""The simulated robot as a process: the pure model on an absolute 200 Hz grid behind the simulated bridge.

One thread owns model and bridge; zenoh's threads only stamp and enqueue. Commands are taken in the order and with
the times of their arrival. A late cycle skips grid points and never sends a burst. Bytes that are no message of the
topic's type are journalled and ignored, as a Fast DDS reader ignores them (wire reference §3.2).

The faults of scope `node` live here: the router's end and return, a frozen process, dead routes, a lost robot node.
"""

from __future__ import annotations

import contextlib
import ctypes
import errno
import gc
import os
import subprocess
import sys
import time
from collections import deque
from collections.abc import Callable
from typing import Final

import zenoh

from gateway.process.zenoh_words import in_words
from gateway.sim.bridge import CONTROL_KEY, Bridge
from gateway.sim.companion import until_told
from gateway.sim.control import Control
from gateway.sim.robot.faults import Fault
from gateway.sim.robot.manual import MS, S
from gateway.sim.robot.model import SimRobot
from gateway.sim.robot.parts import WorldUnstable
from gateway.sim.robot.settings import SimSettings
from gateway.sim.wire import Wire

__all__ = ["DEFAULT_LISTEN", "SimNode", "main_sim", "run"]

DEFAULT_LISTEN: Final = "tcp/127.0.0.1:9000"
_REOPEN_TRIES: Final = 100
_LINES_PER_S: Final = 10
_SET_NS: Final = 10 * MS  # a wall clock that is further off than this was set
_PR_SET_TIMERSLACK: Final = 29


class SimNode:
    """A robot and its bridge.

    Attributes:
        robot: The model.
        is_ending: Somebody asked for the end over the control channel.
    """

    def __init__(
        self,
        settings: SimSettings,
        listen: str = DEFAULT_LISTEN,
        clock: Callable[[], int] = time.monotonic_ns,
        wall_clock: Callable[[], int] = time.time_ns,
    ) -> None:
        """Listen and announce the robot.

        Args:
            settings: What to simulate.
            listen: Endpoint of the router.
            clock: Monotonic time [ns].
            wall_clock: What the robot's clock goes by [ns since 1970].

        Raises:
            zenoh.ZError: If the endpoint cannot be listened on.
        """
        self._listen, self._clock, self._wall_clock = listen, clock, wall_clock
        self._namespace = settings.namespace
        self.robot = SimRobot(settings, start_ns=clock(), epoch_ns=wall_clock() - clock())
        self.is_ending = False
        self._control = Control(self.robot, self)
        self._timed: list[tuple[Fault, int]] = []
        self._reopen_ns: int | None = None
        self._reopen_tries = 0
        self._freezer: subprocess.Popen[bytes] | None = None
        self._bridge: Wire | None = self._open()

    def _open(self) -> Wire:
        return Bridge(self._listen, self.robot.states, self.robot.commands, self._clock, self._namespace)

    # --------------------------------------------------------------------------------------------------------- cycle

    def step(self, now_ns: int) -> None:
        """Take what has arrived, let the robot live until now, publish what is due."""
        self._end_faults(now_ns)
        self._follow_wall_clock()
        self.robot.dynamics.shed(now_ns)
        bridge = self._bridge
        if bridge is None:
            self.robot.advance(now_ns, latest_only=True, topics=())
            self._reopen(now_ns)
            return
        while bridge.arrivals:
            arrival = bridge.arrivals.popleft()
            self._take(bridge, arrival.topic, arrival.payload, arrival.now_ns)
        for topic, message in self.robot.advance(now_ns, latest_only=True, topics=bridge.wanted()):
            bridge.publish(topic, message)
        while bridge.queries and self._bridge is bridge:
            self._answer(bridge, bridge.queries.popleft(), now_ns)

    def _follow_wall_clock(self) -> None:
        """Set the robot's clock when its host's was set, or the host slept; not for what passes between two looks at clocks."""
        before_ns = self._clock()
        epoch_ns = self._wall_clock() - before_ns
        if abs(epoch_ns - self.robot.clock.epoch_ns) > _SET_NS > self._clock() - before_ns:
            self.robot.clock.epoch_ns = epoch_ns

    def _take(self, bridge: Wire, topic: str, payload: bytes | None, arrival_ns: int) -> None:
        if payload is None:
            self.robot.journal.note(arrival_ns, "DELETE_ON_COMMAND", topic, "a zenoh DELETE is no message")
            return
        try:
            message = bridge.read(topic, payload)
        except ValueError as error:
            self.robot.journal.note(arrival_ns, "INVALID_CDR", topic, str(error))
            return
        self.robot.receive(topic, message, arrival_ns)

    def _answer(self, bridge: Wire, query: zenoh.Query, now_ns: int) -> None:
        with query:
            if str(query.key_expr) != CONTROL_KEY:
                bridge.answer(query)
                return
            text = query.payload.to_string() if query.payload is not None else "{}"
            query.reply(CONTROL_KEY, self._control.answer(text, now_ns), express=True)

    # -------------------------------------------------------------------------------------------------------- faults

    def begin(self, fault: Fault, now_ns: int) -> None:
        """Let a node fault act from now on; without a duration the router's absence and a freeze last 1 s."""
        self.robot.journal.note(now_ns, "FAULT", fault.name, fault.details)
        duration_s = fault.duration_s
        if fault.name == "router_stop":
            self._reopen_ns = now_ns + round((duration_s or 1.0) * S)
            self._reopen_tries = 0
        elif fault.name == "frozen":
            self._freeze(duration_s or 1.0)
        else:
            until_ns = sys.maxsize if duration_s is None else now_ns + round(duration_s * S)
            self._timed.append((fault, until_ns))
            self._apply(fault, is_on=True)

    def clear(self, name: str | None, topic: str | None) -> int:
        """End dead routes and a lost node; return how many ended."""
        ended = [
            (fault, until_ns)
            for fault, until_ns in self._timed
            if name in (None, fault.name) and topic in (None, fault.topic)
        ]
        for fault, until_ns in ended:
            self._timed.remove((fault, until_ns))
            self._apply(fault, is_on=False)
        return len(ended)

    def shut_down(self) -> None:
        """End the node after this cycle."""
        self.is_ending = True

    def _end_faults(self, now_ns: int) -> None:
        for fault, until_ns in [timed for timed in self._timed if timed[1] <= now_ns]:
            self._timed.remove((fault, until_ns))
            self._apply(fault, is_on=False)
        if self._bridge is not None and self._reopen_ns is not None:
            self._bridge.close()
            self._bridge = None

    def _apply(self, fault: Fault, *, is_on: bool) -> None:
        if self._bridge is None:
            return
        if fault.name == "route_dead":
            self._bridge.set_dead(fault.topic, is_dead=is_on)
        elif is_on:
            self._bridge.retire()
        else:
            self._bridge.announce()

    def _reopen(self, now_ns: int) -> None:
        """Listen again when it is time; the port may need a moment to become free."""
        if self._reopen_ns is None or now_ns < self._reopen_ns:
            return
        self._reopen_tries += 1
        try:
            self._bridge = self._open()
        except zenoh.ZError:
            if self._reopen_tries >= _REOPEN_TRIES:
                raise
            self._reopen_ns = now_ns + 50 * MS
            return
        self._reopen_ns = None
        for fault, _ in self._timed:
            self._apply(fault, is_on=True)

    def _freeze(self, duration_s: float) -> None:
        """Have this whole process stopped and continued by a child: nothing of it runs, its sockets fill up."""
        companions = () if self._bridge is None else self._bridge.companions()
        pids = " ".join(map(str, (os.getpid(), *companions)))
        script = f"sleep 0.05; kill -STOP {pids}; sleep {duration_s}; kill -CONT {pids}"
        self._freezer = subprocess.Popen(["/bin/sh", "-c", script], start_new_session=True)

    def close(self) -> None:
        """End the session and what was started; safe to call twice."""
        if self._bridge is not None:
            self._bridge.close()
            self._bridge = None
        if self._freezer is not None:
            self._freezer.wait()
            self._freezer = None


def run(
    settings: SimSettings,
    listen: str = DEFAULT_LISTEN,
    *,
    should_stop: Callable[[], bool],
    ready: Callable[[], None] | None = None,
    write: Callable[[str], None] | None = None,
    make: Callable[[SimSettings, str], SimNode] = SimNode,
) -> None:
    """Run a simulated robot in the calling thread until asked to stop.

    `write` takes lines for people: where it listens, and the robot's log, at most ten lines a second.

    Raises:
        zenoh.ZError: If the endpoint cannot be listened on.
    """
    _tighten_timer()
    switch_interval_s = sys.getswitchinterval()
    node = make(settings, listen)
    try:
        lines = _Lines(node.robot, write)
        lines.say(f"listening on {listen}")
        if ready is not None:
            ready()
        sys.setswitchinterval(0.0005)  # an arrival is stamped by another thread: it must not wait 5 ms for this one
        gc.collect()
        gc.freeze()
        node.robot.dynamics.begin(time.monotonic_ns())
        while not (should_stop() or node.is_ending):
            ahead_ns = node.robot.next_state_ns - time.monotonic_ns()
            if ahead_ns > 0:
                time.sleep(ahead_ns / S)
            now_ns = time.monotonic_ns()
            node.step(now_ns)
            lines.follow(now_ns)
    finally:
        node.close()
        gc.unfreeze()
        sys.setswitchinterval(switch_interval_s)


class _Lines:
    """Hands new entries of the robot's log to people, ten a second at most."""

    def __init__(self, robot: SimRobot, write: Callable[[str], None] | None) -> None:
        self._journal, self._write = robot.journal, write
        self._number = 0
        self._said_ns: deque[int] = deque(maxlen=_LINES_PER_S)

    def say(self, line: str) -> None:
        if self._write is not None:
            self._write(line)

    def follow(self, now_ns: int) -> None:
        entries = self._journal.entries
        if not entries or entries[-1].number == self._number:
            return
        for entry in self._journal.since(self._number):
            if len(self._said_ns) < _LINES_PER_S or now_ns - self._said_ns[0] >= S:
                self._said_ns.append(now_ns)
                self.say(f"{entry.code}: {entry.text}")
        self._number = entries[-1].number


def main_sim(
    listen: str = DEFAULT_LISTEN,
    settings: SimSettings | None = None,
    ready: Callable[[], None] | None = None,
    make: Callable[[SimSettings, str], SimNode] = SimNode,
) -> int:
    """Run a simulated robot until SIGINT or SIGTERM, telling people what happens; return the exit code.

    Without settings it is a standard robot.
    """

    def write(line: str) -> None:
        with contextlib.suppress(BrokenPipeError):  # nobody reads any more; the robot goes on
            sys.stdout.write(f"{line}\n")
            sys.stdout.flush()

    try:
        with until_told() as should_stop:
            run(settings or SimSettings(), listen, should_stop=should_stop, ready=ready, write=write, make=make)
    except zenoh.ZError as error:
        is_taken = f"(os error {errno.EADDRINUSE})" in str(error)
        hint = "Another simulation or a bridge may use this port already.\n" if is_taken else ""
        sys.stderr.write(f"cannot listen on {listen}: {in_words(error)}\n{hint}")
        return 1
    except WorldUnstable as error:
        sys.stderr.write(f"{error}\n")
        return 1
    return 0


def _tighten_timer() -> None:
    """Let this thread's sleeps end within a nanosecond instead of 50 µs of their time, where Linux offers it."""
    with contextlib.suppress(OSError, AttributeError):
        ctypes.CDLL(None).prctl(_PR_SET_TIMERSLACK, 1, 0, 0, 0)
