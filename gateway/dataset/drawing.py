"""Draws an episode of a dataset: a sheet of its cameras' pictures, and every vector over time. Libraries: matplotlib."""

from __future__ import annotations

import base64
import html
import io
import json
import os
import warnings
from pathlib import Path
from typing import Any, Final

import numpy as np

from gateway.dataset.building import PROVENANCE
from gateway.dataset.episode import INTEGERS
from gateway.dataset.lerobot_reader import Dataset, EpisodeRead, labels_of
from gateway.dataset.lerobot_videos import episode_pictures
from gateway.dataset.videos import IMAGES
from gateway.recording.bag_writer import needed

__all__ = ["Group", "draw", "groups_of"]

Group = tuple[tuple[str, ...], str]
"""Dimensions that are drawn together: their names, and their unit."""
WIDTH_IN, ROW_IN, COLUMNS, TOGETHER = 14.0, 1.6, 8, 8
HTML: Final = (
    '<!doctype html>\n<html lang="en">\n<meta charset="utf-8">\n<title>{0}</title>\n<h1>{0}</h1>\n'
    '<p><img alt="pictures and vectors" style="max-width:100%" src="data:image/png;base64,{1}"></p>\n</html>\n'
)


def groups_of(dataset: Dataset) -> dict[str, list[Group]]:
    """Return the dimensions of each vector: grouped as the layout it was built by has them, else in eights, without units."""
    path = dataset.folder / PROVENANCE
    facts = json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}
    layout = facts.get("choices", {}).get("layout", {}).get("feature", ())
    built = {one["name"]: [(tuple(part["names"]), part["unit"]) for part in one["part"]] for one in layout}
    found = {}
    for name, feature in dataset.features.items():
        if feature["dtype"] not in ("video", "image", "string") and name not in (*INTEGERS, "timestamp"):
            size = int(np.prod(feature["shape"]))
            listed = labels_of(feature, size)
            eights = [(tuple(listed[first : first + TOGETHER]), "") for first in range(0, size, TOGETHER)]
            found[name] = built.get(name, eights)
    return found


def draw(dataset: Dataset, episode: EpisodeRead, title: str, out: Path) -> None:
    """Draw an episode into a file, `.html` or `.png`; a part of a vector that is 0 in all of them is left out.

    Raises:
        Rejected: BAD_REQUEST, matplotlib or PyAV is not installed.
        OSError, ValueError: A video cannot be read, or the file cannot be written.
    """
    figures = needed("matplotlib.figure", "demo")
    tables = {name: episode.columns[name].reshape(episode.rows, -1) for name in groups_of(dataset)}
    vectors = [_parts(groups, tables[name]) for name, groups in groups_of(dataset).items()]
    longest = max(map(len, vectors), default=0)
    kept = [n for n in range(longest) if any(n < len(parts) and np.any(parts[n][2]) for parts in vectors)] or [0]
    shown = np.unique(np.linspace(0, max(0, episode.rows - 1), COLUMNS).round().astype(int))
    shapes = [dataset.features[name]["shape"] for name in episode.videos]
    sheet_in = [WIDTH_IN / len(shown) * shape[0] / shape[1] + 0.1 for shape in shapes]
    heights = [sum(sheet_in) + 0.4] * bool(shapes) + [ROW_IN * len(kept) + 0.3] * bool(longest)
    figure = figures.Figure(figsize=(WIDTH_IN, sum(heights) + 0.5), layout="constrained")
    figure.suptitle(title, parse_math=False)
    places = list(figure.subfigures(max(1, len(heights)), 1, squeeze=False, height_ratios=heights or None)[:, 0])
    if shapes:
        axes = places.pop(0).subplots(len(shapes), len(shown), squeeze=False, height_ratios=sheet_in)
        for line, (name, video) in zip(axes, episode.videos.items(), strict=True):
            line[0].set_ylabel(_plain(name.removeprefix(IMAGES)), fontsize=9)
            for row, picture in enumerate(episode_pictures(*video, episode.rows, dataset.fps)):
                if row in shown:
                    line[list(shown).index(row)].imshow(picture.to_ndarray(format="rgb24"))
            for panel, row in zip(line, shown, strict=True):
                panel.set(xticks=[], yticks=[])
                axes[0, list(shown).index(row)].set_title(f"{row / dataset.fps:.2f} s", fontsize=8)
    if longest:
        axes = places.pop(0).subplots(len(kept), len(vectors), squeeze=False, sharex=True)
        for column, (name, parts) in enumerate(zip(tables, vectors, strict=True)):
            for panel, part in zip(axes[:, column], kept, strict=True):
                if part < len(parts):
                    _draw_part(panel, np.arange(episode.rows) / dataset.fps, *parts[part])
                else:
                    panel.set_axis_off()
            axes[0, column].set_title(_plain(name), loc="right", fontsize=9, fontweight="bold")
            axes[-1, column].set_xlabel("time [s]", fontsize=8)
    png = io.BytesIO()
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Glyph .* missing")  # of a task in another script: a box stands for it
        figure.savefig(png, format="png", dpi=100)
    if out.suffix.lower() == ".html":
        page = HTML.format(html.escape(title), base64.b64encode(png.getvalue()).decode())
        out.write_text(page, encoding="utf-8")
    else:
        out.write_bytes(png.getvalue())


def _parts(groups: list[Group], table: Any) -> list[tuple[tuple[str, ...], str, Any]]:  # noqa: ANN401  of any numbers
    ends = np.cumsum([len(names) for names, _ in groups])
    return [(names, unit, table[:, end - len(names) : end]) for (names, unit), end in zip(groups, ends, strict=True)]


def _draw_part(panel: Any, times_s: Any, names: tuple[str, ...], unit: str, values: Any) -> None:  # noqa: ANN401
    panel.set_title(_plain(names[0] if len(names) == 1 else f"{names[0]} .. {names[-1]}"), loc="left", fontsize=8)
    panel.set_ylabel(f"[{_plain(unit)}]" if unit else "", fontsize=8)
    panel.tick_params(labelsize=7)
    panel.grid(alpha=0.3)
    if not np.any(values):
        panel.set(yticks=[])
        panel.text(0.5, 0.5, "0 throughout", transform=panel.transAxes, ha="center", va="center", color="grey")
        return
    lines = panel.plot(times_s, values, linewidth=1.0)
    if len(names) > 1:
        begin, end = (len(os.path.commonprefix([name[::step] for name in names])) for step in (1, -1))  # noqa: RUF071  no paths
        short = [_plain(name[begin : len(name) - end] or name).lstrip("_") for name in names]
        place = {"loc": "center left", "bbox_to_anchor": (1.0, 0.5)}
        panel.legend(lines, short, fontsize=7, frameon=False, labelspacing=0.1, **place)


def _plain(text: str) -> str:
    return text.replace("$", r"\$")
