"""Where a recorder is told about episodes and policies: a unix socket for its user alone, in a thread of its own.

One caller at a time, one packet each way, a quarter of a second for each: whoever hangs there keeps other callers waiting, and
nobody else. Nothing of the recording waits for it.
"""

from __future__ import annotations

import contextlib
import os
import socket
import threading
from collections.abc import Callable, Mapping
from pathlib import Path

from gateway.api.recorder_protocol import (
    MAX_PACKET_BYTES,
    RecorderAnswer,
    RecorderAsk,
    RecordingState,
    packed,
    read_question,
)
from gateway.errors import Code, GatewayError, failure
from gateway.process.threads import supervised

__all__ = ["Door"]

CALLER_S = 0.25
LOOK_S = 0.1
QUEUE = 8


class Door:
    """Listens.

    Args:
        path: Of the socket, see `recorder_socket`.
        carry_out: Does what is asked; may raise a `GatewayError`.
        state: Tells how the recording is.
        note: Takes facts about a policy that is played; returns whether there was room for them.

    Raises:
        Rejected: BAD_REQUEST, another recorder listens there, or it cannot be made.
    """

    def __init__(
        self,
        path: Path,
        carry_out: Callable[[RecorderAsk, str, str], RecordingState],
        state: Callable[[], RecordingState],
        note: Callable[[Mapping[str, object]], bool] = lambda facts: False,
    ) -> None:
        self._path = path
        self._note = note
        self._carry_out = carry_out
        self._state = state
        self._is_closing = threading.Event()
        self._listener = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        try:
            path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
            _sweep(path)
            before = os.umask(0o177)
            try:
                self._listener.bind(str(path))
            finally:
                os.umask(before)
            self._inode = os.stat(path).st_ino
            self._listener.listen(QUEUE)
            self._listener.settimeout(LOOK_S)
        except OSError as error:
            self._listener.close()
            message = f"this recorder cannot be told of episodes at {path}: {error.strerror or error}"
            hint = "keys work all the same; two recorders at one gateway cannot both be told"
            raise failure(Code.BAD_REQUEST, message, hint=hint) from None
        self._thread = supervised(self._serve, "ta2-record-door", may_return=self._is_closing.is_set, again=True)
        self._thread.start()

    def close(self) -> None:
        """Listen no more; another recorder's socket stays."""
        self._is_closing.set()
        self._thread.join(2 * (LOOK_S + CALLER_S))
        with contextlib.suppress(OSError):
            if os.stat(self._path).st_ino == self._inode:
                os.unlink(self._path)
        self._listener.close()

    def _serve(self) -> None:
        while not self._is_closing.is_set():
            with contextlib.suppress(OSError):  # nobody came, or whoever came has gone
                caller, _ = self._listener.accept()
                with caller:
                    caller.settimeout(CALLER_S)
                    packet = caller.recv(MAX_PACKET_BYTES)
                    if packet:
                        caller.send(packed(self._answer(packet)))

    def _answer(self, packet: bytes) -> RecorderAnswer:
        try:
            question = read_question(packet)
        except ValueError as error:
            return RecorderAnswer(state=self._state(), error=f"nobody can read that: {error}")
        if question.ask == "policy":
            return RecorderAnswer(state=self._state(), error="" if self._note(question.facts) else "it was not noted")
        try:
            return RecorderAnswer(state=self._carry_out(question.ask, question.task, question.text))
        except GatewayError as error:
            return RecorderAnswer(state=self._state(), error=error.message, hint=error.hint)


def _sweep(path: Path) -> None:
    """Take away the socket of a recorder that was killed; one that listens stays."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET | socket.SOCK_NONBLOCK) as caller:
        try:
            caller.connect(str(path))
        except ConnectionRefusedError:
            os.unlink(path)
        except OSError:  # there is none, or a busy one
            return
