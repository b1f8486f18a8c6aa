"""Tests of LeRobot's formats: what its own loaders and a tool of others ask for is there."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from gateway.dataset.building import Choices, build
from gateway.dataset.layout import ACTION, STATE, vendor_layout
from gateway.dataset.lerobot_reader import Dataset
from tests.dataset.motion import moving

SCALARS = {
    "timestamp": "float",
    "frame_index": "int64",
    "episode_index": "int64",
    "index": "int64",
    "task_index": "int64",
}


@pytest.fixture(scope="module")
def sets(tmp_path_factory):
    """Return a folder with one dataset of each format."""
    folder = tmp_path_factory.mktemp("sets")
    bags = [moving(folder / "a", 3.0), moving(folder / "b", 2.0, facts={"task": "bow"})]
    for version in ("v2.1", "v3.0"):
        build(bags, folder / version, Choices(layout=vendor_layout(), version=version))
    return folder


def test_both_formats_hold_the_same_rows(sets):
    """And the same tasks."""
    old, new = (list(Dataset(sets / version).episodes()) for version in ("v2.1", "v3.0"))
    assert [e.tasks for e in old] == [e.tasks for e in new] == [("wave",), ("bow",)]
    for one, other in zip(old, new, strict=True):
        assert one.columns.keys() == other.columns.keys()
        assert all(np.array_equal(one.columns[name], other.columns[name]) for name in one.columns)
    assert Dataset(sets / "v2.1").tasks() == Dataset(sets / "v3.0").tasks() == {0: "wave", 1: "bow"}


@pytest.mark.parametrize(("version", "path"), [("v2.1", "data/chunk-000/episode_000001.parquet"),
                                               ("v3.0", "data/chunk-000/file-000.parquet")])  # fmt: skip
def test_columns_have_the_types_that_lerobot_loads(sets, version, path):
    """Vectors of fixed size, float32; times float32, numbers int64."""
    schema = pq.read_schema(sets / version / path)
    assert {name: str(schema.field(name).type) for name in SCALARS} == SCALARS
    for name in (STATE, ACTION):
        assert schema.field(name).type.list_size == 72 and str(schema.field(name).type.value_type) == "float"


def test_v21_has_a_line_for_each_task_and_episode(sets):
    """And for the statistics of each, which v2.1 needs."""
    meta = sets / "v2.1/meta"
    lines = {name: [json.loads(x) for x in (meta / f"{name}.jsonl").read_text().splitlines()]
             for name in ("tasks", "episodes", "episodes_stats")}  # fmt: skip
    assert lines["tasks"] == [{"task_index": 0, "task": "wave"}, {"task_index": 1, "task": "bow"}]
    rows = [episode.rows for episode in Dataset(sets / "v2.1").episodes()]
    assert [(e["episode_index"], e["tasks"], e["length"]) for e in lines["episodes"]] == [
        (0, ["wave"], rows[0]), (1, ["bow"], rows[1]),
    ]  # fmt: skip
    stats = lines["episodes_stats"][1]["stats"]
    assert set(stats) == {STATE, ACTION, *SCALARS} and stats["index"]["min"] == [float(rows[0])]
    assert all(isinstance(one["count"][0], int) for one in stats.values())
    info = json.loads((meta / "info.json").read_text())
    assert (info["total_chunks"], info["total_videos"], info["splits"], info["fps"]) == (1, 0, {"train": "0:2"}, 45)


def test_v30_has_a_row_for_each_episode_and_labels_for_pandas(sets):
    """Where its rows are, its statistics; tasks are labels of rows, as LeRobot looks them up."""
    table = pq.read_table(sets / "v3.0/meta/episodes/chunk-000/file-000.parquet").to_pylist()
    first, second = table
    assert (
        first["dataset_from_index"] == 0
        and first["dataset_to_index"] == second["dataset_from_index"] == first["length"]
    )
    assert second["dataset_to_index"] == first["length"] + second["length"]
    assert len(first[f"stats/{STATE}/q01"]) == 72 and first["stats/index/count"] == [first["length"]]
    facts = json.loads(pq.read_schema(sets / "v3.0/meta/tasks.parquet").metadata[b"pandas"])
    assert facts["index_columns"] == ["task"]
    stats = json.loads((sets / "v3.0/meta/stats.json").read_text())
    assert set(stats[ACTION]) == {"min", "max", "mean", "std", "count", "q01", "q10", "q50", "q90", "q99"}


@pytest.mark.parametrize("version", ["v2.1", "v3.0"])
def test_lerobot_doctor_finds_no_fault(sets, version):
    """A checker of others; that dimensions never change it warns of, and rightly."""
    doctor = Path(sys.executable).with_name("lerobot-doctor")
    done = subprocess.run([doctor, "check", sets / version], capture_output=True, text=True, timeout=120, check=False)
    summary = [line for line in done.stdout.splitlines() if line.startswith("Summary")]
    assert len(summary) == 1 and "PASS" in summary[0] and "FAIL" not in summary[0], done.stdout + done.stderr
