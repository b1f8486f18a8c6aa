"""The daemon's composition root: builds everything, starts it in order, runs the loop, ends it in order.

    locks -> state file -> engine -> guard -> local plane -> robot link -> real-time measures -> loop -> the same way back

A thread that ends unasked is told to the engine, like what the guard finds out; then the process ends as one that died, so
that its guard goes on with what is held, and the service manager starts another one.

One daemon per robot. It ends by SIGTERM or Ctrl-C: the engine brakes, sends what it owes and says when it is done,
within 5 s. Nothing here decides anything about the robot.
"""

from __future__ import annotations

import contextlib
import logging
import os
import signal
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, NoReturn

from msgspec.structs import replace

from gateway.api import protocol
from gateway.api.guard_protocol import guard_socket, robot_name
from gateway.api.service import LocalPlane
from gateway.core.engine import Engine
from gateway.core.messages.events import Event, ExitRequested, GuardSeen, LinkUp, PartEnded
from gateway.core.messages.outputs import Notice, Reply, router_name
from gateway.errors import Code
from gateway.guard.launcher import GuardLauncher
from gateway.guard.successor import HoldSuccessor
from gateway.incident.recorder import Recorder
from gateway.incident.ring import folder_of
from gateway.link.robot_link import RobotLink
from gateway.messages.snapshot import Snapshot
from gateway.process.loop import Loop
from gateway.process.measures import Measures
from gateway.process.notify import Notifier
from gateway.process.recall import Recall
from gateway.process.reloading import Reloader, has_terminal
from gateway.process.state_file import StateFile, StateWriter, path_of
from gateway.process.threads import take_lost
from gateway.process.zenoh_threads import share_reactor
from gateway.settings.settings import Settings
from gateway.settings.toml_file import state_dir

if TYPE_CHECKING:
    from gateway.core.robot_state.body_model import BodyModel

__all__ = ["run"]

_log = logging.getLogger(__name__)

DISK_TIMEOUT_S = 2.0
"""How long the end waits for the last state to reach the disk [s]."""
BLACK_BOX_TIMEOUT_S = 1.0
"""And for the black box."""


class _Watched:
    """The local plane with what is the process's own among its events: the end, lost threads, settings that were read anew."""

    def __init__(
        self, plane: LocalPlane, engine: Engine, notifier: Notifier | None = None, reloader: Reloader | None = None
    ) -> None:
        self._notifier = notifier
        self._reloader = reloader
        self._had_terminal = has_terminal()
        self._plane = plane
        self._engine = engine
        self._signals: list[int] = []

    def take_signal(self, number: int) -> None:
        """Take note of a signal; safe in its handler."""
        self._signals.append(number)

    def poll(self) -> Sequence[Event]:
        lost = [PartEnded(message=str(thread), trace=thread.trace, at_ns=thread.at_ns) for thread in take_lost()]
        events: list[Event] = [*lost, *self._plane.poll()]
        self._engine.is_watched = self._plane.is_watched
        numbers, self._signals = self._signals, []
        if self._reloader is not None:
            # A terminal that is gone says so by the same signal: that is an end.
            if signal.SIGHUP in numbers and (has_terminal() or not self._had_terminal):
                numbers = [number for number in numbers if number != signal.SIGHUP]
                self._reloader.ask()
            for reading, settings in self._reloader.take():
                self._plane.take_reading(reading, settings)
                events.append(reading)
        if numbers:
            _log.info("%s: ending", signal.Signals(numbers[0]).name)
            if self._notifier is not None:
                self._notifier.stopping(time.monotonic_ns())
            events.append(ExitRequested(at_ns=time.monotonic_ns()))
        return events

    def poll_stops(self) -> Sequence[Event]:
        return self._plane.poll_stops()

    def wait_for_stop(self, seconds: float) -> bool:
        return self._plane.wait_for_stop(seconds)

    def wait(self, seconds: float) -> bool:
        return bool(self._signals) or self._plane.wait(seconds)

    def send(self, replies: Sequence[Reply], notices: Sequence[Notice]) -> None:
        # First: who is told that he owns the robot is heard from then on.
        self._plane.heed(self._engine.heeded, self._engine.stopper_id, self._engine.owner_id)
        self._plane.send(replies, notices)

    def publish_snapshot(self, snapshot: Snapshot) -> None:
        self._plane.publish_snapshot(snapshot)


