"""Runs the film beside a simulated robot: a process of its own, which ends with this one."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from typing import Final

from gateway.sim.companion import Companion

__all__ = ["FilmProcess"]

_PATIENCE_S: Final = 10.0


class FilmProcess(Companion):
    """The film's process, from `with` to its end, when the file is whole.

    Raises:
        ValueError: The file is no *.mp4 of a folder that exists, or PyAV is not installed: told before a robot listens.
    """

    def __init__(self, endpoint: str, path: Path) -> None:
        if path.suffix != ".mp4" or not path.parent.is_dir():
            raise ValueError(f"a film is an .mp4 file in a folder that exists, not {path}")
        if importlib.util.find_spec("av") is None:
            raise ValueError("a film is written with PyAV: pip install 'teleavatar-gateway[video]'")
        super().__init__("gateway.sim.physics.filming", ["--at", endpoint, "--to", str(path)], _PATIENCE_S)
