"""Four test-pattern cameras, and their pictures stitched into the robot's composite (§5.2).

A pattern scrolls, each camera's in its own direction and colour, under noise that is new in each picture: the encoder
has as much to do as with a real scene. Every crop bears its name and its own code of the camera's trigger
(`pixel_code`), so a composite of unlike triggers, or a damaged one, gives itself away.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

from gateway.sim.camera.composite import CHANNELS, FULL, Size, channel_rows, crop_box, crops_of
from gateway.sim.camera.lettering import lettering
from gateway.sim.camera.pixel_code import layout_of, write_code

__all__ = ["VERSION", "Planes", "TestCamera", "stitch"]

VERSION: Final = 1
"""Of the pattern: pictures of another one are not the same, although all settings are."""

_TILE: Final = 256  # the pattern repeats after so many pixels
_NOISES: Final = 7
_NOISE_LEVELS: Final = 24  # luma steps, peak to peak
_GREY: Final = 128
_INK: Final = 225
_STEPS: Final = ((2, 3), (3, -2), (-2, 4), (-4, -3))  # how far each camera's pattern moves per picture [pixels]
_COLOURS: Final = ((100, 150), (150, 105), (110, 110), (145, 145))  # mean chroma of each camera: Cb, Cr


class Planes(NamedTuple):
    """A picture as YUV 4:2:0, limited range.

    Attributes:
        y: Luma, shape (height, width), uint8.
        u: Cb, shape (height / 2, width / 2), uint8.
        v: Cr, the same shape.
    """

    y: npt.NDArray[np.uint8]
    u: npt.NDArray[np.uint8]
    v: npt.NDArray[np.uint8]

    def yuv420p(self) -> npt.NDArray[np.uint8]:
        """Return all planes in one array, shape (height * 3 / 2, width), as PyAV takes them."""
        width = self.y.shape[1]
        return np.concatenate([self.y.ravel(), self.u.ravel(), self.v.ravel()]).reshape(-1, width)


class TestCamera:
    """One capture channel.

    Args:
        channel: Index in `CHANNELS`.
        size: Of the composite that it is part of [pixels].
        seed: Of pattern and noise.

    Raises:
        ValueError: If the composite cannot be cut, or its crops have no room for the code.
    """

    __test__ = False  # no test, for pytest

    def __init__(self, channel: int, size: Size = FULL, seed: int = 0) -> None:
        size.checked()
        top, bottom = channel_rows(size, channel)
        self.name = CHANNELS[channel]
        self._height, self._width = bottom - top, size.width
        self._step = _STEPS[channel]
        self._boxes = {
            name: (x0, y0 - top, x1, y1 - top)
            for name in crops_of(channel)
            for x0, y0, x1, y1 in [crop_box(size, name)]
        }
        chance = np.random.default_rng([seed, channel])
        rows, columns = self._height + _TILE, self._width + _TILE
        self._pattern = _tiled(_pattern(chance), rows, columns)
        self._u, self._v = (_tiled(_chroma(chance, mean), rows // 2, columns // 2) for mean in _COLOURS[channel])
        noise = chance.integers(0, _NOISE_LEVELS, (self._height + _NOISES, self._width + _NOISES), dtype=np.uint8)
        self._noise = noise
        self._labels = [(x0, y0, ink) for name, box in self._boxes.items() for x0, y0, ink in _label(name, box)]

    def shoot(self, counter: int) -> Planes:
        """Return the channel's picture at a trigger.

        Args:
            counter: Of the trigger; the same one always gives the same picture.
        """
        height, width = self._height, self._width
        across, down = (step * counter % _TILE for step in self._step)
        sway = counter * 5 % _NOISES, counter * 3 % _NOISES
        y = self._pattern[down : down + height, across : across + width].copy()
        y += self._noise[sway[0] : sway[0] + height, sway[1] : sway[1] + width]
        window = np.s_[down // 2 : (down + height) // 2, across // 2 : (across + width) // 2]
        u, v = self._u[window][: height // 2, : width // 2].copy(), self._v[window][: height // 2, : width // 2].copy()
        for x0, y0, x1, y1 in self._boxes.values():
            write_code(y[y0:y1, x0:x1], counter)
            left, top, right, bottom = layout_of(x1 - x0, y1 - y0).box
            for plane in (u, v):
                plane[(y0 + top) // 2 : (y0 + bottom) // 2, (x0 + left) // 2 : (x0 + right) // 2] = _GREY
        for x0, y0, ink in self._labels:
            y[y0 : y0 + ink.shape[0], x0 : x0 + ink.shape[1]][ink] = _INK
        return Planes(y, u, v)


def stitch(channels: Sequence[Planes]) -> Planes:
    """Return the composite of the channels' pictures, which are one below the other.

    Args:
        channels: In the order of `CHANNELS`.

    Raises:
        ValueError: If it is not one picture for each channel.
    """
    if len(channels) != len(CHANNELS):
        raise ValueError(f"{len(channels)} pictures for {len(CHANNELS)} channels: {', '.join(CHANNELS)}")
    return Planes(*(np.concatenate(planes) for planes in zip(*channels, strict=True)))


def _pattern(chance: np.random.Generator) -> npt.NDArray[np.uint8]:
    """Return a tile that fits to itself: waves, and blocks with edges."""
    rows, columns = np.mgrid[0:_TILE, 0:_TILE] * (2 * np.pi / _TILE)
    waves = sum(
        np.sin(a * rows + b * columns + phase)
        for a, b, phase in zip(*chance.integers(1, 9, (2, 6)), chance.uniform(0, 2 * np.pi, 6), strict=True)
    )
    blocks = chance.integers(-24, 25, (_TILE // 8, _TILE // 8)).repeat(8, axis=0).repeat(8, axis=1)
    tile: npt.NDArray[np.uint8] = np.clip(105 + 10 * waves + blocks, 24, 190).astype(np.uint8)
    return tile


def _chroma(chance: np.random.Generator, mean: int) -> npt.NDArray[np.uint8]:
    """Return a tile of one colour plane, coarser than the luma's."""
    side = _TILE // 2
    blocks = chance.integers(-12, 13, (side // 16, side // 16)).repeat(16, axis=0).repeat(16, axis=1)
    return (blocks + mean).astype(np.uint8)


def _tiled(tile: npt.NDArray[np.uint8], rows: int, columns: int) -> npt.NDArray[np.uint8]:
    times = -(-rows // tile.shape[0]), -(-columns // tile.shape[1])
    return np.tile(tile, times)[:rows, :columns]


def _label(name: str, box: tuple[int, int, int, int]) -> list[tuple[int, int, npt.NDArray[np.bool_]]]:
    """Return column, row and ink of each line of a crop's name below its code; nothing where there is no room."""
    x0, y0, x1, y1 = box
    layout = layout_of(x1 - x0, y1 - y0)
    scale = max(1, (x1 - x0) // 160)
    lines = [""]
    for word in name.upper().split("_"):
        longer = f"{lines[-1]} {word}".lstrip()
        if 6 * scale * len(longer) <= x1 - x0 - 2 * layout.cell:
            lines[-1] = longer
        else:
            lines.append(word)
    top = y0 + layout.box[3] + 2 * scale
    inks = [lettering(line, scale) for line in lines if line]
    places = [(x0 + layout.cell, top + 9 * scale * number, ink) for number, ink in enumerate(inks)]
    fits = all(row + ink.shape[0] <= y1 and column + ink.shape[1] <= x1 for column, row, ink in places)
    return places if fits else []
