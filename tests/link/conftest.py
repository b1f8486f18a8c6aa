"""Ports for the tests of the robot plane: one after the other from a range of our own, skipping what is taken."""

from __future__ import annotations

import itertools
import os
import socket

import pytest

_PORTS = itertools.count(os.getpid() % 50)
_WORKER = int(os.environ.get("PYTEST_XDIST_WORKER", "gw0").removeprefix("gw"))
_FIRST = 20200 + 50 * (_WORKER % 32)
"""A robot's router is ended and started again at its port: no process beside this one may take it in between."""


@pytest.fixture
def port() -> int:
    """A port on loopback that nobody listens on, one of fifty that are only this process's."""
    for _ in range(50):
        number = _FIRST + next(_PORTS) % 50
        with socket.socket() as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            try:
                probe.bind(("127.0.0.1", number))
            except OSError:
                continue
            return number
    raise RuntimeError(f"no free port between {_FIRST} and {_FIRST + 49}")
