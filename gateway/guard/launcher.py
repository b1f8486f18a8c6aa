"""The daemon's side of its guard: starts it, shows it what is on the wire, tells the engine how it is, starts another.

Rules it obeys
    * The first guard is started before real-time measures: a process inherits scheduling from the thread that makes it.
      Later ones are started from a thread of their own, which leaves real time for it: a starting interpreter would keep
      a core for a second. The loop never waits for a process.
    * The daemon lives without a guard: one that cannot be started is told and tried again, a second apart.
    * A guard that hangs guards nothing: it counts as one that reaches no robot, and is ended for another one to start.
    * A daemon that ends by itself says so before the pipe closes. One that ends by an error does not: the guard ends what
      is on the wire.
"""

from __future__ import annotations

import contextlib
import logging
import os
import pickle
import subprocess
import threading
import time

from gateway.core.messages.events import Event, GuardSeen, PartEnded
from gateway.core.messages.held import Held
from gateway.guard.blackboard import Blackboard
from gateway.process.own_module import own_module
from gateway.process.threads import supervised
from gateway.settings.settings import Settings

__all__ = ["GuardLauncher"]

_log = logging.getLogger(__name__)

LOOK_NS = 50_000_000
"""How often is looked at what the guard says of itself [ns]."""
AGAIN_S = 1.0
"""Between the end of a guard that did not last and the next one [s]."""
HUNG_NS = 500_000_000
"""A guard that has not looked for so long, while this process looked at it in time, hangs [ns]: it looks every 120 ms."""
KILL_NS = 2_000_000_000
"""The same, and it is ended [ns]."""
START_NS = 15_000_000_000
"""One that has not looked at all after so long is ended, too [ns]: slow machines take seconds to import what it needs."""
API_SILENT = "the API of this gateway does not answer its guard: nobody could stop the robot by it"
END_S = 1.5
"""Longest wait for the guard at the daemon's end [s]."""
STEADY_S = 5.0
"""A guard that lasted this long [s] has another one started at once."""


class GuardLauncher:
    """Keeps one guard running.

    Raises:
        OSError: The kernel gives no memory to share.
    """

    def __init__(self, settings: Settings, *, is_json_log: bool = False) -> None:
        self._payload = pickle.dumps((settings, is_json_log))
        self._board = Blackboard.create()
        self._life, self._life_writer = os.pipe()
        self._daemon = _own_pidfd()
        self._process: subprocess.Popen[bytes] | None = None
        self._lost = ""
        self._told: tuple[int, str, bool, bool] | None = None
        self._looked_ns: int | None = None
        self._its_pid = self._its_look_ns = self._same_ns = self._killed_ns = 0
        """Which guard it is, when it last looked, since when that has been seen to be so, and when it was ended for it [ns]."""
        self._is_ending = threading.Event()
        self._thread = supervised(self._keep, "guard-launcher", may_return=self._is_ending.is_set)

    def start(self) -> None:
        """Start the first guard, and a thread that starts the next ones."""
        if os.getpid() == 1:
            _log.warning(
                "this process is the first of its container: when it dies the kernel ends the guard with it; "
                "give the container a first process that stays (configs/containers/keep-running.sh)"
            )
        self._process = self._spawn()
        self._thread.start()

    def write(self, held: Held) -> None:
        """Show the guard what is on the wire; every tick."""
        self._board.write(held)

    def poll(self, now_ns: int) -> list[Event]:
        """Return what has changed about the guard. Never waits."""
        if self._looked_ns is not None and now_ns - self._looked_ns < LOOK_NS and not self._lost:
            return []
        was_late = (
            self._looked_ns is not None and now_ns - self._looked_ns > 2 * LOOK_NS
        )  # perhaps both were kept from running
        self._looked_ns = now_ns
        said, process = self._board.guard(), self._process
        pid = 0 if process is None else process.pid
        is_its_own = pid != 0 and said.pid == pid
        is_silent = is_its_own and said.is_api_silent
        if said.looked_ns != self._its_look_ns or was_late or pid != self._its_pid:
            self._its_pid, self._its_look_ns, self._same_ns = pid, said.looked_ns, now_ns
        is_hung = now_ns - self._same_ns > HUNG_NS
        patience_ns = KILL_NS if is_its_own else START_NS
        if process is not None and now_ns - max(self._same_ns, self._killed_ns) > patience_ns:
            _log.warning("the guard has not looked for %.1f s: it is ended", (now_ns - self._same_ns) / 1e9)
            self._killed_ns = now_ns
            process.kill()
        told = (pid, said.zid if is_its_own else "", is_its_own and said.is_linked and not is_hung, is_silent)
        lost, self._lost = self._lost, ""
        if told == self._told and not lost:  # the first look tells in any case: a guard is expected
            if told[1]:
                self._board.know(told[1])  # the engine has heard of it by now
            return []
        self._told = told
        seen = GuardSeen(pid=told[0], zid=told[1], is_linked=told[2], at_ns=now_ns, lost=lost)
        return [seen, *([PartEnded(message=API_SILENT, at_ns=now_ns)] if is_silent else ())]

    def close(self, *, is_clean: bool) -> None:
        """End: the guard sees the pipe close. May be called again.

        Args:
            is_clean: Whether the daemon ended by itself, so that nothing is left to be done.
        """
        if self._is_ending.is_set():
            return
        self._is_ending.set()
        if is_clean:
            self._board.end()
        os.close(self._life_writer)
        process = self._process
        if is_clean and process is not None:
            try:
                process.wait(END_S)
            except subprocess.TimeoutExpired:
                _log.warning("the guard did not end in time")
                process.kill()

    # ------------------------------------------------------------------------------------------------ the thread

    def _keep(self) -> None:
        while not self._is_ending.is_set():
            process, begun_s = self._process, time.monotonic()
            if process is not None:
                status = process.wait()
                if self._is_ending.is_set():
                    return
                self._process = None
                self._lost = f"signal {-status}" if status < 0 else f"status {status}"
            if time.monotonic() - begun_s < STEADY_S and self._is_ending.wait(AGAIN_S):
                return
            with contextlib.suppress(OSError, AttributeError):  # a process inherits its scheduling from this thread
                os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
                os.setpriority(
                    os.PRIO_PROCESS, 0, os.getpriority(os.PRIO_PROCESS, os.getpid())
                )  # as its main thread has
            self._process = self._spawn()

    def _spawn(self) -> subprocess.Popen[bytes] | None:
        files = [self._board.descriptor, self._life, *([self._daemon] if self._daemon >= 0 else [])]
        numbers = [str(number) for number in (self._board.descriptor, self._life, self._daemon)]
        try:
            process = subprocess.Popen(
                own_module("gateway.guard.guard", *numbers),
                stdin=subprocess.PIPE,
                pass_fds=files,
                start_new_session=True,
            )
        except OSError as error:
            _log.error("the guard could not be started: %s", error)
            return None
        assert process.stdin is not None
        with contextlib.suppress(OSError):  # it has ended already: the thread sees that
            process.stdin.write(self._payload)
            process.stdin.close()
        return process


def _own_pidfd() -> int:
    """Return a file that stands for this process and no other, ever; -1 where the kernel has none."""
    try:
        return os.pidfd_open(os.getpid())
    except (OSError, AttributeError) as error:
        _log.warning("no pidfd: the guard cannot end a frozen daemon (%s)", error)
        return -1
