"""What is seen becomes findings: each symptom with its code, its numbers and the time it began; told once; over in time."""

from __future__ import annotations

import math

import pytest

from gateway.codes import Code
from gateway.core.messages.events import SampleArrived, SampleRefused
from gateway.core.messages.sightings import ForeignData, Gateway
from gateway.core.motion.motion import plan
from gateway.core.others.other_robots import other_namespace, two_robots
from gateway.core.output.diagnosis import PERIOD_NS, Diagnosis
from gateway.core.robot_state.body_model import BodyModel
from gateway.core.supervision.supervisor import State
from gateway.kinematics.description import nominal
from gateway.messages.snapshot import Finding, SlowingView
from gateway.robot.topics import (
    CHASSIS_STATE,
    CURRENT_MODE,
    FSM_ENABLE,
    FSM_STATE,
    STATE_TOPICS,
    arm_state,
    ee_pose,
    gripper_state,
)
from gateway.settings.settings import Settings
from gateway.values import ArmState, EePose, FsmState, MotorState
from tests.changed import replace
from tests.core.stage import GOAL, MIDDLE, MODE, MS, OFFSET_NS, PLACE, TICK_NS, L, R, Stage

OTHERS = tuple(topic for topic in STATE_TOPICS if topic not in (*map(arm_state, (L, R)), FSM_STATE, CURRENT_MODE))


class Watched(Stage):
    """A stage on which every topic is heard, with a diagnosis that looks on every tick.

    Attributes:
        mute: Topics beside the stage's own that are not heard.
    """

    def __init__(self, *args, mute=(), **kwargs) -> None:
        self.mute = set(mute)
        self.diagnosis: Diagnosis | None = None
        super().__init__(*args, **kwargs)
        self.diagnosis = Diagnosis(self.coordinator)

    def hear(self) -> None:
        super().hear()
        for topic in OTHERS:
            if topic not in self.mute and topic not in map(ee_pose, self.poses):
                value = (
                    EePose(p_m=(0.3, 0.0, 0.0), quat_xyzw=(0.0, 0.0, 0.0, 1.0))
                    if topic.endswith("pose")
                    else MotorState(q_rad=(0.0,), dq_radps=(), tau_nm=(), stamp_ns=self.now_ns + OFFSET_NS)
                )
                self.coordinator.store.receive(
                    SampleArrived(topic=topic, value=value, received_ns=self.now_ns), self.now_ns
                )
        if self.diagnosis is not None:
            self.diagnosis.look(self.now_ns)

    def spend(self, ticks: int) -> None:
        """Let time pass; what is due leaves."""
        for _ in range(ticks):
            self.now_ns += TICK_NS
            self.hear()
            for stream in self.coordinator.body.streams:
                if stream.running and stream.frame(self.now_ns) is not None:
                    stream.log.note(self.now_ns)

    @property
    def findings(self) -> list[tuple[str, str]]:
        """Code and message of what stands."""
        return [(finding.code, finding.message) for finding in self.diagnosis.findings]

    @property
    def codes(self) -> list[str]:
        """Codes of what stands."""
        return [code for code, _ in self.findings]

    def only(self, code: Code) -> Finding:
        """Return the one finding, which must be of this code."""
        (found,) = self.diagnosis.findings
        assert found.code == code.value
        return found


def test_nothing_is_found_where_all_is_well():
    """Held arms, a live heartbeat, every topic heard: silence, for as long as it lasts."""
    stage = Watched(State.HOLDING)
    for _ in range(50):
        stage.spend(20)
        assert stage.findings == []


