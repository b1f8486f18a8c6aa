"""Which robots the tokens announce, by the namespaces of their bridges. Pure.

A robot is what announces publishers of `/fsm_state` and of an arm's joints under one namespace (manual §4.8, §4.11): a
host bridge announces what its ROS nodes publish, too, but no whole robot.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from cdr_types.keys import Token, TokenKind
from gateway.robot.topics import FSM_STATE, arm_state
from gateway.values import Side

__all__ = ["robots_in"]

SIGNS = (FSM_STATE, *map(arm_state, Side))


def robots_in(tokens: Iterable[Token]) -> Mapping[str, tuple[str, ...]]:
    """Return the bridges that announce a robot, by namespace; no namespace is the empty one."""
    found: dict[tuple[str, str], set[str]] = {}
    for token in tokens:
        if token.kind is not TokenKind.MP:
            continue
        for sign in SIGNS:
            if token.topic.endswith(sign):
                namespace = token.topic[: -len(sign)].strip("/")
                found.setdefault((namespace, token.zid), set()).add(sign)
    robots: dict[str, tuple[str, ...]] = {}
    for (namespace, zid), signs in sorted(found.items()):
        if FSM_STATE in signs and len(signs) > 1:
            robots[namespace] = (*robots.get(namespace, ()), zid)
    return robots
