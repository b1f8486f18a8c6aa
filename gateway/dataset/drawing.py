"""Draws an episode of a dataset: pictures of its cameras in a sheet, every vector over time; as PNG, or as one HTML file.

Libraries: matplotlib, Pillow; PyAV where there are cameras.
"""

from __future__ import annotations

import base64
import html
import io
import json
import os
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np

from gateway.dataset.building import PROVENANCE
from gateway.dataset.episode import INTEGERS
from gateway.dataset.layout import vendor_layout
from gateway.dataset.lerobot_reader import Dataset, EpisodeRead
from gateway.dataset.lerobot_videos import episode_pictures
from gateway.dataset.videos import IMAGES
from gateway.recording.bag_writer import needed
from gateway.robot.vector_layout import STATE_NAMES, STATE_WIDTHS

__all__ = ["draw", "parts_of"]

Parts = list[tuple[tuple[str, ...], str]]
"""Groups of dimensions that are drawn together, in order: their names, and their unit."""
GROUP: Final = 8
WIDTH_IN, ROW_IN, DPI = 14.0, 1.6, 100
COLUMNS: Final = 8
"""Pictures of each camera."""


def parts_of(dataset: Dataset) -> dict[str, Parts]:
    """Return the dimensions of each vector by parts: as its layout has them, as the maker's has them, or in eights."""
    path = dataset.folder / PROVENANCE
    told = json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}
    layouts = {
        feature["name"]: feature["part"] for feature in told.get("choices", {}).get("layout", {}).get("feature", ())
    }
    found: dict[str, Parts] = {}
    for name, feature in dataset.features.items():
        if feature["dtype"] in ("video", "image", "string") or name in (*INTEGERS, "timestamp"):
            continue
        size = int(np.prod(feature["shape"]))
        names = feature.get("names")
        names = (
            tuple(map(str, names)) if isinstance(names, list) and len(names) == size else tuple(map(str, range(size)))
        )
        parts = [(tuple(part["names"]), str(part["unit"])) for part in layouts.get(name, ())]
        if not parts and size in STATE_WIDTHS and names == STATE_NAMES[:size]:
            parts = [(part.names, part.unit) for part in vendor_layout(size).feature[0].part]
        if tuple(each for part, _ in parts for each in part) != names:
            parts = [(names[first : first + GROUP], "") for first in range(0, size, GROUP)]
        found[name] = parts
    return found


def draw(dataset: Dataset, episode: EpisodeRead, title: str, out: Path) -> None:
    """Draw an episode.

    Args:
        dataset: It.
        episode: Of it.
        title: Stands above.
        out: File to be written: `.html`, or any picture that Pillow writes.

    Raises:
        Rejected: BAD_REQUEST, matplotlib, Pillow or PyAV is not installed.
        OSError, ValueError: The pictures cannot be read, or the file cannot be written.
    """
    needed("matplotlib", "demo")
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Glyph .* missing")  # of a task's own script: a box stands for it
        drawn = [_plots(dataset, episode, title if not episode.videos else "")]
        if episode.videos:
            drawn.insert(0, _sheet(dataset, episode, title))
    if out.suffix.lower() in (".html", ".htm"):
        images = "".join(
            f'<p><img alt="{alt}" style="max-width:100%" src="data:image/png;base64,{base64.b64encode(png).decode()}"></p>\n'
            for alt, png in zip(("pictures", "vectors")[-len(drawn) :], drawn, strict=True)
        )
        head = f'<!doctype html>\n<html lang="en">\n<meta charset="utf-8">\n<title>{html.escape(title)}</title>\n'
        out.write_text(f"{head}<h1>{html.escape(title)}</h1>\n{images}</html>\n", encoding="utf-8")
        return
    image = needed("PIL.Image", "video")
    pictures = [image.open(io.BytesIO(png)).convert("RGB") for png in drawn]
    whole = image.new("RGB", (max(p.width for p in pictures), sum(p.height for p in pictures)), "white")
    top = 0
    for picture in pictures:
        whole.paste(picture, (0, top))
        top += picture.height
    whole.save(out)


