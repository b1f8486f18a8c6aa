"""A program that attacks a running system over zenoh: `python -m tests.fuzz.attacker local|robot TARGET SEED COUNT`.

`local` sends requests, puts, deletions, tokens and declarations to the daemon's socket; `robot` publishes samples and
declares tokens in the robot's router, where it also listens to learn what good samples look like. Raw zenoh: it uses no
client of ours. Ends by itself and prints what it did as one line of JSON; whoever starts it sets the deadline.
"""

from __future__ import annotations

import json
import random
import sys
import threading
from collections import Counter
from collections.abc import Callable
from typing import Any

import zenoh

from gateway.robot.topics import STATE_TOPICS
from tests.fuzz.hostile import ODD, WORDS, as_json, as_msgpack, monster, mutated, scratched, twisted
from tests.fuzz.inventor import KINDS, Inventor

MEGABYTE = 1 << 20
BATCH = 500
"""After so many payloads a payload of a megabyte ends the connection, and a new one is made."""
OUTSTANDING = 32
"""Queries that may wait for their replies at once."""
PATIENCE_S = 5.0
BREATH_S = 0.004
"""Pause after every few samples [s]: of what arrives between two ticks the daemon reads only the newest."""

Q = [0.1, 0.5, -0.3, 0.9, 0.2, -0.1, 0.3]
HINTS: dict[str, Callable[[], Any]] = {
    "epoch": lambda: 1,
    "name": lambda: "a",
    "targets_rad": lambda: {"left": Q, "right": Q},
    "points": lambda: {"left": [Q, Q, Q]},
    "times_s": lambda: None,
    "dt_s": lambda: 0.1,
    "reason": lambda: "\x1b[2J\nforged",
}
"""What makes sense to this daemon; everything else is invented from the requests' own structs."""
QUESTIONS = ("ta2/1/command", "ta2/1/info", "ta2/1/routes", "ta2/1/snapshot")
"""Keys on which every query is answered, whatever it carries."""
ANY_KEYS = (
    *QUESTIONS, "ta2/1/event", "ta2/1/target/me/1", "ta2/1/target/me/x", "ta2/1/target/me/1/2", "ta2/1/keepalive/me",
    "ta2/1/keepalive/人", "ta2/2/command", "ta2/1/alive/client/me", "ta2/1/alive/daemon/me", "ta2/1", "other",
    "api/fsm/enable", "api/left_arm/joint_cmd", "left_arm/joint_states", "@/a/@ros2_lv", "ta2/1/target/" + "k" * 3_000 + "/1",
)  # fmt: skip
SELECTORS = ("ta2/1/*", "ta2/**", "**", "@/**", "ta2/1/command/**", "ta2/*/info", "*/1/snapshot", *ANY_KEYS)
ENCODINGS = ("application/msgpack", "application/json", "zenoh/bytes", "text/plain", "application/cbor", "x" * 200)


def connect(endpoint: str) -> zenoh.Session:
    """Return a session of a client that only knows this endpoint."""
    config = {
        "mode": "client",
        "connect": {"endpoints": [endpoint], "timeout_ms": 5000, "exit_on_failure": True},
        "listen": {"endpoints": []},
        "scouting": {"multicast": {"enabled": False}, "gossip": {"enabled": False}},
        "transport": {"shared_memory": {"enabled": False}},
    }
    return zenoh.open(zenoh.Config.from_json5(json.dumps(config)))


