"""A program that commands at random over the local API: `python -m tests.interop.commander SOCKET SEED COUNT`.

Requests of every kind, most of them sensible and many of them not, and targets of the streams that it opens; it owns
the robot, recovers and enables again after whatever it has done to itself, so that most of the time something moves.
Raw zenoh and structs of the protocol: no client of ours stands between. Ends by itself with one line of JSON.
"""

from __future__ import annotations

import json
import random
import sys
import threading
import time
from collections import Counter
from typing import Any

import zenoh

from gateway.api import protocol
from gateway.sim.robot.manual import LOWER_RAD, UPPER_RAD, Side
from tests.fuzz.attacker import connect
from tests.fuzz.inventor import KINDS, Inventor

ME = "commander"
SECRET = "s"
SIDES = ("left", "right")
OUTSTANDING = 16
"""Requests that may wait for their replies at once."""
PATIENCE_S = 10.0
CARE_S = 0.25
"""How often it looks after its lease and the robot's state [s]."""
RATE_HZ = 600.0
"""How many commands a second: nobody asks more, and it leaves the robot time to move."""
GOAL_S = 1.5
"""How long the arms are sent to the same place, often to the end of a joint's range [s]."""
WEIGHTS = {
    **dict.fromkeys(("drive_chassis", "drive_lift", "set_gripper"), 8.0),
    **dict.fromkeys(("move", "follow"), 3.0),
    **dict.fromkeys(("hold", "cancel", "close_stream", "stop_lift", "disable_lift", "stop_chassis"), 0.3),
    **dict.fromkeys(("stop", "estop", "release", "abandon", "disable", "take", "acquire"), 0.015),
}
"""How often each kind is asked beside the others, 1 when not named: what ends everything else comes seldom."""


