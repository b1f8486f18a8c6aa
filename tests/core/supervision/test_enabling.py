"""Enabling: steady state, echo, then 1.0; bounded in time, and it says what was missing."""

from __future__ import annotations

from itertools import pairwise

import pytest

from gateway.core.messages.events import GuardSeen
from gateway.core.messages.outputs import Frame, FrameKind, Level
from gateway.core.messages.sightings import Gateway
from gateway.core.others.guarding import WAIT_NS
from gateway.core.streams.heartbeat import Beat
from gateway.core.supervision.conditions import Conditions
from gateway.core.supervision.enabling import FSM_NAMES, Enabling
from gateway.core.supervision.starting import Starting
from gateway.core.supervision.supervisor import State, Trigger
from gateway.errors import Code
from gateway.robot.limits import JOINT_UPPER_RAD
from gateway.robot.topics import FSM_ENABLE, joint_command
from gateway.values import FsmState, Side
from tests.core.stage import MS, TICK_NS, L, R, S, Stage

TOP_RAD = JOINT_UPPER_RAD[L][0]
PAUSE, SLOW_START, READY = int(FsmState.PAUSE), int(FsmState.SLOW_START), int(FsmState.READY)
TIMEOUT_TICKS = 10 * S // TICK_NS


class Scene(Stage):
    """A stage on which an enabling takes its course: nothing else ends it."""

    def __init__(self, state: State = State.IDLE, **how: object) -> None:
        super().__init__(state, **how)
        self.conditions = Conditions(self.coordinator)
        self.enabling = Enabling(self.coordinator, self.conditions, Starting(self.coordinator))
        self.sent: list[tuple[int, Frame]] = []
        """Everything that was due since the first `begin`, with its time."""

    def hear(self) -> None:
        """The robot speaks; an FSM 0 settles what is owed, as the engine sees to it."""
        super().hear()
        if self.fsm == PAUSE:
            self.coordinator.body.heartbeat.fsm_zero_seen(self.now_ns)

    def begin(self, sides: tuple[Side, ...] = (L, R)) -> None:
        """Ann's `enable` was granted."""
        self.coordinator.go(State.ENABLING, self.now_ns, "test")
        self.enabling.begin(sides, self.now_ns)
        self.coordinator.notices.clear()

    def live(self, ticks: int) -> None:
        """Let time pass with the enabling at work as long as it lasts."""
        for _ in range(ticks):
            self.now_ns += TICK_NS
            self.hear()
            if self.state is State.ENABLING:
                self.enabling.step(self.now_ns)
            frames = [stream.frame(self.now_ns) for stream in self.coordinator.body.streams if stream.running]
            self.sent += [(self.now_ns, frame) for frame in frames if frame is not None]

    def unsteady(self) -> None:
        """The left arm was not heard for longer than 100 ms until now; both are heard again."""
        self.dumb = {L}
        self.run(11)
        self.dumb = set()

    def sent_at_ns(self, topic: str) -> list[int]:
        """When frames of a topic were due [ns]."""
        return [at_ns for at_ns, frame in self.sent if frame.topic == topic]

    @property
    def arm_frames(self) -> list[Frame]:
        """Setpoints of both arms."""
        return [frame for _, frame in self.sent if frame.topic in map(joint_command, Side)]

    @property
    def verdict(self) -> tuple[str, Code | None]:
        """How the latest enabling went."""
        return self.coordinator.enable.outcome, self.coordinator.enable.code

    @property
    def running(self) -> set[Side]:
        """Arms whose streams run."""
        return {side for side, arm in self.coordinator.body.arms.items() if arm.running}

    @property
    def is_ready(self) -> bool:
        """Whether the robot's READY counts as the answer to our 1.0."""
        return Trigger.FSM_READY in {trigger for trigger, _ in self.conditions.look(self.now_ns)}


# ------------------------------------------------------------------------------------------------ the course


@pytest.mark.parametrize("sides", [(L,), (R,), (L, R)])
def test_the_arms_are_echoed_first_and_the_heartbeat_follows_30_ms_later(sides):
    """It has a faster lane and must not overtake the setpoint; the arms stay where they are."""
    scene = Scene()
    scene.push(L, 0.2)
    scene.begin(sides)
    scene.live(20)
    echoes_ns, beats_ns = scene.sent_at_ns(joint_command(sides[0])), scene.sent_at_ns(FSM_ENABLE)
    assert beats_ns[0] - echoes_ns[0] == 30 * MS and scene.running == set(sides)
    assert {frame.kind for frame in scene.arm_frames} == {FrameKind.ECHO}
    for side in sides:
        values = {frame.values for frame in scene.arm_frames if frame.topic == joint_command(side)}
        assert values == {scene.q_rad[side]}
    assert {frame.values for _, frame in scene.sent if frame.topic == FSM_ENABLE} == {(1.0,)}


