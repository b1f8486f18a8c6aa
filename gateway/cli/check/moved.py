"""Rows of `ta2 check` for which something moves: pure, over what came from the robot, and went to it, in a span of time."""

from __future__ import annotations

import math
from collections.abc import Sequence

from gateway.cli.check.capture import Capture, Span
from gateway.cli.check.rows import Row, row
from gateway.robot.limits import CHASSIS_DOWN_MPS2, CHASSIS_WATCHDOG_NS, FSM_WATCHDOG_NS
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
    "DRIVE_MPS",
    "STEP_M",
    "STEP_RAD",
    "disabled",
    "echoed",
    "gripped",
    "lifted",
    "moved_back",
    "paused_alone",
    "rolled_out",
]

S = 1_000_000_000

STEP_RAD = 0.05
"""How far a joint is moved [rad] (choice)."""
STEP_M = 0.02
"""How far an end effector is moved, towards its shoulder [m] (choice)."""
DRIVE_MPS = 0.05
"""How fast the chassis drives [m/s] (choice)."""
JUMP_RAD = 0.02
"""An arm that is sent where it is stays within this [rad] (choice; the manual: no visible jump)."""
PART = 0.2
"""A way is gone, and gone back, within this part of it (choice)."""
LEAST_NM = 0.05
"""A gripper that is told to pull is measured to do so by this [N·m] (choice)."""
LATE_S = 0.5
"""So long a reaction may take to be seen, beyond the manual's time [s] (choice: 20 Hz states, and a slow host)."""
ROLLING_RADPS, RESTING_RADPS = 0.1, 0.05
"""A wheel rolls beyond the one, and is at rest below the other [rad/s] (choice)."""
PAUSE = 0


def echoed(capture: Capture, sides: Sequence[Side], span: Span) -> Row:
    """Return whether arms stayed where they were while they were sent there (manual §6.2)."""
    worst_rad = 0.0
    for side in sides:
        came = [each.q_rad for each in capture.motors(arm_state(side), span)]
        if not came:
            return row("echo", "unknown", f"nothing came of the {side} arm")
        worst_rad = max(
            worst_rad, *(abs(q - first) for joints in came for q, first in zip(joints, came[0], strict=True))
        )
    remedy = "do not go on: the robot jumps when it is enabled; ask whoever maintains it"
    return row(
        "echo",
        worst_rad <= JUMP_RAD,
        "the furthest",
        figure=worst_rad,
        bound=f"<= {JUMP_RAD:g}",
        unit="rad",
        remedy=remedy,
    )


def moved_back(capture: Capture, side: Side, joint: int | None, step: float, span: Span) -> Row:
    """Return whether an arm went as far as it was told, that way, and back.

    Args:
        capture: What came.
        side: Which arm.
        joint: Which joint, from 0; None for the end effector, towards its shoulder.
        step: How far, with its sign [rad or m].
        span: From the beginning to the end of the way back.
    """
    name, unit = f"move_{side}", "m" if joint is None else "rad"
    if joint is None:
        way = [math.hypot(*p_m) for p_m in capture.positions(ee_pose(side), span)]
    else:
        way = [each.q_rad[joint] for each in capture.motors(arm_state(side), span)]
    if not way:
        return row(name, "unknown", "nothing came of it")
    gone = max((at - way[0] for at in way), key=lambda by: by * step)
    left = way[-1] - way[0]
    good = abs(gone - step) <= PART * abs(step) and abs(left) <= PART * abs(step)
    what = "the end effector" if joint is None else f"joint {joint + 1}"
    found = f"{what} went {gone:+.3f} {unit} of {step:+.3f}, and came back within {abs(left):.3f}"
    bound = f"{step:+g} within {PART * abs(step):g}"
    return row(
        name,
        good,
        found,
        figure=gone,
        bound=bound,
        unit=unit,
        remedy="is it enabled, free, and in that mode? `ta2 why`",
    )


def gripped(capture: Capture, side: Side, span: Span) -> Row:
    """Return whether a gripper pulled when it was told to open."""
    pulls = [each.tau_nm[0] for each in capture.motors(gripper_state(side), span)]
    remedy = "its torque lives by the arm's stream (§4.4): is the arm enabled?"
    most_nm = max(pulls, default=None)
    good = "unknown" if most_nm is None else most_nm >= LEAST_NM
    return row(
        f"gripper_{side}",
        good,
        "the torque that opens",
        figure=most_nm,
        bound=f">= {LEAST_NM:g}",
        unit="N·m",
        remedy=remedy,
    )


