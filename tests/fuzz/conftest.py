"""The interpreter as it was, whatever a test did to its garbage collection."""

from __future__ import annotations

import gc
from collections.abc import Iterator

import pytest


@pytest.fixture(autouse=True)
def collecting() -> Iterator[None]:
    """Switch garbage collection on again after a test that did without, as the daemon does."""
    yield
    gc.enable()
