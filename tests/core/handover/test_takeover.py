"""Going on in another process's place: what is shown, what may be held, where the hold begins, and how all else ends."""

from __future__ import annotations

from itertools import pairwise

import msgspec
import pytest

from gateway.core.handover.takeover import LAST_FRAME_NS, Takeover
from gateway.core.messages.events import GuardSeen, HeldElsewhere, TakenOver
from gateway.core.messages.held import Held, HeldArm
from gateway.core.messages.outputs import Frame, FrameKind
from gateway.core.messages.sightings import ForeignData, Gateway
from gateway.core.motion.motion import plan
from gateway.core.output.frame_collector import FrameCollector
from gateway.core.streams.gate import Cleared, Gate
from gateway.core.streams.heartbeat import Beat
from gateway.core.supervision.supervisor import State, Trigger
from gateway.errors import Code
from gateway.robot.topics import CHASSIS_VELOCITY, FSM_ENABLE, LIFT_COMMAND, VARIANTS, gripper_command, joint_command
from gateway.settings.settings import ArmSettings
from gateway.values import FsmState
from tests.changed import replace
from tests.core.stage import GOAL, MIDDLE, MS, TICK_NS, L, R, S, Stage

LEFT, RIGHT = joint_command(L), joint_command(R)
READY = int(FsmState.READY)
SPEED: tuple[float, ...] = (0.5,) * 7
"""Velocity of the interrupted motion [rad/s]."""
PULL: tuple[float, ...] = (1.0, -1.0, 0.0, 0.0, 0.0, 0.0, 0.0)
"""Its acceleration [rad/s²]."""


class Scene(Stage):
    """A process that commands nothing yet, with a gate, beside a robot that is READY."""

    def __init__(self, state: State = State.READ_ONLY, *, is_guard: bool = True, **how: object) -> None:
        super().__init__(state, **{"owner": None, **how})
        self.collector = FrameCollector(
            self.coordinator, Gate(ArmSettings(), VARIANTS[str(how.get("model", "standard"))])
        )
        self.takeover = Takeover(self.coordinator, self.collector.resume, is_guard=is_guard)
        self.body = self.coordinator.body
        self.fsm = READY
        self.hear()

    def held(self, **facts: object) -> Held:
        """What a daemon showed 10 ms ago, in the middle of a motion of both arms."""
        arms = {
            side: HeldArm(topic=joint_command(side), values=MIDDLE[side], rate=SPEED, acceleration=PULL)
            for side in (L, R)
        }
        shown = {"at_ns": self.now_ns, "last_frame_ns": self.now_ns, "state": "ACTIVE", "beat": "one", "arms": arms}
        return Held(**(shown | {"is_owed": True} | facts))

    def take(self, held: Held) -> None:
        """The other process has ended."""
        self.takeover.hear(TakenOver(held=held, at_ns=self.now_ns), self.now_ns)

    def tick(self, ticks: int = 1) -> list[Cleared]:
        """Let time pass; return what left."""
        left: list[Cleared] = []
        for _ in range(ticks):
            self.now_ns += TICK_NS
            self.hear()
            self.takeover.step(self.now_ns)
            left += self.collector.frames(self.now_ns, stops_only=False)
        return left


def on(frames: list[Cleared], topic: str) -> list[Frame]:
    """The frames on one topic."""
    return [frame for frame in frames if frame.topic == topic]


# ------------------------------------------------------------------------------------------------ what is shown


def test_nothing_is_shown_of_a_process_that_sends_nothing():
    """A guard has nothing to go on with."""
    scene = Scene()
    shown = scene.takeover.show(scene.now_ns)
    assert shown.is_silent
    assert (shown.at_ns, shown.state, shown.last_frame_ns) == (scene.now_ns, "READ_ONLY", 0)


def test_each_running_arm_is_shown_with_its_last_setpoint_velocity_and_acceleration():
    """And when the newest setpoint left."""
    scene = Scene(State.ACTIVE, model="lift", owner="ann")
    for side in (L, R):
        scene.collector.resume(joint_command(side), MIDDLE[side], (0.0,) * 7)  # this gate did not see them start
    references = {side: scene.body.arms[side].reference for side in (L, R)}
    for side, path in plan(references, {side: GOAL[side] for side in (L, R)}, 1.0).items():
        scene.body.arms[side].follow_path(path, scene.epoch)
    scene.tick(20)
    scene.body.arms[R].stop()
    scene.body.ground_stop(scene.now_ns)
    shown = scene.takeover.show(scene.now_ns)
    assert set(shown.arms) == {L}
    arm, reference = shown.arms[L], references[L]
    assert (arm.topic, arm.values, arm.rate, arm.acceleration) == (
        LEFT,
        reference.values,
        reference.rates,
        reference.forces,
    )
    assert any(arm.rate)
    assert (shown.state, shown.beat, shown.is_owed, shown.last_frame_ns) == ("ACTIVE", "one", True, scene.now_ns)
    assert (shown.has_chassis, shown.has_lift, shown.epoch) == (True, True, scene.epoch)


