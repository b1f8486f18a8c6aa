"""Tests of the sheet that shows all six views of a frame, each under its name."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from gateway.video.decoding.frame import Frame
from gateway.video.decoding.views import BOXES, VIEWS, pixel_box
from gateway.video.errors import VideoCode, VideoError
from gateway.video.sheet import ROWS, Sheet, write_sheet
from tests.video.shown import Shown


def a_frame(width=1280, height=2720):
    """Return one whose views have a colour each."""
    rgb = np.zeros((height, width, 3), np.uint8)
    for number, name in enumerate(BOXES):
        x0, y0, x1, y1 = pixel_box(name, width, height)
        rgb[y0:y1, x0:x1] = colour_of(number)
    rgb.flags.writeable = False
    return Frame(Shown(rgb), 0, rtp_time=0, received_ns=0, published_ns=0, clean=True)


def colour_of(number):
    """Return a colour that is in no other view, and in no text."""
    return 40 * number, 255 - 40 * number, 100


def test_every_view_is_there_whole_and_once():
    """In its full size; the robot's left on the left."""
    assert sorted(name for row in ROWS for name in row) == sorted(VIEWS)
    frame = a_frame()
    picture = Sheet(1280, 2720).compose(frame)
    columns = {}
    for number, name in enumerate(BOXES):
        found = (picture == colour_of(number)).all(axis=2)
        assert found.sum() == frame[name].shape[0] * frame[name].shape[1]
        columns[name] = np.flatnonzero(found.any(axis=0))[0]
    assert all(columns[left] < columns[right] for left, right in ROWS)


@pytest.mark.parametrize(
    ("width", "height", "step"), [(1280, 2720, 1), (1280, 2720, 2), (1280, 2720, 3), (160, 340, 1)]
)
def test_every_view_bears_its_name(width, height, step):
    """There is ink above each, and only there; the sheet is that of its size."""
    sheet = Sheet(width, height, step)
    empty = sheet.compose(replace(a_frame(width, height), source=Shown(np.zeros((height, width, 3), np.uint8))))
    assert (empty.max(axis=2) > 200).any()
    titled = sheet.compose(a_frame(width, height), "a title")
    assert (titled != sheet.compose(a_frame(width, height))).any()
    assert titled.shape == empty.shape and sheet.size == (width, height)


def test_a_damaged_frame_has_a_red_edge():
    """Nobody shall judge by it unwarned."""
    sheet = Sheet(160, 340)
    clean, damaged = (sheet.compose(replace(a_frame(160, 340), clean=clean)) for clean in (True, False))
    assert (damaged[0] == (220, 40, 40)).all() and not (clean[0] == (220, 40, 40)).all(axis=1).any()


def test_a_file_is_a_jpeg_in_full_size(tmp_path):
    """It can be opened by anything."""
    path = tmp_path / "sheet.jpg"
    write_sheet(a_frame(), path, "frame 0")
    with Image.open(path) as image:
        assert image.format == "JPEG" and image.width > 2 * 960 and image.height > 960 + 2 * 400


def test_a_file_that_cannot_be_written_is_a_clear_error(tmp_path):
    """With its path."""
    with pytest.raises(VideoError, match=r"nowhere") as caught:
        write_sheet(a_frame(160, 340), tmp_path / "nowhere" / "sheet.jpg")
    assert caught.value.code is VideoCode.CANNOT_WRITE
