"""Tests of the blocking client: connecting, looking and stopping; owning is in test_control.py."""

from __future__ import annotations

import threading

import numpy as np
import pytest
from msgspec.structs import replace

from gateway.api.stop_pipe import MAX_BYTES
from gateway.client import Robot, StopResult, connect
from gateway.core.messages.outputs import Level, Notice
from gateway.errors import (
    Code,
    Disconnected,
    NotReady,
    OutcomeUnknown,
    ProtocolError,
    Refusal,
    Rejected,
    Stale,
)
from gateway.messages import requests
from gateway.messages.snapshot import ContactView, SlowingView
from tests.api.stand_in import START_Q, a_snapshot


def test_connecting_gives_facts_and_a_first_state(world):
    """After connect() the daemon's facts and a state are there; nothing was asked of the engine."""
    with connect(transport=world.transport(), name="eyes") as robot:
        assert isinstance(robot, Robot)
        assert robot.info.model == "standard" and robot.info.pid == 4711
        assert robot.state.state == "READ_ONLY"
        assert "eyes" in repr(robot)
    assert world.engine.requests == []
    world.run(0.02)
    assert world.engine.gone == [robot.client_id]


def test_connecting_to_nobody_times_out_as_disconnected(world):
    """Without a daemon the wait ends in time, with the class that says: try again."""
    world.plane.reachable = False
    before_ns = world.time_ns
    with pytest.raises(Disconnected) as caught:
        connect(transport=world.transport(), timeout_s=2.0)
    assert caught.value.code is Code.DISCONNECTED and "ta2 run" in caught.value.hint
    assert 2.0 <= (world.time_ns - before_ns) / 1e9 < 2.2


def test_a_daemon_of_another_version_is_named(world):
    """A daemon that speaks another protocol is told apart from no daemon."""
    world.plane.reachable = False
    transport = world.transport()
    join = world.plane.join
    world.plane.join = lambda client, listener: (
        join(client, listener),
        listener.on_daemon("ta2/7/alive/daemon/x", True),
    )
    with pytest.raises(ProtocolError) as caught:
        connect(transport=transport)
    assert caught.value.code is Code.UNSUPPORTED_VERSION and "7" in str(caught.value)


@pytest.mark.parametrize("target", ["gateway.sock", "udp/127.0.0.1:1", "tcp/127.0.0.1", "tcp/h:99999", "unix:", "/x#y"])
def test_what_is_no_address_is_rejected(target):
    """A target that cannot be an address is refused before anything is opened."""
    with pytest.raises(Rejected) as caught:
        connect(target)
    assert caught.value.field == "target"


def test_a_socket_that_is_not_there_is_named(tmp_path):
    """Connecting to a path without a socket says which path, at once."""
    with pytest.raises(Disconnected, match=r"no\.sock"):
        connect(str(tmp_path / "no.sock"))


def test_state_has_units_shapes_and_ages(world, robot):
    """Vectors are read-only numpy of the right shape; ages count on from the daemon's figure."""
    arm = robot.state.left_arm
    assert arm.q.shape == (7,) and arm.q.dtype == np.float64
    assert np.allclose(arm.q, START_Q) and np.allclose(arm.tau, 0.5)
    with pytest.raises(ValueError, match="read-only"):
        arm.q[0] = 1.0
    assert arm.age == pytest.approx(0.002, abs=0.011)
    assert arm.pose.p.shape == (3,) and arm.pose.quat_xyzw.shape == (4,) and arm.pose.frame == "left_shoulder_base"
    assert arm.model is not None and (arm.model.state, arm.model.position_m) == ("agrees", 2e-4)
    assert arm.q_ref.shape == (0,) and not arm.is_streaming and arm.tracking_error is None
    world.engine.frozen = True
    world.run(0.5)
    assert robot.state.left_arm.age == pytest.approx(0.5, abs=0.03)
    assert robot.state.age == pytest.approx(0.5, abs=0.03)


def test_what_was_never_measured_is_stale_not_zero(robot):
    """A part without a sample raises when it is read, and tells beforehand."""
    gripper = robot.state.right_gripper
    assert not gripper.is_known and gripper.age == float("inf")
    with pytest.raises(Stale) as caught:
        _ = gripper.q
    assert caught.value.code is Code.PART_STALE and caught.value.field == "right_gripper"
    assert robot.state.left_gripper.q.shape == (1,)


