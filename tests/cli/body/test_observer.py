"""Watching: each second a line that says what is missing; enough when every arm that is asked about is identified."""

from __future__ import annotations

import numpy as np
import pytest

from gateway.cli.body.observer import FIRST_S, Observer
from gateway.kinematics.identification.parameters import Group
from gateway.kinematics.identify import Identification, identify
from gateway.values import Side
from tests.kinematics.bodies import ARMS
from tests.kinematics.identities import measured, postures

GROUPS = frozenset({Group.JOINTS, Group.EE})
LEFT, RIGHT = Side.LEFT, Side.RIGHT
PER_S = 50
"""Pairs a second."""


def looked_on(pairs, sides=(LEFT,), seconds=60):
    """Return the lines of a session, and after how many seconds there was enough; None when the time ran out."""
    lines: list[str] = []
    observer = Observer(ARMS, sides, GROUPS, lines.append)
    for second in range(1, seconds + 1):
        so_far = {side: pairs[side][: PER_S * second] for side in sides}
        if observer(so_far, float(second), float(seconds - second)):
            return lines, second
    return lines, None


@pytest.mark.thorough
def test_it_ends_as_soon_as_there_is_enough():
    """Before, the worst parameter and how long it will take; what there is then is identified indeed."""
    pairs = {LEFT: measured(LEFT, postures(LEFT, 3000), noise=1.5)}
    lines, second = looked_on(pairs)
    assert second is not None and FIRST_S < second < 55
    assert isinstance(identify(ARMS[LEFT], pairs[LEFT][: PER_S * second], GROUPS), Identification)
    assert lines[-1].endswith(", enough") and lines[-1].startswith(f"at most {60 - second} s more; left: ")
    told = next(line for line in lines if "more of such motion" in line)
    assert " is known to ±" in told and "postures, gain " in told
    promised_s = float(told.split(": some ")[1].split(" s more")[0])
    at_s = lines.index(told) + 1
    assert 0.3 < (second - at_s) / promised_s < 3.0, (at_s, promised_s, second)


def test_an_arm_that_stands_still_is_waited_for():
    """The other one alone is not enough where both are asked about."""
    still = measured(RIGHT, np.tile(postures(RIGHT)[:1], (1500, 1)))
    lines, second = looked_on({LEFT: measured(LEFT, postures(LEFT, 3000)), RIGHT: still}, (LEFT, RIGHT), 30)
    assert second is None and "left: " in lines[-1] and ", enough" in lines[-1]
    assert lines[-1].endswith("right: stands still")


def test_what_motion_lacks_is_told():
    """Which joint to move; nothing of how long, which nobody knows."""
    q = postures(LEFT, 1000)
    q[:, 6] = q[0, 6]
    lines, second = looked_on({LEFT: measured(LEFT, q)}, seconds=20)
    assert second is None and "move joint 7" in lines[-1] and "more of such motion" not in lines[-1]


def test_what_no_motion_mends_is_told(capsys: pytest.CaptureFixture[str]):
    """Poses of the other arm: not explained, however long; lines are for standard error."""
    pairs = measured(LEFT, postures(RIGHT, 700))
    observer = Observer(ARMS, (RIGHT,), GROUPS)
    assert not observer({RIGHT: pairs}, 12.0, 8.0)
    assert "not explained by zeros and mounts" in capsys.readouterr().err
