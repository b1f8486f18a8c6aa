"""Replies that are given again, requests that are not: one number, one request."""

from __future__ import annotations

import copy

import pytest

from gateway.core.messages.events import CommandRequested
from gateway.core.messages.outputs import Reply
from gateway.core.requests.answers import DROPPED_AT_ONCE, KEPT_NS, REPLIES_KEPT, Answers, number_was_used
from gateway.errors import Code
from gateway.messages.requests import Estop, Recover, Stop
from tests.changed import replace

ASKED = CommandRequested(client_id="ann", request_id=7, request=Recover(), received_ns=1, content=11)
GIVEN = Reply(client_id="ann", request_id=7, facts={"cleared": []})


@pytest.fixture
def answers() -> Answers:
    """One reply was given."""
    answers = Answers()
    answers.keep(ASKED, GIVEN)
    return answers


def test_what_was_not_asked_yet_is_to_be_run(answers: Answers) -> None:
    """Another number, or another client's same one."""
    assert answers.again(replace(ASKED, request_id=8)) is None
    assert answers.again(replace(ASKED, client_id="bob")) is None


def test_the_same_request_gets_its_first_reply_whenever_it_comes(answers: Answers) -> None:
    """The one who asks again has lost the reply."""
    assert answers.again(replace(ASKED, received_ns=99)) is GIVEN


def test_another_request_under_a_number_that_was_used_is_refused_and_the_first_reply_stays(answers: Answers) -> None:
    """With the reply to the first it would be taken for done."""
    reply = answers.again(replace(ASKED, content=12))
    assert (
        reply is not None and reply.refusal == number_was_used(7) and (reply.client_id, reply.request_id) == ("ann", 7)
    )
    assert reply.refusal.code is Code.BAD_REQUEST and reply.refusal.value == "7" and reply.refusal.hint
    assert answers.again(ASKED) is GIVEN


@pytest.mark.parametrize("stop", [Stop(), Estop()])
def test_a_stop_is_always_to_be_run(answers: Answers, stop: Stop | Estop) -> None:
    """Whatever its number, and however often."""
    assert answers.again(replace(ASKED, request=stop, content=12)) is None
    assert answers.again(replace(ASKED, request=stop)) is None


def test_the_latest_replies_are_kept(answers: Answers) -> None:
    """As many as are given in the time in which a client asks again; then it would be run again."""
    for request_id in range(100, 99 + REPLIES_KEPT):
        answers.keep(replace(ASKED, request_id=request_id), GIVEN)
    assert answers.again(ASKED) is GIVEN
    answers.keep(replace(ASKED, request_id=99), GIVEN)
    assert answers.again(ASKED) is None and answers.again(replace(ASKED, request_id=100)) is GIVEN


def test_a_reply_is_not_kept_for_longer_than_anybody_asks_again(answers: Answers) -> None:
    """Those of a burst go a few at a time, the oldest first; the one that was just given stays."""
    for request_id in range(100, 100 + 2 * DROPPED_AT_ONCE):
        answers.keep(replace(ASKED, request_id=request_id, received_ns=2), GIVEN)
    at_ns = ASKED.received_ns + KEPT_NS
    answers.keep(replace(ASKED, request_id=8, received_ns=at_ns), GIVEN)
    assert answers.again(ASKED) is GIVEN
    for request_id, left in ((9, 2 * DROPPED_AT_ONCE + 1 - DROPPED_AT_ONCE), (10, 1), (11, 0), (12, 0)):
        answers.keep(replace(ASKED, request_id=request_id, received_ns=at_ns + 2), GIVEN)
        burst = [replace(ASKED, request_id=number) for number in (7, *range(100, 100 + 2 * DROPPED_AT_ONCE))]
        assert sum(answers.again(asked) is GIVEN for asked in burst) == left
    assert all(answers.again(replace(ASKED, request_id=number)) is GIVEN for number in range(8, 13))


def test_a_copy_gives_the_same_replies_and_goes_its_own_way(answers: Answers) -> None:
    """As the black box freezes it."""
    twin = copy.copy(answers)
    answers.keep(replace(ASKED, request_id=8), GIVEN)
    assert twin.again(ASKED) is GIVEN and twin.again(replace(ASKED, request_id=8)) is None
