"""Rules of `gateway.video.decoding.views` and `frame`: the manual's boxes in pixels, no copies, nothing writable."""

from __future__ import annotations

import numpy as np
import pytest

from gateway.video.decoding.frame import Frame
from gateway.video.decoding.views import COMPOSITE, COMPOSITE_SHAPE, VIEWS, pixel_box
from tests.video.shown import Shown

SIZES = {
    "head_right_eye": (160, 0, 1120, 960),
    "head_left_eye": (160, 960, 1120, 1920),
    "right_wrist_left_eye": (0, 1920, 640, 2320),
    "right_wrist_right_eye": (640, 1920, 1280, 2320),
    "left_wrist_left_eye": (0, 2320, 640, 2720),
    "left_wrist_right_eye": (640, 2320, 1280, 2720),
    COMPOSITE: (0, 0, 1280, 2720),
}


def frame() -> Frame:
    """Return a frame whose pixels are all different enough."""
    rgb = np.arange(np.prod(COMPOSITE_SHAPE), dtype=np.uint32).astype(np.uint8).reshape(COMPOSITE_SHAPE)
    rgb.flags.writeable = False
    return Frame(Shown(rgb), seq=0, rtp_time=180_000, received_ns=1, published_ns=2, clean=True)


@pytest.mark.parametrize("name", SIZES)
def test_a_view_has_the_pixels_of_the_manuals_table(name: str) -> None:
    """§5.2 and §6.9, rounded as the manual's own receiver rounds."""
    assert pixel_box(name, 1280, 2720) == SIZES[name]


@pytest.mark.parametrize("name", SIZES)
def test_a_view_is_no_copy_and_cannot_be_written(name: str) -> None:
    """Frames are immutable: whoever wants to paint copies."""
    picture = frame()
    view = picture[name]
    assert np.shares_memory(view, picture.rgb)
    with pytest.raises(ValueError, match="read-only"):
        view[0, 0, 0] = 1


def test_the_views_cover_the_composite_without_overlap_but_for_the_heads_margins() -> None:
    """Six views; 160 columns on both sides of the head's eyes belong to nobody."""
    count = np.zeros(COMPOSITE_SHAPE[:2], int)
    for name in VIEWS:
        x0, y0, x1, y1 = pixel_box(name, 1280, 2720)
        count[y0:y1, x0:x1] += 1
    assert (count[1920:] == 1).all() and (count[:1920, 160:1120] == 1).all()
    assert not count[:1920, :160].any() and not count[:1920, 1120:].any()


def test_an_unknown_view_is_refused_with_the_names_there_are() -> None:
    """Bad input tells the remedy."""
    with pytest.raises(KeyError, match="head_left_eye"):
        frame()["head"]


def test_a_frame_tells_its_age_and_time_in_seconds() -> None:
    """RTP time counts at 90 kHz."""
    picture = frame()
    assert picture.stream_s == 2.0
    assert picture.age > 0.0
    assert set(picture.views) == set(VIEWS)
