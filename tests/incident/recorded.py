"""An engine with a black box, in place of the engine of a `Pair`: what the daemon's loop does, without the loop."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from gateway.core.engine import Engine, Output
from gateway.core.messages.events import Event
from gateway.incident import recorder
from gateway.incident.recorder import Recorder
from gateway.messages.requests import Estop
from gateway.values import Side
from tests.pair import Pair

DEADLINE_S = 60.0
MOST_WAITING = 300


class Recorded:
    """Stands for an engine; all that is not recorded is the engine's own."""

    def __init__(self, engine: Engine, folder: Path) -> None:
        self.engine = engine
        self.recorder = Recorder(engine, folder, "tcp/robot")
        self.recorder._ring.spare_bytes = 0
        self.is_waited_for = True
        """Whether time stands still while the disk is behind: virtual time is too quick for it."""

    def __getattr__(self, name: str) -> Any:
        return getattr(self.engine, name)

    def receive(self, event: Event, now_ns: int) -> None:
        self.recorder.receive(event, now_ns)

    def tick(self, now_ns: int, late_ns: int = 0) -> Output:
        output = self.recorder.tick(now_ns, late_ns=late_ns)
        self.recorder.look(now_ns)
        if self.is_waited_for:
            until(lambda: len(self.recorder._waiting) < min(MOST_WAITING, recorder.MOST_WAITING // 2))
        return output


def record(pair: Pair, folder: Path) -> Recorded:
    """Let a pair's engine be recorded from now on."""
    pair.engine = recorded = Recorded(pair.engine, folder)  # type: ignore[assignment]  # as much of one as a pair needs
    recorded.recorder.start()
    return recorded


def until(is_so: Callable[[], bool]) -> None:
    """Wait until something is so."""
    end_s = time.monotonic() + DEADLINE_S
    while not is_so():
        assert time.monotonic() < end_s, "not in time"
        time.sleep(0.005)


def an_incident(folder: Path, seconds: float = 1.0) -> Path:
    """Record a motion that an e-stop ends; return the incident."""
    pair = Pair()
    recorded = record(pair, folder)
    epoch = pair.activate()
    pair.move(epoch, {Side.LEFT: (0.3, 0.3, 0.3, 0.3, 0.3, 0.3, 0.3)})
    pair.run(seconds)
    pair.ask(Estop(reason="something fell"))
    pair.run(3.5)
    assert recorded.recorder.close(DEADLINE_S, is_clean=True)
    (kept,) = (folder / "kept").iterdir()
    return kept