def test_an_arm_that_has_sent_nothing_yet_is_not_shown():
    """Its start is known to nobody but itself."""
    scene = Scene(State.IDLE, owner="ann")
    scene.body.arms[L].start(MIDDLE[L], scene.now_ns)
    assert scene.takeover.show(scene.now_ns).arms == {}


def test_a_drive_of_which_nothing_has_left_is_not_shown_and_its_stop_is():
    """Zeros after a drive that still waits for its turn would stop somebody else's chassis; a stop that is owed is ours."""
    scene = Scene(State.IDLE, model="lift", owner="ann")
    for stream in (scene.body.chassis, scene.body.lift):
        assert stream.renew(scene.epoch, scene.now_ns + S, scene.now_ns, 0) is None
    waiting = scene.takeover.show(scene.now_ns)
    assert (waiting.has_chassis, waiting.has_lift, waiting.is_sending) == (False, False, False)
    scene.body.ground_stop(scene.now_ns)
    stopping = scene.takeover.show(scene.now_ns)
    assert (stopping.has_chassis, stopping.has_lift, stopping.is_sending) == (True, True, True)


# ------------------------------------------------------------------------------------------------ what may be held


@pytest.mark.parametrize("state", ["ACTIVE", "HOLDING", "STOPPING"])
def test_a_hold_goes_on_exactly_where_the_last_setpoint_was_and_brakes(state):
    """The gate judges the first frame by the last one of the other process: no step, whatever moved."""
    scene = Scene()
    scene.take(scene.held(state=state))
    assert scene.takeover.refused == ""
    assert scene.state is (State.STOPPING if state == "STOPPING" else State.HOLDING)
    frames = scene.tick(100)
    setpoints = [MIDDLE[L], *(frame.values for frame in on(frames, LEFT))]
    assert {frame.kind for frame in on(frames, LEFT)} == {FrameKind.BRAKE, FrameKind.HOLD}
    steps = [b[0] - a[0] for a, b in pairwise(setpoints)]
    assert steps[0] == pytest.approx(SPEED[0] * 0.01, rel=0.02)
    assert max(map(abs, steps)) <= 0.01 and steps[-1] == 0.0
    assert Code.GATE_VIOLATION not in scene.coordinator.supervisor.latches
    assert [frame.values for frame in on(frames, FSM_ENABLE)][:1] == [(1.0,)]


def test_a_taken_hold_is_unowned_and_its_clock_begins_anew():
    """60 s for a daemon; the guard's own settings say 10 s."""
    scene = Scene(is_guard=False)
    scene.take(scene.held())
    lease = scene.coordinator.lease.view(scene.now_ns)
    assert (lease.owned, lease.down_in_ns) == (False, scene.coordinator.settings.loss.down_after_ns)
    assert scene.coordinator.enable.outcome == "ok"
    assert scene.told(Code.TAKEN_OVER) == ["held in the place of a process that was in ACTIVE"]


def test_chassis_and_lift_stop_where_they_ran():
    """And nowhere else: [0,1] would switch a lift's servo on."""
    scene = Scene(model="lift")
    scene.take(scene.held(has_chassis=True, has_lift=True))
    frames = scene.tick(200)
    assert {frame.values for frame in on(frames, CHASSIS_VELOCITY)} == {(0.0, 0.0, 0.0)}
    assert {frame.values for frame in on(frames, LIFT_COMMAND)} == {(0.0, 1.0)}
    assert scene.body.lift.running and not scene.body.chassis.running
    other = Scene(model="lift")
    other.take(other.held())
    topics = {frame.topic for frame in other.tick(3)}
    assert not topics & {CHASSIS_VELOCITY, LIFT_COMMAND} and LEFT in topics


def test_a_lift_that_was_on_is_kept_on_while_the_hold_goes_on():
    """[0,1] is repeated, as the robot would take the servo off after 3 s of silence (manual §4.6)."""
    scene = Scene(model="lift")
    scene.take(scene.held(has_lift=True))
    assert {frame.values for frame in on(scene.tick(300), LIFT_COMMAND)} == {(0.0, 1.0)}
    assert scene.coordinator.body.lift.running


