"""Rules of `gateway.video.recording.index`: what was written is read, and half a line breaks nothing."""

from __future__ import annotations

import random
from pathlib import Path

import pytest

from gateway.video.recording.index import Dropped, End, Header, IndexWriter, Line, Picture, index_path, read_index

HEADER = Header(
    file="a.mkv",
    robot="10.0.0.2",
    ssrc=3,
    started="2026-01-01T00:00:00+00:00",
    started_wall_ns=1,
    started_ns=2,
    width=1280,
    height=2720,
    versions={"gateway": "1"},
)
PICTURE = Picture(
    n=0,
    pts=0,
    seq=4,
    rtp_time=9,
    life=0,
    ssrc=3,
    arrival_ns=2,
    arrival_wall_ns=1,
    size=10,
    intact=False,
    lost=((1, 2),),
)
LINES: tuple[Line, ...] = (HEADER, PICTURE, Dropped(count=2, why="slow"), End(why="done", pictures=1, dropped=2))


def written(path: Path) -> Path:
    """Return an index with a line of each kind."""
    writer = IndexWriter(path)
    for line in LINES:
        writer.write(line)
    writer.close()
    return path


def test_what_was_written_is_read(tmp_path: Path) -> None:
    """Every line, by its kind."""
    index = read_index(written(index_path(tmp_path / "a.mkv")))
    assert (index.header, *index.pictures, *index.dropped, index.end) == LINES


def test_every_cut_of_an_index_is_readable(tmp_path: Path) -> None:
    """A recorder may be killed after any byte: whole lines count, half a line does not."""
    whole = written(tmp_path / "whole").read_bytes()
    cut = tmp_path / "cut"
    for length in range(len(whole)):
        cut.write_bytes(whole[:length])
        index = read_index(cut)
        lines = [line for line in (index.header, *index.pictures, *index.dropped, index.end) if line is not None]
        assert lines == list(LINES[: whole[:length].count(b"\n")])


def test_a_foreign_line_is_refused_with_its_number(tmp_path: Path) -> None:
    """Bad input tells where."""
    path = tmp_path / "a.jsonl"
    line = b'{"line":"dropped","count":1,"why":""}\n'
    for number, text in ((1, b"rubbish\n"), (2, line + b'{"line":"picture"}\n' + line)):
        path.write_bytes(text)
        with pytest.raises(ValueError, match=rf"a\.jsonl:{number} is no line"):
            read_index(path)


@pytest.mark.parametrize("seed", range(8))
def test_rubbish_at_the_end_of_an_index_is_left_out(tmp_path: Path, seed: int) -> None:
    """A power cut leaves anything in the last block, among it ends of lines: what is whole before it is read."""
    path, rubbish = written(tmp_path / "a"), random.Random(seed).randbytes(4096)
    with path.open("ab") as file:
        file.write(b'{"line":"dropped","why":"\xff\n' + rubbish + b"\n")
    assert read_index(path).end == LINES[-1]


def test_an_index_is_never_overwritten(tmp_path: Path) -> None:
    """It may be all that is left of a recording."""
    path = written(tmp_path / "a")
    with pytest.raises(FileExistsError):
        IndexWriter(path)
