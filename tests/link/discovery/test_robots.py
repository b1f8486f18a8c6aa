"""Rules of `gateway.link.discovery.robots`: what counts as a robot, and under which namespace it stands."""

from __future__ import annotations

import pytest

from cdr_types.keys import Qos, Token, TokenKind
from gateway.link.discovery.robots import robots_in
from gateway.robot.topics import FSM_STATE, STATE_TOPICS, arm_state
from gateway.values import Side

ARM = arm_state(Side.LEFT)


def announced(zid: str, *topics: str, namespace: str = "", kind: TokenKind = TokenKind.MP) -> list[Token]:
    """Return the tokens of a bridge."""
    return [Token(zid=zid, kind=kind, topic=f"{namespace}{topic}", type_name="t", qos=Qos()) for topic in topics]


def test_a_robot_is_who_announces_its_state_machine_and_an_arm():
    """Both, by one bridge, under one namespace; without one it is the empty name."""
    assert robots_in(announced("aa", *STATE_TOPICS)) == {"": ("aa",)}
    assert robots_in(announced("aa", *STATE_TOPICS, namespace="/bot1")) == {"bot1": ("aa",)}
    assert robots_in(announced("aa", *STATE_TOPICS, namespace="/hall/bot1")) == {"hall/bot1": ("aa",)}


@pytest.mark.parametrize(
    "tokens",
    [
        [],
        announced("aa", ARM),
        announced("aa", FSM_STATE),
        announced("aa", FSM_STATE) + announced("bb", ARM),
        announced("aa", FSM_STATE) + announced("aa", ARM, namespace="/bot1"),
        announced("aa", *STATE_TOPICS, kind=TokenKind.MS),
        [Token(zid="aa", kind=TokenKind.PRESENCE)],
    ],
)
def test_parts_of_a_robot_are_none(tokens):
    """A host's nodes may publish one of the topics, and whoever subscribes is no robot."""
    assert robots_in(tokens) == {}


def test_several_robots_are_told_apart_and_in_order():
    """By namespace; two bridges under one namespace stand side by side."""
    tokens = [
        *announced("cc", *STATE_TOPICS, namespace="/b"),
        *announced("aa", *STATE_TOPICS, namespace="/a"),
        *announced("bb", *STATE_TOPICS, namespace="/a"),
    ]
    assert robots_in(tokens) == {"a": ("aa", "bb"), "b": ("cc",)}
    assert list(robots_in(tokens)) == ["a", "b"]
