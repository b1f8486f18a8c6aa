"""Robots that are not one robot where we listen: what is told, and what is refused because of them.

A robot's bridge may put a namespace before all its topics. Then nothing of the robot is heard under another one, however
good the link is. What the tokens announce decides: where it is one robot it is offered, by the setting that names it; where
there are several they are listed. None is taken by itself: which robot moves is a person's choice.

Two robots under one namespace would both obey each command, and their states would come mixed: nothing begins then.
"""

from __future__ import annotations

from collections.abc import Sequence

from gateway.errors import Code, Refusal

__all__ = ["other_namespace", "two_robots"]


def other_namespace(namespaces: Sequence[str], own: str) -> Refusal | None:
    """Return why there is no robot here; None when no other one is known either.

    Args:
        namespaces: Under which robots announce themselves; the empty one stands for none.
        own: Which of them we listen under.
    """
    if not namespaces:
        return None
    there, here = ", ".join(map(_said, namespaces)), _said(own.strip("/"))
    if len(namespaces) == 1:
        message = f"there is no robot {here} at the robot's router, there is one {there}"
        offered = namespaces[0]
        hint = (
            f'if it is this one: namespace = "{offered}" in section [robot], or `ta2 run --namespace {offered}`'
            if offered
            else 'if it is this one: namespace = "" in section [robot]'
        )
    else:
        message = f"there is no robot {here} at the robot's router, there are {len(namespaces)} others: {there}"
        hint = "choose one: namespace in section [robot], or `ta2 run --namespace NAME`"
    return Refusal(
        code=Code.OTHER_NAMESPACE,
        message=message,
        field="robot.namespace",
        value=own.strip("/"),
        bound=", ".join(namespaces),
        hint=hint,
    )


def two_robots(zids: Sequence[str], own: str) -> Refusal | None:
    """Return why nothing may begin; None when at most one bridge announces a robot.

    Args:
        zids: Zenoh ids of the bridges that announce a robot under our namespace.
        own: That namespace.
    """
    if len(zids) < 2:
        return None
    return Refusal(
        code=Code.TWO_ROBOTS,
        message=f"{len(zids)} bridges announce a robot {_said(own.strip('/'))}, all would obey: {', '.join(zids)}",
        field="robot.namespace",
        value=own.strip("/"),
    )


def _said(namespace: str) -> str:
    return f"under namespace {namespace}" if namespace else "without a namespace"
