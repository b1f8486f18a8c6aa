"""The snapshot of an instant: everything the outside may see, with ages, and nothing where nothing is known."""

from __future__ import annotations

import pytest

from gateway.core.messages.events import SampleArrived, SettingsRead
from gateway.core.messages.sightings import ForeignData, Gateway, Means, Writer
from gateway.core.motion.motion import plan
from gateway.core.output.view import build
from gateway.core.robot_state.body_model import BodyModel
from gateway.core.robot_state.contact import Contacts
from gateway.core.supervision.supervisor import State
from gateway.errors import Code
from gateway.kinematics.description import nominal
from gateway.messages.incoming import OnLimit, OnLoss
from gateway.messages.snapshot import (
    ArmView,
    ChassisView,
    EnableView,
    Finding,
    GripView,
    GuardView,
    LiftView,
    LinkView,
    LoopView,
    ModelView,
    ModeView,
    MotorView,
    OthersView,
    OtherView,
    RefusalMessage,
    SlowingView,
    Snapshot,
)
from gateway.robot.topics import (
    CHASSIS_STATE,
    FSM_ENABLE,
    STATE_TOPICS,
    arm_state,
    ee_pose,
    gripper_state,
    joint_command,
)
from gateway.settings.settings import Settings
from gateway.values import ArmState, EePose, MotorState, Side
from tests.core.stage import GOAL, MIDDLE, MS, OFFSET_NS, PLACE, L, R, S, Stage
from tests.kinematics.dynamics.plants import Plant

LOOP = LoopView(ticks=8, skipped=1, late_ns=2, worst_late_ns=3)
ON = {"left": True, "right": True}


def look(stage: Stage, after_ns: int = 0, seq: int = 5) -> Snapshot:
    """What is seen a little later, without another sample."""
    return build(stage.coordinator, (), {}, LOOP, seq, stage.now_ns + after_ns, {})


def test_before_the_first_sample_nothing_is_known():
    """Ages are None, values are missing, streams are off: no number is made up."""
    stage = Stage(State.IDLE, owner=None, dumb={L, R})
    seen = look(stage)
    assert seen.arms["left"] == ArmView(
        measured=None, p_m=(), quat_xyzw=(), pose_age_ns=None, q_ref_rad=(), dq_ref_radps=(), streaming=False,
        tracking_rad=None, space="joint", ref_p_m=(), ref_quat_xyzw=(), ref_v_mps=(), ref_w_radps=(), tracking_m=None,
        model=None, contact=None, touch=None, guard_n=0.0,
    )  # fmt: skip
    assert (seen.grippers, seen.chassis) == ({"left": None, "right": None}, None)
    assert seen.link == LinkView(up=True, router_zid="aa", fresh=False, age_ns=None)
    assert seen.topics[arm_state(L)].age_ns is None
    assert (seen.motions, seen.targets, seen.enable) == (
        (),
        (),
        EnableView(attempt=0, outcome="none", code="", message=""),
    )


def test_a_snapshot_has_its_number_its_time_and_the_loops_figures():
    """They are given by who asks."""
    stage = Stage()
    seen = look(stage, seq=17)
    assert (seen.seq, seen.at_ns, seen.loop) == (17, stage.now_ns, LOOP)


@pytest.mark.parametrize(
    ("latches", "shown"),
    [({}, "ACTIVE"), ({Code.TRACKING_ERROR: "blocked"}, "FAULT"), ({Code.ESTOP: "by ann"}, "ESTOP")],
)
def test_latches_stand_beside_the_state(latches, shown):
    """A person reads FAULT or ESTOP; the state stays what it is (DESIGN §4)."""
    seen = look(Stage(State.ACTIVE, latches=latches))
    assert (seen.state, seen.shown) == ("ACTIVE", shown)
    assert seen.latches == {code.value: message for code, message in latches.items()}


def test_the_link_is_fresh_for_100_ms_and_shows_its_age():
    """At the bound it still is."""
    stage = Stage()
    assert look(stage, 100 * MS).link == LinkView(up=True, router_zid="aa", fresh=True, age_ns=100 * MS)
    assert look(stage, 101 * MS).link == LinkView(up=True, router_zid="aa", fresh=False, age_ns=101 * MS)


