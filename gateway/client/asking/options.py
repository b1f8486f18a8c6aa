"""What `connect()` and `control()` are told, made into a transport, a name, and words that mean something."""

from __future__ import annotations

import os
import sys
from typing import Literal

from gateway.api import protocol
from gateway.client.asking.requests import require_word
from gateway.client.connection.over_zenoh import Credentials, ZenohTransport
from gateway.client.connection.transport import Transport
from gateway.errors import Code, failure

__all__ = ["OnExitName", "program_name", "require_options", "transport_to"]

OnExitName = Literal["release", "hold"]


def transport_to(target: str | None, credentials: Credentials | None) -> Transport:
    """Return the transport to an address that a person typed; None finds the socket by itself."""
    try:
        address = protocol.parse_address(str(protocol.find_socket()) if target is None else target)
    except protocol.AddressRefused as error:
        raise failure(Code.BAD_REQUEST, str(error), field="target", value=str(target), hint="see connect()") from None
    return ZenohTransport(address, credentials)


def program_name() -> str:
    """Return what this program is called, for people who ask who owns the robot."""
    path = sys.argv[0] if sys.argv else ""
    if os.path.basename(path) == "__main__.py":  # python -m package
        path = os.path.dirname(path)
    name = os.path.basename(path)
    return "python" if name in ("", "-c", "-m") else name[:64]


def require_options(on_loss: str, on_exit: str) -> None:
    """Refuse words that mean nothing before anything is asked."""
    require_word("on_loss", on_loss, ("hold", "pause"), "see control()")
    require_word("on_exit", on_exit, ("release", "hold"), "see control()")
