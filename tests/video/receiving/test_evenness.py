"""Rules of `video.receiving.evenness`: a fragment cut short is seen, and senders with habits of their own are let be."""

from __future__ import annotations

import random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.video.receiving.evenness import ENOUGH, MOST, START, Evenness


def nal(evenness: Evenness, *sizes: int) -> bool:
    """Take a NAL unit's fragments; return whether one was found to be cut short."""
    evenness.begin(sizes[0])
    return any([evenness.is_cut_short(size, is_last=at == len(sizes)) for at, size in enumerate(sizes[1:], start=2)])


def known() -> Evenness:
    """Return what knows that its sender is even."""
    evenness = Evenness()
    for _ in range(MOST):
        assert not nal(evenness, 900, 900, 900, 300)
    return evenness


@pytest.mark.parametrize(
    "sizes",
    [
        (700, 900, 900, 300),
        (900, 898, 898, 300),
        (900, 899, 900, 300),
        (900, 900, 0, 300),
        (200, 300),
        (500, 300),
        (899, 9),
    ],
)
def test_a_fragment_cut_short_is_seen(sizes):
    """The first, one in the middle, the first of two."""
    assert nal(known(), *sizes)


@pytest.mark.parametrize("sizes", [(900, 900, 300), (900, 1), (900, 900), (400, 400, 400), (1200, 300)])
def test_a_last_fragment_may_be_shorter_and_other_units_have_other_sizes(sizes):
    """Whether that one was cut short nobody can know."""
    assert not nal(known(), *sizes)


def test_it_is_told_once_for_each_unit():
    """What follows in it is of no use in any case."""
    evenness = known()
    evenness.begin(900)
    assert [evenness.is_cut_short(size, is_last=False) for size in (500, 900, 400)] == [True, False, False]


def test_a_sender_is_taken_for_even_until_it_has_shown_its_habits():
    """The very first fragments can be cut short; units of two fragments tell nothing of habits."""
    evenness = Evenness()
    assert nal(evenness, 900, 500, 300)
    for _ in range(50):
        assert not nal(evenness, 900, 300)
    assert [nal(evenness, 900, 500, 300) for _ in range(4)] == [True] * (START - ENOUGH) + [False] * 2


@given(st.integers(2, 40), st.integers(0, 2**32))
def test_a_sender_that_spreads_its_bytes_evenly_is_let_be(count, seed):
    """Fragments that differ by one byte, as some make them: nothing is said of them."""
    evenness, chance = Evenness(), random.Random(seed)
    for _ in range(100):
        size = chance.randrange(count, 60_000)
        assert not nal(evenness, *[size // count + (at < size % count) for at in range(count)])


@given(st.integers(0, 2**32))
def test_a_sender_without_any_habit_is_let_be(seed):
    """Fragments of random sizes: its first pictures are doubted, and no later ones."""
    chance, evenness = random.Random(seed), Evenness()
    units = [[chance.randrange(200, 1400) for _ in range(chance.randrange(4, 20))] for _ in range(100)]
    found = [at for at, sizes in enumerate(units) if nal(evenness, *sizes)]
    assert found and max(found) < 10


def test_a_sender_may_change_its_habits():
    """After a few units it is known anew."""
    evenness = known()
    found = [nal(evenness, 900, 500, 700, 300) for _ in range(40)]
    assert found == [True] * (MOST - ENOUGH + 1) + [False] * (40 - MOST + ENOUGH - 1)
    assert not any(nal(evenness, 900, 900, 900, 300) for _ in range(40))
    assert nal(evenness, 900, 500, 700, 300)


def test_many_of_the_same_size_can_be_told_at_once():
    """They count as if each had been taken."""
    evenness = known()
    evenness.begin(900)
    evenness.repeat(40)
    assert evenness.is_cut_short(899, is_last=False) is False and evenness.is_cut_short(700, is_last=False) is True
    uneven = Evenness()
    for _ in range(START + MOST):
        nal(uneven, 500, 900, 300)
    for _ in range(2 * MOST):
        uneven.begin(900)
        uneven.repeat(2)
        assert not uneven.is_cut_short(300, is_last=True)
    assert nal(uneven, 500, 900, 300), "it was even lately"


def test_a_sender_of_larger_fragments_is_known_by_them_soon():
    """Another path, another size: units of two fragments are doubted a few times at most, and judged again later."""
    evenness = known()
    found = [nal(evenness, *sizes) for _ in range(MOST) for sizes in ((700, 700, 700, 90), (700, 300))]
    assert not any(found[MOST:]) and sum(found) <= MOST // 2
    assert nal(evenness, 500, 300) and not nal(evenness, 700, 300)


def test_a_sender_that_spreads_its_bytes_is_not_judged_by_a_size_that_it_does_not_have():
    """Its units of two fragments are doubted at the very beginning, and never later."""
    evenness, chance = Evenness(), random.Random(1)
    found = []
    for _ in range(200):
        count, size = chance.choice((2, 2, 3, 5)), chance.randrange(600, 1400)
        found.append(nal(evenness, *[size] * count))
    assert not any(found[10:])


def test_units_of_two_fragments_alone_tell_nothing():
    """Whatever the size of the first one."""
    evenness, chance = Evenness(), random.Random(1)
    for _ in range(100):
        size = chance.randrange(300, 1400)
        assert not nal(evenness, size, size // 2)
