"""Tests of asking in a thread: one order, one answer or error, whatever the server does."""

from __future__ import annotations

import logging
import threading

import numpy as np
import pytest

from gateway.errors import Aborted, Disconnected, InternalError, Rejected
from gateway.policy.asking import Answer, Asking
from gateway.policy.observing import Observation
from gateway.policy.openpi import PolicyServer
from gateway.policy.policy_map import Actions
from tests.policy.server import Scripted

LAYOUT = Actions(columns=("left_arm",))
WAIT_S = 10.0


class Eyes:
    """An observer that counts."""

    def __init__(self, error=None):
        self.looks = 0
        self.error = error

    def observe(self):
        self.looks += 1
        if self.error is not None:
            raise self.error
        measured = {side: np.zeros(7) for side in ("left", "right")}
        return Observation(values={"look": self.looks}, observed_ns=100 * self.looks, measured=measured, uncovered=())


@pytest.fixture
def make():
    """Makes who asks, and its server."""
    opened = []

    def make(policy, eyes=None, is_connected=False):
        server = Scripted(policy)
        client = PolicyServer(server.url)
        if is_connected:
            client.connect()
        asking = Asking(client, eyes or Eyes(), LAYOUT, 1000)
        opened.extend([asking, server])
        return asking, server

    yield make
    for end in opened:
        end.close()


def test_nothing_is_asked_that_was_not_ordered(make):
    """It looks when it asks, not before; whoever plays does not wait."""
    eyes = Eyes()
    asking, server = make(lambda seen: {"actions": np.full((4, 7), seen["look"] / 10)}, eyes)
    assert asking.answer(0.0) is None and eyes.looks == 0 and not server.seen
    for look in (1, 2):
        asking.order()
        answer = asking.answer(WAIT_S)
        assert isinstance(answer, Answer) and answer.chunk.observed_ns == 100 * look and answer.chunk.period_ns == 1000
        assert answer.chunk.arms["left"][0, 0] == pytest.approx(look / 10) and answer.delay_ns > 0
    assert eyes.looks == 2


def test_each_error_is_an_answer_and_the_next_order_begins_anew(make):
    """A traceback, a wrong answer, a hang-up: then it connects again."""
    answers = ["Traceback\nValueError: no", {"actions": np.zeros((4, 6))}, None, {"actions": np.zeros((4, 7))}]
    asking, _ = make(lambda _: answers.pop(0))
    for kind in (Aborted, Rejected, Disconnected, Answer):
        asking.order()
        assert isinstance(asking.answer(WAIT_S), kind)


@pytest.mark.parametrize("is_connected", [True, False])
def test_a_server_that_comes_back_with_another_policy_is_refused(make, is_connected):
    """Its rate and its tasks were looked at once, before anybody moved: another checkpoint would play at the wrong speed."""
    asking, server = make(
        lambda _: None if len(server.seen) % 2 == 0 else {"actions": np.zeros((4, 7))}, is_connected=is_connected
    )
    was = "at first it was fps 30"
    for kind, words, then in (
        (Answer, "", {}),
        (Disconnected, "", {"started": 2}),  # what else it says may differ
        (Answer, "", {}),
        (Disconnected, "", {"fps": 45}),
        (Rejected, f"it says fps 45, {was}", {}),
        (Rejected, f"it says fps 45, {was}", {"fps": 30, "available_tasks": ["fold"]}),
        (Rejected, f"it says fps 30, available_tasks ['fold'], {was}", {}),
    ):
        asking.order()
        answer = asking.answer(WAIT_S)
        assert isinstance(answer, kind)
        if words:
            assert answer.field == "policy" and words in answer.message
        server.metadata |= then


def test_a_bug_of_ours_is_an_answer_too(make, caplog):
    """The thread is lost, and whoever waits hears of it."""
    with caplog.at_level(logging.CRITICAL):
        asking, _ = make(lambda _: {}, Eyes(ZeroDivisionError("bug")))
        asking.order()
        answer = asking.answer(WAIT_S)
    assert isinstance(answer, InternalError) and "ZeroDivisionError: bug" in answer.message


def test_closing_does_not_wait_for_a_policy_that_thinks(make):
    """It hangs up, and the thread ends."""
    asked, release = threading.Event(), threading.Event()

    def slow(_):
        asked.set()
        release.wait(30.0)
        return {}

    asking, _ = make(slow)
    asking.order()
    assert asked.wait(WAIT_S)
    asking.close()
    assert not asking._thread.is_alive()
    release.set()
