"""A ring's files, whoever wrote them."""

from __future__ import annotations

import errno
import os
import pickle
import time
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import TypeAlias

import pytest

from gateway.incident import ring as ring_module
from gateway.incident.replay import incident
from gateway.incident.ring import Ring, records

S = 1_000_000_000


Rings: TypeAlias = Callable[[int], Ring]


@pytest.fixture
def a_ring(tmp_path: Path) -> Iterator[Rings]:
    """Return what makes a ring in this test's folder that has so many pieces, the last one unfinished."""
    made: list[Ring] = []

    def a_ring(pieces: int) -> Ring:
        made.append(ring := Ring(tmp_path))
        ring.spare_bytes = 0
        ring.open()
        for number in range(pieces):
            ring.begin({"form": 1, "number": number}, number * S)
            ring.write(b"x" * 100)
        return ring

    yield a_ring
    for ring in made:
        ring.close()


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
def test_what_a_power_cut_left_of_the_last_pieces_spoils_no_incident(
    tmp_path: Path, a_ring: Rings, content: bytes
) -> None:
    """File systems give a file its length, or its name, before what is in it. A hole between two pieces is told."""
    a_ring(5).close()
    left = sorted((tmp_path / "ring").iterdir())
    for box in left[-2:]:
        box.write_bytes(content)
    kept = a_ring(0).folder / "kept"
    (found,) = map(incident, kept.iterdir())
    assert [box.header["number"] for box in found.pieces] == [0, 1, 2] and found.causes[0].code == "DIED"
    found.pieces[1].path.write_bytes(content)
    with pytest.raises(ValueError):
        incident(found.path)


@pytest.mark.parametrize("gone", [["000001"], ["000002"], ["000003"], ["000001", "000002", "000003"]])
def test_a_piece_that_somebody_deleted_keeps_no_incident_from_being_kept(
    tmp_path: Path, a_ring: Rings, gone: list[str]
) -> None:
    """The rest of the minute is kept, with why."""
    ring = a_ring(3)
    for name in gone:
        (tmp_path / "ring" / f"{name}.box").unlink()
    found = incident(ring.keep([("ESTOP", "", 1)]))
    assert [box.header["number"] for box in found.pieces] == [n for n in range(3) if f"00000{n + 1}" not in gone]
    assert found.causes[0].code == "ESTOP"


def test_an_incident_is_on_the_disk_before_it_has_its_name(
    tmp_path: Path, a_ring: Rings, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What is in it, its note and its folder; then the name. A piece is, when the next one begins."""
    synced: list[str] = []

    def fsync(handle: int) -> None:
        path = Path(os.readlink(f"/proc/self/fd/{handle}"))
        synced.append(str(path.relative_to(tmp_path)))

    monkeypatch.setattr(os, "fsync", fsync)
    ring = a_ring(2)
    assert synced == ["ring/000001.box"]
    synced.clear()
    kept = ring.keep([("ESTOP", "", 1)])
    half = f"kept/.{kept.name}"
    assert set(synced[:-2]) == {f"{half}/00.box", f"{half}/01.box", f"{half}/incident.json"}
    assert synced[-2:] == [half, "kept"]


@pytest.mark.parametrize(("number", "is_kept"), [(errno.EINVAL, True), (errno.EIO, False)])
def test_a_file_system_that_cannot_force_a_folder_onto_its_disk_keeps_incidents_all_the_same(
    a_ring: Rings, monkeypatch: pytest.MonkeyPatch, number: int, is_kept: bool
) -> None:
    """One that fails to is told."""
    ring = a_ring(1)

    def fsync(handle: int) -> None:
        if os.path.isdir(f"/proc/self/fd/{handle}"):
            raise OSError(number, os.strerror(number))

    monkeypatch.setattr(os, "fsync", fsync)
    if is_kept:
        assert ring.keep([("ESTOP", "", 1)]).exists()
    else:
        with pytest.raises(OSError, match=os.strerror(number)):
            ring.keep([("ESTOP", "", 1)])


def test_an_incident_behind_a_step_of_the_clock_stays_and_those_of_the_wrong_clock_go(
    a_ring: Rings, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What has just happened is never let go for what is called later: that was before."""
    monkeypatch.setattr(ring_module, "KEPT_INCIDENTS", 3)
    ring, days = a_ring(1), [0]
    told = SimpleNamespace(gmtime=lambda: time.gmtime(days[0] * 86400), strftime=time.strftime, time_ns=time.time_ns)
    monkeypatch.setattr(ring_module, "time", told)
    kept = []
    for days[0] in (1, 11, 12, 2, 3):
        kept.append(ring.keep([("ESTOP", "", 1)]))
        assert kept[-1].exists()
    assert [path.name[:8] for path in kept if path.exists()] == ["19700102", "19700103", "19700104"]
    days[0] = 1
    assert ring.keep([("ESTOP", "", 1)]).exists()


def test_what_lies_beside_the_incidents_is_left_alone(
    tmp_path: Path, a_ring: Rings, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A file that somebody has put there is no incident, and keeps none away."""
    monkeypatch.setattr(ring_module, "KEPT_INCIDENTS", 2)
    ring = a_ring(1)
    (tmp_path / "kept" / "00.tgz").write_bytes(b"")
    for _ in range(4):
        assert ring.keep([("ESTOP", "", 1)]).exists()
    assert len(list((tmp_path / "kept").iterdir())) == 3


def test_a_ring_that_could_not_be_kept_at_the_start_stays_what_it_is(
    tmp_path: Path, a_ring: Rings, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Pieces of the process before are followed by new ones, and none is taken for another."""
    a_ring(2).close()

    def full(*_: object, **__: object) -> Path:
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patch, pytest.raises(OSError):
        patch.setattr(Ring, "keep", full)
        ring = Ring(tmp_path)
        ring.spare_bytes = 0
        ring.open()
    for number in range(2):
        ring.begin({"form": 1, "number": number}, 200 * S)
    found = incident(ring.keep([("ESTOP", "", 1)]))
    assert [box.header["number"] for box in found.pieces][-2:] == [0, 1]
    ring.close()
