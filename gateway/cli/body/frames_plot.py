"""The picture of the frames: each as three short axes, joined to its parent, seen from two sides without perspective."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TypeAlias

import matplotlib as mpl

mpl.use("Agg")  # a file, never a window
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from gateway.kinematics.frames import ROOT, FrameTree
from gateway.kinematics.transform import Transform
from gateway.values import ArmState, Side

__all__ = ["write_picture"]

AXIS_M = 0.05
AXIS_COLOURS = ("tab:red", "tab:green", "tab:blue")
KIND_COLOURS = {
    "nominal": "black",
    "this robot": "tab:green",
    "stand-in": "tab:orange",
    "joints": "tab:cyan",
    "ours": "tab:gray",
}
VIEWS = (("from the front left", 22.0, 35.0), ("from above, ahead is up", 90.0, 180.0))
"""Titles with elevation and azimuth of the eye [deg]."""
NEAR_M = 0.06
"""Frames nearer to each other than this share one label, line by line."""
LINE_PT, BESIDE_PT, GAP_PT = 9.0, 45.0, 6.0
"""Height of a line of a label, from the outermost frame to the labels, and the least gap between two labels [pt]."""
ROOM = np.array((2.1, 1.4))
"""Width and height of a panel, in those of what is drawn in it, at least."""

View: TypeAlias = NDArray[np.float64]
"""Shape (2, 3): what is to the right and what is up on the paper, as unit vectors."""


def write_picture(
    tree: FrameTree, joints: Mapping[Side, ArmState], kinds: Mapping[str, str], source: str, path: Path
) -> None:
    """Draw every frame that the joints place.

    Args:
        tree: The frames.
        joints: Of each arm that is known.
        kinds: What places each frame in its parent, a key of `KIND_COLOURS`.
        source: Where the joints are from, for the title.
        path: Ends with `.png`, `.svg` or `.pdf`; its folder is made.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    known = [frame for frame in tree.frames if set(tree.sides_between(ROOT, frame)) <= set(joints)]
    places = {frame: tree.locate(ROOT, frame, joints).transform for frame in known}
    figure, panels = plt.subplots(1, len(VIEWS), figsize=(15.5, 6.5), dpi=130, layout="constrained")
    views = [_view(elevation_deg, azimuth_deg) for _, elevation_deg, azimuth_deg in VIEWS]
    for panel, view, (title, elevation_deg, _) in zip(panels, views, VIEWS, strict=True):
        _draw_frames(panel, view, tree, places, kinds)
        panel.set_title(title, fontsize=9)
        if elevation_deg == 90.0:
            panel.grid(color="0.92")
            panel.set_axisbelow(True)
            panel.set_xlabel("y [m]")
            panel.set_ylabel("x [m]")
            panel.xaxis.set_major_formatter(lambda right_m, _: f"{0.0 - right_m:.1f}")
        else:
            panel.set_axis_off()
    shown = {kinds[frame] for frame in known if frame != ROOT}
    handles = [mpl.lines.Line2D([], [], color=KIND_COLOURS[kind], linestyle="--", label=kind) for kind in KIND_COLOURS]
    figure.legend(
        handles=[handle for handle in handles if handle.get_label() in shown], loc="outside lower center", ncols=5
    )
    figure.suptitle(
        f"frames in {ROOT} (manual, appendix A): x red, y green, z blue, each {AXIS_M * 1000:.0f} mm\njoints: {source}",
        fontsize=11,
    )
    figure.draw_without_rendering()  # only then is known how large a panel is; what follows changes nothing of that
    figure.set_layout_engine("none")
    for panel, view in zip(panels, views, strict=True):
        _scale(panel)
        _name_frames(panel, view, places, dots_per_pt=figure.dpi / 72.0)
    figure.savefig(path)
    plt.close(figure)


def _view(elevation_deg: float, azimuth_deg: float) -> View:
    """Return how an eye far away sees space; at azimuth 0 it looks from the front, at 90 from the robot's left."""
    e, a = np.radians((elevation_deg, azimuth_deg))
    eye = np.array((np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)))
    right = np.array((-np.sin(a), np.cos(a), 0.0))
    return np.stack((right, np.cross(eye, right)))


def _draw_frames(
    panel: Axes, view: View, tree: FrameTree, places: Mapping[str, Transform], kinds: Mapping[str, str]
) -> None:
    for frame, place in places.items():
        parent = tree.parent(frame)
        if parent is not None:
            line = np.stack((places[parent].p_m, place.p_m), -1)
            panel.plot(*(view @ line), color=KIND_COLOURS[kinds[frame]], linewidth=1.0, linestyle="--")
        for axis, colour in zip(place.rotation.T, AXIS_COLOURS, strict=True):
            panel.plot(*(view @ np.stack((place.p_m, place.p_m + AXIS_M * axis), -1)), color=colour, linewidth=1.8)


def _scale(panel: Axes) -> None:
    """Show all that is drawn with room for its names, a metre as long to the right as up.

    `set_aspect` would do the second at the cost of the first: which limits it moves depends on matplotlib's version.
    """
    low, high = np.array(panel.dataLim.min), np.array(panel.dataLim.max)
    size = np.array((panel.bbox.width, panel.bbox.height))
    middle, half = (low + high) / 2.0, 0.5 * float(np.max(ROOM * (high - low) / size)) * size
    panel.set_xlim(middle[0] - half[0], middle[0] + half[0])
    panel.set_ylim(middle[1] - half[1], middle[1] + half[1])


def _name_frames(panel: Axes, view: View, places: Mapping[str, Transform], *, dots_per_pt: float) -> None:
    """Write the names in a column on either side of what is drawn, each joined to its frames, none over another."""
    groups = _labels(places)
    at = np.array([np.mean([view @ places[name].p_m for name in names], axis=0) for names in groups])
    at_pt = panel.transData.transform(at) / dots_per_pt
    is_left = at[:, 0] < at[:, 0].mean()
    for side, column_pt in ((is_left, at_pt[:, 0].min() - BESIDE_PT), (~is_left, at_pt[:, 0].max() + BESIDE_PT)):
        lowest_pt = np.inf
        for number in sorted(np.flatnonzero(side), key=lambda number: -float(at_pt[number, 1])):
            height_pt = LINE_PT * len(groups[number])
            centre_pt = min(float(at_pt[number, 1]), lowest_pt - GAP_PT - 0.5 * height_pt)
            lowest_pt = centre_pt - 0.5 * height_pt
            panel.annotate(
                "\n".join(groups[number]),
                tuple(at[number]),
                xytext=(column_pt - at_pt[number, 0], centre_pt - at_pt[number, 1]),
                textcoords="offset points",
                ha="right" if side is is_left else "left",
                va="center",
                fontsize=7,
                arrowprops={"arrowstyle": "-", "color": "0.6", "linewidth": 0.6},
            ).set_in_layout(False)


def _labels(places: Mapping[str, Transform]) -> list[list[str]]:
    """Return names by place: frames that lie on each other are named together."""
    groups: list[list[str]] = []
    for name, place in places.items():
        for group in groups:
            if np.linalg.norm(places[group[0]].p_m - place.p_m) < NEAR_M:
                group.append(name)
                break
        else:
            groups.append([name])
    return groups
