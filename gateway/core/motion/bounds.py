"""One way to refuse a number for its size, and what is no row of numbers, for the whole core: value, bound, unit and remedy."""

from __future__ import annotations

import math

from gateway.errors import Code, Refusal

__all__ = ["no_arm", "not_finite", "outside", "within", "wrong_count"]

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


def not_finite(called: str, value: float, field: str, bound: str = "", unit: str = "") -> Refusal:
    """Return the refusal of a number that is none, NOT_FINITE, with the bound that it would have had."""
    return Refusal(
        code=Code.NOT_FINITE,
        message=f"{called} is {value}, a finite number is needed",
        field=field,
        value=str(value),
        bound=bound,
        unit=unit,
    )


def wrong_count(called: str, count: int, needed: int, field: str, of: str) -> Refusal:
    """Return the refusal of a row that is too long or too short, WRONG_SHAPE; `of` says what the numbers are."""
    message = f"{called} has {count} values, {needed} are needed: {of}"
    return Refusal(
        code=Code.WRONG_SHAPE, message=message, field=field, value=str(count), bound=str(needed), unit="values"
    )


def no_arm(field: str) -> Refusal:
    """Return the refusal of a request that names neither arm, WRONG_SHAPE."""
    message = "no arm is named: left, right or both are needed"
    hint = "name left, right or both"
    return Refusal(
        code=Code.WRONG_SHAPE, message=message, field=field, value="0", bound="[1, 2]", unit="arms", hint=hint
    )
