"""A pair in a chosen state of the gateway, an instant from which everything is judged, and words for what is seen then.

`scene("ACTIVE")` gives a robot that an owner named ann moves; every other state is reached as a user would reach it.
The checks look at what left the engine, at the robot and at the shown state, never into the engine.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from itertools import pairwise

import numpy as np

from gateway.core.messages.events import LinkUp, SampleArrived
from gateway.core.messages.outputs import Frame, FrameKind, Remembered
from gateway.core.robot_state.body_model import body_model
from gateway.errors import Code
from gateway.messages.requests import Disable, Enable, Move, Stop
from gateway.messages.snapshot import MotionView, TargetView
from gateway.robot.limits import HOME_Q_RAD
from gateway.robot.topics import (
    CHASSIS_VELOCITY,
    CURRENT_MODE,
    FSM_ENABLE,
    FSM_STATE,
    LIFT_COMMAND,
    arm_state,
    joint_command,
    pose_command,
)
from gateway.settings.settings import (
    ArmSettings,
    ForeignSettings,
    LinkSettings,
    LocalSettings,
    LossSettings,
    PoseSettings,
    Settings,
)
from gateway.sim.robot.settings import SimSettings
from gateway.values import Side, Vector
from tests.changed import replace
from tests.pair import COMPLIANCE_RADPNM, MS, Pair, S

__all__ = ["HOME", "LEAN", "QUICK", "REACHED_BY", "Scene", "away", "scene", "watched"]

LEAN = (*map(arm_state, Side), FSM_STATE, CURRENT_MODE)
"""State topics that matter here: fewer make a scene cheaper."""
ARM_TOPICS = {joint_command(side): side for side in Side}
HOME = HOME_Q_RAD
BASES = ("IDLE", "READ_ONLY")
QUICK = LossSettings(free_after_ns=1 * S, down_after_ns=3 * S)
"""The stages of a loss, ten and twenty times as fast as usual."""
MOVED = {FrameKind.MOTION, FrameKind.WALK}


class Scene(Pair):
    """A pair whose owner is ann, and what was seen of it since `mark`.

    Args:
        sim: Of the robot.
        remembered: What an earlier engine left.
        model: `lite`, `standard` or `lift`.
        arm: Limits and tolerances, where other ones than the usual are needed.
        pose: The same in end-effector mode.
        loss: Stages of a loss; `QUICK` where their length is not the point.
        foreign: What is done about foreign writers.
        snapshot_hz: How often a snapshot is made; `see` needs 50.
        is_modelled: Whether the engine has the body model of these settings.
        demands_endpoint: Whether nothing may move without a stop endpoint.
    """

    def __init__(
        self,
        sim: SimSettings | None = None,
        remembered: Remembered | None = None,
        *,
        model: str = "standard",
        arm: ArmSettings | None = None,
        pose: PoseSettings | None = None,
        loss: LossSettings | None = None,
        foreign: ForeignSettings | None = None,
        snapshot_hz: float = 1.0,
        is_modelled: bool = False,
        demands_endpoint: bool = False,
    ) -> None:
        settings = Settings(
            arm=arm or ArmSettings(),
            pose=pose or PoseSettings(),
            loss=loss or LossSettings(),
            foreign=foreign or ForeignSettings(),
            local=LocalSettings(snapshot_hz=snapshot_hz, demand_stop_endpoint=demands_endpoint),
            link=LinkSettings(model=model),
        )
        body = body_model(settings) if is_modelled else None
        sim = sim or SimSettings(state_period_ns=10 * MS, model=model, compliance_radpnm=COMPLIANCE_RADPNM)
        super().__init__(settings, sim, remembered, model=body)
        self.topics = LEAN
        self.epoch = 0
        self.before_last: Callable[[], object] = lambda: None
        """Called before the last step on the way into a state, for what must be old by then."""
        self.mark_ns = self.now_ns
        self.was = self.state

    def mark(self) -> None:
        """Judge from now on; what this tick already sent is the past."""
        self.mark_ns, self.was = self.now_ns + 1, self.state
        self.notices.clear()

    def up_as(self, zid: str) -> None:
        """The transport opens anew, with a session of this zenoh id."""
        self.receive(LinkUp(router_zid=self.zid, at_ns=self.now_ns, own_zid=zid))

    def tell_mode(self, **changes: object) -> None:
        """`/api/current_mode` arrives now, with changes; its next sample is up to 1 s away."""
        value = replace(self.heard[CURRENT_MODE].value, **changes)
        self.receive(SampleArrived(topic=CURRENT_MODE, value=value, received_ns=self.now_ns))

    def disable_arm(self, side: Side, *, as_mode: bool = False) -> None:
        """An arm is disabled, or put into the other control mode, and the gateway is told at once."""
        if as_mode:
            self.robot.inject({"fault": "control_mode", "side": side.value, "mode": "pose"}, self.now_ns)
            self.tell_mode(joint_mode={other: other is not side for other in Side})
        else:
            self.robot.inject({"fault": "arm_disabled", "side": side.value}, self.now_ns)
            self.tell_mode(arm_enabled={other: other is not side for other in Side})

    def push(self, side: Side, by_rad: float) -> None:
        """Move an arm's first joint by hand, in steps that no sample guard objects to; something holds it there."""
        self.robot.inject({"fault": "blocked", "side": side.value}, self.now_ns)
        steps = round(abs(by_rad) / 0.05)
        for _ in range(steps):
            self.robot.arms[side].q_rad = self.robot.arms[side].q_rad + np.array([by_rad / steps, *(0.0,) * 6])
            self.run(0.02)

    # ---------------------------------------------------------------------------------------------- what was seen

    def arm_frames(self, side: Side | None = None) -> list[tuple[int, Frame]]:
        """Arm setpoints since the mark."""
        topics = ARM_TOPICS if side is None else (joint_command(side),)
        return [(at_ns, frame) for at_ns, frame in self.frames if at_ns >= self.mark_ns and frame.topic in topics]

    def arm_kinds(self, side: Side | None = None) -> set[FrameKind]:
        """Kinds of the arm setpoints since the mark."""
        return {frame.kind for _, frame in self.arm_frames(side)}

    def values(self, topic: str) -> list[Vector]:
        """What left on a topic since the mark."""
        return [frame.values for _, frame in self.sent_on(topic, self.mark_ns)]

    @property
    def beats(self) -> list[float]:
        """Heartbeat values since the mark."""
        return [value for (value,) in self.values(FSM_ENABLE)]

    @property
    def beats_at_ns(self) -> list[int]:
        """When they left [ns]."""
        return [at_ns for at_ns, _ in self.sent_on(FSM_ENABLE, self.mark_ns)]

    @property
    def fsm(self) -> int:
        """What the robot's state machine says."""
        return self.robot.fsm.published

    def moved(self) -> bool:
        """Whether a frame since the mark could move an arm."""
        return bool(self.arm_kinds() & MOVED)

    def gap_ms(self, topic: str) -> float:
        """Worst interval between frames of a topic since the mark, the time up to now included [ms]."""
        times = [at_ns for at_ns, _ in self.sent_on(topic, self.mark_ns)]
        return max(b - a for a, b in pairwise([self.mark_ns, *times, self.now_ns])) / MS

    def speeds(self, side: Side = Side.LEFT) -> list[float]:
        """Largest joint speed between consecutive setpoints since the mark [rad/s]."""
        values = [frame.values for _, frame in self.arm_frames(side)]
        return [100.0 * max(abs(b - a) for a, b in zip(x, y, strict=True)) for x, y in pairwise(values)]

    def motion_view(self, motion_id: int) -> MotionView:
        """What a snapshot of now says about a motion."""
        return next(motion for motion in self.see().motions if motion.motion_id == motion_id)

    def target_view(self, stream_id: int) -> TargetView:
        """What a snapshot of now says about a stream of targets."""
        return next(target for target in self.see().targets if target.stream_id == stream_id)

    def told(self, code: Code) -> list[str]:
        """Messages of the notices with a code since the mark."""
        return [notice.message for notice in self.notices if notice.code is code]

    def arm_frames_now(self) -> dict[Side, Vector]:
        """The last setpoint of each arm, however old."""
        return {side: self.sent_on(joint_command(side))[-1][1].values for side in Side}

    def first_tick(self) -> list[Frame]:
        """What left in the first tick after the mark that sent anything; it must have been the very next one."""
        sent = [(at_ns, frame) for at_ns, frame in self.frames if at_ns >= self.mark_ns]
        assert sent and sent[0][0] - self.mark_ns <= 10 * MS, "nothing left in the next tick"
        return [frame for at_ns, frame in sent if at_ns == sent[0][0]]

    # ---------------------------------------------------------------------------------------------- what must be so

    def goes_down(self) -> None:
        """No arm frame any more, 0.0 at once and at 20 Hz until the robot reports PAUSE, then the base."""
        assert self.arm_frames() == [], "arm frames went on"
        zeros = [frame for frame in self.first_tick() if frame.topic == FSM_ENABLE]
        assert [frame.values for frame in zeros] == [(0.0,)], "no 0.0 in the first tick"
        self.run_until(lambda: self.engine.running_topics.count(FSM_ENABLE) == 0, 2.1)
        assert set(self.beats) == {0.0} and self.state in BASES and self.fsm == 0

    def goes_off(self) -> None:
        """No arm frame, no 1.0 and no 0.0."""
        self.run(0.3)
        assert self.arm_frames() == [] and self.beats == [] and self.state in BASES

    def brakes_and_holds(self) -> None:
        """The arms come to rest, then repeat their setpoints; 1.0 goes on; nothing of the old motion leaves."""
        self.run(0.9)
        assert self.state == "HOLDING"
        self._holds()

    def brakes_and_gives_way(self) -> None:
        """The arms come to rest, then the setpoint of the left one goes back to where it is; 1.0 goes on."""
        self.run(4.0)
        assert self.state == "HOLDING" and set(self.beats) == {1.0}
        order = {side: list(dict.fromkeys(frame.kind for _, frame in self.arm_frames(side))) for side in self.streaming}
        way = [FrameKind.BRAKE, FrameKind.HOLD, FrameKind.WALK, FrameKind.HOLD]
        assert order == {Side.LEFT: list(dict.fromkeys(way)), Side.RIGHT: way[:2]}, order

    def _holds(self) -> None:
        for side in self.streaming:
            topic = joint_command(side)
            kinds = [frame.kind for _, frame in self.arm_frames(side)]
            assert set(kinds) <= {FrameKind.BRAKE, FrameKind.HOLD} and kinds[-1] is FrameKind.HOLD, kinds
            assert self.gap_ms(topic) <= 11, f"gap of {self.gap_ms(topic)} ms on {topic}"
        assert set(self.beats) == {1.0} and self.gap_ms(FSM_ENABLE) <= 60

    def stays(self) -> None:
        """The same state goes on, and what it sends goes on."""
        before = set(self.engine.running_topics)
        self.run(0.25)
        assert self.state == self.was and set(self.engine.running_topics) - _GROUND == before - _GROUND
        if self.was == "HOLDING":
            self._holds()

    def pauses(self) -> None:
        """Arm streams go on as a hold, no 1.0, 0.0 until FSM 0."""
        self.run(0.9)
        assert self.state == "PAUSED" and set(self.beats) <= {0.0} and not self.moved()
        assert all(self.gap_ms(joint_command(side)) <= 11 for side in self.streaming)

    def stops_first(self) -> None:
        """The arms brake under 1.0; at rest 0.0 follows until FSM 0; then the base, and the arm streams end."""
        assert self.state == "STOPPING"
        self.run_until(lambda: self.state in BASES, 3.0)
        self.run(0.3)
        assert not self.moved() and self.fsm == 0 and self.engine.running_topics.count(FSM_ENABLE) == 0
        zeros_at = [at for at, value in zip(self.beats_at_ns, self.beats, strict=True) if value == 0.0]
        brakes = [at_ns for at_ns, frame in self.arm_frames() if frame.kind is FrameKind.BRAKE]
        assert zeros_at and self.beats == sorted(self.beats, reverse=True), "1.0 until rest, then 0.0"
        assert not brakes or max(brakes) < zeros_at[0], "0.0 came before the arms were at rest"

    @property
    def streaming(self) -> list[Side]:
        """Arms whose streams run."""
        running = self.engine.running_topics
        return [s for s in Side if joint_command(s) in running or pose_command(s) in running]

    @property
    def owner(self) -> str | None:
        """Who owns the robot."""
        return self.engine.owner_id