def test_a_gripper_goes_on_with_the_value_that_was_sent_last():
    """Constant, from the first tick on and never 0.10 between: the grip is kept (manual §4.4)."""
    scene = Scene()
    scene.take(scene.held(grippers={L: 0.8}))
    frames = scene.tick(20)
    assert {(frame.kind, frame.values) for frame in on(frames, gripper_command(L))} == {(FrameKind.HOLD, (0.8,))}
    assert {frame.values for frame in on(frames, gripper_command(R))} == {(0.1,)}
    shown = scene.takeover.show(scene.now_ns)
    assert shown.grippers == {L: 0.8, R: 0.1} and scene.coordinator.supervisor.latches == {}


def test_a_model_without_a_lift_has_none_to_stop():
    """Whatever was shown."""
    scene = Scene()
    scene.take(scene.held(has_lift=True))
    assert on(scene.tick(3), LIFT_COMMAND) == []


def test_an_arm_that_was_disabled_is_left_out():
    """The other one is held."""
    scene = Scene()
    scene.say_mode(arm_enabled={L: True, R: False})
    scene.take(scene.held())
    assert (scene.takeover.refused, scene.coordinator.sides) == ("", (L,))


def vr(scene: Scene) -> None:
    """The robot was switched to VR."""
    scene.say_mode(api=False)


def deaf(scene: Scene) -> None:
    """No state for a while."""
    scene.now_ns += 120 * MS


def unlinked(scene: Scene) -> None:
    """No transport."""
    scene.coordinator.transport_up = False


def paused(scene: Scene) -> None:
    """The robot has paused."""
    scene.fsm = int(FsmState.PAUSE)
    scene.hear()


def modeless(scene: Scene) -> None:
    """The mode has not been heard."""
    scene.mode = None
    scene.coordinator.store.reset()
    scene.hear()


def busy(scene: Scene) -> None:
    """This process commands the robot itself."""
    scene.coordinator.go(State.HOLDING, scene.now_ns, "test")


def disabled(scene: Scene) -> None:
    """Both arms were disabled."""
    scene.say_mode(arm_enabled={L: False, R: False})


@pytest.mark.parametrize(
    ("happens", "why"),
    [
        (vr, "VR mode"),
        (deaf, "older than 100 ms"),
        (unlinked, "no transport"),
        (paused, "FSM is 0, not READY"),
        (modeless, "current_mode is unknown"),
        (busy, "this process is in HOLDING"),
        (disabled, "none of its arms"),
    ],
)
def test_what_the_robot_says_against_a_hold(happens, why):
    """Each alone; nothing is sent to an arm then."""
    scene = Scene()
    held = scene.held()
    happens(scene)
    scene.take(msgspec.structs.replace(held, last_frame_ns=scene.now_ns))
    assert why in scene.takeover.refused
    assert not scene.body.running_arms


@pytest.mark.parametrize("state", ["OFFLINE", "READ_ONLY", "IDLE", "ENABLING", "PAUSED", "STALE"])
def test_from_no_other_state_a_hold_goes_on(state):
    """What was not held by the robot cannot be held on."""
    scene = Scene()
    scene.take(scene.held(state=state))
    assert scene.takeover.refused == f"it was in {state}"
    assert scene.state is State.READ_ONLY


@pytest.mark.parametrize(
    "facts", [{"beat": "zero"}, {"beat": "silent"}, {"arms": {}}], ids=["ending", "silent", "armless"]
)
def test_without_setpoints_and_heartbeat_there_is_nothing_to_hold(facts):
    """A daemon that was ending the robot's motion is not overruled."""
    scene = Scene()
    scene.take(scene.held(**facts))
    assert scene.takeover.refused == "no setpoints with a heartbeat were out"


