"""One way to refuse a number for its size, for the whole core: what it is, its value, bound, unit and remedy."""

from __future__ import annotations

import math

from gateway.errors import Code, Refusal

__all__ = ["outside", "within"]

STAY = "stay inside the bound"


def within(
    called: str, value: float, low: float, high: float, unit: str = "", *, field: str = "", hint: str = STAY
) -> Refusal | None:
    """Refuse a number that is none, or outside [low, high]; see `outside`."""
    return None if low <= value <= high else outside(called, value, low, high, unit, field=field, hint=hint)


def outside(
    called: str, value: float, low: float, high: float, unit: str = "", *, field: str = "", hint: str = STAY
) -> Refusal:
    """Return the refusal of a number: OUT_OF_RANGE, or NOT_FINITE.

    Args:
        called: What the sentence calls it.
        value: The number, in `unit`.
        low: Least value, in `unit`.
        high: Greatest value, in `unit`.
        unit: Empty for a plain number.
        field: Of the request; `called` where that is its name.
        hint: Remedy.
    """
    tail = unit and f" {unit}"
    bound = f"[{low:.6g}, {high:.6g}]"
    return Refusal(
        code=Code.OUT_OF_RANGE if math.isfinite(value) else Code.NOT_FINITE,
        message=f"{called} is {value}{tail}, outside {bound}{tail}",
        field=field or called,
        value=str(value),
        bound=bound,
        unit=unit,
        hint=hint,
    )
