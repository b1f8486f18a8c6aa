"""No peer takes all connections from others."""

from __future__ import annotations

import contextlib
import resource
import socket

import pytest

from gateway.web import listening
from gateway.web.listening import FairListener


@pytest.fixture(autouse=True)
def limits(monkeypatch: pytest.MonkeyPatch) -> list[tuple[int, int]]:
    """Where this process' limits are told and not set."""
    told: list[tuple[int, int]] = []
    monkeypatch.setattr(listening, "MOST_OF_ADDRESS", 3)
    monkeypatch.setattr(resource, "getrlimit", lambda _: (256, 4096))
    monkeypatch.setattr(resource, "setrlimit", lambda _, limits: told.append(limits))
    return told


def test_who_has_too_many_is_closed_and_others_come_in(limits: list[tuple[int, int]]) -> None:
    """At once, before it says anything; a connection that ends makes room for one."""
    with contextlib.ExitStack() as stack:
        listener = stack.enter_context(FairListener(socket.create_server(("127.0.0.1", 0))))
        listener.settimeout(20.0)
        port = listener.getsockname()[1]

        def comes(source: str) -> socket.socket:
            return stack.enter_context(socket.create_connection(("127.0.0.1", port), 20.0, source_address=(source, 0)))

        accepted = []
        for _ in range(3):
            comes("127.0.0.1")
            accepted.append(stack.enter_context(listener.accept()[0]))
        refused = comes("127.0.0.1")
        try:
            comes("127.0.0.2")
        except OSError:  # not on macOS
            pytest.skip("only one address of loopback here")
        connection, address = listener.accept()
        stack.enter_context(connection)
        assert address[0] == "127.0.0.2" and refused.recv(1) == b""
        assert connection.getsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE)
        accepted[0].close()
        accepted[0].close()
        comes("127.0.0.1")
        stack.enter_context(listener.accept()[0])
    assert not limits


def test_as_many_files_are_opened_as_may_be(limits: list[tuple[int, int]]) -> None:
    """Each connection takes one."""
    listening.open_more_files()
    assert limits == [(4096, 4096)]


def test_a_flood_of_one_peer_is_not_served_without_end(monkeypatch: pytest.MonkeyPatch) -> None:
    """The loop gets its turn in between."""
    monkeypatch.setattr(listening, "MOST_OF_ADDRESS", 0)
    monkeypatch.setattr(listening, "MOST_AT_ONCE", 2)
    with FairListener(socket.create_server(("127.0.0.1", 0))) as listener, contextlib.ExitStack() as stack:
        for _ in range(3):
            stack.enter_context(socket.create_connection(listener.getsockname()))
        with pytest.raises(ConnectionAbortedError):
            listener.accept()
