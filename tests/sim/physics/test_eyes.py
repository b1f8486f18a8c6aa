"""What the robot's eyes see of the scene: things are where lens and mounts put them, in all crops of the composite."""

from __future__ import annotations

import numpy as np
import pytest

from gateway.sim.camera.composite import CROPS, Size, crop_box
from gateway.sim.camera.rig import Rig
from gateway.sim.physics.body_numbers import body_numbers
from gateway.sim.robot.manual import EXAMPLE_HOME_RAD, Side
from tests.sim.physics.drawing_needed import demand_drawing
from tests.sim.physics.mujoco_needed import REASON
from tests.sim.physics.test_lens import seen_at

pytest.importorskip("mujoco", reason=REASON)
av = pytest.importorskip("av")

from gateway.sim.physics.eyes import Eyes
from gateway.sim.physics.world import World

SIZE = Size(640, 1360)


@pytest.fixture(scope="module")
def world() -> World:
    """Hands at home, before the table."""
    made = World(has_lift=True)
    for side in Side:
        made.pose_arm(side, np.array(EXAMPLE_HOME_RAD[side]))
        made.pose_gripper(side, 0.9)
    made.pose_lift(0.2)
    made.data.qpos[0] = 0.35
    made.pose_thing("block", (0.95, 0.15, 0.77))
    return made


@pytest.fixture(scope="module")
def eyes(world):
    """All eyes of it, and how often they asked where everything is."""
    asked = []

    def ask():
        asked.append(1)
        return world.positions()

    demand_drawing()
    with Eyes(ask, has_lift=True, size=SIZE) as made:
        made.asked = asked
        yield made


@pytest.fixture(scope="module")
def composite(eyes):
    """The composite of one trigger, through the mailboxes, shape (height, width, 3), RGB."""
    planes = Rig(SIZE, cameras=eyes.cameras).shoot(0)
    return av.VideoFrame.from_ndarray(planes.yuv420p(), format="yuv420p").to_ndarray(format="rgb24")


def crop(composite, name):
    """A crop of the composite."""
    x0, y0, x1, y1 = crop_box(SIZE, name)
    return composite[y0:y1, x0:x1]


def red_middle(picture) -> np.ndarray:
    """The middle of what is as red as the block [pixels]."""
    r, g, b = (picture[..., channel].astype(int) for channel in range(3))
    rows, columns = np.nonzero((r > 90) & (r > 2 * g) & (r > 2 * b))
    assert len(rows) > 4
    return np.array([columns.mean(), rows.mean()])


def expected(world, name) -> np.ndarray:
    """Where the block's middle is seen by an eye, by its mount and its lens [pixels]."""
    x0, y0, x1, y1 = crop_box(SIZE, name)
    width, height = x1 - x0, y1 - y0
    eye = world.data.camera(name)
    rotation = eye.xmat.reshape(3, 3) @ np.diag([1.0, -1.0, -1.0])  # z forward, y down
    ray = rotation.T @ (np.array(world.place("block").position_m) - eye.xpos)
    table = body_numbers().cameras["head" if name.startswith("head") else name.rsplit("_", 2)[0]]
    if "example_fisheye" in table:
        lens, part = table["example_fisheye"], width / table["sensor_px"][0]
        focal = (lens["fx_px"] * part, lens["fy_px"] * part)
        return seen_at(ray, focal, (lens["cx_px"] * part - 0.5, lens["cy_px"] * part - 0.5), lens["k"])
    focal_px = 0.5 * width / np.deg2rad(60.0)
    return seen_at(ray, (focal_px, focal_px), (0.5 * width - 0.5, 0.5 * height - 0.5))


@pytest.mark.parametrize("name", ["head_left_eye", "head_right_eye", "left_wrist_left_eye", "left_wrist_right_eye"])
def test_the_block_is_seen_where_mount_and_lens_put_it(world, composite, name):
    """Middle of its red against the model, to what its size and being hidden in part allow."""
    assert red_middle(crop(composite, name)) == pytest.approx(
        expected(world, name), abs=3.0 if "head" in name else 14.0
    )


def test_both_head_eyes_differ_by_the_baseline(world, composite):
    """65 mm at the block's distance, to half a pixel."""
    left, right = (red_middle(crop(composite, f"head_{eye}_eye")) for eye in ("left", "right"))
    wanted = expected(world, "head_left_eye") - expected(world, "head_right_eye")
    assert wanted[0] > 10.0
    assert left - right == pytest.approx(wanted, abs=1.0)


def test_beside_the_head_s_crop_and_in_its_corners_it_is_black(composite):
    """The middle three quarters of the channel are the crop (§5.2); the lens shows 68 deg from its axis."""
    for name in ("head_left_eye", "head_right_eye"):
        x0, y0, x1, y1 = crop_box(SIZE, name)
        assert composite[y0:y1, : x0 - 2].max() < 8 and composite[y0:y1, x1 + 2 :].max() < 8
        assert composite[y0 + 2, x0 + 2].max() < 8 and composite[y1 - 3, x1 - 3].max() < 8


def test_all_cameras_of_a_trigger_see_one_instant(eyes, world):
    """Positions are asked for once per trigger; a new trigger sees what has changed."""
    rig = Rig(SIZE, cameras=eyes.cameras)
    eyes.asked.clear()
    before = rig.shoot(1)
    assert len(eyes.asked) == 1
    world.pose_thing("block", (6.0, -5.0, 0.02))
    after = rig.shoot(2)
    assert len(eyes.asked) == 2 and rig.mailboxes.stitched == 2
    assert np.abs(before.y.astype(int) - after.y).max() > 20
    world.pose_thing("block", (0.95, 0.15, 0.77))


def test_every_crop_shows_something(composite):
    """Six different pictures, none of them empty."""
    pictures = [crop(composite, name) for name in CROPS]
    assert all(picture.std() > 15.0 for picture in pictures)
