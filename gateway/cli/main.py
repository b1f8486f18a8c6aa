"""`ta2`: arguments to calls. What a command does lives beside it; here is only who does it.

Rules
    * Nothing heavy is imported before it is known what is wanted: `ta2 stop` loads the client and nothing else.
    * What a person or a script wants to read goes to standard output, what is said on the way to standard error.
    * An error is one line, `CODE: message -> hint`, and an exit status of `terminal.ending.ExitStatus`.
    * SIGTERM and SIGHUP are to a client command what Ctrl-C is: whatever moves is left held, at once. None of them is lost, not
      even where Python drops the exception that it makes of it, as in a finaliser. What is said to a terminal that is gone
      fails nothing: a recording ends well, its views are split off.
"""

from __future__ import annotations

import codecs
import errno
import json
import os
import signal
import sys
import termios
from argparse import Namespace
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from importlib import import_module
from io import TextIOWrapper
from types import FrameType

from gateway import __version__
from gateway.cli.command_line.arguments import parse
from gateway.cli.terminal.ending import ExitStatus, Interrupted, report
from gateway.errors import Code, GatewayError, failure

__all__ = ["COMMANDS", "main"]

AGAIN_S = 0.002
"""After so long an interruption comes again that was dropped [s]: that place is left by then, or it is dropped once more."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Carry out a command line; return the exit status.

    Args:
        arguments: Without the program's name; None for this process's own.
    """
    _open_what_is_closed()
    if isinstance(sys.stdout, TextIOWrapper):  # what a terminal has no letter for fails nothing that was done
        codecs.register_error("ta2", _as_json_does)
        sys.stdout.reconfigure(errors="ta2")
    options = parse(sys.argv[1:] if arguments is None else arguments)
    try:
        with _interruptible(options.command):
            return int(COMMANDS[options.command](options))
    except GatewayError as error:
        return report(error, as_json=getattr(options, "json", False), takes=hasattr(options, "take"))
    except Interrupted as end:
        return 128 + end.number
    except KeyboardInterrupt:
        return 128 + signal.SIGINT
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # Python flushes once more on its way out
        return ExitStatus.BROKEN_PIPE


def _open_what_is_closed() -> None:
    """Stand in for standard files that are closed: nobody is there, as in a script.

    Whatever was opened next would be taken for them else, and the log be written to it, by the guard too: it inherits these.
    """
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            os.set_inheritable(os.open(os.devnull, os.O_RDWR), True)
    sys.stdin = sys.stdin or open(os.devnull, encoding="utf-8")
    sys.stdout = sys.stdout or open(os.devnull, "w", encoding="utf-8")
    sys.stderr = sys.stderr or open(os.devnull, "w", encoding="utf-8")


def _as_json_does(error: UnicodeError) -> tuple[str, int]:
    r"""Return letters that a stream's encoding does not have as `\u00e4` and where to go on: what is JSON stays JSON."""
    if not isinstance(error, UnicodeEncodeError):
        raise error
    return json.dumps(error.object[error.start : error.end])[1:-1], error.end


@contextmanager
def _interruptible(command: str) -> Iterator[None]:
    """Turn SIGTERM and SIGHUP into an exception, so that a client can leave the robot held and say so, as Python does Ctrl-C.

    The two processes that run for ever have their own answer to signals.
    """
    if command in ("run", "sim"):
        yield
        return

    newest, tell = 0, sys.unraisablehook

    def interrupt(number: int, frame: FrameType | None) -> None:
        nonlocal newest
        newest = newest if number == signal.SIGALRM else number
        if number == signal.SIGHUP:
            _leave_terminal()
        while frame is not None:
            if frame.f_code is dropped.__code__:  # it would be dropped again, from there
                return again()
            frame = frame.f_back
        raise KeyboardInterrupt if newest == signal.SIGINT else Interrupted(newest)

    def dropped(what: sys.UnraisableHookArgs) -> None:
        if issubclass(what.exc_type, KeyboardInterrupt):
            again()
        else:
            tell(what)

    def again() -> None:
        before.setdefault(signal.SIGALRM, signal.signal(signal.SIGALRM, interrupt))
        signal.setitimer(signal.ITIMER_REAL, AGAIN_S)

    heard = [signal.SIGTERM, signal.SIGHUP]
    if signal.getsignal(signal.SIGINT) is not signal.SIG_IGN:  # as in a shell's background
        heard.append(signal.SIGINT)
    before = {number: signal.signal(number, interrupt) for number in heard}
    sys.unraisablehook = dropped
    try:
        yield
    finally:
        sys.unraisablehook = tell
        if signal.SIGALRM in before:
            signal.setitimer(signal.ITIMER_REAL, 0.0)
        for number, handler in before.items():
            signal.signal(number, handler)