class _Guards:
    """This daemon's guard, and the one that an earlier daemon left, as far as the loop is concerned."""

    def __init__(
        self,
        settings: Settings,
        engine: Engine,
        latch: Callable[[Code, str], None],
        socket: Path,
        *,
        is_json_log: bool,
    ) -> None:
        self._engine = engine
        name = robot_name(settings.link.endpoint, settings.link.namespace)
        self._successor = HoldSuccessor(guard_socket(socket), engine, latch, name)
        self._launcher: GuardLauncher | None = None
        if settings.guard.enabled:
            here = replace(settings, local=replace(settings.local, socket=str(socket)))
            try:
                self._launcher = GuardLauncher(here, is_json_log=is_json_log)
                self._launcher.start()
            except OSError as error:
                _log.error("there is no guard: %s", error)
        else:
            _log.warning("no guard: when this process dies, the robot's own watchdogs stop it, and the grip is lost")

    def poll(self) -> list[Event]:
        now_ns = time.monotonic_ns()
        return [*self._successor.poll(now_ns), *(self._launcher.poll(now_ns) if self._launcher is not None else ())]

    def on_sending(self, now_ns: int) -> None:
        self._successor.confirm()
        if self._launcher is not None:
            self._launcher.write(self._engine.takeover.show(now_ns))

    def close(self, is_clean: Callable[[], bool]) -> None:
        self._successor.close()
        if self._launcher is not None:
            self._launcher.close(is_clean=is_clean())


def _latching(recorder: Recorder) -> Callable[[Code, str], None]:
    return lambda code, message: recorder.latch(code, message, time.monotonic_ns())


class _Link:
    """The robot link, telling when a session has brought new threads that must be scheduled like the others.

    `on_up` is called in the loop's thread after each LinkUp.
    """

    def __init__(
        self,
        link: RobotLink,
        engine: Engine,
        on_up: Callable[[], None],
        guards: _Guards,
        recall: Recall,
        latch: Callable[[Code, str], None],
        namespace: str,
    ) -> None:
        self._recall = recall
        self._latch = latch
        self._namespace = namespace
        self._guards = guards
        self._on_up = on_up
        self._link = link
        self._engine = engine
        self.publish = link.publish
        self.show = link.show

    def poll(self) -> Sequence[Event]:
        engine = self._engine
        self._link.pace(is_moving=engine.is_streaming, is_watched=engine.is_watched, is_posing=engine.is_posing)
        events = self._link.poll()
        for event in events:
            if isinstance(event, LinkUp):
                self._on_up()
                self._recall.meet(router_name(event.router_zid, self._namespace), self._latch)
        of_guards = self._guards.poll()
        for event in of_guards:
            if isinstance(event, GuardSeen) and event.zid:
                self._link.befriend(event.zid)
        return [*events, *of_guards]


@contextmanager
def _signals(handle: Callable[[int], None]) -> Iterator[None]:
    """Take the signals that ask for an end, or for a reading, but those that were ignored by whoever started this (`nohup`)."""

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


