"""The last look at every outgoing frame; the only place that makes a `Cleared` one.

The rules:

* The gate never repairs. A frame that fails is a bug or a fault: it does not leave, and the engine latches.
* It believes nobody: form, range, step and permission are judged from the frame, its forerunner on the same topic and
  a few facts of this tick, whatever validation, motion and streams have checked before.
* Stop frames always pass, in any state, fresh or not. No other frame of theirs has that privilege.
* A running arm stream is judged by its own grid: frames are one nominal period apart, whatever the wall time between
  them. A stream that was silent is announced with `forget`, and starts at rest with an echo of its start.

It knows neither clock nor lease nor the way a frame came about. States are compared by value (`supervisor.py`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import partial
from operator import le, sub
from typing import NamedTuple, NewType

from msgspec import Struct

from gateway.core.messages.outputs import Frame, FrameKind
from gateway.core.motion.poses.quaternion import dot, turn
from gateway.errors import Code, Refusal
from gateway.robot.limits import HARD_CHASSIS_V_MPS, HARD_CHASSIS_W_RADPS
from gateway.robot.topics import (
    CHASSIS_VELOCITY,
    FSM_ENABLE,
    LIFT_COMMAND,
    TOPICS,
    Variant,
    gripper_command,
    joint_command,
    pose_command,
)
from gateway.settings.settings import ArmSettings, ChassisSettings, PoseSettings
from gateway.values import Side, Vector

__all__ = ["Cleared", "Gate", "GateContext"]

Cleared = NewType("Cleared", Frame)
"""A frame that may leave. `robot_link.publish` takes nothing else."""

POSITION_SLACK_RAD = 1e-9
"""Rounding at a position limit [rad]."""
SPEED_SLACK = 1e-9
"""Rounding at a speed limit of the chassis [m/s, rad/s]."""
POSITION_SLACK_M = 1e-9
"""Rounding at the end of the reach [m]."""
STEP_SLACK = 1e-6
"""Rounding of first and second differences of setpoints [rad, m]."""
NORM_SLACK = 1e-6
"""How far the norm of a commanded quaternion may be from 1."""
DEFAULT_POSE = PoseSettings()
"""The limits of the end effectors unless others are configured."""
HARD_CHASSIS = ChassisSettings(v_mps=HARD_CHASSIS_V_MPS, w_radps=HARD_CHASSIS_W_RADPS)
"""The loosest limits of the chassis that can be configured (BEHAVIOUR, values)."""
LIFT_OFF: Vector = (0.0, 0.0)
"""Ends the use of the lift: servo off (manual §4.6)."""

_RUNNING = ("ACTIVE", "HOLDING", "PAUSED", "STOPPING")
_HELD = ("ENABLING", *_RUNNING)
_BASE = ("IDLE", "ENABLING", "ACTIVE", "HOLDING")

_ARM_STATES: dict[FrameKind, tuple[str, ...]] = {
    FrameKind.MOTION: ("ACTIVE",),
    FrameKind.ECHO: ("ENABLING", "ACTIVE", "HOLDING", "STOPPING"),
    FrameKind.BRAKE: _RUNNING,
    FrameKind.WALK: _RUNNING,
    FrameKind.HOLD: _HELD,
}
_SETPOINT_STATES = {**_ARM_STATES, FrameKind.ECHO: _HELD}
_STATES: dict[str, dict[FrameKind, tuple[str, ...]]] = {
    **{joint_command(side): _SETPOINT_STATES for side in Side},
    **{pose_command(side): _SETPOINT_STATES for side in Side},
    **{
        gripper_command(side): {kind: _ARM_STATES[kind] for kind in (FrameKind.MOTION, FrameKind.ECHO, FrameKind.HOLD)}
        for side in Side
    },
    CHASSIS_VELOCITY: {FrameKind.MOTION: _BASE},
    LIFT_COMMAND: {FrameKind.MOTION: _BASE},
    FSM_ENABLE: {FrameKind.BEAT: ("ENABLING", "ACTIVE", "HOLDING", "STOPPING")},
}
"""In which states a kind of frame may leave on a topic, with fresh state. Kinds that are not here never may; stop
frames are exempt. An echo in HOLDING is the start of a stream that a short stall had silenced, or of an arm that joins; in
ACTIVE or STOPPING that of one whose start the next request met in the same tick; one in PAUSED follows an arm that nobody
drives."""


class GateContext(Struct, frozen=True, kw_only=True):
    """What the gate must know of this tick.

    Attributes:
        state: Supervisor state by value, e.g. `ACTIVE`.
        epoch: The lease epoch under which motion may leave; 0 when there is none.
        fresh: Whether the robot's state is fresh.
        stale_hold: STALE for at most 0.8 s, with references at rest: constant hold frames go on.
        resuming: A short stall is over and being resumed: 1.0 and constant hold frames go on although the state is
            STALE until the arms are seeded.
        latched: Whether a latch refuses motion.
    """

    state: str
    epoch: int
    fresh: bool
    stale_hold: bool = False
    resuming: bool = False
    latched: bool = False


class _Past(NamedTuple):
    values: Vector
    step: Vector  # what it added to its forerunner (a pose: position, then rotation vector); zeros at a start


class Gate:
    """Judges frames."""

    def __init__(
        self,
        arm: ArmSettings,
        variant: Variant,
        chassis: ChassisSettings = HARD_CHASSIS,
        pose: PoseSettings = DEFAULT_POSE,
    ) -> None:
        self._arm = arm
        self._chassis = chassis
        self._pose = pose
        self._topics = variant.command_topics
        self._past: dict[str, _Past] = {}
        self._ranges: dict[str, Callable[[Vector], str]] = {
            CHASSIS_VELOCITY: self._chassis_range,
            LIFT_COMMAND: _lift_range,
            FSM_ENABLE: _switch_range,
        }
        self._steps: dict[str, Callable[[_Past, Vector, Vector], str]] = {CHASSIS_VELOCITY: self._chassis_step}
        self._differences: dict[str, Callable[[Vector, Vector], Vector]] = {}
        for side in Side:
            self._ranges[joint_command(side)] = self._joint_range(side)
            self._ranges[pose_command(side)] = self._pose_range
            self._ranges[gripper_command(side)] = _gripper_range
            self._steps[joint_command(side)] = self._joint_step
            self._steps[pose_command(side)] = self._pose_step
            self._differences[pose_command(side)] = _pose_difference

    def clear(self, frame: Frame, context: GateContext) -> Cleared | Refusal:
        """Judge a frame. Call it for the frames of a topic in the order in which they leave.

        Returns:
            The same frame, cleared; or GATE_VIOLATION with what was wrong. A refused frame leaves no trace here.
        """
        past = self._past.get(frame.topic)
        wrong = self._malformed(frame)
        step: Vector = ()
        if not wrong:
            difference = self._differences.get(frame.topic, _difference)
            step = difference(frame.values, past.values if past else frame.values)
            if frame.kind is FrameKind.STOP:
                wrong = _not_a_stop(frame)
            else:
                wrong = _not_permitted(frame, context) or self._discontinuous(frame, past, step)
        if wrong:
            return Refusal(
                code=Code.GATE_VIOLATION,
                message=f"{frame.kind.value} frame for {frame.topic} in {context.state}: {wrong}",
                field=frame.topic,
                value=str(frame.values),
            )
        self._past[frame.topic] = _Past(frame.values, step)
        return Cleared(frame)

    def resume(self, topic: str, values: Vector, step: Vector) -> None:
        """Take note that a stream of another process is gone on with: what follows is judged by its last frame.

        Args:
            topic: Command topic.
            values: Its last frame.
            step: What that frame had added to the one before.
        """
        self._past[topic] = _Past(values, step)

    def forget(self, topic: str) -> None:
        """Take note that a stream has ended: its next frame is a start, at rest."""
        self._past.pop(topic, None)

    def _malformed(self, frame: Frame) -> str:
        if frame.topic not in self._topics:
            return "this model has no such command topic (manual §1.2, §4)"
        width = TOPICS[frame.topic].width
        if len(frame.values) != width:
            return f"{len(frame.values)} values, the topic has {width} (manual {TOPICS[frame.topic].section})"
        if not all(map(math.isfinite, frame.values)):
            return "not every value is finite"
        return self._ranges[frame.topic](frame.values)

    def _discontinuous(self, frame: Frame, past: _Past | None, step: Vector) -> str:
        judge = self._steps.get(frame.topic)
        if past is None and frame.topic == CHASSIS_VELOCITY:
            past, step = _Past((0.0, 0.0, 0.0), ()), frame.values  # it drives off from rest
        if past is None:
            starts = frame.kind is FrameKind.ECHO or FrameKind.ECHO not in _STATES[frame.topic]
            return "" if starts else "a stream starts with an echo of its start"
        if frame.kind in (FrameKind.HOLD, FrameKind.ECHO) and frame.values != past.values:
            return f"it must repeat {past.values}"
        return judge(past, frame.values, step) if judge else ""

    def _joint_range(self, side: Side) -> Callable[[Vector], str]:
        bounds = tuple(zip(self._arm.lower_rad[side], self._arm.upper_rad[side], strict=True))
        lows = tuple(low - POSITION_SLACK_RAD for low, _ in bounds)
        highs = tuple(high + POSITION_SLACK_RAD for _, high in bounds)

        return partial(_joints_within, bounds, lows, highs)

    def _joint_step(self, past: _Past, q_rad: Vector, step: Vector) -> str:
        v, a, period_s = self._arm.v_radps, self._arm.a_radps2, 1.0 / self._arm.rate_hz
        steps, changes = tuple(map(abs, step)), tuple(map(abs, map(sub, step, past.step)))
        most, bound = max(steps), v * period_s + STEP_SLACK
        if most > bound:
            joint = steps.index(most) + 1
            return f"joint {joint} moves {most:.6f} rad in a period, {v} rad/s allow {bound:.6f} rad"
        most, bound = max(changes), a * period_s**2 + STEP_SLACK
        if most > bound:
            joint = changes.index(most) + 1
            return f"joint {joint} changes its step by {most:.6f} rad, {a} rad/s² allow {bound:.6f} rad"
        return ""

    def _chassis_range(self, values: Vector) -> str:
        v, w = self._chassis.v_mps + SPEED_SLACK, self._chassis.w_radps + SPEED_SLACK
        return (
            _within("vx", values[0], -v, v, "m/s", "configuration")
            or _within("vy", values[1], -v, v, "m/s", "configuration")
            or _within("wz", values[2], -w, w, "rad/s", "configuration")
        )

    def _chassis_step(self, past: _Past, values: Vector, step: Vector) -> str:
        """The robot's own ramps: a component that goes away from zero may do so by the slower of them."""
        period_s = 1.0 / TOPICS[CHASSIS_VELOCITY].rate_hz
        for name, old, new, change in zip(("vx", "vy", "wz"), past.values, values, step, strict=True):
            grows = abs(new) > abs(old) and old * new >= 0.0
            bound = (self._chassis.up_mps2 if grows else self._chassis.down_mps2) * period_s + STEP_SLACK
            if abs(change) > bound:
                return f"{name} changes by {abs(change):.6f} in a period, {bound:.6f} is allowed (manual §4.5)"
        return ""

    def _pose_range(self, values: Vector) -> str:
        reach_m, norm = math.hypot(*values[:3]), math.hypot(*values[3:])
        return _within(
            "reach", reach_m, 0.0, self._pose.reach_m + POSITION_SLACK_M, "m", "manual §4.0.4, configuration"
        ) or _within("norm of the quaternion", norm, 1.0 - NORM_SLACK, 1.0 + NORM_SLACK, "", "xyzw, manual §4.2")

    def _pose_step(self, past: _Past, values: Vector, step: Vector) -> str:
        if dot(past.values[3:], values[3:]) < 0.0:
            return "the quaternion changes its sign"
        pose, change = self._pose, _difference(step, past.step)
        dt = 1.0 / pose.rate_hz
        judged = (
            ("step", step[:3], pose.v_mps * dt, "m", "pose.v_mps"),
            ("turn", step[3:], pose.w_radps * dt, "rad", "pose.w_radps"),
            ("change of the step", change[:3], pose.a_mps2 * dt * dt, "m", "pose.a_mps2"),
            ("change of the turn", change[3:], pose.dw_radps2 * dt * dt, "rad", "pose.dw_radps2"),
        )
        for name, vector, bound, unit, source in judged:
            wrong = _within(name, math.hypot(*vector), 0.0, bound + STEP_SLACK, unit, source)
            if wrong:
                return wrong
        return ""


