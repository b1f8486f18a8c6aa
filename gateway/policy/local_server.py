"""A policy that is a function in Python, asked as a server is: in a process of its own, which may hang, fail or die.

Whatever goes wrong there is told as of a server: lost, silent, or failed. One that is silent for too long is ended.
"""

from __future__ import annotations

import os
import signal
import socket
import subprocess
from collections.abc import Mapping
from contextlib import suppress
from typing import Any, BinaryIO

from gateway.errors import Code, GatewayError, failure
from gateway.policy.local_policy import received, send
from gateway.policy.openpi import FIRST_ANSWER_S, decoded, encoded
from gateway.process.own_module import own_module

__all__ = ["LocalPolicy"]


class LocalPolicy:
    """`MODULE:FUNCTION` in a process of its own, begun by `connect`; used by one thread, closed by any.

    The longest waits [s] are as a `PolicyServer`'s, `first_answer_s` for the import as well.
    """

    def __init__(self, name: str, *, answer_s: float = 5.0, first_answer_s: float = FIRST_ANSWER_S) -> None:
        self.url = name
        self.metadata: Mapping[Any, Any] = {}
        self._answer_s, self._first_answer_s = answer_s, first_answer_s
        self._running: tuple[subprocess.Popen[bytes], socket.socket, BinaryIO] | None = None
        self._has_answered = False

    @property
    def is_connected(self) -> bool:
        """Whether there is a process that was not lost yet."""
        return self._running is not None

    def connect(self) -> None:
        """Begin a process, and wait until it has imported the function. Raises as `ask` does."""
        self.close()
        ours, theirs = socket.socketpair()
        with theirs:
            command, nowhere = own_module("gateway.policy.local_policy", self.url, str(os.getpid())), subprocess.DEVNULL
            # A session of its own: Ctrl-C in the terminal is for who plays it.
            process = subprocess.Popen(command, stdin=theirs.fileno(), stdout=nowhere, start_new_session=True)
        self._running, self._has_answered = (process, ours, ours.makefile("rb")), False
        self.metadata = self._exchange(None, self._first_answer_s)

    def ask(self, observation: Mapping[str, Any]) -> dict[Any, Any]:
        """Return the function's answer to an observation. Raises as `PolicyServer.ask` does."""
        answer = self._exchange(encoded(observation), self._answer_s if self._has_answered else self._first_answer_s)
        self._has_answered = True
        return answer

    def close(self) -> None:
        """End the process, and what it has begun; nothing when there is none."""
        running, self._running = self._running, None
        if running is not None:
            process, end, stream = running
            with suppress(OSError):
                end.shutdown(socket.SHUT_RDWR)  # wakes who reads
            stream.close()
            end.close()
            with suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
            process.wait()

    def _exchange(self, frame: bytes | None, wait_s: float) -> dict[Any, Any]:
        if self._running is None:
            raise self._failed(Code.DISCONNECTED, "is not there", "see what it printed")
        _, end, stream = self._running
        try:
            end.settimeout(wait_s)
            if frame is not None:
                with suppress(BrokenPipeError):  # what it said before it ended is still there to be read
                    send(end, frame)
            answer, has_failed = received(stream)
        except TimeoutError:
            self.close()
            what, hint = f"did not answer in {wait_s:g} s, and was ended", "wait longer with --timeout"
            raise self._failed(Code.TIMEOUT, what, hint) from None
        except (OSError, EOFError, ValueError) as error:  # the last one where another thread closes it
            self.close()
            raise self._failed(Code.DISCONNECTED, f"is gone: {error}", "see what it printed") from None
        if has_failed:
            self.close()
            raise self._failed(
                Code.POLICY_FAILED,
                f"failed: {answer.decode()[:300]}",
                "where its own code failed, the traceback is on stderr",
            )
        return decoded(answer)

    def _failed(self, code: Code, what: str, hint: str) -> GatewayError:
        message = f"the local policy {self.url} {what}"
        return failure(code, message, field="server", hint=hint)