def test_without_a_transport_there_is_no_router_and_nothing_is_fresh():
    """Even in the instant after the last sample; the age goes on."""
    stage = Stage()
    stage.coordinator.transport_up = False
    assert look(stage, 5 * MS).link == LinkView(up=False, router_zid="", fresh=False, age_ns=5 * MS)


def test_mode_and_fsm_are_shown_until_they_are_too_old():
    """0.5 s and 3 s; then they are unknown, not the last value (BEHAVIOUR, values)."""
    stage = Stage()
    stage.say_mode(joint_mode={L: True, R: False}, arm_enabled={L: False, R: True}, lift_enabled=False)
    assert look(stage, 40 * MS).mode == ModeView(
        api=True,
        joint_mode={"left": True, "right": False},
        arm_enabled={"left": False, "right": True},
        chassis_enabled=True,
        lift_enabled=False,
        collision_check=False,
        age_ns=40 * MS,
    )
    assert [look(stage, age_ns).fsm for age_ns in (500 * MS, 501 * MS)] == [0, None]
    assert [look(stage, age_ns).mode is None for age_ns in (3 * S, 3 * S + 1)] == [False, True]


def test_the_lease_is_shown():
    """Who owns the robot, under which epoch."""
    lease = look(Stage()).lease
    assert (lease.owned, lease.name, lease.pid, lease.epoch) == (True, "ann", 7, 1)
    assert not look(Stage(State.READ_ONLY, owner=None)).lease.owned


def test_a_silent_arm_shows_what_is_measured_and_no_setpoint():
    """A reference that is not sent is no setpoint, and there is nothing to be away from."""
    stage = Stage()
    stage.run(1)
    arm = look(stage, 7 * MS).arms["right"]
    assert arm.measured == MotorView(
        q_rad=MIDDLE[R], dq_radps=(), tau_nm=(), stamp_ns=stage.now_ns + OFFSET_NS, age_ns=7 * MS
    )
    assert (arm.streaming, arm.q_ref_rad, arm.dq_ref_radps, arm.tracking_rad) == (False, (), (), None)


def test_a_streaming_arm_shows_its_setpoint_and_how_far_the_arm_is_off():
    """The largest joint distance; each arm its own."""
    stage = Stage(State.ACTIVE)
    stage.push(L, 0.12)
    left = stage.coordinator.body.arms[L]
    left.follow_path(plan({L: left.reference}, {L: GOAL[L]})[L], stage.epoch)
    stage.run(20)
    arms = look(stage).arms
    assert (arms["left"].streaming, arms["left"].q_ref_rad) == (True, left.reference.values)
    assert arms["left"].dq_ref_radps == left.reference.rates != (0.0,) * 7
    assert arms["left"].tracking_rad == left.distance(stage.q_rad[L]).rad > 0.0
    assert arms["right"].tracking_rad == 0.0


def test_an_arm_that_streams_unmeasured_has_no_tracking_error():
    """The distance to an arm that was never heard is unknown, not zero."""
    stage = Stage(dumb={R})
    stage.coordinator.body.arms[R].start(MIDDLE[R], stage.now_ns)
    arm = look(stage).arms["right"]
    assert (arm.streaming, arm.measured, arm.tracking_rad) == (True, None, None)


def test_poses_are_shown_with_their_age():
    """In the arm's own shoulder frame (manual §4.0.2)."""
    stage = Stage()
    pose = EePose(p_m=(0.1, 0.2, 0.3), quat_xyzw=(0.0, 0.0, 0.0, 1.0))
    stage.coordinator.store.receive(SampleArrived(topic=ee_pose(L), value=pose, received_ns=stage.now_ns), stage.now_ns)
    seen = look(stage, 9 * MS).arms
    assert (seen["left"].p_m, seen["left"].quat_xyzw, seen["left"].pose_age_ns) == (pose.p_m, pose.quat_xyzw, 9 * MS)
    assert (seen["right"].p_m, seen["right"].pose_age_ns) == ((), None)


