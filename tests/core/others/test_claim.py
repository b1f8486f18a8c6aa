"""The claim: shown, looked around again, then confirmed; the larger zenoh id yields, and an established one is left alone."""

from __future__ import annotations

import itertools

import pytest

from gateway.core.others.claim import GIVE_UP_NS, LINK_SETTLE_NS, LOOK_AGAIN_NS, Claim

MS = 1_000_000
TICK_NS = 10 * MS


class Party:
    """A gateway with its claim; what it shows is seen by the others a tick later.

    Args:
        zid: Its zenoh id.
        wants_at_ns: From when on somebody owns its robot.
        obeys: Whether it yields; one that does not shows its token for ever.
    """

    def __init__(self, zid: str, wants_at_ns: int = 0, *, obeys: bool = True) -> None:
        self.zid, self.wants_at_ns, self.obeys = zid, wants_at_ns, obeys
        self.claim = Claim()
        self.claim.link_up(0)
        self.is_used = False
        self.shows = False
        self.confirmed_at: list[int] = []

    def step(self, now_ns: int, rivals: list[str]) -> None:
        """One tick; a new claim is shown at once."""
        was = self.claim.is_confirmed
        self.claim.step(
            now_ns, is_wanted=now_ns >= self.wants_at_ns, is_used=self.is_used, own_zid=self.zid, rivals=rivals
        )
        self.claim.shown(self.claim.number, now_ns) if self.claim.number and not self.shows else None
        self.shows = bool(self.claim.number) or (self.shows and not self.obeys)
        if self.claim.is_confirmed and not was:
            self.confirmed_at.append(now_ns)


def live(parties: list[Party], until_ns: int, from_ns: int = 0) -> None:
    """Let them live; each sees what the others showed a tick ago."""
    for now_ns in range(from_ns, until_ns, TICK_NS):
        shown = {party.zid: party.shows for party in parties}
        for party in parties:
            party.step(now_ns, [zid for zid, is_shown in shown.items() if is_shown and zid != party.zid])


def test_alone_a_claim_is_confirmed_150_ms_after_it_was_shown():
    """The first frame waits that long, and after a new link for the tokens of others as well."""
    party = Party("a")
    live([party], 500 * MS)
    assert party.confirmed_at == [LINK_SETTLE_NS + LOOK_AGAIN_NS]


def test_nothing_is_claimed_without_a_wish_or_a_link():
    """Nobody owns the robot; or the transport is down."""
    claim = Claim()
    claim.step(10**9, is_wanted=True, is_used=False, own_zid="a", rivals=[])
    assert claim.number == 0
    claim.link_up(10**9)
    claim.step(2 * 10**9, is_wanted=False, is_used=True, own_zid="a", rivals=[])
    assert claim.number == 0


def test_a_claim_is_open_until_it_is_confirmed_or_withdrawn():
    """So long nothing leaves, and whoever else is armed may be the one who yields."""
    party = Party("a")
    assert not party.claim.is_open
    live([party], LINK_SETTLE_NS + TICK_NS)
    assert party.claim.is_open
    live([party], 500 * MS, LINK_SETTLE_NS + TICK_NS)
    assert party.claim.is_confirmed and not party.claim.is_open
    party.claim.withdraw()
    assert not party.claim.is_open


def test_a_claim_that_is_not_shown_is_not_confirmed():
    """The 150 ms count from the instant at which others can see it; the token of an earlier claim is no answer."""
    claim = Claim()
    claim.link_up(0)
    for now_ns in (LINK_SETTLE_NS, 10**9, 2 * 10**9):
        claim.step(now_ns, is_wanted=True, is_used=False, own_zid="a", rivals=[])
        claim.shown(claim.number + 1, now_ns)
        claim.shown(0, now_ns)
    assert claim.number == 1 and not claim.is_confirmed


def test_a_claim_ends_with_its_wish_and_the_next_has_another_number():
    """A token that was shown for the first says nothing about the second."""
    party = Party("a")
    live([party], 400 * MS)
    first = party.claim.number
    party.wants_at_ns = 600 * MS
    live([party], 600 * MS, 400 * MS)
    assert (party.claim.number, party.claim.is_confirmed) == (0, False)
    live([party], 900 * MS, 600 * MS)
    assert party.claim.number == first + 1 and party.claim.is_confirmed


