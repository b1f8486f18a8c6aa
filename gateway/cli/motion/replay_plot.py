"""The picture of a replay: each joint as it was measured beside the recorded one, and how far they are apart."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import matplotlib as mpl

mpl.use("Agg")  # a file, never a window
import matplotlib.pyplot as plt
import numpy as np
from numpy.typing import NDArray

__all__ = ["write_plot"]

LEAST_RAD = 0.1  # of a panel's height: a joint that stands still shall look like one


def write_plot(rows: Mapping[str, NDArray[np.float64]], path: Path) -> None:
    """Draw a column per arm, a panel per joint, and write it.

    Args:
        rows: Per side, shape (N, 15): time since the first point [s], seven joints measured now, and then [rad].
        path: `.png`, `.svg` or `.pdf`, in a folder that is there.
    """
    size = (1.0 + 5.0 * len(rows), 11.0)
    figure, panels = plt.subplots(7, len(rows), figsize=size, sharex=True, squeeze=False, layout="constrained")
    for column, (side, table) in zip(panels.T, rows.items(), strict=True):
        times_s, now, then = table[:, 0], table[:, 1:8], table[:, 8:]
        for joint, panel in enumerate(column):
            off = now[:, joint] - then[:, joint]
            panel.plot(times_s, then[:, joint], color="0.65", linewidth=3.0, label="recorded")
            panel.plot(times_s, now[:, joint], color="tab:blue", linewidth=1.0, label="measured now")
            rms = f"RMS {1e3 * np.sqrt(np.nanmean(off**2)):.1f} mrad" if np.isfinite(off).any() else "not recorded"
            middle, height = panel.viewLim.intervaly.mean(), panel.viewLim.height
            panel.set_ylim(middle - max(height, LEAST_RAD) / 2.0, middle + max(height, LEAST_RAD) / 2.0)
            panel.set_title(f"{side} joint {joint + 1}: {rms}", loc="left", fontsize=9)
            panel.set_ylabel("[rad]", fontsize=8)
            panel.tick_params(labelsize=8)
            panel.yaxis.get_major_formatter().set_useOffset(False)
            panel.grid(alpha=0.3)
        column[-1].set_xlabel("time since the first point [s]", fontsize=8)
    figure.legend(
        *panels[0, 0].get_legend_handles_labels(), loc="outside upper right", ncols=2, fontsize=9, frameon=False
    )
    figure.align_ylabels()
    figure.savefig(path, dpi=110)
    plt.close(figure)