def test_ready_is_an_answer_only_after_our_first_heartbeat():
    """Until then the robot is somebody else's; afterwards SLOW_START and READY are what was asked for."""
    scene = Scene()
    scene.begin()
    scene.live(3)
    assert scene.conditions.first_beat_ns is None
    scene.live(1)
    assert scene.conditions.first_beat_ns == scene.now_ns == scene.sent_at_ns(FSM_ENABLE)[0]
    scene.fsm = SLOW_START
    scene.live(10)
    assert scene.state is State.ENABLING and not scene.is_ready
    scene.fsm = READY
    scene.live(1)
    assert scene.state is State.ENABLING and scene.is_ready


def test_each_enabling_is_an_attempt_of_its_own():
    """It counts, it runs, and what failed before is forgotten: its heartbeat, its verdict and its arms."""
    scene = Scene()
    scene.begin()
    scene.live(4)
    scene.coordinator.enable.blame(Code.ENABLE_TIMEOUT, "too long")
    scene.coordinator.go(State.IDLE, scene.now_ns, "test")
    assert (scene.coordinator.enable.attempt, scene.verdict) == (1, ("failed", Code.ENABLE_TIMEOUT))
    scene.begin((R,))
    record = scene.coordinator.enable
    assert (record.attempt, record.sides, scene.verdict, record.message) == (2, (R,), ("running", None), "")
    assert scene.conditions.first_beat_ns is None


def test_no_arm_is_echoed_before_the_state_of_all_was_steady_for_a_while():
    """0.3 s without a gap (BEHAVIOUR, before seeding); an arm that is steady waits for the other one."""
    scene = Scene()
    scene.unsteady()
    scene.begin()
    scene.live(30)
    assert scene.sent == [] and scene.state is State.ENABLING
    scene.live(1)
    assert {frame.topic for frame in scene.arm_frames} == {joint_command(side) for side in Side}


def test_an_arm_that_is_not_to_be_enabled_is_not_waited_for():
    """It may be dead for all we know."""
    scene = Scene()
    scene.unsteady()
    scene.begin((R,))
    scene.live(1)
    assert {frame.topic for frame in scene.arm_frames} == {joint_command(R)}


# ------------------------------------------------------------------------------------------------ from PAUSED


def test_from_paused_the_echo_goes_on_without_a_gap_from_where_the_arms_are():
    """At once, though the state was not steady: the robot does not follow (BEHAVIOUR, before seeding)."""
    scene = Scene(State.PAUSED)
    scene.fsm = PAUSE
    scene.unsteady()
    scene.push(R, -0.4)
    scene.begin()
    assert scene.running == {L, R}
    scene.live(10)
    for side in Side:
        times_ns = scene.sent_at_ns(joint_command(side))
        assert [b - a for a, b in pairwise(times_ns)] == [TICK_NS] * 9
    assert {frame.kind for frame in scene.arm_frames} == {FrameKind.ECHO}
    assert {frame.values for frame in scene.arm_frames} == set(scene.q_rad.values())
    assert scene.coordinator.body.heartbeat.beat is Beat.ONE


@pytest.mark.parametrize(("streamed", "sides"), [((L, R), (L,)), ((L, R), (R,)), ((L,), (R,))])
def test_from_paused_an_arm_that_the_robot_has_disabled_falls_silent(streamed, sides):
    """It takes no setpoints any more; the others are echoed."""
    scene = Scene(State.PAUSED, sides=streamed)
    scene.fsm = PAUSE
    scene.begin(sides)
    scene.live(1)
    assert scene.running == set(sides)
    assert {frame.topic for frame in scene.arm_frames} == {joint_command(side) for side in sides}


def test_from_paused_an_arm_outside_its_limits_ends_the_enabling_at_once():
    """Nothing is echoed from then on."""
    scene = Scene(State.PAUSED)
    scene.fsm = PAUSE
    scene.push(L, TOP_RAD + 0.1)
    scene.begin()
    assert (scene.state, scene.verdict) == (State.IDLE, ("failed", Code.START_OUTSIDE_LIMITS))
    assert scene.running == set()


# ------------------------------------------------------------------------------------------------ how it fails


def test_an_arm_outside_its_limits_ends_the_enabling_before_anything_is_sent():
    """With joint, value and bound; no 0.0, because no 1.0 was out."""
    scene = Scene()
    scene.push(R, -TOP_RAD - 0.1)
    scene.begin()
    scene.live(10)
    assert (scene.state, scene.verdict) == (State.IDLE, ("failed", Code.START_OUTSIDE_LIMITS))
    assert scene.coordinator.enable.message.startswith("right arm joint 1 is at -1.9000 rad")
    assert scene.sent == []