class LocalAttack:
    """Attacks the daemon's socket."""

    def __init__(self, rng: random.Random, target: str) -> None:
        self.rng = rng
        self.endpoint = f"unixsock-stream/{target}"
        self.session = connect(self.endpoint)
        self.inventor = Inventor(rng, HINTS)
        self.done: Counter[str] = Counter()
        self.codes: Counter[str] = Counter()
        self.unanswered: list[int] = []
        """Numbers of the payloads with which questions went that nobody answered."""
        self._number = 0
        self._slots = threading.Semaphore(OUTSTANDING)
        self._kept: list[Any] = []

    def run(self, count: int) -> None:
        """Send so many payloads, most of them with queries that must be answered."""
        acts = (self.ask, self.ask, self.ask, self.select, self.put, self.put, self.delete, self.declare)
        for number in range(1, count + 1):
            self._number = number
            try:
                self.rng.choice(acts)()
            except zenoh.ZError:
                self.done["not sent"] += 1
            if number % BATCH == 0:
                self.end_connection()
        self.session.close()

    def end_connection(self) -> None:
        """Wait for what is outstanding, send what ends a connection, and connect anew."""
        for _ in range(OUTSTANDING):
            if not self._slots.acquire(timeout=PATIENCE_S):
                self.done["never finished"] += 1
        self.done["megabytes"] += 1
        try:
            if self.rng.random() < 0.5:
                self.session.put("ta2/1/target/me/1", bytes(MEGABYTE))
            else:
                self.session.get("ta2/1/command", zenoh.handlers.Callback(lambda reply: None), payload=bytes(MEGABYTE))
        except zenoh.ZError:
            self.done["not sent"] += 1
        self._kept.clear()
        self.session.close()
        self.session = connect(self.endpoint)
        self._slots = threading.Semaphore(OUTSTANDING)

    def payload(self) -> tuple[bytes, str]:
        """Return hostile bytes and the encoding that is claimed for them."""
        rng = self.rng
        request = self.inventor.request(rng.choice(tuple(KINDS)))
        message = {
            "version": 1,
            "client_id": "me",
            "secret": "s",
            "request_id": rng.randrange(2**40),
            "request": request,
        }
        if rng.random() < 0.15:
            message = {"epoch": 1, "seq": rng.randrange(2**40), "values": Q}
        is_json, fate = rng.random() < 0.5, rng.random()
        if fate < 0.05:
            payload = monster(rng, message, is_json=is_json)
        elif fate < 0.08:
            payload = rng.randbytes(rng.choice((65_536, 65_537, 200_000)))
        else:
            odd: Any = message if fate < 0.2 else twisted(rng, message) if fate < 0.5 else mutated(rng, message)
            payload = as_json(odd) if is_json else as_msgpack(odd)
            if fate > 0.85:
                payload = scratched(rng, payload)
        right = ENCODINGS[1] if is_json else ENCODINGS[0]
        return payload, right if rng.random() < 0.95 else rng.choice(ENCODINGS)

    def ask(self) -> None:
        """Query a key that is answered."""
        self._get(self.rng.choice((QUESTIONS[0], QUESTIONS[0], *QUESTIONS)), "question", 1)

    def select(self) -> None:
        """Query whatever there is; most of it is dropped before it reaches the daemon."""
        self._get(self.rng.choice(SELECTORS), "selector", 0)

    def _get(self, selector: str, what: str, due: int) -> None:
        if not self._slots.acquire(timeout=PATIENCE_S):
            self.done["never finished"] += 1
        payload, encoding = self.payload()
        answers, slots, number = [0], self._slots, self._number

        def take(reply: zenoh.Reply) -> None:
            answers[0] += 1
            if due and reply.ok is not None:
                self._note(reply.ok.payload.to_bytes(), str(reply.ok.encoding))

        def finish() -> None:
            self.done[f"{what} answered {answers[0]}" if due else what] += 1
            if due and not answers[0]:
                self.unanswered.append(number)
            slots.release()

        try:
            self.session.get(
                selector, zenoh.handlers.Callback(take, finish, indirect=False), payload=payload, encoding=encoding,
                timeout=3.0 if due else 0.2, consolidation=zenoh.ConsolidationMode.NONE,
            )  # fmt: skip
        except zenoh.ZError:
            finish()

    def _note(self, payload: bytes, encoding: str) -> None:
        if encoding.startswith("application/json"):
            refusal = json.loads(payload).get("refusal", {})
            self.codes[refusal["code"] if refusal else "no refusal"] += 1

    def put(self) -> None:
        """Put on any key."""
        payload, encoding = self.payload()
        self.done["put"] += 1
        self.session.put(
            self.rng.choice(ANY_KEYS), payload, encoding=encoding, congestion_control=zenoh.CongestionControl.DROP
        )

    def delete(self) -> None:
        """Delete any key."""
        self.done["delete"] += 1
        self.session.delete(self.rng.choice(ANY_KEYS))

    def declare(self) -> None:
        """Pretend to be a daemon, a client or somebody who listens; keep it for a while."""
        rng, key = self.rng, self.rng.choice(ANY_KEYS)
        self.done["declaration"] += 1
        ignore = zenoh.handlers.Callback(lambda _: None, indirect=False)
        what = rng.randrange(5)
        if what == 0:
            self._kept.append(
                self.session.liveliness().declare_token(rng.choice((key, f"ta2/1/alive/client/c{rng.random()}")))
            )
        elif what == 1:
            self._kept.append(self.session.declare_subscriber(rng.choice(SELECTORS), ignore))
        elif what == 2:
            self._kept.append(self.session.declare_queryable(key, ignore))
        elif what == 3:
            self._kept.append(self.session.liveliness().declare_subscriber(rng.choice(SELECTORS), ignore, history=True))
        else:
            self._kept.append(self.session.declare_publisher(key))
        while len(self._kept) > 20:
            self._kept.pop(rng.randrange(20)).undeclare()


