"""Tests of the robot's own videos: each row has the picture of its instant, of the eye that is asked for."""

from __future__ import annotations

import json

import numpy as np
import pytest
from rosbags.rosbag2 import StoragePlugin

from gateway.dataset.bag_videos import TOPICS, bag_pictures
from gateway.dataset.building import PROVENANCE, Choices, build
from gateway.dataset.checking import check_dataset
from gateway.dataset.lerobot_reader import Dataset
from gateway.dataset.lerobot_videos import episode_pictures
from gateway.dataset.videos import IMAGES
from gateway.errors import Rejected
from gateway.robot.vector_layout import EYES
from tests.dataset.motion import BEGIN_NS, filmed, moving
from tests.dataset.packets import GOP, PERIOD_NS, RIGHT, SIZES, vendor_bag
from tests.video.coded import grey_of

FPS = 45.0


def seen(folder):
    """Return of each camera the mean luma of each row's picture, and each row's time after the bag's begin [ns]."""
    dataset = Dataset(folder)
    (episode,) = dataset.episodes()
    begin_ns = json.loads((folder / PROVENANCE).read_text())["episodes"][0]["begin_ns"] - BEGIN_NS
    greys = {
        name.removeprefix(IMAGES): [
            float(picture.to_ndarray(format="yuv420p")[: picture.height].mean())
            for picture in episode_pictures(*video, episode.rows, FPS)
        ]
        for name, video in episode.videos.items()
    }
    return greys, begin_ns + np.rint(np.arange(episode.rows) * 1e9 / FPS).astype(np.int64)


@pytest.mark.parametrize("plugin", [StoragePlugin.MCAP, StoragePlugin.SQLITE3])
@pytest.mark.parametrize("eyes", list(EYES))
def test_each_row_has_the_picture_of_its_instant_of_the_eye_that_is_asked_for(layout, tmp_path, plugin, eyes):
    """By the packets' stamps, though they came 30 ms late; of each camera the half that shows the view."""
    bag = vendor_bag(tmp_path / "bag", plugin)
    build([bag], tmp_path / "set", Choices(layout=layout, fps=FPS, least_rows=10, eyes=eyes))
    greys, times_ns = seen(tmp_path / "set")
    assert list(greys) == list(EYES[eyes]) and len(times_ns) > 30
    for camera, view in EYES[eyes].items():
        bright = RIGHT if view.endswith("right_eye") else 0
        for grey, at_ns in zip(greys[camera], times_ns, strict=True):
            near = {int((at_ns + off) // PERIOD_NS) for off in (-2_000_000, 2_000_000)}
            assert any(abs(grey - (grey_of(n) - 20 + bright)) < 4.0 for n in near), (camera, at_ns)
    assert Dataset(tmp_path / "set").features[IMAGES + "head_camera"]["shape"] == [64, 64, 3]
    assert [f for f in check_dataset(Dataset(tmp_path / "set")).findings if f.level == "error"] == []


def test_rows_begin_with_the_first_picture_that_can_be_decoded(layout, tmp_path):
    """A bag that was begun between two pictures that stand alone; what is broken or cut in it is passed over."""
    bag = vendor_bag(tmp_path / "bag", first=3)
    build([bag], tmp_path / "set", Choices(layout=layout, fps=FPS, least_rows=10))
    _, times_ns = seen(tmp_path / "set")
    assert 0 <= times_ns[0] - GOP * PERIOD_NS < 2 * PERIOD_NS
    pictures = bag_pictures(bag, TOPICS["head"])
    assert next(pictures)[1] == GOP - 3
    pictures.close()


@pytest.mark.parametrize(("broken", "episodes", "missing"), [(range(23, 27), 1, 0), (range(12, 27), 2, 7)])
def test_packets_that_cannot_be_decoded_end_an_episode_where_they_are_many(layout, tmp_path, broken, episodes, missing):
    """Less than a fifth of a second is held over; more is no picture, in no row, and is told."""
    bag = vendor_bag(tmp_path / "bag", broken=broken, topics=[TOPICS["head"]])
    built = build([bag], tmp_path / "set", Choices(layout=layout, fps=FPS, least_rows=5))
    left_out = built.left_out.get(f"row: no value of {TOPICS['head']}", 0)
    assert built.episodes == episodes and left_out == missing
    assert [f for f in check_dataset(Dataset(tmp_path / "set")).findings if f.level == "error"] == []


def test_a_picture_with_a_stamp_before_those_of_earlier_ones_counts_as_none(layout, tmp_path):
    """It would stand for all of them until its own number is reached."""
    bag = vendor_bag(tmp_path / "bag", early=[31], topics=[TOPICS["head"]])
    built = build([bag], tmp_path / "set", Choices(layout=layout, fps=100.0))
    assert built.episodes == 1 and built.rows > 80 and built.left_out == {}


def test_h264_and_names_of_encoders_are_understood(layout, tmp_path):
    """As older recorders write them; one camera alone is one camera."""
    bag = vendor_bag(tmp_path / "bag", topics=[TOPICS["head"]], encoding="libx264")
    build([bag], tmp_path / "set", Choices(layout=layout, fps=FPS, least_rows=10))
    assert Dataset(tmp_path / "set").cameras == [IMAGES + "head_camera"]


def test_a_picture_of_one_eye_is_taken_whole(layout, tmp_path, monkeypatch):
    """Only what is twice as wide as high is of both."""
    monkeypatch.setitem(SIZES, TOPICS["head"], (64, 64))
    bag = vendor_bag(tmp_path / "bag", topics=[TOPICS["head"]])
    build([bag], tmp_path / "set", Choices(layout=layout, fps=FPS, least_rows=10))
    assert Dataset(tmp_path / "set").features[IMAGES + "head_camera"]["shape"] == [64, 64, 3]


@pytest.mark.parametrize(
    ("encoding", "why"), [("hevc", "no picture of .* can be decoded"), ("theora2", "no decoder of")]
)
def test_what_cannot_be_decoded_is_refused(layout, tmp_path, encoding, why):
    """Not one picture that stands alone; a codec that nobody has."""
    bag = vendor_bag(tmp_path / "bag", count=GOP, first=1, topics=[TOPICS["head"]], encoding=encoding)
    with pytest.raises(Rejected, match=why):
        build([bag], tmp_path / "set", Choices(layout=layout, least_rows=10))


def test_bags_of_other_cameras_are_not_put_together(layout, tmp_path):
    """Nor one with pictures and one without; a recording beside a bag counts before what is in it."""
    with pytest.raises(Rejected, match=r"other cameras: .*bag: none"):
        bags = [vendor_bag(tmp_path / "one"), moving(tmp_path / "bag", 0.9)]
        build(bags, tmp_path / "set", Choices(layout=layout, least_rows=10))
    bag = filmed(tmp_path, "filmed", count=40, seconds=0.9)
    build([bag], tmp_path / "set", Choices(layout=layout, least_rows=10))
    assert Dataset(tmp_path / "set").features[IMAGES + "head_camera"]["shape"] == [120, 120, 3]
