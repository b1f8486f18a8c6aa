"""What a user says, as requests of the protocol: shapes, numbers and limits checked before anything is sent.

Pure. Every refusal has the code, field, value and bound that the daemon would give: the same mistake is the same
exception on either side. numpy is loaded with the first vector: whoever only wants to stop the robot does not wait for it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from enum import Enum
from typing import TYPE_CHECKING, SupportsFloat, SupportsIndex, TypeVar

from gateway.api import protocol
from gateway.errors import Code, failure

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import ArrayLike, NDArray

__all__ = [
    "SIDES",
    "chosen",
    "joints",
    "move",
    "number",
    "numeric",
    "read_only",
    "require_sides",
    "require_word",
    "row",
    "seconds",
    "within_limits",
]

SIDES = tuple(protocol.Side)

_Choice = TypeVar("_Choice", bound=Enum)


def read_only(values: tuple[float, ...]) -> NDArray[np.float64]:
    """Return a vector that its reader cannot change by mistake."""
    import numpy as np

    array = np.array(values, dtype=np.float64)
    array.setflags(write=False)
    return array


def number(name: str, value: object) -> float:
    """Return a number that a user gave. Neither text nor a truth value is one, whatever `float` makes of it.

    `grip(True)` would close with all there is, and `"0.5"` is a mistake somewhere else: the daemon takes neither.

    Args:
        name: What it is called, for the message.
        value: Anything; what is not finite is judged by others.

    Raises:
        Rejected: BAD_REQUEST.
    """
    is_word = isinstance(value, (bool, str, bytes, bytearray)) or _kind(value) in _WORDS
    try:
        if isinstance(value, (SupportsFloat, SupportsIndex)) and not is_word:
            return float(value)
        said = f"is {value!r}"
    except (TypeError, ValueError, OverflowError) as error:
        said = f"is none ({error})"
    raise failure(
        Code.BAD_REQUEST,
        f"{name} {said}, a number is needed",
        field=name,
        value=repr(value)[:40],
        bound="a number",
        hint="give a number",
    )


def numeric(values: ArrayLike) -> NDArray[np.float64]:
    """Return numbers that a user gave, in whatever shape, under the rule of `number`.

    Raises:
        TypeError: Texts, truth values or other things are among them; so do ValueError and OverflowError say.
    """
    import numpy as np

    given = np.asarray(values)
    is_mixed = given.dtype.kind == "O" and any(isinstance(value, (bool, str, bytes)) for value in given.flat)
    if given.dtype.kind in _WORDS or is_mixed:
        raise TypeError(f"its values are {'texts or truth values among others' if is_mixed else given.dtype}")
    return given.astype(np.float64)


_WORDS = frozenset("bcSU")
"""What numpy calls truth values, complex numbers, bytes and text."""


def _kind(value: object) -> str:
    """Return the kind of a numpy value, without numpy; empty for anything else."""
    return str(getattr(getattr(value, "dtype", None), "kind", ""))


def require_word(name: str, value: str, words: Sequence[str], hint: str = "") -> None:
    """Refuse a word that means nothing, before anything is asked.

    Raises:
        Rejected: BAD_REQUEST, with the words that there are.
    """
    if value not in words:
        known = ", ".join(words)
        message = f"{name} is {value!r}, one of {known} is needed"
        raise failure(Code.BAD_REQUEST, message, field=name, value=str(value), bound=known, hint=hint)


def chosen(choices: type[_Choice], name: str, value: str) -> _Choice:
    """Return one of the words that a parameter may be, as the protocol has it; or refuse it as `require_word` does."""
    require_word(name, value, [choice.value for choice in choices])
    return choices(value)


def row(called: str, given: ArrayLike, count: int, field: str, of: str, unit: str = "") -> tuple[float, ...]:
    """Return so many finite numbers.

    Args:
        called: What a refusal calls them.
        given: Anything that numpy takes as shape (count,), in `unit`.
        count: How many there must be.
        field: Of the request.
        of: What they are, in their order.
        unit: Empty for plain numbers.

    Raises:
        Rejected: WRONG_SHAPE or NOT_FINITE.
    """
    try:
        array = numeric(given)
    except (TypeError, ValueError, OverflowError) as error:
        wrong, shown = f"is no vector of numbers ({error})", type(given).__name__
    else:
        wrong, shown = ("", "") if array.shape == (count,) else (f"has shape {array.shape}", str(array.shape))
    if wrong:
        message = f"{called} {wrong}, {count} values are needed: {of}"
        raise failure(Code.WRONG_SHAPE, message, field=field, value=shown, bound=f"({count},)")
    values = tuple(array.tolist())
    for n, value in enumerate(values):
        if not math.isfinite(value):
            message = f"value {n + 1} of {called} is {value}, a finite number is needed"
            raise failure(Code.NOT_FINITE, message, field=f"{field}[{n}]", value=str(value), unit=unit)
    return values


def joints(side: str, q_rad: ArrayLike) -> tuple[float, ...]:
    """Return seven finite joint values.

    Args:
        side: `left` or `right`.
        q_rad: Anything that numpy takes as shape (7,) [rad], in the order of manual §4.0.3.

    Raises:
        Rejected: WRONG_SHAPE or NOT_FINITE.
    """
    return row(f"the {side} arm's goal", q_rad, protocol.ARM_DOF, f"{side}_arm", "its joints (manual §4.0.3)", "rad")


def within_limits(
    side: str, q_rad: tuple[float, ...], info: protocol.Info, on_limit: protocol.OnLimitName
) -> tuple[float, ...]:
    """Return joint values inside the configured limits: as they are, or clipped when that was asked for.

    Args:
        side: `left` or `right`.
        q_rad: Seven finite values [rad].
        info: Of the daemon, with its limits.
        on_limit: `reject` or `clip`.

    Raises:
        Rejected: OUT_OF_RANGE, with joint, value and bound.
    """
    lower, upper = info.lower_rad[side], info.upper_rad[side]
    if on_limit == "clip":
        return tuple(min(max(q, low), high) for q, low, high in zip(q_rad, lower, upper, strict=True))
    for index, (q, low, high) in enumerate(zip(q_rad, lower, upper, strict=True)):
        if not low <= q <= high:
            raise failure(
                Code.OUT_OF_RANGE,
                f"{side} arm joint {index + 1} ({info.joint_names[side][index]}): {q:.4f} rad is outside "
                f"[{low:.2f}, {high:.2f}] rad (manual §4.13 or tighter configuration)",
                field=f"{side}_arm[{index}]",
                value=f"{q:.6g}",
                bound=f"[{low}, {high}]",
                unit="rad",
            )
    return q_rad


def require_sides(field: str, targets: Mapping[str, object]) -> None:
    """Refuse what names no arm, or one that there is not; raise Rejected, WRONG_SHAPE."""
    unknown = [str(side) for side in targets if side not in SIDES]
    if unknown or not targets:
        raise failure(
            Code.WRONG_SHAPE,
            f"a motion of {unknown or 'no arm'} was asked for, 'left' and 'right' exist",
            field=field,
            value=", ".join(unknown),
            bound="left, right",
            hint="name left, right or both",
        )


def move(
    epoch: int,
    targets_rad: Mapping[str, ArrayLike],
    *,
    relative: bool,
    speed: float,
    tolerance_rad: float | None,
    on_limit: protocol.OnLimitName,
    until: protocol.Until | None = None,
) -> protocol.Move:
    """Return the request for a motion of one or both arms.

    Raises:
        Rejected: WRONG_SHAPE (no arm, an unknown one, not seven values) or NOT_FINITE.
    """
    require_sides("targets_rad", targets_rad)
    return protocol.Move(
        epoch=epoch,
        targets_rad={side: joints(side, targets_rad[side]) for side in SIDES if side in targets_rad},
        relative=relative,
        speed=number("speed", speed),
        tolerance_rad=None if tolerance_rad is None else number("tolerance", tolerance_rad),
        on_limit=chosen(protocol.OnLimit, "on_limit", on_limit),
        until=until,
    )


def seconds(name: str, value_s: float, *, most: float = 86_400.0) -> int:
    """Return a time that a user gave in seconds, in nanoseconds.

    Raises:
        Rejected: NOT_FINITE or OUT_OF_RANGE: no wait is endless.
    """
    value = number(name, value_s)
    if not (math.isfinite(value) and 0.0 <= value <= most):
        raise failure(
            Code.OUT_OF_RANGE if math.isfinite(value) else Code.NOT_FINITE,
            f"{name} is {value:g} s, a time in [0, {most:g}] s is needed",
            field=name,
            value=f"{value:g}",
            bound=f"[0, {most:g}]",
            unit="s",
            hint="stay inside the bound",
        )
    return int(value * 1e9)
