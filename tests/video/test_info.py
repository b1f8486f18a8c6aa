"""Rules of `gateway.cli.cameras.info` and `measures`: what a recording holds, from the file, and honest about the rest."""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

import pytest

from gateway.cli.cameras.info import info_of, lines, show_info
from gateway.errors import Rejected
from gateway.video.hevc.access_unit import AccessUnit
from gateway.video.recording.index import Picture, index_path
from gateway.video.recording.measures import arrival_of, stretches, timing_of
from gateway.video.recording.take import Take
from tests.video.coded import GOP, units


def recorded(path: Path, pictures: Iterable[AccessUnit]) -> Path:
    """Record pictures."""
    take = Take(path, "10.0.0.2")
    for unit in pictures:
        take.write(unit)
    take.end("it was ended")
    return path


@pytest.mark.parametrize("name", ["take.mkv", "take.mp4"])
def test_a_recording_is_told_from_its_file_and_its_index(tmp_path: Path, name: str) -> None:
    """Duration, measured rate, size, codec, damage."""
    pictures = list(units())
    pictures[13] = replace(pictures[13], is_intact=False, lost=((901, 902),))
    del pictures[25]
    info = info_of(recorded(tmp_path / name, pictures))
    assert (info.codec, info.width, info.height, info.key_pictures) == ("hevc", 160, 340, 4)
    assert info.timing.pictures == 39
    assert info.timing.duration_s == pytest.approx(39 / 45)
    assert info.timing.interval_max_ms == pytest.approx(2000 / 45)
    assert info.size_bytes == (tmp_path / name).stat().st_size
    assert (info.robot, info.senders, info.ended, info.is_growing) == ("10.0.0.2", 1, "it was ended", False)
    assert (info.missing, info.dropped) == (1, 0)
    assert info.damaged == 7 + 4
    assert [(one.pictures, one.lost_packets) for one in info.stretches] == [(7, 2), (4, 0)]
    assert info.stretches[0].first_s == pytest.approx(13 / 45)
    text = "\n".join(lines(info))
    assert "11 of 39 pictures" in text
    assert "10.0.0.2" in text


def test_json_has_the_same(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """For scripts."""
    recording = recorded(tmp_path / "take.mkv", units())
    show_info(recording, as_json=True)
    found = json.loads(capsys.readouterr().out)
    assert found["timing"]["fps"] == pytest.approx(45)
    assert found["stretches"] == []
    show_info(recording, as_json=False)
    assert "45.000 fps" in capsys.readouterr().out


def test_without_an_index_damage_is_unknown(tmp_path: Path) -> None:
    """It is said, not guessed."""
    recording = recorded(tmp_path / "take.mkv", units())
    index_path(recording).unlink()
    info = info_of(recording)
    assert info.index is None
    assert info.timing.pictures == 40
    assert "unknown" in "\n".join(lines(info))


def test_of_a_killed_recorder_only_what_is_in_the_file_counts(tmp_path: Path) -> None:
    """Its index may name pictures that never reached the disk."""
    recording = recorded(tmp_path / "take.mkv", units(200))
    whole = recording.read_bytes()
    recording.write_bytes(whole[: len(whole) // 2])
    index = index_path(recording)
    index.write_bytes(index.read_bytes().rpartition(b'{"line":"end"')[0])
    info = info_of(recording)
    assert 70 <= info.timing.pictures <= 110
    assert info.missing == 0
    assert "killed" in "\n".join(lines(info))


def test_a_recording_that_goes_on_is_told_as_such(tmp_path: Path) -> None:
    """What is in it by now."""
    take = Take(tmp_path / "take.mkv")
    for unit in units(200):
        take.write(unit)
    info = info_of(tmp_path / "take.mkv")
    assert info.is_growing
    assert info.timing.pictures >= 150
    take.end("it was ended")
    assert not info_of(tmp_path / "take.mkv").is_growing


@pytest.mark.parametrize("content", [None, b"no video", b""])
def test_what_is_no_recording_is_refused_in_words(tmp_path: Path, content: bytes | None) -> None:
    """Not with a trace."""
    path = tmp_path / "take.mkv"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(Rejected, match=r"take\.mkv cannot be read"):
        info_of(path)


def test_jitter_is_that_of_the_intervals() -> None:
    """Alternating 20 and 24 ms: 22 on average, off by 2."""
    timing = timing_of([0, 1800, 3960, 5760, 7920])
    assert (timing.fps, timing.jitter_ms) == (pytest.approx(4 / 0.088), pytest.approx(2.0))
    assert (timing.interval_p50_ms, timing.interval_max_ms) == (pytest.approx(22.0), pytest.approx(24.0))


@pytest.mark.parametrize("pts", [[], [0]])
def test_fewer_than_two_pictures_have_no_rate(pts: list[int]) -> None:
    """Nothing is divided by nothing."""
    timing = timing_of(pts)
    assert (timing.pictures, timing.fps, timing.duration_s) == (len(pts), 0.0, 0.0)


def test_arrival_is_judged_within_each_life_of_a_sender() -> None:
    """Two senders' clocks have nothing in common."""
    first = Picture(n=0, pts=0, seq=0, rtp_time=0, life=0, ssrc=1, arrival_ns=0, arrival_wall_ns=0, size=1)
    late = replace_struct(first, rtp_time=90, arrival_ns=11_000_000)  # 1 ms after the first, arrived after 11
    other = replace_struct(first, rtp_time=5_000_000, arrival_ns=20_000_000, life=1)
    found = arrival_of([first, late, other])
    assert found is not None
    assert found.jitter_ms == pytest.approx(10 / 16)
    assert 9.0 < found.spread_ms <= 10.0
    assert arrival_of([first]) is None


def test_stretches_are_separated_by_clean_pictures() -> None:
    """A stretch that goes to the end is one as well."""
    clean = Picture(n=0, pts=0, seq=0, rtp_time=0, life=0, ssrc=1, arrival_ns=0, arrival_wall_ns=0, size=1)
    broken = replace_struct(clean, clean=False, lost=((1, 3), (7, 7)))
    found = stretches([broken, clean, broken, broken])
    assert [(one.pictures, one.lost_packets) for one in found] == [(1, 4), (2, 8)]
    assert GOP == 10


def replace_struct(picture: Picture, **changes: object) -> Picture:
    """Return a picture with other values."""
    import msgspec

    return msgspec.structs.replace(picture, **changes)
