"""Tests of which pictures can be trusted: damage goes on from picture to picture until nothing is predicted from it."""

from __future__ import annotations

from dataclasses import replace

import pytest

from gateway.video.decoding.damage import MAX_RANGES, Damage, Verdict
from gateway.video.hevc.access_unit import AccessUnit

KEY = AccessUnit(
    data=b"",
    seq=0,
    rtp_time=0,
    first_packet_ns=0,
    complete_ns=0,
    is_intact=True,
    is_irap=True,
    has_parameter_sets=True,
    lost=(),
    ssrc=1,
    life=0,
    slice_type=19,
)
NEXT = replace(KEY, is_irap=False, has_parameter_sets=False, slice_type=1)
RASL = replace(NEXT, slice_type=8)
CRA = replace(KEY, slice_type=21)


def judged(*units: AccessUnit) -> list[Verdict]:
    """Return what is known of these, each numbered by its place where it has no number of its own."""
    damage = Damage()
    return [damage.judge(replace(unit, seq=unit.seq or n)) for n, unit in enumerate(units)]


def clean(*units: AccessUnit) -> list[bool]:
    """Return which of these are clean."""
    return [verdict.clean for verdict in judged(*units)]


def test_pictures_after_an_intact_key_picture_are_clean() -> None:
    """Nothing is missing."""
    assert clean(KEY, NEXT, NEXT, KEY, NEXT) == [True] * 5
    assert all(verdict.lost == () for verdict in judged(KEY, NEXT, NEXT))


def test_decoding_begins_with_a_key_picture_that_has_parameter_sets() -> None:
    """What came before it is predicted from pictures that nobody has; without parameter sets nobody can read it."""
    found = judged(NEXT, replace(KEY, has_parameter_sets=False), NEXT, KEY, NEXT)
    assert [verdict.is_decodable for verdict in found] == [False, False, False, True, True]
    assert [verdict.begins for verdict in found] == [False, False, False, True, False]
    assert [verdict.clean for verdict in found] == [False, False, False, True, True]


def test_a_later_key_picture_needs_no_parameter_sets() -> None:
    """The decoder has them."""
    assert clean(KEY, NEXT, replace(KEY, has_parameter_sets=False), NEXT) == [True] * 4


@pytest.mark.parametrize(
    "damaged",
    [
        pytest.param(replace(NEXT, is_intact=False, lost=((5, 6),)), id="packets of it were lost"),
        pytest.param(replace(NEXT, lost=((5, 9),)), id="packets before it were lost"),
        pytest.param(replace(NEXT, seq=2), id="a picture before it is missing"),
        pytest.param(replace(NEXT, is_intact=False), id="a packet of it was malformed"),
    ],
)
def test_damage_lasts_until_the_next_intact_key_picture(damaged: AccessUnit) -> None:
    """Each picture is predicted from the one before it; a damaged key picture heals nothing."""
    first = damaged.seq or 1
    after = [replace(NEXT, seq=first + n) for n in (1, 2)]
    broken = replace(KEY, seq=first + 3, is_intact=False, lost=((20, 20),))
    healed = [replace(KEY, seq=first + 4), replace(NEXT, seq=first + 5)]
    found = judged(KEY, damaged, *after, broken, *healed)
    assert [verdict.clean for verdict in found] == [True, False, False, False, False, True, True]
    assert [verdict.lost for verdict in found[1:4]] == [damaged.lost] * 3
    assert found[4].lost == (*damaged.lost, (20, 20)) and found[5].lost == ()
    assert all(verdict.is_decodable for verdict in found)


def test_packets_lost_before_an_intact_key_picture_do_not_matter() -> None:
    """Nothing in it, nor after it, needs them."""
    assert clean(KEY, NEXT, replace(KEY, lost=((3, 9),)), NEXT) == [True] * 4


