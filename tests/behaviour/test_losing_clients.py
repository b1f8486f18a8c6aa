"""BEHAVIOUR, Losing: clients that vanish, leave or are taken over."""

from __future__ import annotations

import pytest

from gateway.core.messages.events import ClientSeen
from gateway.core.messages.outputs import FrameKind
from gateway.errors import Code
from gateway.messages.incoming import OnLoss
from gateway.messages.requests import Abandon, Acquire, Move, OpenStream, Release, Stop, Take
from gateway.robot.topics import LIFT_COMMAND
from gateway.settings.settings import LossSettings
from gateway.values import Side
from tests.behaviour.scene import HOME, QUICK, Scene, away, scene
from tests.pair import MS, S
from tests.thoroughness import IS_THOROUGH


def stages(pair: Scene) -> list[str]:
    """Stages of a loss that were told since the mark."""
    return [notice.facts["stage"] for notice in pair.notices if notice.code is Code.LOSS_STAGE]


def lose(pair: Scene) -> int:
    """Ann vanishes; return when [ns]."""
    pair.kill("ann")
    at_ns = pair.now_ns
    pair.step()
    return at_ns


# --------------------------------------------------------------------------------------------------- lost clients


def test_a_client_is_lost_after_250_ms_without_a_keepalive() -> None:
    """The criterion is the library's keepalive, not the spacing of targets."""
    pair = scene("ACTIVE")
    pair.alive.discard("ann")
    last_ns = pair.now_ns
    pair.run_until(lambda: pair.state == "HOLDING", 0.4)
    assert 200 * MS <= pair.now_ns - last_ns <= 260 * MS and stages(pair) == ["lost"]


def test_a_client_whose_token_is_gone_is_lost_at_once() -> None:
    """In mid-move: the arms brake in the very tick, and hold."""
    pair = scene("ACTIVE")
    lose(pair)
    assert pair.state == "HOLDING" and pair.arm_kinds() == {FrameKind.BRAKE}
    pair.brakes_and_holds()


def test_a_lost_client_keeps_the_lease_for_10_s_and_the_hold_for_60_s() -> None:
    """Stage by stage: free at 10 s, the hold goes on unowned, down at 60 s (15 s by hand); every stage is told."""
    down_s = 60 if IS_THOROUGH else 15
    pair = scene("ACTIVE", Scene(loss=LossSettings(down_after_ns=down_s * S)))
    lost_ns = lose(pair)
    pair.run(9.9)
    assert pair.owner == "ann" and pair.state == "HOLDING"
    pair.run_until(lambda: pair.owner is None, 0.2)
    assert 10 * S <= pair.now_ns - lost_ns <= 10 * S + 20 * MS
    pair.mark_ns = pair.now_ns
    pair.run(down_s - 10.0 - 0.2)
    assert pair.state == "HOLDING" and set(pair.beats) == {1.0} and pair.arm_kinds() == {FrameKind.HOLD}
    pair.mark()
    pair.run_until(lambda: pair.state != "HOLDING", 0.3)
    assert down_s * S <= pair.now_ns - lost_ns <= down_s * S + 20 * MS and pair.state == "READ_ONLY"
    assert stages(pair) == ["down"]
    pair.run(0.3)
    assert set(pair.beats) <= {0.0, 1.0} and pair.beats[-1] == 0.0 and pair.fsm == 0


def test_after_60_s_the_lift_is_off() -> None:
    """[0,1] where the lift was commanded, [0,0] when everything goes down."""
    pair = scene("HOLDING", Scene(model="lift", loss=QUICK))
    lose(pair)
    pair.run(2.0)
    pair.granted(Stop(), "bob")
    pair.run(3.0)
    assert pair.state == "READ_ONLY" and pair.values(LIFT_COMMAND)[-1] == (0.0, 0.0)


@pytest.mark.parametrize("sign", ["keepalive", "acquire"])
def test_a_client_that_is_back_within_10_s_ends_the_clocks(sign: str) -> None:
    """It keeps its lease and epoch; what was held is held; it resumes explicitly."""
    pair = scene("ACTIVE", Scene(loss=QUICK))
    lose(pair)
    pair.run(0.9)
    assert pair.refused(Move(epoch=pair.epoch, targets_rad=HOME), "ann").code is Code.LEASE_LOST
    pair.alive.add("ann")
    if sign == "acquire":
        assert pair.granted(Acquire(name="ann", pid=1), "ann") == {"epoch": pair.epoch}
    pair.run(0.1)
    assert stages(pair) == ["lost", "back"] and pair.state == "HOLDING"
    pair.mark()
    pair.run(3.5)
    assert pair.state == "HOLDING" and stages(pair) == [] and pair.owner == "ann"
    pair.granted(Move(epoch=pair.epoch, targets_rad=HOME), "ann")
    assert pair.state == "ACTIVE"


