"""Rules of `gateway.sim.camera.annexb`: byte streams come apart at start codes and nowhere else (H.265 annex B)."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.sim.camera.annexb import is_irap, joined, nal_type, nal_units, without_parameter_sets

VPS, SPS, PPS, IDR, CRA, TRAIL = (bytes((kind << 1, 1, 7)) for kind in (32, 33, 34, 20, 21, 1))


@st.composite
def unit(draw: st.DrawFn) -> bytes:
    """A NAL unit as an encoder writes it: no start code inside, no zero at its end."""
    body = draw(st.binary(min_size=1, max_size=40))
    while b"\x00\x00" in body:
        body = body.replace(b"\x00\x00", b"\x00\x01")
    return b"\x40\x01" + body.rstrip(b"\x00") + b"\x80"


@given(st.lists(unit(), min_size=1, max_size=6))
def test_what_was_joined_comes_apart_again(units: list[bytes]) -> None:
    """With start codes of four bytes as with those of three."""
    assert nal_units(joined(units)) == units
    assert nal_units(b"".join(b"\x00\x00\x01" + one for one in units)) == units


@pytest.mark.parametrize("stream", [b"", b"\x00\x00", b"\x40\x01\x00\x00\x01\x40\x01"])
def test_what_does_not_begin_with_a_start_code_is_no_byte_stream(stream: bytes) -> None:
    """The message shows how it begins."""
    with pytest.raises(ValueError, match="no start code"):
        nal_units(stream)


def test_the_type_is_in_the_first_byte() -> None:
    """Beside the forbidden bit and the first bit of the layer."""
    assert [nal_type(one) for one in (VPS, SPS, PPS, IDR, CRA, TRAIL)] == [32, 33, 34, 20, 21, 1]
    assert nal_type(b"\xc1\x01") == 32


def test_decoding_begins_at_idr_and_cra_only() -> None:
    """Parameter sets alone are no picture."""
    assert is_irap([VPS, SPS, PPS, IDR]) and is_irap([CRA])
    assert not is_irap([TRAIL]) and not is_irap([VPS, SPS, PPS])


def test_parameter_sets_can_be_taken_out() -> None:
    """All else stays as it was."""
    assert without_parameter_sets(joined([VPS, SPS, PPS, IDR, TRAIL])) == joined([IDR, TRAIL])
