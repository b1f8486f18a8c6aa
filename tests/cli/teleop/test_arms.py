"""Tests of one arm that is jogged, without a gateway: how far ahead its target may go. The rest: test_session.py."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from gateway.api.translate import describe
from gateway.cli.teleop.arms import Arm, held_up
from gateway.cli.teleop.jogging import AXES
from gateway.kinematics.arm import ArmModel
from gateway.kinematics.description import nominal
from gateway.robot.limits import HOME_Q_RAD
from gateway.settings.settings import Settings
from gateway.values import Side

INFO = describe(Settings(), socket="/s", pid=1)
STEP_S = 0.02


class Out:
    """A stream of joints that takes everything inside the limits."""

    side = "left"

    def __init__(self):
        self.q = np.array(HOME_Q_RAD[Side.LEFT])

    def set(self, q):
        """Take a target, clipped."""
        self.q = np.clip(np.array(q), INFO.lower_rad["left"], INFO.upper_rad["left"])
        return self.q


def state(q_ref, q=None, error_rad=0.0, spacing=None, findings=(), model="agrees"):
    """What the gateway tells."""
    arm = SimpleNamespace(
        q_ref=np.array(q_ref),
        q=np.array(q_ref if q is None else q),
        tracking_error=error_rad,
        model=SimpleNamespace(state=model, reason="16 mm apart"),
    )
    return SimpleNamespace(arm=lambda _: arm, spacing=spacing, view=SimpleNamespace(findings=findings))


@pytest.fixture
def arm():
    """An arm in joint mode at its initial position."""
    return Arm(Out(), ArmModel(nominal(), Side.LEFT), INFO)


def advance(arm, seen, **rates):
    """Take a step."""
    return arm.advance({**dict.fromkeys(AXES, 0.0), **rates}, 3, STEP_S, seen, in_hand=False)


def test_a_target_waits_for_a_reference_that_stands(arm):
    """It is ahead by a third of a second of its own speed and no more, however long is wished for."""
    begin = arm.out.q.copy()
    said = {advance(arm, state(begin), joint=0.2) for _ in range(200)}
    assert 0.05 < arm.out.q[3] - begin[3] < 0.2 * 0.3 + 0.02
    assert said == {"", "held up: the arm is behind its target"}
    back = arm.out.q[3]
    assert advance(arm, state(arm.out.q), joint=-0.2) == "" and arm.out.q[3] < back


def test_a_target_goes_on_while_the_reference_follows(arm):
    """A tenth of a second behind."""
    told, begin = [arm.out.q.copy()] * 5, arm.out.q.copy()
    for _ in range(100):
        assert advance(arm, state(told.pop(0)), joint=0.5) == ""
        told.append(arm.out.q.copy())
    assert arm.out.q[3] - begin[3] == pytest.approx(1.0)


def test_an_arm_that_does_not_follow_is_led_back_to_where_it_is(arm):
    """Until everything was let go; then it goes another way."""
    stuck = arm.out.q.copy()
    ahead = stuck + np.eye(7)[3] * 0.5 * INFO.tracking_rad
    arm.out.q = ahead.copy()
    assert "does not follow" in advance(arm, state(ahead, stuck, 0.5 * INFO.tracking_rad), joint=0.2)
    assert np.allclose(arm.out.q, stuck)
    assert "does not follow" in advance(arm, state(stuck), joint=0.2) and np.allclose(arm.out.q, stuck)
    advance(arm, state(stuck))
    assert advance(arm, state(stuck), joint=-0.2) == "" and arm.out.q[3] < stuck[3]


def test_no_joint_races_for_the_hand(arm):
    """However fast the hand is wished for, and the hand goes less far then."""
    for twist in ({"x": 5.0}, {"yaw": 20.0}, {"z": -5.0, "roll": 20.0}):
        before = arm.out.q.copy()
        advance(arm, state(before), **twist)
        assert np.abs(arm.out.q - before).max() <= 0.8 * INFO.v_radps * STEP_S + 1e-9


def test_the_hand_takes_a_model_that_agrees(arm):
    """Else it stays, with the reason."""
    before = arm.out.q.copy()
    said = advance(arm, state(before, model="differs"), x=0.1)
    assert "16 mm apart" in said and "jog joints" in said and np.allclose(arm.out.q, before)


def test_what_holds_an_arm_up_is_told():
    """Another part of the body, what the gateway has found, or that nobody knows."""
    near = SimpleNamespace(held=("left",), gap_m=0.031, margin_m=0.03, first="left_palm", second="torso")
    assert held_up(state([], spacing=near), "left") == (
        "held back: left_palm and torso are 31 mm apart, 30 mm have to stay free"
    )
    found = SimpleNamespace(code="IK_REFUSED", message="the arm stands")
    assert held_up(state([], findings=(found,)), "left") == "held up: IK_REFUSED: the arm stands"
    assert held_up(state([], spacing=near), "right") == "held up: the arm is behind its target"
