"""How a command of `ta2` connects: under its own name, and never longer than it takes to notice that nobody is there."""

from __future__ import annotations

import gateway.client
from gateway.client import Robot

__all__ = ["connected"]

GREETING_S = 5.0
"""Longest wait for the gateway, also of commands that wait longer for the robot [s]."""


def connected(command: str, target: str | None, timeout_s: float, *, greet: bool = True) -> Robot:
    """Return a connected robot, to be used in a `with` block.

    Args:
        command: Which command asks; others see `ta2 COMMAND` as the client's name.
        target: Where the gateway is; None finds its socket.
        timeout_s: Longest wait of the command [s].
        greet: Whether to wait for a first state; a stop does not.

    Raises:
        Disconnected: No gateway answers there.
    """
    return gateway.client.connect(target, name=f"ta2 {command}", timeout_s=min(timeout_s, GREETING_S), greet=greet)
