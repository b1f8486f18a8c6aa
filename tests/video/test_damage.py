"""Rules of `gateway.apps.video.damage`: damage goes on from picture to picture, until an intact IRAP."""

from __future__ import annotations

from dataclasses import replace

import pytest

from gateway.apps.video.access_unit import AccessUnit
from gateway.apps.video.damage import Chain

IRAP = AccessUnit(
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
)
NEXT = replace(IRAP, is_irap=False, seq=1)


def judged(*units: AccessUnit) -> list[bool]:
    """Return which of these are clean."""
    chain = Chain()
    return [chain.is_clean(unit) for unit in units]


def test_pictures_after_an_intact_irap_are_clean() -> None:
    """Nothing is missing."""
    assert judged(IRAP, NEXT, replace(NEXT, seq=2)) == [True, True, True]


def test_nothing_is_clean_before_the_first_irap() -> None:
    """It is predicted from pictures that nobody has."""
    assert judged(NEXT, replace(IRAP, seq=2)) == [False, True]


@pytest.mark.parametrize(
    "damaged",
    [
        pytest.param(replace(NEXT, is_intact=False, lost=((5, 6),)), id="packets of it were lost"),
        pytest.param(replace(NEXT, lost=((5, 9),)), id="packets before it were lost"),
        pytest.param(replace(NEXT, seq=2), id="a picture before it is missing"),
        pytest.param(replace(NEXT, life=1), id="it is another sender's"),
    ],
)
def test_damage_lasts_until_the_next_intact_irap(damaged: AccessUnit) -> None:
    """Each picture is predicted from the one before it; a damaged IRAP heals nothing."""
    after = [replace(damaged, seq=damaged.seq + n, is_intact=True, lost=()) for n in (1, 2, 3)]
    broken_irap = replace(after[1], is_irap=True, is_intact=False)
    irap = replace(after[2], is_irap=True, lost=((9, 9),))
    assert judged(IRAP, damaged, after[0], broken_irap, irap) == [True, False, False, False, True]