def test_how_near_the_arms_are_is_in_the_state(world, robot):
    """Where arms are kept apart: the nearest pair, its gap and the margin; None where nobody asked for it."""
    spacing = robot.state.spacing
    assert spacing is not None and (spacing.first, spacing.second) == ("left_palm", "right_forearm")
    assert (spacing.gap_m, spacing.margin_m, spacing.on, spacing.held) == (0.143, 0.02, True, ())
    world.engine.show(spacing=None)
    world.run(0.05)
    assert robot.state.spacing is None


FELT = ContactView(
    state="known", basis="nominal", torque_nm=(0.5,) * 7, torque_sd_nm=(0.1,) * 7, frame="left_shoulder_base",
    point="left_ee", wrench=(1.0, -8.0, None, 0.0, 0.1, 0.0), wrench_sd=(2.0, 1.5, None, 0.1, 0.1, 0.1),
    unknown=((0.0, 0.0, 1.0, 0.0, 0.0, 0.0),), sigmas=5.0, age_ns=4_000_000,
)  # fmt: skip


def test_what_pulls_at_an_arm_is_in_the_state(world, robot):
    """Torques and wrench with standard deviations, in a named frame; what is not felt is no number; None without dynamics."""
    assert robot.state.left_arm.contact is None
    unknown = ContactView(state="unknown", code="MODEL_DIFFERS", reason="9 mm off", basis="nominal")
    arms = world.engine.snapshot.arms
    left, right = (replace(arms[side], contact=view) for side, view in (("left", FELT), ("right", unknown)))
    world.engine.show(arms={"left": left, "right": right})
    world.run(0.05)
    contact = robot.state.left_arm.contact
    assert contact.is_known and contact.reason == "" and contact.basis == "nominal"
    assert contact.torque.shape == contact.torque_sd.shape == (7,) and not contact.torque.flags.writeable
    assert (contact.frame, contact.point, contact.sigmas) == ("left_shoulder_base", "left_ee", 5.0)
    assert list(contact.wrench[:2]) == [1.0, -8.0] and np.isnan(contact.wrench[2]) and np.isinf(contact.wrench_sd[2])
    assert [list(direction) for direction in contact.unknown] == [[0.0, 0.0, 1.0, 0.0, 0.0, 0.0]]
    assert 0.004 <= contact.age < 1.0 and "-8.000" in repr(contact)
    contact = robot.state.right_arm.contact
    assert not contact.is_known and contact.reason == "MODEL_DIFFERS: 9 mm off" and contact.reason in repr(contact)
    with pytest.raises(NotReady) as caught:
        _ = contact.torque
    assert caught.value.code is Code.MODEL_DIFFERS and caught.value.field == "right_arm"


def test_how_near_a_singularity_an_arm_is_is_in_the_state(world, robot):
    """While its poses are streamed: the part of the speed limits that is left, and the joint for whose sake."""
    assert robot.state.slowing == {}
    near = SlowingView(on=True, why="", speed_ratio=0.34, held=True, joint=4, joint_radps=8.8, bound_radps=3.0)
    world.engine.show(slowing={"left": near})
    world.run(0.05)
    seen = robot.state.slowing["left"]
    assert (seen.speed_ratio, seen.held, seen.joint, seen.bound_radps) == (0.34, True, 4, 3.0)


def test_a_state_does_not_change_after_it_was_taken(world, robot):
    """A state is of one instant: later snapshots make later states."""
    state = robot.state
    world.engine.show(state="OFFLINE", fsm=None)
    world.run(0.05)
    assert state.state == "READ_ONLY" and state.fsm_name == "PAUSE"
    assert robot.state.state == "OFFLINE" and robot.state.fsm_name == "UNKNOWN"
    with pytest.raises(AttributeError):
        state.age = 1.0


def test_health_tells_what_is_not_well(world, robot):
    """health() is plain, says ok when it is, and names what is not."""
    health = robot.health()
    assert health.ok and health.daemon and health.link_up and health.fsm == "PAUSE" and health.lease_holder is None
    assert health.ages["/fsm_state"] == pytest.approx(0.02, abs=0.02) and health.ages["/chassis/joint_states"] is None
    assert health.streams == {"/api/fsm/enable": 0.051} and health.loop_skipped == 1
    world.engine.show(latches={"ESTOP": "estop()"}, shown="ESTOP")
    world.run(0.02)
    assert not robot.health().ok and robot.health().latches == ("ESTOP",) and robot.health().state == "ESTOP"


