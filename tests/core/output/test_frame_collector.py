"""The collector: what leaves in which order, what leaves in a late tick, and what happens when the gate refuses."""

from __future__ import annotations

import pytest

from gateway.core.messages.outputs import Frame, FrameKind
from gateway.core.motion.motion import plan
from gateway.core.output.frame_collector import FrameCollector
from gateway.core.streams.gate import Gate, GateContext
from gateway.core.supervision.supervisor import State
from gateway.errors import Code, Refusal
from gateway.robot.topics import CHASSIS_VELOCITY, FSM_ENABLE, LIFT_COMMAND, VARIANTS, joint_command
from gateway.settings.settings import ArmSettings
from tests.core.stage import GOAL, MIDDLE, TICK_NS, L, R, S, Stage

LEFT, RIGHT = joint_command(L), joint_command(R)
BEAT, WHEELS, LIFT = FSM_ENABLE, CHASSIS_VELOCITY, LIFT_COMMAND


class Watched(Gate):
    """A gate that remembers what it was asked.

    Attributes:
        asked: Frames and facts, in order.
        refusing: Topic on which every frame but a stop frame is refused.
    """

    def __init__(self, model: str) -> None:
        super().__init__(ArmSettings(), VARIANTS[model])
        self.asked: list[tuple[Frame, GateContext]] = []
        self.refusing = ""

    def clear(self, frame, context):
        self.asked.append((frame, context))
        if frame.topic == self.refusing and frame.kind is not FrameKind.STOP:
            return Refusal(code=Code.GATE_VIOLATION, message="it does not please")
        return super().clear(frame, context)


class Scene(Stage):
    """A stage whose frames leave by an collector; its streams are new, so that the gate sees them from their start."""

    def __init__(self, state: State = State.ACTIVE, model: str = "standard") -> None:
        super().__init__(State.IDLE, model=model)
        self.gate = Watched(model)
        self.collector = FrameCollector(self.coordinator, self.gate)
        self.body = self.coordinator.body
        if state is not State.IDLE:
            self.coordinator.go(State.ENABLING, self.now_ns, "test")
            for side in (L, R):
                self.body.arms[side].start(MIDDLE[side], self.now_ns)
            self.tick(3)
            self.body.heartbeat.ones(self.now_ns)
            self.coordinator.go(State.ACTIVE, self.now_ns, "test")
            self.tick(3)
            self.coordinator.go(state, self.now_ns, "test")
        self.coordinator.notices.clear()
        self.gate.asked.clear()

    def tick(self, ticks: int = 1, *, stops_only: bool = False) -> list[list[Frame]]:
        """Let time pass; return the frames of each tick."""
        left = []
        for _ in range(ticks):
            self.now_ns += TICK_NS
            self.hear()
            left.append(list(self.collector.frames(self.now_ns, stops_only=stops_only)))
        return left

    def move(self) -> None:
        """The left arm begins to move."""
        arm = self.body.arms[L]
        arm.follow_path(plan({L: arm.reference}, {L: GOAL[L]})[L], self.epoch)


def topics(frames: list[Frame]) -> list[str]:
    """Topics of frames, in order."""
    return [frame.topic for frame in frames]


def test_nothing_leaves_while_nothing_runs():
    """And the gate is not even asked."""
    scene = Scene(State.IDLE)
    assert scene.tick(20) == [[]] * 20 and scene.gate.asked == []


def test_frames_leave_arms_first():
    """So that a heartbeat never overtakes the setpoint it belongs to."""
    scene = Scene(model="lift")
    scene.body.ground_stop(scene.now_ns)
    full = max(scene.tick(5), key=len)
    assert topics(full) == [LEFT, RIGHT, BEAT, WHEELS, LIFT]


def test_every_stream_keeps_its_own_rate():
    """100 Hz arms, 20 Hz heartbeat and chassis: what is not due does not leave (DESIGN §6)."""
    scene = Scene()
    scene.body.ground_stop(scene.now_ns)
    scene.tick()  # the first zeros are due at once
    left = [topic for frames in scene.tick(50) for topic in topics(frames)]
    assert {topic: left.count(topic) for topic in (LEFT, RIGHT, BEAT, WHEELS)} == {
        LEFT: 50, RIGHT: 50, BEAT: 10, WHEELS: 10,
    }  # fmt: skip


def test_what_left_is_noted_and_what_did_not_is_not():
    """The logs of the streams show what passed the gate, with its time."""
    scene = Scene()
    before = scene.body.arms[L].log.sent
    scene.tick(10)
    assert scene.body.arms[L].log.sent == before + 10 and scene.body.arms[L].log.last_ns == scene.now_ns
    assert scene.body.chassis.log.sent == 0


