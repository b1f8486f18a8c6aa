"""Tests of owning: the lease, enabling, motions, streams, and every way out."""

from __future__ import annotations

import numpy as np
import pytest
from msgspec.structs import replace

from gateway.client import PoseTarget, connect
from gateway.core.messages.outputs import Level, Notice
from gateway.errors import (
    Aborted,
    Cancelled,
    Code,
    Disconnected,
    GatewayTimeout,
    LeaseError,
    NotReady,
    OutcomeUnknown,
    Refusal,
    Rejected,
    Superseded,
)
from gateway.messages import incoming, requests
from gateway.values import Side, Space
from tests.api.stand_in import START_Q, TICK_NS
from tests.client.robot_world import RobotWorld

GOAL = np.array([0.2, 0.6, -0.2, 1.0, 0.1, 0.0, 0.2])


@pytest.fixture
def own(robot):
    """Control of the robot, enabled."""
    with robot.control() as own:
        own.enable()
        yield own


# ----------------------------------------------------------------------------------------------------------- the lease


def test_a_normal_end_releases_and_waits_for_rest(world, robot):
    """`with control()` ends when the robot rests unowned, not when the release was accepted."""
    with robot.control() as own:
        own.enable()
        assert own.epoch == 1 and own.is_open and robot.health().lease_holder == "tester"
    assert world.engine.names() == ["Acquire", "Enable", "Release"]
    state = robot.state
    assert state.state == "READ_ONLY" and not state.lease.owned and not own.is_open
    assert not state.left_arm.is_streaming


def test_an_exception_leaves_the_robot_held(world, robot):
    """A block that is left by an exception abandons: no release, no pause, the exception goes on."""
    with pytest.raises(ZeroDivisionError), robot.control() as own:
        own.enable()
        _ = 1 / 0
    world.run(0.1)
    assert world.engine.names() == ["Acquire", "Enable", "Abandon"]
    assert robot.state.state == "HOLDING" and robot.state.lease.lost_ns is not None
    assert not own.is_open


def test_ctrl_c_in_user_code_leaves_the_robot_held(world, robot):
    """KeyboardInterrupt is an exception like others: held, and re-raised."""
    with pytest.raises(KeyboardInterrupt), robot.control() as own:
        own.enable()
        raise KeyboardInterrupt
    world.run(0.1)
    assert world.engine.names()[-1] == "Abandon"


@pytest.mark.parametrize("wait", ["result", "enable", "tick", "states"])
def test_ctrl_c_in_a_wait_leaves_the_robot_held_at_once(world, robot, wait):
    """Ctrl-C in any wait abandons before the exception reaches user code, and exactly once."""

    def interrupt():
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt), robot.control() as own:
        if wait != "enable":
            own.enable()
        waits = {"enable": own.enable, "states": lambda: [next(states) for _ in range(9)]}
        if wait == "result":
            waits["result"] = own.left_arm.move_to(GOAL).result
        if wait == "tick":
            stream = own.left_arm.stream()
            stream.__enter__()
            waits["tick"] = lambda: [stream.tick() for _ in range(5)]
        states = robot.states()
        world.on_tick = lambda: world.engine.later(0, interrupt) if world.ticks % 7 == 0 else None
        world.engine.later(3, interrupt)
        try:
            waits[wait]()
        finally:
            world.on_tick = None
            world.engine._countdowns.clear()
            assert not own.is_open
            with pytest.raises(LeaseError):
                _ = own.epoch
    world.run(0.1)
    assert world.engine.names().count("Abandon") == 1 and "Release" not in world.engine.names()


def test_on_exit_hold_leaves_the_robot_held(world, robot):
    """on_exit="hold" ends a block like a lost client: brake, hold, the clocks run."""
    with robot.control(on_exit="hold") as own:
        own.enable()
    assert world.engine.names()[-1] == "Abandon"


def test_closing_while_owning_leaves_the_robot_held(world):
    """A client that is closed with the lease abandons it."""
    with connect(transport=world.transport()) as robot:
        own = robot.control().acquire()
        own.enable()
    world.run(0.1)
    assert world.engine.names()[-1] == "Abandon" and world.engine.gone == [robot.client_id]