@pytest.mark.parametrize("topic", [gripper_state(L), gripper_state(R), CHASSIS_STATE])
def test_grippers_and_chassis_are_shown_as_measured(topic):
    """Each where it belongs, with its age; nothing is said about the others."""
    stage = Stage()
    state = MotorState(q_rad=(0.4,), dq_radps=(0.1,), tau_nm=(2.0,), stamp_ns=12)
    stage.coordinator.store.receive(SampleArrived(topic=topic, value=state, received_ns=stage.now_ns), stage.now_ns)
    seen = look(stage, 3 * MS)
    shown = {gripper_state(side): seen.grippers[side.value] for side in Side}
    shown[CHASSIS_STATE] = seen.chassis
    expected = MotorView(q_rad=(0.4,), dq_radps=(0.1,), tau_nm=(2.0,), stamp_ns=12, age_ns=3 * MS)
    assert shown.pop(topic) == expected and set(shown.values()) == {None}


@pytest.mark.parametrize("model", ["standard", "lift"])
def test_every_topic_and_every_stream_of_the_model_is_shown(model):
    """No more and no less than the robot has."""
    stage = Stage(State.ACTIVE, model=model)
    stage.coordinator.body.arms[L].log.note(stage.now_ns)
    seen = look(stage)
    assert tuple(seen.topics) == STATE_TOPICS
    assert list(seen.streams) == [stream.topic for stream in stage.coordinator.body.streams]
    assert [seen.streams[joint_command(side)].sent for side in (L, R)] == [1, 0]
    assert seen.topics[arm_state(L)].count == 35 and seen.topics[CHASSIS_STATE].count == 0


def test_motions_and_streams_of_targets_are_shown():
    """As their books have them."""
    stage = Stage(State.ACTIVE)
    body = stage.coordinator.body
    body.motions.open({L: GOAL[L]}, None, S)
    body.targets.open(R, "ann", stage.epoch, 1.0, OnLimit.REJECT, None)
    seen = look(stage)
    assert [view.sides for view in seen.motions] == [("left",)] and seen.motions == body.motions.views()
    assert [view.side for view in seen.targets] == ["right"] and seen.targets == body.targets.views()


@pytest.mark.parametrize("code", [None, Code.FSM_BUSY])
def test_the_latest_enable_tells_how_it_went(code):
    """Which attempt, and why it failed."""
    stage = Stage(State.ENABLING)
    if code is not None:
        stage.coordinator.enable.blame(code, "somebody else enables")
        stage.coordinator.go(State.IDLE, stage.now_ns, "test")
    expected = ("running", "", "") if code is None else ("failed", "FSM_BUSY", "somebody else enables")
    enable = look(stage).enable
    assert (enable.attempt, enable.outcome, enable.code, enable.message) == (1, *expected)


def test_a_snapshot_is_a_picture_not_a_window():
    """What happens afterwards does not change it."""
    stage = Stage(State.ACTIVE)
    before, twin = look(stage), look(stage)
    stage.push(L, 0.2)
    stage.coordinator.latch(Code.ESTOP, "by ann", stage.now_ns)
    stage.coordinator.go(State.IDLE, stage.now_ns, "test")
    after = look(stage)
    assert before == twin
    assert {name for name in Snapshot.__struct_fields__ if getattr(before, name) != getattr(after, name)} >= {
        "state", "shown", "latches", "arms", "topics", "at_ns",
    }  # fmt: skip


def test_the_guard_is_shown():
    """Whether there shall be one, which one, and whether it reaches the robot."""
    stage = Stage(State.IDLE)
    guard = stage.coordinator.guard
    guard.pid, guard.is_linked, guard.lost, guard.earlier_holds = 41, True, 2, True
    assert look(stage).guard == GuardView(expected=True, pid=41, linked=True, lost=2, earlier_holds=True)


