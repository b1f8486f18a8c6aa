"""Tests of comparing datasets: what differs is named with its place and size, and nothing else."""

from __future__ import annotations

import json
import shutil

import numpy as np
import pytest

from gateway.dataset.building import Choices, build
from gateway.dataset.differing import differences
from gateway.dataset.lerobot_reader import Dataset
from gateway.dataset.parquet import columns, read, write
from gateway.errors import Rejected
from tests.dataset.motion import filmed

CAMERA = "observation.images.head_camera"


@pytest.fixture(scope="module")
def folder(filmed_bags, layout, tmp_path_factory):
    """Return a folder with datasets `a` (v2.1) and `b` (v3.0) of the same bags, and `half` of the first bag."""
    folder = tmp_path_factory.mktemp("sets")
    for name, version, bags in (
        ("a", "v2.1", filmed_bags),
        ("b", "v3.0", filmed_bags),
        ("half", "v2.1", filmed_bags[:1]),
    ):
        build(bags, folder / name, Choices(layout=layout, version=version, least_rows=10))
    return folder


@pytest.fixture
def copied(folder, tmp_path):
    """Return a copy of `a` that may be changed."""
    shutil.copytree(folder / "a", tmp_path / "c")
    return tmp_path / "c"


def found(one, other):
    """Return what differs: place, feature, message."""
    return [(d.where, d.feature, d.message) for d in differences(Dataset(one), Dataset(other))]


def changed(folder, **changes):
    """Change columns of the second episode: each by a function that is given its numbers."""
    path = folder / "data/chunk-000/episode_000001.parquet"
    table, arrays = read(path), {}
    for name in table.column_names:
        column = table.column(name).combine_chunks()
        size = getattr(column.type, "list_size", 0)
        flat = np.array(column.flatten() if size else column)
        arrays[name] = flat.reshape(-1, size) if size else flat
        if name in changes:
            changes[name](arrays[name])
    write(columns(arrays), path)


def test_both_formats_of_the_same_bags_differ_in_nothing(folder):
    """Numbers and pictures; a task has a number of its own in each."""
    shares = []
    assert differences(Dataset(folder / "a"), Dataset(folder / "b"), shares.append) == [] and shares == [0.5, 1.0]


def test_the_largest_difference_of_a_feature_is_named_with_its_place(folder, copied):
    """By name of the dimension; NaN is NaN, and as far as can be from a number."""

    def moved(action):
        action[3, 1] += 0.25
        action[5, 2] += 0.5

    changed(copied, action=moved, task_index=lambda numbers: numbers.fill(7))
    (one,) = differences(Dataset(folder / "b"), Dataset(copied))
    assert (one.where, one.feature, one.row, one.largest) == ("episode 1", "action", 5, pytest.approx(0.5))
    assert one.message.startswith("c is ") and one.message.endswith("in row 5: the largest difference")
    changed(copied, action=lambda action: action.__setitem__((4, 0), np.nan))
    assert differences(Dataset(folder / "a"), Dataset(copied))[0].largest == np.finfo(float).max
    assert found(copied, copied) == []


@pytest.mark.parametrize(
    ("names", "label"), [({"motors": ["a", "b", "c"]}, "c"), (["all"], "dimension 2"), (None, "dimension 2")]
)
def test_a_dimension_is_named_only_where_each_has_a_name(copied, tmp_path, names, label):
    """Else it is numbered."""
    path = copied / "meta/info.json"
    info = json.loads(path.read_text())
    info["features"]["action"]["names"] = names
    path.write_text(json.dumps(info))
    shutil.copytree(copied, tmp_path / "d")
    changed(tmp_path / "d", action=lambda action: action.__setitem__((5, 2), 9.0))
    (one,) = differences(Dataset(copied), Dataset(tmp_path / "d"))
    assert one.message.startswith(f"{label} is ") and one.row == 5


