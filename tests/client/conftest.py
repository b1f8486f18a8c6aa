"""Fixtures of the client's tests."""

from __future__ import annotations

import pytest

from gateway.client import connect
from tests.client.world import World


@pytest.fixture
def world():
    """A daemon and a scripted engine in virtual time."""
    return World()


@pytest.fixture
def robot(world):
    """A connected client of it."""
    with connect(transport=world.transport(), name="tester") as robot:
        yield robot