def test_a_held_lease_is_refused_with_its_owner(world, robot):
    """Who asks for an owned robot learns at once who owns it, and does not look alive for it."""
    with connect(transport=world.transport(), name="second") as second, robot.control():
        with pytest.raises(LeaseError) as caught:
            second.control().acquire()
        assert caught.value.code is Code.LEASE_HELD and "tester" in str(caught.value)
        seen = len(world.engine.seen.get(second.client_id, []))
        world.run(0.5)
        assert len(world.engine.seen.get(second.client_id, [])) <= seen + 1


def test_taking_over_waits_until_the_arms_rest(world, robot):
    """take= gets the robot from its owner, and the block begins when the references stand still."""
    first = robot.control().acquire()
    first.enable()
    with connect(transport=world.transport(), name="person") as person:
        with person.control(take="needs a look") as own:
            assert person.state.left_arm.dq_ref.max() == 0.0 and own.epoch == 2
        assert [r.reason for _, r in world.engine.requests if isinstance(r, requests.Take)] == ["needs a look"]
    with pytest.raises(LeaseError) as caught:
        first.left_arm.hold()
    assert caught.value.code is Code.LEASE_STALE
    first.release()  # what is gone cannot be given back, and need not be


def test_one_client_owns_once(world, robot):
    """A second control of the same client is refused and does not hurt the first."""
    with robot.control() as own:
        with pytest.raises(LeaseError, match="already"):
            robot.control().acquire()
        assert own.is_open
        own.enable()
    assert world.engine.names() == ["Acquire", "Enable", "Release"]


def test_a_robot_that_was_taken_away_can_be_taken_back():
    """The lease that somebody took is over, whether its control was ended or not: no word of an owner that we are."""
    world = RobotWorld()
    with connect(transport=world.transport(), name="a") as first, connect(transport=world.transport()) as second:
        mine = first.control().acquire()
        theirs = second.control(take="a look").acquire()
        with pytest.raises(LeaseError, match="pid"):
            first.control().acquire()  # it is theirs, not "owned by this client already"
        again = first.control(take="back").acquire()
        assert again.is_open and not mine.is_open and again.epoch == 3
        again.hold()
        with pytest.raises(LeaseError):
            theirs.hold()


def test_a_robot_that_became_free_can_be_acquired_again():
    """Whoever slept for longer than the clocks run owns it no more, and is not told that he does."""
    world = RobotWorld()
    with connect(transport=world.transport(), name="a") as robot:
        mine = robot.control().acquire()
        beats, world.transports[0]._beats = world.transports[0]._beats, []
        world.run(11.0)
        world.transports[0]._beats = beats
        again = robot.control().acquire()
        assert again.is_open and again.epoch == 2 and not mine.is_open
        world.run(1.0)
        again.chassis.stop()


def test_a_control_that_was_not_entered_commands_nothing(world, robot):
    """Commands need the lease; none is sent without."""
    own = robot.control()
    for command in (own.enable, own.hold, own.left_arm.hold, lambda: own.left_arm.move_to(GOAL), own.left_arm.stream):
        with pytest.raises(LeaseError):
            command()
    own.release()
    assert world.engine.requests == []


def test_a_control_that_ended_stays_ended(world, robot):
    """After its block a control commands nothing, even when the same client owns the robot again."""
    with robot.control() as first:
        first.enable()
    with robot.control() as second, pytest.raises(LeaseError):
        assert second.is_open
        first.enable()


def test_keepalives_come_every_50_ms_while_owning_and_not_before_or_after(world, robot):
    """The owner shows that it lives on a grid of 50 ms, whatever it does; a reader does not."""
    world.run(0.5)
    assert robot.client_id not in world.engine.seen
    with robot.control():
        world.run(2.0)
        seen = list(world.engine.seen[robot.client_id])
        assert 39 <= len(seen) <= 43 and max(np.diff(seen)) <= 60_000_000
    count = len(world.engine.seen[robot.client_id])
    world.run(1.0)
    assert len(world.engine.seen[robot.client_id]) <= count + 1


def test_the_reply_to_acquire_getting_lost_leaves_no_signs_of_life(world, robot):
    """Who does not know that it owns the robot must not keep it."""
    world.engine.mute = {requests.Acquire}
    with pytest.raises(OutcomeUnknown):
        robot.control().acquire()
    count = len(world.engine.seen[robot.client_id])
    world.run(1.0)
    assert len(world.engine.seen[robot.client_id]) <= count + 1


