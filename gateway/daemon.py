"""The daemon's composition root: builds everything, starts it in order, runs the loop, ends it in order.

    locks -> state file -> engine -> local plane -> robot link -> real-time measures -> loop -> the same way back

One daemon per robot. It ends by SIGTERM or Ctrl-C: the engine brakes, sends what it owes and says when it is done,
within 5 s. Nothing here decides anything about the robot.
"""

from __future__ import annotations

import contextlib
import json
import logging
import os
import queue
import signal
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from types import FrameType

from gateway.api import protocol
from gateway.api.service import LocalPlane
from gateway.config import state_dir
from gateway.core.engine import Engine
from gateway.core.events import Event, ExitRequested, LinkUp, Notice, Reply
from gateway.core.snapshot import Snapshot
from gateway.link.robot_link import RobotLink
from gateway.loop import Loop
from gateway.realtime import FifoScheduling, Linux, calm_interpreter, lock_memory, release_interpreter, sharpen_timer
from gateway.settings import Settings
from gateway.state_file import StateFile, StateWriter, path_of

__all__ = ["JsonLines", "LogWriter", "RateLimit", "configure_log", "run"]

_log = logging.getLogger(__name__)

DISK_TIMEOUT_S = 2.0
"""How long the end waits for the last state to reach the disk [s]."""

LOG_CAPACITY = 1000
"""Log lines that may wait to be written."""
LOG_TIMEOUT_S = 1.0
"""How long the end waits for the last log lines [s]."""
STDERR = 2


class JsonLines(logging.Formatter):
    """One JSON object a line: time, level, logger, message, and code and facts of a notice."""

    def format(self, record: logging.LogRecord) -> str:
        """Return the line of a record."""
        line: dict[str, object] = {
            "t": round(record.created, 3),
            "level": record.levelname.lower(),
            "from": record.name,
            "message": record.getMessage(),
        }
        for key in ("code", "facts"):
            value = getattr(record, key, None)
            if value:
                line[key] = value
        if record.exc_info:
            line["error"] = self.formatException(record.exc_info)
        return json.dumps(line, ensure_ascii=False)


class RateLimit(logging.Filter):
    """Lets a source line speak at most so often: warnings may repeat at the rate of the loop.

    Notices come from one line of the loop: each of their codes counts as a source of its own.

    Args:
        burst: Records of one source that pass in each window.
        window_s: Length of a window [s].
        clock: Monotonic clock [s]: a step of the wall clock silences nobody.
    """

    def __init__(self, burst: int = 20, window_s: float = 1.0, clock: Callable[[], float] = time.monotonic) -> None:
        super().__init__()
        self._burst = burst
        self._window_s = window_s
        self._clock = clock
        self._seen: dict[tuple[str, int, str], tuple[float, int]] = {}

    def filter(self, record: logging.LogRecord) -> bool:
        """Return whether a record passes."""
        source = (record.pathname, record.lineno, getattr(record, "code", ""))
        now = self._clock()
        since, count = self._seen.get(source, (now, 0))
        if now - since > self._window_s:
            since, count = now, 0
        self._seen[source] = (since, count + 1)
        return count < self._burst


class LogWriter(logging.Handler):
    """Writes records to a file descriptor from a thread of its own: who logs never waits for whoever reads the log.

    A terminal under Ctrl-S, a pipe whose reader hangs or a full disk would stop the control loop else, at its next
    notice and for as long as it lasts. What does not fit is left out, and counted in the log. The descriptor is written
    directly: a thread that hangs in `sys.stderr` holds a lock that the interpreter needs to end.

    Args:
        descriptor: Where to write; stays open.
        capacity: Records that may wait.
    """

    def __init__(self, descriptor: int = STDERR, capacity: int = LOG_CAPACITY) -> None:
        super().__init__()
        self._descriptor = descriptor
        self._capacity = capacity
        self._waiting: queue.SimpleQueue[logging.LogRecord | None] = queue.SimpleQueue()
        self._left_out = 0
        self._counting = threading.Lock()
        self._is_closed = False
        self._thread = threading.Thread(target=self._run, name="log", daemon=True)
        self._thread.start()

    def emit(self, record: logging.LogRecord) -> None:
        """Put a record in line."""
        if self._is_closed or self._waiting.qsize() >= self._capacity:
            with self._counting:
                self._left_out += 1
        else:
            self._waiting.put(record)

    def close(self) -> None:
        """Write what waits, for a second at most. May be called again; logging does it when the process ends."""
        if not self._is_closed:
            self._is_closed = True
            self._waiting.put(None)
            self._thread.join(LOG_TIMEOUT_S)
        super().close()

    def _run(self) -> None:
        while (record := self._waiting.get()) is not None:
            try:
                line = self.format(record)
            except Exception as error:  # noqa: BLE001  whatever a message does when it is formatted: the next are told
                line = f"a record of {record.pathname}:{record.lineno} cannot be shown: {type(error).__name__}"
            self._write(line)
            if self._left_out:
                with self._counting:
                    lost, self._left_out = self._left_out, 0
                self._write(self.format(_line_of(f"{lost} log lines were left out: nobody read the log")))

    def _write(self, line: str) -> None:
        rest = memoryview(f"{line}\n".encode(errors="backslashreplace"))
        with contextlib.suppress(OSError):  # nobody will ever read it: the terminal is gone, the disk is full
            while rest:
                rest = rest[os.write(self._descriptor, rest) :]


def _line_of(message: str) -> logging.LogRecord:
    return logging.LogRecord(__name__, logging.WARNING, __file__, 0, message, (), None)