def _sheet(dataset: Dataset, episode: EpisodeRead, title: str) -> bytes:
    """Return the sheet: a row for each camera, times above."""
    from matplotlib.figure import Figure

    rows = np.unique(np.linspace(0, max(0, episode.rows - 1), COLUMNS).round().astype(int))
    shapes = [dataset.features[name]["shape"] for name in episode.videos]
    heights = [WIDTH_IN / len(rows) * shape[0] / shape[1] for shape in shapes]
    figure = Figure(figsize=(WIDTH_IN, sum(heights) + 0.1 * len(heights) + 0.6), layout="constrained")
    figure.suptitle(title, fontsize=12, parse_math=False)
    axes = figure.subplots(len(shapes), len(rows), squeeze=False, height_ratios=heights)
    for row, panel in zip(rows, axes[0], strict=True):
        panel.set_title(f"{row / dataset.fps:.2f} s", fontsize=8)
    for line, (name, video) in zip(axes, episode.videos.items(), strict=True):
        wanted = {int(row): panel for row, panel in zip(rows, line, strict=True)}
        for panel in line:
            panel.set(xticks=[], yticks=[])
        line[0].set_ylabel(_plain(name.removeprefix(IMAGES)), fontsize=9)
        for row, picture in enumerate(episode_pictures(*video, episode.rows, dataset.fps)):
            if row in wanted:
                wanted[row].imshow(picture.to_ndarray(format="rgb24"))
    return _png(figure)


def _plots(dataset: Dataset, episode: EpisodeRead, title: str) -> bytes:
    """Return the vectors over time: a column for each, a row for each part."""
    from matplotlib.figure import Figure

    parts = parts_of(dataset)
    columns = {name: _drawable(episode, name, mine) for name, mine in parts.items()}
    count = max((len(mine) for mine in columns.values()), default=1)
    is_empty = [all(len(mine) <= row or mine[row][2] is None for mine in columns.values()) for row in range(count)]
    rows = [row for row in range(count) if not is_empty[row]] or [0]
    figure = Figure(figsize=(WIDTH_IN, ROW_IN * len(rows) + 0.8), layout="constrained")
    figure.suptitle(title, fontsize=12, parse_math=False)
    axes = figure.subplots(len(rows), max(1, len(columns)), squeeze=False, sharex=True)
    times_s = np.arange(episode.rows) / dataset.fps
    for column, (name, mine) in enumerate(columns.items()):
        for place, row in enumerate(rows):
            panel = axes[place, column]
            if row >= len(mine):
                panel.set_axis_off()
                continue
            _panel(panel, times_s, *mine[row])
            if not place:
                panel.set_title(_plain(name), loc="right", fontsize=9, fontweight="bold")
        axes[-1, column].set_xlabel("time [s]", fontsize=8)
    return _png(figure)


def _drawable(episode: EpisodeRead, name: str, parts: Parts) -> list[tuple[tuple[str, ...], str, Any]]:
    """Return names, unit and rows of each part; None for the rows of one that is 0 throughout."""
    table = episode.columns[name].reshape(episode.rows, -1).astype(np.float64)
    found, first = [], 0
    for names, unit in parts:
        values = table[:, first : first + len(names)]
        found.append((names, unit, values if np.any(values) else None))
        first += len(names)
    return found


def _panel(panel: Any, times_s: Any, names: Sequence[str], unit: str, values: Any) -> None:  # noqa: ANN401  of matplotlib
    label = names[0] if len(names) == 1 else f"{names[0]} .. {names[-1]}"
    panel.set_title(_plain(label), loc="left", fontsize=8)
    panel.set_ylabel(f"[{_plain(unit)}]" if unit else "", fontsize=8)
    panel.tick_params(labelsize=7)
    panel.grid(alpha=0.3)
    if values is None:
        panel.set(yticks=[])
        panel.text(
            0.5, 0.5, "0 throughout", transform=panel.transAxes, ha="center", va="center", color="grey", fontsize=8
        )
        return
    lines = panel.plot(times_s, values, linewidth=1.0)
    if len(names) > 1:
        begin, end = len(os.path.commonprefix(list(names))), len(os.path.commonprefix([name[::-1] for name in names]))
        short = [_plain(name[begin : len(name) - end] or name).lstrip("_") for name in names]
        panel.legend(
            lines, short, fontsize=7, loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False, labelspacing=0.1
        )


def _plain(text: str) -> str:
    return text.replace("$", r"\$")


def _png(figure: Any) -> bytes:  # noqa: ANN401  of matplotlib
    file = io.BytesIO()
    figure.savefig(file, format="png", dpi=DPI)
    return file.getvalue()
