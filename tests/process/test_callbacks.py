"""What zenoh calls in threads that Python does not know: their state is kept, and nothing else is different."""

from __future__ import annotations

import json
import subprocess
import sys
import threading
from collections import Counter
from collections.abc import Callable
from typing import Any

import pytest
import zenoh

from gateway.process.callbacks import direct
from tests.e2e.system import ROOT, free_port, wait_for

pytestmark = pytest.mark.e2e

SAMPLES = 300


def _opened(role: str, port: int) -> zenoh.Session:
    config = {
        "mode": "peer" if role == "listen" else "client",
        role: {"endpoints": [f"tcp/127.0.0.1:{port}"]},
        "scouting": {"multicast": {"enabled": False}},
    }
    return zenoh.open(zenoh.Config.from_json5(json.dumps(config)))


def calls_a_state_saw(handler: Callable[[Callable[[Any], None]], Any]) -> Counter[int]:
    """Return by thread how many calls the longest-lived of its states saw."""
    here, most, port = threading.local(), Counter[int](), free_port()

    def take(sample: zenoh.Sample) -> None:
        here.calls = getattr(here, "calls", 0) + 1
        most[threading.get_ident()] = max(most[threading.get_ident()], here.calls)
        came.append(int(sample.payload.to_string()))

    came: list[int] = []
    with _opened("listen", port) as near, _opened("connect", port) as far:
        near.declare_subscriber("a", handler(take))
        publisher = far.declare_publisher("a", congestion_control=zenoh.CongestionControl.BLOCK)
        wait_for(lambda: publisher.matching_status.matching, "the subscriber", 20.0)
        for number in range(SAMPLES):
            publisher.put(str(number))
        wait_for(lambda: len(came) == SAMPLES, "all samples", 20.0)
    assert came == list(range(SAMPLES))
    return most


ALONE = """
import zenoh
from gateway.process.callbacks import direct
from tests.process.test_callbacks import calls_a_state_saw
made_anew = calls_a_state_saw(lambda take: zenoh.handlers.Callback(take, indirect=False))
print(set(made_anew.values()), sum(calls_a_state_saw(direct).values()))
"""
"""A process of its own: a thread that has once been kept stays so."""


def test_a_thread_of_zenoh_keeps_its_state_from_the_first_call_on() -> None:
    """Without that Python makes one for each call and throws it away: three times the processor time."""
    done = subprocess.run(
        [sys.executable, "-c", ALONE], cwd=ROOT, capture_output=True, text=True, check=True, timeout=60
    )
    assert (done.stdout, done.stderr) == (f"{{1}} {SAMPLES}\n", "")


def test_what_a_callback_raises_is_zenohs_to_tell_as_ever() -> None:
    """In a thread that Python knows, too."""

    def fail(what: int) -> None:
        raise ValueError(what)

    with pytest.raises(ValueError, match="3"):
        direct(fail)(3)