@pytest.mark.parametrize("state", [State.ACTIVE, State.HOLDING, State.PAUSED, State.STOPPING])
def test_the_gate_is_told_the_facts_of_this_tick(state):
    """State, epoch and freshness, as they are now."""
    scene = Scene(state)
    scene.tick()
    assert {context for _, context in scene.gate.asked} == {
        GateContext(state=state.value, epoch=scene.epoch, fresh=True)
    }


def test_the_gate_is_told_of_latches_and_of_a_lost_owner():
    """A latch refuses motion; under a lost owner's epoch none may leave."""
    scene = Scene(State.HOLDING)
    scene.coordinator.latch(Code.TRACKING_ERROR, "blocked", scene.now_ns)
    scene.coordinator.lease.gone("ann", scene.now_ns)
    scene.tick()
    assert {context for _, context in scene.gate.asked} == {
        GateContext(state="HOLDING", epoch=0, fresh=True, latched=True)
    }


def test_the_gate_is_told_of_a_stall():
    """Constant hold frames go on while nothing is heard; without transport nothing is fresh at all."""
    scene = Scene(State.STALE)
    scene.dumb = {L, R}
    (frames, *_) = scene.tick(11)
    assert topics(frames) == [LEFT, RIGHT] and frames[0].kind is FrameKind.HOLD
    scene.coordinator.resuming = True
    scene.gate.asked.clear()
    scene.tick()
    assert {context for _, context in scene.gate.asked} == {
        GateContext(state="STALE", epoch=scene.epoch, fresh=False, stale_hold=True, resuming=True)
    }
    scene.dumb = set()
    scene.tick()
    assert scene.gate.asked[-1][1].fresh
    scene.coordinator.transport_up = False
    scene.tick()
    assert not scene.gate.asked[-1][1].fresh


def test_a_stream_that_starts_anew_may_start_elsewhere():
    """The gate forgets a stream that is silent: the arm may have moved meanwhile."""
    scene = Scene()
    for arm in scene.body.running_arms:
        arm.stop()
    scene.coordinator.go(State.ENABLING, scene.now_ns, "test")
    scene.tick()
    scene.body.arms[L].start(GOAL[L], scene.now_ns)
    assert [frame.values for frame in scene.tick()[0] if frame.topic == LEFT] == [GOAL[L]]
    assert scene.coordinator.supervisor.latches == {}


def test_a_stream_that_is_started_anew_without_a_gap_may_start_elsewhere():
    """PAUSED re-seeds at once: the first echo after a start is no step of the old motion."""
    scene = Scene(State.PAUSED)
    scene.coordinator.go(State.ENABLING, scene.now_ns, "test")
    scene.body.arms[L].start(GOAL[L], scene.now_ns)
    frames = [frame for tick in scene.tick(2) for frame in tick if frame.topic == LEFT]
    assert [(frame.kind, frame.values) for frame in frames] == [(FrameKind.ECHO, GOAL[L])] * 2
    assert scene.coordinator.supervisor.latches == {}


def test_an_echo_that_goes_on_must_go_on():
    """Only the first one is a start: a later one that is elsewhere is a jump, and latches."""
    scene = Scene(State.PAUSED)
    scene.coordinator.go(State.ENABLING, scene.now_ns, "test")
    scene.body.arms[L].start(MIDDLE[L], scene.now_ns)
    scene.tick(2)
    scene.body.arms[L].reference.seed(GOAL[L])
    assert LEFT not in topics(scene.tick()[0])
    assert set(scene.coordinator.supervisor.latches) == {Code.GATE_VIOLATION}


# ------------------------------------------------------------------------------------------------ stops only


def test_a_late_tick_gives_stop_frames_only():
    """No setpoint and no 1.0; zeros for the chassis and the lift's stop leave at once."""
    scene = Scene(model="lift")
    scene.body.ground_stop(scene.now_ns)
    assert [topics(frames) for frames in scene.tick(1, stops_only=True)] == [[WHEELS, LIFT]]
    scene.body.heartbeat.zeros(scene.now_ns)
    (frames,) = scene.tick(1, stops_only=True)
    assert [(frame.topic, frame.values) for frame in frames if frame.topic == BEAT] == [(BEAT, (0.0,))]


def test_a_late_tick_gives_no_velocity():
    """What is driven is no stop frame; its ramp does not advance without a frame either."""
    scene = Scene(State.IDLE, model="lift")
    for ground in scene.body.drives:
        ground.renew(scene.epoch, scene.now_ns + 10 * S, scene.now_ns, 0)
    scene.body.chassis.wanted = (0.2, 0.0, 0.0)
    assert {topic for frames in scene.tick(5) for topic in topics(frames)} == {WHEELS, LIFT}
    before = scene.body.chassis.commanded
    assert scene.tick(20, stops_only=True) == [[]] * 20 and scene.body.chassis.commanded == before


