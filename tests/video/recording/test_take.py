"""Rules of `gateway.video.recording.take` and `container`: pictures bit for bit, exact times, an honest index."""

from __future__ import annotations

import time
from collections.abc import Iterable
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import av
import pytest

from gateway.errors import Rejected
from gateway.video.hevc.access_unit import AccessUnit
from gateway.video.recording.container import ticks_of
from gateway.video.recording.index import Index, index_path, read_index
from gateway.video.recording.take import Take
from tests.video.coded import GOP, HEIGHT, PERIOD_TICKS, WIDTH, units

NAMES = ("take.mkv", "take.mp4")


def recorded(path: Path, pictures: Iterable[AccessUnit]) -> Index:
    """Record pictures; return the index."""
    take = Take(path, "10.0.0.2")
    for unit in pictures:
        take.write(unit)
    take.end("it was ended")
    return read_index(index_path(path))


def times_of(path: Path) -> list[int]:
    """Return when the file's pictures stand in it [ticks]."""
    with av.open(str(path)) as file:
        return [ticks_of(p.pts, p.time_base) for p in file.demux(video=0) if p.pts is not None and p.time_base]


def pixels_of(path: Path) -> list[bytes]:
    """Return the decoded luma of the file's pictures."""
    with av.open(str(path)) as file:
        return [bytes(picture.to_ndarray(format="gray")) for picture in file.decode(video=0)]


def decoded(pictures: Iterable[AccessUnit]) -> list[bytes]:
    """Return the decoded luma of coded pictures."""
    decoder = av.CodecContext.create("hevc", "r")
    found = [picture for unit in pictures for picture in decoder.decode(av.Packet(unit.data))]
    found += decoder.decode(None)
    return [bytes(picture.to_ndarray(format="gray")) for picture in found]


@pytest.mark.parametrize("name", NAMES)
def test_a_recording_decodes_to_the_pixels_that_were_sent(tmp_path: Path, name: str) -> None:
    """Nothing is encoded again."""
    recorded(tmp_path / name, units())
    assert pixels_of(tmp_path / name) == decoded(units())


@pytest.mark.parametrize("name", NAMES)
def test_times_are_rtp_times_to_the_tick(tmp_path: Path, name: str) -> None:
    """Also in Matroska, and hours into a recording: 1/90000 s, not milliseconds."""
    start = units()[0]
    pictures = [replace(unit, rtp_time=start.rtp_time + unit.seq * 2003 + 7 * (unit.seq > 30)) for unit in units()]
    hours = [
        replace(
            unit,
            rtp_time=unit.rtp_time + 5 * 3600 * 90_000 + 1,
            first_packet_ns=unit.first_packet_ns + 5 * 3600 * 1_000_000_000,
            seq=unit.seq + 40,
        )
        for unit in pictures
    ]
    recorded(tmp_path / name, [*pictures, *hours])
    assert times_of(tmp_path / name) == [unit.rtp_time - start.rtp_time for unit in [*pictures, *hours]]


