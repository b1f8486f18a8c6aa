"""`ta2 home` and `ta2 move`: say what will move and how far, ask, own, enable, move, disable.

Rules
    * What cannot be reached is refused before anybody is asked and before anything moves.
    * A motion that was refused undoes what this command did; one that was under way when something went wrong (an error,
      Ctrl-C) leaves the arms held, and says so.
"""

from __future__ import annotations

import json
import math
import sys
import termios
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass

from gateway.api import protocol
from gateway.apps.connection import connected
from gateway.apps.ending import ExitStatus, report
from gateway.apps.figures import joints_text
from gateway.apps.owning import HELD, LOOK_S, held_text, is_held, owned
from gateway.apps.progress import Teller, teller
from gateway.client import MotionHandle, MotionResult, Robot, RobotState
from gateway.client.requests import joints, within_limits
from gateway.errors import Code, GatewayError, Refusal, Refused, to_exception
from gateway.robot import HOME_Q_RAD

__all__ = ["Aim", "Errand", "Plan", "carry_out", "home", "to_joints"]

ENABLE_S = 12.0
"""The gateway gives up enabling after 10 s; its reason is worth waiting for [s]."""

PROGRESS_HZ = 10.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Errand:
    """How a motion is to be carried out.

    Attributes:
        command: `home` or `move`.
        target: Where the gateway is; None finds its socket.
        timeout_s: Longest wait for the end of the motion [s].
        speed: Factor on the velocity limit.
        tolerance_rad: Reached within this [rad]; None for the configured one.
        is_clipping: Whether a goal outside the limits is moved to the limit.
        is_left_held: Whether the arms are left held instead of pausing the robot.
        take: Reason to take the robot from its owner; None to be refused.
        asks: Whether a person at a terminal is asked first.
        as_json: Whether the result is printed as JSON.
    """

    command: str
    target: str | None
    timeout_s: float
    speed: float
    tolerance_rad: float | None
    is_clipping: bool
    is_left_held: bool
    take: str | None
    asks: bool
    as_json: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class Plan:
    """Where arms are to go.

    Attributes:
        what: In words.
        targets_rad: Per side seven joints [rad], or offsets.
        is_offset: Whether they are offsets from where the arm is held, or was measured.
    """

    what: str
    targets_rad: Mapping[str, tuple[float, ...]]
    is_offset: bool = False


Aim = Callable[[RobotState], Plan]
"""Makes a plan from the state in which it begins."""


def home(state: RobotState) -> Plan:
    """Return the way to the initial position of manual §6.6, for every arm that is enabled."""
    enabled = {"left": True, "right": True} if state.mode is None else state.mode.arm_enabled
    goals = {side.value: q_rad for side, q_rad in HOME_Q_RAD.items() if enabled.get(side.value)}
    staying = [side.value for side in HOME_Q_RAD if side.value not in goals]
    if not goals:
        raise to_exception(Refusal(code=Code.NO_ARM_ENABLED, message="no arm is enabled in the robot's configuration"))
    note = f"; the {staying[0]} arm is disabled and stays" if staying else ""
    return Plan(what=f"to the initial position of manual §6.6{note}", targets_rad=goals)


def to_joints(targets_rad: Mapping[str, tuple[float, ...]], *, is_offset: bool) -> Aim:
    """Return the way to joints that a person gave.

    Args:
        targets_rad: Per side [rad].
        is_offset: Whether they are offsets.

    Raises:
        Rejected: WRONG_SHAPE or NOT_FINITE.
    """
    checked = {side: joints(side, q_rad) for side, q_rad in targets_rad.items()}
    plan = Plan(what="by offsets" if is_offset else "to joint positions", targets_rad=checked, is_offset=is_offset)
    return lambda _: plan


def carry_out(errand: Errand, aim: Aim) -> ExitStatus:
    """Move the arms, and tell on the way.

    Args:
        errand: How.
        aim: Where to.

    Raises:
        GatewayError: Nothing was begun.
    """
    with connected(errand.command, errand.target, errand.timeout_s) as robot:
        plan = aim(robot.state)
        print(_preview(errand, plan, robot), file=sys.stderr)
        if errand.asks and not _confirmed():
            print("nothing was done", file=sys.stderr)
            return ExitStatus.REFUSED
        try:
            result, clipped = _move(errand, plan, robot)
        except GatewayError as error:
            status = report(error, as_json=errand.as_json)
            if is_held(robot):
                print(held_text(robot, errand.command), file=sys.stderr)
            return status
        except KeyboardInterrupt:
            if is_held(robot):
                print(f"\ninterrupted: {held_text(robot, errand.command)}", file=sys.stderr)
            raise
        if errand.is_left_held:
            print(held_text(robot, errand.command), file=sys.stderr)
    print(_report(errand, result, clipped))
    return ExitStatus.OK


# -------------------------------------------------------------------------------------------------------------- before


