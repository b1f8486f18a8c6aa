"""What is said at the guard's socket: a stop while the daemon is dead, and the way a hold comes to the next daemon.

One packet each way (SOCK_SEQPACKET, JSON). The socket lies beside the daemon's: `<socket>.guard`. A guard that only
watches says so, and does nothing: a living daemon is asked itself. This is all that a client must know of the guard.

A stop is its arrival: where a packet is no question, but names one (`{"ask": "estop", "reason": 5}`, cut JSON, a plain
`STOP`), it is that stop, with name and reason as far as they can be read.
"""

from __future__ import annotations

import re
import socket
import struct
from pathlib import Path
from typing import Literal

import msgspec

from gateway.api.address import GUARD_SUFFIX
from gateway.api.keys import printable
from gateway.api.stop_pipe import may_be_map
from gateway.robot.endpoint import robot_name

__all__ = [
    "MAX_PACKET_BYTES",
    "GuardAnswer",
    "GuardQuestion",
    "connected",
    "guard_socket",
    "packed",
    "read_answer",
    "read_dropped",
    "read_question",
    "robot_name",
]

MAX_PACKET_BYTES = 16_384
"""No packet is larger."""

STOP_WORD = re.compile(rb'(?:\A\W*|"ask"\s*:\s*")(e-?stop|stop)(?!\w)', re.IGNORECASE)
"""A stop in a packet that is no question: its first word, or what it asks for."""
TEXT_OF = r'"%s"\s*:\s*"((?:[^"\\]|\\.)*)'

Ask = Literal["status", "stop", "estop", "hand_over", "taken"]
"""`hand_over` and `taken` are a daemon's: give me what you hold; I have it, you may go."""


class GuardQuestion(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """What is wanted, by whom, and why."""

    ask: Ask
    client: str = ""
    reason: str = ""


class GuardAnswer(msgspec.Struct, frozen=True, kw_only=True):
    """How the guard is, and what it did.

    Attributes:
        phase: `watching` (the daemon lives), `acting`, `handed` or `done`.
        pid: Process id of the guard.
        state: What a supervisor would show, e.g. `HOLDING`.
        done: Whether what was asked was done.
        undelivered: Whether a stop could not be delivered: use the physical emergency stop.
        held: What is on the wire, for a daemon that asked for it; `null` else.
        latches: Causes that this guard has latched, with their messages.
        robot: Which robot it commands, as `robot_name` has it.
        left_ms: How long its hold will go on [ms]; 0 when it holds nothing.
    """

    phase: str
    pid: int
    state: str
    done: bool = False
    undelivered: bool = False
    held: msgspec.Raw = msgspec.Raw(b"null")
    latches: dict[str, str] = {}
    robot: str = ""
    left_ms: int = 0


_QUESTION = msgspec.json.Decoder(GuardQuestion)
_ANSWER = msgspec.json.Decoder(GuardAnswer)


def guard_socket(socket: Path) -> Path:
    """Return where the guard of the daemon at this socket listens."""
    return socket.with_name(socket.name + GUARD_SUFFIX)


def packed(message: GuardQuestion | GuardAnswer) -> bytes:
    """Return the packet of a message."""
    return msgspec.json.encode(message)


def read_question(packet: bytes) -> GuardQuestion:
    """Return the question in a packet; a stop also where it cannot be read otherwise.

    Raises:
        ValueError: It is none.
    """
    try:
        question = _QUESTION.decode(packet)
    except (ValueError, RecursionError) as error:  # no JSON, cut, of other types, or nested without end
        word = STOP_WORD.search(packet)
        if word is None:
            raise ValueError(f"no question: {error}") from None
        ask: Ask = "stop" if word[1].lower() == b"stop" else "estop"
        rest = packet[word.end() :].decode(errors="replace").strip()
        text = packet.decode(errors="replace")
        reason = _text_of("reason", text) if "{" in text else rest
        question = GuardQuestion(ask=ask, client=_text_of("client", text), reason=reason)
    return msgspec.structs.replace(question, client=printable(question.client), reason=printable(question.reason))


def read_dropped(payload: bytes, ask: Ask) -> GuardQuestion:
    """Return the stop that was dropped into a pipe, with name and reason as far as they can be read."""
    text = payload.decode(errors="replace").strip()
    reason = _text_of("reason", text) if may_be_map(payload) else text
    return GuardQuestion(ask=ask, client=printable(_text_of("name", text)), reason=printable(reason))


def _text_of(name: str, text: str) -> str:
    found = re.search(TEXT_OF % name, text)
    return found[1] if found is not None else ""


def connected(path: Path, timeout_s: float) -> socket.socket:
    """Return a connection to a guard. In a crowd it waits for its place in the queue, which no timeout of Python's does.

    Args:
        path: Of its socket.
        timeout_s: Longest wait for a place, then for each packet [s].

    Raises:
        OSError: Nobody listens there; BlockingIOError: there was no place in time.
    """
    caller = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    try:
        seconds, rest = divmod(round(timeout_s * 1e6), 1_000_000)
        caller.setsockopt(socket.SOL_SOCKET, socket.SO_SNDTIMEO, struct.pack("ll", seconds, rest))
        caller.connect(str(path))
        caller.settimeout(timeout_s)
    except BaseException:
        caller.close()
        raise
    return caller


def read_answer(packet: bytes) -> GuardAnswer:
    """Return the answer in a packet.

    Raises:
        ValueError: It is none.
    """
    return _ANSWER.decode(packet)
