"""BEHAVIOUR, Losing: clocks that jump, a host that sleeps, ticks that come late."""

from __future__ import annotations

from itertools import pairwise

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from gateway.core.messages.events import ClientSeen, Suspended
from gateway.core.messages.outputs import FrameKind
from gateway.errors import Code
from gateway.messages.requests import Disable, DriveChassis, Enable, Estop, Move
from gateway.robot.topics import CHASSIS_VELOCITY, FSM_ENABLE, arm_state, joint_command
from gateway.sim.robot.settings import SimSettings
from gateway.values import Side
from tests.behaviour.scene import HOME, Scene, scene
from tests.pair import COMPLIANCE_RADPNM, MS, S
from tests.thoroughness import either, traces

# --------------------------------------------------------------------------------------------------- time and host


@pytest.mark.parametrize("step_s", [3600.0, -3600.0])
@pytest.mark.parametrize("state", ["ACTIVE", "HOLDING"])
def test_a_jump_of_the_robots_clock_changes_nothing(step_s: float, state: str) -> None:
    """Ages are monotonic; stamps are compared with each other only."""
    pair = scene(state)
    pair.robot.inject({"fault": "clock_step", "step_s": step_s}, pair.now_ns)
    pair.run(0.5)
    assert pair.state == state and all(pair.gap_ms(joint_command(side)) <= 11 for side in Side)
    pair.granted(Move(epoch=pair.epoch, targets_rad=HOME), "ann")


def test_enabling_works_after_a_jump_of_the_robots_clock() -> None:
    """The least lag of before the jump says nothing about the samples after it."""
    for step_s in (3600.0, -3600.0):
        pair = scene("IDLE")
        pair.robot.inject({"fault": "clock_step", "step_s": step_s}, pair.now_ns)
        pair.granted(Enable(epoch=pair.epoch), "ann")
        pair.run_until(lambda pair=pair: pair.state == "ACTIVE", 10.0)


OFF = [(-64 * 86_400.0, 500.0), (-0.05, -500.0), (0.05, 500.0), (3600.0, -500.0)]
"""Clocks of robots: how far ahead at the start [s], how much faster [ppm]; 500 ppm is as fast as a host's clock is slewed."""


def off(offset_s: float, drift_ppm: float, state: str) -> Scene:
    """A robot whose clock is off and drifts, longer than the gateway remembers the least lag."""
    clock = {"clock_offset_ns": round(offset_s * S), "clock_drift_ppm": drift_ppm}
    sim = SimSettings(state_period_ns=10 * MS, compliance_radpnm=COMPLIANCE_RADPNM, **clock)
    pair = scene(state, Scene(sim, snapshot_hz=50))
    pair.run(70.0)
    return pair


@pytest.mark.slow
@pytest.mark.parametrize("clock", either(OFF[:2], OFF))
def test_a_robots_clock_that_is_off_and_drifts_changes_nothing(clock: tuple[float, float]) -> None:
    """Nothing goes stale, is refused or judged milder: no setpoint is late, a jump is refused, a long one kills its part."""
    pair = off(*clock, "HOLDING")
    topic, jump = arm_state(Side.LEFT), {"fault": "jump", "side": "left", "joint": 2, "delta_rad": 0.6}
    assert pair.state == "HOLDING" and all(pair.gap_ms(joint_command(side)) <= 11 for side in Side)
    assert pair.see().topics[topic].refused == 0
    motion = pair.granted(Move(epoch=pair.epoch, targets_rad=HOME), "ann")["motion_id"]
    pair.robot.inject({**jump, "duration_s": 0.05}, pair.now_ns)
    pair.run(0.15)
    assert pair.state == "ACTIVE" and pair.see().topics[topic].refused >= 4
    pair.robot.inject({**jump, "duration_s": 0.2}, pair.now_ns)
    pair.run_until(lambda: pair.state == "HOLDING", 0.13)
    assert pair.motion_view(motion).code == "PART_LOST"


@pytest.mark.slow
@pytest.mark.parametrize("clock", either(OFF[:2], OFF))
def test_enabling_knows_old_state_whatever_the_robots_clock(clock: tuple[float, float]) -> None:
    """An arm may start at once by what comes in time, and not by what waited in the link for 0.3 s."""
    pair = off(*clock, "IDLE")
    fault = {"fault": "delay", "topic": arm_state(Side.LEFT), "delay_s": 0.3, "duration_s": 2.0}
    pair.robot.inject(fault, pair.now_ns)
    pair.run(1.0)
    pair.granted(Enable(epoch=pair.epoch), "ann")
    pair.run(1.0)
    assert pair.arm_frames(Side.LEFT) == [] and pair.state == "ENABLING"
    pair.run_until(lambda: pair.state == "ACTIVE", 1.0)
    pair.granted(Disable(epoch=pair.epoch), "ann")
    pair.run_until(lambda: pair.state == "IDLE", 5.0)
    pair.run(1.0)
    pair.mark()
    pair.granted(Enable(epoch=pair.epoch), "ann")
    pair.run(0.05)
    assert pair.arm_frames(Side.LEFT)


