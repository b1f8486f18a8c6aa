"""A ring's files, whoever wrote them."""

from __future__ import annotations

import os
import pickle
import zlib
from pathlib import Path

import pytest

from gateway.incident import ring as ring_module
from gateway.incident.replay import incident
from gateway.incident.ring import Ring, records

S = 1_000_000_000


def a_ring(folder: Path, pieces: int) -> Ring:
    """Return a ring that has so many pieces, the last one unfinished."""
    ring = Ring(folder)
    ring.spare_bytes = 0
    ring.open()
    for number in range(pieces):
        ring.begin({"form": 1, "number": number}, number * S)
        ring.write(b"x" * 100)
    return ring


def test_a_block_that_unpacks_to_more_than_any_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A small file could fill the memory else."""
    monkeypatch.setattr(ring_module, "BLOCK_BYTES", 2**16)
    block = zlib.compress(pickle.dumps(bytes(2**20)))
    path = tmp_path / "00.box"
    path.write_bytes(b"{}\n" + len(block).to_bytes(4, "big") + block)
    with pytest.raises(ValueError, match="larger than any"):
        list(records(path))


def test_whatever_a_file_does_to_our_values_it_is_a_file_that_cannot_be_read(tmp_path: Path) -> None:
    """Not a defect of the one who reads."""
    block = zlib.compress(b"cgateway.core.engine\nEngine\n(NNNNNNtR.")
    path = tmp_path / "00.box"
    path.write_bytes(b"{}\n" + len(block).to_bytes(4, "big") + block)
    with pytest.raises(ValueError, match=r"00\.box"):
        list(records(path))


@pytest.mark.parametrize("content", [b"", bytes(4096)])
def test_what_a_power_cut_left_of_the_last_pieces_spoils_no_incident(tmp_path: Path, content: bytes) -> None:
    """File systems give a file its length, or its name, before what is in it. A hole between two pieces is told."""
    a_ring(tmp_path, 5).close()
    left = sorted((tmp_path / "ring").iterdir())
    for box in left[-2:]:
        box.write_bytes(content)
    kept = a_ring(tmp_path, 0).folder / "kept"
    (found,) = map(incident, kept.iterdir())
    assert [box.header["number"] for box in found.pieces] == [0, 1, 2] and found.causes[0].code == "DIED"
    found.pieces[1].path.write_bytes(content)
    with pytest.raises(ValueError):
        incident(found.path)


def test_an_incident_is_on_the_disk_before_it_has_its_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What is in it, its note and its folder; then the name. A piece is, when the next one begins."""
    synced: list[str] = []

    def fsync(handle: int) -> None:
        path = Path(os.readlink(f"/proc/self/fd/{handle}"))
        synced.append(str(path.relative_to(tmp_path)))

    monkeypatch.setattr(os, "fsync", fsync)
    ring = a_ring(tmp_path, 2)
    assert synced == ["ring/000001.box"]
    synced.clear()
    kept = ring.keep([("ESTOP", "", 1)])
    half = f"kept/.{kept.name}"
    assert set(synced[:-2]) == {f"{half}/00.box", f"{half}/01.box", f"{half}/incident.json"}
    assert synced[-2:] == [half, "kept"]
    ring.close()
