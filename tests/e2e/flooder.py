"""A program that floods the daemon's socket: `python -m tests.e2e.flooder KIND SOCKET SECONDS`.

Raw zenoh, and raw sockets: it uses no client of ours. It owns nothing, knows nobody's secret, goes as fast as it can for so
long, never stops the robot, and says at its end what it sent. `ready` is printed when the flood begins.
"""

from __future__ import annotations

import os
import random
import signal
import socket
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from itertools import count
from typing import Any

import msgspec
import zenoh

from tests.fuzz.attacker import connect

__all__ = ["KINDS"]

LARGE = 64 * 1024
OUTSTANDING = 64
"""Questions of a session that may wait for their answers at once: what a client with the patience of a flood would have."""
SESSIONS = 500
TOKEN_SESSIONS, TOKENS_OF_EACH = 40, 250
HALF_OPEN = 200
POSES = 450
NUMBERS = count(1)

ROOT = "ta2/1"
ME, MINE = f"flooder{os.getpid()}", "s" * 32


def _request(request: dict[str, Any]) -> bytes:
    """Return a request of this process's own identity, under a number of its own."""
    command = {"version": 1, "client_id": ME, "secret": MINE, "request_id": next(NUMBERS), "request": request}
    return msgspec.msgpack.encode(command)


def _poses() -> dict[str, Any]:
    point = [0.3, 0.1, -0.2, 0.0, 0.0, 0.0, 1.0]
    arms = ("left", "right")
    follow = {
        "epoch": 1,
        "points": {arm: [point] * POSES for arm in arms},
        "space": "pose",
        "frames": {arm: f"{arm}_shoulder_base" for arm in arms},
        "dt_s": 0.02,
    }
    return {"type": "check_follow", "follow": {"type": "follow", **follow}}


class Flood:
    """One session that floods until its time is over."""

    def __init__(self, endpoint: str, until: float) -> None:
        self.session = connect(endpoint)
        self.until = until
        self.sent = 0
        self._slots = threading.Semaphore(OUTSTANDING)

    def put(self, keys: Iterator[str], payload: bytes) -> None:
        """Put the same payload on one key after the other."""
        drop = zenoh.CongestionControl.DROP
        while time.monotonic() < self.until:
            for _ in range(100):
                self.session.put(next(keys), payload, congestion_control=drop)
            self.sent += 100

    def ask(self, key: str, payload: Callable[[], bytes]) -> None:
        """Ask without end; what is not answered is given up after two seconds."""
        ignore = zenoh.handlers.Callback(lambda _: None, self._slots.release, indirect=False)
        while time.monotonic() < self.until:
            if not self._slots.acquire(timeout=0.1):
                continue
            self.session.get(key, ignore, payload=payload(), timeout=2.0)
            self.sent += 1


def keepalives(flood: Flood) -> None:
    """Keepalives of clients that do not exist."""
    flood.put((f"{ROOT}/keepalive/x{n % 1000}/{n}" for n in count()), b"")


def targets(flood: Flood) -> None:
    """Targets of streams that do not exist."""
    target = msgspec.msgpack.encode({"epoch": 1, "seq": 1, "values": [0.1] * 7})
    flood.put((f"{ROOT}/target/x{n % 1000}/{n}/{n}" for n in count()), target)


def wildcards(flood: Flood) -> None:
    """Keepalives and targets of everybody at once."""
    keys = (
        *(f"{ROOT}/keepalive/**", f"{ROOT}/keepalive/*/*", f"{ROOT}/target/*/*/*", f"{ROOT}/check_in/**"),
        *(f"{ROOT}/check_in/*/{digit}$*" for digit in "0123456789abcdef"),
    )
    flood.put((keys[n % len(keys)] for n in count()), b"")


def large_puts(flood: Flood) -> None:
    """Targets of 64 kB."""
    flood.put((f"{ROOT}/target/x{n % 1000}/1/{n}" for n in count()), bytes(LARGE))


def own_keys(flood: Flood) -> None:
    """Keepalives and targets of a client that is known, with its secret: a former owner's, say."""
    session, acquire = flood.session, {"type": "acquire", "name": "flooder", "pid": os.getpid()}
    for _ in session.get(f"{ROOT}/command", payload=_request(acquire), timeout=2.0):
        pass
    target = msgspec.msgpack.encode({"epoch": 1, "seq": 1, "values": [0.1] * 7})
    keys = (f"{ROOT}/keepalive/{ME}/{MINE}", f"{ROOT}/target/{ME}/1/{MINE}")
    flood.put((keys[n % 2] for n in count()), target)


def large_questions(flood: Flood) -> None:
    """Requests of 64 kB that cannot be read."""
    payload = b"\x91" * LARGE
    flood.ask(f"{ROOT}/command", lambda: payload)


