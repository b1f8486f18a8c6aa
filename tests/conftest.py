"""Rules for every test: how many examples property tests try, which tests come last, and how long one may take.

Knows nothing of the packages under test; fixtures live beside the tests that use them.
"""

from __future__ import annotations

import os

import pytest
from hypothesis import HealthCheck, settings

# No deadline for one example: it would measure the machine, not the code.
_COMMON = settings(deadline=None, suppress_health_check=[HealthCheck.too_slow])

settings.register_profile("dev", parent=_COMMON, max_examples=50)
# The same examples in every run: a red run can be repeated, and a green one stays green.
settings.register_profile("ci", parent=_COMMON, max_examples=300, derandomize=True, print_blob=True)
# By hand, before a release.
settings.register_profile("long", parent=_COMMON, max_examples=20_000, print_blob=True)
# For coverage by mirror: few and fixed, since coverage must not hang on luck.
settings.register_profile("mirror", parent=_COMMON, max_examples=10, derandomize=True)

PROFILE = os.environ.get("TA2_HYPOTHESIS_PROFILE") or ("ci" if os.environ.get("CI") == "true" else "dev")
settings.load_profile(PROFILE)

E2E_TIMEOUT_S = 180
SLOW_TIMEOUT_S = 600


def pytest_report_header() -> str:
    """Name the profile, so that a report tells how much was tried."""
    return f"hypothesis profile of this run: {PROFILE} ({settings().max_examples} examples)"


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Put end-to-end tests last and slow ones before them; give both the time they need."""
    items.sort(key=_cost)  # stable: the order inside each group stays
    for item in items:
        if PROFILE == "long":
            item.add_marker(pytest.mark.timeout(0))
        elif item.get_closest_marker("timeout") is None and _cost(item):
            item.add_marker(pytest.mark.timeout(E2E_TIMEOUT_S if _cost(item) == 2 else SLOW_TIMEOUT_S))


def _cost(item: pytest.Item) -> int:
    if item.get_closest_marker("e2e") is not None:
        return 2
    return 1 if item.get_closest_marker("slow") is not None else 0