def _leave_terminal() -> None:
    """Say nowhere what would be said to a terminal that is gone."""
    for output in (1, 2):
        try:
            termios.tcgetattr(output)
        except termios.error as error:
            if error.args[0] == errno.EIO:
                os.dup2(os.open(os.devnull, os.O_WRONLY), output)


# ----------------------------------------------------------------------------------------------------------- processes


def _run(options: Namespace) -> int:
    import shlex
    from functools import partial
    from pathlib import Path

    from msgspec.structs import replace

    from gateway.process.blas_threads import one_blas_thread

    one_blas_thread()  # before anything takes numpy along; the guard inherits it
    from gateway.api.protocol import default_socket
    from gateway.process import daemon, log
    from gateway.process.notify import notifier_of
    from gateway.settings import toml_file
    from gateway.settings.reloading import read_regular
    from gateway.settings.settings import Settings

    def read(load: Callable[[], Settings]) -> Settings:
        settings = toml_file.overridden(
            load(), robot=options.robot, socket=options.socket, namespace=options.namespace, model=options.model
        )
        if options.no_guard:
            settings = replace(settings, guard=replace(settings.guard, enabled=False))
        return settings

    settings = read(partial(toml_file.load, options.config))
    log.configure_log(is_json=options.json_log)
    notifier = notifier_of(os.environ, os.getpid())  # before anything is started that would inherit its variables

    def on_ready(socket: str) -> None:
        if options.json_log:
            return
        at = "" if Path(socket) == default_socket() else f" --socket {shlex.quote(socket)}"
        print(
            f"\nta2 {__version__}: the gateway of {settings.link.endpoint} (model {settings.link.model}); "
            f"clients connect to {socket}\n"
            f"  look   ta2 status{at}\n"
            f"         ta2 watch{at}\n"
            f"  move   ta2 home{at}\n"
            f"  stop   ta2 stop{at}\n"
            f"  end    Ctrl-C: brakes, then pauses the robot\n",
            file=sys.stderr,
            flush=True,
        )

    again = partial(read, partial(toml_file.load, options.config, read_regular))
    return daemon.run(settings, on_ready, is_json_log=options.json_log, notifier=notifier, read=again)


def _sim(options: Namespace) -> int:
    if options.ask is not None:
        return _ask_sim(options)
    from gateway.sim.starting import CannotStart, start

    if options.camera and options.camera_to is None:
        from gateway.sim.camera.sender import DEFAULT_TO  # and what draws and sends pictures

        options.camera_to = DEFAULT_TO
    try:
        return start(options)
    except CannotStart as error:
        raise failure(Code.BAD_REQUEST, str(error), hint="`ta2 sim --help` lists what can be chosen") from None


def _ask_sim(options: Namespace) -> int:
    from gateway.sim.remote import SimControl, SimUnreachable

    try:
        values: object = {}
        if options.ask == "fault":
            values = json.loads(options.fault)
        elif options.ask == "clear" and options.fault is not None:
            values = {"fault": options.fault}
        if not isinstance(values, dict) or "do" in values:
            raise ValueError(f'a fault is an object such as {{"fault": "pause"}}, not {options.fault}')
        with SimControl(options.at) as control:
            print(json.dumps(control.ask(options.ask, **values), indent=2))
    except SimUnreachable as error:
        hint = "start one with `ta2 sim`; a real robot has no such channel"
        message = str(error).partition(": ")[0]  # what follows is zenoh's own trace
        raise failure(Code.DISCONNECTED, message, hint=hint) from None
    except ValueError as error:  # no JSON, or refused by the simulation
        raise failure(Code.BAD_REQUEST, str(error), hint="`ta2 sim faults` lists what there is") from None
    return ExitStatus.OK


