"""Endpoints: who promised to be heard, who is silent, and what that refuses."""

from __future__ import annotations

import pytest

from gateway.core.supervision.endpoints import (
    LONGEST_NS,
    MOST,
    MOST_OF_VIEWERS,
    SHORTEST_NS,
    Endpoint,
    Endpoints,
)
from gateway.errors import Code, Refusal
from gateway.messages.requests import OnLoss

MS = 1_000_000
S = 1_000_000_000


@pytest.fixture
def endpoints():
    """One, of ann, with a period of 0.5 s, heard at 10 s."""
    endpoints = Endpoints()
    assert isinstance(endpoints.register("ann", "page", 500 * MS, OnLoss.HOLD, 10 * S), Endpoint)
    return endpoints


def code(answer: object) -> Code | None:
    """Code of a refusal; None when there is none."""
    return answer.code if isinstance(answer, Refusal) else None


@pytest.mark.parametrize(
    ("timeout_ns", "refused"),
    [(SHORTEST_NS - 1, True), (SHORTEST_NS, False), (LONGEST_NS, False), (LONGEST_NS + 1, True), (0, True)],
)
def test_a_period_is_bounded(timeout_ns, refused):
    """0.1 to 10 s, told with value, bound and unit."""
    answer = Endpoints().register("ann", "page", timeout_ns, OnLoss.HOLD, 0)
    assert (code(answer) is Code.OUT_OF_RANGE) is refused
    assert not refused or (isinstance(answer, Refusal) and answer.bound == "[0.1, 10]" and answer.unit == "s")


def test_who_registered_is_known_by_his_client(endpoints):
    """From registration to leaving."""
    endpoints.register("bob", "pad", 500 * MS, OnLoss.HOLD, 10 * S)
    assert endpoints.client_ids == {"ann", "bob"}
    endpoints.leave("ann")
    assert endpoints.client_ids == {"bob"}
    assert [endpoints.name_of(client_id) for client_id in ("ann", "bob")] == ["", "pad"]


def test_so_many_and_no_more_and_their_names_are_told():
    """The same client may take its own place at any time."""
    endpoints = Endpoints()
    for n in range(MOST):
        assert code(endpoints.register(f"c{n}", f"page {n}", S, OnLoss.HOLD, 0)) is None
    refusal = endpoints.register("late", "late", S, OnLoss.HOLD, 0)
    assert isinstance(refusal, Refusal) and refusal.code is Code.TOO_MANY_ENDPOINTS and "page 7" in refusal.message
    again = endpoints.register("c3", "page 3", 2 * S, OnLoss.PAUSE, 0)
    assert isinstance(again, Endpoint) and again.endpoint_id == MOST + 1 and len(endpoints.views(0)) == MOST


def test_viewers_leave_room_for_a_persons_deadman():
    """Whoever may move nothing has half of the places, and all of them are told whose they are."""
    endpoints = Endpoints()
    for n in range(MOST_OF_VIEWERS):
        assert isinstance(endpoints.register(f"v{n}", f"page {n}", S, OnLoss.HOLD, 0, is_viewers=True), Endpoint)
    refusal = endpoints.register("v9", "late", S, OnLoss.HOLD, 0, is_viewers=True)
    assert isinstance(refusal, Refusal) and refusal.code is Code.TOO_MANY_ENDPOINTS
    assert refusal.message == "4 stop endpoints of viewers are registered already: page 0, page 1, page 2, page 3"
    for n in range(MOST - MOST_OF_VIEWERS):
        assert isinstance(endpoints.register(f"c{n}", f"page {n}", S, OnLoss.HOLD, 0), Endpoint)
    assert isinstance(endpoints.register("late", "late", S, OnLoss.HOLD, 0), Refusal)


def test_of_all_eight_places_taken_by_others_viewers_have_none():
    """Those of viewers are not kept for them."""
    endpoints = Endpoints()
    for n in range(MOST):
        assert isinstance(endpoints.register(f"c{n}", f"page {n}", S, OnLoss.HOLD, 0), Endpoint)
    assert isinstance(endpoints.register("v", "page", S, OnLoss.HOLD, 0, is_viewers=True), Refusal)


