"""Lenses for tests: one eye of one real robot, and pairs made around it."""

from __future__ import annotations

import numpy as np

from gateway.kinematics.cameras.lens import Fisheye, Intrinsics
from gateway.kinematics.cameras.stereo import StereoPair
from gateway.kinematics.nominal_frames import rotation_of_rpy
from gateway.kinematics.transform import Transform

EXAMPLE = Intrinsics(fx_px=957.752, fy_px=957.058, cx_px=953.094, cy_px=961.864, width_px=1920, height_px=1920)
EXAMPLE_K = (-0.021404, 0.002564, -0.003170, -0.001808)
"""One head eye of one robot (published by a third party): an example."""

SKEWED_RPY_RAD = (0.02, -0.03, 0.015)
SKEWED_T_M = (-0.0653, 0.0011, -0.0007)


def example_lens():
    """Return the example at its full size."""
    return Fisheye(EXAMPLE, EXAMPLE_K)


def skewed_pair():
    """Return two eyes that differ, are not parallel and not level, as mounted by people; at the size of the view."""
    other = Intrinsics(fx_px=955.1, fy_px=956.3, cx_px=960.2, cy_px=955.4, width_px=1920, height_px=1920)
    return StereoPair(
        left=example_lens().scaled(960, 960),
        right=Fisheye(other, (-0.02, 0.003, -0.003, -0.0015)).scaled(960, 960),
        right_T_left=Transform.of(
            "head_right_camera_T_head_left_camera", p_m=SKEWED_T_M, rotation=rotation_of_rpy(SKEWED_RPY_RAD)
        ),
    )


def cone(rng, count, widest_rad):
    """Return random directions up to an angle from the optical axis, shape (count, 3)."""
    theta, phi = rng.uniform(0.0, widest_rad, count), rng.uniform(-np.pi, np.pi, count)
    return np.stack((np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)), axis=-1)
