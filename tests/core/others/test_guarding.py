"""What a daemon knows of guards: when an enabling waits for one, and what is told of one that was lost."""

from __future__ import annotations

import pytest

from gateway.core.messages.events import GuardSeen
from gateway.core.others.guarding import KNOWS_NS, WAIT_NS, Guarding


def seen(**facts: object) -> GuardSeen:
    """A guard that runs and reaches the robot, unless told otherwise."""
    return GuardSeen(**({"pid": 41, "zid": "c4", "is_linked": True, "at_ns": 1} | facts))


def test_a_guard_that_is_still_connecting_is_awaited_for_two_seconds():
    """Its session is open before the first frame leaves, unless it cannot be had."""
    guards = Guarding()
    assert guards.see(seen(is_linked=False)) == ""
    assert guards.is_awaited(0)
    assert guards.is_awaited(WAIT_NS - 1)
    assert not guards.is_awaited(WAIT_NS)


def test_no_guard_and_a_linked_one_are_not_awaited():
    """Without a guard nothing waits."""
    guards = Guarding()
    assert not guards.is_awaited(0)
    assert not guards.is_expected
    guards.see(seen())
    assert guards.is_expected
    assert (guards.pid, guards.zid, guards.is_linked) == (41, "c4", True)
    assert not guards.is_awaited(0)


def test_a_hold_elsewhere_is_known_by_its_socket_or_by_its_claim():
    """The claim of this daemon's own guard is none."""
    guards = Guarding()
    guards.see(seen())
    assert not guards.is_held_elsewhere(())
    assert not guards.is_held_elsewhere(("c4",))
    assert guards.is_held_elsewhere(("c4", "9a"))
    guards.earlier_holds = True
    assert guards.is_held_elsewhere(())


@pytest.mark.parametrize(
    "now", [{"zid": "", "is_linked": False}, {"zid": "d5"}, {"pid": 0, "zid": "", "lost": "signal 9"}]
)
def test_a_session_that_our_own_guard_has_left_holds_nothing(now: dict[str, object]):
    """It reconnects, or has ended: what it showed stays until the router has noticed, and is no earlier daemon's."""
    guards = Guarding()
    guards.see(seen())
    guards.see(seen(**now))
    assert not guards.is_held_elsewhere(("c4",))
    assert guards.is_held_elsewhere(("c4", "9a"))


def test_a_lost_guard_is_counted_and_told():
    """With how it ended."""
    guards = Guarding()
    assert guards.see(seen(pid=0, is_linked=False, lost="signal 9")).startswith("the guard ended (signal 9)")
    assert guards.see(seen(pid=42, is_linked=False)) == ""
    assert guards.lost == 1


def test_a_guard_could_hold_once_it_has_been_linked_for_a_while():
    """It hears the mode once a second; another session of it begins anew."""
    guards = Guarding()
    assert not guards.could_hold(KNOWS_NS)
    guards.see(seen(at_ns=10))
    guards.see(seen(at_ns=20))
    assert not guards.could_hold(9 + KNOWS_NS)
    assert guards.could_hold(10 + KNOWS_NS)
    guards.see(seen(at_ns=10 + KNOWS_NS, zid="d5"))
    assert not guards.could_hold(11 + KNOWS_NS)
    guards.see(seen(at_ns=20 + KNOWS_NS, is_linked=False))
    assert not guards.could_hold(9 * KNOWS_NS)
