"""Whether a gripper seems to hold something: each part of the rule, and what nobody can tell."""

from __future__ import annotations

import pytest

from gateway.core.messages.events import SampleArrived
from gateway.core.supervision.grip import Grips
from gateway.core.supervision.supervisor import State
from gateway.robot.topics import gripper_state
from gateway.settings.settings import ModelSettings, Settings
from gateway.values import FsmState, MotorState
from tests.core.stage import L, Stage


class Scene(Stage):
    """A stage whose left gripper is told something and whose motor says something."""

    def __init__(self, raw: float = 0.8, settings: Settings | None = None) -> None:
        super().__init__(State.ACTIVE, settings=settings)
        self.grips = Grips(self.coordinator)
        self.gripper = self.coordinator.body.grippers[L]
        self.gripper.enter(raw, self.now_ns)

    def look(self, q_rad: float | None = 0.4, dq_radps: float | None = 0.0, ticks: int = 32) -> bool | None:
        """Let time pass; return what is taken to be so at its end."""
        for _ in range(ticks):
            self.run(1)
            if q_rad is not None:
                speeds = () if dq_radps is None else (dq_radps,)
                value = MotorState(q_rad=(q_rad,), dq_radps=speeds, tau_nm=(), stamp_ns=self.now_ns)
                sample = SampleArrived(topic=gripper_state(L), value=value, received_ns=self.now_ns)
                self.coordinator.store.receive(sample, self.now_ns)
            self.grips.step(self.now_ns)
        return self.gripper.is_holding


def test_a_gripper_that_closes_and_stands_still_half_way_holds_something():
    """For 0.3 s; not before."""
    scene = Scene()
    assert scene.look(ticks=30) is False and scene.look(ticks=2) is True


@pytest.mark.parametrize(
    ("raw", "q_rad", "dq_radps"),
    [(0.1, 0.4, 0.0), (0.14, 0.4, 0.0), (0.0, 0.4, 0.0), (0.8, 0.02, 0.0), (0.8, 0.4, -0.2)],
)
def test_one_that_does_not_close_is_closed_or_moves_holds_nothing(raw, q_rad, dq_radps):
    """Each part of the rule alone."""
    assert Scene(raw).look(q_rad, dq_radps) is False


@pytest.mark.parametrize(("side", "holds"), [("left", False), ("right", True)])
def test_closed_is_where_the_settings_have_it(side, holds):
    """Each gripper has its own."""
    settings = Settings(model=ModelSettings(**{f"{side}_gripper_closed_rad": 0.4}))
    assert Scene(settings=settings).look(0.42) is holds and Scene(settings=settings).look(0.44) is True


@pytest.mark.parametrize("fsm", [None, FsmState.PAUSE, FsmState.ERROR])
def test_nobody_can_tell_of_a_gripper_that_may_have_no_torque(fsm):
    """The FSM drives nothing, or is not heard; driven again, the wait begins anew."""
    scene = Scene()
    assert scene.look() is True
    scene.fsm = fsm
    assert scene.look(ticks=60) is None
    scene.fsm = FsmState.SLOW_START
    assert scene.look(ticks=30) is not True and scene.look(ticks=10) is True


def test_a_slip_begins_the_wait_anew():
    """It has not stood still since."""
    scene = Scene()
    scene.look(ticks=25)
    assert scene.look(dq_radps=-0.2, ticks=1) is False and scene.look(ticks=30) is False and scene.look(ticks=2) is True


@pytest.mark.parametrize(("q_rad", "dq_radps"), [(None, 0.0), (0.4, None)])
def test_without_fresh_state_or_velocity_nobody_can_tell(q_rad, dq_radps):
    """Never heard, or old, or without the velocity that the rule asks for."""
    scene = Scene()
    assert scene.look(q_rad, dq_radps) is None
    scene.look()
    assert scene.look(None, ticks=15) is None and scene.look(ticks=30) is False


def test_nothing_is_told_of_a_gripper_that_is_sent_nothing():
    """Its arm is not streamed: there is no torque."""
    scene = Scene()
    assert scene.look() is True
    scene.coordinator.body.arms[L].stop()
    assert scene.look(ticks=1) is None
