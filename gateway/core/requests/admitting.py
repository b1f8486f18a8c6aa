"""Streams whose arm yields to what pushes its hand: tick by tick, from what is felt to the pose that is followed.

    what pulls at the hand, as far as it is sure  ->  virtual mass (`poses/admittance.py`)  ->  followed as a streamed pose

So limits, reach, slowing near singularities, braking and the grid are those of any stream of poses; its targets are anchors and
signs of life: without them it brakes and holds, as any stream. What is not felt pushes nothing: axes that the posture does not
feel (`ContactView.unknown` names them), and what is within `SURE` standard deviations. Once nothing is known of what pulls at
the arm its stream ends with CONTACT_UNKNOWN: it brakes.
"""

from __future__ import annotations

import math

from gateway.core.body.feeler import unknown
from gateway.core.body.motions import MotionState
from gateway.core.messages.outputs import Level
from gateway.core.supervision.coordinator import Coordinator
from gateway.core.supervision.supervisor import State
from gateway.errors import Refusal
from gateway.values import Side, Space, Vector

__all__ = ["SURE", "Admitting", "felt"]

NOTHING: Vector = (0.0,) * 6
SURE, DOUBTED = 2.0, 1.0
"""A force pushes by what of it is beyond so many standard deviations; once it does, until it is within so many. In between it
pushes as it did: dry friction, which nobody knows better and which changes its sign with each turn, must not swing the hand."""


def felt(coordinator: Coordinator, side: Side, now_ns: int, before: Vector = NOTHING) -> Vector | Refusal:
    """Return what pushes the hand of an arm for sure [N, N·m], shape (6,), 0 along axes that are not felt; or why nobody knows.

    Args:
        coordinator: Knows the arm's model.
        side: Which arm.
        now_ns: Monotonic time [ns].
        before: What was returned last.
    """
    contacts = coordinator.contacts
    if isinstance(contacts, Refusal):
        return contacts
    seen = contacts.view(side, now_ns)
    if seen.state != "known":
        return unknown(side, seen.reason, seen.code)
    axes = zip(seen.wrench, seen.wrench_sd, before, strict=True)
    return tuple([0.0 if x is None or sd is None else _sure(x, sd, old) for x, sd, old in axes])


def _sure(x: float, sd: float, before: float) -> float:
    """Return what of a force pushes: what it was, as long as that is between what is beyond `SURE` and beyond `DOUBTED`."""
    size, sign = abs(x), math.copysign(1.0, x)
    return sign * min(max(sign * before, size - SURE * sd, 0.0), max(size - DOUBTED * sd, 0.0))


class Admitting:
    """Leads the virtual masses."""

    def __init__(self, coordinator: Coordinator) -> None:
        self._coordinator = coordinator

    def step(self, now_ns: int) -> None:
        """Move the masses of the arms whose next pose leaves in this tick."""
        coordinator = self._coordinator
        for stream in coordinator.body.targets.running:
            mass = stream.mass
            if mass is None:
                continue
            if stream.received_ns is None or coordinator.state is not State.ACTIVE:
                mass.rest(())
                continue
            arm = coordinator.body.pose_arms[stream.side]
            due_ns = arm.next_due_ns()
            if due_ns is None or due_ns > now_ns:
                continue
            force = felt(coordinator, stream.side, now_ns, mass.force)
            if isinstance(force, Refusal):
                coordinator.body.drop_driver(stream.side, MotionState.ABORTED, force.code, force.message)
                text = f"the {stream.side} arm brakes and holds: {force.message}"
                coordinator.notice(force.code, Level.WARNING, text, now_ns, side=stream.side.value)
                continue
            if not mass.place:
                mass.rest(arm.reference.rest_values())
            slowing = coordinator.body.slowing.get(stream.side)
            speed = stream.speed * coordinator.body.speed_ratio[Space.POSE]
            share = speed * (1.0 if slowing is None else slowing.speed_ratio)
            values = mass.step(arm.reference.space, force, share)
            arm.follow_target(values, speed, stream.epoch)
