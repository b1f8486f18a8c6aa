"""The other end of the control channel: ask a running simulation from another process.

For tests, the demo and people; no part of the gateway may depend on it, since a robot has no such channel.
"""

from __future__ import annotations

import json

import zenoh

from gateway.sim.bridge import CONTROL_KEY

__all__ = ["SimControl", "SimUnreachable"]


class SimUnreachable(ConnectionError):
    """No simulation answers at the endpoint."""


class SimControl:
    """A connection of its own to the control channel of one simulation; a context manager."""

    def __init__(self, endpoint: str, timeout_s: float = 2.0) -> None:
        """Connect.

        Args:
            endpoint: Where the simulation listens, e.g. `tcp/127.0.0.1:9000`.
            timeout_s: Longest wait for the connection and for each answer [s].

        Raises:
            SimUnreachable: If nothing listens there.
        """
        self._endpoint, self._timeout_s = endpoint, timeout_s
        config = {
            "mode": "client",
            "connect": {
                "endpoints": [endpoint],
                "timeout_ms": round(timeout_s * 1e3),
                "exit_on_failure": True,
                "retry": {"period_init_ms": 50, "period_max_ms": 200, "period_increase_factor": 1.5},
            },
            "listen": {"endpoints": []},
            "scouting": {"multicast": {"enabled": False}, "gossip": {"enabled": False}},
            "transport": {"shared_memory": {"enabled": False}},
        }
        try:
            self._session = zenoh.open(zenoh.Config.from_json5(json.dumps(config)))
        except zenoh.ZError as error:
            raise SimUnreachable(f"no simulation at {endpoint}: {error}; start one with `ta2 sim`") from error

    def ask(self, do: str, **values: object) -> dict[str, object]:
        """Send a request and return the answer.

        Args:
            do: What to do (table in `gateway.sim.control`).
            **values: Its parameters.

        Raises:
            SimUnreachable: If no answer comes in time.
            ValueError: If the simulation does not accept the request; the text says why.
        """
        payload = json.dumps({"do": do, **values})
        for reply in self._session.get(CONTROL_KEY, payload=payload, timeout=self._timeout_s):
            if reply.ok is not None:
                answer: dict[str, object] = json.loads(reply.ok.payload.to_string())
                if answer.get("ok") is not True:
                    raise ValueError(str(answer.get("error")))
                return answer
        raise SimUnreachable(f"the simulation at {self._endpoint} did not answer {do!r} in {self._timeout_s} s")

    def fault(self, name: str, **values: object) -> None:
        """Let a fault begin (grammar in `gateway.sim.robot.faults`)."""
        self.ask("fault", fault=name, **values)

    def close(self) -> None:
        """End the connection."""
        self._session.close()  # type: ignore[no-untyped-call]  # zenoh's stub has no annotation

    def __enter__(self) -> SimControl:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
