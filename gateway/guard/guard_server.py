"""The guard's socket: who asks for a stop while the daemon is dead, and the daemon that comes for the hold. Never waits.

It answers what needs no engine (how the guard is, what it holds) and gives stops to whoever owns the engine. There is one
only while a guard acts: the guard of a daemon that is started again, and ends again, must not hide the one that holds.

Nobody shuts others out: who comes is let in and read, and then, where there are too many, whoever was silent longest among
the connections of the busiest user, of his busiest process, goes; not a stop under way, nor the next daemon. What one look
costs is bounded, however many come.
What was dropped into the pipes of stops beside the daemon's socket is read at each tick while the guard acts.
The hold is given to the guard's own user and to root alone: that of the daemon; who may ask for a stop may not take it.
"""

from __future__ import annotations

import contextlib
import logging
import os
import socket
import struct
from collections import Counter
from pathlib import Path

import msgspec
from msgspec import Struct

from gateway.api.guard_protocol import (
    MAX_PACKET_BYTES,
    GuardAnswer,
    GuardQuestion,
    packed,
    read_dropped,
    read_question,
)
from gateway.api.keys import ESTOP_KEY
from gateway.api.stop_pipe import StopPipes
from gateway.core.guardian import Guardian, Phase

__all__ = ["GuardServer", "peer"]

_log = logging.getLogger(__name__)

MS = 1_000_000

MOST_CALLERS = 16
"""More do not stay."""
MOST_NEWCOMERS = 16
"""So many are let in at one look; the others wait in the queue for the next, which follows at once."""
QUEUE = 1024
"""So many may wait to be let in, where the kernel allows as many."""
SUCCESSOR = "daemon"
"""As whom the next daemon asks: hung up on, it would begin beside the hold. One keeps its place."""
MESSAGE_CHARS = 300
"""No message of a latch takes more of a packet."""


class _Caller(Struct):
    """A connection, with who is at its other end (a process id of 0: of another namespace) and when it was last heard."""

    socket: socket.socket
    uid: int
    pid: int
    heard_ns: int
    is_waiting: bool = False
    """Whether its stop is being carried out."""
    is_successor: bool = False
    """Whether it is the next daemon, as far as anybody of its user is, waiting until it can hold."""


def peer(caller: socket.socket) -> tuple[int, int]:
    """Return the user and the process at the other end."""
    pid, uid, _ = struct.unpack("iII", caller.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, 12))
    return uid, pid


