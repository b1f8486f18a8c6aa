"""`ta2 teleop`: say what will be moved with what, ask, own, enable, and let a person jog; then pause the arms, or leave them held.

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
from gateway.errors import Code, GatewayError, Refusal, to_exception
from gateway.kinematics.configured import configured
from gateway.settings import toml_file

__all__ = ["carry_out"]


class _Screen:
    """Standard error: lines that stay, above one of status on a terminal."""

    def say(self, text: str) -> None:
        self._write(f"\r\x1b[2K{text}\n" if sys.stderr.isatty() else f"{text}\n")

    def show(self, line: str) -> None:
        if sys.stderr.isatty():
            self._write(f"\r\x1b[2K{line[: shutil.get_terminal_size().columns - 1]}")

    def advance(self, phase: str, progress: float | None, detail: str) -> None:
        self.show(f"{phase}: {detail}")

    def _write(self, text: str) -> None:
        try:
            print(text, end="", file=sys.stderr, flush=True)
        except OSError:  # the terminal is gone, and what is still said on the way out goes nowhere
            sys.stderr = open(os.devnull, "w")  # noqa: SIM115
            raise Interrupted(signal.SIGHUP) from None


def carry_out(options: Namespace) -> ExitStatus:
    """Let a person jog.

    Raises:
        GatewayError: Nothing was begun.
    """
    body, screen = configured(toml_file.load(options.config)), _Screen()
    if options.device == "keyboard" and not sys.stdin.isatty():
        message, hint = (
            "standard input is no terminal: nobody can press keys",
            "start it in a terminal, or --device gamepad",
        )
        raise to_exception(Refusal(code=Code.BAD_REQUEST, message=message, field="device", hint=hint))
    with connected("teleop", options.target, options.timeout_s) as robot, ExitStack() as stack:
        pad = stack.enter_context(gamepad.Gamepad()) if options.device == "gamepad" else None
        with_what = "this keyboard" if pad is None else f"gamepad {pad.name!r}"
        print(f"teleop: {with_what} moves arms, grippers, chassis and lift", file=sys.stderr)
        if not (options.yes or confirmed()):
            print("nothing was done", file=sys.stderr)
            return ExitStatus.REFUSED
        status = ExitStatus.OK
        try:
            with owned(robot, screen, take=options.take, is_left_held=options.hold) as own:
                own.enable(timeout=ENABLE_S)
                device: keyboard.Device = keyboard.Keyboard(stack.enter_context(keys()), moves=pad is None)
                if pad is not None:
                    pad.beside, device = device, pad
                turn = Session(robot=robot, own=own, device=device, body=body, say=screen.say, show=screen.show)
                turn.side, turn.task, turn.help = (
                    options.arm,
                    options.task,
                    keyboard.HELP if pad is None else gamepad.HELP,
                )
                screen.say(turn.help)
                turn.run()
                screen.say("the arms brake")
        except GatewayError as error:
            screen.say("")
            status = report(error)
        except KeyboardInterrupt:
            if is_held(robot):
                screen.say(f"interrupted: {held_text(robot, 'teleop')}")
            raise
        if is_held(robot):
            screen.say(held_text(robot, "teleop"))
        return status
