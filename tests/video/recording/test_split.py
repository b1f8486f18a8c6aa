"""Rules of `gateway.video.recording.split`, `view_files`, `coding` and `growing`: six files, exact times, damage told."""

from __future__ import annotations

import json
import threading
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

import av
import numpy as np
import pytest

from gateway.errors import Rejected
from gateway.process.growing import Growing
from gateway.video.decoding.views import VIEWS, pixel_box
from gateway.video.hevc.access_unit import AccessUnit
from gateway.video.recording.coding import Coding
from gateway.video.recording.container import ticks_of
from gateway.video.recording.index import index_path
from gateway.video.recording.split import DAMAGED, Splitter, split_folder
from gateway.video.recording.take import Take
from gateway.video.recording.view_files import ViewFiles, view_paths
from tests.e2e.system import wait_for
from tests.video.coded import GOP, HEIGHT, WIDTH, units


def recorded(path: Path, pictures: Iterable[AccessUnit]) -> Path:
    """Record pictures."""
    take = Take(path)
    for unit in pictures:
        take.write(unit)
    take.end("it was ended")
    return path


def lumas_of(path: Path) -> list[np.ndarray]:
    """Return the decoded luma of a file's pictures."""
    with av.open(str(path)) as file:
        return [picture.to_ndarray(format="yuv420p")[: picture.height] for picture in file.decode(video=0)]


def times_of(path: Path) -> list[int]:
    """Return when the pictures of a file are shown [ticks]."""
    with av.open(str(path)) as file:
        return [ticks_of(p.pts, p.time_base) for p in file.decode(video=0) if p.pts is not None and p.time_base]


CODINGS = [
    Coding(),
    Coding(is_live=True),
    Coding(is_all_intra=True),
    Coding(codec="h265"),
    Coding(codec="h265", is_all_intra=True),
]


@pytest.mark.parametrize("coding", CODINGS, ids=str)
@pytest.mark.parametrize("name", ["take.mkv", "take.mp4"])
def test_each_view_is_its_part_of_the_composite_at_the_same_times(tmp_path: Path, name: str, coding: Coding) -> None:
    """Six files by the names of §5.2; each picture is the crop of the one that was recorded, and stands where that stood."""
    start = units()[0].rtp_time
    pictures = [replace(unit, rtp_time=start + 2003 * unit.seq + 500 * (unit.seq % 3)) for unit in units()]
    recording = recorded(tmp_path / name, pictures)
    split = Splitter(recording, split_folder(recording), coding=coding).run()
    assert set(split.files) == set(VIEWS)
    composites = lumas_of(recording)
    for view, path in split.files.items():
        assert path == tmp_path / "take" / f"{view}.mp4"
        x0, y0, x1, y1 = pixel_box(view, WIDTH, HEIGHT)
        crops = lumas_of(path)
        assert len(crops) == len(composites) == 40
        for crop, composite in zip(crops, composites, strict=True):
            assert crop.shape == (y1 - y0, x1 - x0)
            assert np.abs(crop.astype(int) - composite[y0:y1, x0:x1]).max() <= 3
        assert times_of(path) == [unit.rtp_time - start for unit in pictures]
    assert (split.pictures, split.left_out, split.is_whole, split.damaged) == (40, 0, True, ())


@pytest.mark.parametrize("codec", ["h264", "h265"])
def test_all_intra_means_that_each_picture_stands_alone(tmp_path: Path, codec: str) -> None:
    """Any of them can be decoded without another; otherwise, few can."""
    recording = recorded(tmp_path / "take.mkv", units())
    for is_all_intra in (True, False):
        folder = tmp_path / str(is_all_intra)
        coding = Coding(codec=codec, is_all_intra=is_all_intra)
        path = Splitter(recording, folder, ["head_left_eye"], coding).run().files["head_left_eye"]
        with av.open(str(path)) as file:
            assert file.streams.video[0].codec_context.name == {"h264": "h264", "h265": "hevc"}[codec]
            keys = [packet.is_keyframe for packet in file.demux(video=0) if packet.size]
        assert all(keys) is is_all_intra


def test_only_the_views_that_were_asked_for_are_written(tmp_path: Path) -> None:
    """In any order."""
    recording = recorded(tmp_path / "take.mkv", units())
    Splitter(recording, tmp_path / "some", ["left_wrist_left_eye", "head_right_eye"]).run()
    found = {path.name for path in (tmp_path / "some").iterdir()}
    assert found == {"left_wrist_left_eye.mp4", "head_right_eye.mp4", DAMAGED}


