"""A motion from the shell, whatever it is: say what will move, ask, own, enable, move and tell, disable.

Rules
    * What cannot be done is refused before anybody is asked and before anything moves: that is the task's `preview`.
    * A motion that was refused undoes what this command did; one that was under way when something went wrong (an error,
      Ctrl-C) leaves the arms held, and says so.
"""

from __future__ import annotations

import json
import sys
from argparse import Namespace
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from typing import Protocol

from gateway.cli.terminal.asking import confirmed
from gateway.cli.terminal.connection import connected
from gateway.cli.terminal.ending import ExitStatus, report
from gateway.cli.terminal.owning import HELD, LOOK_S, held_text, is_held, owned
from gateway.cli.terminal.progress import Teller, teller
from gateway.client import Control, MotionHandle, MotionResult, Robot, RobotState
from gateway.errors import Code, GatewayError, Refused, failure

__all__ = ["ENABLE_S", "PROGRESS_HZ", "Aim", "Stage", "Task", "after", "move", "require_mode", "watched"]

ENABLE_S = 12.0
"""The gateway gives up enabling after 10 s; its reason is worth waiting for [s]."""

PROGRESS_HZ = 10.0


def after(options: Namespace) -> str:
    """Return what becomes of the arms afterwards."""
    return "held" if options.hold else "disabled"


Stage = Callable[[Robot, Control, Teller, float], MotionResult]
"""One motion to its end: the robot, the right to command it, who is told, and the longest wait [s]."""


class Task(Protocol):
    """What is to move. Made from the state in which it begins."""

    def preview(self, robot: Robot, options: Namespace) -> Iterable[str]:
        """Return, line by line, what will move and how far; raise what refuses it."""

    @property
    def stages(self) -> Sequence[Stage]:
        """Motions, one after the other; the result of the last one counts."""

    def figures(self) -> dict[str, object]:
        """Return what scripts are told of it at the end, beside what all motions have."""

    def remark(self) -> str:
        """Return the same for people, as the end of a sentence; may be empty."""


Aim = Callable[[RobotState], Task]
"""Makes a task from the state in which it begins."""


def move(options: Namespace, aim: Aim) -> ExitStatus:
    """Move the arms, and tell on the way.

    Raises:
        GatewayError: Nothing was begun.
    """
    with connected(options.command, options.target, options.timeout_s) as robot:
        task = aim(robot.state)
        print("\n".join(task.preview(robot, options)), file=sys.stderr)
        if not options.yes and not confirmed():
            print("nothing was done", file=sys.stderr)
            return ExitStatus.REFUSED
        try:
            result = _move(options, task, robot)
        except GatewayError as error:
            status = report(error, as_json=options.json)
            if is_held(robot):
                print(held_text(robot, options.command), file=sys.stderr)
            return status
        except KeyboardInterrupt:
            if is_held(robot):
                print(f"\ninterrupted: {held_text(robot, options.command)}", file=sys.stderr)
            raise
        if options.hold:
            print(held_text(robot, options.command), file=sys.stderr)
    print(_report(options, task, result))
    return ExitStatus.OK


def require_mode(side: str, state: RobotState, *, is_pose: bool, remedy: str) -> None:
    """Refuse what does not fit an arm's control mode, before anybody is asked.

    Raises:
        NotReady: WRONG_CONTROL_MODE.
    """
    is_joint = state.mode is None or state.mode.joint_mode.get(side, True)
    if state.mode is None or is_joint != is_pose:
        return
    mode = "joint" if is_joint else "end-effector"
    raise failure(
        Code.WRONG_CONTROL_MODE,
        f"the {side} arm is in {mode} mode (manual §2.3)",
        field=f"{side}_arm",
        value=mode,
        hint=f"use {remedy}, or set the arm to the other mode in the robot's web page",
    )


def watched(robot: Robot, handle: MotionHandle, tell: Teller, timeout_s: float, phase: str = "move") -> MotionResult:
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
        tell.advance(phase, handle.progress, f"{handle.progress:4.0%}{error}{settling}")
        if handle.done:
            break
        if state.view.at_ns - begin_ns > timeout_s * 1e9:
            message = f"motion {handle.motion_id} has not ended within {timeout_s:g} s: {handle.progress:.0%}{error}"
            raise failure(Code.TIMEOUT, message, hint="wait longer with --timeout")
    return handle.result()


def _move(options: Namespace, task: Task, robot: Robot) -> MotionResult:
    was_held = robot.state.state in HELD
    with teller() as tell, owned(robot, tell, take=options.take, is_left_held=options.hold) as own:
        try:
            tell.advance("enable", None, "waiting for READY")
            own.enable(timeout=ENABLE_S)
            tell.advance("enable", 1.0, "READY")
            results = [stage(robot, own, tell, options.timeout_s) for stage in task.stages]
        except Refused:
            if not was_held:  # nothing moves: end what this command began, not what another one left held
                with suppress(GatewayError):
                    own.release()
            raise
        if not options.hold:
            tell.advance("disable", None, "braking to rest, then PAUSE")
            own.release()
            tell.advance("disable", 1.0, "PAUSE")
    return results[-1]


def _report(options: Namespace, task: Task, result: MotionResult) -> str:
    if options.json:
        return json.dumps(
            {
                "ok": True,
                "motion_id": result.motion_id,
                "sides": list(result.sides),
                "error_rad": result.error,
                "error_m": result.error_m,
                "duration_s": result.duration,
                **task.figures(),
                "held": options.hold,
            }
        )
    error = "" if result.error is None else f" within {result.error:.3f} rad"
    error += "" if result.error_m is None else f" and {result.error_m * 1e3:.1f} mm"
    return f"reached{error} after {result.duration:.1f} s{task.remark()}; {after(options)}"
