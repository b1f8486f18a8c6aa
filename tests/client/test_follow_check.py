"""Judging points without moving, from both clients, against the real engine and the simulated robot in virtual time."""

from __future__ import annotations

import numpy as np
import pytest

from gateway.client import FollowCheck, aio, connect
from gateway.errors import Code, Rejected
from tests.client.playing import play
from tests.client.robot_world import RobotWorld


@pytest.fixture
def world():
    """A robot in joint mode that nobody owns."""
    return RobotWorld()


def swing(state, off_rad=0.0):
    """A swing of joint 4 of the left arm that begins so far from where it hangs."""
    ways = off_rad + 0.1 * (1.0 - np.cos(0.1 * np.arange(40)))
    return {"left": state.left_arm.q + ways[:, None] * np.eye(7)[3]}


def test_points_are_judged_without_the_lease_and_nothing_moves(world):
    """How long, how far away, how much smoothing moves; the first point to blame when they are refused."""
    with connect(transport=world.transport(), name="looks") as robot:
        judged = robot.check_follow(swing(robot.state, off_rad=0.05), 0.05, smoothing=0.1)
        assert isinstance(judged, FollowCheck) and judged.duration == pytest.approx(39 * 0.05) and judged.moved > 0.0
        assert judged.away["left"][3] == pytest.approx(0.05, abs=0.01) and judged.skipped == 0
        with pytest.raises(Rejected) as caught:
            robot.check_follow(swing(robot.state), 0.005)
        assert caught.value.code is Code.TOO_FAST and caught.value.field.startswith("left_arm[")
        with pytest.raises(Rejected) as caught:
            robot.check_follow(swing(robot.state, off_rad=0.4), 0.05)
        assert caught.value.code is Code.JUMP_TOO_FAR
        far = robot.check_follow(swing(robot.state, off_rad=0.4), 0.05, from_here=False, stretch=2.0)
        assert far.away["left"][3] == pytest.approx(0.4, abs=0.01) and far.duration == pytest.approx(78 * 0.05)
        assert not robot.state.lease.owned
    assert not world.pair.frames


def test_the_asyncio_client_judges_alike(world):
    """The same words, the same answer."""

    async def scene():
        async with aio.connect(transport=world.transport(), name="looks") as robot:
            return await robot.check_follow(swing(await robot.state()), times=np.arange(40) * 0.05)

    assert play(world, scene).duration == pytest.approx(39 * 0.05)
    assert not world.pair.frames
