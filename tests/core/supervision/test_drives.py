"""What ends the driving of chassis and lift by itself: expiry, lease, latch, state, mode, and the end of the lift's use."""

from __future__ import annotations

import pytest

from gateway.core.messages.outputs import FrameKind
from gateway.core.messages.sightings import ForeignData, Gateway
from gateway.core.supervision.drives import Drives
from gateway.core.supervision.supervisor import State
from gateway.errors import Code
from gateway.robot.topics import CHASSIS_VELOCITY, LIFT_COMMAND
from gateway.values import FsmState, Vector
from tests.changed import replace
from tests.core.stage import MODE, MS, S, Stage

ZEROS, STOPPED, OFF = (0.0, 0.0, 0.0), (0.0, 1.0), (0.0, 0.0)
FAST = (0.2, 0.0, 0.0)


class Scene(Stage):
    """A stage whose chassis and lift are looked after; ann drives both.

    Args:
        state: Where the supervisor is.
        for_ns: How long the velocities count [ns].
        model: `lite`, `standard` or `lift`.
        is_begun: Whether the first frames have left.
    """

    def __init__(
        self, state: State = State.IDLE, *, for_ns: int = 10 * S, model: str = "lift", is_begun: bool = True
    ) -> None:
        super().__init__(state, model=model)
        self.drives = Drives(self.coordinator)
        self.chassis, self.lift = self.coordinator.body.chassis, self.coordinator.body.lift
        expires_ns = self.now_ns + for_ns
        self.chassis.drive(FAST, epoch=self.epoch, expires_ns=expires_ns, now_ns=self.now_ns)
        if self.lift is not None:
            self.lift.drive(0.3, epoch=self.epoch, expires_ns=expires_ns, now_ns=self.now_ns)
        for stream in self.coordinator.body.drives if is_begun else ():
            assert stream.frame(self.now_ns) is not None

    def go_on(self, ticks: int) -> dict[str, list[tuple[FrameKind, Vector]]]:
        """Let time pass; return what was due to chassis and lift."""
        sent: dict[str, list[tuple[FrameKind, Vector]]] = {CHASSIS_VELOCITY: [], LIFT_COMMAND: []}
        for _ in range(ticks):
            self.now_ns += 10 * MS
            self.hear()
            self.drives.step(self.now_ns)
            for stream in self.coordinator.body.drives:
                frame = stream.frame(self.now_ns)
                if frame is not None:
                    sent[stream.topic].append((frame.kind, frame.values))
        return sent

    def stopped(self) -> bool:
        """Whether both were stopped at once: stop frames and nothing else in the next second."""
        sent = self.go_on(100)
        return set(sent[CHASSIS_VELOCITY]) == {(FrameKind.STOP, ZEROS)} and set(sent[LIFT_COMMAND]) <= {
            (FrameKind.STOP, STOPPED), (FrameKind.STOP, OFF)
        }  # fmt: skip

    def codes(self) -> tuple[Code | None, Code | None]:
        """Why the drives of chassis and lift ended."""
        return self.chassis.code, self.lift.code


def test_a_drive_goes_on_while_nothing_speaks_against_it():
    """And nothing is told."""
    scene = Scene()
    sent = scene.go_on(200)
    assert {kind for kind, _ in (*sent[CHASSIS_VELOCITY], *sent[LIFT_COMMAND])} == {FrameKind.MOTION}
    assert scene.codes() == (None, None) and scene.coordinator.notices == []


def test_velocities_run_out_and_it_is_told_once():
    """The chassis ramps down, the lift stops; the drives may go on (BEHAVIOUR, values: expiry)."""
    scene = Scene(for_ns=300 * MS)
    sent = scene.go_on(300)
    assert sent[CHASSIS_VELOCITY][-1] == (FrameKind.STOP, ZEROS) and not scene.chassis.running
    assert sent[LIFT_COMMAND][-1] == (FrameKind.STOP, STOPPED)
    told = [(notice.facts["part"], notice.message) for notice in scene.coordinator.notices]
    assert told == [
        ("chassis", "no velocity came in time: the chassis ramps down"),
        ("lift", "no velocity came in time: the lift stops"),
    ]
    assert scene.codes() == (None, None)


