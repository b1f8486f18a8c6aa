"""Runs the film beside a simulated robot: a process of its own, which ends with this one."""

from __future__ import annotations

import importlib.util
import os
import subprocess
import sys
from pathlib import Path
from types import TracebackType
from typing import Final

__all__ = ["FilmProcess"]

_PATIENCE_S: Final = 10.0


class FilmProcess:
    """The film's process, from `with` to its end, when the file is whole.

    Args:
        endpoint: Where the simulation will listen.
        path: The film, overwritten.

    Raises:
        ValueError: The file is no *.mp4 of a folder that exists, or PyAV is not installed: told before a robot listens.
    """

    def __init__(self, endpoint: str, path: Path) -> None:
        if path.suffix != ".mp4" or not path.parent.is_dir():
            raise ValueError(f"a film is an .mp4 file in a folder that exists, not {path}")
        if importlib.util.find_spec("av") is None:
            raise ValueError("a film is written with PyAV: pip install 'teleavatar-gateway[video]'")
        words = ["--at", endpoint, "--to", str(path), "--parent", str(os.getpid())]
        self._command = [sys.executable, "-m", "gateway.sim.physics.filming", *words]
        self._process: subprocess.Popen[bytes] | None = None

    def __enter__(self) -> FilmProcess:
        """Start it."""
        self._process = subprocess.Popen(self._command, stdin=subprocess.DEVNULL)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """End it, and wait until the file is whole."""
        if self._process is None:
            return
        self._process.terminate()
        try:
            self._process.wait(_PATIENCE_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
