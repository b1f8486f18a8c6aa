"""Conditions: what the robot does by itself is seen on every tick, most serious first, and nothing is done about it."""

from __future__ import annotations

import pytest

from gateway.core.messages.events import SampleRefused
from gateway.core.messages.outputs import Remembered
from gateway.core.messages.sightings import ForeignData, Gateway, Means, Writer
from gateway.core.motion.motion import plan
from gateway.core.supervision.conditions import Conditions
from gateway.core.supervision.coordinator import Coordinator
from gateway.core.supervision.supervisor import STREAMING, State, Trigger
from gateway.errors import Code
from gateway.robot.topics import arm_state, joint_command
from gateway.settings.settings import Settings
from gateway.values import OWN_FSM, FsmState, Side
from tests.core.stage import GOAL, MS, TICK_NS, L, R, Stage

NEITHER = dict.fromkeys(Side, False)
QUIET = {State.OFFLINE, State.STALE}
HEARD = [state for state in State if state not in QUIET]
"""States in which the robot is heard."""


class Scene(Stage):
    """A stage that is looked at; the robot's FSM is what fits its state, so that nothing is wrong at first."""

    def __init__(self, state: State = State.ACTIVE, **how: object) -> None:
        super().__init__(state, **how)
        self.conditions = Conditions(self.coordinator)
        if state in {State.PAUSED, State.ENABLING}:
            self.fsm = int(FsmState.SLOW_START)
        self.hear()

    def look(self) -> list[tuple[Trigger, str]]:
        """Look at the robot now."""
        return list(self.conditions.look(self.now_ns))

    @property
    def seen(self) -> list[Trigger]:
        """What is seen now."""
        return [trigger for trigger, _ in self.look()]

    def says_fsm(self, value: int) -> list[Trigger]:
        """The FSM's state is heard a tick later; return what is seen."""
        self.fsm = value
        self.run(1)
        return self.seen

    def why(self, trigger: Trigger) -> str:
        """Return the one reason that is given for what is seen."""
        (reason,) = [message for seen, message in self.look() if seen is trigger]
        return reason

    def beat(self) -> None:
        """The first 1.0 of an enabling leaves now."""
        self.conditions.first_beat_ns = self.now_ns

    def wrong_names(self) -> None:
        """The left arm's joints come in another order, and have for 50 ms."""
        for at_ns in (self.now_ns - 50 * MS, self.now_ns):
            refused = SampleRefused(
                topic=arm_state(L), code=Code.JOINT_ORDER, message="l_joint2 first", received_ns=at_ns
            )
            self.coordinator.store.receive(refused, self.now_ns)

    def silence(self, ticks: int) -> None:
        """Nothing is heard for so many ticks."""
        self.now_ns += ticks * TICK_NS


def quiet_of(scene: Scene) -> list[Trigger]:
    """What is seen all the time while the FSM is what it was: none of it changes this state."""
    return [Trigger.FSM_SLOW_START] if scene.state in {State.PAUSED, State.ENABLING} else []


# ------------------------------------------------------------------------------------------------ the link


@pytest.mark.parametrize("state", HEARD)
def test_a_healthy_robot_shows_nothing_that_would_move_the_supervisor(state):
    """In any state in which it is heard."""
    scene = Scene(state)
    assert scene.seen == quiet_of(scene)


@pytest.mark.parametrize("state", State)
def test_without_transport_nothing_else_is_seen(state):
    """Whatever was heard last may be of another robot."""
    scene = Scene(state)
    scene.coordinator.transport_up = False
    scene.wrong_names()
    assert scene.look() == [(Trigger.TRANSPORT_LOST, "no transport to the robot's router")]


@pytest.mark.parametrize("state", State)
def test_joints_in_another_order_are_seen_in_every_state(state):
    """Before anything else: this is not our robot (BEHAVIOUR, the robot does something by itself)."""
    scene = Scene(state)
    scene.coordinator.transport_up = True
    scene.wrong_names()
    assert scene.look()[0] == (Trigger.JOINT_ORDER, "l_joint2 first")


@pytest.mark.parametrize("state", State)
def test_a_state_older_than_100_ms_is_stale(state):
    """Just 100 ms are not; nothing else is seen then, for nothing else is known. What is stale already is not told."""
    scene = Scene(state)
    scene.coordinator.transport_up = True
    scene.hear()
    scene.now_ns += 100 * MS
    assert Trigger.STALE not in scene.seen
    scene.now_ns += 1 * MS
    expected = (Trigger.STALE, "the newest state is 101 ms old, 100 ms is the bound")
    assert scene.look() == ([] if state in QUIET else [expected])


