"""Runs the simulated camera beside a simulated robot: a process of its own, which ends with this one."""

from __future__ import annotations

import importlib.util
from typing import Final

from gateway.sim.camera.hevc import REMEDY, EncoderMissing
from gateway.sim.camera.sender import DEFAULT_TO, address_of
from gateway.sim.companion import Companion

__all__ = ["DEFAULT_TO", "SETTINGS", "CameraProcess"]

SETTINGS: tuple[str, ...] = ("--nice", "10")
"""What the camera's program is told besides address and seed: it leaves the processor to the robot's model."""

_PATIENCE_S: Final = 5.0


class CameraProcess(Companion):
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
        shown = () if scene is None else ("--scene", scene)
        super().__init__("gateway.sim.camera", ["--to", to, "--seed", str(seed), *SETTINGS, *shown], _PATIENCE_S)