_GROUND = {CHASSIS_VELOCITY, LIFT_COMMAND}


def away(pair: Pair, side: Side, by_rad: float = 0.05) -> Vector:
    """Return a goal a little beside where an arm is."""
    return tuple(float(q) + by_rad * (-1 if n == 1 else 1) for n, q in enumerate(pair.robot.arms[side].q_rad))


def _read_only(pair: Scene) -> None:
    pair.run_until(lambda: pair.state == "READ_ONLY" and pair.knows_mode)
    pair.run(0.1)


def _vr(pair: Scene) -> None:
    _idle(pair)
    pair.robot.inject({"fault": "vr_mode"}, pair.now_ns)
    pair.run_until(lambda: pair.state == "READ_ONLY")


def _idle(pair: Scene) -> None:
    _read_only(pair)
    pair.epoch = pair.own("ann")
    pair.run(0.2)  # other gateways have seen it
    assert pair.state == "IDLE"


def _enabling(pair: Scene) -> None:
    _idle(pair)
    pair.before_last()
    pair.granted(Enable(epoch=pair.epoch), "ann")
    pair.run_until(lambda: pair.fsm == 1)
    pair.run(0.12)
    assert pair.state == "ENABLING"


def _at_rest(pair: Scene) -> None:
    _idle(pair)
    pair.granted(Enable(epoch=pair.epoch), "ann")
    pair.run_until(lambda: pair.state == "ACTIVE")
    pair.run(0.1)


