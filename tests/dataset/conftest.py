"""Fixtures of the tests of datasets: a small layout, and bags with few small pictures."""

from __future__ import annotations

import pytest

from gateway.dataset.layout import load
from tests.dataset.motion import OWN, filmed


@pytest.fixture(scope="session")
def layout(tmp_path_factory):
    """Return a small layout: three joints, and what they were told."""
    path = tmp_path_factory.mktemp("layout") / "own.toml"
    path.write_text(OWN)
    return load(path)


@pytest.fixture(scope="session")
def filmed_bags(tmp_path_factory):
    """Return two short bags with pictures, of two tasks."""
    folder = tmp_path_factory.mktemp("filmed")
    return [filmed(folder, name, count=40, seconds=0.9, facts={"task": name}) for name in ("wave", "bow")]
