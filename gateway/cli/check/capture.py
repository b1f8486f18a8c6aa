"""What came over the robot's topics while a check listened, with the arrival of each message; read when it is judged.

States and commands, ours too: both ends of a reaction lie on one clock, outside the process that caused it.
"""

from __future__ import annotations

import json
import struct
from collections import deque
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from cdr_types import CdrError, decode, message_type
from gateway.robot.topics import CURRENT_MODE, JOINT_STATE, TOPICS

__all__ = ["ALL", "Capture", "Span", "stamp_ns"]


class Span(NamedTuple):
    """A part of what came, both ends included [ns]."""

    begin_ns: int = 0
    end_ns: int = 2**62


ALL = Span()
KEPT = 24_000
"""Messages of a topic that are kept, the newest: two minutes at 200 Hz. A person may think for hours before anything moves."""


class Capture:
    """Keeps what comes.

    Args:
        topics: ROS names without a namespace, by number.
    """

    def __init__(self, topics: Sequence[str]) -> None:
        self._kept: list[deque[tuple[int, bytes]]] = [deque(maxlen=KEPT) for _ in topics]
        self._number = {topic: number for number, topic in enumerate(topics)}

    def take(self, number: int, at_ns: int, payload: bytes) -> None:
        """Keep a message of the topic of that number, with its monotonic arrival [ns]; from any thread."""
        self._kept[number].append((at_ns, payload))

    def arrivals(self, topic: str, span: Span = ALL) -> list[tuple[int, bytes]]:
        """Return arrival [ns] and payload of each message; none of a topic that is not listened to."""
        kept = self._kept[self._number[topic]].copy() if topic in self._number else ()
        return [each for each in kept if span.begin_ns <= each[0] <= span.end_ns]

    def messages(self, topic: str, span: Span = ALL) -> list[tuple[int, Any]]:  # Any: of the topic's type
        """Return arrival [ns] and message; those that cannot be read are left out, row `samples` tells of them."""
        cls, found = message_type(TOPICS[topic].type_name), []
        for at_ns, payload in self.arrivals(topic, span):
            try:
                found.append((at_ns, decode(payload, cls)))
            except CdrError:
                continue
        return found

    def mode(self) -> Mapping[str, object] | None:
        """Return the newest `/api/current_mode` (manual §4.11.2); None before one that can be read."""
        for _, message in reversed(self.messages(CURRENT_MODE)):
            try:
                fields = json.loads(message.data)
            except (ValueError, RecursionError):
                continue
            if isinstance(fields, dict):
                return fields
        return None


def stamp_ns(topic: str, payload: bytes) -> int | None:
    """Return the robot's time in a message [ns]; None where its type has none, or it is cut off (manual §4.8)."""
    if TOPICS[topic].type_name != JOINT_STATE or len(payload) < 12:
        return None
    seconds, rest_ns = struct.unpack_from("<iI" if payload[1] & 1 else ">iI", payload, 4)
    return int(seconds) * 1_000_000_000 + int(rest_ns)
