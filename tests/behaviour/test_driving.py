"""BEHAVIOUR, chassis and lift: driven by the owner, and stopped on every way out."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise, product

import pytest

from gateway.core.messages.events import ExitRequested, Suspended
from gateway.core.messages.outputs import FrameKind
from gateway.core.messages.sightings import Gateway, GatewayTokens
from gateway.errors import Code
from gateway.messages.incoming import OnLoss
from gateway.messages.requests import (
    Abandon,
    Acquire,
    DisableLift,
    DriveChassis,
    DriveLift,
    Enable,
    Estop,
    Move,
    Release,
    SetGripper,
    Stop,
    StopChassis,
    StopLift,
    Take,
)
from gateway.robot.topics import CHASSIS_VELOCITY, CURRENT_MODE, FSM_STATE, LIFT_COMMAND, joint_command
from gateway.settings.settings import LossSettings
from gateway.values import Side
from tests.behaviour.scene import HOME, QUICK, REACHED_BY, Scene, scene
from tests.pair import MS, S
from tests.thoroughness import IS_THOROUGH, crossed

ZEROS, STOPPED, OFF = (0.0, 0.0, 0.0), (0.0, 1.0), (0.0, 0.0)
FAST = (0.25, 0.0, -0.3)
WHEELS, LIFT = CHASSIS_VELOCITY, LIFT_COMMAND
DRIVEN_IN = ("IDLE", "ENABLING", "at rest", "ACTIVE", "HOLDING")


def drive(pair: Scene, velocity: tuple[float, float, float] = FAST, **how: object) -> DriveChassis:
    """A velocity of the chassis, asked for by ann."""
    vx, vy, wz = velocity
    return DriveChassis(epoch=pair.epoch, vx_mps=vx, vy_mps=vy, wz_radps=wz, **how)


def lift(pair: Scene, velocity: float = 0.3, **how: object) -> DriveLift:
    """A velocity of the lift, asked for by ann."""
    return DriveLift(epoch=pair.epoch, velocity=velocity, **how)


def keep_driving(pair: Scene, seconds: float, drive_id: int = 0) -> None:
    """Drive both for a while as a client does, ten times a second."""
    for _ in range(round(seconds * 10)):
        pair.granted(drive(pair, drive_id=drive_id), "ann")
        if pair.robot.lift is not None:
            pair.granted(lift(pair), "ann")
        pair.run(0.09)


def driving(state: str = "IDLE", model: str = "lift", loss: LossSettings | None = None) -> Scene:
    """A robot that ann drives at speed, marked."""
    pair = scene(state, Scene(model=model, loss=loss))
    keep_driving(pair, 1.2 if state in {"IDLE", "at rest", "HOLDING"} else 0.4)
    pair.mark()
    return pair


def zeros_for_a_second(pair: Scene, *, within_ms: int = 10) -> None:
    """Zeros at once, nothing but zeros, first and last a second apart or more, then silence; the robot stands."""
    pair.run(1.5)
    sent = [(at_ns, frame) for at_ns, frame in pair.frames if frame.topic == WHEELS and at_ns >= pair.mark_ns]
    assert sent and sent[0][0] - pair.mark_ns <= within_ms * MS, "no zeros at once"
    assert {frame.values for _, frame in sent} == {ZEROS} and sent[-1][0] - sent[0][0] >= 1 * S
    assert WHEELS not in pair.engine.running_topics and not any(pair.robot.chassis.velocity)


# ------------------------------------------------------------------------------------------------ driving


@pytest.mark.parametrize("state", DRIVEN_IN)
def test_the_chassis_follows_what_it_is_told_at_every_moment(state: str) -> None:
    """Inside the robot's ramps of 0.3 and 0.6, jerk-limited: robot and command never differ by more than a frame's step."""
    pair = scene(state)
    worst = 0.0
    for n in range(24):
        velocity = FAST if n < 16 else (-0.1, 0.1, 0.0)
        if pair.state not in {"IDLE", "ENABLING", "ACTIVE", "HOLDING"}:
            break
        pair.granted(drive(pair, velocity), "ann")
        for _ in range(9):
            pair.step()
            told = pair.values(WHEELS)[-1]
            worst = max(worst, *(abs(a - b) for a, b in zip(told, pair.robot.chassis.velocity, strict=True)))
    assert worst <= 0.6 * 0.05 + 1e-6
    values = [ZEROS, *pair.values(WHEELS)]
    for before, after in pairwise(values):
        for a, b in zip(before, after, strict=True):
            bound = 0.3 if abs(b) > abs(a) and a * b >= 0 else 0.6
            assert abs(b - a) <= bound * 0.05 + 1e-6
    assert all(len(value) == 3 for value in values)


def test_chassis_and_lift_need_no_enabled_arms() -> None:
    """In IDLE nothing goes to the arms and no heartbeat leaves; both drive (manual §4.5, §4.6)."""
    pair = driving()
    keep_driving(pair, 0.5)
    assert pair.state == "IDLE" and pair.arm_frames() == [] and pair.beats == []
    assert pair.robot.chassis.velocity[0] > 0.2 and pair.robot.lift.lowered_m < 0.29
    assert set(pair.values(LIFT)) == {(0.3, 1.0)}


def test_the_chassis_drives_while_the_arms_are_enabled_and_move() -> None:
    """One does not wait for the other; ENABLING leaves a drive alone."""
    pair = driving()
    pair.granted(Enable(epoch=pair.epoch), "ann")
    for _ in range(100):
        if pair.state == "ACTIVE":
            break
        pair.granted(drive(pair), "ann")
        pair.run(0.05)
    pair.granted(Move(epoch=pair.epoch, targets_rad=HOME), "ann")
    keep_driving(pair, 0.5)
    assert pair.state == "ACTIVE" and pair.moved()
    assert FrameKind.STOP not in {frame.kind for _, frame in pair.sent_on(WHEELS, pair.mark_ns)}


def test_bounds_of_speed_are_refused_and_tell_the_bound() -> None:
    """0.3 m/s over the ground and 0.5 rad/s unless configured otherwise (BEHAVIOUR, values)."""
    pair = scene("IDLE")
    for velocity, bound in (((0.22, 0.22, 0.0), "0.3"), ((0.0, 0.0, 0.6), "0.5")):
        refusal = pair.refused(drive(pair, velocity), "ann")
        assert refusal.code is Code.OUT_OF_RANGE and bound in refusal.bound
    pair.run(0.2)
    assert pair.values(WHEELS) == []


def test_a_velocity_expires_and_the_chassis_comes_to_rest_on_its_ramp() -> None:
    """0.3 s after the last command; then zeros for a second, then silence."""
    pair = driving(model="standard")
    pair.run(1.5)
    sent = pair.sent_on(WHEELS, pair.mark_ns)
    zeros = [at_ns for at_ns, frame in sent if frame.kind is FrameKind.STOP]
    full = [at_ns for at_ns, frame in sent if frame.values == FAST]
    assert 150 * MS <= full[-1] - pair.mark_ns <= 310 * MS and 500 * MS <= zeros[0] - full[-1] <= 900 * MS
    pair.run(1.5)
    assert pair.sent_on(WHEELS, pair.mark_ns)[-1][1].values == ZEROS and WHEELS not in pair.engine.running_topics
    assert pair.told(Code.TARGET_EXPIRED) == ["no velocity came in time: the chassis ramps down"]


def test_the_lift_stops_when_its_velocity_expires_and_stays_on() -> None:
    """[0,1] for as long as somebody owns the robot: the robot would take the servo off after 3 s of silence."""
    pair = driving()
    pair.run(20.0)
    assert pair.values(LIFT)[-1] == STOPPED and pair.robot.lift.is_powered and pair.robot.lift.motor_radps == 0.0
    assert pair.gap_ms(LIFT) <= 60


def test_disabling_the_lift_takes_its_servo_off() -> None:
    """[0,1], then [0,0]; another velocity takes it on again."""
    pair = driving()
    pair.granted(DisableLift(epoch=pair.epoch), "ann")
    pair.run(1.5)
    assert pair.values(LIFT)[-1] == OFF and not pair.robot.lift.is_powered
    pair.granted(lift(pair), "ann")
    pair.run(0.1)
    assert pair.robot.lift.is_powered


@pytest.mark.parametrize("model", ["lite", "standard"])
def test_a_model_without_a_lift_refuses_its_commands(model: str) -> None:
    """With a code of its own; no frame leaves (manual §1.2)."""
    pair = scene("IDLE", Scene(model=model))
    assert pair.refused(lift(pair), "ann").code is Code.NO_LIFT
    pair.run(0.2)
    assert pair.values(LIFT) == []


@pytest.mark.parametrize(
    ("part", "request_of", "code"),
    [("chassis", drive, Code.CHASSIS_DISABLED), ("lift", lift, Code.LIFT_DISABLED)],
)
def test_a_part_that_is_switched_off_is_refused_and_stops(
    part: str, request_of: Callable[..., object], code: Code
) -> None:
    """As `/api/current_mode` says (manual §4.11.2): before it is driven, and while it is."""
    pair = driving()
    if part == "chassis":
        pair.robot.chassis.is_enabled = False
    else:
        pair.robot.lift.is_configured = False
    pair.tell_mode(**{f"{part}_enabled": False})
    pair.step()
    topic, stop = (WHEELS, ZEROS) if part == "chassis" else (LIFT, STOPPED)
    assert set(pair.values(topic)) <= {stop} and len(pair.told(code)) == 1
    assert pair.refused(request_of(pair), "ann").code is code


def test_an_unknown_mode_stops_the_driving_and_refuses_it() -> None:
    """MODE_UNKNOWN: new motion refused, on wheels, too."""
    pair = driving()
    pair.topics = tuple(topic for topic in pair.topics if topic != CURRENT_MODE)
    for _ in range(60):
        if pair.ask(drive(pair), "ann").refusal is not None:
            break
        pair.run(0.09)
    pair.run(0.1)
    assert pair.refused(drive(pair), "ann").code is Code.MODE_UNKNOWN and pair.values(WHEELS)[-1] == ZEROS


def test_the_lift_does_not_drive_against_an_fsm_in_error() -> None:
    """The robot stops it by itself (manual §4.6); in IDLE this is a condition, no latch. The chassis needs no FSM."""
    pair = driving()
    pair.robot.inject({"fault": "fsm_error"}, pair.now_ns)
    pair.run_until(lambda: pair.heard[FSM_STATE].value == -1)
    pair.run(0.05)
    assert pair.refused(lift(pair), "ann").code is Code.FSM_ERROR and pair.engine.latches == {}
    assert pair.values(LIFT)[-1] == STOPPED and pair.told(Code.FSM_ERROR)
    pair.granted(drive(pair), "ann")


@pytest.mark.parametrize(("value", "state"), crossed([3, 6, 9], ["IDLE", "at rest"]))
def test_nothing_drives_beside_vr_or_playback(value: int, state: str) -> None:
    """FSM 3-6 or unknown in API mode: zeros, lift stop and then silence, FSM_BUSY; no 0.0 (BEHAVIOUR, VR mode, FSM 3-6)."""
    pair = driving(state)
    pair.robot.inject({"fault": "fsm_value", "value": value}, pair.now_ns)
    pair.run_until(lambda: pair.heard[FSM_STATE].value == value)
    for request in (drive(pair), lift(pair)):
        assert pair.refused(request, "ann").code is Code.FSM_BUSY
    pair.mark()
    pair.run(2.5)
    assert set(pair.values(WHEELS)) == {ZEROS} and set(pair.values(LIFT)) == {STOPPED} and pair.beats == []
    assert not {WHEELS, LIFT} & set(pair.engine.running_topics) and not any(pair.robot.chassis.velocity)


# ------------------------------------------------------------------------------------------------ every way out


def _lost(pair: Scene) -> None:
    pair.kill("ann")
    pair.step()


def _silent(pair: Scene) -> None:
    """The client freezes: no keepalive, no velocity; the token stays."""
    pair.alive.discard("ann")


def _pausing(pair: Scene) -> None:
    pair.granted(Acquire(name="ann", pid=42, on_loss=OnLoss.PAUSE), "ann")
    pair.mark()
    _lost(pair)


def _deaf(pair: Scene) -> None:
    pair.is_deaf = True
    pair.run_until(lambda: pair.state == "STALE")
    pair.mark_ns = pair.now_ns


def _vr(pair: Scene) -> None:
    pair.robot.inject({"fault": "vr_mode"}, pair.now_ns)
    pair.tell_mode(api=False)
    pair.step()


ENDS: dict[str, Callable[[Scene], object]] = {
    "release": lambda pair: pair.granted(Release(epoch=pair.epoch), "ann"),
    "abandon": lambda pair: pair.granted(Abandon(epoch=pair.epoch), "ann"),
    "client lost": _lost,
    "client lost, pause": _pausing,
    "take": lambda pair: pair.granted(Take(name="bob", pid=2, reason="test"), "bob"),
    "owner's stop": lambda pair: pair.granted(Stop(), "ann"),
    "other's stop": lambda pair: pair.granted(Stop(), "bob"),
    "estop": lambda pair: pair.granted(Estop(), "bob"),
    "chassis stop": lambda pair: pair.granted(StopChassis(epoch=pair.epoch), "ann"),
    "stale": _deaf,
    "vr": _vr,
    "SIGTERM": lambda pair: (pair.receive(ExitRequested(at_ns=0)), pair.step()),
    "suspend": lambda pair: (pair.receive(Suspended(slept_ns=S, at_ns=0)), pair.step()),
}
"""Ways in which a drive ends at once."""


@pytest.mark.parametrize(("end", "state"), crossed(ENDS, ["IDLE", "at rest", "HOLDING"]))
def test_zeros_leave_at_once_and_for_a_second_on_every_way_out(end: str, state: str) -> None:
    """Whatever ends the use of the chassis, in every state in which it may be driven (DESIGN §8.8)."""
    pair = driving(state, model="standard")
    assert pair.robot.chassis.velocity[0] > 0.2
    ENDS[end](pair)
    zeros_for_a_second(pair)
    assert Code.GATE_VIOLATION not in pair.engine.latches


@pytest.mark.parametrize("state", ["IDLE", "at rest"])
@pytest.mark.parametrize("end", ["chassis stop", "owner's stop", "late tick"])
def test_a_stop_leaves_before_a_drive_that_is_asked_for_in_the_same_tick(end: str, state: str) -> None:
    """Two threads of an owner, or a request that waited out a pause of ours: zeros at once, then from rest; no fault."""
    pair = driving(state, model="standard")
    if end == "late tick":
        pair.late_ns = 200 * MS
        pair.now_ns += 190 * MS
    else:
        pair.tell(StopChassis(epoch=pair.epoch) if end == "chassis stop" else Stop(), "ann")
    pair.now_ns += 1
    pair.tell(drive(pair), "ann")
    pair.mark()
    pair.run(0.25)
    first, second, *_ = pair.values(WHEELS)
    assert (
        first == ZEROS
        and 0.0 < second[0] <= 0.3 * 0.05
        and pair.sent_on(WHEELS, pair.mark_ns)[0][0] <= pair.mark_ns + 10 * MS
    )
    assert pair.engine.latches == {} and pair.state in {"IDLE", "HOLDING", "ACTIVE"}


def test_no_two_requests_of_one_tick_are_a_fault() -> None:
    """An owner with two threads may ask for anything in any order: what leaves keeps to the ramps, and nothing is latched."""
    pair = driving("at rest")
    asked = (
        lambda: drive(pair),
        lambda: drive(pair, (-0.2, 0.1, 0.4)),
        lambda: StopChassis(epoch=pair.epoch),
        lambda: lift(pair, -0.5),
        lambda: StopLift(epoch=pair.epoch),
        lambda: DisableLift(epoch=pair.epoch),
        lambda: SetGripper(epoch=pair.epoch, side=Side.LEFT, raw=0.8),
        Stop,
    )
    for first, second in product(asked, repeat=2):
        keep_driving(pair, 0.3)
        for request_of in (first, second):
            pair.now_ns += 1
            pair.tell(request_of(), "ann")
        pair.run(0.12)
        assert pair.engine.latches == {}, (first(), second())
    assert pair.state in {"ACTIVE", "HOLDING"} and not any(
        pair.told(code) for code in (Code.GATE_VIOLATION, Code.INTERNAL)
    )


@pytest.mark.parametrize("end", ["owner's stop", "client lost", "stale"])
def test_a_drive_that_was_ended_is_not_gone_on_with(end: str) -> None:
    """Keeping a drive alive does not undo a stop or a loss: the next velocity of the same drive is refused with it."""
    pair = scene("at rest")
    drive_id = pair.granted(drive(pair), "ann")["drive_id"]
    assert pair.granted(drive(pair, drive_id=drive_id), "ann") == {"drive_id": drive_id}
    ENDS[end](pair)
    pair.is_deaf = False
    pair.alive.add("ann")
    pair.run(2.0)
    refusal = pair.refused(drive(pair, drive_id=drive_id), "ann")
    expected = {"owner's stop": Code.STOPPED, "client lost": Code.CLIENT_LOST, "stale": Code.STATE_STALE}
    assert refusal.code is expected[end]
    pair.granted(drive(pair), "ann")


def test_a_drive_that_is_asked_for_in_the_tick_of_a_stop_begins_from_rest() -> None:
    """The stop is heard by the robot, then the ramp begins anew: nothing jumps, and nothing is latched."""
    pair = driving()
    for request in (StopChassis(epoch=pair.epoch), drive(pair), StopLift(epoch=pair.epoch), lift(pair)):
        pair.tell(request, "ann")
    pair.run(0.2)
    assert not pair.engine.latches
    for topic, stop in ((WHEELS, ZEROS), (LIFT, STOPPED)):
        first, *rest = [frame for _, frame in pair.sent_on(topic, pair.mark_ns)]
        assert (first.values, first.kind) == (stop, FrameKind.STOP)
        assert rest and all(frame.kind is FrameKind.MOTION for frame in rest)
    speeds = [0.0, *(frame.values[0] for _, frame in pair.sent_on(WHEELS, pair.mark_ns))]
    assert all(0.0 <= after - before <= 0.3 * 0.05 + 1e-9 for before, after in pairwise(speeds))


def test_a_client_that_freezes_is_stopped_by_the_expiry_or_the_keepalive() -> None:
    """Keepalive 250 ms, expiry 300 ms: zeros, or the ramp down to them, within 350 ms."""
    pair = driving(model="standard")
    _silent(pair)
    begin_ns = pair.now_ns
    pair.run_until(lambda: pair.values(WHEELS)[-1:] == [ZEROS], 1.0)
    assert pair.now_ns - begin_ns <= 350 * MS
    pair.mark_ns = pair.now_ns
    zeros_for_a_second(pair)


def test_a_lost_transport_is_followed_by_zeros_when_it_is_back() -> None:
    """What may not have arrived is sent again for a full second; nothing goes on (invariant 7)."""
    pair = driving()
    pair.down()
    pair.run(0.4)
    pair.up()
    pair.mark()
    pair.run(3.0)
    values = pair.values(WHEELS)
    assert set(values) == {ZEROS} and len(values) >= 20 and not any(pair.robot.chassis.velocity)
    assert set(pair.values(LIFT)) == {OFF} and not pair.robot.lift.is_powered
    assert pair.owner == "ann" and WHEELS not in pair.engine.running_topics


@pytest.mark.parametrize(("outage_s", "topics"), [(0.9, {WHEELS, LIFT}), (1.5, {LIFT}), (60.0, set())])
def test_what_the_robot_has_ended_itself_in_an_outage_is_not_ended_again(outage_s: float, topics: set[str]) -> None:
    """1 s after the last velocity, 3 s after the lift's (manual §4.5, §4.6), what stands there may be somebody else's drive."""
    pair = driving()
    pair.down()
    pair.run(outage_s)
    pair.up()
    pair.mark()
    pair.receive(GatewayTokens(gateways=(Gateway(zid="b", is_armed=True),), at_ns=pair.now_ns))
    pair.run(3.0)
    assert {frame.topic for at_ns, frame in pair.frames if at_ns >= pair.mark_ns} == topics


def test_a_late_tick_ends_the_driving() -> None:
    """A gap of 200 ms: what the robot did meanwhile is not known, so that no velocity of before it goes on."""
    pair = driving(model="standard")
    pair.late_ns = 200 * MS
    pair.step(pair.now_ns + 200 * MS)
    pair.mark_ns = pair.now_ns
    zeros_for_a_second(pair)


@pytest.mark.parametrize(
    ("end", "state"), crossed(["release", "estop", "SIGTERM", "suspend"], ["IDLE", "at rest", "HOLDING"])
)
def test_the_lift_ends_with_the_servo_off(end: str, state: str) -> None:
    """[0,0] on release, estop, exit and when the lease is free; [0,1] before it (BEHAVIOUR, lift)."""
    pair = driving(state)
    ENDS[end](pair)
    pair.run(4.5)
    values = pair.values(LIFT)
    assert values[-1] == OFF and set(values[:-1]) == {STOPPED} and not pair.robot.lift.is_powered


def test_a_held_lift_stays_on_for_60_s_after_its_owner_is_lost() -> None:
    """[0,1] while it is held, whoever owns it; [0,0] when everything goes down."""
    pair = driving("at rest", loss=None if IS_THOROUGH else QUICK)
    _lost(pair)
    pair.run(59.0 if IS_THOROUGH else 2.9)
    assert pair.values(LIFT)[-1] == STOPPED and pair.owner is None and pair.state == "HOLDING"
    pair.run(3.0)
    assert pair.values(LIFT)[-1] == OFF and LIFT not in pair.engine.running_topics


def test_a_lift_in_idle_is_off_when_the_lease_of_its_lost_owner_is_free() -> None:
    """Nothing is held: 10 s after the loss."""
    pair = driving("IDLE")
    _lost(pair)
    pair.run(9.5)
    assert pair.values(LIFT)[-1] == STOPPED
    pair.run(1.5)
    assert pair.values(LIFT)[-1] == OFF


def test_an_unowned_lift_is_off_although_the_robot_is_not_heard_any_more() -> None:
    """The hold ended with the short stall, the lease 10 s after its owner: [0,0] does not wait for the robot's state."""
    pair = driving("at rest")
    pair.is_deaf = True
    pair.run(0.3)
    _lost(pair)
    pair.run(9.5)
    assert pair.values(LIFT)[-1] == STOPPED and pair.state == "STALE"
    pair.run(1.0)
    assert pair.owner is None and pair.values(LIFT)[-1] == OFF and LIFT not in pair.engine.running_topics