def test_a_robot_that_was_never_heard_is_stale_without_an_age():
    """A state other than OFFLINE cannot be reached like this, but it would be left at once."""
    coordinator = Coordinator(Settings(), Remembered())
    coordinator.transport_up = True
    coordinator.go(State.IDLE, 0, "test")
    told = list(Conditions(coordinator).look(0))
    assert told == [(Trigger.STALE, "the newest state is 0 ms old, 100 ms is the bound")]


@pytest.mark.parametrize("state", sorted(QUIET))
def test_the_way_back_from_silence_is_not_a_condition(state):
    """It depends on how long the robot was gone: whatever it says, nothing is seen here."""
    scene = Scene(state)
    scene.coordinator.transport_up = True
    scene.say_mode(api=False)
    assert scene.says_fsm(FsmState.ERROR) == []


# ------------------------------------------------------------------------------------------------ the mode


@pytest.mark.parametrize("state", HEARD)
def test_a_mode_that_has_not_been_heard_for_3_s_is_unknown(state):
    """At 3 s it is still known."""
    scene = Scene(state)
    scene.mode = None
    scene.run(300)
    assert scene.seen == quiet_of(scene)
    scene.run(1)
    assert scene.why(Trigger.MODE_UNKNOWN) == "/api/current_mode has not been heard for 3 s"


@pytest.mark.parametrize("state", HEARD)
def test_vr_mode_is_seen_wherever_it_is_not_yet_known(state):
    """READ_ONLY is where it leads."""
    scene = Scene(state)
    scene.say_mode(api=False, arm_enabled=NEITHER)
    assert (Trigger.VR_MODE in scene.seen) == (state is not State.READ_ONLY)
    if state in {State.READ_ONLY, State.IDLE}:
        assert Trigger.NO_ARM not in scene.seen, "what is enabled is VR's matter then"


@pytest.mark.parametrize("state", HEARD)
@pytest.mark.parametrize(
    "changes",
    [
        {"arm_enabled": NEITHER},
        {"arm_enabled": NEITHER, "joint_mode": NEITHER},
    ],
)
def test_a_robot_without_an_enabled_arm_is_seen(state, changes):
    """Whatever control mode they are in."""
    scene = Scene(state)
    scene.say_mode(**changes)
    assert scene.why(Trigger.NO_ARM).startswith("no arm is enabled any more")


# ------------------------------------------------------------------------------------------------ the FSM


@pytest.mark.parametrize("state", [State.READ_ONLY, State.IDLE])
@pytest.mark.parametrize("value", [*range(-2, 9), 99])
def test_the_fsm_is_nobodys_matter_while_nothing_is_sent(state, value):
    """It refuses an `enable`, where that is asked for."""
    assert Scene(state).says_fsm(value) == []


@pytest.mark.parametrize("state", sorted(STREAMING))
def test_an_fsm_that_has_not_been_heard_for_half_a_second_is_dead(state):
    """At 0.5 s it is not yet; then its last word counts for nothing."""
    scene = Scene(state)
    scene.fsm = None
    scene.run(50)
    assert Trigger.FSM_DEAD not in scene.seen
    scene.run(1)
    assert scene.look() == [(Trigger.FSM_DEAD, "/fsm_state has not been heard for 0.5 s")]


@pytest.mark.parametrize("state", sorted(STREAMING))
@pytest.mark.parametrize("value", [-2, 3, 4, 5, 6, 7, 99])
def test_an_fsm_that_no_api_program_meets_is_foreign(state, value):
    """VR single arm, playback, or a value that the manual does not know (§4.11.1)."""
    assert value not in OWN_FSM
    scene = Scene(state)
    assert scene.says_fsm(value) == [Trigger.FSM_FOREIGN]
    assert f"FSM is {value}:" in scene.why(Trigger.FSM_FOREIGN)


@pytest.mark.parametrize("state", sorted(STREAMING))
def test_an_fsm_in_error_is_seen_wherever_something_is_sent(state):
    """A control or motor fault (manual §4.11.1)."""
    scene = Scene(state)
    assert scene.says_fsm(FsmState.ERROR) == [Trigger.FSM_ERROR] and "ERROR (-1)" in scene.why(Trigger.FSM_ERROR)