def test_a_step_of_the_hosts_clock_does_not_show(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Pictures stay beside what a bag holds, whose clock goes on as it began."""
    take, wall_ns = Take(tmp_path / "take.mkv"), time.time_ns
    for unit in units():
        take.write(unit)
        if unit.seq == GOP // 2:
            monkeypatch.setattr(time, "time_ns", lambda: wall_ns() + 1_000_000_000)
    take.end("it was ended")
    index = read_index(index_path(tmp_path / "take.mkv"))
    assert index.header is not None
    offsets = {picture.arrival_wall_ns - picture.arrival_ns for picture in index.pictures}
    assert offsets == {index.header.started_wall_ns - index.header.started_ns}


def test_a_recording_begins_at_the_first_intact_irap_with_its_parameter_sets(tmp_path: Path) -> None:
    """What comes before cannot be decoded: neither later pictures, nor a damaged IRAP, nor one without its sets."""
    pictures = list(units())
    pictures[GOP] = replace(pictures[GOP], is_intact=False)
    pictures[2 * GOP] = replace(pictures[2 * GOP], has_parameter_sets=False)
    index = recorded(tmp_path / "take.mkv", pictures[1:])
    assert [picture.seq for picture in index.pictures] == list(range(3 * GOP, 4 * GOP))
    assert index.pictures[0].pts == 0
    assert index.pictures[0].irap


def test_an_irap_that_no_decoder_understands_is_no_beginning(tmp_path: Path) -> None:
    """The next one may be."""
    broken = replace(units()[0], data=b"\0\0\0\1\x40\x01" + bytes(range(200)))
    index = recorded(tmp_path / "take.mkv", [broken, *units()[1:]])
    assert index.pictures[0].seq == GOP


def test_the_index_says_what_was_recorded_and_when(tmp_path: Path) -> None:
    """One header; a line per picture with the stream's numbers and the arrival on two clocks."""
    pictures = units()
    index = recorded(tmp_path / "take.mkv", pictures)
    assert index.header is not None
    header = index.header
    assert (header.file, header.robot, header.ssrc, header.codec) == ("take.mkv", "10.0.0.2", 7, "hevc")
    assert (header.width, header.height) == (WIDTH, HEIGHT)
    assert {"gateway", "python", "av", "libavformat"} <= header.versions.keys()
    assert [(p.n, p.seq, p.rtp_time, p.arrival_ns, p.size) for p in index.pictures] == [
        (n, u.seq, u.rtp_time, u.first_packet_ns, len(u.data)) for n, u in enumerate(pictures)
    ]
    wall_gaps = [b.arrival_wall_ns - a.arrival_wall_ns for a, b in pairwise(index.pictures)]
    assert all(abs(gap - 22_222_222) < 5_000_000 for gap in wall_gaps)
    assert index.end is not None
    assert (index.end.pictures, index.end.dropped) == (len(pictures), 0)


def test_damaged_pictures_are_recorded_and_marked_until_the_next_intact_irap(tmp_path: Path) -> None:
    """With the packets that were lost."""
    pictures = list(units())
    pictures[3] = replace(pictures[3], data=pictures[3].data[:-20], is_intact=False, lost=((901, 902),))
    index = recorded(tmp_path / "take.mkv", pictures)
    assert [p.n for p in index.pictures if not p.clean] == list(range(3, GOP))
    assert [(p.n, p.lost) for p in index.pictures if not p.intact] == [(3, ((901, 902),))]


def test_a_new_sender_is_taken_from_its_first_intact_irap_and_stands_where_it_arrived(tmp_path: Path) -> None:
    """Pictures before that would be decoded from the old sender's."""
    first, second = units(15), units(30, life=1, ssrc=8)
    shift_ns = 15 * 22_222_222 + 500_000_000
    later = [
        replace(u, seq=u.seq + 15, first_packet_ns=u.first_packet_ns + shift_ns, rtp_time=u.seq * 2000) for u in second
    ]
    path = tmp_path / "take.mp4"
    index = recorded(path, [*first, *later[3:]])
    new = [p for p in index.pictures if p.life == 1]
    assert [p.seq for p in new] == list(range(15 + GOP, 45))
    assert all(p.ssrc == 8 and p.clean for p in new)
    assert sum(lost.count for lost in index.dropped) == GOP - 3
    waited = later[GOP].first_packet_ns - first[-1].first_packet_ns
    assert abs(new[0].pts - index.pictures[14].pts - waited * 90_000 / 1e9) < 1
    assert times_of(path) == [p.pts for p in index.pictures]
    assert pixels_of(path) == decoded([*first]) + decoded(later[GOP:])


def test_a_recording_without_a_picture_leaves_nothing(tmp_path: Path) -> None:
    """An empty file would look like a recording."""
    take = Take(tmp_path / "take.mkv")
    for unit in units()[1:GOP]:
        take.write(unit)
    take.end("nothing came")
    assert take.counts.skipped == GOP - 1
    assert list(tmp_path.iterdir()) == []


def test_what_is_there_is_never_overwritten(tmp_path: Path) -> None:
    """Neither a recording nor an index, and nothing is left of the attempt."""
    recorded(tmp_path / "take.mkv", units())
    with pytest.raises(FileExistsError):
        Take(tmp_path / "take.mkv")
    index_path(tmp_path / "other.mkv").touch()
    with pytest.raises(FileExistsError):
        Take(tmp_path / "other.mkv")
    assert not (tmp_path / "other.mkv").exists()


def test_a_format_that_would_not_survive_is_refused_with_those_that_do(tmp_path: Path) -> None:
    """Bad input tells the remedy."""
    with pytest.raises(Rejected, match=r"take\.avi") as refused:
        Take(tmp_path / "take.avi")
    assert ".mkv" in refused.value.hint
    assert PERIOD_TICKS * 45 == 90_000
