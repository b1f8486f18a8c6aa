"""The eight invariants of the design, watched from outside: a monitor that sees every tick of a `Pair` and raises.

It trusts neither gate nor supervisor: it judges by the frames that left, the replies that were given, the samples that
arrived and the state that is shown. Numbers of the invariants are the design's (section 8).
Those of chassis, lift and grippers are in `ground_invariants.py`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from itertools import pairwise

from gateway.core.engine import Output
from gateway.core.messages.outputs import Frame, FrameKind
from gateway.errors import Code
from gateway.robot.limits import JOINT_LOWER_RAD, JOINT_UPPER_RAD, MAX_ARM_LEN_M
from gateway.robot.topics import (
    CHASSIS_VELOCITY,
    FSM_ENABLE,
    FSM_STATE,
    TOPICS,
    arm_state,
    ee_pose,
    joint_command,
    pose_command,
)
from gateway.values import ArmState, EePose, FsmState, Side, Vector
from tests.core.pose_judge import rates
from tests.ground_invariants import GROUND_TOPICS, GroundMonitor
from tests.pair import MS, Pair, S

JOINT_TOPICS = {joint_command(side): side for side in Side}
POSE_TOPICS = {pose_command(side): side for side in Side}
ARM_TOPICS = {**JOINT_TOPICS, **POSE_TOPICS}
HELD_STATES = {"ACTIVE", "HOLDING", "STOPPING"}
FRAME_STATES = {
    FrameKind.MOTION: {"ACTIVE"},
    FrameKind.ECHO: {"ENABLING", "HOLDING", "ACTIVE", "PAUSED", "STOPPING"},
    FrameKind.BRAKE: {"ACTIVE", "HOLDING", "PAUSED", "STOPPING"},
    FrameKind.WALK: {"ACTIVE", "HOLDING", "PAUSED", "STOPPING"},
    FrameKind.HOLD: {"ENABLING", "ACTIVE", "HOLDING", "PAUSED", "STOPPING", "STALE"},
    FrameKind.BEAT: {"ENABLING", "ACTIVE", "HOLDING", "STOPPING", "STALE"},
}


@dataclass
class _Arm:
    """What was sent to one arm since its last start."""

    last_ns: int = -S
    history: list[Vector] = field(default_factory=list)


class Monitor:
    """Watches a pair.

    Args:
        pair: The pair; its `on_step` becomes this monitor's.
    """

    def __init__(self, pair: Pair) -> None:
        self.pair = pair
        self.arms = {topic: _Arm() for topic in ARM_TOPICS}
        self.state = pair.state
        self.state_since_ns = pair.now_ns
        self.came_from = pair.state
        self.may_move = False
        """Whether a motion request was accepted since the gateway was last not ACTIVE."""
        self.epoch = 0
        self.last_beat: Frame | None = None
        self.last_beat_ns = -S
        self.held_since_ns: int | None = None
        self.late_until_ns = 0
        self.latches: set[Code] = set()
        self.is_recovering = False
        self.may_clip = False
        """Whether the robot was ever made to clip tighter than the manual says; our own limits are judged all the same."""
        self.checked = 0
        self.ground = GroundMonitor(pair)
        self.paused_ns = -S
        """When the FSM was last heard to be PAUSE [ns]."""
        self.told_pause = False
        """Whether somebody told the engine last that the FSM is PAUSE, and not the robot, whom `Pair.heard` has."""
        self.foreign_until_ns = 0
        """Somebody else's arm or FSM commands came less than 2 s before this [ns]."""
        self.is_beside_gateway = False
        """Whether another gateway is armed."""
        pair.on_step = self.see

    # ------------------------------------------------------------------------------------------------ told by the trace

    def note_late(self, late_ns: int) -> None:
        """The next tick is late: gap invariants do not hold around it."""
        self.late_until_ns = self.pair.now_ns + late_ns + 300 * MS

    def note_foreign(self) -> None:
        """Somebody else's command arrives now, on an arm's or the FSM's key."""
        self.foreign_until_ns = self.pair.now_ns + 2 * S

    def note_restart(self) -> None:
        """The daemon died: streams ended without a word; latches must still be there."""
        self.foreign_until_ns = 0
        self.arms = {topic: _Arm() for topic in ARM_TOPICS}
        self.may_move, self.held_since_ns, self.last_beat = False, None, None
        self.ground.note_restart()
        assert self.latches <= set(self.pair.engine.latches), "a restart cleared a latch (7)"

    # ------------------------------------------------------------------------------------------------ one tick

    def see(self, output: Output) -> None:
        """Judge one tick."""
        pair, now_ns = self.pair, self.pair.now_ns
        state = pair.state
        if self._hears(FSM_STATE, 500 * MS) == FsmState.PAUSE:
            self.paused_ns = now_ns
        self._latches(output)
        if state != self.state:
            self.state_since_ns, self.came_from = now_ns, self.state
        if state != "ACTIVE" or self.state != "ACTIVE":
            self.may_move = False
        for reply in output.replies:
            if reply.refusal is None and reply.facts.keys() & {"motion_id", "stream_id", "torque_nm"}:
                self.may_move = True
            epoch = reply.facts.get("epoch")
            if isinstance(epoch, int):
                assert epoch >= self.epoch, "an epoch was given twice (6)"
                self.epoch = epoch
        self.state = state
        for frame in output.frames:
            self.checked += 1
            self._well_formed(frame)
            self._permitted(frame, now_ns)
            self._alone(frame, now_ns)
            if frame.topic in ARM_TOPICS:
                self._continuous(frame, now_ns)
                is_asked = self.state == "ENABLING" and self.last_beat_ns > self.state_since_ns  # it may have started
                if now_ns == self.paused_ns and not is_asked:
                    self._stays_with_the_arm(frame)
            elif frame.topic == FSM_ENABLE:
                self.last_beat, self.last_beat_ns = frame, now_ns
        is_late = now_ns <= self.late_until_ns
        self.ground.see(output, state=state, epoch=self.epoch, is_latched=bool(self.latches), is_late=is_late)
        self._no_gap(now_ns)
        self._stopped_at_once(output)
        clips = any(arm.clips for arm in pair.robot.arms.values())
        assert self.may_clip or not clips, "the robot had to clip (2)"

    def _latches(self, output: Output) -> None:
        latches = set(self.pair.engine.latches)
        gone = self.latches - latches
        assert Code.GATE_VIOLATION not in latches, f"the gate had to refuse: {self.pair.engine.latches} (2, 3)"
        cleared = [reply for reply in output.replies if "cleared" in reply.facts]
        assert not gone or cleared, f"{gone} was cleared without recover (7)"
        self.latches = latches

    def _well_formed(self, frame: Frame) -> None:
        """Invariant 2."""
        assert frame.topic in self.pair.settings.link.variant.command_topics, (
            f"{frame.topic} is outside the profile (2)"
        )
        assert len(frame.values) == TOPICS[frame.topic].width, f"{frame} has a wrong length (2)"
        assert math.isfinite(sum(frame.values)), f"{frame} is not finite (2)"
        if frame.topic in POSE_TOPICS:
            assert math.hypot(*frame.values[:3]) <= MAX_ARM_LEN_M + 1e-9, f"{frame} is beyond the reach (2)"
            assert abs(math.hypot(*frame.values[3:]) - 1.0) < 1e-6, f"{frame} has no unit quaternion (2)"
        if frame.topic in JOINT_TOPICS:
            side = ARM_TOPICS[frame.topic]
            bounds = zip(JOINT_LOWER_RAD[side], frame.values, JOINT_UPPER_RAD[side], strict=True)
            assert all(low - 1e-9 <= q <= high + 1e-9 for low, q, high in bounds), f"{frame} is outside the limits (2)"

    def _permitted(self, frame: Frame, now_ns: int) -> None:
        """Invariants 3, 5, 6, 7."""
        if frame.kind is FrameKind.STOP or frame.topic in GROUND_TOPICS:
            return
        assert self.state in FRAME_STATES[frame.kind], f"{frame.kind} left in {self.state} (3)"
        age_ns = self.pair.state_age_ns
        if frame.kind is FrameKind.HOLD and self.state == "STALE":
            assert now_ns - self.state_since_ns <= 800 * MS, "hold frames go on too long in STALE (3)"
        else:
            assert age_ns is not None and age_ns <= 100 * MS, f"{frame.kind} left with state {age_ns} ns old (3)"
        if frame.kind is FrameKind.MOTION:
            assert self.may_move, "motion without an accepted request since the last stop (5, 7)"
            assert frame.epoch == self.epoch, f"motion of epoch {frame.epoch}, {self.epoch} owns (6)"
            assert not self.latches, f"motion while {self.latches} is latched (3)"

    def _alone(self, frame: Frame, now_ns: int) -> None:
        """Never two setpoints in turn, no heartbeat beside somebody else's; beside a gateway no 0.0 but an e-stop's (8)."""
        if self.is_beside_gateway or now_ns < self.foreign_until_ns:
            assert frame.topic not in ARM_TOPICS, f"{frame} left beside somebody else's commands"
            assert frame.kind is not FrameKind.BEAT, "1.0 left beside somebody else's commands"
        if self.is_beside_gateway and frame.topic == FSM_ENABLE:
            assert Code.ESTOP in self.latches, "0.0 left beside another gateway"

    def _continuous(self, frame: Frame, now_ns: int) -> None:
        """Invariant 1."""
        arm, settings = self.arms[frame.topic], self.pair.settings.arm
        side, is_pose = ARM_TOPICS[frame.topic], frame.topic in POSE_TOPICS
        is_start = frame.kind is FrameKind.ECHO and (not arm.history or arm.history[-1] != frame.values)
        if is_start:
            was_silent = now_ns - arm.last_ns > 20 * MS
            is_heard = now_ns - self.paused_ns <= 20 * MS  # one frame later, at most
            is_paused = self.state == "PAUSED" and (is_heard or self.told_pause)
            assert was_silent or is_paused or self.state == "ENABLING", "a live stream was seeded anew (1)"
            steady_ns = now_ns - self.pair.steady_since_ns[arm_state(side)]
            assert is_paused or self.came_from == "PAUSED" or steady_ns >= 290 * MS, (
                f"started after {steady_ns / MS} ms of state (1)"
            )
            if is_pose:
                self._starts_at_the_pose(side, frame.values)
            else:
                heard = self.pair.heard[arm_state(side)].value
                assert isinstance(heard, ArmState)
                bounds = zip(settings.lower_rad[side], settings.upper_rad[side], strict=True)
                inside = [min(max(q, low), high) for q, (low, high) in zip(heard.q_rad, bounds, strict=True)]
                worst = max(abs(a - b) for a, b in zip(frame.values, inside, strict=True))
                assert worst <= 0.01, f"the {side} stream starts {worst} rad from the arm (1)"
            arm.history = []
        arm.history = [*arm.history[-3:], frame.values]
        arm.last_ns = now_ns
        if is_pose:
            self._pose_steps(arm.history)
            return
        period_s = 1.0 / settings.rate_hz
        bounds = (
            ("velocity", (1.0, -1.0), settings.v_radps * period_s + 1e-6),
            ("acceleration", (1.0, -2.0, 1.0), settings.a_radps2 * period_s**2 + 2e-6),
            ("jerk", (1.0, -3.0, 3.0, -1.0), settings.j_radps3 * period_s**3 + 4e-6),
        )
        newest_first = arm.history[::-1]
        for name, weights, bound in bounds:  # finite differences of the newest setpoints
            if len(weights) > len(newest_first):
                break
            for joint in zip(*newest_first[: len(weights)], strict=True):
                difference = sum(w * q for w, q in zip(weights, joint, strict=True))
                assert abs(difference) <= bound, f"{name} limit broken: {joint[::-1]} (1)"

    def _hears(self, topic: str, within_ns: int) -> object:
        """Return what the engine has heard on a topic, while it is young enough."""
        sample = self.pair.heard.get(topic)
        age_ns = self.pair.state_age_ns
        is_young = sample is not None and self.pair.now_ns - sample.received_ns <= within_ns
        return sample.value if sample is not None and is_young and age_ns is not None and age_ns <= 100 * MS else None

    def _stays_with_the_arm(self, frame: Frame) -> None:
        """Invariant 9: while the robot's FSM is PAUSE a setpoint is where its arm is, as long as it may be there."""
        side, settings = ARM_TOPICS[frame.topic], self.pair.settings
        if self.pair.robot.faults.active("jump"):
            return  # what is heard is not believed
        arm, pose = self._hears(arm_state(side), 100 * MS), self._hears(ee_pose(side), 100 * MS)
        if frame.topic in JOINT_TOPICS and isinstance(arm, ArmState):
            bounds = list(zip(settings.arm.lower_rad[side], arm.q_rad, settings.arm.upper_rad[side], strict=True))
            if all(low - 0.05 <= q <= high + 0.05 for low, q, high in bounds):
                inside = [min(max(q, low), high) for low, q, high in bounds]
                off_rad = max(abs(a - b) for a, b in zip(frame.values, inside, strict=True))
                assert off_rad <= 0.02, f"the paused {side} reference is {off_rad} rad from the arm (9)"
        elif isinstance(arm, ArmState) and isinstance(pose, EePose) and math.hypot(*pose.p_m) <= settings.pose.reach_m:
            off_m = math.dist(pose.p_m, frame.values[:3])
            cosine = min(1.0, abs(sum(a * b for a, b in zip(pose.quat_xyzw, frame.values[3:], strict=True))))
            assert off_m <= 0.002 and 2.0 * math.acos(cosine) <= 0.02, f"the paused {side} pose is {off_m} m off (9)"

    def _starts_at_the_pose(self, side: Side, values: Vector) -> None:
        heard = self.pair.heard[ee_pose(side)].value
        assert isinstance(heard, EePose)
        reach_m = max(math.hypot(*heard.p_m), 1e-9)
        inside = [x * min(1.0, MAX_ARM_LEN_M / reach_m) for x in heard.p_m]
        off_m = math.dist(inside, values[:3])
        assert off_m <= 0.001, f"the {side} stream starts {off_m} m from the end effector (1)"

    def _pose_steps(self, history: list[Vector]) -> None:
        """Linear and angular differences, as norms; the sign of the quaternion goes on."""
        limits, dt = self.pair.settings.pose, 1.0 / self.pair.settings.pose.rate_hz
        for a, b in pairwise(history):
            assert sum(x * y for x, y in zip(a[3:], b[3:], strict=True)) > 0.0, "the quaternion changed its sign (1)"
        linear, angular = rates(history, 1.0)
        groups = (
            (linear, (limits.v_mps, limits.a_mps2, limits.j_mps3)),
            (angular, (limits.w_radps, limits.dw_radps2, limits.ddw_radps3)),
        )
        for steps, bounds in groups:
            for order, bound in enumerate(bounds, start=1):
                worst = max((math.hypot(*step) for step in steps), default=0.0)
                assert worst <= bound * dt**order + order * 1e-6, f"derivative {order} of a pose: {history} (1)"
                steps = [tuple(y - x for x, y in zip(a, b, strict=True)) for a, b in pairwise(steps)]

    def _no_gap(self, now_ns: int) -> None:
        """Invariants 4 and 8."""
        is_held = self.state in HELD_STATES and self.pair.is_up
        if not is_held:
            self.held_since_ns = None
        elif self.held_since_ns is None:
            self.held_since_ns = now_ns
        if self.held_since_ns is not None and now_ns > self.late_until_ns:
            for topic in ARM_TOPICS.keys() & set(self.pair.engine.running_topics):
                start_ns = max(self.arms[topic].last_ns, self.held_since_ns)
                assert now_ns - start_ns < 100 * MS, (
                    f"gap of {(now_ns - start_ns) / MS} ms on {topic} in {self.state} (4)"
                )
            start_ns = max(self.last_beat_ns, self.held_since_ns)
            assert now_ns - start_ns < 250 * MS, f"heartbeat gap of {(now_ns - start_ns) / MS} ms in {self.state} (4)"
        is_ours = self.state in {"IDLE", "READ_ONLY"} and self.pair.robot.api_mode
        went_silent = now_ns - max(self.last_beat_ns, self.state_since_ns) > 300 * MS
        if is_ours and went_silent and self.last_beat is not None and self.last_beat.values == (1.0,):
            fsm = self.pair.robot.fsm.published
            assert (
                fsm not in (1, 2) or now_ns - self.state_since_ns < 4 * S or self.pair.is_deaf or self.pair.is_frozen
            ), "the heartbeat ended without 0.0 (8)"

    def _stopped_at_once(self, output: Output) -> None:
        """Invariant 5: a stop's frames leave within the tick that answers it."""
        stops = [reply for reply in output.replies if "stop_undelivered" in reply.facts]
        if stops:
            left = {frame.topic for frame in output.frames if frame.kind is FrameKind.STOP}
            assert CHASSIS_VELOCITY in left, "a stop was answered and no chassis zeros left (5)"
            assert not any(frame.kind is FrameKind.MOTION for frame in output.frames), "motion beside a stop (5)"
