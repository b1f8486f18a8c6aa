"""Tests of datasets made of datasets: what comes of it is what would have been built, and the pictures are the same."""

from __future__ import annotations

import json
import shutil

import numpy as np
import pytest

from gateway.dataset import lerobot_videos
from gateway.dataset.building import PROVENANCE, Choices, build
from gateway.dataset.checking import check_dataset
from gateway.dataset.editing import merge, split
from gateway.dataset.lerobot_reader import Dataset
from gateway.dataset.lerobot_videos import episode_pictures
from gateway.errors import Rejected

VERSIONS = ("v2.1", "v3.0")


def facts(folder):
    """Return every file but the videos, with its bytes."""
    paths = [path for path in sorted(folder.rglob("*")) if path.is_file() and path.suffix != ".mp4"]
    return {str(path.relative_to(folder)): path.read_bytes() for path in paths}


def pictures(folder):
    """Return the decoded pictures of each episode and camera, in order."""
    dataset = Dataset(folder)
    return [
        np.stack(
            [picture.to_ndarray(format="rgb24") for picture in episode_pictures(*video, episode.rows, dataset.fps)]
        )
        for episode in dataset.episodes()
        for video in episode.videos.values()
    ]


def same(one, other):
    """Return whether two lists of arrays are the same."""
    return len(one) == len(other) and all(map(np.array_equal, one, other))


@pytest.fixture(scope="module")
def sets(filmed_bags, layout, tmp_path_factory):
    """Return, by format, datasets of the first bag, of the second one, of both."""
    folder = tmp_path_factory.mktemp("sets")
    made = {}
    for version in VERSIONS:
        chosen = Choices(layout=layout, version=version, least_rows=10)
        made[version] = tuple(
            build(bags, folder / f"{version}-{name}", chosen).folder
            for name, bags in (("a", filmed_bags[:1]), ("b", filmed_bags[1:]), ("both", filmed_bags))
        )
    return made


@pytest.mark.parametrize("version", VERSIONS)
def test_merged_datasets_are_what_would_have_been_built_of_all_bags(sets, tmp_path, version):
    """Rows, numbers, tasks, statistics and origin to the byte; pictures to the pixel; fit for training."""
    a, b, both = sets[version]
    shares = []
    made = merge([Dataset(a), Dataset(b)], tmp_path / "set", shares.append)
    assert facts(tmp_path / "set") == facts(both) and same(pictures(tmp_path / "set"), pictures(both))
    assert made.episodes == 2 and made.rows == Dataset(both).info["total_frames"] and shares == [0.5, 1.0]
    assert [f for f in check_dataset(Dataset(tmp_path / "set")).findings if f.level == "error"] == []
    assert [path.name for path in tmp_path.iterdir()] == ["set"]


@pytest.mark.parametrize("version", VERSIONS)
@pytest.mark.parametrize("number", [0, 1])
def test_an_episode_that_is_split_off_is_what_would_have_been_built_of_its_bag(sets, tmp_path, version, number):
    """But for what was left out of the other bag: that is told of both."""
    both = sets[version][2]
    split(Dataset(both), {number}, tmp_path / "set")
    mine, built = facts(tmp_path / "set"), facts(sets[version][number])
    origins = [json.loads(files.pop(PROVENANCE)) for files in (mine, built)]
    left_out = [origin.pop("left_out") for origin in origins]
    assert mine == built and origins[0] == origins[1] and set(left_out[0]) == set(left_out[1])
    assert (
        same(pictures(tmp_path / "set"), pictures(sets[version][number]))
        and check_dataset(Dataset(tmp_path / "set")).ok
    )


@pytest.mark.parametrize("version", VERSIONS)
def test_episodes_are_taken_in_their_order_and_renumbered(sets, tmp_path, version):
    """Of a dataset that was merged of one twice: of three episodes the first and the last."""
    _, b, both = sets[version]
    merge([Dataset(both), Dataset(b)], tmp_path / "three")
    split(Dataset(tmp_path / "three"), [2, 0], tmp_path / "two")
    assert facts(tmp_path / "two").keys() == facts(both).keys() and same(pictures(tmp_path / "two"), pictures(both))
    wanted, found = list(Dataset(both).episodes()), list(Dataset(tmp_path / "two").episodes())
    for one, other in zip(wanted, found, strict=True):
        assert one.number == other.number and one.tasks == other.tasks
        assert all(np.array_equal(one.columns[name], other.columns[name]) for name in one.columns)


def test_files_that_are_full_are_not_continued(sets, tmp_path, monkeypatch):
    """v3.0: an episode is found in the file where it lies, and cut there."""
    a, b, both = sets["v3.0"]
    monkeypatch.setattr(lerobot_videos, "VIDEO_MB", 0)
    merge([Dataset(a), Dataset(b)], tmp_path / "set")
    assert len(list((tmp_path / "set/videos").rglob("*.mp4"))) == 6
    split(Dataset(tmp_path / "set"), [1], tmp_path / "one")
    assert same(pictures(tmp_path / "one"), pictures(b)) and same(pictures(tmp_path / "set"), pictures(both))


