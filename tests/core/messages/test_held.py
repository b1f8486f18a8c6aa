"""What one process shows to another: when there is nothing to go on with."""

from __future__ import annotations

import pytest
from msgspec.structs import replace

from gateway.core.messages.held import Held, HeldArm
from gateway.values import Side

NOTHING = Held(at_ns=5, state="IDLE")
ARM = HeldArm(topic="/api/left_arm/joint_cmd", values=(0.0,) * 7, rate=(0.0,) * 7, acceleration=(0.0,) * 7)


def test_a_process_that_sends_nothing_and_owes_nothing_is_silent():
    """Whatever its state is called."""
    assert NOTHING.is_silent
    assert replace(NOTHING, state="READ_ONLY", epoch=7, last_frame_ns=4).is_silent


@pytest.mark.parametrize(
    "something",
    [
        {"arms": {Side.LEFT: ARM}},
        {"beat": "one"},
        {"beat": "zero"},
        {"is_owed": True},
        {"is_estop": True},
        {"has_chassis": True},
        {"has_lift": True},
    ],
)
def test_whatever_is_on_the_wire_or_owed_is_not_silence(something):
    """One of them is enough: somebody would have to go on, or to end it."""
    shown = replace(NOTHING, **something)
    assert not shown.is_silent
    assert shown.is_sending is not ("is_owed" in something or "is_estop" in something)
