"""The pictures of README and docs: there, small, and drawn by this repository itself."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from PIL import Image

from tests.sim.physics.drawing_needed import demand_drawing
from tests.sim.physics.mujoco_needed import REASON
from tests.tooling.readme_pictures import FOLDER, PICTURES, draw

ROOT = Path(__file__).resolve().parents[2]
MOST_BYTES = 150_000


def size_px(file: Path) -> tuple[int, int]:
    """Return a picture's width and height."""
    with Image.open(file) as picture:
        return picture.size


def test_every_picture_is_there_and_small() -> None:
    """And none lies about that no page shows."""
    pages = [ROOT / "README.md", *(ROOT / "docs").rglob("*.md")]
    pictures = [(page, re.findall(r"!\[[^]]+\]\(([^)]+)\)", page.read_text(encoding="utf-8"))) for page in pages]
    shown = {(page.parent / name).resolve() for page, names in pictures for name in names}
    there = {file for file in FOLDER.rglob("*.*") if file.suffix in {".png", ".jpg", ".svg"}}
    assert shown == there >= {FOLDER / name for name in PICTURES}
    for file in {file for file in there if file.suffix != ".svg"}:
        assert min(size_px(file)) > 100 and file.stat().st_size < MOST_BYTES, file


@pytest.mark.slow
def test_the_pictures_can_be_drawn_anew(tmp_path: Path) -> None:
    """By one command, in the same sizes: what is shown is what the programs draw now."""
    pytest.importorskip("mujoco", reason=REASON)
    pytest.importorskip("matplotlib")
    demand_drawing()
    draw(tmp_path)
    for name in PICTURES:
        assert size_px(tmp_path / name) == size_px(FOLDER / name)
        assert (tmp_path / name).stat().st_size < MOST_BYTES