def _preview(errand: Errand, plan: Plan, robot: Robot) -> str:
    """Return what will move and how far.

    Raises:
        Stale: An arm was never measured.
        Rejected: OUT_OF_RANGE, the goal is outside the limits and not to be clipped.
    """
    info, state = robot.info, robot.state
    v_radps = errand.speed * info.v_radps
    arms = " and ".join(plan.targets_rad)
    lines = [f"{errand.command}: {arms} {plan.what}, with up to {v_radps:g} rad/s"]
    longest_s = 0.0
    for side, target in plan.targets_rad.items():
        arm = state.arm(side)
        start = tuple(map(float, arm.q_ref if arm.is_streaming else arm.q))
        goal = tuple(q + dq for q, dq in zip(start, target, strict=True)) if plan.is_offset else target
        goal = within_limits(side, goal, info, "clip" if errand.is_clipping else "reject")
        ways = tuple(end - begin for begin, end in zip(start, goal, strict=True))
        lines.append(f"  {side + ' arm':<9} by {joints_text(ways)} rad")
        longest_s = max(longest_s, _duration_s(max(map(abs, ways)), v_radps, info))
    lines.append(f"  takes about {longest_s:.1f} s, then the arms are {'held' if errand.is_left_held else 'disabled'}")
    return "\n".join(lines)


def _duration_s(way_rad: float, v_radps: float, info: protocol.Info) -> float:
    """Return about how long a joint takes from rest to rest; the gateway plans it exactly."""
    ramp_s = info.a_radps2 / info.j_radps3
    if way_rad < v_radps**2 / info.a_radps2:
        return 2.0 * math.sqrt(way_rad / info.a_radps2) + ramp_s
    return way_rad / v_radps + v_radps / info.a_radps2 + ramp_s


def _confirmed() -> bool:
    """Ask a person; where there is none, the command line has said it all."""
    if not (sys.stdin.isatty() and sys.stderr.isatty()):
        return True
    termios.tcflush(sys.stdin, termios.TCIFLUSH)  # what was typed before the question is no answer to it
    print("Nobody and nothing in reach, the emergency stop at hand? Move? [y/N] ", end="", file=sys.stderr, flush=True)
    return sys.stdin.readline().strip().lower() in ("y", "yes")


# -------------------------------------------------------------------------------------------------------------- moving


def _move(errand: Errand, plan: Plan, robot: Robot) -> tuple[MotionResult, tuple[str, ...]]:
    was_held = robot.state.state in HELD
    with teller() as tell, owned(robot, tell, take=errand.take, is_left_held=errand.is_left_held) as own:
        try:
            tell.advance("enable", None, "waiting for READY")
            own.enable(timeout=ENABLE_S)
            tell.advance("enable", 1.0, "READY")
            start = own.move_by if plan.is_offset else own.move_to
            handle = start(
                plan.targets_rad,
                speed=errand.speed,
                tolerance=errand.tolerance_rad,
                on_limit="clip" if errand.is_clipping else "reject",
            )
        except Refused:
            if not was_held:  # nothing moved: end what this command began, not what another one left held
                with suppress(GatewayError):
                    own.release()
            raise
        result = _follow(robot, handle, errand.timeout_s, tell)
        if not errand.is_left_held:
            tell.advance("disable", None, "braking to rest, then PAUSE")
            own.release()
            tell.advance("disable", 1.0, "PAUSE")
    return result, handle.clipped


def _follow(robot: Robot, handle: MotionHandle, timeout_s: float, tell: Teller) -> MotionResult:
    """Show a motion until it has ended; time is the gateway's.

    Raises:
        MotionEnded: It did not reach its goal.
        GatewayTimeout: It has not ended in time.
    """
    begin_ns: int | None = None
    for state in robot.states(max_rate=PROGRESS_HZ, timeout=LOOK_S):
        begin_ns = state.view.at_ns if begin_ns is None else begin_ns
        error = "" if handle.error_rad is None else f", {handle.error_rad:.3f} rad to go"
        settling = ", settling" if handle.progress >= 1.0 and not handle.done else ""
        tell.advance("move", handle.progress, f"{handle.progress:4.0%}{error}{settling}")
        if handle.done:
            break
        if state.view.at_ns - begin_ns > timeout_s * 1e9:
            message = f"motion {handle.motion_id} has not ended within {timeout_s:g} s: {handle.progress:.0%}{error}"
            raise to_exception(Refusal(code=Code.TIMEOUT, message=message, hint="wait longer with --timeout"))
    return handle.result()


def _report(errand: Errand, result: MotionResult, clipped: tuple[str, ...]) -> str:
    if errand.as_json:
        return json.dumps(
            {
                "ok": True,
                "motion_id": result.motion_id,
                "sides": list(result.sides),
                "error_rad": result.error,
                "duration_s": result.duration,
                "clipped": list(clipped),
                "held": errand.is_left_held,
            }
        )
    error = "" if result.error is None else f" within {result.error:.3f} rad"
    limits = f", clipped to the limits: {', '.join(clipped)}" if clipped else ""
    after = "held" if errand.is_left_held else "disabled"
    return f"reached{error} after {result.duration:.1f} s{limits}; {after}"
