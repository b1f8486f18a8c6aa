"""The guard: a process of its own that brakes, holds and stops in the daemon's place when that is dead or frozen.

    python -m gateway.guard.guard BOARD LIFE DAEMON      three open files; settings come on standard input

The daemon starts it before it commands anything. It opens its own robot session, watches the daemon's ticks in shared
memory and the pipe that closes when the daemon ends, and sends nothing. What it does then is `core/guardian.py`'s word.

Rules it obeys
    * Two never write. A frozen daemon is killed by its pidfd, which can mean no other process, and nothing is sent before
      its last thread can run no more (`dying.py`), or the pipe has closed, which comes some milliseconds later.
    * A daemon that said that it ends, or that never sent anything, is no reason to do anything: the guard ends, too.
    * A person who stops the daemon with SIGSTOP or a debugger, while it commands the robot, ends it: to the guard that is
      a freeze. `ta2 run --no-guard` is for debuggers.
    * Ctrl-C in the daemon's terminal does not reach it (it has a session of its own); SIGTERM ends what it holds, or what it
      is about to hold: who ends a service asks both processes. One of long ago is no wish any more.
    * What others command is the daemon's to look for while it ticks: it lets the robot go at once, and what it has on the wire
      is all that may be gone on with. The guard looks too from the first doubt on, when it asks whether the daemon could run,
      and when it acts. To hear the daemon's own commands come back would cost as much as all else that the guard does.
    * A guard that has lost a thread of its own ends, and its daemon starts another one. While it acts it goes on: a hold
      without a diagnosis, say, is better than none.
    * The disk is written from a thread: a latch of the guard's reaches the state file, or the daemon that takes over.
"""

from __future__ import annotations

import contextlib
import logging
import os
import pickle
import select
import signal
import socket
import sys
import threading
import time
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from types import FrameType
from typing import NamedTuple

from msgspec.structs import replace

from gateway.api.guard_protocol import guard_socket, robot_name
from gateway.api.protocol import default_socket
from gateway.core.engine import Output
from gateway.core.guardian import Guardian, Phase
from gateway.core.handover.takeover import LATCHED_BEFORE
from gateway.core.messages.events import CommandRequested, LinkUp, Suspended
from gateway.core.messages.held import Held
from gateway.core.supervision.supervisor import State
from gateway.errors import Code, GatewayError
from gateway.guard.api_watch import END_MISSES, SILENT_MISSES, ApiWatch
from gateway.guard.blackboard import Blackboard
from gateway.guard.core_probe import CoreProbe
from gateway.guard.dying import DyingProcess
from gateway.guard.guard_server import GuardServer
from gateway.link.discovery.discovery import Discovery
from gateway.link.hearing import DECIDING
from gateway.link.robot_link import RobotLink
from gateway.messages.requests import Estop, Stop
from gateway.process.cores import LinuxAffinity, spread
from gateway.process.log import configure_log
from gateway.process.loop import LEVELS
from gateway.process.measures import Measures
from gateway.process.realtime import SleepWatch
from gateway.process.state_file import StateFile, path_of
from gateway.process.threads import supervised, take_lost
from gateway.process.zenoh_threads import share_reactor
from gateway.robot.limits import FSM_WATCHDOG_NS
from gateway.settings.settings import Settings
from gateway.settings.toml_file import state_dir

__all__ = ["Files", "Guard", "main"]

_log = logging.getLogger(__name__)

S = 1_000_000_000
PERIOD_NS = 10_000_000
"""Ticks while it acts [ns]: 100 Hz."""
CLOSELY_NS = 1 * S
"""While it waits, what the robot says is skimmed: when it came is known, what it says is read this often [ns]. It is read at
once when the daemon ends, and as long as the robot was not heard in time."""
DYING_NS = 500_000
"""A daemon that was killed is looked at this often [ns]."""
LISTEN_NS = 40_000_000
"""The robot is listened to this often while the guard waits [ns]: a state is at most twice as old then, which is fresh."""
HANDED_S = 0.3
"""The claim stays seen this long after the hold was handed over [s]: until that of the daemon is."""
ASKED_NS = 5 * S
"""A SIGTERM counts for what the guard begins to hold within this [ns]."""
DISK_TIMEOUT_S = 2.0
"""Longest wait for the disk at the end [s], and for a process that was killed to let go of the file."""
CLOSE_NS = 1 * S
"""Longest wait for the robot session's end [ns]."""


