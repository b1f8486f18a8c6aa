"""The docs' pictures of the body, drawn anew: `python -m tests.tooling.readme_pictures`.

The frames as `ta2 frames` draws them, and the robot with forces at its table.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Final

import numpy as np
from PIL import Image

from gateway.sim.robot.manual import EXAMPLE_HOME_RAD, Side

__all__ = ["FOLDER", "PICTURES", "draw", "main"]

FOLDER: Final = Path(__file__).parents[2] / "docs"
PICTURES: Final = ("frames.png", "robot.jpg")
_QUALITY: Final = 80
_COLOURS: Final = 64


def draw(folder: Path) -> None:
    """Draw all of them.

    Args:
        folder: For `PICTURES`; made if it is not there.

    Raises:
        DrawingMissing: Nothing here can draw without a display.
    """
    folder.mkdir(parents=True, exist_ok=True)
    frames, robot = (folder / name for name in PICTURES)
    _draw_frames(frames)
    _draw_robot(robot)


def _draw_frames(file: Path) -> None:
    from gateway import cli  # matplotlib is not everywhere

    if cli.main(["frames", "--plot", str(file)]) != 0:
        raise RuntimeError("ta2 frames could not draw")
    with Image.open(file) as drawn:
        drawn.convert("RGB").quantize(_COLOURS, Image.Quantize.MAXCOVERAGE).save(file, optimize=True)  # lines need few


def _draw_robot(file: Path) -> None:
    from gateway.sim.physics.drawing import Drawing
    from gateway.sim.physics.world import World  # MuJoCo is not everywhere

    world = World(has_lift=True)
    for side in Side:
        world.pose_arm(side, np.array(EXAMPLE_HOME_RAD[side]))
        world.pose_gripper(side, 0.9)
    world.pose_lift(0.2)
    positions = world.positions()
    positions[0] = 0.35  # near the table
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