def _difference(values: Vector, past: Vector) -> Vector:
    return tuple(map(sub, values, past))


def _pose_difference(values: Vector, past: Vector) -> Vector:
    """Return how far a pose has moved [m] and turned, as a rotation vector about the frame's axes [rad]; shape (6,)."""
    return *map(sub, values[:3], past[:3]), *turn(past[3:], values[3:])


def _not_a_stop(frame: Frame) -> str:
    stop = TOPICS[frame.topic].stop_frame
    allowed = (stop, LIFT_OFF) if frame.topic == LIFT_COMMAND else (stop,)
    return "" if stop and frame.values in allowed else f"no stop frame of this topic, which are {allowed}"


def _not_permitted(frame: Frame, context: GateContext) -> str:
    states = _STATES[frame.topic].get(frame.kind)
    if states is None:
        return "this topic has no frames of this kind"
    if context.state == "STALE" and frame.kind is FrameKind.HOLD and context.stale_hold:
        return ""
    if not context.fresh:
        return "the robot's state is stale"
    resumes = context.state == "STALE" and context.resuming and frame.kind in (FrameKind.BEAT, FrameKind.HOLD)
    if not resumes and context.state not in states:
        return f"allowed in {', '.join(states)} only"
    if frame.kind is FrameKind.BEAT and frame.values != (1.0,):
        return "a heartbeat is 1.0 (manual §4.7)"
    if frame.kind is FrameKind.MOTION and not frame.epoch == context.epoch != 0:
        return f"its epoch {frame.epoch} is not the current one, {context.epoch}"
    if frame.kind is FrameKind.MOTION and context.latched:
        return "a latch refuses motion"
    return ""


