"""A value with other fields, whether it is a struct or a dataclass, as `copy.replace` of Python 3.13 has it."""

from __future__ import annotations

import dataclasses
from typing import TypeVar

from msgspec import Struct, structs

__all__ = ["replace"]

T = TypeVar("T")


def replace(value: T, /, **changes: object) -> T:
    """Return a copy in which some fields are others."""
    if isinstance(value, Struct):
        return structs.replace(value, **changes)
    return dataclasses.replace(value, **changes)  # type: ignore[type-var]  # whatever it is, it says if it has no fields
