"""Numbers of the command line, read within bounds; what is no such number is refused with the bounds."""

from __future__ import annotations

import argparse
import math
from functools import partial

__all__ = ["above_zero", "between", "factor", "integer", "seconds", "span", "udp_port"]


def above_zero(text: str, most: float, what: str) -> float:
    """Return a number above 0 and up to `most`.

    Raises:
        ArgumentTypeError: It is no number, or out of bounds.
    """
    value = _number(text)
    if not 0.0 < value <= most:  # NaN compares false
        raise argparse.ArgumentTypeError(f"{text.strip()!r} is not a {what} above 0 and up to {most:g}")
    return value


def between(text: str, least: float, most: float, what: str) -> float:
    """Return a number from `least` to `most`; else as `above_zero`."""
    value = _number(text)
    if not least <= value <= most:  # NaN compares false
        raise argparse.ArgumentTypeError(f"{text.strip()!r} is no {what} from {least:g} to {most:g}")
    return value


def integer(text: str, least: int, most: int, what: str) -> int:
    """Return a whole number from `least` to `most`; else as `above_zero`."""
    try:
        value = int(text)
    except ValueError:
        value = least - 1
    if not least <= value <= most:
        raise argparse.ArgumentTypeError(f"{text.strip()!r} is no {what} from {least} to {most}")
    return value


def span(text: str) -> float:
    """Return a time [s] that was typed as `90s`, `10m`, `1h` or `2d`; else as `above_zero`."""
    scale = {"s": 1.0, "m": 60.0, "h": 3600.0, "d": 86_400.0}.get(text.strip()[-1:], math.nan)
    value_s = _number(text.strip()[:-1]) * scale
    if not 0.0 < value_s <= 31 * 86_400.0:  # NaN compares false
        raise argparse.ArgumentTypeError(f"{text!r} is no time such as 90s, 10m, 1h, 2d, at most 31d")
    return value_s


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return math.nan


factor = partial(above_zero, most=1.0, what="factor")
seconds = partial(above_zero, most=86_400.0, what="time [s]")
udp_port = partial(integer, least=1, most=65_535, what="UDP port")
