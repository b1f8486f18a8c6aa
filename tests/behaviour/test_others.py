"""BEHAVIOUR, somebody else: foreign writers and other gateways, what stops, what is owed, who is told, and what is no alarm."""

from __future__ import annotations

import pytest

from gateway.core.messages.events import GuardSeen, LinkUp
from gateway.core.messages.outputs import FrameKind
from gateway.core.messages.sightings import (
    Befriended,
    ForeignData,
    ForeignTokens,
    Gateway,
    GatewayTokens,
    Means,
    Writer,
)
from gateway.errors import Code
from gateway.messages.requests import (
    Acquire,
    Disable,
    DriveChassis,
    DriveLift,
    Enable,
    Estop,
    Move,
    Recover,
    Release,
    Stop,
)
from gateway.robot.topics import (
    CHASSIS_VELOCITY,
    FSM_ENABLE,
    LIFT_COMMAND,
    gripper_command,
    joint_command,
    pose_command,
)
from gateway.settings.settings import ForeignSettings
from gateway.values import Side
from tests.behaviour.scene import HOME, Scene, scene, watched
from tests.pair import MS

ARM = joint_command(Side.LEFT)


def send(pair: Scene, topic: str = ARM, zid: str = "b0b") -> None:
    """Somebody else's sample on a command key arrives."""
    pair.receive(ForeignData(topic=topic, zid=zid, at_ns=pair.now_ns, link="tcp/10.0.0.9:4711"))


def announce(pair: Scene, *zids: str, topic: str = ARM, means: Means = Means.TOKEN) -> None:
    """These sessions announce commands, and no others."""
    writers = tuple(Writer(topic=topic, zid=zid, means=means, link="tcp/10.0.0.9:4711") for zid in zids)
    pair.receive(ForeignTokens(writers=writers, at_ns=pair.now_ns))


def gateways(pair: Scene, **armed: bool) -> None:
    """These other gateways are there, and no others."""
    seen = tuple(Gateway(zid=zid, is_armed=is_armed) for zid, is_armed in armed.items())
    pair.receive(GatewayTokens(gateways=seen, at_ns=pair.now_ns))


# ------------------------------------------------------------------------------------------------ foreign data


@pytest.mark.parametrize("topic", [ARM, FSM_ENABLE, gripper_command(Side.RIGHT), pose_command(Side.LEFT)])
def test_foreign_arm_data_ends_our_frames_in_the_next_tick(topic: str) -> None:
    """In mid-motion: 0.0 once, no setpoint of ours any more, so never two in turn; the base, latched by name."""
    pair = watched("ACTIVE")
    send(pair, topic)
    pair.step()
    assert pair.state == "IDLE" and pair.arm_frames() == [] and pair.beats == [0.0]
    pair.run(1.0)
    assert pair.arm_frames() == [] and pair.beats == [0.0]
    assert "b0b at tcp/10.0.0.9:4711" in pair.engine.latches[Code.FOREIGN_WRITER]
    assert any("b0b" in text for text in pair.told(Code.FOREIGN_WRITER))
    (seen,) = pair.see().others.seen
    assert (seen.kind, seen.topic, seen.zid, seen.link, seen.count) == ("data", topic, "b0b", "tcp/10.0.0.9:4711", 1)


def test_the_motion_that_foreign_data_ended_says_so() -> None:
    """Its owner reads FOREIGN_WRITER, not a time-out."""
    pair = watched("at rest")
    motion = pair.move(pair.epoch, HOME, "ann")
    pair.run(0.3)
    send(pair)
    pair.step()
    view = pair.motion_view(motion)
    assert (view.state, view.code) == ("aborted", "FOREIGN_WRITER") and "b0b" in view.message


def test_a_0_0_is_owed_only_when_our_1_0_was_out() -> None:
    """Enabling, echoing, no heartbeat yet: nothing of ours has to be taken back."""
    pair = scene("IDLE")
    pair.granted(Enable(epoch=pair.epoch), "ann")
    pair.run_until(lambda: bool(pair.arm_frames()))
    assert pair.beats == []
    send(pair)
    pair.run(0.5)
    assert pair.beats == [] and pair.state == "IDLE" and Code.FOREIGN_WRITER in pair.engine.latches


