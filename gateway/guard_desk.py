"""The guard's socket: who asks for a stop while the daemon is dead, and the daemon that comes for the hold. Never waits.

It answers what needs no engine (how the guard is, what it holds) and gives stops to whoever owns the engine. There is one
only while a guard acts: the guard of a daemon that is started again, and ends again, must not hide the one that holds.
"""

from __future__ import annotations

import contextlib
import logging
import os
import socket

import msgspec

from gateway.api.guard_protocol import MAX_PACKET_BYTES, GuardAnswer, GuardQuestion, packed, read_question
from gateway.core.guardian import Guardian, Phase

__all__ = ["GuardDesk"]

_log = logging.getLogger(__name__)

MS = 1_000_000

MOST_CALLERS = 16
"""More are turned away."""
MESSAGE_CHARS = 300
"""No message of a latch takes more of a packet."""


class GuardDesk:
    """Answers at the guard's socket.

    Args:
        path: Of the socket; whatever lies there is replaced.
        mode: Permission bits.
        robot: Which robot it is about, see `robot_name`.
    """

    def __init__(self, path: str, mode: int, robot: str = "") -> None:
        self._path = path
        self._robot = robot
        self._mode = mode
        self._listener: socket.socket | None = None
        self._inode = 0
        self._callers: dict[int, socket.socket] = {}
        self._heir: int | None = None
        """Which caller was given the hold."""

    @property
    def files(self) -> list[socket.socket]:
        """What to wait for."""
        return [*([self._listener] if self._listener is not None else []), *self._callers.values()]

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
            listener.listen(MOST_CALLERS)
            self._inode = os.stat(self._path).st_ino
        except OSError as error:
            listener.close()
            _log.warning("the guard cannot be asked to stop: %s: %s", self._path, error)
            return
        self._listener = listener

    def close(self) -> None:
        """Listen no more; a later guard's socket stays."""
        for caller in self.files:
            caller.close()
        self._callers.clear()
        if self._listener is not None:
            self._listener = None
            with contextlib.suppress(OSError):
                if os.stat(self._path).st_ino == self._inode:
                    os.unlink(self._path)

    def poll(self, guardian: Guardian, now_ns: int) -> list[tuple[int, GuardQuestion]]:
        """Answer what was asked; return the stops, each with the number under which `stopped` answers it.

        Args:
            guardian: Who watches or acts.
            now_ns: Monotonic time [ns].
        """
        self._accept()
        stops = []
        for number, caller in list(self._callers.items()):
            try:
                packet = caller.recv(MAX_PACKET_BYTES)
            except BlockingIOError:
                continue
            except OSError:
                packet = b""
            try:
                question = read_question(packet)
            except ValueError:  # nothing: it hung up; or nothing that we understand
                self._hang_up(number, guardian, now_ns)
                continue
            if question.ask in ("stop", "estop") and guardian.phase is Phase.ACTING:
                stops.append((number, question))
            else:
                self._reply(number, self._answer_to(question, number, guardian, now_ns))
        return stops

    def stopped(self, number: int, guardian: Guardian, now_ns: int, *, is_undelivered: bool) -> None:
        """Answer a stop that was carried out."""
        answer = self._answer(guardian, now_ns)
        self._reply(number, msgspec.structs.replace(answer, done=True, undelivered=is_undelivered))

    def _accept(self) -> None:
        while self._listener is not None:
            try:
                caller, _ = self._listener.accept()
            except OSError:  # nobody waits any more
                return
            caller.setblocking(False)
            if len(self._callers) >= MOST_CALLERS:
                caller.close()
                continue
            self._callers[caller.fileno()] = caller

    def _answer_to(self, question: GuardQuestion, number: int, guardian: Guardian, now_ns: int) -> GuardAnswer:
        if question.ask == "hand_over" and (held := guardian.hand_over(now_ns)) is not None:
            self._heir = number
            raw = msgspec.Raw(msgspec.json.encode(held))
            return msgspec.structs.replace(self._answer(guardian, now_ns), done=True, held=raw)
        if question.ask == "taken" and number == self._heir:
            guardian.handed_on()
            return msgspec.structs.replace(self._answer(guardian, now_ns), done=True)
        return self._answer(guardian, now_ns)

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
        self._callers.pop(number).close()
        if number == self._heir:
            self._heir = None
            guardian.take_back(now_ns)

    def _reply(self, number: int, answer: GuardAnswer) -> None:
        caller = self._callers.get(number)
        if caller is not None:
            with contextlib.suppress(OSError):  # it does not listen: it is heard of no more, and will be dropped
                caller.send(packed(answer))
