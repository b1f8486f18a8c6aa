"""Asks a recorder on this host: one question at its unix socket. Needs no gateway."""

from __future__ import annotations

import os
from collections.abc import Mapping

from gateway.api.guard_protocol import connected
from gateway.api.recorder_protocol import (
    MAX_PACKET_BYTES,
    RecorderAsk,
    RecorderQuestion,
    RecordingState,
    packed,
    read_answer,
    recorder_socket,
)
from gateway.errors import Code, failure

__all__ = ["ask_recorder"]

ANSWER_S = 2.0
"""Longest wait for an answer [s]; it comes within a moment."""


def ask_recorder(
    address: str | None,
    ask: RecorderAsk,
    task: str = "",
    text: str = "",
    timeout_s: float = ANSWER_S,
    facts: Mapping[str, object] | None = None,
) -> RecordingState:
    """Tell a recorder something about an episode or a policy, and return how its recording is then.

    Args:
        address: Of the gateway beside whose socket it listens, see `recorder_socket`.
        ask: What.
        task: Of `start`.
        text: Of a mark or a verdict.
        timeout_s: Longest wait [s].
        facts: Of `policy`, for JSON.

    Raises:
        NotReady: NO_RECORDER, none of this user records there.
        Rejected: It cannot be done now, or makes no sense; field `target`: that is no address.
        OutcomeUnknown: The recorder did not answer.
    """
    path = recorder_socket(address)
    try:
        question = packed(RecorderQuestion(ask=ask, task=task, text=text, facts=facts or {}))
    except UnicodeEncodeError as error:
        raise failure(Code.BAD_REQUEST, f"that is no text: {error}", field="text", hint="write it in UTF-8") from None
    if len(question) > MAX_PACKET_BYTES:
        message, hint = f"{len(question)} bytes are asked, {MAX_PACKET_BYTES} bytes fit", "say it in fewer words"
        raise failure(Code.BAD_REQUEST, message, field="text", hint=hint)
    try:
        if os.stat(path).st_uid != os.geteuid():
            raise FileNotFoundError
        recorder = connected(path, timeout_s)
    except (FileNotFoundError, ConnectionRefusedError, PermissionError):
        raise failure(Code.NO_RECORDER, f"no recorder listens at {path}") from None
    except OSError as error:
        raise _unknown(str(error)) from None
    with recorder:
        try:
            recorder.send(question)
            answer = read_answer(recorder.recv(MAX_PACKET_BYTES))
        except (OSError, ValueError) as error:
            raise _unknown(str(error)) from None
    if answer.error:
        raise failure(Code.BAD_REQUEST, answer.error, hint=answer.hint)
    return answer.state


def _unknown(why: str) -> Exception:
    message, hint = f"the recorder did not answer: {why}", "look at its terminal before you repeat it"
    return failure(Code.OUTCOME_UNKNOWN, message, hint=hint)