def test_a_setpoint_that_is_left_out_is_not_skipped():
    """The reference does not advance without a frame: a late tick delays the motion and never makes it jump."""
    scene = Scene()
    scene.move()
    scene.tick(20)
    before = scene.body.arms[L].reference.values
    assert scene.tick(5, stops_only=True) == [[]] * 5
    assert scene.body.arms[L].reference.values == before
    (frames,) = scene.tick()
    assert topics(frames)[:1] == [LEFT] and scene.coordinator.supervisor.latches == {}


# ------------------------------------------------------------------------------------------------ violations


@pytest.mark.parametrize("topic", [LEFT, RIGHT, BEAT])
def test_a_frame_that_the_gate_refuses_takes_everything_down(topic):
    """Nothing of that tick leaves but stop frames, the fault is latched, motions end (BEHAVIOUR, latches)."""
    scene = Scene()
    scene.move()
    motion = scene.body.motions.open({L: GOAL[L]}, None, S)
    scene.tick(4)
    scene.gate.refusing = topic
    left = next(frames for frames in (scene.tick()[0] for _ in range(5)) if scene.coordinator.supervisor.latches)
    assert [(frame.topic, frame.values) for frame in left] == [(BEAT, (0.0,)), (WHEELS, (0.0, 0.0, 0.0))]
    assert scene.coordinator.supervisor.latches == {Code.GATE_VIOLATION: f"{topic}: it does not please"}
    assert (motion.code, scene.body.running_arms) == (Code.GATE_VIOLATION, ())
    assert scene.state is State.IDLE


def test_stop_frames_go_on_after_a_violation():
    """0.0 until the robot pauses, zeros for a second; no arm frame any more."""
    scene = Scene()
    scene.gate.refusing = LEFT
    left = [frame for frames in scene.tick(100) for frame in frames]
    assert {frame.kind for frame in left} == {FrameKind.STOP} and set(topics(left)) == {BEAT, WHEELS}
    assert topics(left).count(WHEELS) >= 20
    assert len(scene.told(Code.LATCH_CHANGED)) == 1, "one fault, told once"


def test_a_frame_outside_its_state_never_leaves():
    """A bug that leaves a stream running at the base is caught here, whatever the modules before have done."""
    scene = Scene()
    scene.coordinator.supervisor.move(State.IDLE, scene.now_ns)
    (frames,) = scene.tick()
    assert {frame.kind for frame in frames} == {FrameKind.STOP}
    assert "allowed in" in scene.coordinator.supervisor.latches[Code.GATE_VIOLATION]


def test_the_tick_of_a_violation_stops_the_lift_too():
    """Whatever the refused frame was for: an explicit stop reaches every group at once."""
    scene = Scene(model="lift")
    scene.gate.refusing = RIGHT
    (frames,) = scene.tick()
    assert topics(frames) == [BEAT, WHEELS, LIFT] and frames[-1].values == (0.0, 1.0)


def test_a_stream_of_another_process_passes_without_an_echo():
    """Its last frame was told to the gate; without that the first frame would be a violation."""
    scene = Scene(State.HOLDING)
    arm = scene.body.arms[L]
    arm.stop()
    scene.tick()
    arm.enter(MIDDLE[L], (0.1,) * 7, (0.0,) * 7, scene.now_ns)
    scene.collector.resume(LEFT, MIDDLE[L], (0.001,) * 7)
    frames = [frame for tick in scene.tick(3) for frame in tick if frame.topic == LEFT]
    assert frames[0].kind is FrameKind.BRAKE
    assert scene.state is State.HOLDING


def test_a_drive_waits_until_other_gateways_have_seen_our_claim():
    """Stop frames do not wait, and neither do arms, which waited before they were enabled."""
    scene = Scene(State.HOLDING)
    scene.coordinator.claim.is_confirmed = False
    scene.body.chassis.drive((0.1, 0.0, 0.0), epoch=1, expires_ns=scene.now_ns + 9 * S, now_ns=scene.now_ns)
    topics = {frame.topic for frames in scene.tick(10) for frame in frames}
    assert topics == {LEFT, RIGHT, BEAT}
    scene.coordinator.claim.is_confirmed = True
    assert WHEELS in {frame.topic for frames in scene.tick(10) for frame in frames}
    scene.coordinator.claim.is_confirmed = False
    scene.body.chassis.stop(scene.now_ns)
    assert WHEELS in {frame.topic for frames in scene.tick(10) for frame in frames}


def test_what_is_not_due_holds_nothing_back():
    """A chassis that is told to stop between two heartbeats does not wait for the next one."""
    scene = Scene()
    while BEAT not in topics(scene.tick()[0]):
        pass
    scene.body.ground_stop(scene.now_ns)
    (frames,) = scene.tick()
    assert topics(frames) == [LEFT, RIGHT, WHEELS]