@pytest.mark.parametrize("model", ["standard", "lift"])
def test_chassis_and_lift_show_what_they_are_told(model):
    """Wanted, commanded, what is left of it, and why it ended; a model without a lift shows none."""
    stage = Stage(State.IDLE, model=model)
    seen = look(stage)
    assert seen.drive == ChassisView(
        driven=False, drive_id=0, code="", wanted_mps=(0.0, 0.0), wanted_radps=0.0, commanded_mps=(0.0, 0.0),
        commanded_radps=0.0, left_ns=None,
    )  # fmt: skip
    body = stage.coordinator.body
    body.chassis.drive((0.2, 0.0, -0.1), epoch=1, expires_ns=stage.now_ns + S, now_ns=stage.now_ns)
    stage.run(1)
    seen = look(stage)
    assert (seen.drive.driven, seen.drive.drive_id, seen.drive.left_ns) == (True, 1, S - 10 * MS)
    assert (seen.drive.wanted_mps, seen.drive.wanted_radps) == ((0.2, 0.0), -0.1)
    assert 0.0 < seen.drive.commanded_mps[0] < 0.2 and -0.1 < seen.drive.commanded_radps < 0.0
    body.ground_cut(Code.CLIENT_LOST, stage.now_ns)
    assert (look(stage).drive.driven, look(stage).drive.code) == (False, "CLIENT_LOST")
    if body.lift is None:
        assert seen.lift is None
        return
    body.lift.drive(-0.5, epoch=1, expires_ns=stage.now_ns + S, now_ns=stage.now_ns)
    assert look(stage).lift == LiftView(driven=True, drive_id=1, code="", velocity_ratio=-0.5, servo_on=True, left_ns=S)
    stage.run(1)
    body.ground_cut(Code.STOPPED, stage.now_ns)
    assert look(stage).lift == LiftView(
        driven=False, drive_id=1, code="STOPPED", velocity_ratio=0.0, servo_on=True, left_ns=None
    )


def test_others_are_shown_with_what_is_known_of_them():
    """Data with its count and last arrival, announcements with their means, gateways armed or not; and who we are."""
    stage = Stage()
    assert look(stage).others == OthersView(zid="", armed=True, seen=())
    others, at_ns = stage.coordinator.others, stage.now_ns
    others.own_zid = "a1"
    others.see_data(ForeignData(topic=FSM_ENABLE, zid="b", at_ns=at_ns, count=2, link="tcp/x"))
    others.see_writers([Writer(topic=FSM_ENABLE, zid="c", means=Means.PUBLISHER)], at_ns)
    others.see_gateways([Gateway(zid="d", is_armed=True, link="tcp/y")], at_ns)
    seen = look(stage).others
    nothing = {"last_ns": None, "count": 0, "armed": False, "link": ""}
    assert (seen.zid, seen.armed) == ("a1", True)
    assert seen.seen == (
        OtherView(
            kind="data", topic=FSM_ENABLE, zid="b", link="tcp/x", since_ns=at_ns, last_ns=at_ns, count=2,
            armed=False,
        ),
        OtherView(**{**nothing, "kind": "publisher", "topic": FSM_ENABLE, "zid": "c", "since_ns": at_ns}),
        OtherView(
            **{**nothing, "kind": "gateway", "topic": "", "zid": "d", "since_ns": at_ns, "armed": True, "link": "tcp/y"}
        ),
    )  # fmt: skip


def test_grippers_show_what_they_are_told():
    """Input, its torque, and the estimate; nothing while their arm is not streamed."""
    stage = Stage(State.ACTIVE, sides=(L,))
    for gripper in stage.coordinator.body.grippers.values():
        gripper.enter(0.55, stage.now_ns)
    stage.coordinator.body.grippers[L].is_holding = True
    assert look(stage).grips == {
        "left": GripView(streaming=True, input_ratio=0.55, torque_nm=-0.8, holding=True),
        "right": GripView(streaming=False, input_ratio=None, torque_nm=None, holding=None),
    }


def test_a_streaming_end_effector_shows_its_setpoint_and_how_far_the_arm_is_off():
    """Position and orientation, their velocities, and the distance in both; no joints are made up."""
    stage = Stage(State.ACTIVE, poses=(R,))
    stage.shift(R, 0.02)
    arms = look(stage).arms
    right = arms["right"]
    assert (right.space, right.streaming, right.q_ref_rad, right.dq_ref_radps) == ("pose", True, (), ())
    assert (right.ref_p_m, right.ref_quat_xyzw) == (PLACE[R][:3], PLACE[R][3:])
    assert (right.ref_v_mps, right.ref_w_radps) == ((0.0,) * 3, (0.0,) * 3)
    assert (right.tracking_m, right.tracking_rad) == (pytest.approx(0.02), pytest.approx(0.0))
    assert (arms["left"].space, arms["left"].tracking_m) == ("joint", None)