def test_a_keepalive_of_another_client_ends_no_clock() -> None:
    """Only the owner's own."""
    pair = scene("ACTIVE", Scene(loss=QUICK))
    lose(pair)
    for _ in range(4):
        pair.receive(ClientSeen(client_id="bob", at_ns=pair.now_ns))
        pair.run(0.6)
    assert pair.owner is None


def test_while_the_clocks_run_others_take_but_do_not_acquire() -> None:
    """LEASE_HELD until free; `take` works at once; a new owner ends both clocks."""
    pair = scene("ACTIVE", Scene(loss=QUICK))
    lose(pair)
    refusal = pair.refused(Acquire(name="bob", pid=2), "bob")
    assert refusal.code is Code.LEASE_HELD and "free in" in refusal.message
    pair.alive.add("bob")
    epoch = pair.granted(Take(name="bob", pid=2, reason="ann crashed"), "bob")["epoch"]
    pair.mark()
    pair.run(3.5)
    assert pair.owner == "bob" and pair.state == "HOLDING" and stages(pair) == []
    assert pair.refused(Move(epoch=pair.epoch, targets_rad=HOME), "ann").code is Code.LEASE_STALE
    pair.granted(Move(epoch=epoch, targets_rad=HOME), "bob")


def test_whoever_acquires_an_unowned_hold_goes_on_from_it() -> None:
    """Free after 10 s, held until 60 s: a new owner moves on without `enable`."""
    pair = scene("ACTIVE", Scene(loss=QUICK))
    lose(pair)
    pair.run(2.0)
    pair.alive.add("bob")
    epoch = pair.granted(Acquire(name="bob", pid=2), "bob")["epoch"]
    pair.mark()
    pair.run(3.0)
    assert pair.state == "HOLDING" and epoch == pair.epoch + 1
    pair.granted(Move(epoch=epoch, targets_rad=HOME), "bob")
    assert pair.state == "ACTIVE" and FrameKind.ECHO not in pair.arm_kinds()


@pytest.mark.parametrize("state", ["ENABLING", "ACTIVE", "HOLDING", "PAUSED"])
def test_on_loss_pause_goes_down_at_once(state: str) -> None:
    """For users who prefer a paused robot over a held load: 0.0 in the same tick, the lease is free."""
    pair = scene(state)
    pair.granted(Acquire(name="ann", pid=1, on_loss=OnLoss.PAUSE), "ann")
    pair.mark()
    lose(pair)
    pair.goes_down()
    assert pair.owner is None


def test_a_client_lost_while_nothing_is_held_costs_only_its_lease() -> None:
    """IDLE: free after 10 s; there is nothing to go down after 60 s, and nobody says that a grip was lost."""
    pair = scene("IDLE", Scene(loss=QUICK))
    lose(pair)
    pair.run(3.5)
    assert pair.owner is None and pair.state == "READ_ONLY" and stages(pair) == ["lost", "free"] and not pair.frames


def test_a_client_that_leaves_its_lease_is_lost_at_once() -> None:
    """`abandon`: as client lost, and only asking for the lease again brings it back."""
    pair = scene("ACTIVE")
    pair.tell(Move(epoch=pair.epoch, targets_rad=HOME), "ann")
    pair.granted(Abandon(epoch=pair.epoch), "ann")
    assert pair.state == "HOLDING" and FrameKind.MOTION not in pair.arm_kinds()
    pair.run(1.0)
    assert pair.refused(Move(epoch=pair.epoch, targets_rad=HOME), "ann").code is Code.LEASE_LOST
    pair.granted(Acquire(name="ann", pid=1), "ann")
    pair.granted(Move(epoch=pair.epoch, targets_rad=HOME), "ann")


def test_a_client_that_leaves_its_lease_and_takes_it_at_once_was_lost() -> None:
    """Both in one tick, as a program that fails and tries again has them: nothing of before goes on."""
    pair = scene("ACTIVE")
    epoch = pair.epoch
    pair.tell(Abandon(epoch=epoch), "ann")
    pair.tell(Acquire(name="ann", pid=1), "ann")
    pair.step()
    assert pair.state == "HOLDING" and pair.owner == "ann" and pair.told(Code.MOTION_ENDED)
    pair.run(0.5)
    assert stages(pair) == ["lost", "back"] and FrameKind.MOTION not in pair.arm_kinds()


def test_a_lost_client_while_stopping_is_still_stopped() -> None:
    """STOPPING goes on to its end; the lease is free after 10 s."""
    pair = scene("STOPPING", Scene(loss=QUICK))
    lose(pair)
    pair.stops_first()
    pair.run(1.0)
    assert pair.owner is None and stages(pair) == ["lost", "free"]


