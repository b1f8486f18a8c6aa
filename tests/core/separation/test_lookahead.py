"""Room that is asked for beyond what a tick needs: as far as joints are bound for, less where there is less."""

from __future__ import annotations

from itertools import pairwise

import pytest

from gateway.core.motion.joints.braking import REST
from gateway.core.separation.lookahead import LEAST_RAD, MOST_RAD, SPEED_S, STRAY_RAD, TIGHT_TICKS, Lookahead, wider
from gateway.values import Side

L, R = Side.LEFT, Side.RIGHT
HERE = dict.fromkeys(Side, REST)
WAYS = {side: [(-0.01, 0.02)] * 7 for side in Side}


def both(speed_radps=0.0, aim_rad=0.0):
    """Return next states and aims, the same for all joints of the left arm; the right one is not moved."""
    return {L: (REST, (speed_radps,) * 7, REST)}, {L: (aim_rad,) * 7}


@pytest.mark.parametrize(
    ("speed_radps", "aim_rad", "back_rad", "forth_rad"),
    [
        (0.0, 0.0, STRAY_RAD, STRAY_RAD),
        (0.0, 0.3, STRAY_RAD, 0.28),
        (0.0, -0.3, 0.29, STRAY_RAD),
        (0.0, 5.0, STRAY_RAD, MOST_RAD),
        (1.0, 0.0, STRAY_RAD, SPEED_S),
        (-1.0, 0.0, SPEED_S, STRAY_RAD),
    ],
)
def test_joints_have_room_as_far_as_they_are_bound_for_or_get_at_their_speed(speed_radps, aim_rad, back_rad, forth_rad):
    """From the ends of their ways on, a little both ways, at most so much; an arm that is not moved keeps its ways."""
    found = wider(HERE, WAYS, *both(speed_radps, aim_rad), MOST_RAD)
    assert found[R] == WAYS[R]
    for low, high in found[L]:
        assert (low, high) == (pytest.approx(-0.01 - back_rad), pytest.approx(0.02 + forth_rad))


def test_what_is_free_holds_what_lies_inside_wherever_it_begins():
    """Until it is dropped, or something else is kept; at first nothing is free."""
    lookahead = Lookahead()
    assert not lookahead.holds(HERE, WAYS)
    lookahead.keep(HERE, WAYS, is_free=True)
    moved = dict.fromkeys(Side, (0.005,) * 7)
    assert lookahead.holds(HERE, WAYS)
    assert lookahead.holds(moved, {side: [(-0.015, 0.015)] * 7 for side in Side})
    assert not lookahead.holds(moved, {side: [(-0.016, 0.015)] * 7 for side in Side})
    assert not lookahead.holds(moved, WAYS)
    lookahead.drop()
    assert not lookahead.holds(HERE, WAYS)
    lookahead.keep(HERE, WAYS, is_free=True)
    lookahead.keep(HERE, None, is_free=False)
    assert not lookahead.holds(HERE, WAYS)


def test_less_is_asked_for_where_there_is_less_and_nothing_for_some_ticks_where_there_is_hardly_any():
    """Then as much as before that, and more as long as that is free."""
    lookahead, asked = Lookahead(), []

    def ask():
        found = lookahead.ask(HERE, WAYS, *both(aim_rad=5.0))
        return found, 0.0 if found is None else found[L][0][1] - 0.02

    while True:
        found, room_rad = ask()
        if found is None:
            break
        asked.append(room_rad)
        lookahead.keep(HERE, found, is_free=False)
        assert not lookahead.holds(HERE, WAYS)
    assert asked[0] == pytest.approx(MOST_RAD) and asked[-1] <= LEAST_RAD
    assert all(after == pytest.approx(0.5 * before) for before, after in pairwise(asked))
    assert [ask()[0] for _ in range(TIGHT_TICKS - 1)] == [None] * (TIGHT_TICKS - 1)
    for _ in range(20):
        found, room_rad = ask()
        lookahead.keep(HERE, found, is_free=True)
        assert lookahead.holds(HERE, WAYS)
    assert room_rad == pytest.approx(MOST_RAD)