class GuardServer:
    """Answers at the guard's socket.

    Args:
        path: Of the socket; whatever lies there is replaced.
        mode: Permission bits.
        robot: Which robot it is about, see `robot_name`.
        daemon: The daemon's socket, beside which stops are dropped; None for nowhere.
    """

    def __init__(self, path: str, mode: int, robot: str = "", daemon: Path | None = None) -> None:
        self._path = path
        self._robot = robot
        self._mode = mode
        self._listener: socket.socket | None = None
        self._pipes: StopPipes | None = None
        if daemon is not None:
            try:
                self._pipes = StopPipes(daemon, mode)
            except OSError as error:
                _log.warning("the guard has no pipes for stops: %s", error)
        self._inode = 0
        self._callers: dict[int, _Caller] = {}
        self._last = 0
        """Number of the newest caller; none is used again."""
        self._refused: set[int] = set()
        """Users of whom was told that they asked for the hold."""
        self._recipient: int | None = None
        """Which caller was given the hold."""

    @property
    def files(self) -> list[socket.socket]:
        """What to wait for."""
        callers = [caller.socket for caller in self._callers.values()]
        return [*([self._listener] if self._listener is not None else []), *callers]

    def sweep(self) -> None:
        """Take away the socket of a guard that was killed; one that listens stays."""
        with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET | socket.SOCK_NONBLOCK) as caller:
            try:
                caller.connect(self._path)
            except ConnectionRefusedError:
                with contextlib.suppress(OSError):
                    os.unlink(self._path)
            except OSError:  # there is none, or a busy one
                return

    def open(self) -> None:
        """Listen; without a place to listen at the guard works all the same, and says so."""
        listener = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET | socket.SOCK_NONBLOCK | socket.SOCK_CLOEXEC)
        try:
            with contextlib.suppress(FileNotFoundError):
                os.unlink(self._path)
            before = os.umask(0o177)
            try:
                listener.bind(self._path)
            finally:
                os.umask(before)
            os.chmod(self._path, self._mode)
            listener.listen(QUEUE)
            self._inode = os.stat(self._path).st_ino
        except OSError as error:
            listener.close()
            _log.warning("the guard cannot be asked to stop: %s: %s", self._path, error)
            return
        self._listener = listener

    def close(self) -> None:
        """Listen no more; a later guard's socket stays."""
        if self._pipes is not None:
            self._pipes.close()
        for file in self.files:
            file.close()
        self._callers.clear()
        if self._listener is not None:
            self._listener = None
            with contextlib.suppress(OSError):
                if os.stat(self._path).st_ino == self._inode:
                    os.unlink(self._path)

    def poll(self, guardian: Guardian, now_ns: int) -> list[tuple[int, GuardQuestion]]:
        """Answer what was asked; return the stops, each with the number under which `stopped` answers it."""
        self._accept(now_ns)
        stops = self._dropped() if guardian.phase is Phase.ACTING else []
        for number, caller in list(self._callers.items()):
            try:
                packet = caller.socket.recv(MAX_PACKET_BYTES)
            except BlockingIOError:
                continue
            except OSError:
                packet = b""
            caller.heard_ns = now_ns
            try:
                question = read_question(packet)
            except ValueError:  # nothing: it hung up; or nothing that we understand
                self._hang_up(number, guardian, now_ns)
                continue
            if question.ask in ("stop", "estop") and guardian.phase is Phase.ACTING:
                caller.is_waiting = True
                stops.append((number, question))
            elif question.ask == "hand_over" and stops:  # they are carried out here first; the next daemon asks again
                self._reply(number, self._answer(guardian, now_ns))
            else:
                if question.client == SUCCESSOR and not any(c.is_successor for c in self._callers.values()):
                    caller.is_successor = caller.uid in (os.geteuid(), 0)
                self._reply(number, self._answer_to(question, number, guardian, now_ns))
        self._make_room(guardian, now_ns)
        return stops

    def _dropped(self) -> list[tuple[int, GuardQuestion]]:
        """Return the stops that were dropped, under a number that no caller has."""
        dropped = [] if self._pipes is None else self._pipes.read()
        return [(0, read_dropped(payload, "estop" if key == ESTOP_KEY else "stop")) for key, payload in dropped]

    def stopped(self, number: int, guardian: Guardian, now_ns: int, *, is_undelivered: bool) -> None:
        """Answer a stop that was carried out."""
        answer = self._answer(guardian, now_ns)
        self._reply(number, msgspec.structs.replace(answer, done=True, undelivered=is_undelivered))

    def _accept(self, now_ns: int) -> None:
        for _ in range(MOST_NEWCOMERS):
            if self._listener is None:
                return
            try:
                caller, _ = self._listener.accept()
                uid, pid = peer(caller)
            except OSError:  # nobody waits any more
                return
            caller.setblocking(False)
            self._last += 1
            self._callers[self._last] = _Caller(caller, uid, pid, now_ns)

    def _make_room(self, guardian: Guardian, now_ns: int) -> None:
        """Hang up on the most silent ones of the busiest user's busiest process; never on a stop, nor on the successor."""
        excess = len(self._callers) - MOST_CALLERS
        if excess <= 0:
            return
        leaving = {
            n: c for n, c in self._callers.items() if not (c.is_waiting or c.is_successor or n == self._recipient)
        }
        of_uid = Counter(caller.uid for caller in leaving.values())
        of_pid = Counter((caller.uid, caller.pid) for caller in leaving.values())
        for _ in range(min(excess, len(leaving))):
            number = min(
                leaving,
                key=lambda n: (
                    -of_uid[leaving[n].uid],
                    -of_pid[leaving[n].uid, leaving[n].pid],
                    leaving[n].heard_ns,
                    n,
                ),
            )
            caller = leaving.pop(number)
            of_uid[caller.uid] -= 1
            of_pid[caller.uid, caller.pid] -= 1
            self._hang_up(number, guardian, now_ns)

    def _answer_to(self, question: GuardQuestion, number: int, guardian: Guardian, now_ns: int) -> GuardAnswer:
        if question.ask == "hand_over" and not self._is_trusted(number):
            return self._answer(guardian, now_ns)
        if question.ask == "hand_over" and (held := guardian.hand_over(now_ns)) is not None:
            self._recipient = number
            raw = msgspec.Raw(msgspec.json.encode(held))
            return msgspec.structs.replace(self._answer(guardian, now_ns), done=True, held=raw)
        if question.ask == "taken" and number == self._recipient:
            guardian.handed_on()
            return msgspec.structs.replace(self._answer(guardian, now_ns), done=True)
        return self._answer(guardian, now_ns)

    def _is_trusted(self, number: int) -> bool:
        """Whether a caller is of the guard's own user, or root: nobody else's process is the next daemon."""
        caller = self._callers[number]
        if caller.uid in (os.geteuid(), 0):
            return True
        if caller.uid not in self._refused:  # once: nobody fills the log
            self._refused.add(caller.uid)
            _log.warning(
                "the hold is not given to process %d of user %d: only to user %d, whose daemon this was, or root",
                *(caller.pid, caller.uid, os.geteuid()),
            )
        return False

    def _answer(self, guardian: Guardian, now_ns: int) -> GuardAnswer:
        return GuardAnswer(
            phase=guardian.phase.value,
            pid=os.getpid(),
            state=guardian.engine.state.value,
            latches={code.value: message[:MESSAGE_CHARS] for code, message in guardian.engine.latches.items()},
            robot=self._robot,
            left_ms=guardian.left_ns(now_ns) // MS,
        )

    def _hang_up(self, number: int, guardian: Guardian, now_ns: int) -> None:
        """A caller is gone; if it was to have the hold, it has died before it had it."""
        self._callers.pop(number).socket.close()
        if number == self._recipient:
            self._recipient = None
            guardian.take_back(now_ns)

    def _reply(self, number: int, answer: GuardAnswer) -> None:
        caller = self._callers.get(number)
        if caller is not None:
            caller.is_waiting = False
            with contextlib.suppress(OSError):  # it does not listen: it is heard of no more, and will be dropped
                caller.socket.send(packed(answer))
