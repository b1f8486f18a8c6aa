"""Rules of `nal`, `bits` and `parameter_sets`: what a receiver reads of H.265, and that nonsense is no exception."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.video.hevc.bits import BitReader, BitsEnded
from gateway.video.hevc.nal import annex_b, begins_picture, is_irap, is_valid, recovery_point
from gateway.video.hevc.parameter_sets import MAX_BYTES, ParameterSets
from tests.video.packets import PPS, SPS, VPS, recovery_point_sei, slice_nal, split_annex_b

NALS = st.binary(min_size=3, max_size=40).filter(lambda b: b"\0\0\0" not in b and b"\0\0\1" not in b and b[-1] != 0)


@pytest.mark.parametrize(("bits", "number"), [("1", 0), ("010", 1), ("011", 2), ("00100", 3), ("0001000", 7)])
def test_unsigned_numbers_are_as_in_table_9_2_of_the_standard(bits: str, number: int) -> None:
    """H.265 section 9.2."""
    assert BitReader(int(bits.ljust(8, "0"), 2).to_bytes(1, "big")).unsigned() == number


@pytest.mark.parametrize(("bits", "number"), [("1", 0), ("010", 1), ("011", -1), ("00100", 2), ("00101", -2)])
def test_signed_numbers_are_as_in_table_9_3_of_the_standard(bits: str, number: int) -> None:
    """H.265 section 9.2.2."""
    assert BitReader(int(bits.ljust(8, "0"), 2).to_bytes(1, "big")).signed() == number


def test_emulation_prevention_is_no_data() -> None:
    """00 00 03 stands for 00 00 (H.265 section 7.4.2)."""
    assert BitReader(b"\x00\x00\x03\x01").read(24) == 1


def test_numbers_that_do_not_end_are_refused() -> None:
    """Neither zeros for ever nor the end of the data hang or crash a reader."""
    with pytest.raises(BitsEnded, match="zeros"):
        BitReader(bytes(40).replace(b"\0", b"\0")).unsigned()
    with pytest.raises(BitsEnded, match="left"):
        BitReader(b"\x01").read(9)


@given(st.lists(NALS, min_size=1, max_size=6))
def test_annex_b_gives_the_same_units_back(nals: list[bytes]) -> None:
    """Start codes are put in and found again."""
    assert split_annex_b(annex_b(nals)) == nals


def test_start_codes_of_three_bytes_are_found_too() -> None:
    """H.265 annex B.2."""
    assert split_annex_b(b"\x00\x00\x01" + VPS + b"\x00\x00\x01" + PPS) == [VPS, PPS]


def test_irap_types_are_those_of_the_standard() -> None:
    """BLA, IDR, CRA and what is reserved for more of them (H.265 table 7-1)."""
    assert [kind for kind in range(64) if is_irap(kind)] == list(range(16, 24))


@pytest.mark.parametrize(
    ("nal", "valid"), [(VPS, True), (b"\x40\x01", False), (b"\x80\x01\x00", False), (b"\x40\x00\x00", False)]
)
def test_a_header_is_judged(nal: bytes, valid: bool) -> None:
    """Zero bit, type below 48, temporal id from 1 on, something behind it (H.265 section 7.3.1.2)."""
    assert is_valid(nal) is valid


def test_the_first_slice_says_so() -> None:
    """`first_slice_segment_in_pic_flag`."""
    assert begins_picture(slice_nal(1, 20, 0)) and not begins_picture(slice_nal(1, 20, 0, is_first=False))


@pytest.mark.parametrize("pictures", [0, 1, 2])
def test_a_recovery_point_says_after_how_many_pictures(pictures: int) -> None:
    """H.265 section D.2.8, coded as a signed number: 1 is the code number 1, -1 the code number 2."""
    expected = {0: 0, 1: 1, 2: 2}[pictures]
    assert recovery_point(recovery_point_sei(pictures)) == expected


@pytest.mark.parametrize("flags", ["00", "01", "11"])
def test_a_recovery_point_that_promises_less_than_the_exact_picture_is_none(flags: str) -> None:
    """H.265 section D.3.8, exact_match_flag and broken_link_flag: a picture that is nearly right is not clean."""
    payload = int("1" + flags + "1" + "0000", 2)
    assert recovery_point(bytes((39 << 1, 1, 6, 1, payload, 0x80))) is None


def test_other_messages_before_a_recovery_point_are_passed_over() -> None:
    """A message of 260 bytes, whose length takes two bytes."""
    sei = recovery_point_sei()
    assert recovery_point(sei[:2] + b"\x05\xff\x05" + b"\x55" * 260 + sei[2:]) == 0


def test_a_very_long_message_is_not_looked_into() -> None:
    """Reading it would cost more than it can tell."""
    assert recovery_point(b"\x4e\x01" + b"\x05\x01\x55" * 2000 + recovery_point_sei()[2:]) is None


@given(st.binary(max_size=60))
def test_any_sei_is_read_without_an_exception(body: bytes) -> None:
    """Also one that ends in the middle of a message."""
    assert recovery_point(b"\x4e\x01" + body) is None or body


@pytest.mark.parametrize("layers", [0, 1, 6])
def test_an_sps_is_known_by_its_id_behind_the_profile_of_all_layers(layers: int) -> None:
    """H.265 section 7.3.2.2 and 7.3.3: every sub-layer with profile and level takes 96 bits more, and flags."""
    bits = "0000" + f"{layers:03b}" + "1" + "1" * 96
    bits += "11" * layers + "11" * (8 - layers if layers else 0) + "1" * (96 * layers)
    raw = [int((bits + code).ljust(1000, "1"), 2).to_bytes(125, "big") for code in ("1", "00100")]
    sets = ParameterSets()
    for body in raw:
        assert sets.keep(b"\x42\x01" + body)
    assert len(sets.all_but(set())) == 2, "ids 0 and 3"


def test_a_newer_one_replaces_the_one_with_its_id_and_decoders_get_them_in_order() -> None:
    """A sender may change them; VPS before SPS before PPS."""
    sets, newer = ParameterSets(), PPS[:-1] + b"\x41"
    for nal in (PPS, SPS, VPS, newer):
        assert not sets.is_complete or nal is newer
        assert sets.keep(nal)
    assert sets.is_complete and sets.all_but(set()) == [VPS, SPS, newer]
    assert sets.all_but({33, 34}) == [VPS]


@pytest.mark.parametrize(
    "nal", [b"\x42\x01\x01", SPS + bytes(MAX_BYTES), b"\x44\x01\x00\x00\x00\x00\x00\x00\x00", b"\x44\x01\x01\x04"]
)
def test_what_cannot_be_a_parameter_set_is_not_kept(nal: bytes) -> None:
    """Too short, too long, without an id, or with one that is too large: memory stays bounded."""
    sets = ParameterSets()
    assert not sets.keep(nal) and sets.all_but(set()) == []
