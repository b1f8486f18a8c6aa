"""The robot's four cameras in the scene of a running simulation, as the test cameras' twins: `shoot` gives a channel.

All cameras of one trigger see one instant: positions are asked for once per trigger. A head's channel shows its crop (the
middle three quarters) and black beside it; a wrist's has its two eyes side by side (§5.2).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import av
import numpy as np
from numpy.typing import NDArray

from gateway.sim.camera.composite import CHANNELS, Size, channel_rows, crop_box, crops_of
from gateway.sim.camera.picture import Planes
from gateway.sim.physics.body_numbers import body_numbers
from gateway.sim.physics.drawing import Drawing
from gateway.sim.physics.lens import Lens, lens_of

__all__ = ["Eyes", "SceneCamera"]


class Eyes:
    """All four cameras, from `with` to its end; to be used in one thread.

    Args:
        ask: Returns where everything is now (`{"do": "world"}`).
        has_lift: Whether the robot is the lift model.
        size: Of the composite [pixels].

    Attributes:
        cameras: In the order of `CHANNELS`.
        backend: What draws.

    Raises:
        DrawingMissing: Nothing here can draw.
        ValueError: The composite cannot be cut.
    """

    def __init__(self, ask: Callable[[], Sequence[float]], *, has_lift: bool, size: Size) -> None:
        size.checked()
        self._ask = ask
        self._counter: int | None = None
        self.cameras = [SceneCamera(self, channel, size) for channel in range(len(CHANNELS))]
        drawn = [lens.drawn for camera in self.cameras for lens in camera.lenses.values()]
        largest = (max(16, *(width for width, _ in drawn)), max(16, *(height for _, height in drawn)))
        self._drawing = Drawing(has_lift=has_lift, width=largest[0], height=largest[1])
        self.backend = self._drawing.backend

    def view(self, eye: str, lens: Lens, counter: int) -> NDArray[np.uint8]:
        """Return what an eye sees at a trigger, shape (height, width, 3), RGB."""
        if counter != self._counter:
            self._drawing.pose(self._ask())
            self._counter = counter
        return lens.see(self._drawing.look(eye, *lens.drawn, lens.fovy_deg))

    def close(self) -> None:
        """Give what draws back."""
        self._drawing.close()

    def __enter__(self) -> Eyes:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


class SceneCamera:
    """One capture channel.

    Args:
        eyes: All of them.
        channel: Index in `CHANNELS`.
        size: Of the composite [pixels].

    Attributes:
        lenses: In front of each crop, by name.
    """

    def __init__(self, eyes: Eyes, channel: int, size: Size) -> None:
        top, bottom = channel_rows(size, channel)
        self._eyes = eyes
        self._shape = (bottom - top, size.width, 3)
        camera = body_numbers().cameras["head" if CHANNELS[channel].startswith("head") else CHANNELS[channel]]
        self._boxes = {
            name: (x0, y0 - top, x1, y1 - top)
            for name in crops_of(channel)
            for x0, y0, x1, y1 in [crop_box(size, name)]
        }
        self.lenses = {name: lens_of(camera, (x1 - x0, y1 - y0)) for name, (x0, y0, x1, y1) in self._boxes.items()}

    def shoot(self, counter: int) -> Planes:
        """Return the channel's picture at a trigger.

        Args:
            counter: Of the trigger; a new one is a new instant.
        """
        picture = np.zeros(self._shape, np.uint8)
        for name, (x0, y0, x1, y1) in self._boxes.items():
            picture[y0:y1, x0:x1] = self._eyes.view(name, self.lenses[name], counter)
        return _planes(picture)


def _planes(picture: NDArray[np.uint8]) -> Planes:
    """Return an RGB picture as YUV 4:2:0, limited range."""
    frame = av.VideoFrame.from_ndarray(picture, format="rgb24").reformat(format="yuv420p")
    height, width, _ = picture.shape
    flat = frame.to_ndarray().astype(np.uint8, copy=False).reshape(-1)
    luma, quarter = height * width, height * width // 4
    half = (height // 2, width // 2)
    return Planes(
        flat[:luma].reshape(height, width),
        flat[luma : luma + quarter].reshape(half),
        flat[luma + quarter : luma + 2 * quarter].reshape(half),
    )
