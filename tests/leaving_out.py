"""What becomes of a test that lacks something of this machine: left out by hand, failed where that must be there."""

from __future__ import annotations

import os
from typing import NoReturn

import pytest

__all__ = ["is_required", "leave_out"]


def is_required(variable: str) -> bool:
    """Return whether tests that lack something must fail instead of being left out.

    Args:
        variable: The environment's that says so, such as `TA2_INTEROP`: `required`. `.ci/run` sets it for what it installs.
    """
    return os.environ.get(variable) == "required"


def leave_out(what: str, variable: str, *, module: bool = False) -> NoReturn:
    """Skip the test, or fail it where skipping is not allowed.

    Args:
        what: Is missing, and how to get it, in one line.
        variable: See `is_required`.
        module: Whether this is called while the module is imported, for all its tests.
    """
    if is_required(variable):
        pytest.fail(what, pytrace=False)
    pytest.skip(what, allow_module_level=module)  # the reason is what is missing; CI, which installs it, fails above