@pytest.mark.parametrize("fsm", [SLOW_START, READY, 3, -1, None])
@pytest.mark.parametrize("ticks", [0, 2])
def test_an_fsm_that_leaves_pause_before_our_heartbeat_is_somebody_elses(fsm, ticks):
    """FSM_BUSY, before the echo or after it; neither 1.0 nor 0.0 is sent to his robot."""
    scene = Scene()
    scene.begin()
    scene.live(ticks)
    scene.fsm = fsm
    if fsm is None:
        scene.run(51)
    scene.live(1)
    assert (scene.state, scene.verdict) == (State.IDLE, ("failed", Code.FSM_BUSY))
    assert (
        scene.coordinator.enable.message
        == f"the FSM went to {FSM_NAMES.get(fsm, fsm)} before our first heartbeat: somebody else enables"
    )
    scene.live(10)
    assert scene.sent_at_ns(FSM_ENABLE) == [] and scene.running == set()


@pytest.mark.parametrize(("sides", "named"), [((L,), "the left arm"), ((L, R), "the left arm and the right arm")])
def test_an_enabling_that_waited_too_long_for_steady_state_names_the_arms(sides, named):
    """ENABLE_TIMEOUT after 10 s and not before; nothing was sent, so no 0.0 is."""
    scene = Scene()
    scene.dumb = set(Side)
    scene.run(11)
    scene.begin(sides)
    scene.live(TIMEOUT_TICKS)
    assert scene.state is State.ENABLING
    scene.live(1)
    assert scene.verdict == ("failed", Code.ENABLE_TIMEOUT) and scene.state is not State.ENABLING
    assert scene.coordinator.enable.message == (
        f"the robot was not READY within 10 s: no 0.3 s of steady, timely state from {named}"
    )
    assert scene.sent == [] and scene.coordinator.body.heartbeat.beat is Beat.SILENT


@pytest.mark.parametrize(("fsm", "name"), [(PAUSE, "PAUSE"), (SLOW_START, "SLOW_START"), (None, "unknown"), (9, "9")])
def test_an_enabling_that_the_robot_did_not_answer_says_where_the_fsm_stayed(fsm, name):
    """ENABLE_TIMEOUT after 10 s and not before; our 1.0 was out, so 0.0 follows, and the arms fall silent."""
    scene = Scene()
    scene.begin()
    scene.live(4)
    scene.fsm = fsm
    scene.live(TIMEOUT_TICKS - 4)
    assert (scene.state, scene.coordinator.body.heartbeat.beat) == (State.ENABLING, Beat.ONE)
    scene.live(1)
    assert (scene.state, scene.verdict) == (State.IDLE, ("failed", Code.ENABLE_TIMEOUT))
    assert scene.coordinator.enable.message == (
        f"the robot was not READY within 10 s: setpoints and heartbeat were sent, the FSM stayed {name}"
    )
    assert scene.running == set() and scene.coordinator.body.heartbeat.beat is Beat.ZERO


# ------------------------------------------------------------------------------------------------ a heartbeat unheard


@pytest.mark.parametrize("route", ["no subscriber at the robot", None])
def test_a_heartbeat_that_does_nothing_is_told_once_with_what_is_known_of_its_route(route):
    """After 1.5 s of 1.0 in PAUSE (BEHAVIOUR, the bridge misbehaves); the enabling goes on."""
    scene = Scene()
    if route is not None:
        scene.coordinator.routes[FSM_ENABLE] = route
    scene.begin()
    scene.live(4 + 150)
    assert scene.coordinator.notices == []
    scene.live(100)
    (notice,) = scene.coordinator.notices
    shown = route or "nothing is known of its route"
    assert (notice.code, notice.level) == (Code.HEARTBEAT_NOT_EFFECTIVE, Level.WARNING)
    assert notice.message == f"1.0 has been sent for 1.5 s and the FSM stays PAUSE; {FSM_ENABLE}: {shown}"
    assert dict(notice.facts) == {"topic": FSM_ENABLE, "route": shown}
    assert (scene.state, scene.coordinator.body.heartbeat.beat) == (State.ENABLING, Beat.ONE)


def test_the_next_enabling_tells_of_its_own_heartbeat():
    """Once each."""
    scene = Scene()
    for _ in range(2):
        scene.begin()
        scene.live(200)
        assert len(scene.told(Code.HEARTBEAT_NOT_EFFECTIVE)) == 1
        scene.coordinator.go(State.IDLE, scene.now_ns, "test")
        scene.live(20)


@pytest.mark.parametrize("fsm", [SLOW_START, READY, None])
def test_a_heartbeat_that_was_heard_is_not_complained_of(fsm):
    """The robot has left PAUSE, or its FSM is not known."""
    scene = Scene()
    scene.begin()
    scene.live(4)
    scene.fsm = fsm
    scene.live(200)
    assert scene.told(Code.HEARTBEAT_NOT_EFFECTIVE) == []


