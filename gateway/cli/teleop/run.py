"""`ta2 teleop`: say what moves, ask, own, enable, and let a person jog; then pause the arms, or leave them held.

A turn that does not end by `q` leaves the arms held: Ctrl-C, a terminal that is gone, another owner, a lost gateway.
"""

from __future__ import annotations

import os
import shutil
import signal
import sys
from argparse import Namespace
from contextlib import ExitStack

from gateway.cli.teleop import gamepad, keyboard
from gateway.cli.teleop.session import ENABLE_S, Session
from gateway.cli.terminal.asking import confirmed
from gateway.cli.terminal.connection import connected
from gateway.cli.terminal.ending import ExitStatus, Interrupted, report
from gateway.cli.terminal.keys import keys
from gateway.cli.terminal.owning import held_text, is_held, owned
from gateway.errors import Code, GatewayError, failure

__all__ = ["carry_out"]


class _Screen:
    """Standard error: lines that stay, above one of status on a terminal."""

    def say(self, text: str) -> None:
        self._write(f"\r\x1b[2K{text}\n" if sys.stderr.isatty() else f"{text}\n")

    def advance(self, phase: str, progress: float | None, detail: str) -> None:
        if sys.stderr.isatty():
            self._write(f"\r\x1b[2K{phase}: {detail}"[: shutil.get_terminal_size().columns + 4])

    def _write(self, text: str) -> None:
        try:
            print(text, end="", file=sys.stderr, flush=True)
        except OSError:  # the terminal is gone, and what is still said on the way out goes nowhere
            sys.stderr = open(os.devnull, "w")
            raise Interrupted(signal.SIGHUP) from None


def carry_out(options: Namespace) -> ExitStatus:
    """Let a person jog.

    Raises:
        GatewayError: Nothing was begun.
    """
    screen, status = _Screen(), ExitStatus.OK
    if options.device == "keyboard" and not sys.stdin.isatty():
        message, hint = "standard input is no terminal with keys", "start it in a terminal, or give --device gamepad"
        raise failure(Code.BAD_REQUEST, message, field="device", hint=hint)
    with connected("teleop", options.target, options.timeout_s) as robot, ExitStack() as stack:
        pad = gamepad.Gamepad() if options.device == "gamepad" else None
        print(f"teleop: the {options.device} moves arms, grippers, chassis and lift", file=sys.stderr)
        if not (options.yes or confirmed()):
            print("nothing was done", file=sys.stderr)
            return ExitStatus.REFUSED
        try:
            with owned(robot, screen, take=options.take, is_left_held=options.hold) as own:
                own.enable(timeout=ENABLE_S)
                read = keyboard.Keyboard(stack.enter_context(keys()), moves=pad is None).read
                if pad is not None:
                    pad.beside, read = read, pad.read
                turn = Session(robot, own, read, screen)
                turn.side, turn.task, turn.help = options.arm, options.task, gamepad.HELP if pad else keyboard.HELP
                screen.say(turn.help)
                turn.run()
                screen.say("the arms brake")
        except GatewayError as error:
            screen.say("")
            status = report(error)
        finally:
            if is_held(robot):
                screen.say(held_text(robot, "teleop"))
        return status
