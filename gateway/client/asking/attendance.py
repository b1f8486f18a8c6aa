"""A stop endpoint of ours, without waiting: what both clients' `StopEndpoint` do, as procedures.

No thread checks in by itself: a check-in says that the user's own loop, and whoever it listens to, still lives.
"""

from __future__ import annotations

from gateway.api import protocol
from gateway.client.asking.procedures import Procedure, request
from gateway.client.asking.requests import chosen, seconds
from gateway.client.connection.session import Session
from gateway.errors import Code, GatewayError, failure

__all__ = ["Attendance"]


class Attendance:
    """The promise to be heard, from registering to leaving.

    Raises:
        Rejected: An argument is none of what it may be.
    """

    def __init__(self, session: Session, timeout_s: float, on_silence: protocol.OnLossName) -> None:
        self._session = session
        self._timeout_ns = seconds("timeout", timeout_s)
        self._on_silence = chosen(protocol.OnLoss, "on_silence", on_silence)
        self._endpoint_id = 0
        self._daemon = ""
        self._after_seq = 0

    @property
    def is_registered(self) -> bool:
        """Whether it was registered and has not left."""
        return self._endpoint_id > 0

    def __repr__(self) -> str:
        """Show whose it is and whether it is registered."""
        state = f"number {self._endpoint_id}" if self.is_registered else "not registered"
        return f"<stop endpoint of {self._session.name!r}, {state}>"

    def check_in(self) -> None:
        """Be heard: call it several times within the period. Never waits.

        Raises:
            NotReady: ENDPOINT_UNKNOWN, it is not registered, or `recover` with a reason has let it go.
            Disconnected: The daemon is gone, or another one is there, which holds motion off until somebody recovers it.
        """
        session = self._session
        if not self.is_registered:
            raise _unknown("this stop endpoint is not registered")
        session.require_daemon(self._daemon)
        seen = session.sighting()
        if seen is not None and seen.view.seq > self._after_seq:
            if all(endpoint.endpoint_id != self._endpoint_id for endpoint in seen.view.endpoints):
                self._endpoint_id = 0
                raise _unknown("this stop endpoint was let go")
        session.transport.put(protocol.check_in_key(session.client_id, session.secret), b"")

    def _register(self) -> Procedure[None]:
        command = protocol.RegisterEndpoint(
            name=self._session.name, timeout_ns=self._timeout_ns, on_silence=self._on_silence
        )
        reply = yield from request(self._session, command)
        self._endpoint_id, self._after_seq = int(reply.facts["endpoint_id"]), reply.after_seq
        self._daemon = self._session.daemon

    def _leave(self) -> Procedure[None]:
        if self.is_registered:
            yield from request(self._session, protocol.LeaveEndpoint())
            self._endpoint_id = 0


def _unknown(message: str) -> GatewayError:
    return failure(Code.ENDPOINT_UNKNOWN, message)
