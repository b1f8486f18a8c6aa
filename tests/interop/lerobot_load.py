"""Loads a dataset with LeRobot's own loader and compares it with its files; run by `bin/interop` in an environment of its own.

Knows nothing of the gateway: Parquet by pyarrow and video by PyAV are the witnesses.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import av
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

PICTURES = 10
"""Compared of each camera and episode."""
TOLERANCE = 3.0 / 255.0
"""Between two ways to make RGB of the same coded picture, on average."""


def rows_of(folder: Path) -> Any:
    """Return all rows as they lie in the files."""
    return pa.concat_tables([pq.read_table(path) for path in sorted((folder / "data").rglob("*.parquet"))])


def picture(path: Path, at_s: float) -> Any:
    """Return the picture of a file at a time, 0..1, shape (3, height, width)."""
    with av.open(str(path)) as file:
        for frame in file.decode(video=0):
            if abs(float(frame.pts * frame.time_base) - at_s) < 1e-4:
                return frame.to_ndarray(format="rgb24").transpose(2, 0, 1) / 255.0
    raise AssertionError(f"{path}: no picture at {at_s} s")


def place(dataset: Any, folder: Path, camera: str, episode: int) -> tuple[Path, float]:
    """Return the file of an episode's video, and where it begins in it [s], as LeRobot says."""
    path = folder / dataset.meta.get_video_file_path(episode, camera)
    begin_s = 0.0
    if dataset.meta.info["codebase_version"] == "v3.0":
        begin_s = float(dataset.meta.episodes[episode][f"videos/{camera}/from_timestamp"])
    return path, begin_s


def main(folder: Path) -> int:
    """Compare, and print what was found; return the exit status."""
    from lerobot import __version__
    from lerobot.datasets.lerobot_dataset import LeRobotDataset

    info = json.loads((folder / "meta/info.json").read_text())
    dataset = LeRobotDataset("teleavatar/ours", root=folder, video_backend="pyav")
    table = rows_of(folder)
    assert len(dataset) == info["total_frames"] == len(table), (len(dataset), info["total_frames"], len(table))
    cameras = [name for name, feature in info["features"].items() if feature["dtype"] == "video"]
    numbers = [name for name, feature in info["features"].items() if feature["dtype"] != "video"]
    episodes = np.array(table.column("episode_index"))
    compared, worst = 0, 0.0
    for episode in range(info["total_episodes"]):
        mine = np.flatnonzero(episodes == episode)
        for row in np.unique(np.linspace(mine[0], mine[-1], PICTURES).round().astype(int)):
            item = dataset[int(row)]
            for name in numbers:
                wanted = np.asarray(table.column(name)[int(row)].as_py(), dtype=np.float64)
                assert np.array_equal(np.asarray(item[name], dtype=np.float64).reshape(-1), wanted.reshape(-1)), (
                    name,
                    row,
                )
            for camera in cameras:
                path, begin_s = place(dataset, folder, camera, episode)
                wanted = picture(path, begin_s + float(item["timestamp"]))
                worst = max(worst, float(np.abs(np.asarray(item[camera]) - wanted).mean()))
                compared += 1
    vectors = dataset.hf_dataset.with_format("numpy")
    for name in numbers:
        loaded, written = np.stack(list(vectors[name])), np.array(table.column(name).to_pylist())
        assert np.array_equal(loaded.reshape(written.shape), written), name
    stats = {name: set(one) for name, one in dataset.meta.stats.items()}
    assert all({"min", "max", "mean", "std", "count"} <= kinds for kinds in stats.values()) and set(cameras) <= set(
        stats
    )
    assert worst < TOLERANCE, f"pictures differ by {worst}"
    counts = f"{info['total_episodes']} episodes, {len(table)} rows all the same"
    print(f"LeRobot {__version__} loads {folder} ({info['codebase_version']}): {counts}, ", end="")
    print(f"{compared} pictures within {worst * 255:.2f} of 255")
    return 0


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1])))
