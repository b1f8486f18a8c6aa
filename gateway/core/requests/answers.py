"""Replies that were given, so that a request which is asked for again gets its first reply again and runs once.

Rules
    * A request is known by its client and its number. Under a number that was used, another request is neither run nor
      answered with the reply to the first: it would be taken for done.
    * A stop stops, whatever its number.
    * Bounded: the latest replies are kept, and none for long once others follow.
"""

from __future__ import annotations

from typing import NamedTuple

from gateway.core.messages.events import CommandRequested
from gateway.core.messages.outputs import Reply
from gateway.errors import Code, Refusal
from gateway.messages.requests import Estop, Stop

__all__ = ["DROPPED_AT_ONCE", "KEPT_NS", "REPLIES_KEPT", "Answers", "Kept", "number_was_used"]

REPLIES_KEPT = 2048
"""So many replies are kept. At most four requests reach a tick, so each is kept for 5 s: longer than a client asks again for
a reply that was lost (3 s)."""
KEPT_NS = 60_000_000_000
"""A reply whose request is older than this [ns] is dropped when the next one is kept."""
DROPPED_AT_ONCE = 16
"""At most so many at one time: what a tick does stays small."""


def number_was_used(request_id: int) -> Refusal:
    """Return the refusal of a request under the number of another one."""
    return Refusal(
        code=Code.BAD_REQUEST,
        message=f"request_id {request_id} was used for another request of this client; this one was not run",
        field="request_id",
        value=str(request_id),
        hint="give each request a number of its own; the same number asks again for a reply that was lost",
    )


class Kept(NamedTuple):
    """Replies at one moment, by client and number, the oldest first: what was asked, and the reply. Nobody changes them."""

    replies: dict[tuple[str, int], tuple[int, Reply, int]]


class Answers:
    """The latest replies.

    Args:
        kept: Those of before.
    """

    def __init__(self, kept: Kept | None = None) -> None:
        self._kept = {} if kept is None else kept.replies.copy()

    def __reduce__(self) -> tuple[type[Answers], tuple[Kept]]:
        return Answers, (Kept(self._kept.copy()),)

    def again(self, command: CommandRequested) -> Reply | None:
        """Return what a request is answered without being run; None when it is to be run."""
        kept = self._kept.get((command.client_id, command.request_id))
        if kept is None or isinstance(command.request, (Stop, Estop)):
            return None
        content, reply, _ = kept
        if content == command.content:
            return reply
        refusal = number_was_used(command.request_id)
        return Reply(client_id=command.client_id, request_id=command.request_id, refusal=refusal)

    def keep(self, command: CommandRequested, reply: Reply) -> None:
        """Remember the reply to a request that was run."""
        self._kept[command.client_id, command.request_id] = command.content, reply, command.received_ns
        for _ in range(DROPPED_AT_ONCE):
            oldest, (_, _, received_ns) = next(iter(self._kept.items()))
            if len(self._kept) <= REPLIES_KEPT and command.received_ns - received_ns <= KEPT_NS:
                break
            del self._kept[oldest]