def test_one_is_silent_beyond_its_period_and_told_once(endpoints):
    """At its very end it is not; heard again, that is told once, too."""
    assert endpoints.look(10 * S + 500 * MS, 0) == [] and endpoints.refusal(is_demanded=False) is None
    (silent,) = endpoints.look(10 * S + 500 * MS + 1, 0)
    assert silent.is_silent and endpoints.silent == ["page"] and endpoints.look(11 * S, 0) == []
    refusal = endpoints.refusal(is_demanded=False)
    assert refusal is not None and refusal.code is Code.ENDPOINT_SILENT
    assert "'page' was not heard for 1.00 s (0.5 s is its bound)" in refusal.message
    endpoints.heard("ann", 11 * S)
    endpoints.heard("ann", 10 * S)  # what was late on its way takes nothing back
    endpoints.heard("bob", 11 * S)
    (back,) = endpoints.look(11 * S + 10 * MS, 0)
    assert not back.is_silent and endpoints.refusal(is_demanded=True) is None


def test_a_pause_explains_a_silence_and_motion_waits_all_the_same(endpoints):
    """One that only a pause of ours explains is not told to be silent, and is doubted."""
    assert endpoints.look(10 * S + 590 * MS, 400 * MS) == [] and endpoints.doubted is None
    assert endpoints.look(10 * S + 700 * MS, 300 * MS) == [] and endpoints.doubted is not None
    assert code(endpoints.refusal(is_demanded=False)) is Code.ENDPOINT_SILENT
    assert len(endpoints.look(11 * S, 0)) == 1 and endpoints.doubted is None


def test_whose_connection_ends_is_silent_at_once_until_a_later_check_in(endpoints):
    """Others are not."""
    endpoints.gone("bob", 10 * S)
    assert endpoints.look(10 * S, 0) == []
    endpoints.gone("ann", 10 * S + 10 * MS)
    assert len(endpoints.look(10 * S + 10 * MS, 0)) == 1
    endpoints.heard("ann", 10 * S + 20 * MS)
    assert len(endpoints.look(10 * S + 20 * MS, 0)) == 1 and endpoints.silent == []


def test_leaving_is_ones_own_and_dismissing_is_for_the_silent(endpoints):
    """Nobody lets one go that is heard, but itself."""
    endpoints.register("bob", "pad", S, OnLoss.HOLD, 10 * S)
    endpoints.look(10 * S + 600 * MS, 0)
    assert endpoints.dismiss() == ["page"] and [view.name for view in endpoints.views(11 * S)] == ["pad"]
    assert code(endpoints.leave("ann")) is Code.ENDPOINT_UNKNOWN
    left = endpoints.leave("bob")
    assert isinstance(left, Endpoint) and left.name == "pad" and endpoints.views(0) == ()


def test_where_one_is_demanded_none_is_refused():
    """With the setting's name."""
    refusal = Endpoints().refusal(is_demanded=True)
    assert refusal is not None and refusal.code is Code.ENDPOINT_MISSING and "demand_stop_endpoint" in refusal.message
    assert Endpoints().refusal(is_demanded=False) is None


def test_the_next_daemon_finds_a_latch_while_one_is_registered(endpoints):
    """Beside the others; without endpoints, only the others."""
    latches = {Code.ESTOP: "by bob"}
    assert Endpoints().beside(latches) == latches
    assert endpoints.beside(latches) == {
        Code.ENDPOINT_SILENT: "stop endpoints of an earlier daemon: page",
        Code.ESTOP: "by bob",
    }


def test_a_view_tells_period_choice_and_age(endpoints):
    """And no id by which its client could be taken for another."""
    (view,) = endpoints.views(10 * S + 100 * MS)
    assert (view.endpoint_id, view.name, view.timeout_ns, view.on_silence) == (1, "page", 500 * MS, "hold")
    assert view.age_ns == 100 * MS and not view.is_silent and not hasattr(view, "client_id")


def test_a_refusal_names_how_long_it_lasted_and_how_long_it_may(endpoints):
    """In seconds, as the sentence says it; where none is registered, how many are demanded."""
    endpoints.look(11 * S, 0)
    refusal = endpoints.refusal(is_demanded=False)
    assert (refusal.field, refusal.value, refusal.bound, refusal.unit) == ("endpoints", "1.00", "0.5", "s")
    missing = Endpoints().refusal(is_demanded=True)
    assert (missing.code, missing.field, missing.value, missing.bound) == (Code.ENDPOINT_MISSING, "endpoints", "0", "1")
