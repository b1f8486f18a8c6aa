"""The picture of the frames: each as three short axes, joined to its parent, seen from two sides."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import matplotlib as mpl

mpl.use("Agg")  # a file, never a window
import matplotlib.pyplot as plt
import numpy as np

from gateway.apps.frames import Posture, kind_of
from gateway.kinematics.frames import ROOT, FrameTree
from gateway.kinematics.transform import Transform

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
"""Titles with elevation and azimuth [deg]."""
NEAR_M = 0.06
"""Frames nearer to each other than this share one label, line by line."""


def write_picture(tree: FrameTree, posture: Posture, path: Path) -> None:
    """Draw every frame that the joints place.

    Args:
        tree: All frames.
        posture: Where the arms are.
        path: `.png`, `.svg` or `.pdf`; the folder is made.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    known = [frame for frame in tree.frames if set(tree.sides_between(ROOT, frame)) <= set(posture.joints)]
    places = {frame: tree.locate(ROOT, frame, posture.joints).transform for frame in known}
    figure = plt.figure(figsize=(15, 8), layout="constrained")
    for number, (title, elevation, azimuth) in enumerate(VIEWS, start=1):
        panel: Any = figure.add_subplot(1, len(VIEWS), number, projection="3d")
        for frame, place in places.items():
            for axis, colour in zip(place.rotation.T, AXIS_COLOURS, strict=True):
                panel.plot(*np.stack((place.p_m, place.p_m + AXIS_M * axis), -1), color=colour, linewidth=1.5)
            parent = tree.parent(frame)
            if parent is not None:
                line = np.stack((places[parent].p_m, place.p_m), -1)
                panel.plot(*line, color=KIND_COLOURS[kind_of(tree, frame)], linewidth=1.0, linestyle="--")
        for names in _labels(places):
            at = places[names[-1]].p_m
            panel.text(at[0], at[1] - 0.03, at[2], "\n".join(names), fontsize=6, va="center")
        points = np.array([place.p_m for place in places.values()])
        middle, half = 0.5 * (points.max(axis=0) + points.min(axis=0)), 0.55 * np.ptp(points, axis=0).max()
        for name, at in zip("xyz", middle, strict=True):
            getattr(panel, f"set_{name}lim")(at - half, at + half)
            getattr(panel, f"set_{name}label")(f"{name} [m]")
        panel.set_box_aspect((1, 1, 1))
        panel.set_proj_type("ortho")
        if elevation == 90.0:
            panel.set_zticks([])
            panel.set_zlabel("")
        panel.view_init(elev=elevation, azim=azimuth)
        panel.set_title(f"{title}; joints: {posture.source}", fontsize=8)
    shown = {kind_of(tree, frame) for frame in known if frame != ROOT}
    handles = [mpl.lines.Line2D([], [], color=KIND_COLOURS[kind], linestyle="--", label=kind) for kind in KIND_COLOURS]
    figure.legend(handles=[handle for handle in handles if handle.get_label() in shown], loc="lower center", ncols=5)
    figure.suptitle(f"frames in {ROOT} (manual, appendix A): x red, y green, z blue")
    figure.savefig(path, dpi=130)
    plt.close(figure)


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
