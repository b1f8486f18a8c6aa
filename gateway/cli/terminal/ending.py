"""How a command of `ta2` ends: its exit status, and the one line that tells a person what went wrong.

Exit statuses are part of the interface; `ta2 --help` lists them. Hints of the gateway are written for programs
(`recover()`); here they become what a person types (`ta2 recover`). Needs nothing but the standard library.
"""

from __future__ import annotations

import json
import re
import sys
from dataclasses import asdict, replace
from enum import IntEnum

from gateway.errors import (
    STOP_UNKNOWN,
    Code,
    ConfigError,
    Disconnected,
    GatewayError,
    GatewayTimeout,
    InternalError,
    OutcomeUnknown,
    ProtocolError,
    Rejected,
    failure,
    to_exception,
)

__all__ = [
    "STATUS_HELP",
    "ExitStatus",
    "Interrupted",
    "for_stopping",
    "in_shell_words",
    "line_of",
    "report",
    "status_of",
    "undelivered",
]


class ExitStatus(IntEnum):
    """What a command of `ta2` returns to the shell."""

    OK = 0
    REFUSED = 1
    USAGE = 2
    NO_GATEWAY = 3
    UNKNOWN = 4
    BROKEN = 5
    BROKEN_PIPE = 141
    """Whoever read the output has gone: 128 + SIGPIPE, as other programs have it."""


class Interrupted(KeyboardInterrupt):
    """SIGTERM or SIGHUP, treated as Ctrl-C: whatever moves is left held.

    Attributes:
        number: Of the signal.
    """

    def __init__(self, number: int) -> None:
        super().__init__(number)
        self.number = number


STATUS_HELP = """exit status:
  0    done
  1    refused, or the motion did not reach its goal; nothing moves, or the arms are held
  2    the command line or a file is wrong
  3    no gateway (or no robot, or no policy server) answers there
  4    timeout, or the reply was lost: look at `ta2 status` before you repeat it
  5    client and gateway do not understand each other, or a bug
  130  Ctrl-C: `home`, `move`, `follow`, `gripper`, `teleop` and `policy run` leave the robot held (SIGTERM 143, SIGHUP 129)
"""

SHELL_WORDS = {
    "take(reason=...)": "--take REASON",
    "take(reason='...')": "--take REASON",
    "take the lease with control() first": "own it first: `ta2 enable`, `ta2 home` or `ta2 move`",
    "ask for on_limit='clip'": "ask for --clip",
    "or move there first": "or move there first: --approach",
    "stretch=": "--stretch ",
    "ask for smoothing": "ask for --smoothing",
    "recover()": "`ta2 recover`",
    "recover(reason='...')": "`ta2 recover REASON`",
    "call stop_endpoint()": "start `ta2 stop-endpoint`",
    "enable()": "`ta2 enable`",
    "estop()": "`ta2 estop`",
    "stop()": "`ta2 stop`",
    "use move_pose(), which": "use `ta2 move-pose` without --straight, which",
    "connect()": "`ta2 --help`",
}
"""What a program calls -> what a person types."""


FILES = frozenset({"target", "file", "bag", "dataset"})
"""Fields of a refusal that blame a word of the command line, or what is in the file that it names."""


def in_shell_words(hint: str) -> str:
    """Return a hint as a person in a shell would follow it."""
    for call, command in SHELL_WORDS.items():
        hint = re.sub(rf"(?<![\w.]){re.escape(call)}", command, hint)  # whole words alone
    return hint


def status_of(error: GatewayError) -> ExitStatus:
    """Return the exit status of an error."""
    if isinstance(error, ConfigError) or (isinstance(error, Rejected) and error.field in FILES):
        return ExitStatus.USAGE
    if isinstance(error, Disconnected):
        return ExitStatus.NO_GATEWAY
    if isinstance(error, (GatewayTimeout, OutcomeUnknown)):
        return ExitStatus.UNKNOWN
    if isinstance(error, (ProtocolError, InternalError)):
        return ExitStatus.BROKEN
    return ExitStatus.REFUSED


def line_of(error: GatewayError) -> str:
    """Return `CODE: message -> hint`."""
    hint = in_shell_words(error.hint)
    return f"{error.code}: {error.message}" + (f" -> {hint}" if hint else "")


def report(error: GatewayError, *, as_json: bool = False, takes: bool = True) -> ExitStatus:
    """Tell what went wrong, on standard error, and for scripts as JSON on standard output; return the exit status.

    `takes` says whether the command has --take: where it has none, no hint names it.
    """
    status = status_of(error)
    print(line_of(error) if takes else line_of(error).replace(", or --take REASON", ""), file=sys.stderr)
    if as_json:
        facts = asdict(error.refusal) | {"retryable": error.retryable}
        print(json.dumps({"ok": False, "error": facts, "exit_status": int(status)}, ensure_ascii=False))
    return status


def for_stopping(error: GatewayError) -> GatewayError:
    """Return the same error with the only hint that counts when a stop failed."""
    if isinstance(error, (Disconnected, OutcomeUnknown, GatewayTimeout)):
        return to_exception(replace(error.refusal, hint=STOP_UNKNOWN))
    return error


def undelivered() -> GatewayError:
    """Return the error of a stop that had no way to the robot."""
    return failure(Code.STOP_UNDELIVERED, "the gateway has no transport to the robot: the stop did not leave")