def _within(name: str, value: float, low: float, high: float, unit: str, source: str) -> str:
    return "" if low <= value <= high else f"{name} {value!r} is outside [{low}, {high}] {unit} ({source})"


def _joints_within(bounds: Sequence[tuple[float, float]], lows: Vector, highs: Vector, q_rad: Vector) -> str:
    if all(map(le, lows, q_rad)) and all(map(le, q_rad, highs)):
        return ""
    joint = next(n for n, q in enumerate(q_rad) if not lows[n] <= q <= highs[n])
    low, high = bounds[joint]
    return f"joint {joint + 1} at {q_rad[joint]!r} rad is outside [{low}, {high}] rad (manual §4.13, configuration)"


def _gripper_range(values: Vector) -> str:
    return _within("force", values[0], 0.0, 1.0, "(normalised)", "manual §4.4")


def _lift_range(values: Vector) -> str:
    if values[0] != 0.0 and values[1] == 0.0:
        return f"velocity {values[0]!r} with the servo off"
    return _within("velocity", values[0], -1.0, 1.0, "(normalised)", "manual §4.6") or _switch_range(values[1:])


def _switch_range(values: Vector) -> str:
    return "" if values[0] in (0.0, 1.0) else f"switch {values[0]!r} is neither 0 nor 1 (manual §4.6, §4.7)"
