"""Rules of `link.others.claim_token`: shown when it is out, from a thread of its own, through failures and new sessions."""

from __future__ import annotations

import threading

import pytest
import zenoh

from gateway.link.others.claim_token import ClaimToken
from tests.link.robot_process import wait_until


class Session:
    """A session that writes down what is declared on it."""

    def __init__(self) -> None:
        self.log: list[str] = []
        self.failures = 0
        self.gate = threading.Event()
        self.gate.set()

    def declare_armed(self):
        self.gate.wait(10.0)
        if self.failures:
            self.failures -= 1
            raise zenoh.ZError("closed")
        self.log.append("out")
        return lambda: self.log.append("in")


@pytest.fixture
def shown() -> list[int]:
    """Claims that were shown."""
    return []


@pytest.fixture
def token(shown):
    """A token, ended with the test."""
    made = ClaimToken(shown.append)
    yield made
    assert made.close(5.0)


def test_a_claim_is_shown_when_its_token_is_out(token, shown):
    """And taken in when nothing is claimed any more; the same wish again changes nothing."""
    session = Session()
    token.attach(session)
    for claim in (0, 3, 3):
        token.show(claim)
    wait_until(lambda: shown == [3])
    assert session.log == ["out"]
    token.show(0)
    wait_until(lambda: session.log == ["out", "in"])
    assert shown == [3]


def test_the_next_claim_is_shown_as_well(token, shown):
    """Also when the thread never saw the moment between the two: the token is out, and that is said."""
    session = Session()
    token.attach(session)
    token.show(1)
    wait_until(lambda: shown == [1])
    token.show(2)
    wait_until(lambda: shown == [1, 2])
    assert session.log == ["out"]


def test_a_new_session_gets_its_own_token_when_it_is_asked_for(token, shown):
    """That of the former went with it; without a session nothing is shown, and with a new one nothing by itself."""
    first, second = Session(), Session()
    token.show(1)
    token.attach(first)
    token.show(1)
    wait_until(lambda: shown == [1])
    token.attach(None)
    token.show(1)
    token.attach(second)
    assert second.log == []
    token.show(1)
    wait_until(lambda: shown == [1, 1])
    assert (first.log, second.log) == (["out"], ["out"])


def test_a_declaration_that_fails_is_tried_again(token, shown, caplog):
    """The session may just be coming back; nothing is claimed to be out meanwhile."""
    session = Session()
    session.failures = 2
    token.attach(session)
    token.show(1)
    wait_until(lambda: shown == [1])
    assert caplog.text.count("cannot be declared") == 2


def test_whoever_wants_it_does_not_wait(token, shown):
    """A stalled link holds the declaration: what is wanted meanwhile is served afterwards, the latest wins."""
    session = Session()
    session.gate.clear()
    token.attach(session)
    token.show(1)
    token.show(0)
    token.show(2)
    assert shown == []
    session.gate.set()
    wait_until(lambda: shown[-1:] == [2])


def test_a_declaration_on_a_session_that_is_gone_shows_nothing(token, shown):
    """It was put out on a session that nobody uses any more."""
    first, second = Session(), Session()
    first.gate.clear()
    token.attach(first)
    token.show(1)
    token.attach(second)
    first.gate.set()
    token.show(2)
    wait_until(lambda: shown == [2])
    assert second.log == ["out"]


def test_an_end_comes_through_a_failing_session(shown):
    """It is not waited for the next try."""
    token, session = ClaimToken(shown.append), Session()
    session.failures = 10**6
    token.attach(session)
    token.show(1)
    assert token.close(5.0)


def test_a_token_that_nobody_wanted_has_no_thread(shown):
    """And is closed at once, twice."""
    before = threading.active_count()
    token = ClaimToken(shown.append)
    token.attach(Session())
    token.show(0)
    assert threading.active_count() == before and token.close(0.0) and token.close(0.0)
