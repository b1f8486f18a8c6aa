"""The last resort of a stop: the guard of a daemon that does not answer. One question at a unix socket; asks nothing else.

The guard listens only while its daemon is dead and it acts. Whoever asks in the instant between the two asks again, for a
moment, as does who was hung up on in a crowd or had no answer in time: a stop may be asked for twice. Where there is no guard
nothing is claimed: whoever asked hears of the daemon's silence.
"""

from __future__ import annotations

import socket
import time
from pathlib import Path

from gateway.api import protocol
from gateway.api.guard_protocol import (
    MAX_PACKET_BYTES,
    Ask,
    GuardQuestion,
    connected,
    guard_socket,
    packed,
    read_answer,
)
from gateway.client.asking.results import StopResult

__all__ = ["PAUSES_S", "stop_at_guard"]

ANSWER_S = 1.0
"""Longest wait for the guard in each try [s]; it answers within a tick, where this host lets it run."""
PAUSES_S = (0.05, 0.1, 0.15)
"""Between tries [s]: a guard takes over within 50 ms of a daemon's death, some 100 ms of a freeze."""


def stop_at_guard(address: str, ask: Ask, reason: str, client: str) -> StopResult | None:
    """Ask the guard of the daemon at an address to stop; return what it did, None when there is none or it only watches.

    The address is as `Transport.address` has it, or as a person typed it.
    """
    try:
        path = protocol.parse_address(address).path
    except protocol.AddressRefused:
        return None
    if path is None or not hasattr(socket, "SOCK_SEQPACKET"):  # a guard is asked on its own host alone
        return None
    question = GuardQuestion(ask=ask, client=client, reason=reason)
    for pause_s in PAUSES_S:
        try:
            return _asked(guard_socket(path), question)
        except (FileNotFoundError, ConnectionError, TimeoutError):  # not yet, not at all, hung up on, or still busy
            time.sleep(pause_s)
        except (OSError, ValueError):
            return None
    try:
        return _asked(guard_socket(path), question)
    except (OSError, ValueError):
        return None


def _asked(path: Path, question: GuardQuestion) -> StopResult | None:
    """Ask once.

    Raises:
        OSError: Nobody listens there, or answers.
        ValueError: The answer makes no sense.
    """
    with connected(path, ANSWER_S) as guard:
        guard.send(packed(question))
        packet = guard.recv(MAX_PACKET_BYTES)
    if not packet:
        raise ConnectionResetError("the guard hung up")
    answer = read_answer(packet)
    return StopResult(undelivered=answer.undelivered, by_guard=True) if answer.done else None
