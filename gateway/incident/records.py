"""What the black box notes, in its order: an engine's state, then what it heard and gave, tick by tick. Plain values."""

from __future__ import annotations

from typing import NamedTuple, TypeAlias

from gateway.core.messages.events import Event
from gateway.core.messages.outputs import Frame, Notice, Reply
from gateway.errors import Code

__all__ = ["HEADER_VERSION", "Heard", "Latched", "Start", "Tick"]

HEADER_VERSION = 1
"""Of the files' form."""


class Latched(NamedTuple):
    """A latch that another process had set, taken over between two events."""

    code: Code
    message: str
    at_ns: int


Heard: TypeAlias = Event | Latched


class Start(NamedTuple):
    """The engine's state before the next tick, as `freezing.packed` has it."""

    parts: bytes
    state: bytes


class Tick(NamedTuple):
    """One tick.

    Attributes:
        now_ns: Its monotonic time [ns].
        late_ns: How late it was [ns].
        is_watched: Whether anybody listened to snapshots.
        heard: Events since the tick before, in their order.
        frames: What left, in its order.
        state: Of the supervisor after it, by value; empty where the engine raised, and `frames` are those of its end.
        notices: What was told.
        replies: What was answered.
        claim: Number of the claim that was shown.
    """

    now_ns: int
    late_ns: int
    is_watched: bool
    heard: tuple[Heard, ...]
    frames: tuple[Frame, ...]
    state: str
    notices: tuple[Notice, ...]
    replies: tuple[Reply, ...]
    claim: int
