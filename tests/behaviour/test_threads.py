"""BEHAVIOUR, a part of the daemon ended, a thread or its API: it brakes, holds, leaves the hold to its guard, and ends."""

from __future__ import annotations

from itertools import pairwise

import pytest

from gateway.core.guardian import Phase
from gateway.core.messages.events import GuardSeen, PartEnded
from gateway.core.messages.outputs import FrameKind
from gateway.errors import Code
from gateway.messages.requests import Enable, Estop, Move, Recover, Stop
from gateway.robot.topics import FSM_ENABLE, joint_command
from gateway.settings.settings import ArmSettings
from gateway.values import Side
from tests.behaviour.scene import HOME, REACHED_BY, Scene, scene
from tests.behaviour.test_guard import in_motion, in_state
from tests.pair import MS, Pair, S

ARMS = tuple(map(joint_command, Side))
LOST = "the thread ta2-api-read ended unasked: PanicException: boom"


def link_guard(pair: Pair, seconds_ago: float = 2.0) -> None:
    """The daemon's guard has been linked for some time."""
    at_ns = pair.now_ns - round(seconds_ago * S)
    pair.receive(GuardSeen(pid=41, zid="c4", is_linked=True, at_ns=at_ns))


def lose_part(pair: Pair) -> None:
    """A thread ends that nobody asked to end."""
    pair.receive(PartEnded(message=LOST, trace="Traceback", at_ns=pair.now_ns))


def until_done(pair: Pair) -> float:
    """Run until the daemon has ended; return how long that took [s]."""
    begun_ns = pair.now_ns
    pair.run_until(lambda: pair.done, 5.0)
    return (pair.now_ns - begun_ns) / S


@pytest.mark.parametrize("state", ["ACTIVE", "HOLDING"])
def test_a_daemon_that_lost_a_thread_brakes_and_leaves_the_hold_to_its_guard(state: str) -> None:
    """One smooth motion to rest, then the daemon ends in HOLDING: no 0.0, no gap, and the next one takes over, latched."""
    pair = in_state(state)
    link_guard(pair)
    lost_ns = pair.now_ns
    lose_part(pair)
    assert until_done(pair) < 3.0
    assert (pair.state, pair.engine.is_broken, pair.engine.is_streaming) == ("HOLDING", True, True)
    (notice,) = [notice for notice in pair.notices if notice.code is Code.GATEWAY_BROKEN]
    assert (notice.message, dict(notice.facts)) == (LOST, {"trace": "Traceback"})
    pair.die()
    pair.run(1.0)
    assert pair.guardian.is_holding
    pair.restart_guarded()
    pair.run(1.0)
    assert pair.state == "HOLDING" and Code.GATEWAY_BROKEN in pair.engine.latches
    assert {frame.values for _, frame in pair.sent_on(FSM_ENABLE, lost_ns)} == {(1.0,)}
    for topic in ARMS:
        times = [at_ns for at_ns, _ in pair.sent_on(topic, lost_ns - 100 * MS)]
        assert max(b - a for a, b in pairwise(times)) < 50 * MS
        assert {frame.kind for _, frame in pair.sent_on(topic, lost_ns + 1)} <= {FrameKind.BRAKE, FrameKind.HOLD}
    epoch = pair.own("bob")
    assert pair.refused(Enable(epoch=epoch), "bob").code is Code.LATCHED
    assert pair.granted(Recover(), "bob") == {"cleared": [Code.GATEWAY_BROKEN.value]}
    pair.granted(Enable(epoch=epoch), "bob")


@pytest.mark.parametrize("state", REACHED_BY)
def test_without_a_guard_it_ends_as_if_it_had_been_asked_to(state: str) -> None:
    """In every state: brake, 0.0 where 1.0 was out, and the end in less than 5 s."""
    pair = scene(state)
    lose_part(pair)
    assert until_done(pair) < 5.0
    ever = [frame.values for _, frame in pair.sent_on(FSM_ENABLE)]
    if state != "OFFLINE":  # out of reach: the robot's own watchdogs pause it
        assert (1.0,) not in ever or ever[-1] == (0.0,)
    assert not pair.moved() and pair.engine.is_broken
    assert pair.remembered is not None and pair.remembered.latches == {Code.GATEWAY_BROKEN: LOST}


