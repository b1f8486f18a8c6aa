"""Tests of lenses: the published formula, the inverse, where a lens ends, sizes."""

from __future__ import annotations

import math

import numpy as np
import pytest

from gateway.kinematics.cameras.lens import Fisheye, Intrinsics, Pinhole
from gateway.values import ValueRefused
from tests.changed import replace
from tests.kinematics.lenses import EXAMPLE, EXAMPLE_K, cone, example_lens
from tests.thoroughness import either

LENSES = [
    example_lens(),
    Fisheye(EXAMPLE),
    Fisheye(EXAMPLE, (0.1, -0.02, 0.004, -0.0003)),
    Fisheye(EXAMPLE, (-0.3, 0.0, 0.0, 0.0)),
    Pinhole(EXAMPLE),
]


def test_the_fisheye_model_is_the_published_formula():
    """θ_d = θ (1 + k1 θ² + k2 θ⁴ + k3 θ⁶ + k4 θ⁸) towards the point, written out number by number (OpenCV, §5.5)."""
    k1, k2, k3, k4 = EXAMPLE_K
    for x, y, z in ((0.3, -0.2, 1.0), (1.0, 0.5, 0.4), (-0.01, 0.0, 2.0)):
        r = math.hypot(x / z, y / z)
        t = math.atan(r)
        d = t * (1 + k1 * t**2 + k2 * t**4 + k3 * t**6 + k4 * t**8)
        u, v = EXAMPLE.fx_px * d / r * x / z + EXAMPLE.cx_px, EXAMPLE.fy_px * d / r * y / z + EXAMPLE.cy_px
        found = example_lens().project([x, y, z])
        np.testing.assert_allclose(found.px, (u, v), atol=1e-9)
        assert found.is_visible == (-0.5 <= u <= 1919.5 and -0.5 <= v <= 1919.5)


def test_the_pinhole_is_a_central_projection():
    """Pixel fx x / z + cx, and nothing behind it is seen."""
    found = Pinhole(EXAMPLE).project([[0.2, 0.1, 0.5], [0.2, 0.1, -0.5], [0.2, 0.1, 0.0]])
    np.testing.assert_allclose(found.px[0], (EXAMPLE.fx_px * 0.4 + EXAMPLE.cx_px, EXAMPLE.fy_px * 0.2 + EXAMPLE.cy_px))
    assert np.isnan(found.px[1:]).all() and found.is_visible.tolist() == [True, False, False]


def test_no_pixel_sends_the_search_back_and_forth():
    """Newton's method alone went on between two angles for ever for one pixel in 50,000 of this lens, near 2.1725 rad."""
    lens = Fisheye(EXAMPLE, (0.1, -0.02, 0.004, -0.0003))
    theta = np.linspace(2.1, 2.25, 30_001)
    directions = np.stack((np.sin(theta), np.zeros_like(theta), np.cos(theta)), axis=-1)
    np.testing.assert_allclose(lens.rays(lens.project(directions).px), directions, atol=1e-13)


@pytest.mark.parametrize("lens", LENSES, ids=lambda lens: f"{type(lens).__name__} {getattr(lens, 'k', '')}")
def test_a_pixel_looks_back_at_what_it_shows(lens):
    """Rays undo the projection to rounding, up to the edge of what the lens sees."""
    reach = lens.reach_rad if isinstance(lens, Fisheye) else math.radians(89.0)
    rng = np.random.default_rng(1)
    # Where θ_d stops growing, rounding of θ_d grows without bound in θ: up to there, not on it.
    directions = cone(rng, either(2_000, 100_000), min(reach * 0.999, math.pi * 0.99))
    projected = lens.project(directions * rng.uniform(0.1, 5.0, (len(directions), 1)))
    np.testing.assert_allclose(lens.rays(projected.px), directions, atol=1e-11)
    np.testing.assert_allclose(lens.rays(lens.project([0.0, 0.0, 1.0]).px), (0, 0, 1), atol=1e-15)


