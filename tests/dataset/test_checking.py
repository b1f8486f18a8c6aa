"""Tests of the judge of datasets: each fault is found, where it is, and nothing else is."""

from __future__ import annotations

import json

import numpy as np
import pytest

from gateway.dataset import lerobot_format
from gateway.dataset.building import Choices, build
from gateway.dataset.checking import check_dataset
from gateway.dataset.layout import ACTION, STATE, load
from gateway.dataset.lerobot_reader import Dataset
from gateway.dataset.parquet import columns, read, write
from gateway.errors import Rejected
from tests.dataset.motion import OWN, moving


@pytest.fixture(scope="module")
def bags(tmp_path_factory, layout):
    """Return two bags and a small layout."""
    folder = tmp_path_factory.mktemp("bags")
    return [moving(folder / "a", 2.0), moving(folder / "b", 2.0)], layout


def built(bags, folder, version, **more):
    """Build a dataset and return its folder."""
    paths, layout = bags
    build(paths, folder, Choices(layout=layout, version=version, **more))
    return folder


def told(folder):
    """Return what is found."""
    return [(f.level, f.where, f.message) for f in check_dataset(Dataset(folder)).findings]


DATA = {"v2.1": "data/chunk-000/episode_000001.parquet", "v3.0": "data/chunk-000/file-000.parquet"}


def changed(change):
    """Return a fault in the rows: what becomes of each column, by its name."""

    def spoil(folder, version):
        path = folder / DATA[version]
        table = read(path)
        arrays = {}
        for name in table.column_names:
            column = table.column(name).combine_chunks()
            size = getattr(column.type, "list_size", 0)
            flat = np.array(column.flatten() if size else column)
            arrays[name] = flat.reshape(-1, size) if size else flat
        change(arrays)
        write(columns(arrays), path)

    return spoil


def noted(name, change):
    """Return a fault in `info.json`."""

    def spoil(folder, version):
        path = folder / "meta/info.json"
        info = json.loads(path.read_text())
        change(info) if name is None else info.update({name: change})
        path.write_text(json.dumps(info))

    return spoil


def _nan(arrays):
    arrays[STATE][-3, 1] = np.nan


def _jump(arrays):
    arrays[ACTION][-20:, 2] += 5.0


def _later(arrays):
    arrays["timestamp"][-5:] += 0.002


def _moved(arrays):
    arrays["timestamp"][-80:] += 0.002


def _other_task(arrays):
    arrays["task_index"][-1] = 7


def _double(arrays):
    arrays[STATE] = arrays[STATE].astype(np.float64)


def _narrow(arrays):
    arrays[ACTION] = arrays[ACTION][:, :2]


FAULTS = {
    "nan": (changed(_nan), "error", f"episode 1: {STATE}", "b is nan in row"),
    "jump": (changed(_jump), "warning", f"episode 1: {ACTION}", "c jumps from"),
    "late": (changed(_later), "error", "episode 1: timestamp", "2.000 ms off 1/45 s"),
    "numbers": (
        changed(lambda a: a["frame_index"].__setitem__(-1, 0)),
        "error",
        "episode 1: frame_index",
        "is 0 in row",
    ),
    "episode": (
        changed(lambda a: a["episode_index"].__setitem__(-1, 5)),
        "error",
        "episode 1: episode_index",
        "is 5 in",
    ),
    "index": (changed(lambda a: a["index"].__setitem__(-1, 5)), "error", "episode 1: index", "is 5 in row"),
    "task": (changed(_other_task), "error", "episode 1: task_index", "number 7, which is none"),
    "type": (changed(_double), "error", f"episode 1: {STATE}", "is of float64, written down is float32"),
    "width": (changed(_narrow), "error", f"episode 1: {ACTION}", "has 2 dimensions, written down are 3"),
    "column": (changed(lambda a: a.pop(ACTION)), "error", f"episode 1: {ACTION}", "is missing"),
    "episodes": (noted("total_episodes", 3), "error", "meta/info.json", "total_episodes is 3, there are 2"),
    "frames": (noted("total_frames", 5), "error", "meta/info.json", "total_frames is 5, there are"),
    "tasks": (noted("total_tasks", 5), "error", "meta/info.json", "total_tasks is 5, there are 1"),
    "gone": (lambda folder, version: (folder / DATA[version]).unlink(), "error", None, "cannot be read: FileNotFound"),
    "rubbish": (lambda f, v: (f / DATA[v]).write_bytes(b"rubbish"), "error", None, "cannot be read: ArrowInvalid"),
}