def test_datasets_of_others_are_merged_too(sets, tmp_path):
    """Without a word on where they come from: none is made up. Their own times stay."""
    for name in ("x", "y"):
        shutil.copytree(sets["v2.1"][0], tmp_path / name)
        (tmp_path / name / PROVENANCE).unlink()
        path = tmp_path / name / "meta/info.json"
        path.write_text(json.dumps(json.loads(path.read_text()) | {"robot_type": "another"}))
    merge([Dataset(tmp_path / "x"), Dataset(tmp_path / "y")], tmp_path / "set")
    assert not (tmp_path / "set" / PROVENANCE).exists() and check_dataset(Dataset(tmp_path / "set")).ok
    assert Dataset(tmp_path / "set").info["robot_type"] == "another"


def test_choices_that_differ_are_not_told_of_both(sets, filmed_bags, layout, tmp_path):
    """But what the numbers and pictures are has to be the same."""
    a = sets["v2.1"][0]
    build(filmed_bags[:1], tmp_path / "b", Choices(layout=layout, least_rows=12, task="bow"))
    merge([Dataset(a), Dataset(tmp_path / "b")], tmp_path / "set")
    choices = json.loads((tmp_path / "set" / PROVENANCE).read_text())["choices"]
    assert "least_rows" not in choices and "task" not in choices and choices["fps"] == 45.0
    assert set(Dataset(tmp_path / "set").tasks().values()) == {"wave", "bow"}
    build(filmed_bags[:1], tmp_path / "c", Choices(layout=layout, least_rows=10, eyes="left_eyes"))
    with pytest.raises(Rejected, match=r"other eyes in meta/teleavatar\.json"):
        merge([Dataset(a), Dataset(tmp_path / "c")], tmp_path / "other")
    assert not (tmp_path / "other").exists()


def test_what_does_not_go_together_is_refused_by_name(sets, filmed_bags, layout, tmp_path):
    """Formats, rates, kinds of robots, features; a folder that holds something."""
    a, b, _ = sets["v2.1"]
    build(filmed_bags[:1], tmp_path / "slow", Choices(layout=layout, fps=20.0, least_rows=5))
    shutil.copytree(b, tmp_path / "other")
    path = tmp_path / "other/meta/info.json"
    info = json.loads(path.read_text())
    for change, why in (
        ({"fps": 20}, "do not go together: other rows per second"),
        ({"robot_type": "so100"}, "other robot_type"),
        (
            {"features": info["features"] | {"action": {"dtype": "float32", "shape": [2], "names": None}}},
            "other feature action",
        ),
    ):
        path.write_text(json.dumps(info | change))
        with pytest.raises(Rejected, match=why):
            merge([Dataset(a), Dataset(tmp_path / "other")], tmp_path / "set")
    with pytest.raises(Rejected, match="other format"):
        merge([Dataset(a), Dataset(sets["v3.0"][0])], tmp_path / "set")
    with pytest.raises(Rejected, match="is not empty"):
        merge([Dataset(a)], b)
    assert not (tmp_path / "set").exists()


@pytest.mark.parametrize(("numbers", "why"), [([2], "no episode 2: there are 2"), ([-1, 0], "no episode -1")])
def test_episodes_that_are_not_there_are_refused(sets, tmp_path, numbers, why):
    """Nothing is left behind."""
    with pytest.raises(Rejected, match=why):
        split(Dataset(sets["v2.1"][2]), numbers, tmp_path / "set")
    assert not list(tmp_path.iterdir())


def test_what_cannot_be_read_is_refused_and_nothing_is_left(sets, tmp_path):
    """A file that is gone, a video that is cut, statistics of pictures that are missing, two tasks in one episode."""
    for version, pattern in (("v2.1", "data/**/*.parquet"), ("v2.1", "videos/**/*.mp4"), ("v3.0", "videos/**/*.mp4")):
        shutil.copytree(sets[version][0], tmp_path / "set")
        next((tmp_path / "set").glob(pattern)).unlink()
        with pytest.raises(Rejected, match=r"cannot be (read|made)"):
            merge([Dataset(tmp_path / "set")], tmp_path / "out")
        shutil.rmtree(tmp_path / "set")
    for name, change, why in (
        ("episodes", lambda row: row["tasks"].append("bow"), "too many values to unpack"),
        ("episodes", lambda row: row.update(length=3), "no column of 3 numbers"),
        ("episodes_stats", lambda row: row["stats"].pop("observation.images.head_camera"), "KeyError"),
    ):
        shutil.copytree(sets["v2.1"][0], tmp_path / "set")
        path = tmp_path / f"set/meta/{name}.jsonl"
        row = json.loads(path.read_text())
        change(row)
        path.write_text(json.dumps(row) + "\n")
        with pytest.raises(Rejected, match=why):
            merge([Dataset(tmp_path / "set")], tmp_path / "out")
        shutil.rmtree(tmp_path / "set")
    assert not list(tmp_path.iterdir())


def test_a_video_is_cut_only_where_a_picture_stands_alone(sets):
    """Every second one does."""
    (episode,) = Dataset(sets["v3.0"][0]).episodes()
    path, _ = next(iter(episode.videos.values()))
    assert len(list(episode_pictures(path, 2 / 45, 5, 45.0))) == 5
    with pytest.raises(ValueError, match="does not stand alone"):
        list(episode_pictures(path, 1 / 45, 5, 45.0))