class RobotAttack:
    """Attacks the daemon through the robot's router."""

    def __init__(self, rng: random.Random, target: str) -> None:
        self.rng = rng
        self.session = connect(target)
        self.done: Counter[str] = Counter()
        self.codes: Counter[str] = Counter()
        self.unanswered: list[int] = []
        self.keys = [topic[1:] for topic in STATE_TOPICS]
        self.good: dict[str, bytes] = dict.fromkeys(self.keys, b"\x00\x01\x00\x00")
        self._kept: list[Any] = []
        for key in self.keys:
            self.session.declare_subscriber(key, zenoh.handlers.Callback(self._learn, indirect=False))

    def _learn(self, sample: zenoh.Sample) -> None:
        payload = sample.payload.to_bytes()
        if len(payload) < 2_000:
            self.good[str(sample.key_expr)] = payload

    def run(self, count: int) -> None:
        """Publish so many samples, with tokens that come and go among them."""
        pause = threading.Event()
        for number in range(count):
            if number % 5 == 0:
                self.declare_token()
                pause.wait(BREATH_S)
            self.publish()
        self._kept.clear()
        self.session.close()

    def publish(self) -> None:
        """Publish one hostile sample."""
        rng, key = self.rng, self.rng.choice(self.keys)
        good, fate = self.good[key], rng.random()
        if fate < 0.01:
            self.done["megabytes"] += 1
            payload = good[:4] + bytes(MEGABYTE)
        elif fate < 0.03:
            self.done["delete"] += 1
            self.session.delete(key)
            return
        elif fate < 0.15:
            self.done["foreign"] += 1
            payload = self.good[rng.choice(self.keys)]
        elif fate < 0.25:
            self.done["shapeless"] += 1
            payload = rng.choice((b"", good[:4], rng.randbytes(rng.randrange(500)), good[:4] + rng.choice(WORDS) * 50))
        else:
            self.done["scratched"] += 1
            payload = scratched(rng, good, WORDS)
        self.session.put(key, payload, congestion_control=zenoh.CongestionControl.BLOCK)

    def declare_token(self) -> None:
        """Announce a publisher, a subscriber, a service or nonsense, as a bridge would; keep it for a while."""
        rng = self.rng
        zid = rng.choice((str(self.session.zid()), "0", "f" * 32, "F", "f" * 33, "人"))
        name = rng.choice((*self.keys, "api/fsm/enable", "x" * 2_000, "§", "a§§b", "人"))
        kind = rng.choice(("MP", "MS", "SS", "AC", "mp", "", "ZZ"))
        type_name = rng.choice(("sensor_msgs§msg§JointState", "x", "§"))
        qos = rng.choice((":1::", ":::", "1:2:3:4", "::::::", "K:9:99999999999999999999:", str(rng.choice(ODD))))
        parts = [zid, "@ros2_lv", kind, name.replace("/", "§"), type_name, qos]
        key = "/".join(["@", *parts[: rng.randint(2, 6)], *(["more"] if rng.random() < 0.05 else [])])
        try:
            self._kept.append(self.session.liveliness().declare_token(key))
            self.done["token"] += 1
        except zenoh.ZError:
            self.done["no key"] += 1
        while len(self._kept) > 30:
            self._kept.pop(rng.randrange(30)).undeclare()


def main(side: str, target: str, seed: str, count: str) -> None:
    """Attack, and say what was done."""
    attack = (LocalAttack if side == "local" else RobotAttack)(random.Random(int(seed)), target)
    attack.run(int(count))
    done = {"done": attack.done, "codes": attack.codes, "unanswered": attack.unanswered}
    print("DONE " + json.dumps(done), flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