@pytest.mark.parametrize("state", sorted(STREAMING - {State.ENABLING}))
def test_ready_is_news_only_in_a_pause(state):
    """There it means that the robot did not stay paused: it is told 0.0. Anywhere else it is as it should be."""
    expected = [Trigger.FSM_READY] if state is State.PAUSED else []
    assert Scene(state).says_fsm(FsmState.READY) == expected


def test_ready_ends_an_enabling_only_as_an_answer_to_its_heartbeat():
    """Heard before the first 1.0, or with it, it is somebody else's; the next sample after it counts."""
    scene = Scene(State.ENABLING)
    assert scene.says_fsm(FsmState.READY) == []
    scene.beat()
    assert scene.seen == []
    assert scene.says_fsm(FsmState.READY) == [Trigger.FSM_READY]
    assert scene.why(Trigger.FSM_READY) == "the robot's FSM is READY"


def test_an_answer_to_an_earlier_enabling_is_none_to_this_one():
    """Each begins without a heartbeat of its own."""
    scene = Scene(State.ENABLING)
    scene.beat()
    scene.says_fsm(FsmState.SLOW_START)
    scene.conditions.enabling_begins()
    assert scene.conditions.first_beat_ns is None
    assert scene.says_fsm(FsmState.READY) == []
    assert scene.says_fsm(FsmState.PAUSE) == [Trigger.FSM_PAUSE], "nor has it fallen: it never rose"


def test_an_fsm_that_was_forgotten_is_no_answer():
    """After a loss of the link only what comes then counts."""
    scene = Scene(State.ENABLING)
    scene.beat()
    assert scene.says_fsm(FsmState.READY) == [Trigger.FSM_READY]
    scene.fsm = None
    scene.coordinator.store.reset()
    scene.run(1)
    assert scene.seen == [Trigger.FSM_DEAD]


@pytest.mark.parametrize("state", sorted(STREAMING))
def test_slow_start_is_told_in_any_state(state):
    """The table knows where it is a fall (a pause too short to be seen) and where it is the way up."""
    scene = Scene(state)
    assert scene.says_fsm(FsmState.SLOW_START) == [Trigger.FSM_SLOW_START]


def test_a_robot_that_falls_back_while_enabling_is_seen():
    """From SLOW_START to PAUSE after our 1.0: somebody stopped it (BEHAVIOUR, FSM from 1 to 0)."""
    scene = Scene(State.ENABLING)
    scene.beat()
    assert scene.says_fsm(FsmState.PAUSE) == [Trigger.FSM_PAUSE], "it has not risen yet"
    scene.says_fsm(FsmState.SLOW_START)
    assert scene.says_fsm(FsmState.PAUSE) == [Trigger.FSM_FELL, Trigger.FSM_PAUSE]
    assert scene.why(Trigger.FSM_FELL) == "the robot's FSM fell from SLOW_START to PAUSE while enabling"


def test_a_slow_start_from_before_our_heartbeat_is_no_rise():
    """What comes after it cannot be a fall of ours."""
    scene = Scene(State.ENABLING)
    scene.says_fsm(FsmState.SLOW_START)
    scene.beat()
    assert scene.says_fsm(FsmState.PAUSE) == [Trigger.FSM_PAUSE]


@pytest.mark.parametrize("state", sorted(STREAMING - {State.ENABLING}))
def test_outside_an_enabling_a_pause_is_only_a_pause(state):
    """Though the robot rose before it."""
    scene = Scene(state)
    scene.beat()
    scene.says_fsm(FsmState.SLOW_START)
    assert scene.says_fsm(FsmState.PAUSE) == [Trigger.FSM_PAUSE]


@pytest.mark.parametrize(
    ("state", "moving", "whose"),
    [
        (State.ACTIVE, False, "by itself, perhaps a physical stop"),
        (State.HOLDING, False, "by itself, perhaps a physical stop"),
        (State.STOPPING, True, "by itself, perhaps a physical stop"),
        (State.STOPPING, False, "as our 0.0 asked for"),
    ],
)
def test_a_pause_is_the_robots_own_until_we_have_asked_for_it(state, moving, whose):
    """In STOPPING 0.0 is not sent before the arms are at rest: a pause while they brake is somebody else's."""
    scene = Scene(state)
    if moving:
        arm = scene.coordinator.body.arms[L]
        arm.follow_path(plan({L: arm.reference}, {L: GOAL[L]})[L], scene.epoch)
        scene.run(20)
    scene.says_fsm(FsmState.PAUSE)
    assert scene.why(Trigger.FSM_PAUSE).endswith(whose)


