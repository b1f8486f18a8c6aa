"""Tests of the loop of `ta2 teleop`, with the real engine and a robot in virtual time."""

from __future__ import annotations

import numpy as np
import pytest

from gateway.cli.teleop.keyboard import Wish
from gateway.errors import Code, GatewayError
from tests.cli.teleop.world import Turn

FULL = {axis: 1.0 for axis in ("x", "y", "z", "roll", "pitch", "yaw")}
AXES = [("x", 0), ("y", 1), ("z", 2)]


@pytest.fixture(params=["joint", "pose"])
def turn(request):
    """A turn with a robot in either control mode."""
    return Turn(is_modelled=True, left_mode=request.param)


@pytest.mark.parametrize(("axis", "row"), AXES)
def test_the_hand_goes_where_it_is_wished_in_both_modes(turn, axis, row):
    """Along the axis of the shoulder frame, and nowhere else, at no more than full speed; its orientation stays."""
    turn.run((0.4, {}), (1.0, {axis: 1.0}), (1.0, {}))
    before = turn.left.pose
    turn.run((1.0, {axis: -1.0}), (1.0, {}))
    after = turn.left.pose
    way = after.p - before.p
    assert -0.055 < way[row] < -0.03, turn.said
    assert np.abs(np.delete(way, row)).max() < 0.004
    assert abs(float(np.dot(before.quat_xyzw, after.quat_xyzw))) > 0.9999
    assert turn.robot.state.state == "HOLDING" and turn.said == []