class Files(NamedTuple):
    """What the daemon hands to its guard.

    Attributes:
        board: The shared page.
        life: Reading end of a pipe whose writing end is the daemon's alone.
        daemon: The daemon's pidfd; -1 where the kernel has none.
    """

    board: int
    life: int
    daemon: int


class Guard:
    """Watches one daemon."""

    def __init__(self, settings: Settings, files: Files) -> None:
        self._settings = settings
        self._life, self._daemon = files.life, files.daemon
        self._board = Blackboard(files.board)
        self._guardian = Guardian(settings)
        self._link = RobotLink(settings.link, topics=DECIDING, stamped=(), hears_commands=False)
        beside = Path(settings.local.socket or default_socket())
        name = robot_name(settings.link.endpoint, settings.link.namespace)
        self._api = ApiWatch(beside, self._board.read)
        self._server = GuardServer(str(guard_socket(beside)), settings.local.socket_mode, name, beside)
        self._sleep = SleepWatch()
        self._measures = Measures(settings, is_guard=True)
        self._asked_ns: int | None = None
        self._closely_ns = 0
        self._dying: DyingProcess | None = None
        self._probe = CoreProbe(os.getppid(), LinuxAffinity(), settings.realtime.fifo_priority)
        self._writers: list[threading.Thread] = []
        self._one_writer = threading.Lock()
        self._is_killed = self._is_open = self._is_armed = self._is_handing = self._has_news = False

    def run(self) -> None:
        """Watch until the daemon has ended, act as long as it takes, end."""
        with contextlib.ExitStack() as ending:
            ending.callback(self._measures.undo)
            ending.callback(self._finish_writing)
            ending.callback(self._link.close, CLOSE_NS)
            ending.callback(self._server.close)
            ending.callback(self._probe.close)
            ending.callback(self._api.close)
            self._server.sweep()
            self._link.open()
            self._api.start()
            self._measures.take()
            self._link.pace(is_moving=True, is_watched=False)
            try:
                self._loop()
            except BaseException:  # any bug, a panic of a compiled part too: stop frames, then raise it again
                _log.exception("the guard ends by an error; its stop frames leave now")
                if self._is_acting:
                    for frame in self._guardian.engine.panic_frames(time.monotonic_ns()):
                        self._link.publish(frame)
                raise

    def _loop(self) -> None:
        deadline_ns = time.monotonic_ns()
        while self._guardian.phase is not Phase.DONE:
            is_daemon_gone = self._wait(deadline_ns) or self._is_dead()
            now_ns = self._listen(is_needed=is_daemon_gone)
            self._answer(now_ns)
            was_acting = self._is_acting
            if self._guardian.phase is Phase.WATCHING:
                self._watch(now_ns, is_daemon_gone=is_daemon_gone)
            elif self._asked_ns is not None:
                self._guardian.end(now_ns)
            # The first tick has no instant at which it was due: what it sends is not late.
            if self._has_news:
                self._has_news = False
                output = self._guardian.tick(now_ns, max(now_ns - deadline_ns, 0) if was_acting else 0)
                self._hand_out(output, now_ns)
            else:
                self._show_claim(0)
            if self._is_acting and not self._is_open:  # only now: the frames come first
                self._is_open = True
                self._link.hear_commands()
                self._server.open()
            is_api_silent = self._api.misses >= SILENT_MISSES
            self._board.say(
                os.getpid(), now_ns, self._link.zid, is_linked=self._link.is_up, is_api_silent=is_api_silent
            )
            self._end_if_incomplete()
            deadline_ns = self._next_ns(now_ns)
        if self._guardian.given_up:
            _log.warning("nothing is sent any more: %s", self._guardian.given_up)
        if self._is_handing:
            select.select([], [], [], HANDED_S)

    def _end_if_incomplete(self) -> None:
        """End when a thread of this process was lost: the daemon starts another guard. Not while it holds, or is about to."""
        lost = take_lost()
        if lost and self._guardian.phase is Phase.WATCHING and not self._is_killed:
            raise RuntimeError("; ".join(map(str, lost)))

    @property
    def _is_acting(self) -> bool:
        return self._guardian.phase is Phase.ACTING

    def ask_to_end(self, number: int, frame: FrameType | None) -> None:
        """Take a signal: whatever is held ends as a daemon's SIGTERM would end it. A guard that watches goes on."""
        self._asked_ns = time.monotonic_ns()

    # ------------------------------------------------------------------------------------------------ waiting

    def _wait(self, deadline_ns: int) -> bool:
        """Wait until then, for the daemon's end, or for somebody who asks; return whether the daemon has ended.

        The robot is listened to meanwhile: what it says must not look old when the daemon ends.
        """
        files: list[socket.socket | int] = [*self._server.files]
        if self._guardian.phase is Phase.WATCHING:
            files.append(self._life)
        while True:
            rest_ns = max(deadline_ns - time.monotonic_ns(), 0)
            ready, _, _ = select.select(files, [], [], min(rest_ns, LISTEN_NS) / S)
            if ready or rest_ns <= LISTEN_NS:
                return self._life in ready and not os.read(self._life, 64)
            self._listen()

    def _listen(self, *, is_needed: bool = False) -> int:
        """Hear the robot, and read what it says unless that can wait; return the time at which it was heard [ns]."""
        now_ns = time.monotonic_ns()
        slept_ns = self._sleep.slept_ns()
        if slept_ns > 0:
            self._guardian.receive(Suspended(slept_ns=slept_ns, at_ns=now_ns), now_ns)
        newest_ns = self._link.skim()
        is_at_ease = (
            self._guardian.phase is Phase.WATCHING
            and self._guardian.engine.state is State.READ_ONLY
            and now_ns - newest_ns < self._settings.enable.stale_ns
            and now_ns - self._closely_ns < CLOSELY_NS
        )
        if is_at_ease and not (is_needed or self._is_killed or slept_ns > 0):
            return now_ns
        self._closely_ns, self._has_news = now_ns, True
        for event in self._link.poll():
            if isinstance(event, LinkUp):
                self._measures.renew()
            self._guardian.receive(event, now_ns)
        return now_ns

    def _next_ns(self, now_ns: int) -> int:
        if self._guardian.phase is Phase.WATCHING:
            if self._is_killed:
                return now_ns + (DYING_NS if self._dying else PERIOD_NS)
            return self._guardian.freeze.look_ns
        grid_ns = (now_ns // PERIOD_NS + 1) * PERIOD_NS
        due_ns = self._guardian.engine.next_due_ns()
        return grid_ns if due_ns is None or due_ns <= now_ns else min(grid_ns, due_ns)

    # ------------------------------------------------------------------------------------------------ watching

    def _watch(self, now_ns: int, *, is_daemon_gone: bool) -> None:
        held = self._board.read()
        # Not before the daemon knows this session of ours: it would take us for another gateway, and let the robot go.
        is_known = self._link.zid != "" and self._board.known_zid == self._link.zid
        # Nor after the robot's own watchdogs have acted: it would disturb whoever commands the robot since.
        is_current = held is not None and now_ns - held.at_ns < FSM_WATCHDOG_NS
        self._is_armed = held is not None and held.is_sending and is_known and is_current
        if self._asked_ns is not None and now_ns - self._asked_ns > ASKED_NS:
            self._asked_ns = None
        if is_daemon_gone:
            self._begin(held, now_ns)
        elif not self._is_killed and self._guardian.freeze.is_frozen(held, now_ns, self._probe.ran_ns()):
            why = f"has not ticked for {self._settings.guard.freeze_ns / 1e6:.0f} ms while it commands the robot"
            self._kill(why, held, now_ns)
        elif not self._is_killed and self._api.misses >= END_MISSES:
            self._kill(f"has not answered {END_MISSES} questions, and did not end when it was told", held, now_ns)
        elif self._guardian.freeze.is_asking:
            self._probe.ask()
            self._link.hear_commands()

    def _begin(self, held: Held | None, now_ns: int) -> None:
        """The daemon is gone: go on in its place, if there is anything to go on with."""
        is_clean = self._board.is_ended
        self._guardian.daemon_ended(held, now_ns, is_clean=is_clean)
        if self._is_acting:
            _log.warning("the daemon has ended without a word; it was in %s", "" if held is None else held.state)
            if not self._guardian.is_holding:
                _log.warning("nothing is held: %s", self._guardian.engine.takeover.refused)
        elif held is not None and held.latches and not is_clean:
            self._remember({Code(name): LATCHED_BEFORE for name in held.latches})

    def _kill(self, why: str, held: Held | None, now_ns: int) -> None:
        """End the daemon that hangs, so that it can never send anything again."""
        self._is_killed = True
        tick_ms = (now_ns - held.at_ns) / 1e6 if held is not None else 0.0
        if self._daemon < 0:
            _log.error("the daemon %s, and this kernel has no pidfd to end it by", why)
            return
        try:  # first: each millisecond counts against the robot's watchdogs, words do not
            signal.pidfd_send_signal(self._daemon, signal.SIGKILL)
        except ProcessLookupError:  # it has just ended by itself: the pipe says so
            return
        except OSError as error:  # forbidden here: it may come back, and nothing is sent as long as it may
            _log.error("the daemon %s, and cannot be ended: %s", why, error)
            return
        self._api.close()
        with contextlib.suppress(OSError):  # no /proc here: then its pipe tells
            self._dying = DyingProcess(self._daemon)
        _log.error("the daemon %s: it is ended", why)
        _log.error("its last tick %.1f ms ago, %s", tick_ms, self._probe.account(now_ns))

    def _is_dead(self) -> bool:
        """Return whether the daemon was killed by us and can do nothing any more."""
        return self._dying is not None and self._guardian.phase is Phase.WATCHING and self._dying.is_over()

    # ------------------------------------------------------------------------------------------------ acting

    def _hand_out(self, output: Output, now_ns: int) -> None:
        for frame in output.frames:
            self._link.publish(frame)
        self._show_claim(output.claim)
        if self._guardian.phase is Phase.WATCHING:
            return
        for notice in output.notices:
            facts = {"code": notice.code.value, "facts": dict(notice.facts)}
            _log.log(LEVELS[notice.level], "guard: %s: %s", notice.code, notice.message, extra=facts)
        for reply in output.replies:
            undelivered = bool(reply.facts.get("stop_undelivered"))
            self._server.stopped(reply.request_id, self._guardian, now_ns, is_undelivered=undelivered)
        if output.remembered is not None and output.remembered.latches:
            self._remember(dict(output.remembered.latches))

    def _show_claim(self, claim: int) -> None:
        """Show the engine's claim, or the daemon's, which stays seen when the daemon is gone, until the last stop frame.

        Its number is that of the first claim of our own. While a hold is handed over it stays, too: without any claim a
        gateway that waits for the robot would begin.
        """
        phase = self._guardian.phase
        self._is_handing = phase is Phase.HANDED or (self._is_handing and phase is Phase.DONE)
        is_claimed = self._is_handing or (self._is_armed and phase is not Phase.DONE)
        self._link.show(claim or int(is_claimed))

    def _answer(self, now_ns: int) -> None:
        for caller, question in self._server.poll(self._guardian, now_ns):
            request = Stop(reason=question.reason) if question.ask == "stop" else Estop(reason=question.reason)
            command = CommandRequested(
                client_id=question.client or "somebody at the guard's socket",
                request_id=caller,
                request=request,
                received_ns=now_ns,
            )
            self._guardian.receive(command, now_ns)

    def _remember(self, latches: Mapping[Code, str]) -> None:
        writer = supervised(partial(self._keep, latches), "state-file")
        writer.start()
        self._writers.append(writer)

    def _finish_writing(self) -> None:
        for writer in self._writers:
            writer.join(2 * DISK_TIMEOUT_S)

    def _keep(self, latches: Mapping[Code, str]) -> None:
        """Add latches to the state file. Where a new daemon has the file already it takes them over with the hold.

        A process that was killed has it for some moments more, until the kernel has let go of all its memory.
        """
        link, until = self._settings.link, time.monotonic() + DISK_TIMEOUT_S
        while True:
            try:
                with self._one_writer, StateFile(path_of(state_dir(), link.endpoint, link.namespace)) as file:
                    started = file.start()
                    known = started.remembered
                    return file.save(replace(known, epoch=started.reserved_epoch, latches={**latches, **known.latches}))
            except (GatewayError, OSError) as error:
                is_held = isinstance(error, GatewayError) and error.code is Code.OTHER_GATEWAY
                if not is_held or self._is_handing or time.monotonic() > until:
                    return _log.warning("the guard's latches could not be written: %s", error)
            threading.Event().wait(0.01)


def main(arguments: list[str]) -> int:
    """Run the guard of the daemon that started this process."""
    with contextlib.suppress(OSError, AttributeError):  # whatever the daemon runs under: measures are taken anew
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
    spread(LinuxAffinity())  # the daemon keeps to one core, and may spin there
    settings, is_json = pickle.load(sys.stdin.buffer)  # from the process that started this one
    configure_log(is_json=is_json)
    logging.getLogger(Discovery.__module__).setLevel(logging.ERROR)  # the daemon tells of routes, and knows who is ours
    share_reactor()
    guard = Guard(settings, Files(*map(int, arguments)))
    for number in (signal.SIGTERM, signal.SIGINT, signal.SIGHUP):
        signal.signal(number, guard.ask_to_end)
    status = 1
    try:
        guard.run()
        status = 0
    finally:
        logging.shutdown()
        os._exit(status)  # zenoh's threads may hang; nothing is left to be done


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