def test_a_claim_is_kept_until_the_last_frame_has_left():
    """The owner is gone, chassis zeros still go out."""
    party = Party("a")
    live([party], 400 * MS)
    party.is_used, party.wants_at_ns = True, 10**12
    live([party], 800 * MS, 400 * MS)
    assert party.claim.is_confirmed


def test_an_established_gateway_is_not_disturbed_by_one_that_comes_later():
    """The later one sees it and shows nothing, whatever the ids; it gets its turn when the first is done."""
    first, second = Party("f"), Party("a", wants_at_ns=500 * MS)
    live([first, second], 2000 * MS)
    assert first.claim.is_confirmed and second.claim.number == 0 and not second.shows
    first.wants_at_ns = 10**12
    live([first, second], 3000 * MS, 2000 * MS)
    assert second.claim.is_confirmed and first.claim.number == 0


@pytest.mark.parametrize("apart_ms", range(-60, 70, 10))
def test_of_two_that_claim_at_once_exactly_the_smaller_one_is_confirmed(apart_ms):
    """Seen or unseen before: never both, and never neither. Ids are compared as numbers, leading zeros are not printed."""
    small, large = Party("9f"), Party("100", wants_at_ns=0)
    small.wants_at_ns = max(0, apart_ms * MS) + LINK_SETTLE_NS
    large.wants_at_ns = max(0, -apart_ms * MS) + LINK_SETTLE_NS
    live([small, large], 3000 * MS)
    confirmed = [party for party in (small, large) if party.confirmed_at]
    assert len(confirmed) == 1
    if abs(apart_ms) <= 0:
        assert confirmed == [small]


def test_of_many_that_claim_at_once_exactly_one_is_confirmed():
    """Whichever order they are looked at in."""
    for zids in itertools.permutations(["1", "2", "3"]):
        parties = [Party(zid) for zid in zids]
        live(parties, 3000 * MS)
        assert [party.zid for party in parties if party.confirmed_at] == ["1"]


def test_a_larger_one_that_does_not_yield_is_left_alone():
    """It does not know the rule: we do, and withdraw after a second."""
    ours, theirs = Party("a"), Party("f", obeys=False)
    live([ours, theirs], LINK_SETTLE_NS + GIVE_UP_NS)
    assert ours.claim.number and not ours.claim.is_confirmed
    live([ours, theirs], 3000 * MS, LINK_SETTLE_NS + GIVE_UP_NS)
    assert ours.claim.number == 0 and not ours.confirmed_at


def test_an_established_claim_yields_to_another_only_when_nothing_is_sent():
    """What must stop first is the supervisor's; then two that both believed to be alone sort it out anew."""
    party = Party("a")
    live([party], 400 * MS)
    party.is_used = True
    party.step(400 * MS, ["b"])
    assert party.claim.is_confirmed
    party.is_used = False
    party.step(410 * MS, ["b"])
    assert party.claim.number == 0


def test_a_lost_link_takes_the_claim_with_it():
    """On return it is made anew: others may have come meanwhile."""
    party = Party("a")
    live([party], 400 * MS)
    party.claim.link_down()
    assert (party.claim.number, party.claim.is_confirmed) == (0, False)
    party.step(500 * MS, [])
    assert party.claim.number == 0
    party.claim.link_up(600 * MS)
    party.step(600 * MS + LINK_SETTLE_NS, [])
    assert party.claim.number == 2 and not party.claim.is_confirmed


def test_without_a_name_of_our_own_we_are_the_smallest():
    """An engine that was told no zenoh id still claims."""
    claim = Claim()
    claim.link_up(0)
    claim.step(LINK_SETTLE_NS, is_wanted=True, is_used=False, own_zid="", rivals=[])
    claim.shown(1, LINK_SETTLE_NS)
    claim.step(LINK_SETTLE_NS + LOOK_AGAIN_NS, is_wanted=True, is_used=False, own_zid="", rivals=["1"])
    assert claim.number == 1 and not claim.is_confirmed