# ------------------------------------------------------------------------------------------------------------ enabling


def test_enable_returns_when_the_fsm_is_ready(world, robot):
    """enable() waits for the outcome in the snapshot, not for the reply."""
    with robot.control() as own:
        own.enable(timeout=5.0)
        assert robot.state.state == "ACTIVE" and robot.state.fsm_name == "READY"
        own.enable(timeout=0.5)  # already: success, nothing new
        own.disable()
        assert robot.state.state == "IDLE" and robot.state.lease.owned


def test_enable_raises_what_was_missing(world, robot):
    """A failed outcome arrives with its code and message."""
    world.engine.enable_outcome = "ENABLE_TIMEOUT"
    with robot.control() as own, pytest.raises(NotReady) as caught:
        own.enable()
    assert caught.value.code is Code.ENABLE_TIMEOUT and "READY was not seen" in str(caught.value)


def test_enable_raises_the_refusal(world, robot):
    """A refusal at once arrives with its class."""
    world.engine.refusals[requests.Enable] = Refusal(code=Code.MODE_VR, message="the robot is in VR mode")
    with robot.control() as own, pytest.raises(NotReady) as caught:
        own.enable()
    assert caught.value.code is Code.MODE_VR and "reboot" in caught.value.hint


def test_enable_that_takes_too_long_times_out_and_says_what_is_seen(world, robot):
    """A wait ends in time, with the state in its message."""
    with robot.control() as own:
        world.engine.later = lambda ticks, action: None
        before_ns = world.time_ns
        with pytest.raises(GatewayTimeout, match="ENABLING"):
            own.enable(timeout=1.0)
        assert (world.time_ns - before_ns) / 1e9 == pytest.approx(1.0, abs=0.05)
        del world.engine.later


def test_enable_ends_when_the_lease_is_lost(world, robot):
    """Who waits for READY and loses the robot is told so, not left waiting."""
    with robot.control() as own:
        world.engine.later(3, world.engine.free)
        with pytest.raises(LeaseError) as caught:
            own.enable()
        assert caught.value.code is Code.LEASE_LOST


def test_who_loses_the_robot_while_it_enables_is_told_the_reason(world, robot):
    """That of the takeover, once the gateway has told it."""
    lease = replace(world.engine.snapshot.lease, owned=True, name="operator", client_id="x", pid=9, epoch=99)
    facts = {"epoch": "99"}
    told = Notice(code=Code.LEASE_CHANGED, level=Level.WARNING, message="operator took it: smoke", at_ns=1, facts=facts)

    def happen():
        world.engine.notices.append(told)
        world.engine.show(lease=lease)

    with robot.control() as own:
        world.engine.later(3, happen)
        with pytest.raises(LeaseError, match="is over: operator took it: smoke"):
            own.enable()


def test_enable_from_a_held_robot_waits_for_the_walk(world, robot):
    """When the reference is led back to the arms, enable() waits until it is there."""
    with robot.control() as own:
        own.enable()
        far = world.engine._arm(START_Q, 0.1)
        arms = {
            side: far.__class__(**{n: getattr(far, n) for n in far.__slots__} | {"tracking_rad": 0.5})
            for side in ("left", "right")
        }
        world.engine.show(state="HOLDING", arms=arms)
        world.engine._on_enable = lambda event: {"attempt": 1, "outcome": "ok", "walking": True}
        still = {side: world.engine._arm(START_Q) for side in ("left", "right")}
        world.engine.later(30, lambda: world.engine.show(arms=still))
        before_ns = world.time_ns
        own.enable()
        assert (world.time_ns - before_ns) / TICK_NS >= 29


# ------------------------------------------------------------------------------------------------------------- motions


def test_a_motion_is_accepted_at_once_and_reached_later(world, own):
    """move_to returns a handle; result() waits for the measured end."""
    handle = own.left_arm.move_to(GOAL, speed=0.5)
    assert not handle.done and handle.state in ("queued", "executing") and "motion 1" in repr(handle)
    result = handle.result(timeout=5.0)
    assert handle.done and handle.state == "reached" and handle.progress == 1.0
    assert result.error == pytest.approx(0.004) and result.sides == ("left",) and result.duration == 0.2
    assert handle.goal == {"left": tuple(GOAL)} and handle.clipped == ()
    _, request = world.engine.requests[-1]
    assert request == requests.Move(epoch=1, targets_rad={Side.LEFT: tuple(GOAL)}, speed=0.5)


