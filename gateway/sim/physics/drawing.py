"""Pictures of the scene without a display: EGL, on the processor where there is no graphics card, else OSMesa.

Draws from positions that it is given; owns a model of its own and steps nothing.
"""

from __future__ import annotations

import importlib
from collections.abc import Sequence
from typing import Any, Final

import mujoco
import numpy as np
from numpy.typing import NDArray

from gateway.sim.physics.scene import scene_xml

__all__ = ["BACKENDS", "Drawing", "DrawingMissing"]

BACKENDS: Final = ("egl", "osmesa")
"""In the order in which they are tried."""

_SHAPES: Final = 400
_LOOK: Final = {"lookat": (0.45, 0.0, 0.75), "distance": 2.7, "azimuth": 140.0, "elevation": -18.0}


class DrawingMissing(RuntimeError):
    """Nothing here can draw without a display; the text says what was tried."""


class Drawing:
    """A view of the scene, from `with` to its end; to be used in one thread.

    Args:
        has_lift: Whether the robot is the lift model.
        width: Of the pictures [pixels].
        height: The same.

    Attributes:
        backend: What draws.
        width: Of the pictures [pixels].
        height: The same.

    Raises:
        DrawingMissing: Neither EGL nor OSMesa starts.
        ValueError: A size that is not within 16 to 1280 pixels.
    """

    def __init__(self, *, has_lift: bool, width: int = 960, height: int = 544) -> None:
        if not (16 <= width <= 1280 and 16 <= height <= 1280):
            raise ValueError(f"a picture of {width}x{height} pixels: 16 to 1280 can be drawn, each way")
        self.width, self.height = width, height
        self.backend, self._surface = _surface(width, height)
        self._model: Any = mujoco.MjModel.from_xml_string(scene_xml(has_lift=has_lift))
        self._data: Any = mujoco.MjData(self._model)
        self._context: Any = mujoco.MjrContext(self._model, mujoco.mjtFontScale.mjFONTSCALE_100)
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, self._context)
        self._scene: Any = mujoco.MjvScene(self._model, maxgeom=_SHAPES)
        self._option: Any = mujoco.MjvOption()
        self._camera: Any = mujoco.MjvCamera()
        self._eye: Any = mujoco.MjvCamera()
        self._eye.type = mujoco.mjtCamera.mjCAMERA_FIXED
        for name, value in _LOOK.items():
            setattr(self._camera, name, value)

    def pose(self, positions: Sequence[float]) -> None:
        """Put everything where it is.

        Args:
            positions: Of everything, as `World.positions` gives them.

        Raises:
            ValueError: They are those of another model.
        """
        if len(positions) != self._model.nq:
            raise ValueError(f"{len(positions)} positions for a scene of {self._model.nq}: another model's?")
        self._data.qpos[:] = positions
        mujoco.mj_kinematics(self._model, self._data)
        mujoco.mj_camlight(self._model, self._data)

    def draw(self, positions: Sequence[float]) -> NDArray[np.uint8]:
        """Return the scene seen from the side, shape (height, width, 3), RGB.

        Args:
            positions: As for `pose`.

        Raises:
            ValueError: They are those of another model.
        """
        self.pose(positions)
        return self._picture(self._camera, self.width, self.height)

    def look(self, eye: str, width: int, height: int, fovy_deg: float) -> NDArray[np.uint8]:
        """Return what an eye of the robot sees without its lens, shape (height, width, 3), RGB.

        Args:
            eye: Such as `head_left_eye`.
            width: Of the picture, at most that of the view [pixels].
            height: The same.
            fovy_deg: Field of view from top to bottom [deg].

        Raises:
            KeyError: There is no such eye.
        """
        number = self._model.camera(eye).id
        self._model.cam_fovy[number] = fovy_deg
        self._eye.fixedcamid = number
        return self._picture(self._eye, width, height)

    def _picture(self, camera: Any, width: int, height: int) -> NDArray[np.uint8]:  # noqa: ANN401  MuJoCo's own class
        self._surface.make_current()  # there may be other views in this thread
        everything = mujoco.mjtCatBit.mjCAT_ALL
        mujoco.mjv_updateScene(self._model, self._data, self._option, None, camera, everything, self._scene)
        frame = mujoco.MjrRect(0, 0, width, height)
        mujoco.mjr_render(frame, self._scene, self._context)
        picture = np.empty((height, width, 3), np.uint8)
        mujoco.mjr_readPixels(picture, None, frame, self._context)
        return np.ascontiguousarray(picture[::-1])

    def close(self) -> None:
        """Give the context back; safe to call twice."""
        surface, self._surface = self._surface, None
        if surface is not None:
            surface.make_current()
            self._context.free()
            surface.free()

    def __enter__(self) -> Drawing:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def _surface(width: int, height: int) -> tuple[str, Any]:
    """Return what draws, and its context, made current."""
    reasons = []
    for backend in BACKENDS:
        try:
            surface = importlib.import_module(f"mujoco.{backend}").GLContext(width, height)
            surface.make_current()
        except (
            ImportError,
            RuntimeError,
            AttributeError,
            OSError,
        ) as error:  # a library is not there, or has no device
            reasons.append(f"{backend}: {error}")
        else:
            return backend, surface
    raise DrawingMissing(
        f"nothing draws here without a display ({'; '.join(reasons)}): Debian has libegl1 and libosmesa6"
    )
