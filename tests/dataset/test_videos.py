"""Tests of pictures in datasets: each row has the one that was newest at its time, in either format, and none is made up."""

from __future__ import annotations

import json
import os
import shutil
from dataclasses import replace

import av
import msgspec
import numpy as np
import pytest

from gateway.dataset import building, lerobot_videos
from gateway.dataset.building import PROVENANCE, Choices, build
from gateway.dataset.checking import check_dataset
from gateway.dataset.lerobot_reader import Dataset
from gateway.dataset.videos import IMAGES, STALE_NS, decodable, video_source
from gateway.errors import Rejected
from gateway.policy.policy_map import PRESETS, load_map
from gateway.robot.vector_layout import EYES
from gateway.video.decoding.views import VIEWS
from gateway.video.recording.index import Picture, index_path
from gateway.video.recording.take import Take
from tests.dataset.motion import BEGIN_NS, COUNT, FIRST_NS, PERIOD_NS, filmed, moving, taken
from tests.video.coded import grey_of, units

FPS = 45.0
CAMERAS = [IMAGES + camera for camera in EYES["vendor_openpi"]]


@pytest.fixture(scope="module")
def bags(tmp_path_factory):
    """Return two bags with pictures."""
    folder = tmp_path_factory.mktemp("bags")
    return [filmed(folder, "a"), filmed(folder, "b")]


def greys(path, begin_s, rows):
    """Return the mean luma of an episode's pictures, and their times from its begin [s]."""
    with av.open(str(path)) as file:
        pictures = list(file.decode(video=0))
    shown = [(float(p.pts * p.time_base), float(p.to_ndarray(format="yuv420p")[: p.height].mean())) for p in pictures]
    mine = [(at_s - begin_s, grey) for at_s, grey in shown if begin_s - 1e-6 <= at_s < begin_s + (rows - 0.5) / FPS]
    return np.array([grey for _, grey in mine]), np.array([at_s for at_s, _ in mine])


