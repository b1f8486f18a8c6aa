"""`ta2 stop-endpoint`: a person's terminal watches over the robot. What holds it is this loop, which reads the terminal.

Enter or space stops the robot at once, q leaves in order. Whatever else ends or stops this process (Ctrl-C, Ctrl-Z, a closed
window, a connection that was lost, a terminal that takes no more output) is silence: the robot is held.
"""

from __future__ import annotations

import os
import select
import sys
import termios
import tty
from argparse import Namespace
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from gateway.cli.terminal.connection import connected
from gateway.cli.terminal.ending import ExitStatus
from gateway.errors import Code, failure

if TYPE_CHECKING:
    from gateway.api.protocol import OnLossName
    from gateway.client import Robot

__all__ = ["carry_out"]

STOP_KEYS = b" \r\n"
LEAVE_KEYS = b"qQ"


def carry_out(options: Namespace) -> ExitStatus:
    """Hold the terminal until q.

    Raises:
        Rejected: BAD_REQUEST, there is no terminal; OUT_OF_RANGE, the period.
        NotReady: ENDPOINT_UNKNOWN, somebody has let this endpoint go.
        Disconnected: The gateway or the terminal is gone: the robot is held.
    """
    if not (sys.stdin.isatty() and sys.stdout.isatty()):
        message = "a stop endpoint needs a terminal with a person at it"
        raise failure(Code.BAD_REQUEST, message, hint="use stop_endpoint() in a program")
    on_silence: OnLossName = "pause" if options.pause else "hold"
    period_s: float = options.within
    with connected("stop-endpoint", options.target, options.timeout_s) as robot:
        with robot.stop_endpoint(period_s, on_silence) as endpoint, _keys() as keyboard:
            print(
                f"watching; without this terminal for {period_s:g} s the robot is {'paused' if options.pause else 'held'}"
            )
            print("Enter, space: stop the robot now   q: leave in order   (anything else that ends this: it is held)")
            while True:
                endpoint.check_in()
                ready, _, _ = select.select([keyboard], [], [], period_s / 5)
                pressed = os.read(keyboard, 64) if ready else b""
                if ready and not pressed:
                    raise failure(Code.DISCONNECTED, "the terminal is gone; the robot is held")
                if any(key in STOP_KEYS for key in pressed):  # before q: both may have been pressed
                    robot.stop("the stop endpoint's key")
                    print("\r\x1b[Kstopped: motion is refused until `ta2 recover`")
                if any(key in LEAVE_KEYS for key in pressed):
                    break
                print(f"\r\x1b[K{_line(robot)}", end="", flush=True)
    print("\r\x1b[Kleft in order: nobody watches here any more")
    return ExitStatus.OK


def _line(robot: Robot) -> str:
    state = robot.state
    owner = state.lease.name if state.lease.owned else "nobody"
    others = len(state.endpoints) - 1
    beside = f", {others} more stop endpoint{'s' if others > 1 else ''}" if others > 0 else ""
    return f"{state.view.shown}, owner: {owner}{beside} "


@contextmanager
def _keys() -> Iterator[int]:
    """Give single keys of the terminal, unechoed; Ctrl-C and Ctrl-Z stay what they are."""
    keyboard = sys.stdin.fileno()
    before = termios.tcgetattr(keyboard)
    tty.setcbreak(keyboard)
    try:
        yield keyboard
    finally:
        termios.tcsetattr(keyboard, termios.TCSANOW, before)