def _active(pair: Scene) -> None:
    _at_rest(pair)
    pair.before_last()
    pair.granted(Move(epoch=pair.epoch, targets_rad=HOME), "ann")
    pair.run(0.4)
    assert pair.state == "ACTIVE"


def _holding(pair: Scene) -> None:
    _at_rest(pair)
    pair.granted(Stop(), "ann")
    pair.run(1.2)  # the stop of chassis and lift is over
    assert pair.state == "HOLDING"


def _paused(pair: Scene) -> None:
    _at_rest(pair)
    pair.robot.inject({"fault": "pause"}, pair.now_ns)
    pair.run_until(lambda: pair.state == "PAUSED")
    pair.run(0.3)


def _stopping(pair: Scene) -> None:
    _active(pair)
    pair.granted(Disable(epoch=pair.epoch), "ann")
    assert pair.state == "STOPPING"


def _stale(pair: Scene) -> None:
    _at_rest(pair)
    pair.is_deaf = True
    pair.run_until(lambda: pair.state == "STALE")


def _offline(pair: Scene) -> None:
    _at_rest(pair)
    pair.down()
    pair.run(0.1)


REACHED_BY: Mapping[str, Callable[[Scene], None]] = {
    "READ_ONLY": _read_only,
    "VR": _vr,
    "IDLE": _idle,
    "ENABLING": _enabling,
    "at rest": _at_rest,
    "ACTIVE": _active,
    "HOLDING": _holding,
    "PAUSED": _paused,
    "STOPPING": _stopping,
    "STALE": _stale,
    "OFFLINE": _offline,
}
"""How each state is reached. VR is READ_ONLY with an owner; `at rest` is ACTIVE without a motion, ACTIVE is in motion."""


def scene(state: str, pair: Scene | None = None) -> Scene:
    """Return a pair in a state, marked.

    Args:
        state: A key of `REACHED_BY`.
        pair: A fresh pair of another making; None for the usual one.
    """
    pair = pair or Scene()
    REACHED_BY[state](pair)
    pair.mark()
    return pair


def watched(state: str = "at rest", **options: object) -> Scene:
    """Return a scene whose snapshots come at 50 Hz; other options as `Scene` takes them."""
    return scene(state, Scene(snapshot_hz=50, **options))
