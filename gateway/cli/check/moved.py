"""Rows of `ta2 check` for which something moves: pure, over what came from the robot, and went to it, in a span of time."""

from __future__ import annotations

import math
from collections.abc import Iterable

from gateway.cli.check.capture import Capture, Span
from gateway.cli.check.rows import Row, measured, row
from gateway.robot.topics import (
    CHASSIS_STATE,
    CHASSIS_VELOCITY,
    FSM_ENABLE,
    FSM_STATE,
    LIFT_COMMAND,
    arm_state,
    ee_pose,
    gripper_state,
)
from gateway.values import Side

__all__ = [
    "PAUSE",
    "RESTING_RADPS",
    "STEP_M",
    "STEP_RAD",
    "echoed",
    "gripped",
    "lifted",
    "moved_back",
    "paused",
    "rolled_out",
]

S = 1_000_000_000
STEP_RAD, STEP_M = 0.05, 0.02
"""How far a joint is moved [rad], and an end effector, towards its shoulder [m] (choice)."""
RESTING_RADPS = 0.05
"""Slower than this a wheel is at rest [rad/s] (choice)."""
PAUSE = 0


def echoed(capture: Capture, sides: Iterable[Side], span: Span) -> Row:
    """Return whether arms stayed where they were while they were sent there (manual §6.2)."""
    ways = [[list(message.position) for _, message in capture.messages(arm_state(side), span)] for side in sides]
    gone = [abs(q - q0) for way in ways for q_rad in way for q, q0 in zip(q_rad, way[0], strict=False)]
    return measured("echo", max(gone, default=None), "the furthest")


def moved_back(capture: Capture, side: Side, joint: int | None, step: float, span: Span) -> Row:
    """Return whether an arm went as far as it was told, that way, and back.

    Args:
        capture: What came.
        side: Which arm.
        joint: Which joint, from 0; None for the distance of the end effector from its shoulder.
        step: How far, with its sign [rad or m].
        span: From the beginning to the end of the way back.
    """
    if joint is None:
        points = [message.position for _, message in capture.messages(ee_pose(side), span)]
        way = [math.hypot(p.x, p.y, p.z) for p in points]
    else:
        way = [message.position[joint] for _, message in capture.messages(arm_state(side), span)]
    if not way:
        return row(f"move_{side}", "unknown", "nothing came of it")
    gone, left = max((at - way[0] for at in way), key=lambda by: by * step), abs(way[-1] - way[0])
    what = f"{'the end effector' if joint is None else f'joint {joint + 1}'} by {step:+g} {'m' if joint is None else 'rad'}"
    wrong = f"{what}, and it is still {left:.3f} off" if left > abs(step) / 5 else ""
    return measured(f"move_{side}", gone / step, what, wrong=wrong)


def gripped(capture: Capture, side: Side, span: Span) -> Row:
    """Return whether a gripper pulled when it was told to open."""
    pulls = [message.effort[0] for _, message in capture.messages(gripper_state(side), span)]
    return measured(f"gripper_{side}", max(pulls, default=None), "the torque that opens")


def paused(name: str, capture: Capture, span: Span) -> Row:
    """Return whether the robot paused: told so (`disable`), or by itself without a heartbeat (`heartbeat`, manual §4.7)."""
    sent = [(at_ns, message.data) for at_ns, message in capture.messages(FSM_ENABLE, span)]
    zeros = [at_ns for at_ns, value in sent if value == 0.0]
    if not sent or bool(zeros) != (name == "disable"):
        return row(name, "unknown", "what was seen on /api/fsm/enable is not this trial's")
    from_ns = zeros[0] if zeros else sent[-1][0]
    states = capture.messages(FSM_STATE, Span(from_ns, span.end_ns))
    figure = next(((at_ns - from_ns) / S for at_ns, message in states if message.data == PAUSE), None)
    return measured(name, figure, "until PAUSE", wrong="" if figure is not None else "it did not pause")


def rolled_out(name: str, capture: Capture, span: Span) -> Row:
    """Return whether the wheels came to rest: after zeros (`chassis_stop`), or without commands (`chassis_timeout`, §4.5)."""
    sent = [(at_ns, any(message.data)) for at_ns, message in capture.messages(CHASSIS_VELOCITY, span)]
    driven_ns = max((at_ns for at_ns, drives in sent if drives), default=span.end_ns)
    zeros = [at_ns for at_ns, drives in sent if at_ns > driven_ns and not drives]
    wheels = capture.messages(CHASSIS_STATE, span)
    if not wheels or driven_ns == span.end_ns or bool(zeros) != (name == "chassis_stop"):
        return row(name, "unknown", "what was seen on /api/chassis/velocity is not this trial's")
    rolling = [at_ns for at_ns, message in wheels if max(map(abs, message.velocity)) > RESTING_RADPS]
    if not rolling:
        return row(name, False, "the wheels did not turn", remedy="is the chassis enabled? `ta2 why`")
    if rolling[-1] == wheels[-1][0]:
        return row(name, False, "nothing has shown the wheels at rest: they roll on, or their state stopped coming")
    return measured(name, max(0, rolling[-1] - (zeros[0] if zeros else driven_ns)) / S, "until the wheels were at rest")


def lifted(capture: Capture, span: Span) -> Row:
    """Return whether the lift was told to move and to stop; nobody can measure whether it did (manual §4.12)."""
    sent = [bool(message.data[0]) for _, message in capture.messages(LIFT_COMMAND, span)]
    if not any(sent) or sent[-1]:
        return row("lift_stop", False, "no move and stop were sent", remedy="is the lift enabled? `ta2 why`")
    return row("lift_stop", "unknown", "both were sent, and no topic says where it is (§4.12)")
