"""How much of what is random or long a run tries: a little by hand, everything that the requirements name in CI.

The rules that are judged are the same in every run; only how many examples, payloads, traces or virtual hours they are
judged on differs. `TA2_HYPOTHESIS_PROFILE` chooses; `tests/conftest.py` gives the same name to hypothesis.
"""

from __future__ import annotations

import os
from collections.abc import Iterable
from itertools import product
from typing import TypeVar

__all__ = ["IS_THOROUGH", "PROFILE", "crossed", "either", "traces"]

PROFILE = os.environ.get("TA2_HYPOTHESIS_PROFILE") or "dev"
IS_THOROUGH = PROFILE in ("ci", "long")

T = TypeVar("T")
U = TypeVar("U")


def either(usual: T, thorough: T, release: T | None = None) -> T:
    """Return the amount of a usual run, that of CI, or that of a run before a release where it is another."""
    if PROFILE == "long" and release is not None:
        return release
    return thorough if IS_THOROUGH else usual


def crossed(rows: Iterable[T], columns: Iterable[U]) -> list[tuple[T, U]]:
    """Return every pair in CI, else a diagonal: every row and every column is in one of its pairs.

    For a rule that is the same in every cell; where each cell has its own rule all of them are tried in every run.
    """
    every_row, every_column = list(rows), list(columns)
    if IS_THOROUGH:
        return list(product(every_row, every_column))
    count = max(len(every_row), len(every_column))
    return [(every_row[n % len(every_row)], every_column[n % len(every_column)]) for n in range(count)]


def traces(usual: int) -> int:
    """Return how many random traces the invariants are judged on; `TA2_TRACES` names another number.

    Args:
        usual: In a run by hand; 100 in CI, the same each time, as many as the profile's examples before a release.
    """
    return int(os.environ.get("TA2_TRACES") or {"ci": 100, "long": 20_000}.get(PROFILE, usual))
