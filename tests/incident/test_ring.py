"""A ring's files, whoever wrote them."""

from __future__ import annotations

import pickle
import zlib
from pathlib import Path

import pytest

from gateway.incident import ring as ring_module
from gateway.incident.ring import records


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