def test_two_arms_move_in_one_motion(world, own):
    """One request moves both arms; offsets are marked as such; the tolerance goes along."""
    own.move_by({"right": np.zeros(7), "left": GOAL * 0.01}, tolerance=0.02, on_limit="clip").result(timeout=5.0)
    _, request = world.engine.requests[-1]
    assert set(request.targets_rad) == {Side.LEFT, Side.RIGHT}
    assert request.relative and request.tolerance_rad == 0.02 and request.on_limit is incoming.OnLimit.CLIP


@pytest.mark.parametrize("straight", [False, True])
def test_a_pose_is_gone_to_straight_only_where_that_is_asked_for(world, own, straight):
    """`move_pose` and `move_linear` of an arm are those of both arms, with one of them, in its frame."""
    go, both = (own.left_arm.move_linear, own.move_linear) if straight else (own.left_arm.move_pose, own.move_pose)
    p, quat = (0.3, 0.1, -0.2), (0.0, 0.0, 0.0, 1.0)
    go(p, quat, frame="left_shoulder_base", speed=0.4, tolerance_m=0.002)
    _, request = world.engine.requests[-1]
    assert request == requests.MovePose(
        epoch=1,
        targets={Side.LEFT: (*p, *quat)},
        frames={Side.LEFT: "left_shoulder_base"},
        speed=0.4,
        tolerance_m=0.002,
        straight=straight,
    )
    both({side: PoseTarget(p, quat, f"{side}_shoulder_base") for side in ("left", "right")})
    _, request = world.engine.requests[-1]
    assert (set(request.targets), request.straight) == ({Side.LEFT, Side.RIGHT}, straight)


def test_clipped_joints_are_named(own):
    """What was clipped is on the handle."""
    assert own.left_arm.move_to(GOAL, on_limit="clip").clipped == ("left_arm[3]",)


@pytest.mark.parametrize(
    ("targets", "code"),
    [
        ({"left": [0.0] * 6}, Code.WRONG_SHAPE),
        ({"left": [[0.0] * 7]}, Code.WRONG_SHAPE),
        ({"left": "arm"}, Code.WRONG_SHAPE),
        ({"left": None}, Code.WRONG_SHAPE),
        ({"left": [0.0] * 6 + [float("nan")]}, Code.NOT_FINITE),
        ({"left": [0.0] * 6 + [float("inf")]}, Code.NOT_FINITE),
        ({}, Code.WRONG_SHAPE),
        ({"middle": [0.0] * 7}, Code.WRONG_SHAPE),
    ],
)
def test_a_goal_that_is_none_is_rejected_before_it_is_sent(world, own, targets, code):
    """Shape and finiteness are judged here, with the daemon's codes."""
    before = len(world.engine.requests)
    with pytest.raises(Rejected) as caught:
        own.move_to(targets)
    assert caught.value.code is code and len(world.engine.requests) == before


@pytest.mark.parametrize(
    ("end", "kind"),
    [("TRACKING_ERROR", Aborted), ("ESTOP", Aborted), ("SETTLE_TIMEOUT", Aborted), ("LEASE_LOST", Aborted)],
)
def test_an_aborted_motion_raises_with_its_code(world, own, end, kind):
    """However a motion is ended from outside, result() raises Aborted, and the code says why."""
    world.engine.motion_end = end
    handle = own.left_arm.move_to(GOAL)
    with pytest.raises(kind) as caught:
        handle.result(timeout=5.0)
    assert caught.value.code.value == end and "aborted" in str(caught.value)


def test_a_cancelled_motion_has_stood_still(world, robot, own):
    """cancel() returns when the references stand still; result() raises Cancelled; cancelling again is nothing."""
    handle = own.left_arm.move_to(GOAL)
    handle.cancel()
    assert robot.state.left_arm.dq_ref.max() == 0.0 and handle.state == "cancelled"
    with pytest.raises(Cancelled):
        handle.result()
    handle.cancel()
    assert world.engine.names().count("Cancel") == 1


def test_a_superseded_motion_says_so(own):
    """A later motion ends the earlier one for its handle."""
    first = own.left_arm.move_to(GOAL)
    second = own.left_arm.move_to(GOAL)
    with pytest.raises(Superseded):
        first.result()
    assert second.result().motion_id == 2