def test_the_guards_session_is_open_before_the_first_frame():
    """A guard that is still connecting is waited for, two seconds at most."""
    scene = Scene()
    scene.coordinator.guard.see(GuardSeen(pid=41, zid="", is_linked=False, at_ns=scene.now_ns))
    scene.begin()
    scene.live(50)
    assert not scene.sent
    scene.coordinator.guard.see(GuardSeen(pid=41, zid="c4", is_linked=True, at_ns=scene.now_ns))
    scene.live(2)
    assert scene.sent


def test_an_enabling_goes_on_without_a_guard_that_cannot_connect():
    """Two seconds are enough; that nobody holds the arms when this process dies is told."""
    scene = Scene()
    scene.coordinator.guard.see(GuardSeen(pid=41, zid="", is_linked=False, at_ns=scene.now_ns))
    scene.begin()
    scene.live(WAIT_NS // TICK_NS + 2)
    assert scene.sent
    assert len(scene.told(Code.GUARD_LOST)) == 1


@pytest.mark.parametrize("is_expected", [False, True])
def test_an_enabling_with_a_guard_or_without_any_says_nothing(is_expected):
    """Whoever wants none hears of none."""
    scene = Scene()
    if is_expected:
        scene.coordinator.guard.see(GuardSeen(pid=41, zid="c4", is_linked=True, at_ns=scene.now_ns))
    scene.begin()
    scene.live(60)
    assert scene.sent
    assert scene.told(Code.GUARD_LOST) == []


# ------------------------------------------------------------------------------------------------ our claim


def test_nothing_is_sent_before_the_claim_is_confirmed():
    """The armed token is out and was looked at again, only then the first frame (BEHAVIOUR, starting)."""
    scene = Scene()
    scene.coordinator.claim.is_confirmed = False
    scene.begin()
    scene.live(50)
    assert scene.sent == [] and scene.state is State.ENABLING
    scene.coordinator.claim.is_confirmed = True
    scene.live(2)
    assert len(scene.arm_frames) == 4


def test_a_claim_that_yielded_ends_the_enabling_and_names_the_other():
    """OTHER_GATEWAY; while it is only waiting for its turn nothing ends."""
    scene = Scene()
    scene.coordinator.claim.withdraw()
    scene.begin()
    scene.live(5)
    assert scene.state is State.ENABLING
    scene.coordinator.others.see_gateways([Gateway(zid="1", is_armed=True)], scene.now_ns)
    scene.live(1)
    assert scene.verdict == ("failed", Code.OTHER_GATEWAY) and "zenoh session 1" in scene.coordinator.enable.message
    assert scene.sent == []


def test_an_open_claim_is_not_ended_by_the_other_one():
    """Both are shown: which of the two yields is not known yet."""
    scene = Scene()
    scene.coordinator.claim.is_confirmed = False
    scene.coordinator.others.see_gateways([Gateway(zid="f", is_armed=True)], scene.now_ns)
    scene.begin()
    scene.live(5)
    assert scene.state is State.ENABLING


def test_a_claim_that_was_never_shown_is_what_was_missing():
    """The robot's router did not take our token."""
    scene = Scene()
    scene.coordinator.claim.is_confirmed = False
    scene.begin()
    scene.live(TIMEOUT_TICKS + 1)
    assert scene.verdict == ("failed", Code.ENABLE_TIMEOUT) and "shown our claim" in scene.coordinator.enable.message


def test_from_paused_no_heartbeat_leaves_before_the_samples_agree():
    """The echo goes on at once; the first 1.0 waits for an arm that is still being led, and it is told for what."""
    scene = Scene(State.PAUSED)
    scene.fsm = PAUSE
    scene.begin()
    for _ in range(TIMEOUT_TICKS + 1):
        scene.q_rad[R] = (scene.q_rad[R][0] + (0.03 if scene.now_ns // TICK_NS % 2 else -0.03), *scene.q_rad[R][1:])
        scene.live(1)
    assert scene.coordinator.body.heartbeat.beat is not Beat.ONE
    assert scene.verdict == ("failed", Code.ENABLE_TIMEOUT)
    assert "samples of the right arm do not agree" in scene.coordinator.enable.message


def test_a_changed_echo_leaves_before_the_first_heartbeat():
    """30 ms later, as after the first one."""
    scene = Scene()
    scene.begin()
    scene.enabling.echo_changed(scene.now_ns)  # nothing is echoed yet
    scene.live(3)
    assert scene.sent_at_ns(joint_command(L))
    scene.enabling.echo_changed(scene.now_ns)
    changed_ns = scene.now_ns
    scene.live(10)
    assert scene.sent_at_ns(FSM_ENABLE)[0] - changed_ns == 30 * MS
