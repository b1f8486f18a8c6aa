"""What lies between a simulated robot's node and its users: the router that acts a bridge, or a real one behind DDS.

The node speaks messages; how they become bytes, and on what they travel, is the matter of the wire.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Container
from dataclasses import dataclass
from typing import Protocol

import zenoh
from pycdr2 import IdlStruct

__all__ = ["Arrival", "Wire"]


@dataclass(frozen=True, slots=True)
class Arrival:
    """A sample on a command topic.

    Attributes:
        topic: Its topic.
        now_ns: When it arrived [ns].
        payload: Its bytes; None for a DELETE.
    """

    topic: str
    now_ns: int
    payload: bytes | None


class Wire(Protocol):
    """One life of it, from open to close.

    Attributes:
        arrivals: Samples on command topics, oldest first; the node takes them out.
        queries: Questions that wait for an answer from the node's thread.
    """

    arrivals: deque[Arrival]
    queries: deque[zenoh.Query]

    def wanted(self) -> Container[str]:
        """Return the state topics to publish."""

    def publish(self, topic: str, message: IdlStruct) -> None:
        """Send a message of a state topic."""

    def read(self, topic: str, payload: bytes) -> IdlStruct:
        """Return the message of a command sample.

        Raises:
            ValueError: If the bytes are no message of the topic's type.
        """

    def answer(self, query: zenoh.Query) -> None:
        """Answer a question that is not for the simulation itself."""

    def set_dead(self, topic: str, *, is_dead: bool) -> None:
        """Lose or regain the bridge's reader of a state topic, or of all (`*`)."""

    def retire(self) -> None:
        """Let the robot's node leave; the bridge stays."""

    def announce(self) -> None:
        """Let the robot's node come back."""

    def companions(self) -> tuple[int, ...]:
        """Return the ids of the other processes that stand still when the robot's computer does."""

    def close(self) -> None:
        """End it; safe to call twice."""
