"""What came over the robot's topics while a check listened, with the arrival of each message; read when it is judged.

States and commands, ours too: both ends of a reaction lie on one clock, outside the process that caused it.
"""

from __future__ import annotations

import json
import struct
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple, cast

from cdr_types import CdrError, decode, message_type
from cdr_types.messages import geometry_msgs, sensor_msgs, std_msgs
from gateway.robot.topics import CURRENT_MODE, JOINT_STATE, TOPICS

__all__ = ["Capture", "Motors", "Span", "stamp_ns"]

S = 1_000_000_000


class Span(NamedTuple):
    """A part of what came, both ends included [ns]."""

    begin_ns: int = 0
    end_ns: int = 2**62


class Motors(NamedTuple):
    """A message of motors: arrival [ns], positions [rad], velocities [rad/s], torques [N·m]."""

    at_ns: int
    q_rad: Sequence[float]
    dq_radps: Sequence[float]
    tau_nm: Sequence[float]


class Capture:
    """Keeps what comes.

    Args:
        topics: ROS names without a namespace, by number.
    """

    def __init__(self, topics: Sequence[str]) -> None:
        self._kept: list[deque[tuple[int, bytes]]] = [deque() for _ in topics]
        self._number = {topic: number for number, topic in enumerate(topics)}

    def take(self, number: int, at_ns: int, payload: bytes) -> None:
        """Keep a message; from any thread.

        Args:
            number: Of its topic.
            at_ns: Monotonic arrival [ns].
            payload: As it came.
        """
        self._kept[number].append((at_ns, payload))

    def arrivals(self, topic: str, span: Span = Span()) -> list[tuple[int, bytes]]:  # noqa: B008  it never changes
        """Return arrival [ns] and payload of each message; none of a topic that is not listened to."""
        kept = self._kept[self._number[topic]].copy() if topic in self._number else ()
        return [each for each in kept if span.begin_ns <= each[0] <= span.end_ns]

    def _messages(self, topic: str, span: Span) -> Iterator[tuple[int, Any]]:  # Any: of the topic's type
        cls = message_type(TOPICS[topic].type_name)
        for at_ns, payload in self.arrivals(topic, span):
            try:
                yield at_ns, decode(payload, cls)
            except CdrError:
                continue  # row `samples` tells of it

    def motors(self, topic: str, span: Span = Span()) -> list[Motors]:  # noqa: B008  it never changes
        """Return what came on a topic of motors."""
        width = TOPICS[topic].width
        found = [
            Motors(at_ns, each.position, each.velocity, each.effort)
            for at_ns, message in self._messages(topic, span)
            for each in (cast("sensor_msgs.JointState", message),)
        ]
        return [each for each in found if len(each.q_rad) == len(each.dq_radps) == len(each.tau_nm) == width]

    def positions(self, topic: str, span: Span) -> list[tuple[float, float, float]]:
        """Return where an end effector was, in its arm's shoulder frame [m]."""
        found = [cast("geometry_msgs.Pose", message).position for _, message in self._messages(topic, span)]
        return [(p.x, p.y, p.z) for p in found]

    def numbers(self, topic: str, span: Span = Span()) -> list[tuple[int, float]]:  # noqa: B008  it never changes
        """Return arrival [ns] and value of each message of a topic of one number."""
        return [(at_ns, cast("std_msgs.Float32", message).data) for at_ns, message in self._messages(topic, span)]

    def arrays(self, topic: str, span: Span) -> list[tuple[int, tuple[float, ...]]]:
        """Return arrival [ns] and values of each message of a topic of arrays."""
        return [(at_ns, tuple(message.data)) for at_ns, message in self._messages(topic, span)]

    def mode(self) -> Mapping[str, object] | None:
        """Return the newest `/api/current_mode` (manual §4.11.2); None before one that can be read."""
        for _, message in reversed(list(self._messages(CURRENT_MODE, Span()))):
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
    return int(seconds) * S + int(rest_ns)
