"""Stop endpoints: clients that promise to be heard, and without whom the robot is held, whoever owns it (as Spot has it).

Rules
    * Each is judged by itself: by its own period, and by one pause of this process (`silence.py`). Whose connection ends
      without having left is silent at once.
    * Silence is a condition, not a latch: nothing may move until all are heard again, left, or were dismissed by `recover`
      with a reason. Nothing resumes by itself when one is heard again.
    * An endpoint that is heard is dismissed by nobody but itself: a person relies on it.
    * They do not survive the daemon, but a latch does which says that they were there: `recover` with a reason ends it.

It decides nothing about motion: `watch.py` tells the supervisor what `look` returns.
"""

from __future__ import annotations

from collections.abc import Mapping

from msgspec import Struct

from gateway.core.motion.bounds import outside
from gateway.core.supervision.silence import Silence
from gateway.errors import Code, Refusal
from gateway.messages.incoming import OnLoss
from gateway.messages.snapshot import EndpointView

__all__ = ["LONGEST_NS", "MOST", "SHORTEST_NS", "Endpoint", "Endpoints"]

S = 1_000_000_000
MOST, MOST_OF_VIEWERS = 8, 4
"""So many stop endpoints may be registered at once, and so many of those who may do nothing else."""
SHORTEST_NS, LONGEST_NS = S // 10, 10 * S
"""Bounds of a period [ns]."""


class Endpoint(Struct, kw_only=True):
    """One of them.

    Attributes:
        endpoint_id: Rises by one with each that is registered.
        client_id: Of the client that registered it; a client has one at most.
        name: As the client calls itself.
        timeout_ns: It is silent when it was not heard for longer [ns].
        on_silence: What its silence does.
        is_viewers: Whether whoever registered it may move nothing.
        silence: Since it was last heard.
        is_silent: Whether it is, and was told to be.
    """

    endpoint_id: int
    client_id: str
    name: str
    timeout_ns: int
    on_silence: OnLoss
    is_viewers: bool
    silence: Silence
    is_silent: bool = False

    @property
    def is_doubted(self) -> bool:
        """Whether only a pause of this process explains that it was not heard."""
        return not self.is_silent and self.silence.is_doubted(self.timeout_ns)

    @property
    def text(self) -> str:
        """What it does, in words."""
        silence_s, bound_s = self.silence.ns / S, self.timeout_ns / S
        return f"stop endpoint {self.name!r} was not heard for {silence_s:.2f} s ({bound_s:g} s is its bound)"


