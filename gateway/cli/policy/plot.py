"""The picture of a policy that was played, judged or compared: each joint as it was told beside where it was."""

from __future__ import annotations

from pathlib import Path

import matplotlib as mpl

mpl.use("Agg")  # a file, never a window
import matplotlib.pyplot as plt

from gateway.policy.trace import KINDS, SIDES, Trace

__all__ = ["write_plot"]

STYLES = (("tab:orange", "-"), ("tab:blue", "-"), ("tab:green", ":"))


def write_plot(trace: Trace, path: Path) -> None:
    """Draw seven joints of both arms over time to `.png` or `.svg`, with a line where another chunk began to play.

    Raises:
        OSError: It cannot be written.
    """
    at_ns, joints = trace.table()
    begin_ns = at_ns[0] if len(at_ns) else 0
    figure, panels = plt.subplots(7, 2, figsize=(14, 14), dpi=100, sharex=True, layout="constrained")
    for place, side in enumerate(SIDES):
        for joint, panel in enumerate(panels[:, place]):
            for boundary_ns in trace.boundaries_ns:
                panel.axvline((boundary_ns - begin_ns) / 1e9, color="0.85", linewidth=0.8)
            for number, (what, (colour, style)) in enumerate(zip(KINDS, STYLES, strict=True)):
                q_rad = joints[:, place, number, joint]
                panel.plot((at_ns - begin_ns) / 1e9, q_rad, style, color=colour, linewidth=1.0, label=what)
            panel.set_ylabel(f"{side} {joint + 1} [rad]", fontsize=8)
        panel.set_xlabel("time [s]; grey: another chunk begins", fontsize=8)
    panels[0, 0].legend(fontsize=7, loc="upper right")
    figure.savefig(path)
    plt.close(figure)
