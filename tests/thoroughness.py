"""How much of what is random or long a run tries: enough by hand and in CI, much more before a release.

The rules that are judged are the same in every run; only how many examples, payloads, traces or virtual hours they are
judged on differs, and CI runs every test. `TA2_HYPOTHESIS_PROFILE` chooses; `tests/conftest.py` gives the same name to
hypothesis.
"""

from __future__ import annotations

import os
from collections.abc import Iterable
from itertools import product
from typing import TypeVar

__all__ = ["IS_RELEASE", "IS_THOROUGH", "PROFILE", "crossed", "either", "traces"]

PROFILE = os.environ.get("TA2_HYPOTHESIS_PROFILE") or "dev"
IS_THOROUGH = PROFILE in ("ci", "long")
"""Whether every test runs, those that take long to prove a little more as well."""
IS_RELEASE = PROFILE == "long"
"""Whether each test tries all that it can."""

T = TypeVar("T")
U = TypeVar("U")


def either(usual: T, release: T) -> T:
    """Return the amount of a usual run, CI's among them, or that of a run before a release."""
    return release if IS_RELEASE else usual


def crossed(rows: Iterable[T], columns: Iterable[U]) -> list[tuple[T, U]]:
    """Return every pair before a release, else a diagonal: every row and every column is in one of its pairs.

    For a rule that is the same in every cell; where each cell has its own rule all of them are tried in every run.
    """
    every_row, every_column = list(rows), list(columns)
    if IS_RELEASE:
        return list(product(every_row, every_column))
    count = max(len(every_row), len(every_column))
    return [(every_row[n % len(every_row)], every_column[n % len(every_column)]) for n in range(count)]


def traces(usual: int) -> int:
    """Return how many random traces the invariants are judged on; `TA2_TRACES` names another number.

    Args:
        usual: In a run by hand; 50 in CI, the same each time, as many as the profile's examples before a release.
    """
    return int(os.environ.get("TA2_TRACES") or {"ci": 50, "long": 20_000}.get(PROFILE, usual))
