"""What is said at a recorder's socket: when an episode begins and ends, what came of it, and what a policy wanted.

One packet each way (SOCK_SEQPACKET, JSON). The socket lies beside the gateway's, `<socket>.recorder`, for its user alone; the
gateway itself knows nothing of it. This is all that a client must know of a recorder.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec

from gateway.api.address import RECORDER_SUFFIX, AddressRefused, default_socket, find_socket, parse_address
from gateway.errors import Code, failure

__all__ = [
    "MAX_PACKET_BYTES",
    "RecorderAnswer",
    "RecorderAsk",
    "RecorderQuestion",
    "RecordingState",
    "packed",
    "read_answer",
    "read_question",
    "recorder_socket",
]

MAX_PACKET_BYTES = 16_384
"""No packet is larger."""
Text = Annotated[str, msgspec.Meta(max_length=1000)]
RecorderAsk = Literal["status", "start", "stop", "mark", "success", "failure", "discard", "policy"]


class RecorderQuestion(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """What is wanted: of `start` the task, of a mark or a verdict a text; `policy` notes facts of one that is played."""

    ask: RecorderAsk
    task: Text = ""
    text: Text = ""
    facts: Mapping[str, Any] = {}


class RecordingState(msgspec.Struct, frozen=True, kw_only=True):
    """How a recording is.

    Attributes:
        bag: Folder that is recorded into, on the recorder's host.
        episode: Number of the newest episode; 0 before the first.
        is_running: Whether it goes on.
        task: Of that episode.
    """

    bag: str
    episode: int = 0
    is_running: bool = False
    task: str = ""


class RecorderAnswer(msgspec.Struct, frozen=True, kw_only=True):
    """How the recording is after what was asked; why that was refused, and what then helps, else empty."""

    state: RecordingState
    error: str = ""
    hint: str = ""


_QUESTION = msgspec.json.Decoder(RecorderQuestion)
_ANSWER = msgspec.json.Decoder(RecorderAnswer)


def recorder_socket(address: str | None) -> Path:
    """Return where a recorder of this user listens: beside the gateway's socket, if this user may make one there.

    Args:
        address: Of the gateway, as a person typed it; None finds its socket. One on another host, or in a folder that is not
            this user's, has its recorder beside this user's own socket.

    Raises:
        Rejected: BAD_REQUEST, that is no address.
    """
    try:
        path = find_socket() if address is None else parse_address(address).path
        if path is None or not os.access(path.parent, os.W_OK):
            path = default_socket()
    except AddressRefused as error:
        raise failure(Code.BAD_REQUEST, str(error), field="target", hint="see connect()") from None
    return path.with_name(path.name + RECORDER_SUFFIX)


def packed(message: RecorderQuestion | RecorderAnswer) -> bytes:
    """Return the packet of a message."""
    return msgspec.json.encode(message)


def read_question(packet: bytes) -> RecorderQuestion:
    """Return the question in a packet.

    Raises:
        ValueError: It is none.
    """
    try:
        return _QUESTION.decode(packet)
    except RecursionError as error:  # nested without end
        raise ValueError(str(error)) from None


def read_answer(packet: bytes) -> RecorderAnswer:
    """Return the answer in a packet.

    Raises:
        ValueError: It is none.
    """
    return _ANSWER.decode(packet)