def test_features_rates_and_tasks_are_compared(folder, copied):
    """What is in one only, what is of another type, names in another order."""
    path = copied / "meta/info.json"
    info = json.loads(path.read_text())
    info["features"]["extra"] = {"dtype": "float32", "shape": [1], "names": None}
    info["features"]["action"]["names"] = ["b", "a", "c"]
    info["features"]["observation.state"]["names"] = ["a", "b", "z"]
    path.write_text(json.dumps(info))
    lines = (copied / "meta/episodes.jsonl").read_text().replace("bow", "nod")
    (copied / "meta/episodes.jsonl").write_text(lines)
    assert found(folder / "a", copied) == [
        ("info.json", "observation.state", "dimension 2 is c or z: the first of another name"),
        ("info.json", "action", "dimension 0 is a or b: the first of another name"),
        ("info.json", "extra", f"only {copied} has it"),
        ("episode 1", "", "tasks: bow or nod"),
    ]


@pytest.mark.parametrize(
    ("names", "why"),
    [
        ({"motors": ["a", "b", "c"]}, []),
        ({"arm": ["a", "b"], "grip": ["z"]}, ["dimension 2 is c or z: the first of another name"]),
        ({"a": 0, "c": 1, "b": 2}, ["dimension 1 is b or c: the first of another name"]),
    ],
)
def test_names_in_a_map_are_compared_one_by_one(folder, copied, names, why):
    """As LeRobot's own robots have them: of lists, or of places; and so is the kind of robot."""
    path = copied / "meta/info.json"
    info = json.loads(path.read_text())
    info["features"]["action"]["names"] = names
    path.write_text(json.dumps(info | {"robot_type": "so100"}))
    robot = ("info.json", "", f"robot_type {Dataset(folder / 'a').info['robot_type']} or so100")
    assert found(folder / "a", copied) == [robot, *(("info.json", "action", each) for each in why)]


def test_episodes_and_rows_are_counted(folder, layout, filmed_bags, tmp_path):
    """The rows that both have are compared all the same."""
    assert found(folder / "a", folder / "half") == [("", "", "2 or 1 episodes")]
    build(filmed_bags[:1], tmp_path / "slow", Choices(layout=layout, least_rows=5, fps=20.0))
    told = found(folder / "half", tmp_path / "slow")
    assert told[0] == ("info.json", "", "45 or 20 rows per second") and told[1][2].startswith("rows: ")
    assert any(feature == CAMERA and message.endswith(" pictures") for _, feature, message in told)


def test_the_largest_difference_of_pictures_is_named(folder, copied):
    """The second episode has the other's pictures, one less of them, or pictures of another size."""
    videos = copied / "videos/chunk-000"
    shutil.copy(videos / CAMERA / "episode_000000.mp4", videos / CAMERA / "episode_000001.mp4")
    assert found(folder / "a", copied) == []  # both robots saw the same
    shutil.copy(videos / "observation.images.left_color/episode_000000.mp4", videos / CAMERA / "episode_000001.mp4")
    (told,) = found(folder / "a", copied)
    assert told[:2] == ("episode 1", CAMERA) and told[2].startswith(
        "a pixel is 255 of 255 off in row 0, or the size differs"
    )


def test_another_picture_is_found_to_the_pixel(folder, filmed_bags, layout, tmp_path):
    """One that was damaged: the one before stands in its row."""
    import msgspec

    bag = filmed(
        tmp_path,
        "wave",
        lambda p: msgspec.structs.replace(p, clean=p.n != 20),
        count=40,
        seconds=0.9,
        facts={"task": "wave"},
    )
    build([bag], tmp_path / "set", Choices(layout=layout, least_rows=10))
    told = differences(Dataset(folder / "half"), Dataset(tmp_path / "set"))
    assert {one.feature for one in told} == set(Dataset(folder / "half").cameras)
    assert all(one.largest == pytest.approx(8.0, abs=4.0) and one.row == told[0].row for one in told)


def test_what_cannot_be_read_is_refused(folder, copied):
    """With what says more."""
    (copied / f"videos/chunk-000/{CAMERA}/episode_000001.mp4").unlink()
    with pytest.raises(Rejected, match="episode 1 cannot be compared"):
        found(folder / "a", copied)
    (copied / "data/chunk-000/episode_000001.parquet").unlink()
    with pytest.raises(Rejected, match="cannot be read"):
        found(folder / "a", copied)
