"""Rerun where it is, and what is in a file of it; tests that need it are left out elsewhere."""

from __future__ import annotations

import warnings
from collections import defaultdict

import pytest

__all__ = ["read", "rr"]

with warnings.catch_warnings():
    warnings.simplefilter("ignore", DeprecationWarning)  # on Python 3.10, of that Python's end
    rr = pytest.importorskip("rerun", exc_type=ImportError)
    from rerun.experimental import RrdReader


def read(path):
    """Return per entity, without the leading slash, and component what was logged, in the order of time."""
    found = defaultdict(lambda: defaultdict(list))
    for chunk in RrdReader(path).stream():
        batch = chunk.to_record_batch()
        for name, column in zip(batch.schema.names, batch.columns, strict=True):
            if ":" in name:
                found[chunk.entity_path.lstrip("/")][name.rpartition(":")[2]] += column.to_pylist()
    return found
