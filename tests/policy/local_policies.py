"""Policies in Python for tests, as `ta2 policy run --local` runs them; the prompt names a file for the process's id."""

from __future__ import annotations

import os
import time
from pathlib import Path
from typing import Any

import numpy as np

__all__ = ["dies", "fails", "hangs", "still"]

GRIPPERS_OFF_NM = 0.0
_rows: list[np.ndarray[Any, Any]] = []


def still(observation: dict[str, Any]) -> np.ndarray[Any, Any]:
    """Keep the arms where they were first seen, for a second."""
    state = observation["observation/state"]
    _rows.append(np.array([*state[0:7], GRIPPERS_OFF_NM, *state[8:15], GRIPPERS_OFF_NM], np.float32))
    return np.tile(_rows[0], (30, 1))


def hangs(observation: dict[str, Any]) -> np.ndarray[Any, Any]:
    """Answer twice, then never again."""
    if len(_rows) == 2:
        _tell_id(observation)
        while True:
            time.sleep(3600.0)
    return still(observation)


def dies(observation: dict[str, Any]) -> np.ndarray[Any, Any]:
    """Answer twice, then die."""
    if len(_rows) == 2:
        os._exit(3)
    return still(observation)


def fails(observation: dict[str, Any]) -> np.ndarray[Any, Any]:
    """Answer twice, then raise."""
    if len(_rows) == 2:
        raise ValueError("no such towel")
    return still(observation)


def _tell_id(observation: dict[str, Any]) -> None:
    told = Path(observation["prompt"])
    told.with_suffix(".new").write_text(str(os.getpid()))
    told.with_suffix(".new").rename(told)