def test_damaged_pictures_are_listed_beside_the_views(tmp_path: Path) -> None:
    """Those that lost packets, those predicted from them, and those that no decoder can show."""
    pictures = list(units())
    pictures[13] = replace(pictures[13], data=pictures[13].data[:30], is_intact=False, lost=((901, 902),))
    pictures[25] = replace(pictures[25], data=b"\0\0\0\1\x02\x01", is_intact=False, lost=((950, 950),))
    recording = recorded(tmp_path / "take.mkv", pictures)
    split = Splitter(recording, tmp_path / "out", ["head_left_eye"]).run()
    listed = json.loads((tmp_path / "out" / DAMAGED).read_text())["damaged"]
    by_number = {one["pts"] // 2000: one for one in listed}
    assert list(by_number) == [*range(13, 2 * GOP), *range(25, 3 * GOP)]
    assert (by_number[13]["is_intact"], by_number[13]["lost"]) == (False, [[901, 902]])
    assert (by_number[14]["is_intact"], by_number[14]["lost"]) == (True, [])
    assert by_number[25]["is_there"] is False
    shown = [pts // 2000 for pts in times_of(split.files["head_left_eye"])]
    assert [n for n, one in by_number.items() if not one["is_there"]] == [n for n in range(40) if n not in shown]


@pytest.mark.parametrize("gop", [GOP, 40])
def test_the_loss_of_a_whole_picture_costs_no_other(tmp_path: Path, gop: int) -> None:
    """Those predicted from it are shown as they come out and listed, also where no key picture follows."""
    pictures = [replace(unit, lost=((901, 909),) * (unit.seq == 14)) for unit in units(gop=gop) if unit.seq != 13]
    recording = recorded(tmp_path / "take.mkv", pictures)
    split = Splitter(recording, tmp_path / "out", ["head_left_eye"]).run()
    assert split.damaged is not None
    assert times_of(split.files["head_left_eye"]) == [2000 * unit.seq for unit in pictures]
    assert [one.pts // 2000 for one in split.damaged] == list(range(14, 20 if gop == GOP else 40))
    assert all(one.is_there for one in split.damaged)


def test_what_is_decoded_from_a_block_that_cannot_be_read_is_listed(tmp_path: Path) -> None:
    """Its index knows of no damage, the decoder does."""
    recording = recorded(tmp_path / "take.mkv", units())
    with av.open(str(recording)) as file:
        thirteenth = [bytes(packet) for packet in file.demux(video=0)][13]
    recording.write_bytes(recording.read_bytes().replace(thirteenth, bytes(len(thirteenth))))
    split = Splitter(recording, tmp_path / "out", ["head_left_eye"]).run()
    assert split.damaged is not None
    assert [(one.pts // 2000, one.is_there) for one in split.damaged] == [(n, n > 13) for n in range(13, 20)]


def test_an_end_that_cannot_be_decoded_is_listed(tmp_path: Path) -> None:
    """As of a recorder that was killed: its index goes on after the last picture that is there."""
    recording, longer = recorded(tmp_path / "take.mkv", units()[:35]), recorded(tmp_path / "more.mkv", units())
    index_path(recording).write_bytes(index_path(longer).read_bytes())
    split = Splitter(recording, tmp_path / "out", ["head_left_eye"]).run()
    assert split.damaged is not None
    assert [(one.pts // 2000, one.is_there) for one in split.damaged] == [(n, False) for n in range(35, 40)]


def test_without_an_index_nobody_knows_what_is_damaged(tmp_path: Path) -> None:
    """It is said, not guessed."""
    recording = recorded(tmp_path / "take.mkv", units())
    index_path(recording).unlink()
    split = Splitter(recording, tmp_path / "out", ["head_left_eye"]).run()
    assert split.damaged is None
    assert split.pictures == 40


@pytest.mark.parametrize("name", ["take.mkv", "take.mp4"])
@pytest.mark.parametrize("part", [0.4, 0.6, 0.97])
def test_a_recording_that_was_cut_off_is_split_as_far_as_it_goes(tmp_path: Path, name: str, part: float) -> None:
    """As a killed recorder, or a host without power, leaves it."""
    recording = recorded(tmp_path / name, units(200))
    whole = recording.read_bytes()
    recording.write_bytes(whole[: int(len(whole) * part)])
    split = Splitter(recording, tmp_path / "out", ["head_left_eye"]).run()
    assert split.pictures >= 200 * part - 25
    assert times_of(split.files["head_left_eye"]) == [2000 * n for n in range(split.pictures)]


@pytest.mark.parametrize("name", ["take.mkv", "take.mp4"])
def test_a_recording_is_followed_while_it_is_written(tmp_path: Path, name: str) -> None:
    """It is split as it grows, and ends when it ends."""
    recording, found = tmp_path / name, []
    take = Take(recording)
    for unit in units(200)[:100]:
        take.write(unit)
    splitter = Splitter(recording, tmp_path / "out", ["head_left_eye"])
    thread = threading.Thread(target=lambda: found.append(splitter.run()))
    thread.start()
    wait_for(lambda: splitter.pictures >= 50, "pictures to be split")
    assert 0 <= splitter.position_ticks < 100 * 2000
    assert thread.is_alive()
    for unit in units(200)[100:]:
        take.write(unit)
    take.end("it was ended")
    thread.join(30)
    assert found[0].pictures == 200
    assert times_of(found[0].files["head_left_eye"]) == [2000 * n for n in range(200)]


def test_a_cancelled_split_leaves_playable_files_of_what_it_did(tmp_path: Path) -> None:
    """Also while it waits for a recording to grow."""
    recording, found = tmp_path / "take.mkv", []
    take = Take(recording)
    for unit in units(200)[:100]:
        take.write(unit)
    splitter = Splitter(recording, tmp_path / "out", ["head_left_eye"])
    thread = threading.Thread(target=lambda: found.append(splitter.run()))
    thread.start()
    wait_for(lambda: splitter.pictures >= 50, "pictures to be split")
    splitter.cancel()
    thread.join(30)
    take.end("it was ended")
    assert not found[0].is_whole
    assert len(times_of(found[0].files["head_left_eye"])) == found[0].pictures >= 50


def test_pictures_of_another_size_are_left_out_and_counted(tmp_path: Path) -> None:
    """A file has one size; a new sender may have another."""
    files = ViewFiles(view_paths(tmp_path, ["head_left_eye"]), Coding())
    assert files.write(av.VideoFrame(WIDTH, HEIGHT, "yuv420p"), 0)
    assert not files.write(av.VideoFrame(WIDTH * 2, HEIGHT, "yuv420p"), 2000)
    assert files.write(av.VideoFrame(WIDTH, HEIGHT, "yuv420p"), 4000)
    files.close()
    assert times_of(tmp_path / "head_left_eye.mp4") == [0, 4000]


def test_nothing_is_overwritten(tmp_path: Path) -> None:
    """A second split of a recording needs a folder of its own."""
    recording = recorded(tmp_path / "take.mkv", units())
    Splitter(recording, tmp_path / "out", ["head_left_eye"]).run()
    with pytest.raises(Rejected, match="head_left_eye\\.mp4 is there") as refused:
        Splitter(recording, tmp_path / "out")
    assert "--out" in refused.value.hint


@pytest.mark.parametrize(
    ("ask", "words"),
    [
        pytest.param({"views": ["head"]}, "no view head", id="unknown view"),
        pytest.param({"views": []}, "no view", id="no view"),
        pytest.param({"recording": "none.mkv"}, "there is no such file", id="no recording"),
    ],
)
def test_what_cannot_be_split_is_refused_before_it_begins(tmp_path: Path, ask: dict[str, object], words: str) -> None:
    """Bad input tells the remedy."""
    recorded(tmp_path / "take.mkv", units())
    recording = tmp_path / str(ask.get("recording", "take.mkv"))
    with pytest.raises(Rejected, match=words) as refused:
        Splitter(recording, tmp_path / "out", ask.get("views", VIEWS))  # type: ignore[arg-type]
    assert refused.value.hint


def test_a_file_that_is_no_recording_is_refused_in_words(tmp_path: Path) -> None:
    """Not with a trace."""
    (tmp_path / "take.mkv").write_bytes(b"no video" * 100)
    with pytest.raises(Rejected, match=r"take\.mkv cannot be split"):
        Splitter(tmp_path / "take.mkv", tmp_path / "out").run()


def test_an_unknown_codec_is_refused_with_those_there_are() -> None:
    """Bad input tells the remedy."""
    with pytest.raises(Rejected, match="vp9") as refused:
        Coding(codec="vp9")
    assert "h264" in refused.value.hint


def test_a_complete_file_does_not_seem_to_grow(tmp_path: Path) -> None:
    """The claim ends with its holder."""
    take = Take(tmp_path / "take.mkv")
    file = Growing(tmp_path / "take.mkv")
    assert file.is_growing
    take.write(units()[0])
    take.end("it was ended")
    assert not file.is_growing
    assert len(file.read(1 << 20)) > 100
    assert file.read(100) == b""
    file.close()
