"""BEHAVIOUR, Stopping: how the daemon ends, and what survives it."""

from __future__ import annotations

import pytest

from gateway.core.messages.events import ExitRequested
from gateway.core.messages.outputs import Remembered
from gateway.errors import Code
from gateway.messages.requests import Disable, Enable, Estop, Move, Recover, Stop
from gateway.robot.topics import FSM_ENABLE, FSM_STATE, LIFT_COMMAND
from gateway.settings.settings import ArmSettings
from gateway.sim.robot.settings import SimSettings
from tests.behaviour.scene import HOME, REACHED_BY, Scene, scene
from tests.pair import MS, S

STATES = tuple(REACHED_BY)
ZEROS, STOPPED, OFF = (0.0, 0.0, 0.0), (0.0, 1.0), (0.0, 0.0)


# ---------------------------------------------------------------------------------------------------------- the end


@pytest.mark.parametrize("state", STATES)
@pytest.mark.parametrize("model", ["standard", "lift"])
def test_sigterm_ends_in_less_than_5_s_with_0_0(state: str, model: str) -> None:
    """In every state; where 1.0 was out the last heartbeat is 0.0, and where the lift was commanded, [0,0]."""
    pair = scene(state, Scene(model=model))
    if model == "lift":
        pair.ask(Stop(), "ann")
    pair.receive(ExitRequested(at_ns=pair.now_ns))
    asked_ns = pair.now_ns
    pair.run_until(lambda: pair.done, 5.0)
    assert pair.now_ns - asked_ns < 5 * S
    ever = [frame.values for _, frame in pair.sent_on(FSM_ENABLE)]
    if state != "OFFLINE":  # out of reach: the robot's own watchdogs pause it
        assert (1.0,) not in ever or ever[-1] == (0.0,)
    if model == "lift":
        assert pair.values(LIFT_COMMAND)[-1] == OFF


def test_sigterm_in_the_middle_of_a_brake_brakes_on() -> None:
    """HOLDING that is not yet at rest: silence in motion would hand the brake to the robot's protection."""
    pair = scene("ACTIVE")
    pair.granted(Stop(), "ann")
    pair.mark()
    pair.receive(ExitRequested(at_ns=pair.now_ns))
    pair.run(0.05)
    assert pair.state == "STOPPING" and pair.arm_frames()
    pair.stops_first()
    pair.run_until(lambda: pair.done, 5.0)


def test_sigterm_with_slow_brakes_pauses_the_robot_in_time() -> None:
    """A brake that takes longer than there is time goes on under 0.0: the end is < 5 s and with 0.0."""
    pair = scene("at rest", Scene(arm=ArmSettings(a_radps2=0.1, j_radps3=0.2)))
    pair.granted(Move(epoch=pair.epoch, targets_rad=HOME), "ann")
    pair.run(6.0)
    pair.robot.inject({"fault": "drop", "topic": FSM_STATE}, pair.now_ns)
    pair.mark()
    pair.receive(ExitRequested(at_ns=pair.now_ns))
    pair.run(0.1)
    asked_ns = pair.now_ns
    pair.run_until(lambda: pair.done, 5.0)
    assert pair.now_ns - asked_ns < 4900 * MS and pair.beats[-1] == 0.0 and pair.fsm == 0


def test_nothing_is_accepted_any_more_once_the_end_was_asked_for() -> None:
    """EXITING for requests; `stop` and `estop` still work."""
    pair = scene("ACTIVE")
    pair.receive(ExitRequested(at_ns=pair.now_ns))
    for request in (Move(epoch=pair.epoch, targets_rad=HOME), Enable(epoch=pair.epoch), Disable(epoch=pair.epoch)):
        assert pair.refused(request, "ann").code is Code.EXITING
    pair.granted(Estop(), "bob")
    pair.receive(ExitRequested(at_ns=pair.now_ns))
    pair.run_until(lambda: pair.done, 5.0)
    assert pair.beats[-1] == 0.0


# ------------------------------------------------------------------------------------------------ what is remembered


def test_latches_survive_a_restart_of_the_daemon() -> None:
    """In the state file; only `recover` clears them."""
    pair = scene("ACTIVE")
    pair.granted(Stop(reason="dog"), "bob")
    assert Code.STOPPED_BY_OTHER in pair.remembered.latches
    pair.restart()
    pair.run_until(lambda: pair.state == "READ_ONLY" and pair.knows_mode)
    epoch = pair.own("ann")
    pair.run(2.0)
    refusal = pair.refused(Enable(epoch=epoch), "ann")
    assert refusal.code is Code.LATCHED and "dog" in refusal.message
    pair.granted(Recover(), "ann")
    assert pair.remembered.latches == {}


def test_an_epoch_is_never_reused() -> None:
    """Not after a restart of the daemon either; commands of the old epoch are refused."""
    pair = scene("ACTIVE")
    assert pair.remembered.epoch == pair.epoch
    pair.restart()
    pair.run_until(lambda: pair.state == "READ_ONLY" and pair.knows_mode)
    assert pair.own("ann") == pair.epoch + 1
    assert pair.refused(Enable(epoch=pair.epoch), "ann").code is Code.LEASE_STALE


@pytest.mark.parametrize("fsm", [0, 2])
def test_a_remembered_estop_is_sent_again_only_where_it_is_needed(fsm: int) -> None:
    """A daemon that starts with a latched e-stop cannot know whether it was heard: again when fresh and FSM is 1-2."""
    latched = Remembered(epoch=7, latches={Code.ESTOP: "estop() by bob"})
    pair = Scene(SimSettings(state_period_ns=10 * MS), latched)
    pair.robot.inject({"fault": "fsm_value", "value": fsm}, pair.now_ns)
    pair.run(0.5)
    assert (0.0 in pair.beats) is (fsm == 2) and pair.own("ann") == 8