def test_it_looks_ten_times_a_second():
    """A second look in the same period does nothing."""
    stage = Watched()
    look = stage.diagnosis.look
    begin_ns = (stage.now_ns // PERIOD_NS + 1) * PERIOD_NS
    assert [look(begin_ns), look(begin_ns + 99 * MS), look(begin_ns + 100 * MS)] == [True, False, True]


def test_without_a_link_nothing_is_inferred_and_a_new_link_has_time():
    """What is known is old then; topics get 3 s to come again."""
    stage = Watched(State.IDLE)
    stage.say_mode(api=False)
    stage.spend(20)
    assert stage.codes == ["MODE_VR"]
    stage.coordinator.transport_up = False
    stage.spend(20)
    assert stage.codes == []
    stage.mode = MODE
    stage.dumb, stage.mute = {L, R}, set(OTHERS)
    stage.coordinator.store.reset()
    stage.coordinator.transport_up = True
    stage.spend(290)
    assert stage.codes == []
    stage.spend(50)
    assert "none of" in stage.only(Code.ROUTE_SUSPECT).message


def test_a_robot_under_another_namespace_explains_the_silence_of_everything():
    """One finding, without a notice of its own: the engine has told it. It is over when something is heard."""
    stage = Watched(State.IDLE)
    stage.dumb, stage.mute = {L, R}, set(OTHERS)
    stage.coordinator.other_robot = other_namespace(("bot1", "bot2"), "")
    stage.coordinator.store.reset()
    stage.spend(340)
    found = stage.only(Code.OTHER_NAMESPACE)
    assert "bot1" in found.message and "bot2" in found.message and "ta2 link" in found.hint
    assert not stage.told(Code.OTHER_NAMESPACE)
    stage.dumb, stage.mute = set(), set()
    stage.spend(20)
    assert "OTHER_NAMESPACE" not in stage.codes


def test_a_second_robot_that_would_obey_is_a_finding_although_all_is_heard():
    """Also of one that is silent: a silence of everything stays what it is then."""
    stage = Watched()
    stage.spend(20)
    stage.coordinator.other_robot = two_robots(("a1", "b2"), "")
    stage.spend(30)
    assert "a1, b2" in stage.only(Code.TWO_ROBOTS).message and not stage.told(Code.TWO_ROBOTS)
    stage.dumb, stage.mute = {L, R}, set(OTHERS)
    stage.spend(60)
    assert "ROUTE_SUSPECT" in stage.codes and "TWO_ROBOTS" in stage.codes
    stage.coordinator.other_robot = None
    stage.dumb, stage.mute = set(), set()
    stage.spend(30)
    assert stage.codes == []


# ------------------------------------------------------------------------------------------------------------- modes


def test_modes_are_findings():
    """VR mode hides what is disabled; a disabled arm is told per arm; an unknown mode says nothing here."""
    stage = Watched()
    stage.say_mode(arm_enabled={L: False, R: True})
    stage.spend(20)
    assert "left arm is disabled" in stage.only(Code.ARM_DISABLED).message
    stage.say_mode(arm_enabled={L: False, R: False})
    stage.spend(20)
    assert stage.codes == ["ARM_DISABLED", "ARM_DISABLED"]
    stage.say_mode(api=False, arm_enabled={L: False, R: True})
    stage.spend(20)
    begun_ns = stage.only(Code.MODE_VR).since_ns
    stage.spend(50)
    assert stage.only(Code.MODE_VR).since_ns == begun_ns <= stage.now_ns - 500 * MS
    stage.mode = None
    stage.spend(310)
    assert stage.codes == ["ROUTE_SUSPECT"]
    assert not stage.told(Code.MODE_VR) and len(stage.told(Code.ROUTE_SUSPECT)) == 1


def test_somebody_else_who_commands_the_robot_is_a_finding():
    """Who, on what, since when and how often; it ends with him. The notice is said where he is first seen, not here."""
    stage = Watched()
    stage.spend(20)
    others = stage.coordinator.others
    seen_ns = stage.now_ns
    others.see_data(ForeignData(topic=FSM_ENABLE, zid="b0b", at_ns=seen_ns, count=4, link="tcp/10.0.0.9:4711"))
    stage.spend(30)
    found = stage.only(Code.FOREIGN_WRITER)
    assert "zenoh session b0b at tcp/10.0.0.9:4711 sends commands on /api/fsm/enable that are not ours" in found.message
    assert (
        found.since_ns == seen_ns and found.facts == {"samples": 4} and "stop the robot's other commander" in found.hint
    )
    stage.spend(300)
    assert stage.codes == []
    others.see_gateways((Gateway(zid="9a", is_armed=True),), stage.now_ns)
    stage.spend(30)
    assert stage.only(Code.OTHER_GATEWAY).facts == {} and "another gateway" in stage.only(Code.OTHER_GATEWAY).message
    others.see_gateways((Gateway(zid="9a", is_armed=False),), stage.now_ns)
    stage.spend(30)
    assert stage.codes == [] and not stage.told(Code.FOREIGN_WRITER) and not stage.told(Code.OTHER_GATEWAY)


# ----------------------------------------------------------------------------------------------------------- silence


def test_a_silent_topic_is_told_with_what_is_known_of_its_route():
    """The others live; discovery's words stand in the message."""
    stage = Watched()
    stage.spend(30)
    stage.coordinator.routes[ee_pose(L)] = "route dead: the robot's bridge does not read it"
    stage.mute = {ee_pose(L), gripper_state(R)}
    stage.spend(50)
    assert stage.codes == ["ROUTE_SUSPECT"] * 2
    assert "(route dead" in stage.findings[0][1] and gripper_state(R) in stage.findings[1][1]
    assert all(0.3 < finding.facts["silent_s"] <= 0.5 for finding in stage.diagnosis.findings)
    assert stage.diagnosis.findings[0].since_ns == stage.now_ns - 500 * MS
    assert len(stage.told(Code.ROUTE_SUSPECT)) == 2
    stage.mute = set()
    stage.spend(20)
    assert stage.findings == []


def test_topics_of_disabled_parts_may_be_silent():
    """A disabled arm, its gripper and its pose, and a disabled chassis; what is enabled is missed; so is all while unknown."""
    stage = Watched()
    stage.spend(20)
    stage.mute, stage.dumb = set(OTHERS), {L}
    stage.mode = replace(MODE, arm_enabled={L: False, R: True}, chassis_enabled=False)
    stage.spend(60)
    about = [message.split()[0] for code, message in stage.findings if code == "ROUTE_SUSPECT"]
    assert about == [ee_pose(R), gripper_state(R)]
    stage.mode = None
    stage.spend(310)
    about = [message.split()[0] for code, message in stage.findings if code == "ROUTE_SUSPECT"]
    assert CHASSIS_STATE in about and arm_state(L) in about


def test_samples_that_come_and_are_not_believed_are_no_silence():
    """Why they are not is told instead."""
    stage = Watched(mute={gripper_state(L)})
    topic = gripper_state(L)
    for _ in range(320):
        stage.spend(1)
        stage.coordinator.store.receive(
            SampleRefused(
                topic=topic, code=Code.SAMPLE_REFUSED, message="position[0] is nan", received_ns=stage.now_ns
            ),
            stage.now_ns,
        )
    found = stage.only(Code.SAMPLE_REFUSED)
    assert topic in found.message and "position[0] is nan" in found.message


def test_a_late_look_says_nothing_about_ages():
    """After this process stood still everything seems old; what really is silent is told by the next look."""
    stage = Watched()
    stage.spend(30)
    for _ in range(2):
        stage.now_ns += 300 * MS
        assert stage.diagnosis.look(stage.now_ns) and stage.codes == []
    for _ in range(2):
        stage.now_ns += PERIOD_NS
        assert stage.diagnosis.look(stage.now_ns)
    assert set(stage.codes) == {"ROUTE_SUSPECT"}


def test_a_finding_that_comes_and_goes_is_told_again_only_after_a_while():
    """A flickering topic fills no log."""
    stage = Watched()
    stage.spend(30)
    for _ in range(4):
        stage.mute = {CHASSIS_STATE}
        stage.spend(60)
        stage.mute = set()
        stage.spend(60)
    assert len(stage.told(Code.ROUTE_SUSPECT)) == 1
    stage.spend(800)
    stage.mute = {CHASSIS_STATE}
    stage.spend(60)
    assert len(stage.told(Code.ROUTE_SUSPECT)) == 2


# --------------------------------------------------------------------------------------------------- the heartbeat


def test_a_route_that_is_said_to_be_bad_for_half_a_second_is_suspected():
    """What discovery says while it still looks is not told."""
    stage = Watched()
    stage.coordinator.routes[FSM_ENABLE] = "no match: announced, but the router knows no subscriber"
    stage.spend(40)
    assert stage.findings == []
    stage.spend(30)
    found = stage.only(Code.ROUTE_SUSPECT)
    assert "no match" in found.message and found.since_ns <= stage.now_ns - 500 * MS
    stage.coordinator.routes[FSM_ENABLE] = "ready"
    stage.spend(20)
    assert stage.findings == []


def unanswered() -> Watched:
    """Return a stage whose 1.0 has had no effect for a second."""
    stage = Watched(State.ENABLING)
    stage.coordinator.body.heartbeat.ones(stage.now_ns)
    stage.spend(60)
    assert stage.findings == []
    stage.spend(40)
    return stage


def test_1_0_without_an_answer_is_told():
    """The FSM answers within a period of 50 ms."""
    found = unanswered().only(Code.HEARTBEAT_NOT_EFFECTIVE)
    assert found.facts["beats_s"] == pytest.approx(1.0, abs=0.15) and "nothing is known of its route" in found.message


def test_the_reason_outlives_the_attempt():
    """After the heartbeat was silenced it is told for a minute, until the FSM leaves PAUSE, or until another attempt."""
    stage = unanswered()
    stage.coordinator.body.heartbeat.silence()
    stage.spend(5900)
    assert stage.codes == ["HEARTBEAT_NOT_EFFECTIVE"]
    stage.spend(200)
    assert stage.codes == []
    for end in ("fsm", "attempt"):
        stage = unanswered()
        stage.coordinator.body.heartbeat.silence()
        if end == "fsm":
            stage.fsm = int(FsmState.SLOW_START)
        else:
            stage.coordinator.enable.begin((L, R))
        stage.spend(20)
        assert stage.codes == []


# ----------------------------------------------------------------------------------------------------- our own gaps


def test_a_gap_of_our_own_is_told_while_it_shows():
    """Half of what drops the grip is late already; for 10 s, as the stream's figures. A gripper's own has no bound (§4.4)."""
    stage = Watched(State.HOLDING)
    stage.coordinator.body.grippers[L].start(stage.now_ns, is_kept=False)
    stage.spend(20)
    stage.now_ns += 60 * MS
    stage.spend(20)
    about = [finding.facts for finding in stage.diagnosis.findings if finding.code == "STREAM_LATE"]
    assert [round(facts["gap_ms"]) for facts in about] == [70, 70] and about[0]["bound_ms"] == 50
    assert stage.coordinator.body.grippers[L].log.worst_gap(stage.now_ns)[1] >= 60 * MS
    began_ns = {finding.since_ns for finding in stage.diagnosis.findings if finding.code == "STREAM_LATE"}
    assert began_ns == {stage.now_ns - 200 * MS - 60 * MS}
    stage.spend(1010)
    assert stage.findings == []


# ------------------------------------------------------------------------------------------------------------- arms


def moving(stage: Watched) -> Watched:
    """Send both arms to a goal; the robot does not move."""
    arms = stage.coordinator.body.arms
    for side, path in plan({side: arms[side].reference for side in (L, R)}, GOAL).items():
        arms[side].follow_path(path, stage.epoch)
    return stage


def test_an_arm_that_is_not_as_modelled_is_told_with_both_figures():
    """A robot with its hands elsewhere: the one that was compared is told, and only while the two differ."""
    stage = Watched(State.IDLE, poses={L, R})
    stage.coordinator.model = model = BodyModel(nominal(), Settings())
    stage.spend(100)
    assert stage.codes == []
    pose = EePose(p_m=PLACE[L][:3], quat_xyzw=PLACE[L][3:])
    state = ArmState(q_rad=MIDDLE[L], dq_radps=(), tau_nm=(), stamp_ns=0)
    for _ in range(100):
        for topic, value in ((ee_pose(L), pose), (arm_state(L), state)):
            model.hear(SampleArrived(topic=topic, value=value, received_ns=stage.now_ns), stage.now_ns)
        stage.spend(2)
    symptom = stage.only(Code.MODEL_DIFFERS)
    verdict = model.verdict(L, stage.now_ns)
    assert verdict.reason in symptom.message
    assert "left arm" in symptom.message and "ta2 identify" in symptom.hint
    assert symptom.facts == {"position_m": verdict.position_m, "angle_rad": verdict.angle_rad}
    model.forget()
    stage.spend(20)
    assert stage.codes == []


def test_arms_that_do_not_follow_are_told():
    """Per arm, with the joint that is furthest away."""
    stage = moving(Watched(State.ACTIVE))
    stage.spend(90)
    assert stage.codes == ["TRACKING_STALL"] * 2
    found = stage.diagnosis.findings[0]
    assert found.facts["joint"] == 1 and found.facts["off_rad"] > 0.1 and "l_joint1" in found.message
    assert len(stage.told(Code.TRACKING_STALL)) == 2


def test_a_joint_that_stays_behind_the_others_is_told_apart():
    """The others follow: clipped, or held."""
    stage = moving(Watched(State.ACTIVE))
    for _ in range(120):
        stage.spend(1)
        for side in (L, R):
            _, *others = stage.coordinator.body.arms[side].reference.values
            stage.q_rad[side] = (stage.q_rad[side][0], *others)
    assert stage.codes == ["CLIPPED_BY_ROBOT"] * 2 and "other joints follow" in stage.findings[0][1]


@pytest.mark.parametrize("how", ["state", "silent", "stale"])
def test_an_arm_that_is_not_driven_is_not_judged(how: str):
    """Not while enabling or paused, not without a stream, not when its state is old."""
    stage = moving(Watched(State.ACTIVE))
    stage.spend(30)
    if how == "state":
        stage.coordinator.go(State.PAUSED, stage.now_ns, "test")
    elif how == "silent":
        stage.coordinator.body.silence_arms()
    else:
        stage.dumb = {L, R}
        stage.spend(25)
    stage.spend(60)
    assert not {"TRACKING_STALL", "CLIPPED_BY_ROBOT"} & set(stage.codes)


def test_topics_that_never_came_are_one_finding():
    """What this robot does not send is told in one line, 3 s after the link stood."""
    stage = Watched(mute={CHASSIS_STATE, gripper_state(L)})
    stage.spend(320)
    message = stage.only(Code.ROUTE_SUSPECT).message
    assert CHASSIS_STATE in message and gripper_state(L) in message and "not heard since" in message
    found = stage.only(Code.ROUTE_SUSPECT)
    began_s = (stage.now_ns - found.since_ns) / 1e9
    assert set(found.facts) == {"silent_s"} and 3.0 < found.facts["silent_s"] <= began_s


def led(stage: Watched) -> Watched:
    """Send the right end effector 10 cm aside and turn it; the robot does not move."""
    x, y, z, *_ = stage.pose[R]
    goal = (x, y + 0.1, z, 0.0, 0.0, 0.38941834, 0.92106099)
    body = stage.coordinator.body
    body.arms[R].follow_path(body.plan({R: goal}, 1.0)[R], stage.epoch)
    return stage


def test_an_end_effector_that_does_not_follow_is_told():
    """In pose mode the robot's IK refuses without a word; how far it is away stands in metres and radians."""
    stage = led(Watched(State.ACTIVE, poses={R}))
    stage.spend(90)
    found = stage.only(Code.IK_REFUSED)
    assert found.facts["off_m"] > 0.02 and found.facts["off_rad"] > 0.05 and "right end effector" in found.message


def slowed(ratio: float, held: bool) -> SlowingView:
    """Return what is shown of an arm near a singularity."""
    return SlowingView(on=True, why="", speed_ratio=ratio, held=held, joint=4, joint_radps=3.0 / ratio, bound_radps=3.0)


@pytest.mark.parametrize(("ratio", "held", "is_told"), [(0.34, True, True), (0.34, False, False), (0.95, True, False)])
def test_poses_that_are_followed_slower_near_a_singularity_are_told(ratio: float, held: bool, is_told: bool):
    """Only where that is what holds them back, and by more than a tenth: part of the speed, joint, speed and bound."""
    stage = Watched(State.ACTIVE, poses={R})
    stage.coordinator.body.slowing[R] = slowed(ratio, held)
    stage.spend(20)
    assert ("SINGULARITY_NEAR" in stage.codes) is is_told
    if is_told:
        found = stage.only(Code.SINGULARITY_NEAR)
        assert (
            "right arm are followed at 34%" in found.message
            and "(r_joint4) would have to go 8.8 rad/s" in found.message
        )
        assert found.facts == {"speed_ratio": 0.34, "joint": 4, "joint_radps": pytest.approx(8.82, abs=0.01)}


def test_the_other_sign_of_a_quaternion_is_the_same_orientation():
    """A robot that answers from the other hemisphere follows all the same."""
    stage = led(Watched(State.ACTIVE, poses={R}))
    for _ in range(120):
        stage.spend(1)
        x, y, z, *quat = stage.coordinator.body.arms[R].values
        stage.pose[R] = (x, y, z, *(-part for part in quat))
        assert "IK_REFUSED" not in stage.codes


def test_a_pose_that_is_turned_as_its_setpoint_is_off_by_no_angle():
    """The product of this unit quaternion with itself is rounded to more than 1, which is the cosine of nothing."""
    turned = (0.0, 0.0, math.sin(0.025), math.cos(0.025))
    assert sum(part * part for part in turned) > 1.0
    stage = Watched(State.ACTIVE, poses={R})
    x, y, z, *_ = stage.pose[R]
    stage.pose[R] = here = (x, y, z, *turned)
    body = stage.coordinator.body
    body.arms[R].stop()
    body.arms[R].start(here, stage.now_ns)
    stage.spend(10)
    body.arms[R].follow_path(body.plan({R: (x, y + 0.1, z, *turned)}, 1.0)[R], stage.epoch)
    stage.spend(90)
    assert stage.only(Code.IK_REFUSED).facts["off_rad"] == 0.0