def test_hold_ends_motions(own):
    """hold() of an arm, or of both, ends their motions as cancelled."""
    handle = own.left_arm.move_to(GOAL)
    own.left_arm.hold()
    with pytest.raises(Cancelled):
        handle.result()
    own.hold()


def test_a_timeout_of_result_leaves_the_motion_alone(world, own):
    """A wait that ends early raises GatewayTimeout (a TimeoutError); the motion goes on and can be waited for again."""
    handle = own.left_arm.move_to(GOAL)
    with pytest.raises(TimeoutError):
        handle.result(timeout=0.05)
    assert handle.result(timeout=5.0).motion_id == 1 and "Cancel" not in world.engine.names()


@pytest.mark.parametrize("timeout", [-1.0, float("nan"), float("inf")])
def test_no_wait_is_endless(own, timeout):
    """A timeout that is none is refused."""
    with pytest.raises(Rejected):
        own.left_arm.move_to(GOAL).result(timeout=timeout)


def test_the_end_of_a_motion_is_not_missed_by_an_idle_owner(world, own):
    """An owner who looks only much later still learns how its motion ended, although it is no longer listed."""
    handle = own.left_arm.move_to(GOAL)
    world.run(0.5)
    world.engine.show(motions=())
    world.run(0.2)
    assert handle.result().motion_id == handle.motion_id


def test_a_motion_that_vanished_is_unknown(world, own):
    """A motion that no snapshot lists although it should is not called reached."""
    handle = own.left_arm.move_to(GOAL)
    world.engine._countdowns.clear()
    world.engine.show(motions=())
    with pytest.raises(OutcomeUnknown):
        handle.result()
    assert handle.done and handle.state == "unknown"


def test_a_daemon_that_dies_ends_the_wait_for_a_motion_and_the_block(world, robot):
    """Waiting for a motion of a dead daemon ends within about a second as Disconnected; so does a normal end."""
    with pytest.raises(Disconnected), robot.control() as own:
        own.enable()
        handle = own.left_arm.move_to(GOAL)
        world.plane.set_reachable(False)
        world.engine.frozen = True
        before_ns = world.time_ns
        with pytest.raises(Disconnected):
            handle.result(timeout=30.0)
        assert (world.time_ns - before_ns) / 1e9 < 1.2


def test_a_restarted_daemon_ends_the_wait_for_a_motion(world, own):
    """Another daemon does not know the motion: Disconnected, not a timeout."""
    handle = own.left_arm.move_to(GOAL)
    world.plane.set_reachable(False)
    world.plane._daemon_id = "second"
    world.plane.set_reachable(True)
    with pytest.raises(Disconnected, match="restarted"):
        handle.result(timeout=30.0)
    assert handle.done and handle.state == "unknown"


# ------------------------------------------------------------------------------------------------------------- streams


def test_a_stream_starts_where_the_arm_is_held_and_sends_what_is_set(world, own):
    """Q is the start, then the last target; set() returns what goes out; the newest target arrives with rising seq."""
    with own.left_arm.stream(rate_hz=50, speed=0.7, expiry=0.5) as out:
        assert np.allclose(out.q, START_Q)
        for step in range(10):
            sent = out.set(np.array(START_Q) + 0.001 * step)
            out.tick()
        assert np.allclose(sent, out.q) and sent.shape == (7,) and not sent.flags.writeable
        assert out.accepted == 10 and not out.limited and out.skipped == 0
    _, opened = next((c, r) for c, r in world.engine.requests if isinstance(r, requests.OpenStream))
    assert opened.speed == 0.7 and opened.expiry_ns == 500_000_000
    assert [t.seq for t in world.engine.targets] == list(range(1, 11)) and world.engine.targets[-1].epoch == 1
    assert np.allclose(world.engine.targets[-1].values, sent)
    assert world.engine.names()[-1] == "CloseStream"


def test_ticks_keep_an_absolute_grid_and_skip_what_is_late(world, own):
    """tick() does not drift; a late user loses periods, which are counted and never made up for."""
    with own.left_arm.stream(rate_hz=20) as out:
        before_ns = world.time_ns
        for _ in range(20):
            world.run(0.02)  # the user's work
            out.tick()
        assert (world.time_ns - before_ns) / 1e9 == pytest.approx(1.0, abs=0.011)
        world.run(0.22)
        out.tick()
        assert out.skipped == 4
        assert (world.time_ns - before_ns) / 1e9 == pytest.approx(1.25, abs=0.011)