def test_health_never_raises_without_a_daemon(world, robot):
    """A dead daemon is something that health() tells, not something that stops it."""
    world.plane.set_reachable(False)
    world.run(3.0)
    health = robot.health()
    assert not health.ok and not health.daemon and health.snapshot_age > 2.9
    with pytest.raises(Disconnected):
        _ = robot.state


def test_dropped_snapshots_are_counted(world, robot):
    """Gaps in the numbers of snapshots are counted without decoding any."""
    session = robot._session
    session.on_snapshot(b"?", session._last_seq + 5, world.time_ns)
    assert session.snapshots_dropped == 4


def test_a_snapshot_that_cannot_be_read_is_a_protocol_error(world, robot):
    """Nonsense from the daemon is told as such, never as a stray decoding error."""
    world.plane._listeners[robot.client_id].on_snapshot(b"\xc1", 10_000, world.time_ns)
    with pytest.raises(ProtocolError):
        _ = robot.state


def test_anybody_stops_and_recovers(world, robot):
    """stop, estop and recover need no lease; the latch of a stranger's stop is seen and cleared."""
    assert robot.stop("looks odd").undelivered is False
    world.run(0.02)
    assert robot.state.latches == {"STOPPED_BY_OTHER": "stop(): looks odd"} and robot.state.shown == "FAULT"
    robot.estop("worse")
    robot.recover()
    world.run(0.02)
    assert robot.state.latches == {} and world.engine.names() == ["Stop", "Estop", "Recover"]


def test_an_undelivered_stop_is_said_and_remembered_until_one_gets_through(world, robot):
    """Without a transport to the robot the stop says so, and health() keeps saying it."""
    world.engine.show(link=a_snapshot().link.__class__(up=False, router_zid="", fresh=False, age_ns=None))
    assert robot.stop().undelivered is True
    assert robot.health().stop_undelivered and not robot.health().ok
    world.engine.show(link=a_snapshot().link)
    assert robot.stop().undelivered is False
    assert not robot.health().stop_undelivered
    world.engine.notices.append(Notice(code=Code.STOP_UNDELIVERED, level=Level.ERROR, message="!", at_ns=1))
    world.run(0.02)
    assert robot.health().stop_undelivered


def test_a_stop_that_did_not_leave_is_forgotten_when_the_robot_is_in_order_again(world, robot):
    """Who only watches sends no stop that could get through: a fresh link and nothing latched, seen later, say it, too."""
    lost = a_snapshot().link.__class__(up=False, router_zid="", fresh=False, age_ns=None)
    world.engine.show(link=lost, latches={"ESTOP": "estop()"})
    told = Notice(code=Code.STOP_UNDELIVERED, level=Level.ERROR, message="!", at_ns=world.engine.snapshot.at_ns)
    world.engine.notices.append(told)
    world.run(0.05)
    for better in ({"link": a_snapshot().link}, {"link": lost, "latches": {}}):
        world.engine.show(**better)
        world.run(0.05)
        assert robot.health().stop_undelivered
    world.engine.show(link=a_snapshot().link)
    world.run(0.05)
    assert not robot.health().stop_undelivered


def test_a_state_from_before_an_undelivered_stop_forgets_none(world, robot):
    """It was well then."""
    world.run(0.05)
    at_ns = world.engine.snapshot.at_ns + 10**9
    world.engine.notices.append(Notice(code=Code.STOP_UNDELIVERED, level=Level.ERROR, message="!", at_ns=at_ns))
    world.run(0.05)
    assert robot.health().stop_undelivered


@pytest.mark.parametrize(
    "ask",
    [
        lambda robot: next(robot.states(max_rate=0.0)),
        lambda robot: next(robot.states(timeout=-1.0)),
        lambda robot: robot.control().acquire().left_arm.stream(rate_hz=500.0),
        lambda robot: robot.check_follow({"left": [START_Q] * 2}, dt=0.1, start_in=1e10),
    ],
    ids=["max_rate", "timeout", "rate_hz", "start_in"],
)
def test_what_cannot_be_clipped_is_not_said_to_be(robot, ask):
    """on_limit is for goals alone."""
    with pytest.raises(Rejected) as caught:
        ask(robot)
    assert caught.value.code is Code.OUT_OF_RANGE and caught.value.hint == "stay inside the bound"


def test_a_refusal_arrives_as_its_class_with_all_its_facts(world, robot):
    """Code, field, value, bound, unit and hint of a refusal survive the way."""
    refusal = Refusal(
        code=Code.LATCH_PERSISTS, message="m", field="f", value="v", bound="b", unit="rad", hint="do this"
    )
    world.engine.refusals[requests.Recover] = refusal
    with pytest.raises(NotReady) as caught:
        robot.recover()
    assert caught.value.refusal == refusal


