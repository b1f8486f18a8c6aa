"""Whose turn it is to be decoded, in virtual time: a poll each 10 ms."""

from __future__ import annotations

import pytest

from gateway.link.decode_schedule import LATE_NS, DecodeSchedule
from gateway.link.hearing import AT_ONCE, DECISIVE, POSED, SHOWN

MS = 1_000_000


def polls(turns, count=20, begin_ns=1_000_003):
    """Return in which of so many polls each class had its turn, after a first one."""
    turns.due(begin_ns, is_everyones=True)
    rows = [turns.due(begin_ns + number * 10 * MS, is_everyones=False) for number in range(1, count + 1)]
    return [[number for number, row in enumerate(rows) if row[kind]] for kind in (AT_ONCE, DECISIVE, POSED, SHOWN)]


@pytest.mark.parametrize(
    ("moving", "watched", "posing", "times"),
    [
        (False, False, False, (20, 10, 5, 5)),
        (True, False, False, (20, 10, 10, 10)),
        (False, True, False, (20, 10, 10, 10)),
        (False, False, True, (20, 10, 20, 5)),
        (True, True, True, (20, 10, 20, 10)),
    ],
)
def test_what_nobody_needs_now_is_decoded_less_often(moving, watched, posing, times):
    """FSM and mode in each poll, joints in every second one, the rest by what is going on."""
    turns = DecodeSchedule()
    turns.pace(is_moving=moving, is_watched=watched, is_posing=posing)
    assert tuple(map(len, polls(turns))) == times


def test_what_waits_for_its_turn_has_it_in_the_same_poll():
    """What caches lose while a loop sleeps is paid once."""
    _, decisive, posed, shown = polls(DecodeSchedule())
    assert decisive == posed == shown
    turns = DecodeSchedule()
    turns.pace(is_moving=False, is_watched=False, is_posing=False)
    _, decisive, posed, shown = polls(turns)
    assert posed == shown and set(shown) < set(decisive)


def test_after_a_pause_and_beside_news_it_is_everyones_turn():
    """What came before the news is told before it; after a pause what waits is old already."""
    turns = DecodeSchedule()
    assert turns.due(10 * MS, is_everyones=True) == [True] * 4
    assert not all(turns.due(19 * MS, is_everyones=False))
    assert all(turns.due(19 * MS + LATE_NS + 1, is_everyones=False))
