"""`ta2 status`: one screen of what the gateway sees, and what to do next. For scripts the same as JSON."""

from __future__ import annotations

import json
from argparse import Namespace
from collections.abc import Iterator

import msgspec
from rich.console import Console
from rich.text import Text

from gateway.api import protocol
from gateway.cli.terminal.advice import next_steps
from gateway.cli.terminal.connection import connected
from gateway.cli.terminal.ending import ExitStatus
from gateway.cli.terminal.figures import age_text, fsm_text, joints_text, rate_text, since_text, topic_text
from gateway.cli.terminal.others import is_in_the_way, other_text, others_in_order
from gateway.cli.terminal.style import MODEL_STYLES, STEP_MARKS, STEP_STYLES, state_style
from gateway.client import Health

__all__ = ["carry_out", "lines"]

SIDES = ("left", "right")

OTHERS_SHOWN = 4
"""So many others on the robot have a line each."""


def carry_out(options: Namespace) -> ExitStatus:
    """Print it.

    Raises:
        Disconnected: No gateway answers.
    """
    with connected("status", options.target, options.timeout_s) as robot:
        info, state, health = robot.info, robot.state, robot.health()
    if options.json:
        print(json.dumps(_document(info, state.view, health), ensure_ascii=False, indent=2))
        return ExitStatus.OK
    Console(highlight=False).print(*lines(info, state.view), sep="\n", soft_wrap=True)
    return ExitStatus.OK


def _document(info: protocol.Info, view: protocol.Snapshot, health: Health) -> dict[str, object]:
    return {
        "ok": health.ok,
        "health": msgspec.to_builtins(health),
        "next": [msgspec.to_builtins(step) for step in next_steps(view, info)],
        "info": msgspec.to_builtins(info),
        "snapshot": msgspec.to_builtins(view),
    }


def lines(info: protocol.Info, view: protocol.Snapshot) -> Iterator[Text]:
    """Yield the lines of the screen.

    Args:
        info: What does not change while the gateway runs.
        view: What it sees now.
    """
    link, lease, mode = view.link, view.lease, view.mode
    seen = "no link" if not link.up else f"linked, newest state {age_text(link.age_ns)} old"
    yield _row("gateway", f"release {info.version}, pid {info.pid}, {info.socket}")
    yield _row("robot", f"{info.robot} ({info.model}), {seen}", "" if link.fresh else "red")
    yield _row("state", view.shown if view.shown == view.state else f"{view.shown} ({view.state})", state_style(view))
    yield _row("FSM", fsm_text(view.fsm))
    yield _row("mode", "unknown" if mode is None else _mode(mode))
    yield _row("owner", _owner(view, lease))
    for endpoint in view.endpoints:
        yield _row("endpoint", *_endpoint(endpoint))
    others = others_in_order(view)
    for other in others[:OTHERS_SHOWN]:
        yield _row("others", other_text(other, view.at_ns), "yellow" if is_in_the_way(other) else "")
    if len(others) > OTHERS_SHOWN:
        yield _row("others", f"and {len(others) - OTHERS_SHOWN} more")
    for side in SIDES:
        yield from _arm(side, view.arms[side])
    yield _row("body model", *_model(view))
    yield _row("grippers", ", ".join(f"{side} {_gripper(view.grippers.get(side))}" for side in SIDES))
    yield _row("streams", _streams(view))
    for motion in view.motions[-2:]:
        yield _row(f"motion {motion.motion_id}", _motion(motion))
    loop = view.loop
    late = age_text(loop.worst_late_ns)
    yield _row("loop", f"{loop.ticks} ticks, {loop.skipped} skipped, at worst {late} late in the last 10 s")
    yield _row("guard", *_guard(view.guard))
    yield Text()
    for step in next_steps(view, info):
        yield Text(f"{STEP_MARKS[step.level]} {step.text}", style=STEP_STYLES[step.level])


def _row(name: str, value: str, style: str = "") -> Text:
    return Text.assemble((f"{name:<10} ", "dim"), (value, style))


