"""What stop endpoints ask for, and what their silence does: brake and hold, or pause, whoever owns the robot.

Who is silent is known to `endpoints.py`; what follows stands in the supervisor's table. Every change is told.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TypeAlias

from gateway.core.messages.events import CommandRequested
from gateway.core.messages.outputs import Level
from gateway.core.supervision.coordinator import Coordinator
from gateway.core.supervision.endpoints import Endpoint
from gateway.core.supervision.supervisor import Trigger
from gateway.errors import Code, Refusal
from gateway.messages.incoming import OnLoss
from gateway.messages.requests import LeaveEndpoint, Recover, RegisterEndpoint
from gateway.values import Role

__all__ = ["Watch"]

Answer: TypeAlias = Mapping[str, object] | Refusal
"""Facts for the caller, or why nothing was done."""

S = 1_000_000_000


class Watch:
    """Answers stop endpoints, and looks at their clocks."""

    def __init__(self, coordinator: Coordinator) -> None:
        self._coordinator = coordinator

    @property
    def _is_demanded(self) -> bool:
        return self._coordinator.settings.local.demand_stop_endpoint

    def refusal(self) -> Refusal | None:
        """Refuse motion while an endpoint is silent, or missing where it is demanded."""
        return self._coordinator.endpoints.refusal(is_demanded=self._is_demanded)

    def register(self, command: CommandRequested, request: RegisterEndpoint, now_ns: int) -> Answer:
        """Take an endpoint in. Reply: `endpoint_id`."""
        coordinator = self._coordinator
        if coordinator.is_exiting:
            return Refusal(code=Code.EXITING, message="the daemon is ending")
        endpoint = coordinator.endpoints.register(
            *(command.client_id, request.name, request.timeout_ns, request.on_silence, now_ns),
            is_viewers=command.role is Role.VIEWER,
        )
        if isinstance(endpoint, Refusal):
            return endpoint
        does = f"{endpoint.on_silence.value} when it is not heard for {endpoint.timeout_ns / S:g} s"
        self._tell(endpoint, "registered", f"{endpoint.name} is a stop endpoint: {does}", now_ns)
        return {"endpoint_id": endpoint.endpoint_id}

    def leave(self, command: CommandRequested, request: LeaveEndpoint, now_ns: int) -> Answer:
        """Let an endpoint go that asks for it. The last one, where one is demanded, leaves the robot held."""
        endpoint = self._coordinator.endpoints.leave(command.client_id)
        if isinstance(endpoint, Refusal):
            return endpoint
        self._tell(endpoint, "left", f"stop endpoint {endpoint.name!r} has left in order", now_ns)
        missing = self._coordinator.endpoints.refusal(is_demanded=self._is_demanded)
        if missing is not None and missing.code is Code.ENDPOINT_MISSING:
            self._coordinator.fire(Trigger.ENDPOINT_SILENT, now_ns, missing.message)
        return {}

    def may_recover(self, request: Recover) -> Refusal | None:
        """Refuse a `recover` without a reason while it would let silent endpoints go."""
        latch = self._coordinator.supervisor.latches.get(Code.ENDPOINT_SILENT)
        silent = [*self._coordinator.endpoints.silent, *([] if latch is None else [latch])]
        if not silent or request.reason.strip():
            return None
        return Refusal(
            code=Code.ENDPOINT_SILENT,
            message=f"stop endpoints are silent ({', '.join(silent)}): to let them go needs a reason",
            field="reason",
            hint="see that whoever watched the robot is well, then recover(reason='...')",
        )

    def dismiss(self, who: str, request: Recover, now_ns: int) -> list[str]:
        """Let silent endpoints go, as a `recover` with a reason does by whoever is called so; return their names."""
        names = self._coordinator.endpoints.dismiss()
        for name in names:
            message = f"recover() by {who} let stop endpoint {name!r} go: {request.reason}"
            self._coordinator.notice(
                Code.ENDPOINT_CHANGED, Level.WARNING, message, now_ns, endpoint=name, change="dismissed"
            )
        return names

    def look(self, now_ns: int, late_ns: int) -> None:
        """Do what a silence asks for.

        Args:
            now_ns: Monotonic time [ns].
            late_ns: How late the tick is [ns]: a pause of this process is no silence of an endpoint.
        """
        coordinator = self._coordinator
        for endpoint in coordinator.endpoints.look(now_ns, late_ns):
            if endpoint.is_silent:
                coordinator.notice(
                    Code.ENDPOINT_SILENT, Level.WARNING, endpoint.text, now_ns, endpoint=endpoint.name, change="silent"
                )
                pauses = endpoint.on_silence is OnLoss.PAUSE
                coordinator.fire(
                    Trigger.ENDPOINT_SILENT_PAUSE if pauses else Trigger.ENDPOINT_SILENT, now_ns, endpoint.text
                )
            else:
                text = f"stop endpoint {endpoint.name!r} is heard again; nothing resumes by itself"
                self._tell(endpoint, "back", text, now_ns)
        doubted = coordinator.endpoints.doubted
        if doubted is not None:  # as at the pause itself: what moves comes to rest, what is held stays held
            coordinator.fire(Trigger.LONG_GAP, now_ns, doubted.text)

    def _tell(self, endpoint: Endpoint, change: str, message: str, now_ns: int) -> None:
        facts = {"endpoint": endpoint.name, "change": change}
        self._coordinator.notice(Code.ENDPOINT_CHANGED, Level.INFO, message, now_ns, **facts)
