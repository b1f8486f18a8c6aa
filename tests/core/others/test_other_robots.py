"""A robot under another namespace is offered when it is the only one, several are listed; two under one are refused."""

from __future__ import annotations

import pytest

from gateway.core.others.other_robots import other_namespace, two_robots
from gateway.errors import Code


def test_without_another_robot_there_is_nothing_to_say():
    """Silence then has another reason."""
    assert other_namespace((), "bot1") is None


def test_the_only_other_robot_is_offered_by_the_setting_that_names_it():
    """Where we listen, where it is, and what to write; also when its bridge has no namespace."""
    offer = other_namespace(("bot1",), "")
    assert (offer.code, offer.field, offer.value, offer.bound) == (Code.OTHER_NAMESPACE, "robot.namespace", "", "bot1")
    assert (
        offer.message
        == "there is no robot without a namespace at the robot's router, there is one under namespace bot1"
    )
    assert 'namespace = "bot1"' in offer.hint and "ta2 run --namespace bot1" in offer.hint
    back = other_namespace(("",), "/bot1/")
    assert back.message.endswith("there is one without a namespace") and "under namespace bot1 at" in back.message
    assert 'namespace = ""' in back.hint and "--namespace" not in back.hint


@pytest.mark.parametrize("namespaces", [("a", "b"), ("", "b", "c")])
def test_several_are_listed_and_none_is_offered(namespaces):
    """Which of them moves is a person's choice."""
    refusal = other_namespace(namespaces, "x")
    assert refusal.code is Code.OTHER_NAMESPACE and f"there are {len(namespaces)} others" in refusal.message
    assert all(name in refusal.message for name in namespaces) and refusal.bound == ", ".join(namespaces)
    assert "choose one" in refusal.hint


def test_two_robots_under_one_namespace_are_refused_by_their_bridges():
    """Both would obey; one, or none, is nothing to refuse."""
    assert two_robots((), "") is None and two_robots(("a1",), "") is None
    refusal = two_robots(("a1", "b2"), "/bot1")
    assert refusal.code is Code.TWO_ROBOTS and refusal.value == "bot1"
    assert refusal.message == "2 bridges announce a robot under namespace bot1, all would obey: a1, b2"
