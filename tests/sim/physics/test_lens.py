"""The eyes' lenses as maps of pixels, against OpenCV's fisheye model written down once more."""

from __future__ import annotations

import numpy as np
import pytest

from gateway.sim.physics.body_numbers import body_numbers
from gateway.sim.physics.lens import WIDEST_RAD, Lens, lens_of

HEAD = body_numbers().cameras["head"]
WRIST = body_numbers().cameras["left_wrist"]


def seen_at(ray, focal_px, centre_px, k=(0.0, 0.0, 0.0, 0.0)):
    """Where a ray (x right, y down, z forward) is seen [pixels]."""
    radius = float(np.hypot(ray[0], ray[1]))
    theta = float(np.arctan2(radius, ray[2]))
    distorted = theta * (1.0 + sum(factor * theta ** (2 * n) for n, factor in enumerate(k, start=1)))
    return np.array(centre_px) + np.array(focal_px) * distorted * np.array(ray[:2]) / max(radius, 1e-12)


def drawn_at(lens: Lens, pixel) -> np.ndarray:
    """Where a pixel of the crop lies on the plane at distance 1, by the lens' map."""
    column, row = (round(float(value)) for value in pixel)
    index = int(lens.source[row, column])
    assert index >= 0
    width, height = lens.drawn
    scale = 0.5 * height / np.tan(np.deg2rad(0.5 * lens.fovy_deg))
    return np.array([(index % width + 0.5 - 0.5 * width) / scale, (index // width + 0.5 - 0.5 * height) / scale])


def test_the_head_s_lens_is_the_published_example_at_half_its_size():
    """Rays anywhere within 55 deg are found on the plane where the model puts them, to the pixel that was drawn."""
    lens = lens_of(HEAD, (960, 960))
    example = HEAD["example_fisheye"]
    focal_px = (0.5 * example["fx_px"], 0.5 * example["fy_px"])
    centre_px = (0.5 * example["cx_px"] - 0.25, 0.5 * example["cy_px"] - 0.25)
    scale = 0.5 * lens.drawn[1] / np.tan(np.deg2rad(0.5 * lens.fovy_deg))
    rng = np.random.default_rng(8)
    for theta, phi in zip(np.deg2rad(rng.uniform(0.0, 55.0, 200)), rng.uniform(-np.pi, np.pi, 200), strict=True):
        ray = np.array([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)])
        pixel = seen_at(ray, focal_px, centre_px, example["k"])
        # Half a pixel of the crop, and one of what is drawn; the plane stretches by 1/cos² towards its rim.
        allowed = 0.75 / focal_px[0] / np.cos(theta) ** 2 + 1.5 / scale
        assert drawn_at(lens, pixel) == pytest.approx(ray[:2] / ray[2], abs=allowed)


def test_a_wrist_s_lens_has_both_published_fields_of_view():
    """120 deg across and 76 down: one focal length gives both, so it is equidistant."""
    lens = lens_of(WRIST, (640, 400))
    focal_px = 320.0 / np.deg2rad(60.0)
    assert 2.0 * np.rad2deg(200.0 / focal_px) == pytest.approx(76.0, abs=1.5)
    for pixel, ray in (((639, 200), (np.tan(np.deg2rad(60.0)), 0.0)), ((320, 399), (0.0, np.tan(200.0 / focal_px)))):
        assert drawn_at(lens, pixel) == pytest.approx(ray, abs=0.03)


def test_what_is_too_far_from_the_axis_is_black_and_the_middle_is_not():
    """The corners of the head's crop are beyond 68 deg; its middle looks straight on."""
    lens = lens_of(HEAD, (240, 240))
    white = np.full((lens.drawn[1], lens.drawn[0], 3), 255, np.uint8)
    seen = lens.see(white)
    assert seen.shape == (240, 240, 3)
    for row in (0, -1):
        for column in (0, -1):
            assert not seen[row, column].any()
    assert seen[120, 120].all() and seen[120, 2].all() and seen[2, 120].all()
    assert drawn_at(lens, (119, 120)) == pytest.approx((0.0, 0.0), abs=0.03)
    assert np.rad2deg(WIDEST_RAD) == pytest.approx(68.0)
    assert not lens.source.flags.writeable
