"""The last look at every outgoing frame; the only place that makes a `Cleared` one.

The rules:

* The gate never repairs. A frame that fails is a bug or a fault: it does not leave, and the engine latches.
* It believes nobody: form, range, step and permission are judged from the frame, its forerunner on the same topic and
  a few facts of this tick, whatever door, motion and streams have checked before.
* Stop frames always pass, in any state, fresh or not. No other frame of theirs has that privilege.
* A running arm stream is judged by its own grid: frames are one nominal period apart, whatever the wall time between
  them. A stream that was silent is announced with `forget`, and starts at rest with an echo of its start.

It knows neither clock nor lease nor the way a frame came about. States are compared by value (`core/supervisor.py`).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from operator import le, sub
from typing import NamedTuple, NewType

from gateway import robot
from gateway.core.events import Frame, FrameKind
from gateway.errors import Code, Refusal
from gateway.settings import ArmSettings
from gateway.values import Side, Vector

__all__ = ["Cleared", "Gate", "GateContext"]

Cleared = NewType("Cleared", Frame)
"""A frame that may leave. `robot_link.publish` takes nothing else."""

POSITION_SLACK_RAD = 1e-9
"""Rounding at a position limit [rad]."""
STEP_SLACK = 1e-6
"""Rounding of first and second differences of setpoints [rad, m]."""
NORM_SLACK = 1e-6
"""How far the norm of a commanded quaternion may be from 1."""
POSE_V_MPS = 0.5
POSE_W_RADPS = 1.5
"""Hard bounds of end-effector speed (BEHAVIOUR, values)."""
CHASSIS_V_MPS = 0.5
CHASSIS_W_RADPS = 1.0
"""Hard bounds of chassis speed (BEHAVIOUR, values)."""
LIFT_OFF: Vector = (0.0, 0.0)
"""Ends the use of the lift: servo off (manual §4.6)."""

_RUNNING = ("ACTIVE", "HOLDING", "PAUSED", "STOPPING")
_HELD = ("ENABLING", *_RUNNING)
_BASE = ("IDLE", "ENABLING", "ACTIVE", "HOLDING")

_ARM_STATES: dict[FrameKind, tuple[str, ...]] = {
    FrameKind.MOTION: ("ACTIVE",),
    FrameKind.ECHO: ("ENABLING", "HOLDING"),
    FrameKind.BRAKE: _RUNNING,
    FrameKind.WALK: _RUNNING,
    FrameKind.HOLD: _HELD,
}
_STATES: dict[str, dict[FrameKind, tuple[str, ...]]] = {
    **{robot.joint_command(side): _ARM_STATES for side in Side},
    **{robot.pose_command(side): _ARM_STATES for side in Side},
    **{
        robot.gripper_command(side): {
            kind: _ARM_STATES[kind] for kind in (FrameKind.MOTION, FrameKind.ECHO, FrameKind.HOLD)
        }
        for side in Side
    },
    robot.CHASSIS_VELOCITY: {FrameKind.MOTION: _BASE},
    robot.LIFT_COMMAND: {FrameKind.MOTION: _BASE},
    robot.FSM_ENABLE: {FrameKind.BEAT: ("ENABLING", "ACTIVE", "HOLDING", "STOPPING")},
}
"""In which states a kind of frame may leave on a topic, with fresh state. Kinds that are not here never may; stop
frames are exempt. An echo in HOLDING is the start of a stream that a short stall had silenced."""


@dataclass(frozen=True, slots=True, kw_only=True)
class GateContext:
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
    step: Vector  # what it added to its forerunner; zeros at a start


class Gate:
    """Judges frames.

    Args:
        arm: Limits of the arms, the configured ones.
        variant: Which command topics exist.
    """

    def __init__(self, arm: ArmSettings, variant: robot.Variant) -> None:
        self._arm = arm
        self._topics = variant.command_topics
        self._past: dict[str, _Past] = {}
        self._ranges: dict[str, Callable[[Vector], str]] = {
            robot.CHASSIS_VELOCITY: _chassis_range,
            robot.LIFT_COMMAND: _lift_range,
            robot.FSM_ENABLE: _switch_range,
        }
        self._steps: dict[str, Callable[[_Past, Vector, Vector], str]] = {}
        for side in Side:
            self._ranges[robot.joint_command(side)] = self._joint_range(side)
            self._ranges[robot.pose_command(side)] = _pose_range
            self._ranges[robot.gripper_command(side)] = _gripper_range
            self._steps[robot.joint_command(side)] = self._joint_step
            self._steps[robot.pose_command(side)] = _pose_step

    def clear(self, frame: Frame, context: GateContext) -> Cleared | Refusal:
        """Judge a frame. Call it for the frames of a topic in the order in which they leave.

        Args:
            frame: What is to be sent.
            context: The facts of this tick.

        Returns:
            The same frame, cleared; or GATE_VIOLATION with what was wrong. A refused frame leaves no trace here.
        """
        past = self._past.get(frame.topic)
        wrong = self._malformed(frame)
        step: Vector = ()
        if not wrong:
            step = tuple(map(sub, frame.values, past.values)) if past else (0.0,) * len(frame.values)
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

    def forget(self, topic: str) -> None:
        """Take note that a stream has ended: its next frame is a start, at rest."""
        self._past.pop(topic, None)

    def _malformed(self, frame: Frame) -> str:
        if frame.topic not in self._topics:
            return "this model has no such command topic (manual §1.2, §4)"
        width = robot.TOPICS[frame.topic].width
        if len(frame.values) != width:
            return f"{len(frame.values)} values, the topic has {width} (manual {robot.TOPICS[frame.topic].section})"
        if not all(map(math.isfinite, frame.values)):
            return "not every value is finite"
        return self._ranges[frame.topic](frame.values)

    def _discontinuous(self, frame: Frame, past: _Past | None, step: Vector) -> str:
        judge = self._steps.get(frame.topic)
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

        def judge(q_rad: Vector) -> str:
            if all(map(le, lows, q_rad)) and all(map(le, q_rad, highs)):
                return ""
            joint = next(n for n, q in enumerate(q_rad) if not lows[n] <= q <= highs[n])
            low, high = bounds[joint]
            return f"joint {joint + 1} at {q_rad[joint]!r} rad is outside [{low}, {high}] rad (manual §4.13, configuration)"

        return judge

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


def _not_a_stop(frame: Frame) -> str:
    stop = robot.TOPICS[frame.topic].stop_frame
    allowed = (stop, LIFT_OFF) if frame.topic == robot.LIFT_COMMAND else (stop,)
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


def _gripper_range(values: Vector) -> str:
    return _within("force", values[0], 0.0, 1.0, "(normalised)", "manual §4.4")


def _chassis_range(values: Vector) -> str:
    return (
        _within("vx", values[0], -CHASSIS_V_MPS, CHASSIS_V_MPS, "m/s", "hard bound of the gateway")
        or _within("vy", values[1], -CHASSIS_V_MPS, CHASSIS_V_MPS, "m/s", "hard bound of the gateway")
        or _within("wz", values[2], -CHASSIS_W_RADPS, CHASSIS_W_RADPS, "rad/s", "hard bound of the gateway")
    )


def _lift_range(values: Vector) -> str:
    return _within("velocity", values[0], -1.0, 1.0, "(normalised)", "manual §4.6") or _switch_range(values[1:])


def _switch_range(values: Vector) -> str:
    return "" if values[0] in (0.0, 1.0) else f"switch {values[0]!r} is neither 0 nor 1 (manual §4.6, §4.7)"


def _pose_range(values: Vector) -> str:
    reach_m, norm = math.hypot(*values[:3]), math.hypot(*values[3:])
    return _within("reach", reach_m, 0.0, robot.MAX_ARM_LEN_M, "m", "manual §4.0.4") or _within(
        "norm of the quaternion", norm, 1.0 - NORM_SLACK, 1.0 + NORM_SLACK, "", "xyzw, manual §4.2"
    )


def _pose_step(past: _Past, values: Vector, _: Vector) -> str:
    period_s = 1.0 / robot.TOPICS[robot.pose_command(Side.LEFT)].rate_hz
    moved_m = math.dist(past.values[:3], values[:3])
    dot = abs(sum(a * b for a, b in zip(past.values[3:], values[3:], strict=True)))
    turned_rad = 2.0 * math.acos(min(1.0, dot))
    return _within(
        "step", moved_m, 0.0, POSE_V_MPS * period_s + STEP_SLACK, "m", "hard bound of the gateway"
    ) or _within("turn", turned_rad, 0.0, POSE_W_RADPS * period_s + STEP_SLACK, "rad", "hard bound of the gateway")