class Endpoints:
    """All of them."""

    def __init__(self) -> None:
        self._endpoints: dict[str, Endpoint] = {}
        self._latest_id = 0

    @property
    def doubted(self) -> Endpoint | None:
        """One that only a pause of this process explains; None when there is none."""
        return next((endpoint for endpoint in self._endpoints.values() if endpoint.is_doubted), None)

    @property
    def client_ids(self) -> frozenset[str]:
        """Of the clients that registered them."""
        return frozenset(self._endpoints)

    def name_of(self, client_id: str) -> str:
        """Return the name of the one that this client registered; empty when there is none."""
        endpoint = self._endpoints.get(client_id)
        return "" if endpoint is None else endpoint.name

    @property
    def silent(self) -> list[str]:
        """Names of those that are silent."""
        return [endpoint.name for endpoint in self._endpoints.values() if endpoint.is_silent]

    def register(
        self, client_id: str, name: str, timeout_ns: int, on_silence: OnLoss, now_ns: int, *, is_viewers: bool = False
    ) -> Endpoint | Refusal:
        """Take one in; its registration is its first sign of life. Another one of the same client takes the place of the first.

        Returns:
            The endpoint, or OUT_OF_RANGE for its period, or TOO_MANY_ENDPOINTS.
        """
        if not SHORTEST_NS <= timeout_ns <= LONGEST_NS:
            span_s, hint = (SHORTEST_NS / S, LONGEST_NS / S), "stay inside the bound, and check in four times as often"
            return outside("the period of a stop endpoint", timeout_ns / S, *span_s, "s", field="timeout_ns", hint=hint)
        names = [endpoint.name for endpoint in self._endpoints.values()]
        of_viewers = [endpoint.name for endpoint in self._endpoints.values() if endpoint.is_viewers]
        of_whom, full, most = "", names, MOST
        if is_viewers and len(names) < MOST:
            of_whom, full, most = " of viewers", of_viewers, MOST_OF_VIEWERS
        if client_id not in self._endpoints and len(full) >= most:
            return Refusal(
                code=Code.TOO_MANY_ENDPOINTS,
                message=f"{most} stop endpoints{of_whom} are registered already: {', '.join(full)}",
                field="endpoints",
                value=str(most),
                bound=str(most),
            )
        self._latest_id += 1
        endpoint = Endpoint(
            endpoint_id=self._latest_id,
            client_id=client_id,
            name=name,
            timeout_ns=timeout_ns,
            on_silence=on_silence,
            is_viewers=is_viewers,
            silence=Silence(now_ns),
        )
        self._endpoints[client_id] = endpoint
        return endpoint

    def leave(self, client_id: str) -> Endpoint | Refusal:
        """Let one go by its own wish; ENDPOINT_UNKNOWN when this client has none."""
        if client_id not in self._endpoints:
            return Refusal(code=Code.ENDPOINT_UNKNOWN, message="this client is not registered as a stop endpoint")
        return self._endpoints.pop(client_id)

    def dismiss(self) -> list[str]:
        """Let all go that are silent; return their names."""
        gone = self.silent
        self._endpoints = {who: endpoint for who, endpoint in self._endpoints.items() if not endpoint.is_silent}
        return gone

    def heard(self, client_id: str, at_ns: int) -> None:
        """Take a check-in that arrived at `at_ns` [ns]."""
        endpoint = self._endpoints.get(client_id)
        if endpoint is not None:
            endpoint.silence.heard_ns = max(endpoint.silence.heard_ns, at_ns)

    def gone(self, client_id: str, at_ns: int) -> None:
        """Take the end of a client's connection: only a later check-in counts."""
        endpoint = self._endpoints.get(client_id)
        if endpoint is not None:  # as if it had been silent for its whole period since
            endpoint.silence = Silence(at_ns - endpoint.timeout_ns - 1)

    def look(self, now_ns: int, late_ns: int) -> list[Endpoint]:
        """Let time pass until a tick that is `late_ns` late [ns]; return those that fell silent or are heard again."""
        changed = []
        for endpoint in self._endpoints.values():
            endpoint.silence.look(now_ns, late_ns)
            is_silent = endpoint.silence.ns > endpoint.silence.patience_ns(endpoint.timeout_ns)
            if is_silent is not endpoint.is_silent:
                endpoint.is_silent = is_silent
                changed.append(endpoint)
        return changed

    def refusal(self, *, is_demanded: bool) -> Refusal | None:
        """Refuse motion while one is silent or doubted, or while there is none and the configuration demands one."""
        for endpoint in self._endpoints.values():
            if endpoint.is_silent or endpoint.is_doubted:
                return Refusal(
                    code=Code.ENDPOINT_SILENT,
                    message=endpoint.text,
                    field="endpoints",
                    value=f"{endpoint.silence.ns / S:.2f}",
                    bound=f"{endpoint.timeout_ns / S:g}",
                    unit="s",
                )
        if is_demanded and not self._endpoints:
            return Refusal(
                code=Code.ENDPOINT_MISSING,
                message="no stop endpoint is registered, and the configuration demands one (local.demand_stop_endpoint)",
                field="endpoints",
                value="0",
                bound="1",
            )
        return None

    def beside(self, latches: Mapping[Code, str]) -> dict[Code, str]:
        """Return the latches as the next daemon must find them: it knows nobody who was registered here."""
        if not self._endpoints:
            return dict(latches)
        names = ", ".join(endpoint.name for endpoint in self._endpoints.values())
        return {Code.ENDPOINT_SILENT: f"stop endpoints of an earlier daemon: {names}", **latches}

    def views(self, now_ns: int) -> tuple[EndpointView, ...]:
        """Return what the outside may see."""
        return tuple(
            EndpointView(
                endpoint_id=endpoint.endpoint_id,
                name=endpoint.name,
                timeout_ns=endpoint.timeout_ns,
                on_silence=endpoint.on_silence.value,
                age_ns=max(0, now_ns - endpoint.silence.heard_ns),
                is_silent=endpoint.is_silent,
            )
            for endpoint in self._endpoints.values()
        )
