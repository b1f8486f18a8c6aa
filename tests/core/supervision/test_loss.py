"""Loss: each stage of a lost owner is told and does what the supervisor's table says."""

from __future__ import annotations

import pytest

from gateway.core.messages.outputs import Level
from gateway.core.supervision.loss import STAGE_NAMES, Loss
from gateway.core.supervision.supervisor import State
from gateway.errors import Code
from gateway.messages.incoming import OnLoss
from tests.core.stage import MS, S, Stage


def stages(stage: Stage) -> list[str]:
    """Stages that were told, in order."""
    return [notice.facts["stage"] for notice in stage.coordinator.notices if notice.code is Code.LOSS_STAGE]


def lost(state: State, on_loss: OnLoss = OnLoss.HOLD) -> tuple[Stage, Loss]:
    """A stage whose owner is gone, and was told to be."""
    stage = Stage(state)
    stage.coordinator.lease.acquire("ann", "ann", 7, on_loss, stage.now_ns)
    stage.coordinator.lease.gone("ann", stage.now_ns)
    loss = Loss(stage.coordinator)
    loss.look(stage.now_ns, 0)
    return stage, loss


def pass_time(stage: Stage, loss: Loss, seconds: float) -> None:
    """Let time pass at once; the robot is heard at the end of it."""
    stage.now_ns += round(seconds * S)
    stage.hear()
    loss.look(stage.now_ns, 0)


def test_every_stage_has_a_name():
    """Notices carry it for programs."""
    assert sorted(STAGE_NAMES.values()) == ["back", "down", "free", "lost"]


def test_a_lost_owner_of_a_held_robot_goes_through_all_stages():
    """Lost: brake and hold; free after 10 s; down after 60 s. Each is told once, loudly."""
    stage, loss = lost(State.ACTIVE)
    assert stage.state is State.HOLDING and stages(stage) == ["lost"]
    pass_time(stage, loss, 10.0)
    assert stage.coordinator.lease.owner is None and stage.state is State.HOLDING
    pass_time(stage, loss, 50.0)
    assert stage.state is State.READ_ONLY and stages(stage) == ["lost", "free", "down"]
    told = [notice for notice in stage.coordinator.notices if notice.code is Code.LOSS_STAGE]
    assert {notice.level for notice in told} == {Level.WARNING} and "ann is lost" in told[0].message


def test_an_owner_who_comes_back_ends_the_clocks():
    """Told at ease; what was held is held."""
    stage, loss = lost(State.ACTIVE)
    stage.coordinator.lease.seen("ann", stage.now_ns + 1)
    pass_time(stage, loss, 0.1)
    assert stages(stage) == ["lost", "back"] and stage.state is State.HOLDING
    assert [n.level for n in stage.coordinator.notices if n.facts.get("stage") == "back"] == [Level.INFO]


@pytest.mark.parametrize("state", [State.ENABLING, State.ACTIVE, State.HOLDING])
def test_on_loss_pause_goes_down_at_once(state):
    """And the lease is free."""
    stage, _ = lost(state, OnLoss.PAUSE)
    assert stage.state is State.READ_ONLY and stage.coordinator.lease.owner is None


def test_a_loss_while_nothing_is_held_has_no_last_stage():
    """IDLE: the lease gets free; nothing goes down after 60 s, and nobody says so."""
    stage, loss = lost(State.IDLE)
    pass_time(stage, loss, 10.0)
    pass_time(stage, loss, 60.0)
    assert stages(stage) == ["lost", "free"]


def test_the_last_stage_of_a_robot_that_is_stopping_anyway_is_not_told():
    """The table says: nothing; so nothing is said."""
    stage, loss = lost(State.STOPPING)
    pass_time(stage, loss, 10.0)
    pass_time(stage, loss, 50.0)
    assert stages(stage) == ["lost", "free"] and stage.state is State.STOPPING


def test_a_pause_of_this_process_is_no_silence_of_the_owner():
    """After a late tick the keepalives that came meanwhile are still to be read."""
    stage = Stage(State.ACTIVE)
    loss = Loss(stage.coordinator)
    stage.coordinator.lease.seen("ann", stage.now_ns)
    stage.now_ns += S
    loss.look(stage.now_ns, S)
    assert stages(stage) == []


def test_an_owner_that_only_a_pause_explains_moves_nothing():
    """It is not lost; what moves brakes, and is held, until it is heard."""
    stage = Stage(State.ACTIVE)
    loss = Loss(stage.coordinator)
    stage.now_ns += 400 * MS
    stage.hear()
    loss.look(stage.now_ns, 300 * MS)
    assert stages(stage) == [] and stage.state is State.HOLDING
    told = [notice.message for notice in stage.coordinator.notices if notice.code is Code.STATE_CHANGED]
    assert "430 ms ago" in told[0]