def _guard(guard: protocol.GuardView) -> tuple[str, str]:
    """Return how the guard is, and in which style to say it."""
    if guard.earlier_holds:
        return "the guard of an earlier daemon holds the robot; the hold is being taken over", "yellow"
    if not guard.expected:
        return "none (--no-guard): when the gateway dies the robot's own watchdogs act, and the grip is lost", "yellow"
    lost = f", {guard.lost} lost before" if guard.lost else ""
    if not guard.pid:
        return f"gone; another one is being started{lost}", "red"
    if not guard.linked:
        return f"pid {guard.pid}, does not reach the robot{lost}", "yellow"
    return f"pid {guard.pid}, watches{lost}", ""


def _mode(mode: protocol.ModeView) -> str:
    parts = ["API" if mode.api else "VR"]
    for side in SIDES:
        kind = "joint mode" if mode.joint_mode.get(side) else "end-effector mode"
        parts.append(f"{side} arm {kind if mode.arm_enabled.get(side) else 'disabled'}")
    parts.append(f"chassis {'on' if mode.chassis_enabled else 'off'}")
    parts.append(f"lift {'on' if mode.lift_enabled else 'off'}")
    return ", ".join(parts)


def _owner(view: protocol.Snapshot, lease: protocol.LeaseView) -> str:
    if not lease.owned:
        return "nobody"
    since = since_text(view.at_ns - lease.since_ns)
    return f"{lease.name} (pid {lease.pid}) for {since}, epoch {lease.epoch}, on loss: {lease.on_loss}"


def _endpoint(endpoint: protocol.EndpointView) -> tuple[str, str]:
    """Return who must be heard, and in which style to say it."""
    does = f"{endpoint.on_silence} after {endpoint.timeout_ns / 1e9:g} s"
    text = f"{endpoint.name}, heard {age_text(endpoint.age_ns)} ago, {does}"
    return (f"{text}: SILENT, nothing moves", "red") if endpoint.is_silent else (text, "")


def _arm(side: str, arm: protocol.ArmView) -> Iterator[Text]:
    measured = arm.measured
    if measured is None:
        yield _row(f"{side} arm", "no state yet")
        return
    yield _row(f"{side} arm", f"{joints_text(measured.q_rad)} rad, {age_text(measured.age_ns)} old")
    if arm.streaming and arm.tracking_rad is not None and arm.tracking_m is not None:
        setpoint = f"{joints_text(arm.ref_p_m)} m, quaternion {joints_text(arm.ref_quat_xyzw)}"
        yield _row("  setpoint", f"{setpoint}, off by {arm.tracking_m * 1e3:.1f} mm, {arm.tracking_rad:.3f} rad")
    elif arm.streaming and arm.tracking_rad is not None:
        yield _row("  setpoint", f"{joints_text(arm.q_ref_rad)} rad, off by {arm.tracking_rad:.3f}")


def _model(view: protocol.Snapshot) -> tuple[str, str]:
    """Return how far the body model is from each arm, and the style of the worse one."""
    models = {side: model for side in SIDES if (model := view.arms[side].model) is not None}
    if not models:
        return "none (model.check = false)", ""
    words = [f"{side} {model.state}{_figures(model)}" for side, model in models.items()]
    worst = [state for state in MODEL_STYLES if any(model.state == state for model in models.values())][-1:]
    return ", ".join(words), "".join(MODEL_STYLES[state] for state in worst)


def _figures(model: protocol.ModelView) -> str:
    if model.position_m is None or model.angle_rad is None:
        return ""
    return f" ({1e3 * model.position_m:.2f} mm, {1e3 * model.angle_rad:.2f} mrad)"


def _gripper(motor: protocol.MotorView | None) -> str:
    return "no state yet" if motor is None else f"{motor.q_rad[0]:+.2f} rad"


def _streams(view: protocol.Snapshot) -> str:
    running = [
        f"{topic_text(name)} {rate_text(stream.rate_hz)} Hz, gap {age_text(stream.worst_gap_ns)}"
        for name, stream in view.streams.items()
        if stream.running
    ]
    return "; ".join(running) or "none runs"


def _motion(motion: protocol.MotionView) -> str:
    error = "" if motion.error_rad is None else f", {motion.error_rad:.3f} rad from the goal"
    why = f": {motion.code}" if motion.code else ""
    progress = f" {motion.progress:.0%}" if motion.state == "executing" else ""
    return f"{' and '.join(motion.sides)} {motion.state}{progress}{why}{error}"
