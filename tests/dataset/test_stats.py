"""Tests of statistics: parts put together are the whole."""

from __future__ import annotations

import numpy as np
import pytest

from gateway.dataset.stats import QUANTILES, merged, of_table, quantiles


def test_statistics_of_parts_put_together_are_those_of_the_whole():
    """However long the parts are."""
    random = np.random.default_rng(1)
    parts = [random.normal(5.0 * n, 1.0 + n, (size, 3)).astype(np.float32) for n, size in enumerate((1, 40, 300))]
    whole, found = of_table(np.concatenate(parts)), merged([of_table(part) for part in parts])
    assert set(whole) == set(found) == {"min", "max", "mean", "std", "count"}
    for name, values in whole.items():
        assert found[name] == pytest.approx(values), name


def test_numbers_have_statistics_of_one_dimension():
    """As LeRobot writes them."""
    found = of_table(np.arange(5))
    assert {name: values.tolist() for name, values in found.items()} == {
        "min": [0.0], "max": [4.0], "mean": [2.0], "std": [pytest.approx(np.sqrt(2.0))], "count": [5.0],
    }  # fmt: skip


def test_quantiles_are_of_all_rows_and_no_mean_of_each_episodes():
    """Of a long quiet episode and a short one elsewhere, the ninth tenth is quiet."""
    found = quantiles([np.zeros((95, 1)), np.full((5, 1), 100.0)])
    assert set(found) == set(QUANTILES)
    assert found["q90"].tolist() == [0.0] and found["q99"].tolist() == [100.0]