# ------------------------------------------------------------------------------------------------ the arms


@pytest.mark.parametrize("state", HEARD)
@pytest.mark.parametrize("side", Side)
@pytest.mark.parametrize("part", ["arm_enabled", "joint_mode"])
def test_an_arm_that_is_disabled_or_leaves_its_mode_is_seen_where_it_is_streamed(state, side, part):
    """By its name; the other one goes on."""
    scene = Scene(state)
    scene.say_mode(**{part: {other: other is not side for other in Side}})
    lost = [Trigger.ARM_DISABLED] if state in STREAMING else []
    assert scene.seen == quiet_of(scene) + lost
    if lost:
        why = (
            f"the {side} arm was disabled"
            if part == "arm_enabled"
            else f"WRONG_CONTROL_MODE: the {side} arm left joint mode"
        )
        assert scene.why(Trigger.ARM_DISABLED).startswith(why)


@pytest.mark.parametrize("state", HEARD)
@pytest.mark.parametrize("side", Side)
def test_an_arm_whose_state_is_older_than_100_ms_is_seen_where_it_is_streamed(state, side):
    """The link is fresh: the other arm is heard."""
    scene = Scene(state)
    scene.dumb = {side}
    scene.run(10)
    assert scene.seen == quiet_of(scene)
    scene.run(1)
    dead = [Trigger.PART_DEAD] if state in STREAMING else []
    assert scene.seen == quiet_of(scene) + dead
    if dead:
        assert scene.why(Trigger.PART_DEAD) == f"the state of the {side} arm is older than 100 ms"


def test_a_part_whose_samples_are_not_believed_dies_with_the_reason():
    """Who reads why the arm is held reads what is wrong with its state; an old refusal is no reason."""
    scene = Scene(State.ACTIVE)
    scene.dumb = {L}
    for _ in range(12):
        scene.run(1)
        refused = SampleRefused(
            topic=arm_state(L), code=Code.SAMPLE_REFUSED, message="position[0] is nan", received_ns=scene.now_ns
        )
        scene.coordinator.store.receive(refused, scene.now_ns)
    assert scene.why(Trigger.PART_DEAD).endswith("100 ms: its samples are not believed, position[0] is nan")
    scene.run(25)
    assert scene.why(Trigger.PART_DEAD).endswith("100 ms")


def test_each_lost_arm_is_told_by_itself():
    """One disabled, the other dead."""
    scene = Scene(State.HOLDING)
    scene.say_mode(arm_enabled={L: True, R: False})
    scene.mode = None
    scene.dumb = {L}
    scene.run(11)
    assert scene.seen == [Trigger.PART_DEAD, Trigger.ARM_DISABLED]


@pytest.mark.parametrize("state", sorted(STREAMING - {State.ENABLING}))
def test_when_no_arm_is_left_that_was_enabled_it_is_seen(state):
    """Though the robot has arms in joint mode: they were let go, and nothing is held any more."""
    scene = Scene(state)
    scene.coordinator.body.silence_arms()
    assert scene.why(Trigger.NO_ARM) == "no arm that was enabled is left"


# ------------------------------------------------------------------------------------------------ tracking


def off(scene: Scene, side: Side, off_rad: float) -> None:
    """An arm is found away from its setpoint, heard as after a reconnect: no step that could not be believed."""
    scene.coordinator.store.reset()
    first, *others = scene.coordinator.body.arms[side].reference.values
    scene.q_rad[side] = (first + off_rad, *others)
    scene.run(1)


@pytest.mark.parametrize("state", sorted(STREAMING - {State.ENABLING}))
@pytest.mark.parametrize("side", Side)
@pytest.mark.parametrize("off_rad", [0.31, -0.5])
def test_an_arm_that_is_off_by_more_than_the_bound_for_300_ms_is_seen(state, side, off_rad):
    """Not before; its name, distance and bounds are told."""
    scene = Scene(state)
    off(scene, side, off_rad)
    for _ in range(30):
        assert scene.seen == quiet_of(scene)
        scene.run(1)
    assert scene.seen == [*quiet_of(scene), Trigger.TRACKING]
    assert scene.why(Trigger.TRACKING) == (
        f"the {side} arm is {abs(off_rad)} rad from its setpoint for 0.3 s, 0.3 rad is the bound"
    )


