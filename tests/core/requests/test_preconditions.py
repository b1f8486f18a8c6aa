"""What the owner would be refused now is asked of the rules that refuse, and is never old for long."""

from __future__ import annotations

import pytest

from gateway.codes import Code
from gateway.core.requests.handler import RequestHandler
from gateway.core.requests.preconditions import PERIOD_NS, Preconditions
from gateway.core.supervision.supervisor import State
from gateway.errors import CODES
from gateway.messages.requests import Stop
from tests.changed import replace
from tests.core.stage import MODE, TICK_NS, L, R, Stage


class Asked(Stage):
    """A stage whose owner asks on every tick."""

    def __init__(self, *args, **kwargs) -> None:
        super().__init__(*args, **kwargs)
        for gripper in self.coordinator.body.grippers.values():
            gripper.start(self.now_ns, is_kept=False)
        self.preconditions = Preconditions(self.coordinator, RequestHandler(self.coordinator, self.phases))

    def codes(self, ticks: int = 21) -> dict[str, str]:
        """What is refused a period later."""
        for _ in range(ticks):
            self.run(1)
            self.preconditions.look(self.now_ns)
        return {kind: refusal.code for kind, refusal in self.preconditions.refusals.items()}


def test_who_may_do_everything_is_refused_nothing():
    """An owner in ACTIVE: enable (it is done), both arms and grippers, the chassis."""
    assert Asked(State.ACTIVE).codes() == {}


def test_each_kind_of_request_has_its_own_reason():
    """Arms need enabling, the chassis does not; the lift is asked about where there is one."""
    stage = Asked(State.IDLE, model="lift")
    arms = dict.fromkeys(("left_arm", "right_arm", "left_gripper", "right_gripper"), "NOT_ENABLED")
    assert stage.codes() == arms
    stage.mode = replace(MODE, chassis_enabled=False, lift_enabled=False)
    assert stage.codes() == {**arms, "chassis": "CHASSIS_DISABLED", "lift": "LIFT_DISABLED"}


def test_a_refusal_is_shown_whole():
    """Code, words, input, value, bound and unit as the refusal has them; the remedy of its code where it has none."""
    stage = Asked(State.ACTIVE)
    stage.say_mode(arm_enabled={L: False, R: True})
    stage.codes()
    seen = stage.preconditions.refusals["left_arm"]
    assert (seen.code, seen.field, seen.value, seen.bound) == ("ARM_DISABLED", "left_arm", "disabled", "enabled")
    assert seen.hint == CODES[Code.ARM_DISABLED].hint and "disabled" in seen.message and seen.unit == ""


def test_where_nobody_owns_the_robot_that_is_the_answer():
    """Not that an epoch is over."""
    assert set(Asked(State.READ_ONLY, owner=None).codes().values()) == {"NOT_OWNER"}


def test_what_changes_at_once_is_seen_at_once():
    """State and latches do not wait for the next period; what the robot says does, for a tenth of a second at most."""
    stage = Asked(State.ACTIVE)
    assert stage.codes() == {}
    stage.now_ns = (stage.now_ns // PERIOD_NS) * PERIOD_NS
    stage.codes(1)
    stage.coordinator.latch(Code.ESTOP, "by hand", stage.now_ns)
    assert set(stage.codes(1).values()) == {"LATCHED"}
    stage.coordinator.supervisor.clear()
    assert stage.codes(1) == {}
    stage.coordinator.go(State.PAUSED, stage.now_ns, "test")
    assert stage.codes(1)["left_arm"] == "ROBOT_PAUSED"
    stage.coordinator.is_exiting = True
    assert set(stage.codes(1).values()) == {"EXITING"}
    stage.coordinator.is_exiting = False
    stage.coordinator.go(State.ACTIVE, stage.now_ns, "test")
    assert stage.codes(1) == {}
    stage.mode = replace(MODE, api=False)
    assert stage.codes(1) == {} and set(stage.codes(PERIOD_NS // TICK_NS).values()) >= {"MODE_VR"}


def test_what_was_stopped_in_this_very_tick_does_not_matter():
    """It asks as if it came after this tick."""
    stage = Stage(State.ACTIVE)
    handler = RequestHandler(stage.coordinator, stage.phases)
    preconditions = Preconditions(stage.coordinator, handler)
    handler.answer(stage.command(Stop()), stage.now_ns)
    stage.coordinator.go(State.ACTIVE, stage.now_ns, "test")
    preconditions.look(stage.now_ns)
    assert "STOPPED" not in {refusal.code for refusal in preconditions.refusals.values()}


def test_where_nobody_ever_owned_the_robot_no_epoch_is_over():
    """Also after the first owner has gone."""
    stage = Asked(State.IDLE)
    assert stage.coordinator.lease.release("ann", stage.epoch, stage.now_ns) is None
    assert set(stage.codes().values()) == {"NOT_OWNER"}


@pytest.mark.parametrize("state", [State.IDLE, State.ACTIVE])
def test_a_mode_that_nobody_knows_is_the_reason(state):
    """For an arm that is sent setpoints and for one that is not."""
    stage = Asked(state)
    stage.mode = None
    stage.run(400)
    assert stage.codes()["left_arm"] == ("MODE_UNKNOWN" if state is State.ACTIVE else "NOT_ENABLED")