# ------------------------------------------------------------------------------------------------------------ settings


def _carried_out_by(module: str, name: str = "carry_out") -> Callable[[Namespace], int]:
    """Return what loads a module and lets a function of it carry out the command."""

    def carry_out(options: Namespace) -> int:
        return int(getattr(import_module(module), name)(options))

    return carry_out


# ------------------------------------------------------------------------------------------------------------- clients


def _link(options: Namespace) -> int:
    from gateway.cli.looking import link

    if options.robot is None and options.config is None:
        return link.show_link(options.target, options.timeout_s, as_json=options.json)
    import logging

    from gateway.link.surveyor import look
    from gateway.settings import toml_file

    logging.getLogger("gateway").addHandler(logging.NullHandler())  # the page says it
    settings = toml_file.overridden(
        toml_file.load(options.config), robot=options.robot, namespace=options.namespace, model=options.model
    )
    wire = look(settings.link, is_named=bool(options.namespace is not None or settings.link.namespace))
    return link.show_look(wire, as_json=options.json)


def _check(options: Namespace) -> int:
    from gateway.cli.check import command
    from gateway.link.surveyor import look

    return command.carry_out(options, look)


COMMANDS: Mapping[str, Callable[[Namespace], int]] = {
    "run": _run,
    "sim": _sim,
    "config": _carried_out_by("gateway.cli.configuring"),
    "model": _carried_out_by("gateway.cli.body.model"),
    "status": _carried_out_by("gateway.cli.looking.status"),
    "watch": _carried_out_by("gateway.cli.looking.watch"),
    "why": _carried_out_by("gateway.cli.looking.why"),
    "topics": _carried_out_by("gateway.cli.looking.topics"),
    "link": _link,
    "check": _check,
    "doctor": _carried_out_by("gateway.cli.check.doctor"),
    "events": _carried_out_by("gateway.cli.looking.events"),
    "incident": _carried_out_by("gateway.cli.looking.incident"),
    "frames": _carried_out_by("gateway.cli.body.frames"),
    "identify": _carried_out_by("gateway.cli.body.identify"),
    "enable": _carried_out_by("gateway.cli.motion.enabling"),
    "view": _carried_out_by("gateway.cli.scene.view"),
    "home": _carried_out_by("gateway.cli.motion.moving"),
    "move": _carried_out_by("gateway.cli.motion.moving"),
    "move-pose": _carried_out_by("gateway.cli.motion.moving"),
    "follow": _carried_out_by("gateway.cli.motion.following"),
    "replay": _carried_out_by("gateway.cli.motion.replaying"),
    "gripper": _carried_out_by("gateway.cli.motion.grounding"),
    "payload": _carried_out_by("gateway.cli.motion.grounding"),
    "drive": _carried_out_by("gateway.cli.motion.grounding"),
    "lift": _carried_out_by("gateway.cli.motion.grounding"),
    "teleop": _carried_out_by("gateway.cli.teleop.run"),
    "video": _carried_out_by("gateway.cli.cameras.commands"),
    "record": _carried_out_by("gateway.cli.recording.record"),
    "episode": _carried_out_by("gateway.cli.recording.episode"),
    "bag": _carried_out_by("gateway.cli.recording.bag"),
    "dataset": _carried_out_by("gateway.cli.dataset.build"),
    "policy": _carried_out_by("gateway.cli.policy.run"),
    "web": _carried_out_by("gateway.cli.web"),
    "example": _carried_out_by("gateway.cli.examples"),
    "demo": _carried_out_by("gateway.cli.demo"),
    "completion": _carried_out_by("gateway.cli.completion"),
    "keys": _carried_out_by("gateway.cli.keys"),
    "service": _carried_out_by("gateway.cli.service"),
    "fleet": _carried_out_by("gateway.cli.fleet"),
    "stop": _carried_out_by("gateway.cli.motion.stopping", "stop"),
    "estop": _carried_out_by("gateway.cli.motion.stopping", "stop"),
    "stop-endpoint": _carried_out_by("gateway.cli.motion.stop_endpoint"),
    "recover": _carried_out_by("gateway.cli.motion.stopping", "recover"),
}
"""Who carries out which command."""