@pytest.mark.parametrize("state", ["READ_ONLY", "HOLDING", "PAUSED", "STOPPING", "STALE", "OFFLINE"])
def test_who_acquires_a_free_lease_gets_it_in_every_state(state: str) -> None:
    """Held, paused or stopping robots go on as they are; at rest the new owner is at the base."""
    pair = scene(state, Scene(loss=QUICK))
    if state == "STOPPING":
        pair.granted(Release(epoch=pair.epoch), "ann")
    elif state != "READ_ONLY":
        lose(pair)
        pair.run_until(lambda: pair.owner is None, 1.1)
    before = pair.state
    pair.alive.add("bob")
    epoch = pair.granted(Acquire(name="bob", pid=2), "bob")["epoch"]
    assert pair.owner == "bob" and epoch == pair.epoch + 1
    assert pair.state == {"READ_ONLY": "IDLE"}.get(before, before)
    if state in {"HOLDING", "PAUSED"}:
        pair.run(3.0)
        assert pair.state == before, "the clocks of the former owner went on"
    elif state == "STOPPING":
        pair.stops_first()
        assert pair.state == "IDLE"


# -------------------------------------------------------------------------------------------------------- takeover


def test_a_takeover_in_mid_motion_brakes_first() -> None:
    """The epoch moves at once; the old motion ends LEASE_LOST; new commands get TAKEOVER_BRAKING until rest."""
    pair = scene("ACTIVE", Scene(snapshot_hz=50))
    pair.alive.add("bob")
    epoch = pair.granted(Take(name="bob", pid=2, reason="my turn"), "bob")["epoch"]
    assert epoch == pair.epoch + 1 and pair.arm_kinds() == {FrameKind.BRAKE}
    assert pair.refused(Move(epoch=pair.epoch, targets_rad=HOME), "ann").code is Code.LEASE_STALE
    refused = 0
    while pair.ask(Move(epoch=epoch, targets_rad=HOME), "bob").refusal is not None:
        assert pair.replies[-1].refusal.code is Code.TAKEOVER_BRAKING
        refused += 1
    assert refused > 5 and pair.state == "ACTIVE"
    last_brake = max(at for at, frame in pair.arm_frames() if frame.kind is FrameKind.BRAKE)
    first_move = min(at for at, frame in pair.arm_frames() if frame.kind is FrameKind.MOTION)
    assert last_brake < first_move
    ended = pair.see().motions[0]
    assert (ended.state, ended.code) == ("aborted", "LEASE_LOST") and "my turn" in ended.message


def test_a_takeover_of_a_brake_waits_for_it_too() -> None:
    """The owner was lost a moment ago and the arms still brake: no command before rest."""
    pair = scene("ACTIVE")
    lose(pair)
    epoch = pair.granted(Take(name="bob", pid=2, reason="my turn"), "bob")["epoch"]
    pair.alive.add("bob")
    for request in (Move(epoch=epoch, targets_rad=HOME), OpenStream(epoch=epoch, side=Side.LEFT)):
        assert pair.refused(request, "bob").code is Code.TAKEOVER_BRAKING
    pair.run(1.0)
    pair.granted(OpenStream(epoch=epoch, side=Side.LEFT), "bob")


def test_a_late_command_of_a_former_owner_moves_nothing() -> None:
    """Two owners never interleave: streamed targets of the old epoch are dropped as well."""
    pair = scene("at rest")
    stream = pair.stream(pair.epoch, Side.LEFT, "ann")
    pair.target(pair.epoch, stream, HOME[Side.LEFT], "ann")
    pair.run(0.1)
    pair.tell(Take(name="bob", pid=2, reason="test"), "bob")
    pair.target(pair.epoch, stream, away(pair, Side.LEFT, 0.5), "ann")
    pair.mark()
    pair.run(1.0)
    assert FrameKind.MOTION not in pair.arm_kinds() and pair.state == "HOLDING"


def test_the_owner_who_takes_what_he_owns_changes_nothing() -> None:
    """Same epoch, no brake."""
    pair = scene("ACTIVE")
    assert pair.granted(Take(name="ann", pid=1, reason="habit"), "ann") == {"epoch": pair.epoch}
    assert pair.state == "ACTIVE"


def test_of_two_who_acquire_at_once_one_gets_the_lease() -> None:
    """The first one; the other hears who has it."""
    pair = scene("READ_ONLY")
    first, second = pair.tell(Acquire(name="ann", pid=1), "ann"), pair.tell(Acquire(name="bob", pid=2), "bob")
    pair.step()
    replies = {reply.request_id: reply for reply in pair.replies}
    assert replies[first].refusal is None and replies[second].refusal.code is Code.LEASE_HELD
    assert "'ann' (pid 1)" in replies[second].refusal.message
