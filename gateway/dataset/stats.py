"""Statistics of a dataset's columns, as LeRobot keeps them: of each episode, and of all together. Pure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np
import numpy.typing as npt

from gateway.dataset.series import Floats

__all__ = ["QUANTILES", "Stats", "merged", "of_table", "quantiles"]

Stats = dict[str, Floats]
"""`min`, `max`, `mean`, `std` of each dimension, shape (dimensions,), and `count`, shape (1,)."""
QUANTILES: Final = {"q01": 0.01, "q10": 0.10, "q50": 0.50, "q90": 0.90, "q99": 0.99}


def of_table(table: npt.NDArray[np.generic]) -> Stats:
    """Return the statistics of a column's rows, shape (n, dimensions) or (n,); n is at least 1."""
    rows = np.asarray(table, dtype=np.float64).reshape(len(table), -1)
    return {
        "min": rows.min(axis=0),
        "max": rows.max(axis=0),
        "mean": rows.mean(axis=0),
        "std": rows.std(axis=0),
        "count": np.array([float(len(rows))]),
    }


def quantiles(tables: Sequence[npt.NDArray[np.generic]]) -> Stats:
    """Return the quantiles of a column over all its tables: the true ones, not a mean of each episode's."""
    rows = np.concatenate([np.asarray(table, dtype=np.float32).reshape(len(table), -1) for table in tables])
    found = np.quantile(rows, list(QUANTILES.values()), axis=0)
    return dict(zip(QUANTILES, found.astype(np.float64), strict=True))


def merged(parts: Sequence[Mapping[str, Floats]]) -> Stats:
    """Return the statistics of all rows from those of each part; one that holds more (quantiles) loses it."""
    counts = np.array([part["count"][0] for part in parts])
    shares = (counts / counts.sum())[:, np.newaxis]
    means = np.stack([part["mean"] for part in parts]).reshape(len(parts), -1)
    deviations = np.stack([part["std"] for part in parts]).reshape(len(parts), -1)
    mean = np.sum(shares * means, axis=0)
    variance = np.sum(shares * (deviations**2 + (means - mean) ** 2), axis=0)
    return {
        "min": np.min(np.stack([part["min"] for part in parts]), axis=0),
        "max": np.max(np.stack([part["max"] for part in parts]), axis=0),
        "mean": mean.reshape(parts[0]["mean"].shape),
        "std": np.sqrt(variance).reshape(parts[0]["std"].shape),
        "count": np.array([counts.sum()]),
    }
