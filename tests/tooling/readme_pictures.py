"""The docs' pictures of the body, drawn anew: `python -m tests.tooling.readme_pictures`.

The frames as `ta2 frames` draws them, the robot with forces at its table, and with the block of the tutorial in its hand.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Final

import numpy as np
from PIL import Image

from gateway.sim.robot.geometry import Array, EePose, arm_geometry
from gateway.sim.robot.manual import EXAMPLE_HOME_RAD, Side
from gateway.sim.robot.settings import HANGING_RAD

__all__ = ["FOLDER", "PICTURES", "draw", "main"]

FOLDER: Final = Path(__file__).parents[2] / "docs"
PICTURES: Final = ("frames.png", "robot.jpg", "tutorials/grasp.jpg")
HAND: Final = EePose(position_m=(0.40, 0.0, -0.275), quat_xyzw=(0.5, 0.5, -0.5, 0.5))
"""Where the tutorial's left hand grasps, pointing down."""
PADS_M: Final = 0.19
"""How far below the hand its pads hold a thing then [m]."""
_QUALITY: Final = 80
_COLOURS: Final = 64


def draw(folder: Path) -> None:
    """Draw all of them.

    Args:
        folder: For `PICTURES`; made if it is not there.

    Raises:
        DrawingMissing: Nothing here can draw without a display.
    """
    frames, robot, grasp = (folder / name for name in PICTURES)
    for file in (frames, robot, grasp):
        file.parent.mkdir(parents=True, exist_ok=True)
    _draw_frames(frames)
    home = {side: np.array(EXAMPLE_HOME_RAD[side]) for side in Side}
    _draw_robot(robot, home, lowered_m=0.2, ahead_m=0.35, opening_rad=0.9)
    down = arm_geometry(Side.LEFT).inverse(HAND, home[Side.LEFT])
    if down is None:
        raise RuntimeError("the hand cannot be there")
    arms = {Side.LEFT: down, Side.RIGHT: np.array(HANGING_RAD[Side.RIGHT])}
    _draw_robot(grasp, arms, lowered_m=0.12, ahead_m=0.49, opening_rad=0.45, holds=True)


def _draw_frames(file: Path) -> None:
    from gateway.cli import main as cli  # matplotlib is not everywhere

    if cli.main(["frames", "--plot", str(file)]) != 0:
        raise RuntimeError("ta2 frames could not draw")
    with Image.open(file) as drawn:
        drawn.convert("RGB").quantize(_COLOURS, Image.Quantize.MAXCOVERAGE).save(file, optimize=True)  # lines need few


def _draw_robot(
    file: Path, arms: Mapping[Side, Array], lowered_m: float, ahead_m: float, opening_rad: float, *, holds: bool = False
) -> None:
    from gateway.sim.physics.drawing import Drawing
    from gateway.sim.physics.world import World  # MuJoCo is not everywhere

    world = World(has_lift=True)
    for side in Side:
        world.pose_arm(side, arms[side])
        world.pose_gripper(side, opening_rad)
    world.pose_lift(lowered_m)
    if holds:
        x_m, y_m, z_m = world.place("left_ee").position_m
        world.pose_thing("block", (x_m + ahead_m, y_m, z_m - PADS_M))
    positions = world.positions()
    positions[0] = ahead_m  # near the table
    with Drawing(has_lift=True) as drawing:
        Image.fromarray(drawing.draw(positions)).save(file, quality=_QUALITY, optimize=True)


def main() -> int:
    """Draw into the docs' folder; return the exit status."""
    draw(FOLDER)
    for name in PICTURES:
        sys.stdout.write(f"{FOLDER / name}: {(FOLDER / name).stat().st_size} bytes\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