def test_an_arm_inside_the_bound_is_never_off():
    """It sags a little under gravity."""
    scene = Scene()
    off(scene, L, 0.299)
    for _ in range(100):
        assert scene.seen == []
        scene.run(1)


def test_the_time_of_an_arm_that_comes_back_begins_anew():
    """A moment inside the bound is enough, and each arm has a time of its own."""
    scene = Scene()
    off(scene, L, 0.4)
    for tick in range(29):
        assert scene.seen == [], tick
        scene.run(1)
    off(scene, L, 0.2)
    assert scene.seen == []
    off(scene, L, 0.4)
    off(scene, R, 0.4)
    for tick in range(29):
        assert scene.seen == [], tick
        scene.run(1)
    assert scene.seen == []
    scene.run(1)
    assert [message.split()[1] for _, message in scene.look()] == ["left", "right"]


def test_an_arm_that_is_not_streamed_is_nowhere_off():
    """It has no setpoint; nor is one judged that was never heard."""
    silent = Scene(sides=(L,))
    silent.push(R, 0.5)
    unheard = Scene(sides=(L,), dumb=(R,))
    unheard.coordinator.body.arms[R].start(GOAL[R], unheard.now_ns)
    for _ in range(40):
        assert silent.seen == [] and Trigger.TRACKING not in unheard.seen
        silent.run(1)
        unheard.run(1)


# ------------------------------------------------------------------------------------------------ the order


def test_the_most_serious_is_told_first():
    """After it has moved the state the rest is looked at again from there (names, mode, FSM, arms, tracking)."""
    scene = Scene()
    off(scene, L, 0.4)
    assert scene.seen == []
    scene.run(20)
    scene.dumb = {R}
    scene.run(11)
    scene.wrong_names()
    scene.say_mode(api=False)
    scene.fsm = int(FsmState.ERROR)
    scene.hear()
    assert scene.seen == [
        Trigger.JOINT_ORDER,
        Trigger.VR_MODE,
        Trigger.FSM_ERROR,
        Trigger.PART_DEAD,
        Trigger.TRACKING,
    ]


def test_looking_does_nothing():
    """Whatever is seen: state, latches, streams and notices stay as they are."""
    scene = Scene()
    scene.wrong_names()
    scene.say_mode(api=False)
    scene.says_fsm(FsmState.ERROR)
    coordinator = scene.coordinator
    assert len(scene.seen) == 3
    assert (coordinator.state, coordinator.supervisor.latches, coordinator.notices) == (State.ACTIVE, {}, [])
    assert coordinator.sides == (L, R)


# ------------------------------------------------------------------------------------------------ somebody else


def foreign_data(scene: Scene) -> None:
    """Somebody sends setpoints."""
    scene.coordinator.others.see_data(ForeignData(topic=joint_command(L), zid="b", at_ns=scene.now_ns))


def foreign_token(scene: Scene) -> None:
    """Somebody announces setpoints."""
    writer = Writer(topic=joint_command(L), zid="b", means=Means.TOKEN)
    scene.coordinator.others.see_writers([writer], scene.now_ns)


def armed_gateway(scene: Scene) -> None:
    """Another gateway commands the robot."""
    scene.coordinator.others.see_gateways([Gateway(zid="b", is_armed=True)], scene.now_ns)


@pytest.mark.parametrize("state", HEARD)
@pytest.mark.parametrize(
    ("happens", "trigger"),
    [
        (foreign_data, Trigger.FOREIGN_DATA),
        (foreign_token, Trigger.FOREIGN_TOKEN),
        (armed_gateway, Trigger.OTHER_GATEWAY),
    ],
)
def test_somebody_else_is_seen_by_name_in_every_state(state, happens, trigger):
    """What it means there is the table's."""
    scene = Scene(state)
    happens(scene)
    assert scene.seen == [trigger, *quiet_of(scene)]
    assert "zenoh session b" in scene.why(trigger)


@pytest.mark.parametrize("state", sorted(QUIET))
def test_somebody_else_moves_nothing_while_the_robot_is_not_heard(state):
    """The way back asks for itself."""
    scene = Scene(state)
    foreign_data(scene)
    assert Trigger.FOREIGN_DATA not in scene.seen