def test_a_repetition_of_0_0_ends_with_foreign_data() -> None:
    """It would fall into somebody else's motion; an e-stop's goes on."""
    for request, goes_on in ((Disable(epoch=1), False), (Estop(), True)):
        pair = scene("at rest")
        pair.robot.inject({"fault": "fsm_value", "value": 2}, pair.now_ns)
        pair.granted(request, "ann")
        pair.run_until(lambda pair=pair: 0.0 in pair.beats)
        send(pair, FSM_ENABLE)
        pair.run(0.1)
        pair.mark()
        pair.run(0.5)
        assert bool(pair.beats) is goes_on, request


def test_while_foreign_data_comes_nothing_can_begin() -> None:
    """`enable` is refused by name and works 2 s after the last sample; no latch where nothing of ours ran."""
    pair = scene("IDLE")
    for _ in range(10):
        send(pair)
        pair.run(0.1)
    refusal = pair.refused(Enable(epoch=pair.epoch), "ann")
    assert refusal.code is Code.FOREIGN_WRITER and "b0b" in refusal.message
    assert pair.arm_frames() == [] and not pair.engine.latches
    pair.run(2.1)
    pair.granted(Enable(epoch=pair.epoch), "ann")


def test_recover_waits_until_the_foreign_writer_is_gone() -> None:
    """LATCH_PERSISTS with the name while it sends or announces; then the owner enables again."""
    pair = scene("ACTIVE")
    send(pair)
    announce(pair, "b0b")
    pair.run(0.5)
    refusal = pair.refused(Recover(), "ann")
    assert refusal.code is Code.LATCH_PERSISTS and "b0b" in refusal.message
    pair.run(2.1)
    assert pair.refused(Recover(), "ann").code is Code.LATCH_PERSISTS  # the announcement is still there
    announce(pair)
    pair.granted(Recover(), "ann")
    pair.granted(Enable(epoch=pair.epoch), "ann")
    pair.run_until(lambda: pair.state == "ACTIVE")


def test_foreign_chassis_data_brakes_the_arms_and_latches() -> None:
    """As an announcement does: the arms are held, the grip is kept. Our stop frames would fall into its drive."""
    pair = scene("ACTIVE")
    send(pair, CHASSIS_VELOCITY)
    pair.brakes_and_holds()
    assert set(pair.engine.latches) == {Code.FOREIGN_WRITER}
    assert pair.values(CHASSIS_VELOCITY) == []


# ------------------------------------------------------------------------------------------------ announcements


def test_an_announcement_stops_the_motion_and_keeps_the_hold() -> None:
    """Nobody sends yet: brake, hold, 1.0; motion is refused until it is gone and somebody recovers."""
    pair = scene("ACTIVE")
    announce(pair, "b0b", topic=pose_command(Side.RIGHT))
    pair.brakes_and_holds()
    refusal = pair.refused(Move(epoch=pair.epoch, targets_rad=HOME), "ann")
    assert refusal.code is Code.LATCHED and "FOREIGN_WRITER" in refusal.message
    announce(pair)
    pair.granted(Recover(), "ann")
    pair.granted(Move(epoch=pair.epoch, targets_rad=HOME), "ann")
    pair.run(0.1)
    assert FrameKind.MOTION in pair.arm_kinds()


@pytest.mark.parametrize("means", list(Means))
def test_an_announcement_while_nothing_of_ours_runs_is_a_condition(means: Means) -> None:
    """`enable` is refused while it is there and works when it is gone, without `recover`."""
    pair = scene("IDLE")
    announce(pair, "b0b", means=means)
    pair.run(0.1)
    assert pair.refused(Enable(epoch=pair.epoch), "ann").code is Code.FOREIGN_WRITER
    assert not pair.engine.latches
    announce(pair)
    pair.granted(Enable(epoch=pair.epoch), "ann")
    pair.run_until(lambda: pair.state == "ACTIVE")


def test_under_warn_others_are_told_of_and_stop_nothing() -> None:
    """Event and view; the motion goes on, `enable` is granted. Another gateway is never fought all the same."""
    pair = Scene(snapshot_hz=50, foreign=ForeignSettings(policy="warn"))
    scene("ACTIVE", pair)
    send(pair)
    announce(pair, "b0b")
    pair.run(0.3)
    assert pair.state == "ACTIVE" and FrameKind.MOTION in pair.arm_kinds() and not pair.engine.latches
    assert len(pair.told(Code.FOREIGN_WRITER)) == 2
    assert [seen.kind for seen in pair.see().others.seen] == ["data", "token"]
    gateways(pair, b=True)
    pair.step()
    assert pair.state == "IDLE"