def test_in_vr_mode_the_lift_is_stopped_and_then_left_alone() -> None:
    """Its operator has it: no [0,0], and [0,1] for a second only (DESIGN §8.8)."""
    pair = driving()
    _vr(pair)
    pair.run(3.0)
    assert set(pair.values(LIFT)) == {STOPPED} and LIFT not in pair.engine.running_topics


@pytest.mark.parametrize("state", [state for state in REACHED_BY if state not in DRIVEN_IN])
def test_driving_is_refused_where_it_may_not_be(state: str) -> None:
    """With the state's own code, and no frame."""
    pair = scene(state, Scene(model="lift"))
    expected = {
        "READ_ONLY": Code.NOT_OWNER,
        "VR": Code.MODE_VR,
        "PAUSED": Code.ROBOT_PAUSED,
        "STOPPING": Code.STOPPING,
        "STALE": Code.STATE_STALE,
        "OFFLINE": Code.NO_LINK,
    }[state]
    for request in (drive(pair), lift(pair)):
        assert pair.refused(request, "ann").code is expected
    pair.run(0.1)
    assert pair.values(WHEELS) == pair.values(LIFT) == []


def test_fifty_velocities_a_second_delay_neither_a_stop_nor_a_setpoint() -> None:
    """A stop is answered in its tick; arms keep their 10 ms (api/inbox.py hands out at most four requests a tick)."""
    pair = scene("ACTIVE")
    for _ in range(25):
        pair.tell(drive(pair), "ann")
        pair.run(0.02)
    assert max(pair.gap_ms(joint_command(side)) for side in Side) <= 11
    pair.tell(drive(pair), "ann")
    pair.tell(Stop(), "ann")
    pair.step()
    assert pair.frames[-1][1].topic == WHEELS and pair.frames[-1][1].values == ZEROS
