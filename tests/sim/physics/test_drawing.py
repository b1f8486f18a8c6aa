"""Pictures of the scene without a display."""

from __future__ import annotations

import sys

import numpy as np
import pytest

from tests.sim.physics.drawing_needed import demand_drawing
from tests.sim.physics.mujoco_needed import REASON

pytest.importorskip("mujoco", reason=REASON)

from gateway.sim.physics.drawing import BACKENDS, Drawing, DrawingMissing
from gateway.sim.physics.world import World


@pytest.fixture
def drawing():
    """A small view of the lift model's scene."""
    demand_drawing()
    with Drawing(has_lift=True, width=320, height=240) as made:
        yield made


def red(picture) -> int:
    """How many pixels are as red as the block."""
    r, g, b = (picture[..., channel].astype(int) for channel in range(3))
    return int(((r > 90) & (r > 2 * g) & (r > 2 * b)).sum())


def test_the_scene_is_seen_as_it_is(drawing):
    """The block is in the picture, is not when it lies elsewhere, and the lift's motion changes what is seen."""
    world = World(has_lift=True)
    before = drawing.draw(world.positions())
    assert before.shape == (240, 320, 3) and before.dtype == np.uint8
    assert before[:20].mean() > before[-20:].mean()  # the sky is above
    assert red(before) > 5
    world.pose_thing("block", (6.0, -5.0, 0.02))  # behind the beholder
    assert red(drawing.draw(world.positions())) == 0
    world.pose_lift(0.4)
    after = drawing.draw(world.positions())
    assert np.abs(after.astype(int) - before).mean() > 1.0
    assert drawing.backend in BACKENDS


def test_positions_of_another_model_are_refused(drawing):
    """The standard model has one joint less."""
    with pytest.raises(ValueError, match="55 positions for a scene of 56"):
        drawing.draw(World(has_lift=False).positions())


def test_a_picture_has_a_size():
    """Neither empty nor larger than what can be drawn."""
    with pytest.raises(ValueError, match="0x240 pixels: 16 to 1280"):
        Drawing(has_lift=False, width=0, height=240)


def test_without_anything_that_draws_the_error_names_what_was_tried(monkeypatch):
    """Both back ends, each with its reason, and the packages that have them."""
    for backend in BACKENDS:
        monkeypatch.setitem(sys.modules, f"mujoco.{backend}", None)
    with pytest.raises(DrawingMissing, match=r"egl: .*; osmesa: .*libegl1 and libosmesa6"):
        Drawing(has_lift=False)
