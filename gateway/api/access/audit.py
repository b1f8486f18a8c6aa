"""Who asked for what, when, and what was answered: one JSON line each, appended to a file.

Rules
    * Nothing here is waited for, and nothing of the disk happens outside the one thread that writes: it may hang or be full
      for as long as it likes. What finds no room then is counted, and the next line that is written says so.
    * Refusals are written, and stops, whichever way they come. Targets, keepalives and questions about the state are not.
    * Each user, and each client of the socket, may have so many lines: a flood of one hides nobody else, and wears no
      earlier lines out of the file. Velocities that were taken come ten times a second: they hide nothing else of his either.
    * The file is opened anew for each line, so that others may move it away.
"""

from __future__ import annotations

import logging
import os
import queue
import time
from collections.abc import Callable
from datetime import datetime, timezone
from typing import Any

import msgspec

from gateway.api import protocol
from gateway.api.access.roles import Asker
from gateway.api.keys import printable
from gateway.api.question import Question
from gateway.api.stop_lane import READ_BYTES, StopLane
from gateway.errors import Code
from gateway.messages.requests import DriveChassis, DriveLift
from gateway.process.threads import Lost, supervised
from gateway.values import Role

__all__ = ["KEPT", "LINES_AT_ONCE", "MAX_WAITING", "MOST_CLIENTS", "TEXT_CHARS", "Audit"]

MAX_WAITING = 1024
"""Lines that may wait for the disk."""
LINES_AT_ONCE = 50
"""Of one user, who may have another one each `LINE_NS`; stops, and his driving that was taken, have as many for themselves."""
LINE_NS = 1_000_000_000
MOST_CLIENTS = 64
"""So many clients that are no named users have lines of their own; the others share theirs, since ids cost nothing."""
TEXT_CHARS = 100
"""Of each text in a line."""
KEPT = 5
"""Earlier files that are kept, `.1` the latest."""
COMPLAINT_NS = 10_000_000_000
"""At most so often the log says that lines are lost [ns]."""
TOLD = ("name", "pid", "reason", "epoch")
"""What of a request is written down."""

log = logging.getLogger(__name__)

_Line = dict[str, Any]