@pytest.mark.parametrize("state", ["READ_ONLY", "IDLE", "ENABLING", "PAUSED", "STOPPING", "OFFLINE"])
def test_where_nothing_is_held_the_guard_has_nothing_to_go_on_with(state: str) -> None:
    """It ends in order, although a guard is linked; its guard sends nothing, or 0.0 again."""
    pair = in_state(state)
    link_guard(pair)
    lost_ns = pair.now_ns
    lose_part(pair)
    assert until_done(pair) < 5.0
    pair.die()
    pair.run_until(lambda: pair.guardian.phase is Phase.DONE, 5.0)
    beats = {frame.values for _, frame in pair.sent_on(FSM_ENABLE, lost_ns + 1)}
    assert beats <= ({(1.0,), (0.0,)} if state == "STOPPING" else {(0.0,)})
    if state not in {"STOPPING", "PAUSED"}:
        assert not any(pair.sent_on(topic, lost_ns + 1) for topic in ARMS)


def test_whoever_stops_is_obeyed_to_the_last_and_nobody_moves_it_any_more() -> None:
    """`stop` and `estop` as ever; motion, enabling and `recover` are refused: what ended does not come back."""
    pair = scene("ACTIVE")
    link_guard(pair)
    lose_part(pair)
    pair.step()
    for request in (Move(epoch=pair.epoch, targets_rad=HOME), Enable(epoch=pair.epoch)):
        assert pair.refused(request, "ann").code is Code.EXITING
    refusal = pair.refused(Recover(), "ann")
    assert (refusal.code, refusal.field) == (Code.LATCH_PERSISTS, "GATEWAY_BROKEN")
    pair.granted(Stop(), "bob")
    assert pair.state == "HOLDING"
    pair.granted(Estop(), "bob")
    assert until_done(pair) < 5.0
    assert pair.beats[-1] == 0.0 and pair.fsm == 0


def test_the_latch_survives_a_restart_and_only_recover_clears_it() -> None:
    """A person is to look first, guard or no guard."""
    pair = scene("ACTIVE")
    lose_part(pair)
    until_done(pair)
    pair.restart()
    pair.run_until(lambda: pair.state == "READ_ONLY" and pair.knows_mode)
    epoch = pair.own("ann")
    pair.run(2.0)
    refusal = pair.refused(Enable(epoch=epoch), "ann")
    assert refusal.code is Code.LATCHED and LOST in refusal.message
    pair.granted(Recover(), "ann")
    assert pair.remembered is not None and pair.remembered.latches == {}


def test_a_guard_that_has_only_just_come_is_waited_for() -> None:
    """It hears the robot's mode once a second, and could not hold before."""
    pair, _ = in_motion()
    link_guard(pair, seconds_ago=0.0)
    lose_part(pair)
    pair.run(1.4)
    assert pair.state == "HOLDING" and not pair.done
    assert until_done(pair) < 0.2
    assert pair.state == "HOLDING"


def test_a_guard_that_dies_meanwhile_is_not_left_alone_with_the_robot() -> None:
    """The daemon brakes and pauses the robot itself then."""
    pair, _ = in_motion()
    link_guard(pair)
    lose_part(pair)
    pair.run(0.1)
    pair.receive(GuardSeen(pid=0, zid="", is_linked=False, at_ns=pair.now_ns, lost="signal 9"))
    assert until_done(pair) < 5.0
    assert pair.robot.fsm.published == 0


def test_arms_that_need_long_to_brake_are_braked_on_by_the_guard() -> None:
    """From where they are, with the speed that they have."""
    pair = scene("at rest", Scene(arm=ArmSettings(a_radps2=0.06, j_radps3=0.12)))
    pair.granted(Move(epoch=pair.epoch, targets_rad=HOME), "ann")
    pair.run(4.0)
    link_guard(pair)
    lose_part(pair)
    assert 3.0 < until_done(pair) < 3.2
    held = pair.engine.takeover.show(pair.now_ns)
    assert held.state == "HOLDING" and any(abs(rate) > 0.01 for arm in held.arms.values() for rate in arm.rate)


def test_a_short_stall_is_waited_out_before_the_hold_is_left() -> None:
    """References at rest go on for 0.8 s, and so may the hold: then it is left. A long one ends it."""
    for stall_s, ends_in in ((0.5, "HOLDING"), (5.0, "STALE")):
        pair = in_state("HOLDING")
        pair.run(1.0)
        link_guard(pair)
        pair.freeze()
        pair.run_until(lambda pair=pair: pair.state == "STALE", 1.0)
        lose_part(pair)
        until_ns = pair.now_ns + round(stall_s * S)
        while pair.now_ns < until_ns and not pair.done:
            pair.step()
        assert pair.done == (ends_in == "STALE")
        pair.thaw()
        pair.run_until(lambda pair=pair: pair.done, 5.0)
        assert pair.state == ends_in