@pytest.mark.parametrize("version", ["v2.1", "v3.0"])
def test_nothing_is_found_in_what_we_build(bags, tmp_path, version):
    """Not even a warning, where everything moves and has a task."""
    checked = check_dataset(Dataset(built(bags, tmp_path / "set", version)))
    assert checked.ok and checked.findings == [] and (checked.version, checked.episodes) == (version, 2)


@pytest.mark.parametrize("version", ["v2.1", "v3.0"])
@pytest.mark.parametrize("fault", FAULTS)
def test_each_fault_is_found_where_it_is(bags, tmp_path, version, fault):
    """In either format; what it makes untrue (statistics, counts) may be told beside it."""
    spoil, level, where, message = FAULTS[fault]
    folder = built(bags, tmp_path / "set", version)
    spoil(folder, version)
    found = told(folder)
    assert any(f[0] == level and where in (None, f[1]) and message in f[2] for f in found), found
    beside = ("in the statistics", "total_", "cannot be read", "step to row", "has no row")
    others = [f for f in found if message not in f[2] and not any(text in f[2] for text in beside)]
    assert all(other[1].startswith("episode 1") or fault in ("type", "width", "column") for other in others), others


@pytest.mark.parametrize(
    ("names", "label"),
    [({"motors": ["a", "b", "c"]}, "c"), (["all"], "2"), ({"a": 0, "b": 1, "c": 2}, "c"), (None, "2")],
)
def test_a_dimension_is_told_by_its_name_or_its_number(bags, tmp_path, names, label):
    """Also where names lie in a map, as those of LeRobot's own robots do, or are fewer than the dimensions."""
    folder = built(bags, tmp_path / "set", "v2.1")
    FAULTS["jump"][0](folder, "v2.1")
    path = folder / "meta/info.json"
    info = json.loads(path.read_text())
    info["features"][ACTION]["names"] = names
    path.write_text(json.dumps(info))
    assert any(text.startswith(f"{label} jumps from") for _, _, text in told(folder))


def test_a_step_that_lerobot_refuses_is_found_though_it_is_2_ms(bags, tmp_path):
    """At the begin of an episode, too: all its rows are off the grid."""
    folder = built(bags, tmp_path / "set", "v2.1")
    changed(_moved)(folder, "v2.1")
    assert any("timestamp" in where and "ms off" in message for _, where, message in told(folder))


def test_statistics_that_are_not_those_of_the_rows_are_found(bags, tmp_path):
    """Of an episode in v2.1, of the whole in v3.0; one that is missing, too."""
    folder = built(bags, tmp_path / "old", "v2.1")
    path = folder / "meta/episodes_stats.jsonl"
    rows = [json.loads(line) for line in path.read_text().splitlines()]
    rows[1]["stats"][STATE]["mean"][1] += 0.01
    rows[0]["stats"][ACTION]["count"] = [3]
    del rows[0]["stats"][STATE]
    path.write_text("".join(json.dumps(row) + "\n" for row in rows))
    found = told(folder)
    assert any(where == f"episode 1: {STATE}" and "mean of dimension 1 is" in text for _, where, text in found)
    assert any(where == f"episode 0: {ACTION}" and "statistics of 3 rows" in text for _, where, text in found)
    assert ("error", f"episode 0: {STATE}", "has no statistics") in found
    folder = built(bags, tmp_path / "new", "v3.0")
    stats = json.loads((folder / "meta/stats.json").read_text())
    stats[ACTION]["std"][0] *= 2
    stats[STATE]["max"] = [1.0]
    del stats["index"]
    (folder / "meta/stats.json").write_text(json.dumps(stats))
    found = [(where, text) for _, where, text in told(folder)]
    assert [where for where, _ in found] == [f"meta/stats.json: {name}" for name in (STATE, ACTION, "index")]
    assert [text.split(" is ")[0] for _, text in found] == [
        "no max of 3 dimensions in the statistics", "std of dimension 0", "has no statistics",
    ]  # fmt: skip


def in_single_precision(rows):
    """Return statistics as LeRobot 0.6 makes them: means of rows and of squares in float32, one row after another."""
    mean, squares = np.mean(rows, axis=0), np.mean(rows**2, axis=0)
    std = np.sqrt(np.maximum(0.0, squares - mean**2))
    return {"mean": mean.astype(float).tolist(), "std": std.astype(float).tolist()}


