"""What the owner would be refused now, and why: asked of the same rules that refuse, before anybody is refused.

Rules
    * It asks as the owner would, at this instant; where nobody owns the robot, that is the answer.
    * Only what no input could change: who, the state, latches, mode, parts, freshness. Goals are judged when they come.
    * Five times a second, and at once when state, latches, owner or epoch change: a viewer never sees an old reason for long.
"""

from __future__ import annotations

from typing import TypeAlias

from gateway.core.messages.events import CommandRequested
from gateway.core.requests.handler import RequestHandler
from gateway.core.supervision.coordinator import Coordinator
from gateway.core.supervision.supervisor import State
from gateway.errors import CODES, Refusal
from gateway.messages.requests import Recover
from gateway.messages.snapshot import RefusalMessage

__all__ = ["PERIOD_NS", "Preconditions"]

PERIOD_NS = 200_000_000
"""Looked at this often while nothing has changed that is noticed at once [ns]."""

_Key: TypeAlias = tuple[int, State, tuple[str, ...], str, int, bool]


class Preconditions:
    """Keeps the answers."""

    def __init__(self, coordinator: Coordinator, handler: RequestHandler) -> None:
        self._coordinator = coordinator
        self._may = handler.may
        self._key: _Key | None = None
        self.refusals: dict[str, RefusalMessage] = {}
        """By kind of request why it would be refused; kinds that would be accepted are left out."""

    def look(self, now_ns: int) -> None:
        """Ask anew when it is time, or when something has changed."""
        coordinator = self._coordinator
        supervisor, lease = coordinator.supervisor, coordinator.lease
        client_id = lease.owner.client_id if lease.owner else ""
        latches = tuple(supervisor.latches)
        key = (now_ns // PERIOD_NS, supervisor.state, latches, client_id, lease.epoch, coordinator.is_exiting)
        if key == self._key:
            return
        self._key = key
        # As if it came after this tick: what was stopped until now does not matter to it.
        command = CommandRequested(client_id=client_id, request_id=0, request=Recover(), received_ns=now_ns + 1)
        epoch = lease.epoch if lease.owner else 0
        refusals = {kind: may(command, epoch, now_ns) for kind, may in self._may.items()}
        self.refusals = {kind: _view(refusal) for kind, refusal in refusals.items() if refusal is not None}


def _view(refusal: Refusal) -> RefusalMessage:
    return RefusalMessage(
        code=refusal.code.value,
        message=refusal.message,
        field=refusal.field,
        value=refusal.value,
        bound=refusal.bound,
        unit=refusal.unit,
        hint=refusal.hint or CODES[refusal.code].hint,
    )
