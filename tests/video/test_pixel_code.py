"""Rules of `gateway.sim.camera.pixel_code`: what was written is read, and damage is never read as another picture."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.sim.camera.composite import CROPS, Size, crop_box
from gateway.sim.camera.pixel_code import COUNTERS, crc8, layout_of, write_code
from tests.video.code_reader import read_code, read_codes, read_composite

SMALL = Size(160, 340)


def written(counter: int, width: int = 80, height: int = 50) -> np.ndarray:
    """Return a grey crop with a code."""
    crop = np.full((height, width), 90, np.uint8)
    write_code(crop, counter)
    return crop


def composite(*counters: int) -> np.ndarray:
    """Return a small composite whose six crops have these codes."""
    luma = np.full((SMALL.height, SMALL.width), 90, np.uint8)
    for name, counter in zip(CROPS, counters, strict=True):
        x0, y0, x1, y1 = crop_box(SMALL, name)
        write_code(luma[y0:y1, x0:x1], counter)
    return luma


@given(st.integers(0, COUNTERS - 1), st.sampled_from([(80, 50), (120, 120), (640, 400), (960, 960)]))
def test_what_was_written_is_read(counter: int, shape: tuple[int, int]) -> None:
    """In small crops and in those of §5.2."""
    assert read_code(written(counter, *shape)) == counter


@given(st.integers(0, COUNTERS - 1), st.integers(0, 31))
def test_a_wrong_cell_is_seen(counter: int, cell: int) -> None:
    """A CRC-8 misses no single bit."""
    crop = written(counter)
    row, column = 8 + cell // 8 * 8, 8 + cell % 8 * 8
    crop[row : row + 8, column : column + 8] = 255 - crop[row : row + 8, column : column + 8]
    assert read_code(crop) is None


@pytest.mark.parametrize("value", [0, 255])
def test_a_picture_of_one_colour_has_no_code(value: int) -> None:
    """What a decoder shows that has nothing to show."""
    assert read_code(np.full((50, 80), value, np.uint8)) is None


def test_it_is_read_from_luma_and_from_rgb_of_full_range() -> None:
    """A decoder's RGB is black at 0 and white at 255."""
    luma = written(123_456)
    stretched = np.clip((luma.astype(float) - 16) * 255 / 219, 0, 255).astype(np.uint8)
    assert read_code(np.stack([stretched] * 3, axis=-1)) == 123_456


@given(st.integers(0, COUNTERS - 1), st.integers(0, 2**32 - 1))
def test_noise_of_a_bad_picture_does_not_matter(counter: int, seed: int) -> None:
    """80 steps of luma on every pixel."""
    noise = np.random.default_rng(seed).integers(-80, 81, (50, 80))
    assert read_code(np.clip(written(counter) + noise, 0, 255).astype(np.uint8)) == counter


def test_the_counter_begins_again_after_24_bits() -> None:
    """About 103 hours at 45 Hz."""
    assert read_code(written(COUNTERS + 5)) == 5


def test_the_crc_is_that_of_its_polynomial() -> None:
    """CRC-8/NRSC-5 of three bytes, worked out bit by bit by long division."""
    value = 0x123456 << 8 ^ 0xFF << 24
    for bit in range(31, 7, -1):
        if value >> bit & 1:
            value ^= 0x131 << bit - 8
    assert crc8(0x123456) == value


def test_a_composite_has_one_counter_only_if_all_crops_agree() -> None:
    """A crop of another picture, or a damaged one, is told by name."""
    assert read_composite(composite(7, 7, 7, 7, 7, 7)) == 7
    torn = composite(7, 7, 7, 8, 7, 7)
    assert read_composite(torn) is None
    assert read_codes(torn)["right_wrist_right_eye"] == 8
    damaged = composite(7, 7, 7, 7, 7, 7)
    damaged[130:160, 30:60] = 90
    assert read_composite(damaged) is None
    assert [name for name, counter in read_codes(damaged).items() if counter is None] == ["head_left_eye"]


def test_full_size_crops_have_one_row_of_16_pixel_cells() -> None:
    """So that codes survive any bit rate."""
    assert layout_of(640, 400).box == (16, 16, 528, 32)
    assert layout_of(80, 50).box == (8, 8, 72, 40)


def test_a_crop_without_room_is_refused() -> None:
    """The message tells the room that it takes."""
    with pytest.raises(ValueError, match="72x40"):
        write_code(np.zeros((39, 72), np.uint8), 1)
    with pytest.raises(ValueError, match="72x40"):
        read_code(np.zeros((40, 71), np.uint8))