def test_statistics_that_lerobot_added_up_in_single_precision_fit(bags, tmp_path):
    """Of a gripper that is told the same for an episode, LeRobot finds a deviation of a thousandth and more: no fault."""
    folder = built(bags, tmp_path / "set", "v2.1")
    path = folder / "meta/episodes_stats.jsonl"
    for episode in (0, 1):
        data = folder / f"data/chunk-000/episode_{episode:06d}.parquet"
        table = read(data)
        arrays = {name: np.array(table.column(name).to_pylist()) for name in table.column_names}
        arrays = {name: a.astype(np.float32 if a.dtype.kind == "f" else np.int64) for name, a in arrays.items()}
        arrays[ACTION][:, 1] = np.float32(2.7)
        write(columns(arrays), data)
        rows = [json.loads(line) for line in path.read_text().splitlines()]
        stats = rows[episode]["stats"][ACTION]
        stats["min"][1] = stats["max"][1] = float(np.float32(2.7))
        stats.update(in_single_precision(arrays[ACTION]))
        path.write_text("".join(json.dumps(row) + "\n" for row in rows))
    assert stats["std"][1] > 1e-3, "nothing is proved"
    assert [level for level, _, _ in told(folder)] == ["warning"]
    stats["std"][1] = 0.05
    path.write_text("".join(json.dumps(row) + "\n" for row in rows))
    assert ("error", f"episode 1: {ACTION}", "std of dimension 1 is 0.05 in the statistics, 0 in the rows") in told(
        folder
    )


def test_dimensions_that_never_change_an_empty_task_and_short_episodes_are_warned_of(bags, tmp_path):
    """They are no error: a robot may stand."""
    _, layout = bags
    still = moving(tmp_path / "still", 0.5, facts={"task": ""})
    build([still], tmp_path / "set", Choices(layout=layout, least_rows=5))
    folder = tmp_path / "set"
    assert len(read(folder / "data/chunk-000/episode_000000.parquet")) < 30
    found = told(folder)
    assert [level for level, _, _ in found] == ["warning"] * len(found)
    assert any("has 2" in text and "rows only" in text for _, _, text in found)
    assert any("no task in words" in text for _, _, text in found)


def test_a_robot_that_stands_still_is_told(tmp_path):
    """Dimension by dimension, with their values."""
    folder = tmp_path / "own.toml"
    folder.write_text(OWN.replace('field = "position"', 'field = "velocity"', 1))
    build([moving(tmp_path / "bag", 2.0)], tmp_path / "set", Choices(layout=load(folder)))
    assert told(tmp_path / "set") == [("warning", STATE, "never changes in any dimension")]


def test_a_dataset_of_many_files_is_read_whole(bags, tmp_path, monkeypatch):
    """v3.0 begins another file where one is full; every episode is found in its own."""
    monkeypatch.setattr(lerobot_format, "DATA_BYTES", 3000)
    folder = built(bags, tmp_path / "set", "v3.0")
    assert len(list((folder / "data").rglob("*.parquet"))) == 2
    monkeypatch.undo()
    whole = built(bags, tmp_path / "whole", "v3.0")
    assert told(folder) == []
    for one, other in zip(Dataset(folder).episodes(), Dataset(whole).episodes(), strict=True):
        assert all(np.array_equal(one.columns[name], other.columns[name]) for name in other.columns)


@pytest.mark.parametrize(
    ("text", "why"),
    [(None, "No such file or directory"), ("{", "JSONDecodeError"), ("{}", "codebase_version"), ("[]", "TypeError")],
)
def test_what_is_no_dataset_is_refused(tmp_path, text, why):
    """With what was found instead."""
    if text is not None:
        (tmp_path / "meta").mkdir()
        (tmp_path / "meta/info.json").write_text(text)
    with pytest.raises(Rejected, match=f"is no dataset of LeRobot: meta/info.json: .*{why}"):
        Dataset(tmp_path)


def test_other_formats_are_refused_by_name(bags, tmp_path):
    """With those that are known."""
    folder = built(bags, tmp_path / "set", "v2.1")
    noted("codebase_version", "v2.0")(folder, "v2.1")
    with pytest.raises(Rejected, match=r"of LeRobot's format v2.0") as refused:
        Dataset(folder)
    assert refused.value.refusal.bound == "v2.1 or v3.0"