# ------------------------------------------------------------------------------------------------ other gateways


@pytest.mark.parametrize("policy", ["hold", "warn"])
def test_why_says_who_else_commands_the_robot(policy: str) -> None:
    """Within half a second, a sentence each: session, address, topics, since when, what to do; over when he is gone."""
    pair = scene("ACTIVE", Scene(snapshot_hz=50, foreign=ForeignSettings(policy=policy)))
    assert not pair.see().findings
    began_ns = pair.now_ns
    for _ in range(25):
        send(pair)
        announce(pair, "b0b", "eve", topic=CHASSIS_VELOCITY)
        gateways(pair, d1=True, d2=False)
        pair.run(0.02)
    told = [each.message for each in pair.see().findings if each.code in ("FOREIGN_WRITER", "OTHER_GATEWAY")]
    assert len(told) == 3
    assert told[0].startswith("another gateway, zenoh session d1, commands the robot")
    assert told[1].startswith(
        f"zenoh session b0b at tcp/10.0.0.9:4711 sends commands on {ARM} that are not ours and announces"
    )
    assert told[2].startswith(f"zenoh session eve at tcp/10.0.0.9:4711 announces some on {CHASSIS_VELOCITY}")
    for finding in pair.see().findings:
        assert finding.hint and began_ns <= finding.since_ns <= began_ns + 20 * MS
    announce(pair)
    gateways(pair, d2=False)
    pair.run(3.0)
    assert not [each for each in pair.see().findings if each.code in ("FOREIGN_WRITER", "OTHER_GATEWAY")]


def test_another_armed_gateway_takes_our_frames_off_without_0_0() -> None:
    """The robot is the other's: no arm frame, no 1.0, no 0.0; no latch, for it goes away by itself."""
    pair = scene("ACTIVE")
    gateways(pair, b=True)
    pair.goes_off()
    assert not pair.engine.latches and any("b" in text for text in pair.told(Code.OTHER_GATEWAY))
    assert pair.refused(Enable(epoch=pair.epoch), "ann").code is Code.OTHER_GATEWAY
    gateways(pair, b=False)
    pair.run(0.3)
    pair.robot.inject({"fault": "pause"}, pair.now_ns)
    pair.run(0.3)
    pair.granted(Enable(epoch=pair.epoch), "ann")


def test_a_gateway_that_is_only_connected_is_no_rival() -> None:
    """It declares its publishers when it connects; it is shown, and nothing stops."""
    pair = watched("ACTIVE")
    gateways(pair, b=False)
    announce(pair, "b", means=Means.PUBLISHER)
    pair.run(0.2)
    assert pair.state == "ACTIVE" and pair.moved() and not pair.told(Code.FOREIGN_WRITER)
    assert [(seen.kind, seen.armed) for seen in pair.see().others.seen] == [("gateway", False)]


def test_the_claim_is_shown_from_the_lease_on_and_looked_at_again_before_the_first_frame() -> None:
    """Acquire and enable in one tick: the first frame comes at least 150 ms later."""
    pair = scene("READ_ONLY")
    pair.run(0.5)
    assert pair.claim == 0
    pair.epoch = pair.own("ann")
    owned_ns = pair.now_ns
    pair.granted(Enable(epoch=pair.epoch), "ann")
    assert pair.claim != 0
    pair.run_until(lambda: bool(pair.arm_frames()))
    assert 150 * MS <= pair.arm_frames()[0][0] - owned_ns <= 200 * MS
    pair.run_until(lambda: pair.state == "ACTIVE")
    pair.granted(Release(epoch=pair.epoch), "ann")
    pair.run_until(lambda: pair.state == "READ_ONLY")
    pair.run(1.5)
    assert pair.claim == 0


@pytest.mark.parametrize(("other", "proceeds"), [("1", False), ("f", True)])
def test_of_two_gateways_that_acquire_at_once_the_larger_zid_yields(other: str, proceeds: bool) -> None:
    """Nothing has left when it does; the smaller one waits until the other has withdrawn, and proceeds."""
    pair = watched("READ_ONLY")
    pair.up_as("a")
    pair.run(1.2)
    pair.epoch = pair.own("ann")
    pair.step()
    gateways(pair, **{other: True})
    pair.mark()
    pair.granted(Enable(epoch=pair.epoch), "ann")
    pair.run(0.3)
    if not proceeds:
        assert pair.claim == 0 and pair.state == "IDLE" and not pair.sent_on(FSM_ENABLE)
        assert pair.arm_frames() == [] and pair.see().enable.code == "OTHER_GATEWAY"
        return
    assert pair.claim != 0 and pair.arm_frames() == []
    gateways(pair, **{other: False})
    pair.run_until(lambda: pair.state == "ACTIVE")