def _paused_ns(capture: Capture, after_ns: int, until_ns: int) -> int | None:
    came = capture.numbers(FSM_STATE, Span(after_ns, until_ns))
    return next((at_ns for at_ns, value in came if int(value) == PAUSE), None)


def disabled(capture: Capture, span: Span) -> Row:
    """Return whether 0.0 on `/api/fsm/enable` paused the robot (manual §4.7)."""
    sent_ns = next((at_ns for at_ns, value in capture.numbers(FSM_ENABLE, span) if value == 0.0), None)
    if sent_ns is None:
        return row("disable", "unknown", "no 0.0 was seen on /api/fsm/enable")
    return _paused("disable", sent_ns, _paused_ns(capture, sent_ns, span.end_ns), LATE_S)


def paused_alone(capture: Capture, span: Span) -> Row:
    """Return whether the robot paused by itself when its heartbeat ended (manual §4.7).

    Args:
        capture: What came.
        span: From before the last heartbeat on.
    """
    sent = capture.numbers(FSM_ENABLE, span)
    last_ns = max((at_ns for at_ns, value in sent if value == 1.0), default=None)
    if last_ns is None or any(value == 0.0 for _, value in sent):
        return row("heartbeat", "unknown", "no heartbeat was seen" if last_ns is None else "somebody paused it")
    return _paused("heartbeat", last_ns, _paused_ns(capture, last_ns, span.end_ns), FSM_WATCHDOG_NS / S + LATE_S)


def _paused(name: str, from_ns: int, paused_ns: int | None, bound_s: float) -> Row:
    figure = None if paused_ns is None else (paused_ns - from_ns) / S
    found = "it did not pause" if figure is None else "until PAUSE was seen"
    remedy = "do not go on: the robot does not stop as the manual says"
    good = figure is not None and figure <= bound_s
    return row(name, good, found, figure=figure, bound=f"<= {bound_s:g}", unit="s", remedy=remedy)


def rolled_out(name: str, capture: Capture, span: Span) -> Row:
    """Return whether the wheels came to rest: after zeros (`chassis_stop`), or after the last command (`chassis_timeout`).

    Args:
        name: Of the row.
        capture: What came.
        span: From before the drive on.
    """
    sent = capture.arrays(CHASSIS_VELOCITY, span)
    driven = [at_ns for at_ns, velocity in sent if any(velocity)]
    wheels = [(each.at_ns, max(map(abs, each.dq_radps))) for each in capture.motors(CHASSIS_STATE, span)]
    zeros = [at_ns for at_ns, velocity in sent if driven and at_ns > driven[-1] and not any(velocity)]
    if not driven or not wheels or bool(zeros) != (name == "chassis_stop"):
        return row(name, "unknown", "the commands that were seen are not those of this trial")
    if max(speed for _, speed in wheels) < ROLLING_RADPS:
        return row(name, False, "the wheels did not turn", remedy="is the chassis enabled? `ta2 why`")
    from_ns = zeros[0] if zeros else driven[-1]
    rolling_ns = max(at_ns for at_ns, speed in wheels if speed > RESTING_RADPS)
    bound_s = (0.0 if zeros else CHASSIS_WATCHDOG_NS / S) + DRIVE_MPS / CHASSIS_DOWN_MPS2 + LATE_S
    figure = max(0, rolling_ns - from_ns) / S
    remedy = "do not drive: the chassis does not stop as the manual says"
    return row(
        name,
        figure <= bound_s,
        "until the wheels were at rest",
        figure=figure,
        bound=f"<= {bound_s:.2f}",
        unit="s",
        remedy=remedy,
    )


def lifted(capture: Capture, span: Span) -> Row:
    """Return whether the lift was told to stop; nobody can measure whether it did (manual §4.12)."""
    sent = capture.arrays(LIFT_COMMAND, span)
    moved = [at_ns for at_ns, velocity in sent if velocity[0]]
    stopped = [at_ns for at_ns, velocity in sent if moved and at_ns > moved[-1] and not velocity[0]]
    if not stopped:
        return row("lift_stop", False, "no stop was sent after it moved", remedy="is the lift enabled? `ta2 why`")
    remedy = "did you see it move a little and stop?"
    return row(
        "lift_stop", "unknown", "moved and stop were sent; no topic says where the lift is (§4.12)", remedy=remedy
    )
