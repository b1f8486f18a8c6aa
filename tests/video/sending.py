"""A simulated camera for tests of whoever receives: small pictures, a process of its own, on a port of its own."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager

__all__ = ["camera", "udp_port"]

SMALL = ("--size", "160x340", "--mbps", "2", "--gop", "15", "--pictures", "45", "--source", "loop")


def udp_port() -> int:
    """Return a UDP port of loopback that nobody uses now."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


@contextmanager
def camera(port: int, *words: str) -> Iterator[subprocess.Popen[bytes]]:
    """Send pictures to a port for the time of a block.

    Args:
        port: UDP port of loopback.
        words: More of its command line.
    """
    command = [sys.executable, "-m", "gateway.sim.camera", "--to", f"127.0.0.1:{port}", *SMALL, *words]
    process = subprocess.Popen(command, env=os.environ | {"PYTHONPATH": os.getcwd()}, stdout=subprocess.DEVNULL)
    try:
        yield process
    finally:
        process.terminate()
        process.wait(20)