def test_what_is_known_of_the_body_model_is_shown_for_each_arm():
    """Verdict, figures and reason as the model has them; nothing where there is none."""
    stage = Stage(State.IDLE, poses={L, R})
    assert look(stage).arms["left"].model is None
    stage.coordinator.model = model = BodyModel(nominal(), Settings())
    assert look(stage).arms["left"].model == ModelView(
        state="unknown",
        reason="no joints and pose of one instant have arrived",
        pairs=0,
        position_m=None,
        angle_rad=None,
        lag_ns=0,
    )
    pose = EePose(p_m=PLACE[L][:3], quat_xyzw=PLACE[L][3:])
    state = ArmState(q_rad=MIDDLE[L], dq_radps=(), tau_nm=(), stamp_ns=0)
    for _ in range(60):
        stage.now_ns += 50 * MS
        for topic, value in ((ee_pose(L), pose), (arm_state(L), state)):
            model.hear(SampleArrived(topic=topic, value=value, received_ns=stage.now_ns), stage.now_ns)
    seen = {side: arm.model for side, arm in look(stage).arms.items()}
    verdict = model.verdict(L, stage.now_ns)
    assert (seen["left"].state, seen["left"].reason, seen["left"].pairs) == ("differs", verdict.reason, 60)
    assert (seen["left"].position_m, seen["left"].angle_rad) == (verdict.position_m, verdict.angle_rad)
    assert seen["right"].state == "unknown"


def test_what_pulls_at_an_arm_is_shown_where_it_is_estimated():
    """Or why it is not known; nothing at all where nobody asked for dynamics."""
    stage = Stage(State.IDLE)
    stage.coordinator.model = model = BodyModel(nominal(), Settings())
    assert look(stage).arms["left"].contact is None
    model.contacts = Contacts({side: Plant() for side in Side}, model.refusal)
    seen = look(stage).arms["left"].contact
    assert (seen.state, seen.code, seen.torque_nm, seen.wrench) == ("unknown", "PART_STALE", (), ())


def test_what_others_have_found_is_shown_as_they_say_it():
    """Findings, refusals, and how fast poses are followed."""
    stage = Stage(State.IDLE)
    finding = Finding(code="MODE_VR", message="it is", hint="", since_ns=1, facts={})
    refusals = {"chassis": RefusalMessage(code="NOT_OWNER", message="you do not own the robot")}
    slowing = SlowingView(on=True, why="", speed_ratio=0.5, held=True, joint=4, joint_radps=6.0, bound_radps=3.0)
    stage.coordinator.body.slowing[R] = slowing
    seen = build(stage.coordinator, (finding,), refusals, LOOP, 5, stage.now_ns, {"NOT_OWNER": 2})
    assert (
        seen.findings == (finding,)
        and seen.refusals == refusals
        and seen.refused == {"NOT_OWNER": 2}
        and seen.slowing["right"] == slowing
    )


def test_a_stop_endpoint_is_shown_with_its_age():
    """As of the instant of the snapshot."""
    stage = Stage(State.IDLE)
    stage.coordinator.endpoints.register("ann", "page", S, OnLoss.PAUSE, stage.now_ns)
    (seen,) = look(stage, after_ns=30 * MS).endpoints
    assert (seen.name, seen.timeout_ns, seen.on_silence, seen.age_ns) == ("page", S, "pause", 30 * MS)


def test_the_latest_reading_of_the_settings_is_shown():
    """When, and why nothing of it was taken; nothing before the first one."""
    stage = Stage(State.IDLE)
    assert (look(stage).settings_read_ns, look(stage).settings_refused) == (0, "")
    stage.coordinator.reading = SettingsRead(values={}, message="arm.v_radps = 0.5", at_ns=7)
    assert (look(stage).settings_read_ns, look(stage).settings_refused) == (7, "")
    stage.coordinator.reading = SettingsRead(values={}, message="it is no file", at_ns=8, is_refused=True)
    assert (look(stage).settings_read_ns, look(stage).settings_refused) == (8, "it is no file")