@pytest.mark.parametrize(
    ("changes", "code"),
    [({"chassis_enabled": False}, Code.CHASSIS_DISABLED), ({"api": False}, Code.MODE_VR)],
)
def test_a_chassis_that_may_not_be_driven_any_more_stops(changes, code):
    """At once, with the reason (manual §4.11.2)."""
    scene = Scene()
    scene.mode = replace(MODE, **changes)
    assert set(scene.go_on(50)[CHASSIS_VELOCITY]) == {(FrameKind.STOP, ZEROS)}
    assert scene.chassis.code is code and len(scene.told(code)) >= 1


@pytest.mark.parametrize(
    ("changes", "fsm", "code"),
    [({"lift_enabled": False}, FsmState.PAUSE, Code.LIFT_DISABLED), ({}, FsmState.ERROR, Code.FSM_ERROR)],
)
def test_a_lift_that_may_not_be_driven_any_more_stops(changes, fsm, code):
    """Its switch, or the FSM in ERROR: the robot stops it then, and we do not drive against that (manual §4.6)."""
    scene = Scene()
    scene.mode, scene.fsm = replace(MODE, **changes), int(fsm)
    sent = scene.go_on(50)
    assert set(sent[LIFT_COMMAND]) == {(FrameKind.STOP, STOPPED)} and scene.lift.code is code
    assert {kind for kind, _ in sent[CHASSIS_VELOCITY]} == {FrameKind.MOTION} and len(scene.told(code)) == 1


@pytest.mark.parametrize("fsm", [3, 6, 17])
def test_both_stop_when_the_fsm_is_somebody_elses(fsm):
    """VR or playback moves the robot itself: zeros, lift stop, and the lift is let go (BEHAVIOUR, FSM 3-6)."""
    scene = Scene()
    scene.go_on(10)
    scene.fsm = fsm
    assert scene.stopped() and scene.codes() == (Code.FSM_BUSY, Code.FSM_BUSY)
    scene.go_on(10)
    assert not scene.lift.is_in_use and not scene.lift.running


def test_an_unknown_mode_stops_both():
    """What may be driven is not known any more."""
    scene = Scene()
    scene.mode = None
    scene.go_on(310)
    assert scene.codes() == (Code.MODE_UNKNOWN, Code.MODE_UNKNOWN) and scene.stopped()


def test_a_drive_ends_with_its_lease():
    """A lost owner, a former owner, nobody: none of them drives."""
    scene = Scene()
    scene.coordinator.lease.gone("ann", scene.now_ns)
    scene.coordinator.lease.poll(scene.now_ns, 0)
    assert scene.stopped() and scene.codes() == (Code.CLIENT_LOST, Code.CLIENT_LOST)
    scene = Scene()
    scene.coordinator.lease.release("ann", scene.epoch, scene.now_ns)
    assert scene.stopped() and scene.codes() == (Code.LEASE_LOST, Code.LEASE_LOST)


def test_a_drive_ends_with_a_latch():
    """Whatever latched: motion is off."""
    scene = Scene()
    scene.coordinator.latch(Code.JOINT_ORDER, "not our robot", scene.now_ns)
    assert scene.stopped() and scene.codes() == (Code.JOINT_ORDER, Code.JOINT_ORDER)


@pytest.mark.parametrize("state", [State.PAUSED, State.STALE, State.STOPPING])
def test_a_drive_ends_in_a_state_in_which_it_could_not_begin(state):
    """The table cuts it on the way there; here nothing is left over."""
    scene = Scene()
    scene.coordinator.supervisor.move(state, scene.now_ns)
    assert scene.stopped() and None not in scene.codes()


# ------------------------------------------------------------------------------------------------ the lift's use


@pytest.mark.parametrize("state", [State.IDLE, State.ACTIVE, State.HOLDING])
def test_the_lift_is_kept_on_while_somebody_owns_the_robot(state):
    """[0,1] for as long as it takes (BEHAVIOUR, lift)."""
    scene = Scene(state, for_ns=100 * MS)
    assert scene.go_on(2000)[LIFT_COMMAND][-1] == (FrameKind.STOP, STOPPED) and scene.lift.is_in_use