def questions(flood: Flood) -> None:
    """Small requests that are refused: the robot belongs to somebody."""
    acquire = {"type": "acquire", "name": "flooder", "pid": os.getpid()}
    flood.ask(f"{ROOT}/command", lambda: _request(acquire))


def chunks(flood: Flood) -> None:
    """Chunks of 450 poses for both arms, to be judged."""
    poses = _poses()
    flood.ask(f"{ROOT}/command", lambda: _request(poses))


def snapshots(flood: Flood) -> None:
    """Questions for the newest snapshot."""
    flood.ask(f"{ROOT}/snapshot", lambda: b"")


def pings(flood: Flood) -> None:
    """Questions whether anybody is there, which the guard asks, too."""
    flood.ask("ta2/ping", lambda: b"")


FLOODS: dict[str, Callable[[Flood], None]] = {
    flood.__name__: flood
    for flood in (
        keepalives, targets, wildcards, large_puts, own_keys, large_questions, questions, chunks, snapshots, pings
    )
}  # fmt: skip


def sessions(endpoint: str, until: float) -> int:
    """Hold 500 sessions, each with a token and a listener, that send keepalives in turn."""
    ignore = zenoh.handlers.Callback(lambda _: None, indirect=False)
    held: list[tuple[zenoh.Session, Any]] = []
    sent = 0
    while time.monotonic() < until:
        if len(held) < SESSIONS:
            with suppress(zenoh.ZError):  # hung up on
                session = connect(endpoint)
                session.declare_subscriber(f"{ROOT}/event", ignore)
                held.append((session, session.liveliness().declare_token(f"{ROOT}/alive/client/x{len(held)}")))
        for session, _ in random.sample(held, min(len(held), 10)):
            session.put(f"{ROOT}/keepalive/x/{sent}", b"")
            sent += 1
    print(f"{len(held)} sessions")
    os._exit(0)  # they end as those of a process that died do


def tokens(endpoint: str, until: float) -> int:
    """Declare 10,000 tokens of clients that are not there, in 40 sessions that zenoh opens anew with all of them; wait."""
    held = [connect(endpoint) for _ in range(TOKEN_SESSIONS)]
    kept = [
        session.liveliness().declare_token(f"{ROOT}/alive/client/{ME}x{number}x{n}")
        for n in range(TOKENS_OF_EACH)
        for number, session in enumerate(held)
    ]
    time.sleep(max(until - time.monotonic(), 0.0))
    print(f"{len(kept)} tokens")
    os._exit(0)  # as above


def half_open(endpoint: str, until: float) -> int:
    """Connect again and again and say half a word, or none."""
    path = endpoint.removeprefix("unixsock-stream/")
    held: list[socket.socket] = []
    sent = 0
    while time.monotonic() < until:
        caller = socket.socket(socket.AF_UNIX)
        caller.settimeout(0.05)
        with suppress(OSError):
            caller.connect(path)
            caller.send((b"", b"\x40\x00", b"\x20\x00\x01\x09\xff" * 5)[sent % 3])
        held.append(caller)
        sent += 1
        if len(held) > HALF_OPEN:
            held.pop(0).close()
    return sent


def deaf(endpoint: str, until: float) -> int:
    """Listen to all that is published, ask for more, and read none of it: the process stands still."""
    ignore = zenoh.handlers.Callback(lambda _: None, indirect=False)
    held = []
    for _ in range(20):
        session = connect(endpoint)
        held += [session.declare_subscriber(f"{ROOT}/{what}", ignore) for what in ("snapshot", "event")]
        for _ in range(OUTSTANDING):
            session.get(f"{ROOT}/snapshot", ignore, timeout=10.0)
    os.kill(os.getpid(), signal.SIGSTOP)
    return len(held)


def spin(endpoint: str, until: float) -> int:
    """Send nothing, and take as much processor time as the others do: what they cost whom they only compete with."""
    spun = 0
    while time.monotonic() < until:
        spun += 1
    return spun


PROCESSES: dict[str, Callable[[str, float], int]] = {
    process.__name__: process for process in (sessions, tokens, half_open, deaf, spin)
}

KINDS = (*FLOODS, *PROCESSES)


def main(kind: str, path: str, seconds: str) -> None:
    """Flood, and say how much."""
    endpoint, until = f"unixsock-stream/{path}", time.monotonic() + float(seconds)
    if kind in PROCESSES:
        print("ready", flush=True)
        sent = PROCESSES[kind](endpoint, until)
    else:
        flood = Flood(endpoint, until)
        print("ready", flush=True)
        FLOODS[kind](flood)
        sent = flood.sent
        flood.session.close()
    print(f"sent {sent}", flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