@pytest.mark.slow
@pytest.mark.parametrize("drift_ppm", [500.0, -500.0])
def test_a_drift_that_begins_and_ends_in_mid_motion_changes_nothing(drift_ppm: float) -> None:
    """As where a robot's clock is slewed towards its time server's."""
    pair = scene("ACTIVE")
    pair.robot.inject({"fault": "clock_drift", "drift_ppm": drift_ppm, "duration_s": 30.0}, pair.now_ns)
    pair.run(60.0)
    assert all(pair.gap_ms(joint_command(side)) <= 11 for side in Side) and not pair.told(Code.PART_LOST)
    pair.granted(Move(epoch=pair.epoch, targets_rad=HOME), "ann")


@pytest.mark.parametrize("state", ["IDLE", "ENABLING", "ACTIVE", "HOLDING", "PAUSED", "STOPPING", "STALE"])
def test_a_suspend_frees_the_lease_and_takes_everything_down(state: str) -> None:
    """Nothing of what was held is held any more; nobody owns the robot; it is told."""
    pair = scene(state)
    pair.receive(Suspended(slept_ns=30 * S, at_ns=pair.now_ns))
    pair.run(0.5)
    assert pair.owner is None and pair.arm_frames() == [] and 1.0 not in pair.beats and pair.told(Code.SUSPENDED)
    assert state in {"IDLE", "STALE"} or pair.beats[0] == 0.0


def test_a_suspend_that_finds_only_old_state_holds_nothing_either() -> None:
    """After a sleep the newest state is old: STALE, but nothing is held there and nothing resumes."""
    pair = scene("HOLDING")
    pair.now_ns += 2 * S
    pair.receive(Suspended(slept_ns=2 * S, at_ns=pair.now_ns))
    pair.mark()
    pair.is_deaf = True
    pair.run(0.3)
    assert pair.state == "STALE" and pair.arm_frames() == [] and 1.0 not in pair.beats
    pair.is_deaf = False
    pair.run(1.0)
    assert pair.state == "READ_ONLY" and pair.arm_frames() == [] and 1.0 not in pair.beats


def test_what_was_heard_before_a_sleep_is_not_believed_after_it() -> None:
    """CLOCK_MONOTONIC stood still meanwhile, so ages say nothing: nothing is enabled before everything is heard anew."""
    pair = scene("IDLE")
    pair.receive(Suspended(slept_ns=3600 * S, at_ns=pair.now_ns))
    epoch = pair.own("bob")
    refusal = pair.refused(Enable(epoch=epoch), "bob")
    assert refusal.code in {Code.STATE_STALE, Code.MODE_UNKNOWN, Code.FSM_UNKNOWN}
    pair.run(1.1)
    pair.granted(Enable(epoch=epoch), "bob")


@pytest.mark.parametrize(("late_ms", "is_skipped"), [(20, False), (50, False), (51, True), (120, True)])
def test_a_tick_that_is_more_than_50_ms_late_is_skipped_and_told(late_ms: int, is_skipped: bool) -> None:
    """Never caught up: the next tick goes on by one period's step."""
    pair = scene("ACTIVE")
    pair.late_ns = late_ms * MS
    output = pair.step(pair.now_ns + late_ms * MS)
    assert bool(output.frames) is not is_skipped and bool(pair.told(Code.TICK_LATE)) is is_skipped
    pair.run(0.2)
    values = [frame.values for _, frame in pair.sent_on(joint_command(Side.LEFT))]
    assert max(abs(b - a) for x, y in pairwise(values) for a, b in zip(x, y, strict=True)) <= 0.01 + 1e-6
    assert pair.state == "ACTIVE"


def test_after_a_gap_in_which_the_robot_stopped_the_arms_the_motion_is_over() -> None:
    """More than 0.15 s without a setpoint: zero-velocity protection (manual §4.3); one at speed must not follow it."""
    pair = scene("ACTIVE")
    pair.late_ns = 200 * MS
    pair.step(pair.now_ns + 200 * MS)
    assert pair.state == "HOLDING" and "200 ms late" in pair.told(Code.MOTION_ENDED)[-1]
    at_ns = pair.now_ns
    pair.run(0.5)
    assert FrameKind.MOTION not in pair.kinds_since(at_ns) and pair.state == "HOLDING"


def test_after_late_ticks_that_make_such_a_gap_together_the_motion_is_over() -> None:
    """Each of them alone is only skipped; whichever setpoint comes next would meet arms that the robot has stopped."""
    pair = scene("ACTIVE")
    for late_ms in (60, 60, 50):
        late_tick(pair, late_ms)
    assert pair.state == "HOLDING" and "ms after the last that was in time" in pair.told(Code.MOTION_ENDED)[-1]
    assert FrameKind.MOTION not in pair.kinds_since(pair.now_ns)
    pair = scene("ACTIVE")
    late_tick(pair, 60)
    pair.run(0.05)
    late_tick(pair, 60)
    assert pair.state == "ACTIVE", "each gap counts by itself"


