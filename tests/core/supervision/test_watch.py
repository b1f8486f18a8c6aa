"""Watch: what stop endpoints ask for, what their silence does, and how each change is told."""

from __future__ import annotations

import pytest
from msgspec import structs

from gateway.core.messages.events import CommandRequested
from gateway.core.supervision.supervisor import State
from gateway.core.supervision.watch import Watch
from gateway.errors import Code, Refusal
from gateway.messages.incoming import OnLoss
from gateway.messages.requests import LeaveEndpoint, Recover, RegisterEndpoint
from tests.changed import replace
from tests.core.stage import MS, S, Stage

PAGE = RegisterEndpoint(name="page", timeout_ns=500 * MS)


def by(client: str, request: object, stage: Stage) -> CommandRequested:
    """A request of a client, now."""
    return CommandRequested(client_id=client, request_id=1, request=request, received_ns=stage.now_ns)


def watched(state: State, on_silence: OnLoss = OnLoss.HOLD, *, is_demanded: bool = False) -> tuple[Stage, Watch]:
    """A stage over which bob's page watches."""
    stage = Stage(state)
    coordinator = stage.coordinator
    coordinator.settings = replace(
        coordinator.settings, local=replace(coordinator.settings.local, demand_stop_endpoint=is_demanded)
    )
    watch = Watch(coordinator)
    page = structs.replace(PAGE, on_silence=on_silence)
    assert watch.register(by("bob", page, stage), page, stage.now_ns) == {"endpoint_id": 1}
    return stage, watch


def changes(stage: Stage) -> list[str]:
    """What was told of endpoints, in order."""
    return [notice.facts["change"] for notice in stage.coordinator.notices if "endpoint" in notice.facts]


def fall_silent(stage: Stage, watch: Watch, seconds: float = 0.6) -> None:
    """Let time pass at once; the robot is heard at the end of it."""
    stage.now_ns += round(seconds * S)
    stage.hear()
    watch.look(stage.now_ns, 0)


@pytest.mark.parametrize(("on_silence", "state"), [(OnLoss.HOLD, State.HOLDING), (OnLoss.PAUSE, State.IDLE)])
def test_silence_does_what_was_chosen(on_silence, state):
    """Hold keeps the robot armed, pause takes it down; both are told, and refuse motion."""
    stage, watch = watched(State.ACTIVE, on_silence)
    assert watch.refusal() is None
    fall_silent(stage, watch)
    assert stage.state is state and changes(stage) == ["registered", "silent"]
    refusal = watch.refusal()
    assert refusal is not None and refusal.code is Code.ENDPOINT_SILENT


def test_one_that_is_heard_again_is_told_and_nothing_resumes():
    """What is held stays held."""
    stage, watch = watched(State.ACTIVE)
    fall_silent(stage, watch)
    stage.coordinator.endpoints.heard("bob", stage.now_ns)
    watch.look(stage.now_ns, 0)
    assert stage.state is State.HOLDING and changes(stage)[-1] == "back" and watch.refusal() is None


def test_motion_rests_while_only_a_pause_of_ours_explains_a_silence():
    """Not told as silence."""
    stage, watch = watched(State.ACTIVE)
    stage.now_ns += 700 * MS
    stage.hear()
    watch.look(stage.now_ns, 600 * MS)
    assert stage.state is State.HOLDING and changes(stage) == ["registered"]


def test_a_daemon_that_ends_takes_nobody_in_and_a_wrong_period_is_refused():
    """With codes."""
    stage, watch = watched(State.IDLE)
    wrong = structs.replace(PAGE, timeout_ns=1)
    refusal = watch.register(by("bob", wrong, stage), wrong, stage.now_ns)
    assert isinstance(refusal, Refusal) and refusal.code is Code.OUT_OF_RANGE
    stage.coordinator.is_exiting = True
    refusal = watch.register(by("bob", PAGE, stage), PAGE, stage.now_ns)
    assert isinstance(refusal, Refusal) and refusal.code is Code.EXITING


@pytest.mark.parametrize(("is_demanded", "state"), [(False, State.ACTIVE), (True, State.HOLDING)])
def test_who_leaves_in_order_stops_nothing_unless_one_is_demanded(is_demanded, state):
    """Who is not there cannot leave."""
    stage, watch = watched(State.ACTIVE, is_demanded=is_demanded)
    leave = LeaveEndpoint()
    assert watch.leave(by("bob", leave, stage), leave, stage.now_ns) == {}
    assert stage.state is state and changes(stage) == ["registered", "left"]
    refusal = watch.leave(by("bob", leave, stage), leave, stage.now_ns)
    assert isinstance(refusal, Refusal) and refusal.code is Code.ENDPOINT_UNKNOWN


def test_the_last_one_that_leaves_beside_a_silent_one_is_not_the_missing_one():
    """Where one is demanded, a silent one is what refuses motion."""
    stage, watch = watched(State.IDLE, is_demanded=True)
    fall_silent(stage, watch)
    assert watch.register(by("eve", PAGE, stage), PAGE, stage.now_ns) == {"endpoint_id": 2}
    assert watch.leave(by("eve", LeaveEndpoint(), stage), LeaveEndpoint(), stage.now_ns) == {}
    refusal = watch.refusal()
    assert refusal is not None and refusal.code is Code.ENDPOINT_SILENT


def test_recover_needs_a_reason_while_one_is_silent_and_says_whom_it_lets_go():
    """A blank is no reason; the latch of an earlier daemon's endpoints needs one, too."""
    stage, watch = watched(State.IDLE)
    assert watch.may_recover(Recover()) is None
    fall_silent(stage, watch)
    refusal = watch.may_recover(Recover(reason=" "))
    assert refusal is not None and refusal.code is Code.ENDPOINT_SILENT and "page" in refusal.message
    why = Recover(reason="its page was closed")
    assert watch.may_recover(why) is None
    assert watch.dismiss("ann", why, stage.now_ns) == ["page"]
    told = stage.coordinator.notices[-1]
    assert (
        told.facts["change"] == "dismissed"
        and "recover() by ann let" in told.message
        and "its page was closed" in told.message
    )
    assert watch.refusal() is None and watch.may_recover(Recover()) is None
    stage.coordinator.latch(Code.ENDPOINT_SILENT, "stop endpoints of an earlier daemon: page", stage.now_ns)
    assert watch.may_recover(Recover()) is not None