def test_a_gateway_that_comes_while_another_is_armed_claims_nothing() -> None:
    """Its owner gets the lease and is refused `enable`; the established one sees no second token."""
    pair = scene("READ_ONLY")
    gateways(pair, b=True)
    pair.epoch = pair.own("ann")
    pair.run(0.5)
    assert pair.claim == 0 and pair.refused(Enable(epoch=pair.epoch), "ann").code is Code.OTHER_GATEWAY
    gateways(pair)
    pair.run(0.3)
    pair.granted(Enable(epoch=pair.epoch), "ann")
    pair.run_until(lambda: pair.state == "ACTIVE")


def test_somebody_else_in_a_short_stall_ends_the_hold_and_nothing_is_resumed() -> None:
    """STALE at rest: frames end at once, and fresh state does not bring 1.0 back."""
    for happens in (send, lambda pair: gateways(pair, b=True)):
        pair = scene("STALE")
        pair.run(0.2)
        assert pair.arm_frames()
        happens(pair)
        pair.mark()
        pair.is_deaf = False
        pair.run(1.0)
        assert pair.arm_frames() == [] and 1.0 not in pair.beats and pair.state == "IDLE"


def test_beside_another_gateway_nothing_that_is_owed_is_paid() -> None:
    """After a long stall the FSM is READY because of the other's 1.0."""
    pair = scene("STALE")
    pair.run(1.5)
    gateways(pair, b=True)
    pair.robot.inject({"fault": "fsm_value", "value": 2}, pair.now_ns)
    pair.mark()
    pair.is_deaf = False
    pair.run(2.5)
    assert pair.state == "IDLE" and pair.beats == []


# ------------------------------------------------------------------------------------------------ no alarm


def test_nothing_of_our_own_is_an_alarm() -> None:
    """This session, an earlier one (restart, reconnect under a new name) and the guard: tokens, publishers and late data."""
    pair = watched("READ_ONLY")
    pair.up_as("a1")
    pair.run(0.5)
    pair.restart()
    pair.up_as("a2")
    pair.up_as("a3")
    pair.receive(Befriended(zid="9a", at_ns=pair.now_ns))
    pair.receive(GuardSeen(pid=7, zid="9a", is_linked=True, at_ns=pair.now_ns))
    for zid in ("a1", "a2", "a3", "9a"):
        send(pair, zid=zid)
    announce(pair, "a1", "a2", "a3", "9a", means=Means.PUBLISHER)
    gateways(pair, **{"a1": False, "a2": False, "a3": True, "9a": True})
    pair.run(1.0)
    pair.activate("ann")
    assert not pair.engine.latches and pair.see().others.seen == ()
    assert not pair.told(Code.FOREIGN_WRITER) and not pair.told(Code.OTHER_GATEWAY)


def test_stopping_is_possible_beside_others() -> None:
    """A stop needs no claim and is never refused."""
    pair = scene("READ_ONLY")
    gateways(pair, b=True)
    announce(pair, "c")
    pair.granted(Stop(), "bob")
    assert pair.values(CHASSIS_VELOCITY)[:1] == [(0.0, 0.0, 0.0)]


def test_whoever_acquires_is_told_nothing_wrong() -> None:
    """The lease is local: it is given although another gateway commands; only moving is refused."""
    pair = scene("READ_ONLY")
    gateways(pair, b=True)
    pair.alive.add("ann")
    assert pair.granted(Acquire(name="ann", pid=1), "ann")["epoch"]


def test_a_new_link_claims_anew() -> None:
    """The token went with the transport; others may have come meanwhile, and are seen first."""
    pair = scene("at rest")
    first = pair.claim
    pair.down()
    pair.run(0.2)
    assert pair.claim == 0
    pair.up()
    pair.receive(LinkUp(router_zid="aa", at_ns=pair.now_ns, own_zid=""))
    gateways(pair, b=True)
    pair.run(0.5)
    assert pair.claim == 0
    gateways(pair)
    pair.run(0.1)
    assert pair.claim > first


# ------------------------------------------------------------------------------------------------ chassis and lift