class Audit:
    """Writes down what was asked. Any thread may call `watched` and `note_stop`; they never wait.

    Args:
        path: Of the file; empty to write nothing.
        most_bytes: Size at which it is begun anew.
        stops: Reads who stopped and why.
    """

    def __init__(self, path: str, most_bytes: int, stops: StopLane) -> None:
        self.lost = 0
        """Lines that were not written."""
        self._path, self.most_bytes = path, most_bytes
        self._read_stop = stops.read
        self._waiting: queue.SimpleQueue[Callable[[], _Line] | None] = queue.SimpleQueue()
        self._paid_ns: dict[str, int] = {}
        """When each will have the right to all of its lines again [ns]."""
        self._complain_ns = 0
        self._is_closing = False
        self._thread = supervised(
            self._write, "ta2-api-audit", may_return=lambda: self._is_closing, again=True, on_lost=_is_told
        )

    def start(self) -> None:
        """Begin to write, where a file was named."""
        if self._path:
            self._thread.start()

    def close(self, timeout_s: float) -> None:
        """Write what waits, at most so long [s]; a disk that hangs is left to itself."""
        self._is_closing = True
        self._waiting.put(None)
        if self._thread.is_alive():
            self._thread.join(timeout_s)

    # ------------------------------------------------------------------------------------------------ any thread

    def watched(self, question: Question, command: protocol.Command | None = None) -> Question:
        """Return a question whose answer will be written down.

        Args:
            question: As it came: a stop on its own key, or a command.
            command: What it says; None for a stop, and for what was not or cannot be read.
        """
        if not self._path:
            return question
        if question.key in STOPS:
            return _Watched(question, self._put, "stop", self._of_stop(question.key, question.payload))
        said: _Line = {"request": "unread"}
        if command is not None:
            told = {name: getattr(command.request, name, "") for name in TOLD}
            said = {"request": type(command.request).__name__, "client": command.client_id}
            said |= {name: value for name, value in told.items() if value != ""}
        asker = question.asker
        whose = asker.user or (command.client_id if command is not None and asker.role is not Role.VIEWER else "")
        is_driving = command is not None and isinstance(command.request, (DriveChassis, DriveLift))
        return _Watched(question, self._put, f"{asker.door} {whose}", lambda: said, is_driving=is_driving)

    def note_stop(self, key: str, payload: bytes, received_ns: int, door: str) -> None:
        """Write down a stop that wants no answer."""
        if self._path:
            self._put("stop", received_ns, Asker(door=door), self._of_stop(key, payload))

    def note_reading(self, message: str, at_ns: int, *, is_refused: bool) -> None:
        """Write down that the settings were read anew: this user alone, and root, can send the signal for it."""
        if self._path:
            answer = Code.SETTINGS_REFUSED if is_refused else "ok"
            line: _Line = {"request": "Reload", "answer": str(answer), "message": message}
            self._put("signal ", at_ns, Asker(door="signal"), lambda: line)

    def _of_stop(self, key: str, payload: bytes) -> Callable[[], _Line]:
        head = payload[: READ_BYTES + 1]

        def said() -> _Line:
            who, name, reason = self._read_stop(head)
            told = {"name": name, "reason": reason}
            return {"request": STOPS[key], "client": who, **{field: text for field, text in told.items() if text}}

        return said

    def _put(self, whose: str, received_ns: int, asker: Asker, says: Callable[[], _Line]) -> None:
        now_ns = time.monotonic_ns()
        if not self._may(whose, is_user=whose == "stop" or bool(asker.user), now_ns=now_ns):
            self.lost += 1
            return
        at_s = (time.time_ns() - now_ns + received_ns) / 1e9
        line: _Line = {"at": "", "at_ns": received_ns, "door": asker.door}
        if whose != "stop":  # everybody stops on the same key
            line |= {"user": asker.user, "role": asker.role.value}
        self._waiting.put(lambda: line | {"at": _iso(at_s)} | says())

    def _may(self, whose: str, *, is_user: bool, now_ns: int) -> bool:
        """Return whether somebody may have one more line, and take it off what he has."""
        if whose not in self._paid_ns and not is_user and len(self._paid_ns) >= MOST_CLIENTS:
            for name, paid_ns in list(self._paid_ns.items()):  # a copy: other threads add to it
                if paid_ns <= now_ns:
                    self._paid_ns.pop(name, None)
            if len(self._paid_ns) >= MOST_CLIENTS:
                whose = "others"
        paid_ns = max(self._paid_ns.get(whose, 0), now_ns) + LINE_NS
        if paid_ns - now_ns > LINES_AT_ONCE * LINE_NS or self._waiting.qsize() >= MAX_WAITING:
            return False
        self._paid_ns[whose] = paid_ns
        return True

    # ------------------------------------------------------------------------------------------------ its own thread

    def _write(self) -> None:
        told, is_whole = 0, False
        while (says := self._waiting.get()) is not None:
            lost = self.lost
            try:
                line = {name: _cut(value) for name, value in says().items()}
                line |= {"lost": lost - told} if lost > told else {}
                self._append(msgspec.json.encode(line) + b"\n", is_whole)
                told, is_whole = lost, True
            except Exception as error:  # noqa: BLE001  the disk, or a line that is none, whyever: the next may be one
                is_whole = False
                self.lost += 1
                if time.monotonic_ns() >= self._complain_ns:
                    self._complain_ns = time.monotonic_ns() + COMPLAINT_NS
                    why = f"{type(error).__name__}: {error}"
                    log.error("the audit log %s cannot be written: %s (%d lines lost)", self._path, why, self.lost)

    def _append(self, line: bytes, is_whole: bool) -> None:
        """Append a line; where nobody knows that the one before is whole, look."""
        flags = os.O_WRONLY | os.O_APPEND | os.O_CREAT | os.O_CLOEXEC | os.O_NOFOLLOW
        file = os.open(self._path, flags, 0o600)
        try:
            size = os.fstat(file).st_size
            if size and size + len(line) > self.most_bytes:
                for number in range(KEPT - 1, 0, -1):
                    if os.path.exists(f"{self._path}.{number}"):
                        os.replace(f"{self._path}.{number}", f"{self._path}.{number + 1}")
                os.replace(self._path, f"{self._path}.1")
                file, earlier = os.open(self._path, flags, 0o600), file
                os.close(earlier)
            elif size and not is_whole:
                with open(self._path, "rb") as earlier_lines:
                    earlier_lines.seek(-1, os.SEEK_END)
                    line = line if earlier_lines.read() == b"\n" else b"\n" + line
            if os.write(file, line) != len(line):
                raise OSError("only a part of a line found room")
        finally:
            os.close(file)


STOPS = {protocol.STOP_KEY: "Stop", protocol.ESTOP_KEY: "Estop"}


class _Watched:
    """A question whose answer is put down with what was asked: by whose share, and what says it."""

    __slots__ = (
        "_is_driving",
        "_put",
        "_question",
        "_says",
        "_whose",
        "asker",
        "encoding",
        "key",
        "payload",
        "received_ns",
    )

    def __init__(
        self,
        question: Question,
        put: Callable[..., None],
        whose: str,
        says: Callable[[], _Line],
        *,
        is_driving: bool = False,
    ) -> None:
        self.key, self.payload, self.encoding = question.key, question.payload, question.encoding
        self.received_ns, self.asker = question.received_ns, question.asker
        self._question, self._put, self._whose, self._says = question, put, whose, says
        self._is_driving = is_driving

    def answer(self, payload: bytes, encoding: str) -> None:
        self._question.answer(payload, encoding)
        says, whose = self._says, self._whose
        if self._is_driving and _answer(payload, encoding)["answer"] == "ok":
            whose += " drive"
        self._put(whose, self.received_ns, self.asker, lambda: says() | _answer(payload, encoding))

    def drop(self) -> None:
        self._question.drop()
        says = self._says
        self._put(self._whose, self.received_ns, self.asker, lambda: says() | {"answer": "none"})


def _cut(value: object) -> object:
    return printable(value)[:TEXT_CHARS] if isinstance(value, str) else value


def _is_told(lost: Lost) -> None:
    """Nothing more than the log, which has it: no robot stops because nobody writes down who asked."""


def _iso(at_s: float) -> str:
    return datetime.fromtimestamp(at_s, timezone.utc).isoformat(timespec="milliseconds")


def _answer(payload: bytes, encoding: str) -> _Line:
    """Return what was answered: `ok`, or the code of the refusal."""
    reply = protocol.decode_reply(payload, encoding)
    if reply.refusal is not None:
        return {"answer": reply.refusal.code, "message": reply.refusal.message}
    return {"answer": "ok", **{name: reply.facts[name] for name in ("epoch",) if name in reply.facts}}