@pytest.mark.parametrize(
    ("q", "code", "field"),
    [
        ([0.0] * 6, Code.WRONG_SHAPE, "left_arm"),
        ([0.0] * 6 + [np.nan], Code.NOT_FINITE, "left_arm[6]"),
        ([0.0, 0.5, 0.0, 0.1, 0.0, 0.0, 0.0], Code.OUT_OF_RANGE, "left_arm[3]"),
    ],
)
def test_a_bad_target_is_rejected_where_it_was_made(world, own, q, code, field):
    """set() refuses shape, finiteness and limits itself, with value and bound, and sends nothing."""
    with own.left_arm.stream() as out:
        with pytest.raises(Rejected) as caught:
            out.set(q)
        assert caught.value.code is code and caught.value.field == field
        assert np.allclose(out.q, START_Q)
    assert world.engine.targets == []


def test_a_target_is_clipped_when_that_was_asked_for(world, own):
    """on_limit="clip" returns and sends the clipped target."""
    with own.left_arm.stream(on_limit="clip") as out:
        sent = out.set([0.0, 0.5, 0.0, 0.1, 0.0, 0.0, 0.0])
        assert sent[3] == 0.25
        out.tick()
    assert world.engine.targets[-1].values[3] == 0.25


def test_an_ended_stream_raises_at_the_next_tick(world, own):
    """A stream that something ended tells why at the next tick, with the exception of its code."""
    with pytest.raises(Aborted) as caught, own.left_arm.stream() as out:
        out.tick()
        world.engine.end_streams("TARGET_EXPIRED")
        for _ in range(3):
            out.set(START_Q)
            out.tick()
    assert caught.value.code is Code.TARGET_EXPIRED and "left" in str(caught.value)


def test_a_stream_is_checked_without_waiting(world, own):
    """In loops that somebody else paces: no time passes, and an end is told as by `tick`."""
    with pytest.raises(Aborted) as caught, own.left_arm.stream() as out:
        before = world.now_ns()
        out.check()
        assert world.now_ns() == before
        world.engine.end_streams("STOPPED")
        world.run(0.1)
        out.check()
    assert caught.value.code is Code.STOPPED


def test_a_refused_target_raises_at_the_next_tick_once(world, own):
    """What the daemon refuses of a target is raised in the stream it belongs to, and only once."""
    with own.left_arm.stream() as out:
        out.tick()
        world.engine.refuse_target("OUT_OF_RANGE", "left arm joint 4 is outside")
        with pytest.raises(Rejected, match="joint 4"):
            for _ in range(3):
                out.tick()
        out.tick()


def test_a_stream_that_is_no_longer_listed_has_ended(world, own):
    """A snapshot that must list the stream and does not means that it ended."""
    with pytest.raises(Aborted) as caught, own.left_arm.stream() as out:
        out.tick()
        world.engine.show(targets=())
        for _ in range(3):
            out.tick()
    assert caught.value.code is Code.STREAM_ENDED


def test_a_stream_is_used_once_and_inside_its_block(own):
    """Targets need an opened stream; a stream is not opened twice."""
    out = own.left_arm.stream()
    with pytest.raises(Rejected) as caught:
        out.set(START_Q)
    assert caught.value.code is Code.UNKNOWN_STREAM
    with out:
        pass
    with pytest.raises(Aborted), out:
        pass


def test_a_hand_that_yields_is_kept_alive_by_its_ticks(world, own):
    """Each repeats the anchor, where the stream starts or what was set last; the request says how it yields, axis by axis."""
    how = {"mass_kg": (8, None, 8), "damping": 200, "stiffness": (0, 0, 50.0), "inertia_kgm2": 0.1, "turn_damping": 20}
    with own.left_arm.stream("admittance", 50.0, frame="left_shoulder_base", **how) as hand:
        for _ in range(3):
            hand.tick()
        hand.set((0.2, 0.1, -0.2), (0.0, 0.0, 0.0, 1.0))
        hand.tick()
    _, opened = next((c, r) for c, r in world.engine.requests if isinstance(r, requests.OpenStream))
    wish = opened.admittance
    assert (opened.space, wish.mass) == (Space.POSE, (8.0, None, 8.0, 0.1, 0.1, 0.1))
    assert wish.damping == (200.0,) * 3 + (20.0,) * 3 and wish.stiffness == (0.0, 0.0, 50.0, 0.0, 0.0, 0.0)
    sent = [target.values for target in world.engine.targets]
    assert sent[0] == sent[2] == pytest.approx(START_Q) and sent[-1][:3] == (0.2, 0.1, -0.2)


