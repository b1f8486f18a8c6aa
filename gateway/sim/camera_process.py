"""Runs the simulated camera beside a simulated robot: a process of its own, which ends with this one."""

from __future__ import annotations

import importlib.util
import os
import subprocess
import sys
from types import TracebackType
from typing import Final

from gateway.sim.hevc import REMEDY, EncoderMissing
from gateway.sim.sender import DEFAULT_TO, address_of

__all__ = ["DEFAULT_TO", "SETTINGS", "CameraProcess"]

SETTINGS: tuple[str, ...] = ("--nice", "10")
"""What the camera's program is told besides address and seed: it leaves the processor to the robot's model."""

_PATIENCE_S: Final = 5.0


class CameraProcess:
    """The camera's process, from `with` to its end.

    Args:
        to: `HOST:PORT` to send to.
        seed: Of its patterns.
        scene: Where the simulation listens whose scene it shows; None for test pictures.

    Raises:
        EncoderMissing: If PyAV is not installed: told here, before a robot begins to listen.
        ValueError: If the address is none.
    """

    def __init__(self, to: str, seed: int = 0, scene: str | None = None) -> None:
        address_of(to)
        if importlib.util.find_spec("av") is None:
            raise EncoderMissing(f"the simulated camera encodes with PyAV, which is not here: {REMEDY}")
        options = ["--to", to, "--seed", str(seed), "--parent", str(os.getpid()), *SETTINGS]
        if scene is not None:
            options += ["--scene", scene]
        self._command = [sys.executable, "-m", "gateway.sim.camera", *options]
        self._process: subprocess.Popen[bytes] | None = None

    def __enter__(self) -> CameraProcess:
        """Start it."""
        self._process = subprocess.Popen(self._command, stdin=subprocess.DEVNULL)
        return self

    @property
    def pid(self) -> int | None:
        """Its process id while it runs."""
        return None if self._process is None or self._process.poll() is not None else self._process.pid

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """End it."""
        if self._process is None:
            return
        self._process.terminate()
        try:
            self._process.wait(_PATIENCE_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
