"""`ta2 events`: what the gateway tells, a line each, as it comes; for people and, as JSON lines, for scripts and logs.

Goes on when the gateway is restarted; what was lost on the way stands where it is missing, with its number.
"""

from __future__ import annotations

import sys
from argparse import Namespace

import msgspec

from gateway.api import protocol
from gateway.cli.terminal.connection import connected
from gateway.cli.terminal.ending import ExitStatus, Interrupted, in_shell_words

__all__ = ["carry_out", "line_of_notice"]


def carry_out(options: Namespace) -> ExitStatus:
    """Print notices until Ctrl-C, or until there was silence.

    Raises:
        Disconnected: No gateway answers at the beginning, or there was silence for lack of one.
    """
    with connected("events", options.target, options.timeout_s) as robot:
        print(f"listening to {robot!r}; Ctrl-C ends it", file=sys.stderr)
        try:
            for notice in robot.events(timeout=options.silence):
                print(msgspec.json.encode(notice).decode() if options.json else line_of_notice(notice), flush=True)
        except Interrupted:
            raise
        except KeyboardInterrupt:
            pass
    return ExitStatus.OK


def line_of_notice(notice: protocol.Notice) -> str:
    """Return a notice as a person reads it."""
    facts = "".join(f" {name}={value}" for name, value in notice.facts.items())
    return f"{notice.level:<7} {notice.code}: {in_shell_words(notice.message)}{facts}"
