"""Requests for grippers: who may, what is sent, and what is refused with the state of its arm."""

from __future__ import annotations

import math

import pytest

from gateway.core.messages.outputs import FrameKind
from gateway.core.requests.authorisation import Authorisation
from gateway.core.requests.gripping import Gripping
from gateway.core.requests.moves import Facts
from gateway.core.supervision.supervisor import State
from gateway.errors import Code, Refusal
from gateway.messages.requests import SetGripper
from gateway.robot.topics import gripper_command
from gateway.values import Side
from tests.core.stage import L, R, Stage


class Scene(Stage):
    """A stage whose grippers run with its arms, and a place that takes requests for them."""

    def __init__(self, state: State = State.ACTIVE, sides: tuple[Side, ...] = (L, R)) -> None:
        super().__init__(state, sides=sides)
        self.gripping = Gripping(self.coordinator, Authorisation(self.coordinator, self.phases.starting))
        self.grippers = self.coordinator.body.grippers
        for side in sides:
            self.grippers[side].enter(0.1, self.now_ns)

    def ask(self, raw: float, side: Side = L, client: str = "ann", epoch: int | None = None) -> Facts | Refusal:
        """Ask for another force input."""
        request = SetGripper(epoch=self.epoch if epoch is None else epoch, side=side, raw=raw)
        return self.gripping.set_gripper(self.command(request, client), request, self.now_ns)


@pytest.mark.parametrize(("raw", "torque_nm"), [(0.0, 2.0), (0.1, 0.0), (0.55, -0.8), (1.0, -1.6)])
def test_a_value_is_taken_and_its_torque_told(raw, torque_nm):
    """It leaves within 20 ms as the owner's (manual §4.4)."""
    scene = Scene()
    assert scene.ask(raw) == {"raw": raw, "torque_nm": pytest.approx(torque_nm)}
    sent = [frame for frame in scene.run(2) if frame.topic == gripper_command(L)]
    assert [(frame.kind, frame.values, frame.epoch) for frame in sent] == [(FrameKind.MOTION, (raw,), scene.epoch)]
    assert scene.grippers[R].raw == 0.1


def test_in_holding_it_is_what_the_owner_resumes_with():
    """A command opened afterwards ends the hold, as a motion would."""
    scene = Scene(State.HOLDING)
    assert isinstance(scene.ask(0.8), dict) and scene.state is State.ACTIVE


@pytest.mark.parametrize(
    ("state", "code"),
    [
        (State.IDLE, Code.NOT_ENABLED),
        (State.ENABLING, Code.NOT_ENABLED),
        (State.PAUSED, Code.ROBOT_PAUSED),
        (State.STOPPING, Code.STOPPING),
        (State.STALE, Code.STATE_STALE),
        (State.OFFLINE, Code.NO_LINK),
    ],
)
def test_where_no_arm_may_move_no_gripper_may_either(state, code):
    """With the state's code."""
    scene = Scene(state)
    refusal = scene.ask(0.8)
    assert isinstance(refusal, Refusal) and refusal.code is code and scene.grippers[L].wanted == 0.1


def test_a_gripper_whose_arm_is_not_streamed_says_so():
    """Without the arm's stream there is no torque (manual §4.4); the other one is not concerned."""
    scene = Scene(sides=(R,))
    refusal = scene.ask(0.8)
    assert isinstance(refusal, Refusal) and (refusal.code, refusal.field) == (Code.NOT_ENABLED, "left_gripper")
    assert (refusal.value, refusal.bound) == ("off", "enabled")
    assert "§4.4" in refusal.message and isinstance(scene.ask(0.8, R), dict)


@pytest.mark.parametrize("raw", [-0.01, 1.01, math.nan, math.inf, -math.inf])
def test_what_is_no_input_is_refused(raw):
    """The robot promises nothing for it (manual §4.4)."""
    scene = Scene()
    refusal = scene.ask(raw)
    assert isinstance(refusal, Refusal) and (refusal.field, refusal.bound) == ("left_gripper", "[0, 1]")
    assert refusal.code is (Code.OUT_OF_RANGE if math.isfinite(raw) else Code.NOT_FINITE)
    assert scene.grippers[L].wanted == 0.1


def test_only_the_owner_grips():
    """Under the current epoch, and not while something is latched."""
    scene = Scene()
    for answer in (scene.ask(0.8, client="bob"), scene.ask(0.8, epoch=0)):
        assert isinstance(answer, Refusal) and answer.code is Code.NOT_OWNER
    scene.coordinator.latch(Code.TRACKING_ERROR, "blocked", scene.now_ns)
    refusal = scene.ask(0.8)
    assert isinstance(refusal, Refusal) and refusal.code is Code.LATCHED