def test_the_most_serious_of_others_comes_first():
    """Beside another gateway no 0.0 leaves, whatever it sends."""
    scene = Scene(State.HOLDING)
    foreign_token(scene)
    foreign_data(scene)
    scene.coordinator.others.see_gateways([Gateway(zid="c", is_armed=True)], scene.now_ns)
    assert scene.seen == [Trigger.OTHER_GATEWAY, Trigger.FOREIGN_DATA, Trigger.FOREIGN_TOKEN]


def test_another_gateway_is_no_trigger_before_our_own_claim_is_confirmed():
    """Until then one of the two yields, perhaps the other."""
    scene = Scene(State.ENABLING)
    armed_gateway(scene)
    scene.coordinator.claim.is_confirmed = False
    assert Trigger.OTHER_GATEWAY not in scene.seen
    scene = Scene(State.HOLDING)  # taken over from a process that had confirmed it
    armed_gateway(scene)
    scene.coordinator.claim.is_confirmed = False
    assert scene.seen == [Trigger.OTHER_GATEWAY]


@pytest.mark.parametrize("happens", [foreign_data, foreign_token])
def test_somebody_else_beside_a_drive_of_ours_is_seen(happens):
    """Where arms are not enabled a writer is only a condition; a chassis that drives is ours to stop."""
    scene = Scene(State.IDLE)
    happens(scene)
    assert Trigger.FOREIGN_BESIDE_DRIVE not in scene.seen
    chassis = scene.coordinator.body.chassis
    chassis.drive((0.1, 0.0, 0.0), epoch=1, expires_ns=scene.now_ns + 1000 * MS, now_ns=scene.now_ns)
    assert scene.seen[-1] is Trigger.FOREIGN_BESIDE_DRIVE and "zenoh session b" in scene.why(scene.seen[-1])


# ------------------------------------------------------------------------------------------------ pose space


def test_an_end_effector_off_by_more_than_6_cm_for_300_ms_is_seen():
    """Judged by the measured pose, whatever the joints are; the text has both distances and both bounds."""
    scene = Scene(State.ACTIVE, poses={R})
    scene.shift(R, 0.07)
    for _ in range(30):
        assert scene.seen == []
        scene.run(1)
    assert scene.seen == [Trigger.TRACKING]
    assert scene.why(Trigger.TRACKING) == (
        "the right arm is 0.07 m and 0 rad from its setpoint for 0.3 s, 0.06 m and 0.3 rad is the bound"
    )


def test_an_end_effector_whose_pose_is_not_heard_is_dead_though_its_joints_are_heard():
    """The part is its joints and its pose."""
    scene = Scene(State.ACTIVE, poses={R})
    scene.poses = set()
    scene.run(11)
    assert scene.seen == [Trigger.PART_DEAD]


def test_an_arm_that_leaves_pose_mode_is_seen():
    """Its setpoints would be taken no more; the text names the mode and what takes the arm up again."""
    scene = Scene(State.ACTIVE, poses={R})
    scene.say_mode()
    assert scene.seen == [Trigger.ARM_DISABLED]
    assert "right arm left pose mode" in scene.why(Trigger.ARM_DISABLED)


# ------------------------------------------------------------------------------------------- whether anybody follows


@pytest.mark.parametrize("value", [None, *FsmState])
def test_only_a_robot_that_says_pause_follows_nobody(value):
    """Not hearing of it says nothing: it may be following."""
    scene = Scene(State.PAUSED)
    scene.fsm = None if value is None else int(value)
    scene.run(51)
    assert scene.conditions.is_unfollowed(scene.now_ns) is (value is FsmState.PAUSE)
    scene.silence(11)
    assert not scene.conditions.is_unfollowed(scene.now_ns)


def test_while_a_first_heartbeat_is_under_way_nothing_is_known():
    """The robot may have started before it says so; when it has not after three of its samples, it has not heard us."""
    scene = Scene(State.ENABLING)
    scene.says_fsm(int(FsmState.PAUSE))
    assert scene.conditions.is_unfollowed(scene.now_ns)
    scene.beat()
    scene.run(15)
    assert not scene.conditions.is_unfollowed(scene.now_ns)
    scene.run(1)
    assert scene.conditions.is_unfollowed(scene.now_ns)
