"""A sender of small pictures in a thread of the test: loops a film, can be restarted, silenced and ended."""

from __future__ import annotations

import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from typing import Any

import pytest

from gateway.sim.camera.film import Film
from gateway.sim.camera.hevc import Coding
from gateway.sim.camera.sender import Sender

__all__ = ["GOP", "HOST", "LENGTH", "film", "free_udp_port", "sending", "until"]

HOST = "127.0.0.1"
GOP = 15
LENGTH = 300
"""Pictures of the loop: 6.7 s at 45 Hz."""
DEADLINE_S = 20.0


def free_udp_port() -> int:
    """Return a UDP port of this host that nobody uses now."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind((HOST, 0))
        return int(probe.getsockname()[1])


@cache
def film() -> Film:
    """Return a loop of small pictures, a key picture three times a second."""
    return Film.of(Coding(width=160, height=340, gop=GOP, bit_rate_bps=2_000_000), LENGTH)


@contextmanager
def sending(port: int, **options: Any) -> Iterator[Sender]:
    """Send to a port of this host while a block lasts."""
    first = options.pop("first", 0)
    sender = Sender((HOST, port), film().play(first), **options)
    ended = threading.Event()
    thread = threading.Thread(target=sender.run, args=(ended.is_set,))
    thread.start()
    try:
        yield sender
    finally:
        ended.set()
        thread.join()
        sender.close()


def until(is_so: Callable[[], Any], what: str) -> Any:
    """Poll until something is so, and return it; fail when it never is."""
    deadline = time.monotonic() + DEADLINE_S
    while not (value := is_so()):
        if time.monotonic() > deadline:
            pytest.fail(f"{what}: not within {DEADLINE_S} s")
        time.sleep(0.005)
    return value