class Commander:
    """Commands at random.

    Args:
        rng: Source of everything.
        socket: The daemon's.
    """

    def __init__(self, rng: random.Random, socket: str) -> None:
        self.rng = rng
        self.session = connect(f"unixsock-stream/{socket}")
        self._token = self.session.liveliness().declare_token(protocol.client_token(ME))
        self.done: Counter[str] = Counter()
        self._epoch, self._last_id, self._seq = 0, 0, 0
        self._streams: dict[str, int] = {}
        self._goal: dict[str, list[float]] = {}
        self._goal_until = 0.0
        self._slots = threading.Semaphore(OUTSTANDING)
        self._is_over = threading.Event()
        self._keeper = threading.Thread(target=self._keep, daemon=True)
        self._keeper.start()
        hints = {
            "epoch": lambda: self._epoch,
            "name": lambda: ME,
            "targets_rad": self._targets,
            "points": self._points,
            "speed": lambda: rng.uniform(0.05, 1.0),
            "raw": lambda: rng.uniform(-0.1, 1.1),
            "vx_mps": lambda: rng.uniform(-0.35, 0.35),
            "vy_mps": lambda: rng.uniform(-0.35, 0.35),
            "wz_radps": lambda: rng.uniform(-0.6, 0.6),
            "drive_id": lambda: 0,
            "expiry_ns": lambda: None,
            "velocity": lambda: rng.uniform(-1.1, 1.1),
            "dt_s": lambda: rng.choice((0.02, 0.05, 0.1)),
            "times_s": lambda: None,
            "space": lambda: "joint",
            "relative": lambda: rng.random() < 0.1,
            "on_limit": lambda: rng.choice(("clip", "clip", "reject")),
        }
        self.inventor = Inventor(rng, hints)

    def run(self, count: int) -> None:
        """Send so many commands."""
        kinds = tuple(KINDS)
        weights = [WEIGHTS.get(kind, 1.0) for kind in kinds]
        began = care_at = time.monotonic()
        for number in range(count):
            time.sleep(max(0.0, began + number / RATE_HZ - time.monotonic()))
            if time.monotonic() >= care_at:
                self._care()
                care_at = time.monotonic() + CARE_S
            if self._streams and self.rng.random() < 0.4:
                self._put_target()
            else:
                self._ask(self.inventor.request(self.rng.choices(kinds, weights)[0]))
        for _ in range(OUTSTANDING):
            if not self._slots.acquire(timeout=PATIENCE_S):
                self.done["never answered"] += 1
        self._is_over.set()
        self._keeper.join()
        self.session.close()

    def _keep(self) -> None:
        key = protocol.keepalive_key(ME, SECRET)
        while not self._is_over.wait(0.05):
            self.session.put(key, b"", congestion_control=zenoh.CongestionControl.DROP)

    def _joints(self, side: str) -> list[float]:
        """Return joint values near the place of the moment, one in ten of them somewhat outside the limits."""
        if time.monotonic() > self._goal_until:
            self._goal_until = time.monotonic() + GOAL_S
            self._goal = {name: self._place(Side(name)) for name in SIDES}
        excess = 0.3 if self.rng.random() < 0.1 else 0.0
        return [q + self.rng.choice((0.0, 0.0, -1.0, 1.0)) * (0.02 + excess) for q in self._goal[side]]

    def _place(self, side: Side) -> list[float]:
        """Return a place inside the limits, half of whose joints are at the end of their range."""
        pairs = zip(LOWER_RAD[side], UPPER_RAD[side], strict=True)
        return [
            self.rng.choice((low, high, self.rng.uniform(low, high), self.rng.uniform(low, high)))
            for low, high in pairs
        ]

    def _targets(self) -> dict[str, list[float]]:
        return {side: self._joints(side) for side in SIDES if self.rng.random() < 0.7}

    def _points(self) -> dict[str, list[list[float]]]:
        """Return a slow way from wherever an arm may be."""
        points = {}
        for side in SIDES:
            if self.rng.random() < 0.7:
                begin, step = self._joints(side), [self.rng.uniform(-0.01, 0.01) for _ in range(7)]
                count = self.rng.randint(2, 20)
                points[side] = [[q + n * d for q, d in zip(begin, step, strict=True)] for n in range(count)]
        return points

    def _put_target(self) -> None:
        side, stream = self.rng.choice(tuple(self._streams.items()))
        self._seq += 1
        target = protocol.Target(epoch=self._epoch, seq=self._seq, values=tuple(self._joints(side)))
        self.session.put(f"ta2/1/target/{ME}/{stream}/{SECRET}", protocol.encode(target, protocol.MSGPACK))
        self.done["target"] += 1

    def _care(self) -> None:
        """Own the robot, clear what latched, enable."""
        for request in (
            {"type": "take", "name": ME, "pid": 1, "reason": "goes on"} if not self._epoch else None,
            {"type": "recover"},
            {"type": "enable", "epoch": self._epoch},
        ):
            if request is not None:
                self._ask(request)

    def _ask(self, request: dict[str, Any]) -> None:
        """Send a request; its reply comes when it comes."""
        if not self._slots.acquire(timeout=PATIENCE_S):
            self.done["never answered"] += 1
        self._last_id += 1
        message = {"version": 1, "client_id": ME, "secret": SECRET, "request_id": self._last_id, "request": request}
        kind = str(request["type"])
        self.session.get(
            protocol.COMMAND_KEY,
            zenoh.handlers.Callback(
                lambda reply: self._answered(kind, request, reply), self._slots.release, indirect=False
            ),
            payload=json.dumps(message, allow_nan=True).encode(),
            encoding=protocol.JSON,
            timeout=PATIENCE_S,
        )

    def _answered(self, kind: str, request: dict[str, Any], reply: zenoh.Reply) -> None:
        if reply.ok is None:
            self.done["no reply"] += 1
            return
        answer = json.loads(reply.ok.payload.to_bytes())
        refusal = answer.get("refusal")
        if refusal is not None:
            self.done[f"{kind} {refusal['code']}"] += 1
            # Of what was asked under an earlier epoch, refusals come in after the reply that brought the next one.
            if refusal["code"] in ("NOT_OWNER", "LEASE_STALE", "LEASE_LOST") and request.get("epoch") == self._epoch:
                self._epoch = 0
            return
        self.done[kind] += 1
        facts = answer.get("facts", {})
        if "epoch" in facts:
            self._epoch = int(facts["epoch"])
            self._streams = {}
        if kind in ("release", "abandon"):
            self._epoch = 0
        if kind == "open_stream":
            self._streams = {**self._streams, str(request["side"]): int(facts["stream_id"])}


def main(socket: str, seed: str, count: str) -> None:
    """Command, and say what was done."""
    commander = Commander(random.Random(int(seed)), socket)
    commander.run(int(count))
    print("DONE " + json.dumps(commander.done), flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
