"""`ta2 episode`: a running recorder is told that an episode begins or ends, or what came of it."""

from __future__ import annotations

import json
from argparse import Namespace

import msgspec

from gateway.api.recorder_protocol import RecordingState
from gateway.cli.terminal.ending import ExitStatus
from gateway.client.connection.recorder import ask_recorder

__all__ = ["carry_out", "line_of"]


def carry_out(options: Namespace) -> ExitStatus:
    """Tell it, and show how the recording is then.

    Raises:
        NotReady: NO_RECORDER, nobody records.
        Rejected: It cannot be done now.
        OutcomeUnknown: The recorder did not answer.
    """
    text, task = " ".join(options.text), options.task
    if options.verb == "start" and not task:
        text, task = "", text
    state = ask_recorder(options.target, options.verb, task, text, options.timeout_s)
    if options.json:
        print(json.dumps({"ok": True, **msgspec.to_builtins(state)}, ensure_ascii=False))
        return ExitStatus.OK
    print(f"{state.bag}: {line_of(state)}")
    return ExitStatus.OK


def line_of(state: RecordingState) -> str:
    """Return which episode goes on, or has ended, with its task."""
    if not state.episode:
        return "no episode yet"
    task = f": {state.task}" if state.task else ""
    return f"episode {state.episode} {'goes on' if state.is_running else 'has ended'}{task}"
