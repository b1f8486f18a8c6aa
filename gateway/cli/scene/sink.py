"""Where a scene goes: into a file, or to Rerun's viewer, a process of its own that is told by a pipe.

A viewer that hangs holds up nobody but this process, which owns nothing. Left to itself it would listen on all networks and
report to its makers how it is used: here it listens on loopback alone, and reports nothing.
"""

from __future__ import annotations

import os
import subprocess
from contextlib import suppress
from pathlib import Path

import rerun as rr
import rerun_cli

from gateway.errors import Code, GatewayError, failure

__all__ = ["Sink"]

GRACE_S = 2.0  # for a viewer that is to end
NICE = 10  # whatever drawing costs, the gateway goes first
OPTIONS = ("--bind", "127.0.0.1", "--port", "0", "--memory-limit", "2GB", "--hide-welcome-screen", "--expect-data-soon")
ENVIRONMENT = {"CI": "1", "RUST_LOG": "warn"}  # the first turns its reports off, and leaves the user's settings alone


class Sink:
    """Takes what is drawn: into a file, to be written or written over, or where that is None into a window.

    Raises `GatewayError`, BAD_REQUEST, where that cannot be. `RERUN_CLI_PATH` names another viewer, as Rerun has it.
    """

    def __init__(self, stream: rr.RecordingStream, file: Path | None) -> None:
        self._stream, self._viewer = stream, None
        try:
            if file is not None:
                stream.save(file)
                return
            self._drawn = rr.binary_stream(stream)
            program = os.environ.get("RERUN_CLI_PATH") or Path(rerun_cli.__file__).with_name("rerun")
            quiet = {**os.environ, **ENVIRONMENT}
            pipe, nothing = subprocess.PIPE, subprocess.DEVNULL
            self._viewer = subprocess.Popen([program, "-", *OPTIONS], stdin=pipe, stdout=nothing, env=quiet)
            nice = max(NICE, os.getpriority(os.PRIO_PROCESS, 0))
            os.setpriority(os.PRIO_PROCESS, self._viewer.pid, nice)
        except (RuntimeError, OSError) as error:
            raise _refused(str(error), "name a place that can be written" if file else "") from None

    def push(self) -> bool:
        """Hand on what was drawn; return whether there is still somebody who looks. Raises as `wait`."""
        if self._viewer is None:
            return True
        if self._viewer.poll() is None and self._viewer.stdin is not None:
            with suppress(BrokenPipeError):
                self._viewer.stdin.write(self._drawn.read() or b"")
                self._viewer.stdin.flush()
                return True
        self.wait()
        return False

    def wait(self) -> None:
        """Wait until nobody looks any more; raise GatewayError, BAD_REQUEST, where the viewer ended by an error."""
        if self._viewer is not None and (status := self._viewer.wait()):
            hint = "a window takes a display and a graphics driver; --save FILE takes neither"
            raise _refused(f"Rerun's viewer ended with status {status}", hint)

    def close(self) -> None:
        """Write the rest of a file, or end the viewer, whatever it does."""
        if self._viewer is None:
            self._stream.disconnect()
            return
        self._viewer.terminate()
        try:
            self._viewer.wait(GRACE_S)
        except subprocess.TimeoutExpired:
            self._viewer.kill()
        with suppress(BrokenPipeError):
            self._viewer.communicate()


def _refused(message: str, hint: str) -> GatewayError:
    return failure(Code.BAD_REQUEST, message, hint=hint)