def test_a_late_tick_still_sends_stop_frames() -> None:
    """0.0, chassis zeros and lift leave whatever the time is."""
    pair = scene("ACTIVE")
    pair.tell(Estop(), "bob")
    pair.late_ns = 400 * MS
    output = pair.step(pair.now_ns + 400 * MS)
    assert {frame.topic for frame in output.frames} == {FSM_ENABLE, CHASSIS_VELOCITY}


# ------------------------------------------------------------------------------- a vanished owner, however ticks come


def freeze_owner(pair: Scene) -> int:
    """Ann gives her last sign of life in a slow motion of both arms; return when [ns]."""
    pair.granted(Move(epoch=pair.epoch, targets_rad=HOME, speed=0.05), "ann")
    pair.run(0.1)
    pair.receive(ClientSeen(client_id="ann", at_ns=pair.now_ns))
    pair.alive.discard("ann")
    return pair.now_ns


def late_tick(pair: Scene, late_ms: int) -> None:
    """The next tick of the 10 ms grid comes late."""
    pair.late_ns = late_ms * MS
    pair.step((pair.now_ns // (10 * MS) + 1) * 10 * MS + late_ms * MS)


def test_motion_ends_in_time_after_the_owner_vanished_though_every_tick_is_late() -> None:
    """49 ms each, which is no reason to skip one: one of them explains 49 ms of its silence, not all of them all of it."""
    pair = scene("at rest")
    last_ns = freeze_owner(pair)
    for _ in range(40):
        late_tick(pair, 49)
    moved = [at_ns for at_ns, frame in pair.arm_frames() if frame.kind is FrameKind.MOTION]
    assert last_ns + 200 * MS < max(moved) <= last_ns + 300 * MS and pair.state == "HOLDING"


def test_what_a_vanished_owner_asked_before_a_pause_of_ours_does_not_move_after_it() -> None:
    """It is read 5 s late, with a keepalive of the same time: refused, and the owner is lost 250 ms later."""
    pair = scene("at rest")
    pair.alive.discard("ann")
    pair.receive(ClientSeen(client_id="ann", at_ns=pair.now_ns + 100 * MS))
    pair.late_ns = 5 * S
    asked = Move(epoch=pair.epoch, targets_rad=HOME)
    number = pair.tell(asked, "ann")
    pair.step(pair.now_ns + 5 * S)
    refusal = next(reply.refusal for reply in pair.replies if reply.request_id == number)
    assert refusal is not None and refusal.code is Code.LEASE_LOST and pair.engine.owner_id == "ann"
    pair.run(0.2)
    assert pair.engine.owner_id == "ann" and not pair.told(Code.LOSS_STAGE)
    pair.run(0.1)
    assert pair.told(Code.LOSS_STAGE) and not pair.moved()


def test_a_living_owner_is_not_lost_by_a_pause_of_ours() -> None:
    """Its keepalives were not read for 2 s; the motion is over, but it owns the robot and moves it again at once."""
    for ago_ms in (40, 1000, 1900):
        pair = scene("ACTIVE")
        pair.is_deaf = True  # what the robot said meanwhile is another matter
        pair.alive.discard("ann")
        pair.receive(ClientSeen(client_id="ann", at_ns=pair.now_ns + (2000 - ago_ms) * MS))
        late_tick(pair, 2000)
        pair.alive.add("ann")
        pair.run(0.1)
        assert pair.engine.owner_id == "ann" and not pair.told(Code.LOSS_STAGE)


TICKS = st.lists(st.sampled_from([0, 0, 0, 10, 19, 30, 49, 60, 100, 140, 145, 200, 600]), min_size=1, max_size=40)
"""How late tick after tick comes [ms]."""


@settings(max_examples=traces(40), suppress_health_check=list(HealthCheck), deadline=None)
@given(ticks=TICKS, queued=st.sets(st.integers(0, 39), max_size=6))
def test_in_any_schedule_of_ticks_nothing_moves_half_a_second_after_the_owners_last_sign_of_life(
    ticks: list[int], queued: set[int]
) -> None:
    """Arms and chassis, though commands of the vanished owner are read late, again and again."""
    pair = scene("at rest")
    last_ns = freeze_owner(pair)
    for number, late_ms in enumerate([*ticks, *[49] * 12]):
        if number in queued:
            pair.tell(Move(epoch=pair.epoch, targets_rad=HOME, speed=0.05), "ann")
            pair.tell(DriveChassis(epoch=pair.epoch, vx_mps=0.1, vy_mps=0.0, wz_radps=0.0, expiry_ns=3 * S), "ann")
        late_tick(pair, late_ms)
    for at_ns, frame in pair.frames:
        stands = frame.topic == CHASSIS_VELOCITY and not any(frame.values)
        assert frame.kind is not FrameKind.MOTION or stands or at_ns <= last_ns + 500 * MS, frame
