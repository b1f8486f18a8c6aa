"""The demo's picture: commanded and measured joints of both arms over time."""

from __future__ import annotations

from pathlib import Path

import matplotlib as mpl

mpl.use("Agg")  # a file, never a window
import matplotlib.pyplot as plt
import numpy as np

from gateway.client import RobotState

__all__ = ["Recording", "write_plot"]

SIDES = ("left", "right")


class Recording:
    """Commanded and measured joints, one row per snapshot."""

    def __init__(self) -> None:
        self.times_s: list[float] = []
        self.commanded: dict[str, list[tuple[float, ...]]] = {side: [] for side in SIDES}
        self.measured: dict[str, list[tuple[float, ...]]] = {side: [] for side in SIDES}

    def add(self, state: RobotState) -> None:
        """Take a snapshot in; one in which an arm has no setpoint or was not measured is left out."""
        arms = {side: state.view.arms[side] for side in SIDES}
        if any(arm.measured is None or not arm.q_ref_rad for arm in arms.values()):
            return
        self.times_s.append(state.view.at_ns / 1e9)
        for side, arm in arms.items():
            self.commanded[side].append(arm.q_ref_rad)
            if arm.measured is not None:
                self.measured[side].append(arm.measured.q_rad)


def write_plot(recording: Recording, path: Path) -> None:
    """Draw both arms, one colour per joint: setpoints thin and dashed over the measured line.

    Args:
        recording: At least one row.
        path: `.png` or `.svg`, in a folder that is there.
    """
    times_s = np.array(recording.times_s) - recording.times_s[0]
    figure, panels = plt.subplots(3, 1, figsize=(11, 9), sharex=True, height_ratios=(3, 3, 1.4), layout="constrained")
    colours = plt.get_cmap("tab10").colors  # type: ignore[attr-defined]  # a listed colour map has them
    for panel, side in zip(panels, SIDES, strict=False):
        commanded, measured = np.array(recording.commanded[side]), np.array(recording.measured[side])
        for joint in range(commanded.shape[1]):
            panel.plot(times_s, measured[:, joint], color=colours[joint], linewidth=1.8, label=f"joint {joint + 1}")
            panel.plot(times_s, commanded[:, joint], color="black", linewidth=0.7, linestyle=(0, (4, 3)))
        panel.set_title(f"{side} arm: measured (colour) and commanded (dashed)", loc="left", fontsize=10)
        panel.set_ylabel("position [rad]")
        panel.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), fontsize=8, frameon=False)
        panels[2].plot(times_s, 1e3 * np.max(np.abs(commanded - measured), axis=1), linewidth=1.0, label=f"{side} arm")
    panels[2].set_title("distance between commanded and measured, worst joint", loc="left", fontsize=10)
    panels[2].set_ylabel("[mrad]")
    panels[2].set_xlabel("time [s]")
    panels[2].legend(loc="center left", bbox_to_anchor=(1.0, 0.5), fontsize=8, frameon=False)
    for panel in panels:
        panel.grid(alpha=0.3)
    figure.savefig(path, dpi=110)
    plt.close(figure)
