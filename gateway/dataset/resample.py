"""Values at the times of a grid, by the rule that a layout names for them; never across a gap. Pure."""

from __future__ import annotations

from typing import Final

import numpy as np
import numpy.typing as npt

from gateway.dataset.layout import Rule
from gateway.dataset.series import Floats, Instants, Series

__all__ = ["Bools", "resample"]

Bools = npt.NDArray[np.bool_]
SAME: Final = 1e-9
"""Below this angle between two quaternions they are one [rad]."""


def resample(series: Series, times_ns: Instants, rule: Rule, stale_ns: int) -> tuple[Floats, Bools]:
    """Return values at the times, and where there are any.

    Args:
        series: At least one sample.
        times_ns: Of the grid, shape (n,).
        rule: See `layout.Rule`; `slerp` takes quaternions xyzw, of any length but 0, and gives unit quaternions
            whose sign does not change from one to the next.
        stale_ns: How far from the time a sample may be; between samples, how far apart these two [ns].

    Returns:
        Values, shape (n, width), 0 where there are none; and for each whether there is one, shape (n,).
    """
    samples, last = series.times_ns, len(series.times_ns) - 1
    before = np.searchsorted(samples, times_ns, side="right") - 1
    after = np.searchsorted(samples, times_ns, side="left")
    earlier, later = np.clip(before, 0, last), np.clip(after, 0, last)
    since = np.where(before >= 0, times_ns - samples[earlier], np.iinfo(np.int64).max)
    until = np.where(after <= last, samples[later] - times_ns, np.iinfo(np.int64).max)
    if rule == "hold":
        values, ok = series.values[earlier], since <= stale_ns
    elif rule == "next":
        values, ok = series.values[later], until <= stale_ns
    elif rule == "nearest":
        is_before = since <= until
        values, ok = series.values[np.where(is_before, earlier, later)], np.minimum(since, until) <= stale_ns
    else:
        span = samples[later] - samples[earlier]
        ok = (before >= 0) & (after <= last) & (span <= stale_ns)
        share = ((times_ns - samples[earlier]) / np.maximum(span, 1))[:, np.newaxis]
        values = (_slerp if rule == "slerp" else _lerp)(series.values[earlier], series.values[later], share)
        ok &= np.isfinite(values).all(axis=1)
    return np.where(ok[:, np.newaxis], values, 0.0), ok


def _lerp(a: Floats, b: Floats, share: Floats) -> Floats:
    return a + (b - a) * share


def _slerp(a: Floats, b: Floats, share: Floats) -> Floats:
    """Return the shorter way between quaternions; NaN where one of them is 0."""
    with np.errstate(invalid="ignore", divide="ignore"):
        a, b = (q / np.linalg.norm(q, axis=1, keepdims=True) for q in (a, b))
        cosine = np.sum(a * b, axis=1, keepdims=True)
        b, cosine = np.where(cosine < 0.0, -b, b), np.clip(np.abs(cosine), 0.0, 1.0)
        angle = np.arccos(cosine)
        sine = np.sin(angle)
        curved = (np.sin((1.0 - share) * angle) * a + np.sin(share * angle) * b) / sine
        mixed = np.where(angle > SAME, curved, a)
        mixed /= np.linalg.norm(mixed, axis=1, keepdims=True)
        turned = np.sum(mixed[1:] * mixed[:-1], axis=1, keepdims=True) < 0.0
    mixed[1:] *= np.cumprod(np.where(turned, -1.0, 1.0), axis=0)
    return np.asarray(mixed)
