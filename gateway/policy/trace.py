"""What a policy told the arms beside where they were and what somebody commanded: rows in time, and how far they differ."""

from __future__ import annotations

from collections import deque

import numpy as np
from numpy.typing import NDArray

from gateway.client import RobotState
from gateway.policy.chunks import Chunk

__all__ = ["KINDS", "SIDES", "Trace"]

SIDES, KINDS = ("left", "right"), ("told", "measured", "commanded")
STALE_S, MOST_ROWS = 0.1, 200_000
"""Rows of two hours at 30 a second; newer ones push out the oldest."""


class Trace:
    """Rows of joints in time. `look` adds one; `boundaries_ns` are when another chunk began to play."""

    def __init__(self) -> None:
        self._rows: deque[tuple[int, NDArray[np.float64]]] = deque(maxlen=MOST_ROWS)
        self._chunk: Chunk | None = None
        self.boundaries_ns: deque[int] = deque(maxlen=MOST_ROWS)

    def look(self, chunk: Chunk | None, state: RobotState, now_ns: int) -> None:
        """Add a row, unless the arms were not measured anew; `chunk` is what plays, or would, and None for none."""
        age_s = max(state.arm(side).age for side in SIDES)
        at_ns = now_ns - round(1e9 * min(age_s, STALE_S))
        if chunk is not None and chunk is not self._chunk:
            self._chunk = chunk
            self.boundaries_ns.append(now_ns)
        if age_s > STALE_S or (self._rows and at_ns - self._rows[-1][0] < 1_000_000):
            return
        row = np.full((len(SIDES), len(KINDS), 7), np.nan)
        for part, side in zip(row, SIDES, strict=True):
            if chunk is not None and side in chunk.arms:
                part[0] = chunk.at(at_ns, side)
            part[1] = state.arm(side).q
            if len(commanded := state.arm(side).q_ref):
                part[2] = commanded
        self._rows.append((at_ns, row))

    def table(self) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """Return times [ns], shape (N,), and joints [rad], shape (N, 2, 3, 7), by `SIDES` and `KINDS`; NaN for none."""
        joints = np.array([row for _, row in self._rows]).reshape(-1, len(SIDES), len(KINDS), 7)
        return np.array([at_ns for at_ns, _ in self._rows], np.int64), joints

    def differences(self) -> dict[str, dict[str, dict[str, float]]]:
        """Return per arm how far what was told is from what was measured and commanded: RMS and worst [rad], of rows."""
        found: dict[str, dict[str, dict[str, float]]] = {}
        for side, joints in zip(SIDES, self.table()[1].swapaxes(0, 1), strict=True):
            for what, away in (("measured", joints[:, 0] - joints[:, 1]), ("commanded", joints[:, 0] - joints[:, 2])):
                if len(rows := away[np.isfinite(away).all(axis=1)]):
                    rms_rad, worst_rad = float(np.sqrt(np.mean(rows**2))), float(np.abs(rows).max())
                    told = {"rms_rad": round(rms_rad, 5), "worst_rad": round(worst_rad, 5), "rows": len(rows)}
                    found.setdefault(side, {})[what] = told
        return found