@pytest.mark.parametrize(("state", "is_kept"), [(State.IDLE, False), (State.HOLDING, True), (State.ACTIVE, True)])
def test_an_unowned_lift_is_kept_only_while_the_robot_is_held(state, is_kept):
    """[0,0] when the lease is free and nothing is held."""
    scene = Scene(state, for_ns=100 * MS)
    scene.go_on(20)
    scene.coordinator.lease.release("ann", scene.epoch, scene.now_ns)
    last = scene.go_on(300)[LIFT_COMMAND][-1]
    assert last == (FrameKind.STOP, STOPPED if is_kept else OFF) and scene.lift.running is is_kept


@pytest.mark.parametrize("held", ["stale_hold", "can_resume", ""])
def test_in_a_stall_the_lift_is_kept_as_long_as_the_arms(held):
    """STALE at rest, or on the way back from it."""
    scene = Scene(State.STALE, for_ns=100 * MS)
    scene.coordinator.stale_hold = scene.coordinator.can_resume = False
    if held:
        setattr(scene.coordinator, held, True)
    scene.coordinator.lease.release("ann", scene.epoch, scene.now_ns)
    assert scene.go_on(300)[LIFT_COMMAND][-1] == (FrameKind.STOP, STOPPED if held else OFF)


@pytest.mark.parametrize("theirs", ["vr", "playback", "no transport"])
def test_a_robot_that_is_not_ours_gets_no_lift_frames_after_the_stop(theirs):
    """No [0,0] and no more [0,1] (DESIGN §8.8: not in VR, not in FSM 3-6)."""
    scene = Scene()
    if theirs == "vr":
        scene.mode = replace(MODE, api=False)
    elif theirs == "playback":
        scene.fsm = 6
        scene.lift.stop(scene.now_ns)
    else:
        scene.coordinator.transport_up = False
        scene.lift.stop(scene.now_ns)
    sent = scene.go_on(300)[LIFT_COMMAND]
    assert set(sent) == {(FrameKind.STOP, STOPPED)} and not scene.lift.running and not scene.lift.is_in_use


def test_without_a_lift_only_the_chassis_is_looked_after():
    """No frame on a topic that the model does not have."""
    scene = Scene(for_ns=100 * MS, model="standard")
    assert scene.go_on(200)[LIFT_COMMAND] == [] and not scene.chassis.running


def test_a_drive_ends_with_an_armed_gateway():
    """Both stop; while our own claim is open nothing has left yet, and the other may be the one who yields."""
    scene = Scene()
    scene.go_on(10)
    scene.coordinator.claim.is_confirmed = False
    scene.coordinator.others.see_gateways([Gateway(zid="b", is_armed=True)], scene.now_ns)
    scene.go_on(1)
    assert scene.codes() == (None, None)
    scene.coordinator.claim.is_confirmed = True
    assert scene.stopped() and scene.codes() == (Code.OTHER_GATEWAY, Code.OTHER_GATEWAY)
    assert "zenoh session b" in scene.told(Code.OTHER_GATEWAY)[0]


def test_a_drive_that_waits_for_a_claim_ends_when_the_claim_is_withdrawn():
    """The other was first: nothing of the drive has left, and nothing follows, no zeros into the other's drive."""
    scene = Scene(is_begun=False)
    scene.coordinator.others.see_gateways([Gateway(zid="b", is_armed=True)], scene.now_ns)
    scene.coordinator.claim.withdraw()
    sent = scene.go_on(200)
    assert sent == {CHASSIS_VELOCITY: [], LIFT_COMMAND: []} and not scene.lift.is_in_use
    assert scene.codes() == (Code.OTHER_GATEWAY, Code.OTHER_GATEWAY) and len(scene.told(Code.OTHER_GATEWAY)) == 2


def test_a_lift_that_somebody_else_commands_is_let_go_after_the_stop():
    """[0,1] for a second, then silence: no repetition beside his commands."""
    scene = Scene()
    at_ns = scene.now_ns
    scene.coordinator.others.see_data(ForeignData(topic=LIFT_COMMAND, zid="b", at_ns=at_ns))
    scene.lift.end(Code.STOPPED)
    scene.lift.stop(scene.now_ns)
    sent = scene.go_on(180)[LIFT_COMMAND]
    assert {values for _, values in sent} == {STOPPED} and not scene.lift.is_in_use and not scene.lift.running