def run(
    settings: Settings,
    on_ready: Callable[[str], None] | None = None,
    *,
    is_json_log: bool = False,
    notifier: Notifier | None = None,
    read: Callable[[], Settings] | None = None,
) -> int:
    """Run the daemon until it is asked to end.

    Must be called in the main thread: it takes over SIGTERM, SIGINT and SIGHUP while it runs.

    `on_ready` is called with the socket's path when clients can connect; `read` reads the settings anew, on SIGHUP (without
    it that signal ends the daemon).

    Returns:
        Exit status: 0. A daemon that lost a thread of its own, or whose API hangs, ends its process with 1.

    Raises:
        NotReady: OTHER_GATEWAY: a daemon for this robot or this socket runs on this host.
        ConfigError: A listener, or a file of the configuration's, cannot be as configured.
    """
    share_reactor()
    model = _model(settings)  # before anything is opened: its files may be wrong
    link: RobotLink | None = None
    status = 1
    try:
        with contextlib.ExitStack() as ending:  # all of it happens whatever fails, the last pushed first
            if notifier is not None:
                ending.callback(notifier.close)
            path = path_of(state_dir(), settings.link.endpoint, settings.link.namespace)
            state_file = ending.enter_context(StateFile(path))
            plane = LocalPlane(settings)
            ending.callback(plane.close)
            recall = Recall(state_file.path)
            started = state_file.start(least_epoch=recall.epoch)
            if started.report:
                _log.warning("%s", started.report)
            engine = Engine(settings, started.remembered, model)
            recorder = Recorder(engine, folder_of(state_file.path), settings.link.endpoint)
            latch = _latching(recorder)
            recall.known_here(started.remembered)
            reloader = None if read is None else Reloader(settings, read)
            if reloader is not None:
                ending.callback(reloader.close)
            watched = _Watched(plane, engine, notifier, reloader)
            ending.enter_context(_signals(watched.take_signal))  # to the very end: impatience must skip nothing
            # Before real-time measures, and before this process has anything that another one should not inherit.
            guards = _Guards(settings, engine, latch, plane.socket, is_json_log=is_json_log)
            ending.callback(guards.close, lambda: status == 0)
            writer = StateWriter(state_file, started, on_saved=recall.saved)
            ending.callback(_close_writer, writer, state_file)
            if settings.local.black_box:
                recorder.start()
                ending.callback(lambda: recorder.close(BLACK_BOX_TIMEOUT_S, is_clean=status == 0))
            measures = Measures(settings)
            ending.callback(measures.undo)
            link = RobotLink(settings.link)
            ending.callback(link.close)
            ending.callback(plane.close)  # first: nobody asks any more
            plane.tell_routes_of(partial(_routes, link))
            plane.open()
            link.open()
            measures.take()
            robot = _Link(link, engine, measures.renew, guards, recall, latch, settings.link.namespace)
            loop = Loop(
                recorder,
                robot,
                watched,
                on_remembered=writer.write,
                on_sending=guards.on_sending,
                on_cycle=_each(recorder.look, notifier),
            )
            ending.callback(guards.close, lambda: status == 0)  # first of all: no tick comes any more
            if on_ready is not None:
                on_ready(str(plane.socket))
            if notifier is not None:
                notifier.ready(time.monotonic_ns(), lambda: engine.state.value)
            loop.run(lambda: False)
            if engine.is_broken:
                recorder.close(0, is_clean=False)  # it writes on while the disk is waited for
                _leave(guards, partial(_close_writer, writer, state_file))
            status = 0
    finally:
        if link is not None and not link.close(0):  # zenoh still hangs in its threads: they would keep the process
            _log.warning("the robot session did not close in time; leaving without it", exc_info=status != 0)
            logging.shutdown()
            os._exit(status)
    return 0


def _each(look: Callable[[int], None], notifier: Notifier | None) -> Callable[[int], None]:
    def on_cycle(now_ns: int) -> None:
        look(now_ns)
        if notifier is not None:
            notifier.beat(now_ns)

    return look if notifier is None else on_cycle


def _leave(guards: _Guards, save: Callable[[], None]) -> NoReturn:
    """End a process a part of which has ended: wait for none of the others but the disk, let the guard go on at once."""
    guards.close(lambda: False)
    save()
    _log.critical("a part of this gateway ended, and so does it: start it anew; its latch wants recover()")
    logging.shutdown()
    os._exit(1)


def _model(settings: Settings) -> BodyModel | None:
    """Return the body model; numpy is loaded only for it, and pinocchio only for dynamics."""
    if not settings.model.check:
        return None
    from gateway.core.robot_state.body_model import body_model

    model = body_model(settings)
    if model is not None and settings.model.dynamics:
        from gateway.core.robot_state.contact import Contacts
        from gateway.kinematics.dynamics.loading import load_dynamics

        model.contacts = Contacts(load_dynamics(settings), model.refusal)
    return model


def _close_writer(writer: StateWriter, state_file: StateFile) -> None:
    if not writer.close(DISK_TIMEOUT_S):
        _log.error("the last state did not reach %s", state_file.path)


def _routes(link: RobotLink) -> protocol.Routes:
    return protocol.Routes(
        routes=link.readiness(), bridge_version=link.robot_version, undelivered=link.undelivered, wire=link.wire()
    )