@pytest.mark.parametrize(
    ("space", "how", "code", "field"),
    [
        ("admittance", {"mass_kg": (8.0, 8.0)}, Code.WRONG_SHAPE, "mass_kg"),
        ("admittance", {"mass_kg": 8.0, "turn_damping": (1.0,) * 6}, Code.WRONG_SHAPE, "turn_damping"),
        ("admittance", {"mass_kg": "8"}, Code.BAD_REQUEST, "mass_kg"),
        ("admittance", {"mass_kg": 8.0, "frame": "right_shoulder_base"}, Code.WRONG_FRAME, "left_arm.frame"),
        ("pose", {"mass_kg": 8.0}, Code.BAD_REQUEST, "space"),
        ("joint", {"inertia_kgm2": 0.1}, Code.BAD_REQUEST, "space"),
    ],
)
def test_what_is_no_virtual_mass_is_refused_where_it_is_made(own, space, how, code, field):
    """By its keyword; and one beside targets that lead the hand is not passed over in silence."""
    with pytest.raises(Rejected) as caught:
        own.left_arm.stream(space, **{"frame": "left_shoulder_base", **how})
    assert (caught.value.code, caught.value.field) == (code, field)


@pytest.mark.parametrize("rate", [0.5, 101.0, float("nan")])
def test_targets_are_taken_at_1_to_100_hz(own, rate):
    """A rate outside is refused with its bound."""
    with pytest.raises(Rejected) as caught:
        own.left_arm.stream(rate_hz=rate)
    assert caught.value.bound == "[1, 100]"


def test_the_error_of_the_block_wins_over_the_one_of_closing(world, own):
    """When a block fails and closing its stream fails too, the first error is told."""
    world.engine.refusals[requests.CloseStream] = Refusal(code=Code.LEASE_LOST, message="gone")
    with pytest.raises(ZeroDivisionError), own.left_arm.stream():
        _ = 1 / 0
    world.engine.refusals[requests.CloseStream] = Refusal(code=Code.LEASE_LOST, message="gone")
    with pytest.raises(LeaseError), own.left_arm.stream():
        pass


def test_a_stop_by_somebody_else_reaches_the_owner(world, own, robot):
    """Motions and streams of the owner end when anybody stops the robot."""
    handle = own.right_arm.move_to(-GOAL)
    with connect(transport=world.transport(), name="guard") as guard:
        guard.stop("hand in the way")
    with pytest.raises(Aborted) as caught:
        handle.result()
    assert caught.value.code is Code.STOPPED


# ----------------------------------------------------------------------------------------------------------- chunks


ROWS = np.tile(np.asarray(START_Q), (4, 1)) + np.linspace(0.0, 0.03, 4)[:, None]


def asked(world):
    """The last request that reached the engine."""
    return world.engine.requests[-1][1]


def test_a_chunk_is_asked_for_with_everything_that_was_wished(world, own):
    """Arrays of any kind; seconds become nanoseconds; one tolerance stands for seven."""
    handle = own.left_arm.follow(
        ROWS.astype(np.float32),
        dt=0.1,
        start_in=-0.3,
        open_end=True,
        stretch=2.0,
        smoothing=0.1,
        path_tolerance=0.2,
        goal_tolerance=[0.1, None, None, None, None, None, 0.1],
        goal_time=1.5,
    )
    request = asked(world)
    assert isinstance(request, requests.Follow) and list(request.points) == [Side.LEFT]
    assert (request.dt_s, request.stretch, request.smoothing_s, request.open_end) == (0.1, 2.0, 0.1, True)
    assert (request.start_at_ns, request.start_in_ns, request.goal_time_ns) == (None, -300_000_000, 1_500_000_000)
    assert request.path_tolerance == {Side.LEFT: (0.2,) * 7}
    assert request.goal_tolerance == {Side.LEFT: (0.1, None, None, None, None, None, 0.1)}
    assert handle.motion_id > 0 and not handle.done


