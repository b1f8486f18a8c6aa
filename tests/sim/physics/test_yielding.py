"""A hand that yields, as a whole and in virtual time: engine, robot with forces, masses and friction that are off the model."""

from __future__ import annotations

import numpy as np
import pytest

REASON = "pinocchio or MuJoCo is not installed: pip install 'teleavatar-gateway[body,sim]'"
pytest.importorskip("pinocchio", reason=REASON)
pytest.importorskip("mujoco", reason=REASON)

from gateway.core.motion.poses.quaternion import turn
from gateway.errors import Code
from gateway.messages.requests import Stop
from tests.sim.physics.yielding import Yielding, held, steady

REST_M = 2e-4
"""A setpoint that moves by less than this in half a second is at rest: a fifth of a millimetre [m]."""


def is_calm(rows, seconds=0.5):
    """Whether the setpoint stood still at the end."""
    last = rows[-round(seconds * 160) :, 1]
    return bool((np.ptp(last, axis=0) < REST_M).all())


def test_a_hand_is_led_without_swinging_and_stays_where_it_is_let_go():
    """Somebody's spring and damper lead it, the plant is 5 % off; let go it is at rest, and nothing came back."""
    pair = Yielding()
    pair.yields()
    idle = pair.guide(0.5)
    assert np.ptp(idle[:, 1], axis=0).max() == 0.0, "what the model does not know moves nothing"
    led = pair.guide(2.5, held(pair.hand[0] + (0.0, 0.08, 0.05)))
    moved = led[-1, 1] - led[0, 1]
    assert moved[1] > 0.03
    back = np.diff(led[:, 1], axis=0).clip(max=0.0).sum(axis=0)
    assert (back > -0.003).all(), "it goes there, and does not swing on the way or there"
    free = pair.guide(1.0)
    assert is_calm(free) and np.abs(free[-1, 1] - free[0, 1]).max() < 0.01
    assert pair.state == "ACTIVE" and not pair.engine.latches


def test_a_spring_leads_it_home_without_overshoot_and_holds_steadily_meanwhile():
    """Held away against its spring it stands; let go it returns, and no further than a millimetre beyond."""
    pair = Yielding()
    pair.yields({"stiffness": (200.0,) * 3 + (0.0,) * 3})
    led = pair.guide(3.0, held(pair.hand[0] - (0.0, 0.08, 0.0)))
    assert led[-1, 1, 1] < pair.anchor[1] - 0.015
    assert np.ptp(led[-130:, 1], axis=0).max() < 0.002, "dry friction makes no limit cycle"
    home = pair.guide(2.5)
    away = home[:, 1] - pair.anchor[:3]
    assert np.abs(away[-1]).max() < 0.003 and away.max() < 0.001


def test_pushed_against_the_table_it_neither_chatters_nor_winds_up():
    """20 N down until the table carries them: the setpoint stands; pulled up it comes at once."""
    pair = Yielding(start_x_m=0.45)
    pair.world.pose_thing("block", (1.3, -0.4, 0.78))
    pair.yields()
    pressed = pair.guide(3.0, lambda place, speed: np.array([0.0, 0.0, -20.0 - 10.0 * speed[2], 0.0, 0.0, 0.0]))
    assert pair.touches_table() and pressed[-1, 1, 2] < pressed[0, 1, 2] - 0.02
    assert is_calm(pressed, 1.0) and pair.state == "ACTIVE" and not pair.engine.latches
    lifted = pair.guide(0.6, lambda place, speed: np.array([0.0, 0.0, 20.0 - 10.0 * speed[2], 0.0, 0.0, 0.0]))
    assert lifted[64, 1, 2] > lifted[0, 1, 2] + 0.002 and not pair.touches_table()


def test_a_moment_turns_it_about_the_axes_that_are_free_alone():
    """3 N·m about z; a push moves it nowhere, since shifts are locked."""
    pair = Yielding()
    pair.yields({"mass": (None,) * 3 + (0.2,) * 3, "damping": (0.0,) * 3 + (20.0,) * 3})
    pair.guide(0.8, lambda place, speed: np.array([0.0, 10.0, 0.0, 0.0, 0.0, 3.0 - 0.5 * speed[5]]))
    turned = turn(pair.anchor[3:], pair.arm.values[3:])
    assert turned[2] > 0.04 and abs(turned[0]) < 0.02 and abs(turned[1]) < 0.03
    assert pair.arm.values[:3] == pytest.approx(pair.anchor[:3], abs=1e-9)


@pytest.mark.parametrize("end", ["death", "stop", "unknown"])
def test_every_end_brakes_and_holds(end):
    """An owner that dies, somebody's stop, and an estimate that is lost: while the hand is being led."""
    pair = Yielding(0.0)
    pair.yields()
    pull = steady((0.0, 10.0, 0.0))
    pair.guide(0.5, pull)
    assert not pair.arm.is_at_rest
    if end == "death":
        pair.kill()
    elif end == "stop":
        pair.granted(Stop(), "somebody")
    else:
        pair.model.contacts.forget()
    pair.guide(0.5, pull)
    place = pair.arm.values
    pair.run(0.1)
    assert pair.arm.is_at_rest and pair.arm.values == place
    stream = pair.engine._coordinator.body.targets.find(pair.stream_id)
    codes = {"death": Code.CLIENT_LOST, "stop": Code.STOPPED, "unknown": Code.CONTACT_UNKNOWN}
    assert stream.code is codes[end]
    assert end != "unknown" or any(
        "left arm brakes and holds: what pushes" in notice.message for notice in pair.notices
    )


def test_while_nothing_is_known_yet_it_is_refused():
    """The first fifth of a second, with the reason."""
    pair = Yielding(0.0)
    pair.model.contacts.forget()
    pair.run(0.05)
    refusal = pair.refused(pair.asked())
    assert refusal.code is Code.CONTACT_UNKNOWN and "observed for" in refusal.message
    pair.run(0.5)
    pair.granted(pair.asked())
