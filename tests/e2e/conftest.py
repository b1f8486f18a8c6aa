"""Systems for end-to-end tests, ended whatever happens."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.e2e.system import System


@pytest.fixture
def systems() -> Iterator[Callable[..., System]]:
    """Give a maker of systems; all of them end with the test."""
    made: list[System] = []

    def make(folder: Path, **options: Any) -> System:
        made.append(System(folder, **options))
        return made[-1]

    yield make
    for system in made:
        system.close()