def test_a_lost_reply_is_an_unknown_outcome(world, robot):
    """A command whose reply never comes is not called failed: it may have run."""
    world.engine.mute = {requests.Recover}
    with pytest.raises(OutcomeUnknown) as caught:
        robot.recover()
    assert "did not answer" in str(caught.value) and world.engine.names() == ["Recover"]


def test_a_lost_reply_is_asked_for_again_and_the_command_runs_once(world, robot):
    """When only the reply was lost, the same number is asked again and gets the first reply."""
    ask, lost = world.plane.ask, []

    def lossy(key, payload, encoding, on_done):
        if lost:
            ask(key, payload, encoding, on_done)
        else:  # the daemon gets it, the reply is lost
            lost.append(payload)
            ask(key, payload, encoding, lambda _: on_done(None))

    world.plane.ask = lossy
    robot.recover()
    assert lost and world.engine.names() == ["Recover"]


def test_a_daemon_that_dies_before_it_answers_leaves_the_outcome_unknown(world, robot):
    """A connection that breaks while a reply is under way is an unknown outcome, soon, not after all of the timeout."""
    world.engine.mute = {requests.Recover}
    world.on_tick = lambda: world.plane.set_reachable(False) if world.engine.names() else None
    ask = world.plane.ask
    world.plane.ask = lambda key, payload, encoding, on_done: (
        ask(key, payload, encoding, lambda _: None),
        on_done(None),
    )
    before_ns = world.time_ns
    with pytest.raises(OutcomeUnknown):
        robot.recover()
    assert (world.time_ns - before_ns) / 1e9 < 1.5


def test_without_a_daemon_nothing_is_sent(world, robot):
    """A command to a daemon that is gone is Disconnected: it certainly did not run."""
    world.plane.set_reachable(False)
    world.run(1.5)
    with pytest.raises(Disconnected):
        robot.stop()
    assert world.engine.requests == []


def test_a_hiccup_of_the_connection_is_bridged(world, robot):
    """A connection that is back within a second costs no exception."""
    world.plane.set_reachable(False)
    world.run(0.5)
    assert robot.state.state == "READ_ONLY"
    world.plane.set_reachable(True)
    robot.stop()


def test_a_restarted_daemon_is_read_anew(world, robot):
    """After a restart the same client reads the new daemon: its facts and its snapshots count from one again."""
    world.run(0.5)
    world.plane.set_reachable(False)
    world.plane._daemon_id = "second"
    world.engine.snapshot = a_snapshot(seq=0, state="OFFLINE")
    world.plane.set_reachable(True)
    assert robot.state.state == "OFFLINE" and robot.state.seq < 10
    assert robot.info.pid == 4711


def test_a_closed_client_says_so(world, robot):
    """After close() nothing hangs and nothing is sent; closing twice is fine."""
    robot.close()
    robot.close()
    with pytest.raises(Disconnected, match="closed"):
        robot.stop()
    with pytest.raises(Disconnected, match="closed"):
        _ = robot.state


def test_a_forked_process_is_told_to_connect_itself(world, robot, monkeypatch):
    """Zenoh's threads do not survive a fork: the child is told so instead of hanging."""
    monkeypatch.setattr("gateway.client.connection.session.os.getpid", lambda: 1)
    with pytest.raises(Disconnected, match="forked"):
        _ = robot.state
    with pytest.raises(Disconnected, match="forked"):
        robot.stop()
    robot.close()  # a child that leaves its `with` block must not close its parent's connection
    monkeypatch.undo()
    assert robot.state.state == "READ_ONLY"


def test_a_forked_process_has_no_daemon_and_owns_nothing(world, robot, monkeypatch):
    """Its health says so at once, whoever held the lock at the fork; what its parent owns it leaves alone."""
    locked, done = threading.Event(), threading.Event()

    def hold():
        with robot._session.changed:
            locked.set()
            done.wait(10)

    with robot.control() as own:
        assert robot.health().daemon and own.is_open
        with monkeypatch.context() as child:
            child.setattr("os.getpid", lambda: 1)
            holding = threading.Thread(target=hold)
            holding.start()
            assert locked.wait(10)
            health = robot.health()
            still_locked = not robot._session.changed.acquire(blocking=False)
            done.set()
            holding.join()
            assert not health.daemon and not health.ok and still_locked and not own.is_open
            with pytest.raises(Disconnected, match="forked"):
                _ = own.epoch
            own.release()
        assert robot.health().daemon and own.is_open and own.epoch == 1