def test_a_lens_ends_where_two_directions_would_share_a_pixel():
    """θ (1 − 0.3 θ²) grows to θ = √(1 / 0.9) only; beyond, and for pixels farther out, there is nothing."""
    lens = Fisheye(EXAMPLE, (-0.3, 0.0, 0.0, 0.0))
    end = math.sqrt(1.0 / 0.9)
    assert lens.reach_rad == pytest.approx(end, abs=1e-12)
    inside, outside = ([math.sin(end + d), 0.0, math.cos(end + d)] for d in (-1e-6, 1e-6))
    assert lens.project(inside).is_visible and not lens.project(outside).is_visible
    assert np.isnan(lens.project(outside).px).all()
    widest = end * (1 - 0.3 * end**2)
    px = EXAMPLE.pixels(np.array([[widest - 1e-9, 0.0], [widest + 1e-9, 0.0]]))
    assert np.isfinite(lens.rays(px)[0]).all() and np.isnan(lens.rays(px)[1]).all()


def test_a_wide_lens_sees_behind_itself_and_a_point_in_the_lens_is_nowhere():
    """Without distortion the whole sphere has pixels; straight behind there is no direction to draw it in."""
    lens = Fisheye(replace(EXAMPLE, width_px=9000, height_px=9000, cx_px=4500, cy_px=4500))
    assert lens.reach_rad == math.pi
    assert lens.project([1.0, 0.0, -1.0]).px[0] == pytest.approx(EXAMPLE.fx_px * 0.75 * math.pi + 4500)
    for nowhere in ([0.0, 0.0, 0.0], [0.0, 0.0, -1.0]):
        assert not lens.project(nowhere).is_visible


def test_half_the_size_is_half_the_pixels_counted_from_the_edge():
    """A view is the eye's picture halved (§5.2): edges scale, and the middle of pixel 0 is half a pixel inside."""
    lens = example_lens()
    half = lens.scaled(960, 960)
    points = cone(np.random.default_rng(2), 100, 1.0)
    np.testing.assert_allclose(half.project(points).px + 0.5, (lens.project(points).px + 0.5) / 2, atol=1e-9)
    assert half.k == lens.k and half.intrinsics.size_px == (960, 960)
    pinhole = Pinhole(EXAMPLE).scaled(480, 480)
    assert pinhole.intrinsics.fx_px == EXAMPLE.fx_px / 4


def test_visibility_ends_at_the_pictures_edge():
    """Half a pixel beyond the middle of the outermost pixels."""
    intrinsics = replace(EXAMPLE, width_px=1000, height_px=970, cx_px=500.0, cy_px=480.0)
    lens = Pinhole(intrinsics)
    for px, is_in in (
        ((-0.4, 5), True),
        ((-0.6, 5), False),
        ((999.4, 5), True),
        ((999.6, 5), False),
        ((5, 969.6), False),
    ):
        assert lens.project(lens.rays(px)).is_visible == is_in


@pytest.mark.parametrize(
    ("change", "match"),
    [
        ({"fx_px": 0.0}, "focal"),
        ({"fy_px": -1.0}, "focal"),
        ({"cx_px": math.nan}, "finite|intrinsics"),
        ({"width_px": 0}, "picture"),
        ({"cx_px": 1920.0}, "principal point"),
        ({"cy_px": -1.0}, "principal point"),
        ({"width_px": 640}, "size and intrinsics"),
    ],
)
def test_intrinsics_that_are_no_camera_are_refused(change, match):
    """Also a size that belongs to other numbers."""
    with pytest.raises(ValueRefused, match=match):
        replace(EXAMPLE, **change)


def test_another_shape_is_another_picture():
    """Scaling a square to 640 × 400 would be a crop, and is refused; so are points and coefficients of a wrong number."""
    with pytest.raises(ValueRefused, match="another shape"):
        EXAMPLE.scaled(640, 400)
    for lens in (example_lens(), Pinhole(EXAMPLE)):
        with pytest.raises(ValueRefused, match="shape"):
            lens.project([1.0, 2.0])
    with pytest.raises(ValueRefused, match="k"):
        Fisheye(EXAMPLE, (0.1, 0.2, 0.3))


def test_shapes_of_points_are_kept():
    """A grid of points gives a grid of pixels."""
    grid = cone(np.random.default_rng(3), 12, 1.0).reshape(3, 4, 3)
    for lens in LENSES:
        found = lens.project(grid)
        assert (
            found.px.shape == (3, 4, 2) and found.is_visible.shape == (3, 4) and lens.rays(found.px).shape == (3, 4, 3)
        )


def test_intrinsics_have_a_size():
    """Width, then height."""
    assert Intrinsics(fx_px=1, fy_px=1, cx_px=1, cy_px=1, width_px=4, height_px=3).size_px == (4, 3)