@pytest.mark.parametrize("version", ["v2.1", "v3.0"])
def test_each_row_has_the_picture_that_was_newest_at_its_time(bags, layout, tmp_path, version):
    """Of each camera; at exactly the row's time in the file; of two bags each its own."""
    built = build(bags, tmp_path / "set", Choices(layout=layout, version=version, fps=FPS))
    dataset = Dataset(tmp_path / "set")
    facts = json.loads((tmp_path / "set" / PROVENANCE).read_text())
    assert dataset.cameras == CAMERAS and built.left_out == {"row: no value of the cameras": 10}
    assert facts["views"] == EYES["vendor_openpi"]
    for episode, noted in zip(dataset.episodes(), facts["episodes"], strict=True):
        times_ns = noted["begin_ns"] + np.rint(np.arange(episode.rows) * 1e9 / FPS).astype(np.int64)
        expected = [grey_of(min(COUNT - 1, int((at_ns - FIRST_NS) // PERIOD_NS))) for at_ns in times_ns]
        for path, begin_s in episode.videos.values():
            seen, at_s = greys(path, begin_s, episode.rows)
            assert len(seen) == episode.rows and np.abs(at_s - np.arange(episode.rows) / FPS).max() < 1e-5
            assert np.abs(seen - expected).max() < 4.0
    assert [f for f in check_dataset(dataset).findings if f.level == "error"] == []


def test_videos_are_the_same_bytes_on_a_host_with_one_processor(bags, layout, tmp_path):
    """As on this one, whatever it has."""
    made = {}
    processors = os.sched_getaffinity(0)
    for name, allowed in (("all", processors), ("one", {min(processors)})):
        os.sched_setaffinity(0, allowed)  # of this thread and those that it begins
        try:
            folder = build(bags[:1], tmp_path / name, Choices(layout=layout)).folder
        finally:
            os.sched_setaffinity(0, processors)
        made[name] = [path.read_bytes() for path in sorted(folder.rglob("*.mp4"))]
    assert len(made["one"]) == 3 and made["one"] == made["all"]


def test_videos_are_coded_without_what_reads_memory_behind_the_picture(bags, layout, tmp_path):
    """As x264's macroblock tree does with AVX-512, where a row is no multiple of eight macroblocks: x264 notes its settings."""
    folder = build(bags[:1], tmp_path / "set", Choices(layout=layout)).folder
    videos = [path.read_bytes() for path in sorted(folder.rglob("*.mp4"))]
    assert len(videos) == 3 and all(b" mbtree=0 " in video and b" threads=1 " in video for video in videos)


def test_statistics_of_pictures_are_of_each_colour_from_0_to_1(bags, layout, tmp_path):
    """In the shape that LeRobot has."""
    build(bags, tmp_path / "set", Choices(layout=layout, version="v3.0"))
    stats = json.loads((tmp_path / "set/meta/stats.json").read_text())[CAMERAS[0]]
    assert np.shape(stats["mean"]) == (3, 1, 1) and set(stats) == {"min", "max", "mean", "std", "count"}
    assert np.all(0.0 <= np.array(stats["min"])) and np.all(np.array(stats["max"]) <= 1.0)
    assert np.all(np.array(stats["min"]) < np.array(stats["mean"])) and np.all(np.array(stats["std"]) > 0.05)
    info = json.loads((tmp_path / "set/meta/info.json").read_text())
    assert info["features"][CAMERAS[0]]["shape"] == [120, 120, 3] and info["features"][CAMERAS[1]]["shape"] == [
        50,
        80,
        3,
    ]


def test_a_hole_in_the_pictures_ends_an_episode(layout, tmp_path):
    """Damaged pictures count as none; one that is missing for less than a fifth of a second is held."""

    def damaged(first, last):
        return lambda picture: msgspec.structs.replace(picture, clean=not first <= picture.n < last)

    short, long = filmed(tmp_path, "short", damaged(40, 45)), filmed(tmp_path, "long", damaged(36, 50))
    one = build([short], tmp_path / "one", Choices(layout=layout, least_rows=10))
    assert one.episodes == 1
    two = build([long], tmp_path / "two", Choices(layout=layout, least_rows=10))
    gap = round((15 * PERIOD_NS - STALE_NS) / PERIOD_NS)
    assert two.episodes == 2 and two.left_out["row: no value of the cameras"] == 5 + gap
    assert check_dataset(Dataset(tmp_path / "two")).ok


def short_of(folder, count):
    """Return a recording that holds less pictures than its index names, as after a recorder that was killed."""
    whole, short = taken(folder / "whole.mkv"), taken(folder / "short.mkv", count=count)
    shutil.copy(index_path(whole), index_path(short))
    return short


def longest_still(folder):
    """Return how many rows in a row show the same picture at most, in any episode's first camera."""
    longest = 0
    for episode in Dataset(folder).episodes():
        shown = greys(*episode.videos[CAMERAS[0]], episode.rows)[0]
        is_new = np.concatenate(([True], np.abs(np.diff(shown)) > 3.5, [True]))
        longest = max(longest, int(np.diff(np.flatnonzero(is_new)).max()))
    return longest


def test_a_few_pictures_that_cannot_be_decoded_are_held_over(layout, tmp_path, monkeypatch):
    """For less than a fifth of a second; nothing is decoded twice for them."""
    monkeypatch.setattr(building, "decodable", None)
    bag = moving(tmp_path / "bag", 1.9)
    built = build([bag], tmp_path / "set", Choices(layout=layout), videos=[short_of(tmp_path, COUNT - 5)])
    assert built.episodes == 1 and built.left_out == {"row: no value of the cameras": 5}
    assert check_dataset(Dataset(tmp_path / "set")).ok and 5 < longest_still(tmp_path / "set") < 9


def test_pictures_that_cannot_be_decoded_to_the_end_end_the_episode(layout, tmp_path):
    """As many as would be missing: no row has one that is older than a fifth of a second, and it is told."""
    bag, count = moving(tmp_path / "bag", 2.0), COUNT - 20
    built = build([bag], tmp_path / "set", Choices(layout=layout), videos=[short_of(tmp_path, count)])
    last_s = (FIRST_NS - BEGIN_NS + (count - 1) * PERIOD_NS + STALE_NS) / 1e9
    assert built.episodes == 1 and built.rows == int(last_s * FPS) + 1 - 5
    assert built.left_out == {"row: no value of the cameras": 90 - built.rows}
    assert check_dataset(Dataset(tmp_path / "set")).ok and longest_still(tmp_path / "set") <= 10


def test_pictures_that_cannot_be_decoded_in_between_end_the_episode(layout, tmp_path):
    """A block of the file that cannot be read: another one begins behind it. Where nothing is left, it is refused."""
    bag = moving(tmp_path / "bag", 2.0)
    path = taken(tmp_path / "take.mkv")
    data = bytearray(path.read_bytes())
    begin, size = len(data) // 3, len(data) // 5
    data[begin : begin + size] = bytes(size)
    path.write_bytes(data)
    built = build([bag], tmp_path / "set", Choices(layout=layout, least_rows=10), videos=[path])
    assert built.episodes == 2 and built.left_out["row: no value of the cameras"] > 5 + 10
    assert check_dataset(Dataset(tmp_path / "set")).ok and longest_still(tmp_path / "set") <= 10
    path.write_bytes(taken(tmp_path / "other.mkv", count=1).read_bytes())
    lines = index_path(path).read_bytes().splitlines(keepends=True)
    index_path(path).write_bytes(b"".join([lines[0], *lines[2:]]))
    with pytest.raises(Rejected, match="no picture of it can be decoded"):
        build([bag], tmp_path / "none", Choices(layout=layout, least_rows=10), videos=[path])


def test_no_picture_predicted_from_one_that_is_missing_is_shown(layout, tmp_path):
    """Whether the index knows that it is damaged, or only the decoder."""
    path, other = taken(tmp_path / "take.mkv"), Take(tmp_path / "other.mkv")
    for unit in units(COUNT):
        if unit.seq != 13:
            other.write(unit)
    other.end("it was ended")
    told = video_source(other.path, EYES["vendor_openpi"])
    other.path.replace(path)
    untold = video_source(path, EYES["vendor_openpi"])
    assert list(told.pts // 2000) == [n for n in range(COUNT) if not 13 <= n < 20]
    assert 14 in untold.pts // 2000
    assert list(decodable(untold).pts) == list(told.pts)


def test_another_file_is_begun_where_one_is_full_or_the_pictures_are_others(bags, layout, tmp_path, monkeypatch):
    """v3.0 puts several episodes into one."""
    build(bags, tmp_path / "one", Choices(layout=layout, version="v3.0"))
    assert len(list((tmp_path / "one/videos" / CAMERAS[0]).rglob("*.mp4"))) == 1
    monkeypatch.setattr(lerobot_videos, "VIDEO_MB", 0)
    build(bags, tmp_path / "two", Choices(layout=layout, version="v3.0"))
    assert len(list((tmp_path / "two/videos" / CAMERAS[0]).rglob("*.mp4"))) == 2
    assert check_dataset(Dataset(tmp_path / "two")).ok


@pytest.mark.parametrize("version", ["v2.1", "v3.0"])
def test_faults_of_videos_are_found(bags, layout, tmp_path, version):
    """A file that is gone, cut, of another size, or has a picture too few."""
    folder = build(bags, tmp_path / "set", Choices(layout=layout, version=version)).folder
    paths = [sorted((folder / "videos").rglob(f"*{camera}*/**/*.mp4"))[-1] for camera in CAMERAS]
    paths[0].unlink()
    paths[1].write_bytes(paths[1].read_bytes()[:500])
    remuxed(paths[2], more=-4)
    found = [(f.where, f.message) for f in check_dataset(Dataset(folder)).findings if f.level == "error"]
    for camera, why in zip(CAMERAS, ("cannot be decoded", "cannot be decoded", "no picture for row"), strict=True):
        assert any(where.endswith(camera) and why in message for where, message in found), found
    info = json.loads((folder / "meta/info.json").read_text())
    info["features"][CAMERAS[2]]["shape"] = [50, 81, 3]
    (folder / "meta/info.json").write_text(json.dumps(info))
    assert any(
        "pictures are 80 x 50, written down is 81 x 50" in f.message for f in check_dataset(Dataset(folder)).findings
    )


def test_pictures_that_no_row_has_are_found(bags, layout, tmp_path):
    """Where each episode has a file of its own: whoever put them there has rows and pictures of two recordings."""
    folder = build(bags, tmp_path / "set", Choices(layout=layout)).folder
    rows = [episode.rows for episode in Dataset(folder).episodes()]
    remuxed(sorted((folder / "videos").rglob("*.mp4"))[0], more=2)
    found = [f for f in check_dataset(Dataset(folder)).findings if f.level == "error"]
    assert [f.message for f in found] == [f"{rows[0] + 2} pictures for {rows[0]} rows"]


def remuxed(path, more):
    """Repeat the last pictures of a file behind it, so many; or take as many out."""
    whole = path.with_suffix(".whole")
    path.rename(whole)
    with av.open(str(whole), format="mp4") as source, av.open(str(path), "w") as out:
        stream = out.add_stream_from_template(source.streams.video[0])
        packets = [packet for packet in source.demux(video=0) if packet.pts is not None]
        for packet in packets[: len(packets) + min(more, 0)]:
            packet.stream = stream
            out.mux(packet)
        for packet in packets[-more:] if more > 0 else ():
            packet.pts = packet.dts = packet.pts + more * packet.duration
            out.mux(packet)
    whole.unlink()


def test_what_is_no_recording_of_the_cameras_is_refused(layout, tmp_path):
    """Without an index nobody knows when its pictures came."""
    bag = moving(tmp_path / "bag", 1.0)
    path = taken(tmp_path / "take.mkv", lambda picture: msgspec.structs.replace(picture, clean=False), 20)
    with pytest.raises(Rejected, match="has no undamaged picture"):
        build([bag], tmp_path / "set", Choices(layout=layout), videos=[path])
    index_path(path).unlink()
    with pytest.raises(Rejected, match="has no index that can be read"):
        video_source(path, {})
    rubbish = taken(tmp_path / "rubbish.mkv")
    rubbish.write_bytes(b"rubbish" * 1000)
    with pytest.raises(Rejected, match="cannot be used"):
        build([bag], tmp_path / "set", Choices(layout=layout), videos=[rubbish])


def test_either_each_bag_has_a_recording_of_the_cameras_or_none_has(bags, layout, tmp_path):
    """And one only, unless it is named."""
    bare = moving(tmp_path / "bare", 1.0)
    for chosen, videos in (([bags[0], bare], []), (bags, [bags[0] / "video.mkv"])):
        with pytest.raises(Rejected, match="1 recordings of the cameras for 2 bags"):
            build(chosen, tmp_path / "set", Choices(layout=layout), videos=videos)
    two = filmed(tmp_path, "two")
    taken(two / "other.mkv")
    with pytest.raises(Rejected, match="more than one recording of the cameras"):
        build([two], tmp_path / "set", Choices(layout=layout))
    build([two], tmp_path / "set", Choices(layout=layout), videos=[two / "other.mkv"])


def test_pictures_that_came_at_one_instant_count_once(tmp_path):
    """The clock of the recording host was set back: what came before counts until it is reached again."""

    def back(picture: Picture) -> Picture:
        step_ns = PERIOD_NS * 3 if picture.n > 9 else 0
        return msgspec.structs.replace(picture, arrival_wall_ns=picture.arrival_wall_ns - step_ns)

    source = video_source(taken(tmp_path / "take.mkv", back), {})
    assert np.all(np.diff(source.times_ns) > 0) and len(source.pts) == COUNT - 3
    assert replace(source, path=tmp_path).pts is source.pts


def test_a_dataset_and_a_policy_that_learnt_from_it_see_the_same_views():
    """What was learnt from is what is shown; LeRobot's own keys are those of the vendor's layout, by the dataset's names."""
    twins = {**{name: name for name in EYES}, "lerobot": "vendor_openpi"}
    assert set(PRESETS) == set(twins)
    for preset, views in ((preset, EYES[name]) for preset, name in twins.items()):
        shown = load_map(preset).observation.images
        assert {key.removeprefix(IMAGES).rpartition("/")[2]: view for key, view in shown.items()} == views
        assert preset != "lerobot" or all(key.startswith(IMAGES) for key in shown)
        assert set(views.values()) <= set(VIEWS)