@pytest.mark.parametrize(("name", "value"), [("on_loss", "drop"), ("on_exit", "stop")])
def test_words_that_mean_nothing_are_rejected(robot, name, value):
    """A wrong word for what happens on loss or exit is refused before the lease is asked for."""
    with pytest.raises(Rejected) as caught:
        robot.control(**{name: value})
    assert caught.value.field == name


@pytest.mark.parametrize("ask", ["stop", "estop"])
def test_a_stop_of_a_dead_daemon_goes_to_its_guard(world, monkeypatch, ask):
    """At once, not when the daemon has been waited for; where it did nothing, the daemon's silence is told."""
    asked = []
    answers = [StopResult(undelivered=False, by_guard=True), None, None, None, None]

    def guard(*question):
        asked.append(question)
        return answers.pop(0)

    monkeypatch.setattr("gateway.client.asking.guard_stop.stop_at_guard", guard)
    transport = world.transport()
    monkeypatch.setattr(transport, "drop", lambda key, payload: asked.append((key, b"smoke" in payload)))
    with connect(transport=transport, name="ann") as robot:
        world.plane.set_reachable(False)
        world.run(0.02)
        begin_ns = world.now_ns()
        assert getattr(robot, ask)("smoke").by_guard and world.now_ns() == begin_ns
        assert asked.pop(0) == (f"ta2/{ask}", True), "dropped before anybody is asked: the daemon may live"
        for _ in range(2):
            with pytest.raises(Disconnected):
                getattr(robot, ask)("smoke")
        assert answers == [], "asked again when the daemon did not come back: it may have taken over meanwhile"
        assert asked[0][1:] == (ask, "smoke", "ann")


ODD_REASONS = ["\udcff", ValueError("smoke"), "x" * 5000, "\x01" * 5000, "\N{FIRE}" * 5000]
"""What nobody can read, what is no text, and what fits nowhere."""


@pytest.mark.parametrize("reason", ODD_REASONS, ids=["no-unicode", "exception", "long", "control", "wide"])
@pytest.mark.parametrize("ask", ["stop", "estop"])
def test_no_reason_keeps_a_stop_away_or_makes_it_a_strangers(world, monkeypatch, ask, reason):
    """It leaves by the pipe and by the key, with the owner's id and secret, whatever he says, and whatever he is called."""
    transport, dropped = world.transport(), []
    monkeypatch.setattr(transport, "drop", lambda key, payload: dropped.append(payload))
    with connect(transport=transport, name="\udcff" + "\N{FIRE}" * 100) as robot:
        robot.control().acquire()
        assert getattr(robot, ask)(reason).undelivered is False
        assert world.engine.requests[-1][0] == robot.client_id
    assert len(dropped[0]) < MAX_BYTES and robot.client_id.encode() in dropped[0]


@pytest.mark.parametrize("ask", ["stop", "estop"])
@pytest.mark.parametrize("away", ["mute", "dies", "gone"])
def test_a_stop_of_which_nobody_knows_says_to_use_the_physical_one(world, robot, ask, away):
    """No answer, a daemon that dies before it, nobody there at all: never to look first, nor to start something."""
    if away == "gone":
        world.plane.set_reachable(False)
        world.run(1.5)
    else:
        world.engine.mute = {requests.Stop, requests.Estop}
    if away == "dies":
        world.on_tick = lambda: world.plane.set_reachable(False)
    with pytest.raises(Disconnected if away == "gone" else OutcomeUnknown) as caught:
        getattr(robot, ask)("smoke")
    assert "physical emergency stop" in caught.value.hint


@pytest.mark.parametrize("timeout_s", [float("inf"), float("nan"), "5", -1.0])
def test_a_time_to_connect_that_is_none_is_rejected(world, timeout_s):
    """Before anything is opened."""
    with pytest.raises(Rejected) as caught:
        connect(transport=world.transport(), timeout_s=timeout_s)
    assert caught.value.field == "timeout_s"
    with pytest.raises(Rejected):
        connect("/nobody.sock", timeout_s=timeout_s)


def test_a_text_that_cannot_be_sent_is_rejected(world, robot):
    """Before anything is asked, by name."""
    with pytest.raises(Rejected, match="Take cannot be sent") as caught:
        robot.control(take="\udcff").acquire()
    assert caught.value.code is Code.BAD_REQUEST and world.engine.requests == []
