"""Rules of `gateway.sim.camera.handover`: what one process notes, another finds, and nothing else."""

from __future__ import annotations

from pathlib import Path

import pytest

from gateway.sim.camera.handover import HandOver, HandOvers

ONE, TWO = HandOver(1_000, 90, 0xFFFFFFFF), HandOver(2_000, 0xFFFFFFFF, 7)


def test_a_reader_finds_what_was_noted(tmp_path: Path) -> None:
    """Through the file; the largest numbers too."""
    with HandOvers(tmp_path / "table", 8) as table, HandOvers(tmp_path / "table") as reader:
        table.note(3, ONE)
        table.note(4, TWO)
        assert (reader.find(3), reader.find(4), reader.count) == (ONE, TWO, 2)


def test_what_was_not_noted_is_not_found(tmp_path: Path) -> None:
    """Not even counter 0, although the file begins with zeros."""
    with HandOvers(tmp_path / "table", 8) as table:
        assert table.find(0) is None and table.find(11) is None
        table.note(3, ONE)
        assert table.find(11) is None


def test_the_newest_are_kept_and_a_counter_has_its_latest_time(tmp_path: Path) -> None:
    """Of a loop, the last round."""
    with HandOvers(tmp_path / "table", 8) as table:
        table.note(3, ONE)
        table.note(3, TWO)
        assert table.find(3) == TWO
        table.note(11, ONE)
        assert table.find(3) is None and table.find(11) == ONE


@pytest.mark.parametrize("content", [b"", b"no table", bytes(64), bytes(63)])
def test_another_file_is_no_table(tmp_path: Path, content: bytes) -> None:
    """It is named."""
    (tmp_path / "file").write_bytes(content)
    with pytest.raises(ValueError, match="no table of hand-overs"):
        HandOvers(tmp_path / "file")


def test_a_table_has_at_least_one_slot(tmp_path: Path) -> None:
    """And is there before it is read."""
    with pytest.raises(ValueError, match="0 slots"):
        HandOvers(tmp_path / "table", 0)
    with pytest.raises(FileNotFoundError):
        HandOvers(tmp_path / "table")
