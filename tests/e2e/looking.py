"""A small perception for tests: where coloured things are, seen by both eyes of the head, in the left arm's own frame.

What anybody can write with the public parts: views of the video, colours in numpy, the directions in which pixels look from
the robot's calibration (`gateway.kinematics.sight`), and the point where those of both eyes meet. It is told nothing of the
scene but colours and the eyes' calibration file.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gateway.kinematics.calibration import RobotIdentity, load
from gateway.kinematics.sight import Sight
from gateway.sim.physics.body_numbers import body_numbers
from gateway.video import Video
from tests.e2e.system import Process
from tests.video.sending import udp_port

__all__ = ["BLOCK", "FRAME", "MARK", "calibrated_sight", "look", "places_m"]

Array = NDArray[np.float64]

FRAME = "left_shoulder_base"
VIEWS = ("head_left_eye", "head_right_eye")

BLOCK, MARK = "block", "mark"
_CHANNELS = {BLOCK: 0, MARK: 1}
"""Which of red, green and blue is the colour of a thing."""
_DOMINANCE, _BRIGHTNESS = 1.7, 40
"""A pixel is of a colour when that is so much stronger than the others and so bright."""
_PIXELS, _SPREAD_PX = 60, 60.0
"""Fewer pixels are nothing seen; those that are so far from most others are something else."""


def calibrated_sight(folder: Path) -> Sight:
    """Return the simulated robot's eyes from a calibration file, as a real one brings its own (§5.5).

    Args:
        folder: For the file.
    """
    head = body_numbers().cameras["head"]
    lens = head["example_fisheye"]
    intrinsics = [lens[key] for key in ("fx_px", "fy_px", "cx_px", "cy_px")]
    width_px, height_px = head["sensor_px"]
    file = folder / "SIM-1.json"
    file.write_text(
        json.dumps(
            {
                "robot": {"serial": "SIM-1", "model": "lift"},
                "conventions": {
                    "transform_naming": "parent_T_child",
                    "matrix_layout": "row-major",
                    "translation_unit": "m",
                    "angle_unit": "rad",
                    "quaternion_order": "xyzw",
                    "handedness": "right",
                    "stereo_extrinsics": "left_T_right",
                },
                "cameras": {
                    "head": {
                        "model": "opencv_fisheye",
                        "width": width_px,
                        "height": height_px,
                        **{f"K{eye}": intrinsics for eye in "LR"},
                        **{f"D{eye}": lens["k"] for eye in "LR"},
                        "R": np.eye(3).tolist(),
                        "T": [head["baseline_m"], 0.0, 0.0],
                    }
                },
            }
        )
    )
    return Sight.of(load(file, RobotIdentity(serial="SIM-1", model="lift")))


def places_m(views: Mapping[str, NDArray[np.uint8]], sight: Sight) -> dict[str, Array]:
    """Return where things that both eyes of the head see are in `FRAME`, each of shape (3,) [m].

    Args:
        views: By the manual's names, shape (height, width, 3), RGB.
        sight: Of the robot that sent them.

    Returns:
        The middle of what is seen of a thing's surface. What an eye does not see is left out.
    """
    found = {}
    for thing, channel in _CHANNELS.items():
        middles = [_middle_px(views[view], channel) for view in VIEWS]
        if all(middle is not None for middle in middles):
            looked = [sight.rays(view, middle, FRAME) for view, middle in zip(VIEWS, middles, strict=True)]
            found[thing] = _meeting_m([located.transform.p_m for _, located in looked], [ray for ray, _ in looked])
    return found


def look(scene: str, folder: Path, sight: Sight) -> dict[str, Array]:
    """Return where things are in a new picture, one that was taken after this was called; see `places_m`.

    The scene's camera runs for this picture only: drawing on the processor would hold up the robot's motions.

    Args:
        scene: Where the simulation listens.
        folder: For the camera's log.
        sight: Of this robot.
    """
    port = udp_port()
    with Video("127.0.0.1", port=port, strict=True) as video:
        words = ["-m", "gateway.sim.camera", "--scene", scene, "--to", f"127.0.0.1:{port}", "--nice", "10"]
        camera = Process("camera", words, folder)
        try:
            frame = next(video.frames(timeout=60.0))
        finally:
            camera.end()
    return places_m(frame.views, sight)


def _middle_px(view: NDArray[np.uint8], channel: int) -> Array | None:
    """Return the middle of what has a colour, u and v [px]; None when that is nothing."""
    picture = view.astype(np.int16)
    colour, others = picture[..., channel], np.delete(picture, channel, axis=-1).max(axis=-1)
    pixels = np.argwhere((colour > _BRIGHTNESS) & (colour > _DOMINANCE * others))[:, ::-1]
    if len(pixels) < _PIXELS:
        return None
    is_near = np.abs(pixels - np.median(pixels, axis=0)).max(axis=-1) < _SPREAD_PX
    middle_px: Array = pixels[is_near].mean(axis=0)
    return middle_px


def _meeting_m(origins_m: list[Array], rays: list[Array]) -> Array:
    """Return the point that is nearest to straight lines, by least squares, shape (3,) [m].

    Args:
        origins_m: A point of each.
        rays: Their directions, unit vectors.
    """
    across = [np.eye(3) - np.outer(ray, ray) for ray in rays]
    wanted = [part @ origin_m for part, origin_m in zip(across, origins_m, strict=True)]
    return np.linalg.solve(np.sum(across, axis=0), np.sum(wanted, axis=0))
