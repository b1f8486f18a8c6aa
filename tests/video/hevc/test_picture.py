"""Rules of the simulated cameras' pictures: the manual's layout, a code and a name in each crop, work for the encoder."""

from __future__ import annotations

import numpy as np
import pytest

from gateway.sim.camera.composite import CHANNELS, CROPS, FULL, Size, channel_rows, crop_box, crops_of
from gateway.sim.camera.lettering import lettering
from gateway.sim.camera.picture import Planes, TestCamera, stitch
from gateway.video.decoding.views import VIEWS, pixel_box
from tests.video.code_reader import read_codes, read_composite

SMALL = Size(160, 340)


def cameras(size: Size = SMALL, seed: int = 0) -> list[TestCamera]:
    """Return the four cameras of a composite."""
    return [TestCamera(channel, size, seed) for channel in range(4)]


def shot(counter: int, seed: int = 0) -> Planes:
    """Return a small composite."""
    return stitch([camera.shoot(counter) for camera in cameras(seed=seed)])


@pytest.mark.parametrize("size", [FULL, SMALL, Size(320, 680)])
def test_the_crops_lie_where_the_receiver_looks_for_them(size: Size) -> None:
    """Worked out here from the channels, there from the manual's boxes (§6.9)."""
    assert tuple(CROPS) == VIEWS
    for name in CROPS:
        assert crop_box(size, name) == pixel_box(name, *size)


def test_the_channels_lie_one_below_the_other() -> None:
    """Head right, head left, right wrist, left wrist (§5.2); each has its own crops."""
    rows = [channel_rows(FULL, channel) for channel in range(4)]
    assert rows == [(0, 960), (960, 1920), (1920, 2320), (2320, 2720)]
    assert [name for channel in range(4) for name in crops_of(channel)] == list(CROPS)


@pytest.mark.parametrize("size", [(0, 340), (150, 340), (160, 300), (16, 34)])
def test_a_composite_that_cannot_be_cut_is_refused(size: tuple[int, int]) -> None:
    """Crops begin and end at whole pixels of the colour planes too."""
    with pytest.raises(ValueError, match="160x340"):
        TestCamera(0, Size(*size))


def test_a_composite_too_small_for_the_code_is_refused() -> None:
    """80x170 pixels can be cut, but nothing can be read from the wrists."""
    with pytest.raises(ValueError, match="72x40"):
        TestCamera(2, Size(80, 136))


def test_every_crop_has_the_code_of_its_trigger() -> None:
    """Stitched from four triggers, the crops tell which."""
    assert read_composite(shot(77).y) == 77
    torn = stitch([camera.shoot(10 + channel) for channel, camera in enumerate(cameras())])
    assert list(read_codes(torn.y).values()) == [10, 11, 12, 12, 13, 13]


def test_the_composite_has_the_robots_size() -> None:
    """2720 rows, 1280 columns, colour at half of both."""
    picture = stitch([camera.shoot(0) for camera in cameras(FULL)])
    assert [plane.shape for plane in picture] == [(2720, 1280), (1360, 640), (1360, 640)]
    assert picture.yuv420p().shape == (4080, 1280)
    assert read_composite(picture.y) == 0


def test_a_picture_is_that_of_its_counter_and_seed() -> None:
    """So a loop can be encoded once, and a receiver's pictures be compared with what was sent."""
    one, again, other, later = shot(5), shot(5), shot(5, seed=1), shot(6)
    assert all(np.array_equal(a, b) for a, b in zip(one, again, strict=True))
    assert not np.array_equal(one.y, other.y)
    assert np.abs(one.y.astype(int) - later.y).mean() > 5.0


def test_cells_are_grey_whatever_the_colour_around() -> None:
    """So that they are black and white in RGB as well."""
    x0, y0, _, _ = crop_box(SMALL, "head_left_eye")
    picture = shot(3)
    window = np.s_[(y0 + 8) // 2 : (y0 + 40) // 2, (x0 + 8) // 2 : (x0 + 72) // 2]
    assert (picture.u[window] == 128).all() and (picture.v[window] == 128).all()
    assert abs(int(picture.u[y0 // 2, x0 // 2]) - 128) > 5


def test_crops_bear_their_names_where_there_is_room() -> None:
    """In dots of four pixels on a full-size wrist, below the code."""
    picture = TestCamera(3).shoot(0)
    ink = lettering("LEFT WRIST RIGHT EYE", 4)
    window = picture.y[40 : 40 + ink.shape[0], 656 : 656 + ink.shape[1]]
    assert (window[ink] == 225).all() and (window[~ink] != 225).mean() > 0.9


def test_letters_are_drawn_with_dots_of_the_scale() -> None:
    """An I: a bar, a stem, a bar."""
    dots = lettering("I", 2)
    assert dots.shape == (14, 12)
    assert dots[::2, ::2].astype(int).sum(axis=1).tolist() == [3, 1, 1, 1, 1, 1, 3]


def test_a_letter_without_a_glyph_is_refused() -> None:
    """Names of crops need 13 letters."""
    with pytest.raises(ValueError, match="no glyph for Q"):
        lettering("QUIET", 1)


def test_not_one_picture_for_each_channel_is_refused() -> None:
    """The message names the channels."""
    with pytest.raises(ValueError, match=CHANNELS[2]):
        stitch([camera.shoot(0) for camera in cameras()[:3]])
