"""Tests of remapping: known pictures come out as they must, with and without OpenCV."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest

from gateway.kinematics.cameras import remap
from gateway.kinematics.cameras.lens import Pinhole
from gateway.kinematics.cameras.remap import RemapTable, straightening, straightenings
from gateway.kinematics.cameras.stereo import level_pinhole, turned_level
from gateway.values import ValueRefused
from tests.changed import replace
from tests.kinematics.lenses import example_lens, skewed_pair


def picture_of(lens, colour):
    """Return what a lens sees of a far world that is coloured by direction, shape (h, w), uint8; black where nothing."""
    width, height = lens.intrinsics.size_px
    v, u = np.indices((height, width), dtype=float)
    return np.round(np.nan_to_num(colour(lens.rays(np.stack((u, v), -1))))).astype(np.uint8)


def smooth(rays):
    """Colour a direction: smooth, so that bilinear mixing is right to a few grey levels."""
    return 127 + 60 * np.sin(6 * rays[..., 0]) + 60 * np.cos(5 * rays[..., 1])


def test_a_straightened_picture_is_the_one_a_pinhole_had_seen():
    """Each pixel of the new picture has the colour of the direction it looks in, within mixing's two grey levels."""
    lens = example_lens().scaled(240, 240)
    pinhole = level_pinhole(200, 160, math.radians(80))
    table = straightening(lens, pinhole)
    assert table.is_inside.all() and table.shape == (160, 200)
    found = table.apply(picture_of(lens, smooth))
    assert np.abs(found.astype(int) - picture_of(pinhole, smooth)).max() <= 2


def test_both_eyes_see_the_far_world_alike_after_rectification():
    """For what is far away two levelled pictures of skewed eyes are one and the same."""
    full = skewed_pair()
    pair = replace(full, left=full.left.scaled(240, 240), right=full.right.scaled(240, 240))
    rectification = turned_level(pair, math.radians(80))
    tables = straightenings(pair, rectification)
    to_left = [np.eye(3), pair.right_T_left.rotation]
    left, right = (
        table.apply(picture_of(lens, lambda rays, turn=turn: smooth(rays @ turn)))
        for table, lens, turn in zip(tables, (pair.left, pair.right), to_left, strict=True)
    )
    assert np.abs(left.astype(int) - right.astype(int)).max() <= 2
    assert left.std() > 30, "there is something to see"


def test_what_comes_from_outside_is_black():
    """A wider view than the lens has is black around it, in every channel."""
    lens = Pinhole(level_pinhole(100, 100, math.radians(60)).intrinsics)
    table = straightening(lens, level_pinhole(100, 100, math.radians(120)))
    found = table.apply(np.full((100, 100, 3), 200, np.uint8))
    assert found.shape == (100, 100, 3)
    assert (found[50, 50] == 200).all() and (found[0, 0] == 0).all() and (found[50, 5] == 0).all()
    assert (found.any(axis=-1) == table.is_inside).all()
    assert (table.u_px[~table.is_inside] == -1.0).all() and table.u_px.dtype == np.float32


def test_a_table_that_changes_nothing_changes_nothing():
    """Whole pixels come out as they are, the last row and column as well, in grey and in colour."""
    rng = np.random.default_rng(1)
    v, u = np.indices((30, 40), dtype=float)
    table = RemapTable(np.stack((u, v), -1), 40, 30)
    for shape in ((30, 40), (30, 40, 3)):
        old = rng.integers(0, 256, shape, dtype=np.uint8)
        np.testing.assert_array_equal(table.by_numpy(old), old)
        np.testing.assert_array_equal(table.apply(np.asfortranarray(old)), old)


def test_between_pixels_is_the_mean_to_a_grey_level():
    """Bilinear, against the formula in floating point, for any fraction; weights of one colour change nothing."""
    rng = np.random.default_rng(2)
    old = rng.integers(0, 256, (30, 40), dtype=np.uint8)
    source = np.stack((rng.uniform(0, 39, (50, 60)), rng.uniform(0, 29, (50, 60))), -1)
    found = RemapTable(source, 40, 30).by_numpy(old)
    left, top = np.floor(source).astype(int).transpose(2, 0, 1)
    a, b = (source - np.floor(source)).transpose(2, 0, 1)
    exact = (
        (1 - a) * (1 - b) * old[top, left]
        + a * (1 - b) * old[top, left + 1]
        + (1 - a) * b * old[top + 1, left]
        + a * b * old[top + 1, left + 1]
    )
    assert np.abs(found - exact).max() < 0.5 + 4 * 0.5 * 255 / 128
    assert np.abs(found - exact).mean() < 0.5
    for grey in (0, 1, 128, 255):
        assert (RemapTable(source, 40, 30).by_numpy(np.full((30, 40), grey, np.uint8)) == grey).all()


def test_a_picture_of_another_size_is_refused():
    """The table knows what it was made for."""
    v, u = np.indices((30, 40), dtype=float)
    table = RemapTable(np.stack((u, v), -1), 40, 30)
    with pytest.raises(ValueRefused, match="30, 40"):
        table.apply(np.zeros((40, 30), np.uint8))


def test_opencv_does_the_work_where_it_is_installed(monkeypatch):
    """It is asked for the same pixels; what comes from outside is black all the same."""
    asked = []

    def fake_remap(picture, u_px, v_px, how, borderMode):
        asked.append((how, borderMode))
        return picture[np.rint(v_px).astype(int), np.rint(u_px).astype(int)]

    module = SimpleNamespace(remap=fake_remap, INTER_LINEAR=1, BORDER_REPLICATE=7)
    monkeypatch.setattr(remap, "opencv", lambda: module)
    v, u = np.indices((5, 5), dtype=float)
    table = RemapTable(np.stack((u + 1, v), -1), 5, 5)
    old = np.arange(25, dtype=np.uint8).reshape(5, 5)
    found = table.apply(old)
    np.testing.assert_array_equal(found[:, :4], old[:, 1:])
    assert (found[:, 4] == 0).all() and asked == [(1, 7)]


def test_opencv_is_optional(monkeypatch):
    """Without it numpy does the work; nothing fails."""

    def missing(name):
        raise ImportError(name)

    monkeypatch.setattr(remap.importlib, "import_module", missing)
    assert remap.opencv() is None
    v, u = np.indices((5, 5), dtype=float)
    assert (RemapTable(np.stack((u, v), -1), 5, 5).apply(np.full((5, 5), 9, np.uint8)) == 9).all()
