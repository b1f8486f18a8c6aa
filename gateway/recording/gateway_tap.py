"""What the gateway tells, for a recording: its notices, its state, owner and latches whenever they change, what it feels.

A client like any other, that owns nothing. Where there is no gateway it looks for one, for as long as the recording goes on.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Mapping
from contextlib import suppress

import msgspec

from gateway.client import Robot, connect
from gateway.errors import GatewayError
from gateway.process.threads import supervised
from gateway.recording.topics import CONTACT, EVENTS, GATEWAY

__all__ = ["GatewayTap"]

AGAIN_S = 1.0
LOOK_S = 0.1

Tell = Callable[[str, Mapping[str, object]], object]
"""Takes what is told: the topic, and facts for JSON."""


class GatewayTap:
    """Listens to the gateway in a thread of its own.

    Args:
        target: Where it is; None finds its socket.
        tell: Called with each fact; must not wait.
    """

    def __init__(self, target: str | None, tell: Tell) -> None:
        self._target = target
        self._tell = tell
        self._is_closing = threading.Event()
        self._seq = -1
        self._shown: Mapping[str, object] | None = None
        self._thread = supervised(self._run, "ta2-record-gateway", may_return=self._is_closing.is_set, again=True)

    def start(self) -> None:
        """Begin."""
        self._thread.start()

    def close(self) -> None:
        """End."""
        self._is_closing.set()
        self._thread.join(2 * AGAIN_S)

    def _run(self) -> None:
        while not self._is_closing.is_set():
            with suppress(GatewayError), connect(self._target, name="ta2 record", timeout_s=AGAIN_S) as robot:
                self._listen(robot)
            self._is_closing.wait(AGAIN_S)

    def _listen(self, robot: Robot) -> None:
        events = robot.events(timeout=LOOK_S)
        while not self._is_closing.is_set():
            look_s = time.monotonic() + LOOK_S
            for notice in events:
                self._tell(EVENTS, msgspec.to_builtins(notice))
                if self._is_closing.is_set():
                    return
                if time.monotonic() > look_s:  # whoever has much told keeps nothing else away
                    break
            view = robot.state.view
            shown: dict[str, object] = {
                "state": view.state,
                "owner": view.lease.name,
                "client_id": view.lease.client_id,
                "epoch": view.lease.epoch,
                "latches": dict(view.latches),
            }
            if shown != self._shown:
                self._shown = shown
                self._tell(GATEWAY, shown)
            felt = {side: arm.contact for side, arm in view.arms.items() if arm.contact is not None}
            if felt and view.seq != self._seq:
                self._seq = view.seq
                self._tell(CONTACT, msgspec.to_builtins(felt))
