"""A restarted daemon's way to the hold of the guard that an earlier daemon left behind.

    there is a guard that acts -> ready to hold, with a guard of its own -> ask for the hold -> take it in the next tick,
    and say so before its first frame leaves

The order of the last two is what keeps two from writing: who hears nothing of the hold that it gave goes on with it when
the connection ends, and the guard of this daemon goes on with what this daemon has shown to it. Showing and saying are
next to each other, and both come before the frames. Until then this daemon enables nothing (`HeldElsewhere`). An e-stop
that reaches it is passed on. When the guard ends first, or never held, the daemon begins as ever. Nothing here waits but
the first look, for a second, and only where a guard listens.
"""

from __future__ import annotations

import contextlib
import logging
import os
import socket
import time
from collections.abc import Callable
from pathlib import Path

import msgspec

from gateway.api.guard_protocol import (
    MAX_PACKET_BYTES,
    GuardAnswer,
    GuardQuestion,
    connected,
    packed,
    read_answer,
)
from gateway.core.engine import Engine
from gateway.core.messages.events import Event, HeldElsewhere, TakenOver
from gateway.core.messages.held import Held
from gateway.errors import Code
from gateway.guard.guard_server import peer

__all__ = ["HoldSuccessor"]

_log = logging.getLogger(__name__)

MS = 1_000_000

LOOK_S = 1.0
"""Longest wait for the guard's first answer [s]: one that listens acts, and answers in its next tick."""
SPARE_NS = 3000 * MS
"""A hold that goes on for less than this is taken over at once [ns], with a guard of our own or without."""
STATUS_NS = 100 * MS
"""Between two looks at a guard that goes on holding [ns]: what it latches meanwhile is ours to keep, and after an e-stop it
ends within a second or two."""
PATIENCE_NS = 5000 * MS
"""A guard whose hold was over this long ago [ns] and that still has the connection open hangs: it is waited for no more."""


class HoldSuccessor:
    """Takes a hold over, once.

    `robot` is as `robot_name` gives it.
    """

    def __init__(
        self,
        path: Path,
        engine: Engine,
        latch: Callable[[Code, str], None],
        robot: str,
        clock: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        self._clock = clock
        self._engine = engine
        self._robot = robot
        self._begun_ns = 0
        self._down_ns = 0
        self._latch = latch
        self._is_new = True
        self._is_asked = self._is_taken = self._is_estop_passed = False
        self._is_waiting = False
        self._looked_ns = 0
        self._known: set[tuple[str, str]] = set()
        self._socket = self._look(path)

    def _look(self, path: Path) -> socket.socket | None:
        """Return a connection to a guard that acts; None where there is none."""
        try:
            caller = connected(path, LOOK_S)
        except OSError:
            return None
        uid, _ = peer(caller)
        if uid not in (os.geteuid(), 0):
            _log.error("%s is user %d's, no guard of an earlier daemon of ours: passed over", path, uid)
            caller.close()
            return None
        try:
            caller.send(packed(GuardQuestion(ask="status", client="daemon")))
            answer = read_answer(caller.recv(MAX_PACKET_BYTES))
        except (OSError, ValueError):
            caller.close()
            return None
        is_ours = answer.robot == self._robot
        if answer.phase != "acting" or not is_ours:
            if not is_ours:
                _log.warning(
                    "the guard of an earlier daemon (pid %d) acts for another robot: %s", answer.pid, answer.robot
                )
            caller.close()
            return None
        self._down_ns = self._clock() + answer.left_ms * MS
        _log.warning("the guard of an earlier daemon (pid %d) acts: %s", answer.pid, answer.state)
        self._take_latches(answer)
        caller.setblocking(False)
        return caller

    def poll(self, now_ns: int) -> list[Event]:
        """Return what the engine must hear. Never waits."""
        if self._socket is None:
            return []
        if self._is_new:
            self._is_new, self._begun_ns = False, now_ns
            return [HeldElsewhere(is_held=True, at_ns=now_ns)]
        answer = self._heard()
        if self._socket is None:  # it has ended
            return [HeldElsewhere(is_held=False, at_ns=now_ns)]
        if answer is not None:
            self._is_waiting = False
            self._take_latches(answer)
            if self._is_asked:
                return self._take(answer, now_ns)
        if now_ns - self._down_ns > PATIENCE_NS:  # it sends nothing when it goes on, as one that stood still
            _log.error("the guard of an earlier daemon hangs: this daemon begins without what it held")
            self.close()
            return [HeldElsewhere(is_held=False, at_ns=now_ns)]
        if Code.ESTOP in self._engine.latches and not self._is_estop_passed:
            self._is_estop_passed = True
            self._ask("estop")
        elif not (self._is_waiting or self._is_estop_passed):
            if not self._must_wait(now_ns):
                self._is_asked = self._is_waiting = True
                self._ask("hand_over")
            elif now_ns - self._looked_ns >= STATUS_NS:
                self._looked_ns, self._is_waiting = now_ns, True
                self._ask("status")
        return []

    def _must_wait(self, now_ns: int) -> bool:
        """Whether the hold is better where it is: this daemon cannot hold yet, or nobody would hold if it died."""
        takeover = self._engine.takeover
        is_long = self._down_ns - now_ns > SPARE_NS
        return bool(takeover.objection(now_ns)) or (is_long and takeover.is_guard_awaited(now_ns - self._begun_ns))

    def confirm(self) -> None:
        """Say that the hold is ours, if it has just become so; called before the frames of the tick leave."""
        if self._is_taken:
            self._ask("taken")
            self.close()

    def close(self) -> None:
        """Let the guard be: it goes on with what was not taken."""
        if self._socket is not None:
            self._socket.close()
            self._socket = None

    def _take(self, answer: GuardAnswer, now_ns: int) -> list[Event]:
        self._is_asked = False
        try:
            held = msgspec.json.decode(answer.held, type=Held | None)
        except ValueError as error:  # of another release: it goes on holding, and ends by itself
            _log.error("the guard's hold is not understood: %s", error)
            self.close()
            return [HeldElsewhere(is_held=False, at_ns=now_ns)]
        if held is None:
            return []
        self._is_taken = True
        return [HeldElsewhere(is_held=False, at_ns=now_ns), TakenOver(held=held, at_ns=now_ns)]

    def _take_latches(self, answer: GuardAnswer) -> None:
        """What the guard has latched is latched here, once: it cannot write it where this daemon has the state file."""
        for name, message in answer.latches.items():
            if name in Code.__members__ and (name, message) not in self._known:
                self._known.add((name, message))
                self._latch(Code(name), message)

    def _ask(self, ask: str) -> None:
        if self._socket is not None:
            with contextlib.suppress(OSError):
                self._socket.send(packed(msgspec.convert({"ask": ask, "client": "daemon"}, GuardQuestion)))

    def _heard(self) -> GuardAnswer | None:
        if self._socket is None:
            return None
        try:
            packet = self._socket.recv(MAX_PACKET_BYTES)
            return read_answer(packet)
        except BlockingIOError:
            return None
        except (OSError, ValueError):
            self.close()
            return None
