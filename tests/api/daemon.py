"""A daemon without a robot: the real local plane over zenoh, and a scripted engine ticked by a thread."""

from __future__ import annotations

import threading
import time
from pathlib import Path

from gateway.api.service import LocalPlane
from gateway.settings.settings import LinkSettings, LocalSettings, Settings
from tests.api.stand_in import TICK_NS, ScriptedEngine


def settings_for(directory: Path, **local):
    """Return settings whose socket, and whose robot, no other test has."""
    return Settings(
        local=LocalSettings(**{"socket": str(directory / "gw.sock")} | local),
        link=LinkSettings(endpoint=f"tcp/robot-of-{directory.name}:9000"),
    )


class Daemon:
    """Context manager; `engine` is the scripted engine, `socket` the path."""

    def __init__(self, directory: Path, **local):
        self.settings = settings_for(directory, **local)
        self.socket = directory / "gw.sock"
        self.plane = LocalPlane(self.settings, directory)
        self.engine = ScriptedEngine(self.plane, time.monotonic_ns)
        self._stopped = threading.Event()
        self._thread = threading.Thread(target=self._run)

    def _run(self):
        due_ns = time.monotonic_ns()
        while not self._stopped.is_set():
            self.engine.tick()
            due_ns += TICK_NS
            self._stopped.wait(max(0, due_ns - time.monotonic_ns()) / 1e9)

    def __enter__(self):
        self.plane.open()
        self._thread.start()
        return self

    def __exit__(self, *_):
        self._stopped.set()
        self._thread.join(5)
        self.plane.close()


def eventually(condition, timeout_s=5.0):
    """Return what a condition gives as soon as it is true; fails when it never is."""
    deadline = time.monotonic() + timeout_s
    while time.monotonic() < deadline:
        value = condition()
        if value:
            return value
        time.sleep(0.005)
    raise AssertionError("it did not happen in time")