def test_both_arms_follow_on_one_clock(world, own):
    """With times, from an instant on."""
    rights = np.tile(np.asarray([-0.5, -0.92, 0.52, -1.28, 0.32, 0.55, -0.52]), (4, 1))
    own.follow({"right": rights, "left": ROWS}, times=[0.0, 0.1, 0.2, 0.4], start_at=12.5)
    request = asked(world)
    assert list(request.points) == [Side.LEFT, Side.RIGHT]
    assert request.start_at_ns == 12_500_000_000 and request.times_s == (0.0, 0.1, 0.2, 0.4)


@pytest.mark.parametrize("targets", [{}, {"lft": [0.0] * 7}])
def test_who_names_no_arm_is_told_the_names(own, targets):
    """Not to give another number of values."""
    for ask in (own.move_to, own.follow):
        with pytest.raises(Rejected) as caught:
            ask(targets)
        assert caught.value.code is Code.WRONG_SHAPE and caught.value.hint == "name left, right or both"


@pytest.mark.parametrize(
    ("points", "how", "code"),
    [
        ({}, {"dt": 0.1}, Code.WRONG_SHAPE),
        ({"middle": ROWS}, {"dt": 0.1}, Code.WRONG_SHAPE),
        ({"left": ROWS[0]}, {"dt": 0.1}, Code.WRONG_SHAPE),
        ({"left": ROWS[:, :6]}, {"dt": 0.1}, Code.WRONG_SHAPE),
        ({"left": [["a"] * 7] * 2}, {"dt": 0.1}, Code.WRONG_SHAPE),
        ({"left": ROWS}, {"times": [[0.0, 0.1, 0.2, 0.3]]}, Code.WRONG_SHAPE),
        ({"left": ROWS}, {"times": ["soon"] * 4}, Code.WRONG_SHAPE),
        ({"left": ROWS}, {"dt": 0.1, "path_tolerance": [0.1] * 6}, Code.WRONG_SHAPE),
        ({"left": ROWS}, {"dt": 0.1, "start_at": 1.0, "start_in": 1.0}, Code.BAD_REQUEST),
        ({"left": ROWS}, {"dt": 0.1, "start_at": float("nan")}, Code.OUT_OF_RANGE),
        ({"left": ROWS}, {"dt": 0.1, "goal_time": float("inf")}, Code.OUT_OF_RANGE),
        ({"left": ROWS}, {}, Code.BAD_REQUEST),
        ({"left": ROWS * np.nan}, {"dt": 0.1}, Code.NOT_FINITE),
    ],
)
def test_what_is_no_chunk_is_refused_where_it_is_seen_first(world, own, points, how, code):
    """By the client or by the daemon, with the same class and code; nothing reaches the engine."""
    count = len(world.engine.requests)
    with pytest.raises(Rejected) as caught:
        own.follow(points, **how)
    assert caught.value.code is code and len(world.engine.requests) == count


def test_poses_are_followed_in_the_frame_that_is_named(world, own):
    """Seven numbers a point; two tolerances, of position and orientation; one number for both would be neither."""
    poses = np.tile([0.3, -0.1, -0.2, 0.0, 0.0, 0.0, 1.0], (4, 1)) + np.linspace(0.0, 0.01, 4)[:, None] * np.eye(7)[0]
    own.right_arm.follow(poses, 0.1, frame="right_shoulder_base", path_tolerance=[0.02, None])
    request = asked(world)
    assert request.space is Space.POSE and request.frames == {Side.RIGHT: "right_shoulder_base"}
    assert request.path_tolerance == {Side.RIGHT: (0.02, None)}
    own.follow({"right": poses}, 0.1, frames={"right": "right_shoulder_base"})
    assert asked(world).space is Space.POSE
    for tolerance in (0.02, [0.1] * 7):
        with pytest.raises(Rejected) as caught:
            own.right_arm.follow(poses, 0.1, frame="right_shoulder_base", goal_tolerance=tolerance)
        assert caught.value.code is Code.WRONG_SHAPE


def test_a_handle_tells_what_was_skipped_and_how_far_smoothing_moved(world, own):
    """From the reply."""
    handle = own.left_arm.follow(ROWS, 0.1)
    handle._facts = {**handle._facts, "skipped": 3, "moved": 0.002}
    assert (handle.skipped, handle.moved) == (3, 0.002)