def drive(pair: Scene) -> DriveChassis:
    """A velocity of the chassis, asked for by ann."""
    return DriveChassis(epoch=pair.epoch, vx_mps=0.2, vy_mps=0.0, wz_radps=0.0, expiry_ns=3000 * MS)


def wheels(pair: Scene) -> list[tuple[float, ...]]:
    """What the chassis was told since the mark."""
    return pair.values(CHASSIS_VELOCITY)


@pytest.mark.parametrize("who", ["data", "token", "chassis data"])
def test_a_foreign_writer_while_our_chassis_runs_stops_it_and_latches(who: str) -> None:
    """Without enabled arms, too: zeros for a second, because ours was driving; then silence beside the other."""
    pair = scene("IDLE")
    pair.granted(drive(pair), "ann")
    pair.run(1.0)
    assert any(any(values) for values in wheels(pair))
    announce(pair, "b0b") if who == "token" else send(pair, ARM if who == "data" else CHASSIS_VELOCITY)
    pair.mark()
    pair.run(2.0)
    times = [at_ns for at_ns, _ in pair.sent_on(CHASSIS_VELOCITY, pair.mark_ns)]
    assert set(wheels(pair)) == {(0.0, 0.0, 0.0)} and 1000 * MS <= times[-1] - times[0] <= 1200 * MS
    assert pair.beats == [] and Code.FOREIGN_WRITER in pair.engine.latches
    assert pair.refused(drive(pair), "ann").code is Code.LATCHED


def test_beside_others_no_drive_begins() -> None:
    """A writer by FOREIGN_WRITER, an armed gateway by OTHER_GATEWAY; nothing is sent."""
    pair = scene("IDLE")
    announce(pair, "b0b")
    assert pair.refused(drive(pair), "ann").code is Code.FOREIGN_WRITER
    announce(pair)
    gateways(pair, b=True)
    assert pair.refused(drive(pair), "ann").code is Code.OTHER_GATEWAY
    pair.run(0.5)
    assert wheels(pair) == []


def test_a_drive_begins_when_other_gateways_have_seen_the_claim() -> None:
    """Acquire and drive in one tick: granted, and the first frame comes at least 150 ms later."""
    pair = scene("READ_ONLY")
    pair.run(0.5)
    pair.epoch = pair.own("ann")
    owned_ns = pair.now_ns
    pair.mark()
    pair.granted(drive(pair), "ann")
    pair.run(0.5)
    first_ns = pair.sent_on(CHASSIS_VELOCITY, pair.mark_ns)[0][0]
    assert 150 * MS <= first_ns - owned_ns <= 250 * MS


@pytest.mark.parametrize("other", ["1", "f"])
def test_of_a_drive_that_lost_the_claim_nothing_ever_leaves(other: str) -> None:
    """Chassis and lift are the other gateway's: neither a velocity, nor zeros when ours gives up, nor a servo switched on."""
    pair = Scene(model="lift", snapshot_hz=50)
    scene("READ_ONLY", pair)
    pair.up_as("a")
    pair.run(1.2)
    pair.epoch = pair.own("ann")
    pair.step()
    gateways(pair, **{other: True})
    pair.mark()
    drive_id = pair.granted(drive(pair), "ann")["drive_id"]
    pair.granted(DriveLift(epoch=pair.epoch, velocity=0.3, expiry_ns=3000 * MS), "ann")
    pair.run(1.5)
    assert pair.claim == 0 and not pair.see().drive.driven and pair.told(Code.OTHER_GATEWAY)
    again = DriveChassis(epoch=pair.epoch, vx_mps=0.1, vy_mps=0.0, wz_radps=0.0, drive_id=drive_id)
    assert pair.refused(again, "ann").code is Code.OTHER_GATEWAY
    pair.granted(Release(epoch=pair.epoch), "ann")
    pair.run(2.0)
    assert wheels(pair) == [] and pair.values(LIFT_COMMAND) == []


def test_another_gateway_that_arms_while_our_chassis_runs_stops_it() -> None:
    """Ours was driving: zeros for a second; no latch, it goes away by itself."""
    pair = scene("IDLE")
    pair.granted(drive(pair), "ann")
    pair.run(1.0)
    gateways(pair, b=True)
    pair.step()
    pair.mark()
    pair.run(2.0)
    assert set(wheels(pair)) == {(0.0, 0.0, 0.0)} and not pair.engine.latches
