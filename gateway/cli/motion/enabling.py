"""`ta2 enable`: enable the arms, hold them where they are until Ctrl-C or SIGTERM, then release.

What happens meanwhile is said; when nothing is held any more, the command ends. Only a normal end releases: when this
process dies or its terminal goes, the arms stay held as for any client that vanished.
"""

from __future__ import annotations

import signal
from argparse import Namespace
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

from gateway.cli.terminal.advice import next_steps
from gateway.cli.terminal.connection import connected
from gateway.cli.terminal.ending import ExitStatus
from gateway.cli.terminal.owning import HELD, LOOK_HZ, LOOK_S, lost, owned
from gateway.cli.terminal.progress import Teller, teller
from gateway.client import Robot, RobotState
from gateway.errors import CODES, Code, GatewayError, failure

__all__ = ["carry_out"]


def carry_out(options: Namespace) -> ExitStatus:
    """Hold the arms until somebody ends it.

    Raises:
        GatewayError: It could not be enabled, or is not held any more.
    """
    with connected("enable", options.target, options.timeout_s) as robot:
        with teller() as tell, owned(robot, tell, take=options.take, is_left_held=False) as own:
            tell.advance("enable", None, "waiting for READY")
            own.enable(timeout=options.timeout_s)
            tell.advance("enable", 1.0, "READY")
            tell.say("held where they are; Ctrl-C releases: the robot pauses, the grip is lost")
            epoch = own.epoch
            with _end_wanted() as wanted:
                _watch_over(robot, tell, epoch, wanted)
                tell.advance("release", None, "braking to rest, then PAUSE")
                own.release()
                tell.advance("release", 1.0, "PAUSE")
    print("released")
    return ExitStatus.OK


@contextmanager
def _end_wanted() -> Iterator[list[int]]:
    """Collect Ctrl-C and SIGTERM instead of being interrupted by them: an interrupted client leaves the robot held."""
    numbers: list[int] = []

    def note(number: int, frame: FrameType | None) -> None:
        numbers.append(number)

    before = {number: signal.signal(number, note) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield numbers
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _watch_over(robot: Robot, tell: Teller, epoch: int, wanted: list[int]) -> None:
    """Return when the end is wanted; say what happens until then.

    Raises:
        GatewayError: The arms are not held any more, or somebody else has the robot.
    """
    shown = robot.state.shown
    for state in robot.states(max_rate=LOOK_HZ, timeout=LOOK_S):
        if wanted:
            return
        if state.lease.epoch != epoch or state.lease.client_id != robot.client_id:
            raise lost(robot, state)
        if state.shown != shown:
            shown = state.shown
            urgent = [step.text for step in next_steps(state.view, robot.info) if step.level != "info"]
            name = shown if shown == state.state else f"{shown}, {state.state}"
            tell.say("\n".join([f"now {name}", *(f"  {text}" for text in urgent)]))
        if state.state not in HELD and state.state != "STALE":
            raise _not_held(state)


def _not_held(state: RobotState) -> GatewayError:
    latches = "; ".join(f"{code}: {message}" for code, message in state.latches.items())
    code = next((Code(code) for code in state.latches if code in {known.value for known in CODES}), Code.NOT_ENABLED)
    why = f", {latches}" if latches else f"; the robot's FSM is {state.fsm_name}"
    return failure(code, f"the arms are not held any more: the gateway is {state.state}{why}")
