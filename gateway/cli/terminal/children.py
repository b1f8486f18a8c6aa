"""Programs of `ta2` as children: processes that end with their block, and a gateway as soon as it is there."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import gateway.client
from gateway.client import Robot
from gateway.errors import Code, Disconnected, GatewayTimeout, failure
from gateway.process.own_module import own_module

__all__ = ["child", "when_live"]

START_S = 20.0
END_S = 8.0


@contextmanager
def child(name: str, arguments: Sequence[str], log: Path) -> Iterator[subprocess.Popen[bytes]]:
    """Run `ta2` with arguments; end it by SIGTERM and see that it ends, unless the block has killed it.

    Args:
        name: For people.
        arguments: Of `ta2`.
        log: Takes what it prints; state files go beside it.
    """
    with log.open("w") as stream:
        process = subprocess.Popen(
            own_module("gateway.cli", *arguments),
            stdin=subprocess.DEVNULL,
            stdout=stream,
            stderr=subprocess.STDOUT,
            env={**os.environ, "TA2_STATE_DIR": str(log.parent / "state")},
            start_new_session=True,  # Ctrl-C must not reach it: it ends in order
        )
    is_killed = False
    try:
        yield process
    finally:
        is_killed = process.poll() == -signal.SIGKILL
        process.terminate()
        try:
            status = process.wait(END_S)
        except subprocess.TimeoutExpired:
            process.kill()
            status = process.wait()
        if status not in (0, -signal.SIGTERM) and not is_killed:
            print(f"{name} ended with status {status}; its log:\n{_end_of(log)}", file=sys.stderr)


def when_live(target: str, name: str, log: Path) -> Robot:
    """Connect as soon as a gateway listens and sees its robot.

    The end of the log is told when there is none.

    Raises:
        Disconnected: Nobody listens in time.
        GatewayTimeout: No live robot in time.
    """
    deadline_s = time.monotonic() + START_S
    while True:
        try:
            robot = gateway.client.connect(target, name=name, timeout_s=1.0)
            break
        except (Disconnected, GatewayTimeout):
            if time.monotonic() > deadline_s:
                print(_end_of(log), file=sys.stderr)
                raise
    for state in robot.states(timeout=START_S):
        if state.link.fresh and state.mode is not None:
            return robot
        if time.monotonic() > deadline_s:
            break
    robot.close()
    raise failure(Code.TIMEOUT, f"no robot that lives within {START_S:g} s", hint="`ta2 link`")


def _end_of(log: Path) -> str:
    return log.read_text(errors="replace")[-2000:]
