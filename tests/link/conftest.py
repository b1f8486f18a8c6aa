"""Ports for the tests of the robot plane: one after the other from a range of our own, skipping what is taken."""

from __future__ import annotations

import itertools
import os
import socket

import pytest

_PORTS = itertools.count(os.getpid() % 100)


@pytest.fixture
def port() -> int:
    """A port on loopback between 19200 and 19299 that nobody listens on."""
    for _ in range(100):
        number = 19200 + next(_PORTS) % 100
        with socket.socket() as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            try:
                probe.bind(("127.0.0.1", number))
            except OSError:
                continue
            return number
    raise RuntimeError("no free port between 19200 and 19299")
