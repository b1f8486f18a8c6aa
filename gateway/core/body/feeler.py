"""Feelers: what a motion or a stream ends at before its goal. How hard a hand is pushed, and whether that is a touch.

A force counts when it is above the threshold and can be told from nothing: at once when it is so by more than its standard
deviation, else when it stays so. Noise comes and goes, a table does not; what the model is off by, the deviation knows.
Pure arithmetic on what `robot_state/contact.py` tells; it does not know what follows.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from msgspec import Struct

from gateway.core.messages.events import CommandRequested
from gateway.core.motion.bounds import within, wrong_count
from gateway.errors import Code, Refusal
from gateway.messages.body_views import ContactView
from gateway.messages.incoming import Until
from gateway.robot.limits import TOUCH_N
from gateway.values import Side, Vector

__all__ = ["LASTS_NS", "MOST_BACK_M", "SURE", "Feeler", "Push", "axis_of", "push_of", "unknown"]

LASTS_NS = 20_000_000
"""A force that is not clearly above the threshold counts when it stays above for so long [ns]."""
SURE = 1.5
"""A force of fewer standard deviations may be nothing: in free motion at full speed 1.2 were the most."""
MOST_BACK_M = 0.1
"""Farther back nobody is led [m]."""
LOST = 0.05
"""A direction is not felt when more than this part of it (of its square) lies along axes that are not."""
AXES = 3
LONGEST = 1e6
"""Length of a direction, and of its inverse."""


class Push(NamedTuple):
    """With what force the surroundings push a hand.

    Attributes:
        force_n: Along a direction, or whatever its direction [N].
        sd_n: Its standard deviation [N].
        why: Why it is unknown; empty while it is known.
    """

    force_n: float
    sd_n: float
    why: str = ""


class Feeler(Struct, kw_only=True):
    """What one arm's motion or stream ends at.

    Attributes:
        force_n: Threshold [N].
        axis: Unit vector in the arm's shoulder frame; empty for any direction.
        back_off_m: How far it then goes back [m].
        command: Who asked for it; None for the gateway's own.
        epoch: Of the lease under which it was asked for.
        over_ns: Since when the force has been above the threshold [ns]; None while it is not.
    """

    force_n: float
    axis: Vector = ()
    back_off_m: float = 0.0
    command: CommandRequested | None = None
    epoch: int = 0
    over_ns: int | None = None

    def feels(self, push: Push, now_ns: int) -> bool:
        """Return whether a known push is a touch."""
        least_n = max(self.force_n, SURE * push.sd_n)
        if push.force_n <= least_n:
            self.over_ns = None
            return False
        if self.over_ns is None:
            self.over_ns = now_ns
        return push.force_n > least_n + push.sd_n or now_ns - self.over_ns >= LASTS_NS


def axis_of(until: Until) -> Vector | Refusal:
    """Return the unit vector that is asked for, empty for any direction, or what is wrong with the wish."""
    refusal = within("force_n", until.force_n, *TOUCH_N, "N", field="until.force_n") or within(
        "back_off_m", until.back_off_m, 0.0, MOST_BACK_M, "m", field="until.back_off_m"
    )
    if refusal is not None:
        return refusal
    if not until.direction:
        return ()
    if len(until.direction) != AXES:
        return wrong_count("the direction", len(until.direction), AXES, "until.direction", "x, y, z")
    length = math.hypot(*until.direction)
    refusal = within("the direction's length", length, 1.0 / LONGEST, LONGEST, field="until.direction")
    return refusal or tuple([value / length for value in until.direction])


def unknown(side: Side, why: str, value: str = "") -> Refusal:
    """Return the refusal of what would have to feel an arm's hand, and cannot."""
    message = f"what pushes the {side} hand is unknown: {why}"
    return Refusal(code=Code.CONTACT_UNKNOWN, message=message, field=f"{side}_arm", value=value)


def push_of(view: ContactView, axis: Vector) -> Push:
    """Return how hard a hand is pushed.

    Args:
        view: What is known of it.
        axis: Unit vector in its frame; empty for the force whatever its direction.
    """
    if view.state != "known":
        return Push(0.0, 0.0, f"{view.code}: {view.reason}")
    known = [
        (n, force, sd)
        for n, (force, sd) in enumerate(zip(view.wrench[:AXES], view.wrench_sd[:AXES], strict=True))
        if force is not None and sd is not None
    ]
    if not known:
        return Push(0.0, 0.0, "this posture feels no force on the hand")
    if not axis:
        return Push(math.hypot(*(force for _, force, _ in known)), max(sd for _, _, sd in known))
    if 1.0 - sum(axis[n] ** 2 for n, _, _ in known) > LOST:
        return Push(0.0, 0.0, "this posture does not feel that direction")
    return Push(sum(axis[n] * force for n, force, _ in known), sum(abs(axis[n]) * sd for n, _, sd in known))
