"""Starts, questions, freezes and kills the stand-in robot of `stand_in.py`; waits for things with a deadline."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import time
from pathlib import Path

__all__ = ["RobotProcess", "wait_until"]

ROOT = Path(__file__).resolve().parents[2]


class RobotProcess:
    """One stand-in process.

    Args:
        port: Port on loopback.
        namespace: Namespace of its bridge.
    """

    def __init__(self, port: int, namespace: str = "") -> None:
        self.endpoint = f"tcp/127.0.0.1:{port}"
        self._command = [sys.executable, "-m", "tests.link.stand_in", self.endpoint, namespace]
        self._process: subprocess.Popen[str] | None = None

    def start(self) -> RobotProcess:
        """Start it and return when it listens."""
        self._process = subprocess.Popen(
            self._command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, cwd=ROOT
        )
        self.zid = json.loads(self._process.stdout.readline())["zid"]
        return self

    def ask(self, do: str, **more):
        """Give one command, return its answer."""
        self._process.stdin.write(json.dumps({"do": do, **more}) + "\n")
        self._process.stdin.flush()
        return json.loads(self._process.stdout.readline())

    def freeze(self) -> None:
        """Stop the process in its tracks (SIGSTOP)."""
        self._process.send_signal(signal.SIGSTOP)

    def thaw(self) -> None:
        """Let it go on (SIGCONT)."""
        self._process.send_signal(signal.SIGCONT)

    def kill(self) -> None:
        """End it without warning; harmless when it has ended."""
        process, self._process = self._process, None
        if process is not None:
            process.kill()
            process.wait()
            process.stdin.close()
            process.stdout.close()


def wait_until(condition, timeout_s: float = 5.0, what: str = ""):
    """Return the first truthy result of `condition`; fail when there is none in time."""
    end_s = time.monotonic() + timeout_s
    while not (found := condition()):
        if time.monotonic() > end_s:
            raise AssertionError(f"not within {timeout_s} s: {what or condition}")
        time.sleep(0.002)
    return found