def test_another_sender_begins_anew() -> None:
    """Its pictures are predicted from its own; the first one that can be decoded is its first key picture."""
    found = judged(KEY, NEXT, replace(NEXT, life=1), replace(KEY, life=1), replace(NEXT, life=1))
    assert [verdict.is_decodable for verdict in found] == [True, True, False, True, True]
    assert [verdict.begins for verdict in found] == [True, False, False, True, False]
    assert [verdict.clean for verdict in found] == [True, True, False, True, True]


def test_rasl_pictures_are_clean_only_if_nothing_before_their_cra_was_damaged() -> None:
    """They are shown before the CRA and predicted from what was sent before it (H.265, 3.111)."""
    lost = replace(NEXT, lost=((4, 4),))
    assert clean(KEY, NEXT, CRA, RASL, NEXT) == [True] * 5
    found = judged(KEY, lost, CRA, RASL, RASL, NEXT, CRA, RASL)
    assert [verdict.clean for verdict in found] == [True, False, True, False, False, True, True, True]
    assert found[3].lost == ((4, 4),) and found[5].lost == ()
    assert clean(KEY, NEXT, replace(CRA, lost=((4, 4),)), RASL, NEXT) == [True, True, True, False, True]
    assert clean(CRA, RASL, NEXT) == [True, False, True]


def test_a_recovery_point_heals_after_as_many_intact_pictures_as_it_says() -> None:
    """A stream may be renewed column by column, without key pictures (H.265, D.3.8)."""
    lost, point = replace(NEXT, lost=((4, 4),)), replace(NEXT, recovers_after=2)
    assert clean(KEY, lost, point, NEXT, NEXT, NEXT) == [True, False, False, False, True, True]
    assert clean(KEY, lost, replace(point, recovers_after=0), NEXT) == [True, False, True, True]
    assert clean(KEY, lost, replace(point, lost=((6, 6),)), NEXT, NEXT) == [True, False, False, False, True]


def test_a_loss_during_a_recovery_ends_it() -> None:
    """What was renewed may be predicted from what was lost again; the next recovery point begins anew."""
    lost, point = replace(NEXT, lost=((4, 4),)), replace(NEXT, recovers_after=2)
    assert clean(KEY, lost, point, lost, NEXT, NEXT, point, NEXT, NEXT) == [True, *[False] * 7, True]
    broken = replace(point, is_intact=False)
    assert clean(KEY, lost, broken, NEXT, NEXT, NEXT) == [True, *[False] * 5]


def test_decoding_can_begin_with_a_recovery_point() -> None:
    """Where no key picture may ever come; it is clean when it says so."""
    point = replace(NEXT, recovers_after=1, has_parameter_sets=True)
    found = judged(NEXT, point, NEXT, NEXT)
    assert [verdict.is_decodable for verdict in found] == [False, True, True, True]
    assert [verdict.clean for verdict in found] == [False, False, True, True]


def test_a_stream_without_anything_that_heals_stays_damaged() -> None:
    """Nobody can know when the damage has left the picture; it is said, not hoped."""
    found = clean(KEY, *[NEXT] * 500, replace(NEXT, lost=((4, 4),)), *[NEXT] * 2000, KEY)
    assert found == [True] * 501 + [False] * 2001 + [True]


def test_a_decoder_that_lost_everything_begins_with_the_next_key_picture() -> None:
    """As with a new sender."""
    damage = Damage()
    damage.judge(KEY)
    damage.begin_anew()
    assert not damage.judge(replace(NEXT, seq=1)).is_decodable
    assert damage.judge(replace(KEY, seq=2)) == Verdict(is_decodable=True, begins=True, clean=True)


def test_what_was_lost_does_not_grow_without_bound() -> None:
    """A stream that nothing heals may lose packets for hours."""
    damage = Damage()
    damage.judge(KEY)
    for n in range(1, 3 * MAX_RANGES):
        found = damage.judge(replace(NEXT, seq=n, lost=((n, n),)))
    assert len(found.lost) == MAX_RANGES and found.lost[-1] == (3 * MAX_RANGES - 1, 3 * MAX_RANGES - 1)
