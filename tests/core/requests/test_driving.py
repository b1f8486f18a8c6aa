"""Requests for chassis and lift: who may, what they set in motion, what is refused without a trace."""

from __future__ import annotations

import math

import pytest
from msgspec import structs

from gateway.core.messages.outputs import FrameKind
from gateway.core.requests.authorisation import Authorisation
from gateway.core.requests.driving import Driving
from gateway.core.requests.moves import Facts
from gateway.core.supervision.supervisor import State
from gateway.errors import Code, Refusal
from gateway.messages.requests import DisableLift, DriveChassis, DriveLift, StopChassis, StopLift
from gateway.robot.topics import CHASSIS_VELOCITY, LIFT_COMMAND
from tests.changed import replace
from tests.core.stage import MODE, MS, S, Stage

ZEROS, STOPPED, OFF = (0.0, 0.0, 0.0), (0.0, 1.0), (0.0, 0.0)
MAY = (State.IDLE, State.ENABLING, State.ACTIVE, State.HOLDING)
REFUSED = {
    State.PAUSED: Code.ROBOT_PAUSED,
    State.STOPPING: Code.STOPPING,
    State.STALE: Code.STATE_STALE,
    State.OFFLINE: Code.NO_LINK,
}


class Scene(Stage):
    """A stage with a place that takes requests for chassis and lift."""

    def __init__(self, state: State = State.IDLE, model: str = "lift") -> None:
        super().__init__(state, model=model)
        self.authorisation = Authorisation(self.coordinator, self.phases.starting)
        self.driving = Driving(self.coordinator, self.authorisation)
        self.body = self.coordinator.body

    def ask(self, request: object, client: str = "ann", received_ns: int | None = None) -> Facts | Refusal:
        """Carry out a request now."""
        carry_out = {
            DriveChassis: self.driving.drive_chassis,
            StopChassis: self.driving.stop_chassis,
            DriveLift: self.driving.drive_lift,
            StopLift: self.driving.stop_lift,
            DisableLift: self.driving.disable_lift,
        }[type(request)]
        return carry_out(self.command(request, client, received_ns), request, self.now_ns)

    def drive(self, vx: float = 0.1, **how: object) -> Facts | Refusal:
        """Ask for a velocity of the chassis."""
        how = {"epoch": self.epoch, "vy_mps": 0.0, "wz_radps": 0.0, **how}
        return self.ask(DriveChassis(vx_mps=vx, **how))

    def lift(self, velocity: float = 0.3, **how: object) -> Facts | Refusal:
        """Ask for a velocity of the lift."""
        return self.ask(DriveLift(**{"epoch": self.epoch, "velocity": velocity, **how}))

    def sent(self, topic: str, ticks: int = 6) -> list[tuple[FrameKind, tuple[float, ...]]]:
        """Let time pass; return what was due on one topic."""
        return [(frame.kind, frame.values) for frame in self.run(ticks) if frame.topic == topic]


def code(answer: Facts | Refusal) -> Code:
    """The code of a refusal."""
    assert isinstance(answer, Refusal), answer
    return answer.code


@pytest.mark.parametrize("state", MAY)
def test_the_owner_drives_with_and_without_enabled_arms(state):
    """IDLE, ENABLING, ACTIVE, HOLDING: neither group depends on the FSM (manual §4.5, §4.6)."""
    scene = Scene(state)
    assert scene.drive() == {"drive_id": 1} and scene.lift() == {"drive_id": 1}
    scene.run(1)
    assert {kind for kind, _ in scene.sent(CHASSIS_VELOCITY)} == {FrameKind.MOTION}
    assert set(scene.sent(LIFT_COMMAND)) == {(FrameKind.MOTION, (0.3, 1.0))}
    assert scene.state is state


@pytest.mark.parametrize("state", REFUSED)
def test_elsewhere_it_is_refused_with_the_states_code(state):
    """And nothing leaves."""
    scene = Scene(state)
    for answer in (scene.drive(), scene.lift()):
        assert code(answer) is REFUSED[state]
    assert not scene.body.chassis.running and not scene.body.lift.running


def test_only_the_owner_with_the_current_epoch_drives_and_stops():
    """The stops for one group are the owner's; `stop()` is everybody's."""
    scene = Scene()
    requests = (
        DriveChassis(epoch=scene.epoch, vx_mps=0.1, vy_mps=0.0, wz_radps=0.0),
        StopChassis(epoch=scene.epoch),
        DriveLift(epoch=scene.epoch, velocity=0.1),
        StopLift(epoch=scene.epoch),
        DisableLift(epoch=scene.epoch),
    )
    for request in requests:
        assert code(scene.ask(request, "bob")) is Code.NOT_OWNER
        assert isinstance(scene.ask(structs.replace(request, epoch=scene.epoch + 1)), Refusal)
    assert not scene.body.chassis.running and not scene.body.lift.running


def test_a_request_from_before_a_stop_drives_nothing():
    """It must not undo the stop (DESIGN §8.5)."""
    scene = Scene()
    scene.authorisation.note_stop(scene.now_ns)
    request = DriveChassis(epoch=scene.epoch, vx_mps=0.1, vy_mps=0.0, wz_radps=0.0)
    assert code(scene.ask(request, received_ns=scene.now_ns)) is Code.STOPPED
    assert scene.ask(request, received_ns=scene.now_ns + 1) == {"drive_id": 1}