def test_a_setpoint_of_150_ms_ago_is_no_reference():
    """The robot has stopped the arms by itself (manual §4.3)."""
    scene = Scene()
    held = scene.held()
    scene.run(LAST_FRAME_NS // TICK_NS - 1)
    scene.take(held)
    assert scene.takeover.refused == ""
    late = Scene()
    held = late.held()
    late.run(LAST_FRAME_NS // TICK_NS)
    late.take(held)
    assert "its last setpoint is 150 ms old" in late.takeover.refused


def test_a_setpoint_that_cannot_brake_inside_the_limits_is_not_gone_on_with():
    """Neither arm is held then: one of two would be half a robot."""
    scene = Scene()
    held = scene.held()
    bad = msgspec.structs.replace(held.arms[R], values=(99.0, *MIDDLE[R][1:]))
    scene.take(msgspec.structs.replace(held, arms={L: held.arms[L], R: bad}))
    assert "cannot brake inside the limits" in scene.takeover.refused
    assert not scene.body.running_arms


@pytest.mark.parametrize("state", ["ACTIVE", "IDLE"])
def test_what_was_latched_stays_latched(state):
    """A stop of the last instant may not have reached the disk; one of a later release is somebody else's to know."""
    scene = Scene()
    assert scene.takeover.show(scene.now_ns).latches == ()
    scene.take(scene.held(state=state, latches=("ESTOP", "STOPPED_BY_OTHER", "OF_NEXT_YEAR")))
    assert set(scene.coordinator.supervisor.latches) == {Code.ESTOP, Code.STOPPED_BY_OTHER}
    assert scene.takeover.show(scene.now_ns).latches == ("ESTOP", "STOPPED_BY_OTHER")


@pytest.mark.parametrize("latches", [("ESTOP",), ()], ids=["there", "here"])
def test_beside_a_latched_estop_nothing_is_held(latches):
    """Wherever it was latched: a hold is 1.0, which restarts the robot. The 0.0 that is being repeated goes on."""
    scene = Scene(is_guard=False)
    if not latches:
        scene.coordinator.fire(Trigger.ESTOP, scene.now_ns, "estop() by ann")
    scene.take(scene.held(latches=latches))
    assert scene.takeover.refused == "an e-stop is latched"
    assert {frame.values for frame in on(scene.tick(60), FSM_ENABLE)} == {(0.0,)}
    assert scene.body.heartbeat.is_estop is not bool(latches) and scene.coordinator.is_estop_unheard


# ------------------------------------------------------------------------------------------------ how all else ends


def test_what_is_not_held_ends_with_0_0_and_stop_frames():
    """0.0 until FSM 0, zeros for a second, the lift's servo off."""
    scene = Scene(model="lift")
    scene.take(scene.held(state="ENABLING", has_chassis=True, has_lift=True))
    frames = scene.tick(130)
    assert {frame.values for frame in on(frames, FSM_ENABLE)} == {(0.0,)}
    assert {frame.values for frame in on(frames, CHASSIS_VELOCITY)} == {(0.0, 0.0, 0.0)}
    assert on(frames, LIFT_COMMAND)[-1].values == (0.0, 0.0)
    assert on(frames, LEFT) == []


def test_nothing_is_sent_that_is_not_owed():
    """A daemon that had sent no 1.0 leaves no 0.0 behind."""
    scene = Scene()
    scene.take(scene.held(state="IDLE", beat="silent", arms={}, is_owed=False, has_chassis=True))
    assert {frame.topic for frame in scene.tick(5)} == {CHASSIS_VELOCITY}


@pytest.mark.parametrize("fsm", [3, 6, 9])
def test_no_0_0_leaves_beside_vr_or_playback(fsm):
    """It would pause somebody else's robot; it stays owed."""
    scene = Scene()
    scene.fsm = fsm
    scene.hear()
    scene.take(scene.held())
    assert scene.tick(5) == []
    assert scene.body.heartbeat.is_owed


def test_no_0_0_leaves_in_vr_mode_but_an_e_stops_does():
    """An e-stop is for everybody."""
    scene = Scene()
    scene.say_mode(api=False)
    scene.take(scene.held())
    assert scene.body.heartbeat.beat is Beat.SILENT
    scene.take(scene.held(is_estop=True))
    assert scene.body.heartbeat.is_estop
    assert scene.coordinator.is_estop_unheard


@pytest.mark.parametrize(("age_ns", "topics"), [(S - 1, {"fsm", "chassis", "lift"}), (S, {"lift"}), (3 * S, set())])
def test_what_the_robots_own_watchdogs_have_ended_is_not_ended_again(age_ns, topics):
    """1 s after the last 1.0 and the last velocity, 3 s after the lift's (manual §4.5 to 4.7), it is somebody else's."""
    scene = Scene(model="lift")
    scene.take(scene.held(at_ns=scene.now_ns - age_ns, state="STALE", has_chassis=True, has_lift=True))
    names = {FSM_ENABLE: "fsm", CHASSIS_VELOCITY: "chassis", LIFT_COMMAND: "lift"}
    assert {names[frame.topic] for frame in scene.tick(5)} == topics
    assert scene.body.heartbeat.is_owed is ("fsm" in topics)


# ------------------------------------------------------------------------------------------------ a guard's hold


def test_a_guard_does_not_wait_out_a_stall():
    """Stale state ends its hold: arms silent, 0.0."""
    scene = Scene()
    scene.take(scene.held())
    scene.tick(60)
    scene.dumb, scene.fsm, scene.mode = {L, R}, None, None
    frames = scene.tick(15)
    assert scene.state is State.STALE
    assert on(frames, FSM_ENABLE)[-1].values == (0.0,)
    assert not scene.body.running_arms


def test_a_guard_that_loses_the_transport_gives_up():
    """Nothing can be held that cannot be reached."""
    scene = Scene()
    scene.take(scene.held())
    scene.coordinator.transport_up = False
    scene.takeover.step(scene.now_ns)
    assert scene.state is State.OFFLINE


@pytest.mark.parametrize("state", [State.HOLDING, State.READ_ONLY, State.STALE])
def test_a_daemon_waits_out_a_stall_as_ever(state):
    """The rule is a guard's alone, and only while something is held."""
    scene = Scene(state, is_guard=state is not State.HOLDING)
    scene.now_ns += 1 * S
    scene.takeover.step(scene.now_ns)
    assert scene.state is state


# ------------------------------------------------------------------------------------------------ guards


def test_a_lost_guard_is_told():
    """Control goes on; the notice names how it ended."""
    scene = Scene()
    event = GuardSeen(pid=0, zid="", is_linked=False, at_ns=scene.now_ns)
    scene.takeover.hear(event, scene.now_ns)
    assert scene.told(Code.GUARD_LOST) == []
    scene.takeover.hear(replace(event, lost="signal 9"), scene.now_ns)
    assert len(scene.told(Code.GUARD_LOST)) == 1


def test_an_own_guard_that_is_connecting_is_awaited():
    """By whoever would take a hold over."""
    scene = Scene()
    assert not scene.takeover.is_guard_awaited(0)
    scene.takeover.hear(GuardSeen(pid=41, zid="", is_linked=False, at_ns=scene.now_ns), scene.now_ns)
    assert scene.takeover.is_guard_awaited(0)


def test_how_long_a_hold_goes_on_is_known():
    """So that a daemon that waits for something does not lose it."""
    scene = Scene()
    assert scene.takeover.left_ns(scene.now_ns) == 0
    scene.take(scene.held())
    assert scene.takeover.left_ns(scene.now_ns) == scene.coordinator.settings.loss.down_after_ns


def test_an_earlier_guard_that_holds_is_known():
    """Until it does so no more."""
    scene = Scene()
    for is_held in (True, False):
        scene.takeover.hear(HeldElsewhere(is_held=is_held, at_ns=scene.now_ns), scene.now_ns)
        assert scene.coordinator.guard.earlier_holds is is_held


# ------------------------------------------------------------------------------------------------ others


def test_the_process_that_is_gone_is_no_stranger():
    """Its armed token was the last, its data has just come; and a guard is ours from its first word on."""
    scene = Scene()
    others = scene.coordinator.others
    others.see_gateways([Gateway(zid="d0", is_armed=True)], scene.now_ns)
    others.see_gateways([], scene.now_ns)  # its token has gone with it
    others.see_data(ForeignData(topic=LEFT, zid="d0", at_ns=scene.now_ns))
    scene.take(scene.held())
    assert scene.state is State.HOLDING and others.objection(scene.now_ns) is None
    scene.takeover.hear(GuardSeen(pid=7, zid="9a", is_linked=True, at_ns=scene.now_ns), scene.now_ns)
    assert {"d0", "9a"} <= set(others.friends)


def test_beside_a_foreign_writer_nothing_is_held():
    """Two would command the robot: what was on the wire ends."""
    scene = Scene()
    scene.coordinator.others.see_data(ForeignData(topic=LEFT, zid="b", at_ns=scene.now_ns))
    scene.take(scene.held())
    assert scene.state is not State.HOLDING and "zenoh session b" in scene.takeover.refused


def test_a_latch_of_another_process_is_taken_over_and_told_once():
    """A stop at the guard's socket refuses motion in the next daemon."""
    scene = Scene()
    for _ in range(2):
        scene.takeover.latch(Code.STOPPED_BY_OTHER, "smoke", scene.now_ns)
    assert scene.coordinator.supervisor.latches == {Code.STOPPED_BY_OTHER: "smoke"}
    assert len(scene.told(Code.LATCH_CHANGED)) == 1