def configure_log(*, is_json: bool) -> None:
    """Write the log to standard error, as JSON lines or as plain ones for people, without ever waiting for it."""
    handler = LogWriter()
    handler.setFormatter(JsonLines() if is_json else logging.Formatter("%(asctime)s %(levelname)-7s %(message)s"))
    handler.addFilter(RateLimit())
    logging.basicConfig(level=logging.INFO, handlers=[handler], force=True)


class _Watched:
    """The local plane with the process's own wishes among its events: the end, and what a new link needs.

    Args:
        plane: The local plane.
        engine: Told whether anybody watches.
    """

    def __init__(self, plane: LocalPlane, engine: Engine) -> None:
        self._plane = plane
        self._engine = engine
        self._signals: list[int] = []

    def ask_to_end(self, number: int) -> None:
        """Ask for a clean end; safe in a signal handler."""
        self._signals.append(number)

    def poll(self) -> Sequence[Event]:
        events = self._plane.poll()
        self._engine.is_watched = self._plane.is_watched
        if self._signals:
            number = self._signals[0]
            self._signals.clear()
            _log.info("%s: ending", signal.Signals(number).name)
            events = [*events, ExitRequested(at_ns=time.monotonic_ns())]
        return events

    def send(self, replies: Sequence[Reply], notices: Sequence[Notice]) -> None:
        self._plane.send(replies, notices)

    def publish_snapshot(self, snapshot: Snapshot) -> None:
        self._plane.publish_snapshot(snapshot)


class _Link:
    """The robot link, telling when a session has brought new threads that must be scheduled like the others.

    Args:
        link: The link.
        engine: Says how closely it must look.
        on_up: Called in the loop's thread after each LinkUp.
    """

    def __init__(self, link: RobotLink, engine: Engine, on_up: Callable[[], None]) -> None:
        self._on_up = on_up
        self._link = link
        self._engine = engine
        self.publish = link.publish

    def poll(self) -> Sequence[Event]:
        engine = self._engine
        self._link.pace(is_moving=engine.is_streaming, is_watched=engine.is_watched)
        events = self._link.poll()
        if any(isinstance(event, LinkUp) for event in events):
            self._on_up()
        return events


@contextmanager
def _signals(handle: Callable[[int], None]) -> Iterator[None]:
    """Take the signals that ask for an end, but those that were ignored by whoever started this (`nohup`)."""

    def on_signal(number: int, frame: FrameType | None) -> None:
        handle(number)

    wanted = (signal.SIGTERM, signal.SIGINT, signal.SIGHUP)
    before = {
        number: signal.signal(number, on_signal) for number in wanted if signal.getsignal(number) != signal.SIG_IGN
    }
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _take_measures(settings: Settings) -> Callable[[], None]:
    """Take the real-time measures that are permitted; one line each. Return what is to be done after a new link."""
    kernel = Linux()
    measures = [sharpen_timer(kernel), calm_interpreter()]
    if settings.realtime.lock_memory:
        measures.append(lock_memory(kernel))
    fifo = FifoScheduling(kernel, settings.realtime.fifo_priority, threading.get_native_id())
    if settings.realtime.fifo:
        measures.append(fifo.apply())
    for measure in measures:
        _log.info("%s", measure.line)

    def after_link_up() -> None:
        if fifo.active and not (measure := fifo.refresh()).taken:
            _log.warning("%s", measure.line)

    return after_link_up


def run(settings: Settings, on_ready: Callable[[str], None] | None = None) -> int:
    """Run the daemon until it is asked to end.

    Must be called in the main thread: it takes over SIGTERM, SIGINT and SIGHUP while it runs.

    Args:
        settings: Effective settings.
        on_ready: Called with the socket's path when clients can connect.

    Returns:
        Exit status: 0.

    Raises:
        NotReady: OTHER_GATEWAY: a daemon for this robot or this socket runs on this host.
        ConfigError: A listener or a file cannot be as configured.
    """
    link: RobotLink | None = None
    status = 1
    try:
        with contextlib.ExitStack() as ending:  # all of it happens whatever fails, the last pushed first
            state_file = ending.enter_context(
                StateFile(path_of(state_dir(), settings.link.endpoint, settings.link.namespace))
            )
            plane = LocalPlane(settings)
            ending.callback(plane.close)
            started = state_file.start()
            if started.report:
                _log.warning("%s", started.report)
            engine = Engine(settings, started.remembered)
            watched = _Watched(plane, engine)
            ending.enter_context(_signals(watched.ask_to_end))  # to the very end: impatience must skip nothing
            writer = StateWriter(state_file, started)
            ending.callback(_close_writer, writer, state_file)
            ending.callback(release_interpreter)
            link = RobotLink(settings.link)
            ending.callback(link.close)
            ending.callback(plane.close)  # first: nobody asks any more
            plane.tell_routes_of(partial(_routes, link))
            plane.open()
            link.open()
            after_link_up = _take_measures(settings)
            loop = Loop(engine, _Link(link, engine, after_link_up), watched, on_remembered=writer.write)
            if on_ready is not None:
                on_ready(str(plane.socket))
            loop.run(lambda: False)
            status = 0
    finally:
        if link is not None and not link.close(0):  # zenoh still hangs in its threads: they would keep the process
            _log.warning("the robot session did not close in time; leaving without it", exc_info=status != 0)
            logging.shutdown()
            os._exit(status)
    return 0


def _close_writer(writer: StateWriter, state_file: StateFile) -> None:
    if not writer.close(DISK_TIMEOUT_S):
        _log.error("the last state did not reach %s", state_file.path)


def _routes(link: RobotLink) -> protocol.Routes:
    return protocol.Routes(routes=link.readiness(), bridge_version=link.robot_version, undelivered=link.undelivered)
