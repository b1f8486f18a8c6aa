"""Rules of the asking end of the control channel."""

from __future__ import annotations

import threading
import time

import pytest

from gateway.sim.node import SimNode
from gateway.sim.remote import SimControl, SimUnreachable
from gateway.sim.robot.settings import SimSettings

pytestmark = pytest.mark.e2e

ENDPOINT = "tcp/127.0.0.1:19150"


@pytest.fixture
def node():
    """A node that nobody steps."""
    made = SimNode(SimSettings(), ENDPOINT)
    yield made
    made.close()


@pytest.fixture
def living(node):
    """The same node, stepped by a thread."""
    stop = threading.Event()

    def live():
        while not stop.wait(0.002):
            node.step(time.monotonic_ns())

    thread = threading.Thread(target=live)
    thread.start()
    yield node
    stop.set()
    thread.join()


def test_an_answer_comes_back_as_a_mapping(living):
    """Requests carry their parameters."""
    with SimControl(ENDPOINT) as control:
        assert control.ask("ping")["model"] == "standard"
        assert control.ask("log", since=5)["entries"] == []


def test_a_fault_begins(living):
    """The shortest way to a fault."""
    with SimControl(ENDPOINT) as control:
        control.fault("vr_mode")
        assert control.ask("state")["mode"]["meta_mode"] == 0


def test_a_refused_request_is_an_error_with_the_reason(living):
    """The text says what is known."""
    with SimControl(ENDPOINT) as control, pytest.raises(ValueError, match="known: drop"):
        control.fault("explode")


def test_a_simulation_that_does_not_answer_is_unreachable(node):
    """Connected, but nobody lives there."""
    with SimControl(ENDPOINT, timeout_s=0.3) as control, pytest.raises(SimUnreachable, match="did not answer"):
        control.ask("ping")


def test_nobody_listening_is_unreachable_with_a_remedy():
    """The text says how to start one."""
    with pytest.raises(SimUnreachable, match="ta2 sim"):
        SimControl("tcp/127.0.0.1:19151", timeout_s=0.3)
