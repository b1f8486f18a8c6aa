"""README and tutorials do what they say, block by block, from the terminals on that they begin with; see `pages.py`."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.e2e.pages import PageBroken, PageRun, blocks
from tests.e2e.system import ATTEMPTS, ROOT, STALLED
from tests.sim.physics.mujoco_needed import REASON

pytestmark = [pytest.mark.e2e, pytest.mark.sim_only("each page says which robot it starts")]

PAGES = [ROOT / "README.md", *sorted((ROOT / "docs" / "tutorials").glob("*.md"))]
LONG = {"demonstration-to-policy", "grasp-and-drive"}


@pytest.fixture
def folder() -> Iterator[Path]:
    """A folder whose path is short enough for a socket in it."""
    made = Path(tempfile.mkdtemp(prefix="ta2-"))
    yield made
    shutil.rmtree(made, ignore_errors=True)


@pytest.mark.body_free("each page says which robot it starts")
@pytest.mark.parametrize(
    "page", [pytest.param(page, id=page.stem, marks=[pytest.mark.thorough] * (page.stem in LONG)) for page in PAGES]
)
def test_the_page_does_what_it_says(page: Path, folder: Path) -> None:
    """Every block that is not marked as one for another machine runs, and prints what the page says, but for numbers."""
    if any("--physics mujoco" in block.text for block in blocks(page) if block.directive == "run: terminals"):
        pytest.importorskip("mujoco", reason=REASON)
    for attempt in range(ATTEMPTS):
        place = folder / str(attempt)
        place.mkdir()
        run = PageRun(page, place)
        try:
            run.run()
        except PageBroken as broken:
            if attempt == ATTEMPTS - 1 or not any(code in str(broken) for code in STALLED):
                raise
        else:
            return
        finally:
            run.close()
