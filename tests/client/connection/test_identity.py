"""Tests of who a client is."""

from __future__ import annotations

import os

from gateway.client.connection.identity import is_of_this_process, new_client_id


def test_every_client_has_a_name_of_its_own():
    """No two clients share one; each fits into a key of the protocol."""
    names = {new_client_id() for _ in range(1000)}
    assert len(names) == 1000 and all(len(name) == 32 and name.isalnum() for name in names)


def test_a_process_knows_its_own_clients_and_no_others(monkeypatch):
    """Also beside a process with the same id in another container, and after a fork."""
    mine = new_client_id()
    assert is_of_this_process(mine) and not is_of_this_process(os.urandom(16).hex())
    monkeypatch.setattr("gateway.client.connection.identity.os.getpid", lambda: 1)
    assert not is_of_this_process(mine) and is_of_this_process(new_client_id())