def test_what_is_latched_drives_nothing():
    """Motion is motion, on wheels, too."""
    scene = Scene()
    scene.coordinator.latch(Code.STOPPED_BY_OTHER, "bob", scene.now_ns)
    assert code(scene.drive()) is code(scene.lift()) is Code.LATCHED


@pytest.mark.parametrize(
    ("changes", "chassis", "lift"),
    [
        ({"api": False}, Code.MODE_VR, Code.MODE_VR),
        ({"chassis_enabled": False}, Code.CHASSIS_DISABLED, None),
        ({"lift_enabled": False}, None, Code.LIFT_DISABLED),
    ],
)
def test_mode_and_switches_are_asked(changes, chassis, lift):
    """As `/api/current_mode` says."""
    scene = Scene()
    scene.mode = replace(MODE, **changes)
    scene.hear()
    for answer, expected in ((scene.drive(), chassis), (scene.lift(), lift)):
        assert answer == {"drive_id": 1} if expected is None else code(answer) is expected


def test_bad_numbers_are_refused_and_the_drive_goes_on():
    """A later velocity that cannot be leaves the running one alone."""
    scene = Scene()
    scene.drive()
    scene.lift()
    for answer in (scene.drive(math.nan), scene.lift(math.inf)):
        assert code(answer) is Code.NOT_FINITE
    for answer in (scene.drive(0.4), scene.drive(expiry_ns=4 * S), scene.lift(1.5), scene.lift(expiry_ns=MS)):
        assert code(answer) is Code.OUT_OF_RANGE
    assert scene.body.chassis.wanted == (0.1, 0.0, 0.0) and scene.body.lift.commanded == 0.3


def test_a_velocity_expires_after_its_arrival():
    """0.3 s unless another time is asked for: what waited in a queue counts no longer for that."""
    scene = Scene()
    scene.drive()
    scene.lift(expiry_ns=S)
    assert scene.body.chassis.left_ns(scene.now_ns) == 300 * MS and scene.body.lift.left_ns(scene.now_ns) == S
    scene.ask(
        DriveChassis(epoch=scene.epoch, vx_mps=0.1, vy_mps=0.0, wz_radps=0.0), received_ns=scene.now_ns - 100 * MS
    )
    assert scene.body.chassis.left_ns(scene.now_ns) == 200 * MS
    scene.lift()
    assert scene.body.lift.left_ns(scene.now_ns) == 300 * MS
    scene.drive(expiry_ns=2 * S)
    assert scene.body.chassis.left_ns(scene.now_ns) == 2 * S


@pytest.mark.parametrize("group", ["chassis", "lift"])
def test_a_drive_that_was_ended_is_not_gone_on_with(group):
    """Whoever keeps his drive alive does not undo a stop; he hears what ended it (BEHAVIOUR, explicitly)."""
    scene = Scene()
    drive = scene.drive if group == "chassis" else scene.lift
    assert code(drive(drive_id=7)) is Code.UNKNOWN_STREAM
    assert drive() == drive(drive_id=1) == {"drive_id": 1}
    scene.ask(StopChassis(epoch=scene.epoch) if group == "chassis" else StopLift(epoch=scene.epoch))
    refusal = drive(drive_id=1)
    assert code(refusal) is Code.STOPPED and refusal.hint and "drive 1 of the" in refusal.message
    assert drive() == {"drive_id": 2} and code(drive(drive_id=1)) is Code.SUPERSEDED


def test_stops_leave_at_once_in_every_state():
    """The owner's stops are stop frames: no state holds them back."""
    for state in (*MAY, State.PAUSED, State.STOPPING, State.STALE):
        scene = Scene(state)
        for request in (StopChassis(epoch=scene.epoch), StopLift(epoch=scene.epoch)):
            assert scene.ask(request) == {}
        due = {frame.topic: frame.values for frame in scene.run(1) if frame.kind is FrameKind.STOP}
        assert due == {CHASSIS_VELOCITY: ZEROS, LIFT_COMMAND: STOPPED}, state


def test_disabling_the_lift_stops_it_and_takes_its_servo_off():
    """[0,1] for a second, then [0,0] (manual §4.6)."""
    scene = Scene()
    scene.lift()
    scene.run(3)
    assert scene.ask(DisableLift(epoch=scene.epoch)) == {}
    values = [values for _, values in scene.sent(LIFT_COMMAND, 200)]
    assert set(values[:-1]) == {STOPPED} and values[-1] == OFF and not scene.body.lift.running


@pytest.mark.parametrize("model", ["lite", "standard"])
def test_a_model_without_a_lift_says_so(model):
    """Its owner, at least, and first that he is not, where he is not."""
    scene = Scene(model=model)
    for request in (DriveLift(epoch=1, velocity=0.1), StopLift(epoch=1), DisableLift(epoch=1)):
        assert code(scene.ask(structs.replace(request, epoch=scene.epoch))) is Code.NO_LIFT
        assert code(scene.ask(request, "bob")) is Code.NOT_OWNER
    assert scene.drive() == {"drive_id": 1}


def test_a_drive_leaves_under_the_epoch_it_was_asked_for_under():
    """The gate lets nothing pass that a former owner set in motion."""
    scene = Scene()
    scene.drive(), scene.lift()
    frames = [frame for frame in scene.run(20) if frame.kind is not FrameKind.STOP]
    drives = {frame.topic: frame.epoch for frame in frames if frame.topic in (CHASSIS_VELOCITY, LIFT_COMMAND)}
    assert drives == {CHASSIS_VELOCITY: scene.epoch, LIFT_COMMAND: scene.epoch}
