"""100,000 hostile payloads of the local API against an engine that drives a robot: every one is answered once, in words.

They take the daemon's own way (inbox, decoder, translator, engine, outbox) into a pair of engine and simulated robot in
virtual time, while the monitor of the invariants judges every frame that leaves. A nurse keeps the robot enabled, so
that hostile motion requests meet arms that can move.
"""

from __future__ import annotations

import gc
import random
from collections import Counter, OrderedDict
from dataclasses import replace
from typing import Any

import pytest

from gateway import robot
from gateway.api import protocol
from gateway.api.inbox import Inbox
from gateway.api.outbox import Outbox
from gateway.api.translate import describe
from gateway.core.engine import REPLIES_KEPT, Output
from gateway.core.events import CommandRequested, Estop, Event, FrameKind, Reply, Stop
from gateway.core.motions import ENDED_KEPT
from gateway.errors import CODES, Code
from gateway.settings import LocalSettings, Settings
from gateway.values import Side
from tests.fuzz.hostile import TEXTS, as_json, as_msgpack, monster, mutated, scratched, twisted
from tests.fuzz.nurse import OWNER, Nurse
from tests.invariants import Monitor
from tests.pair import Pair

pytestmark = pytest.mark.slow

PAYLOADS = 25_000
SEEDS = (1, 2, 3, 4)
PER_TICK = 20
"""Payloads that lie there together when the loop looks."""
BLOCK = 1_000
"""Payloads from one wild spell to the next."""
WILD = 80
"""Of a block, so many may be well-formed stops, takeovers and releases; then the nurse comes."""

SAFE = (
    "acquire",
    "enable",
    "move",
    "move",
    "move",
    "open_stream",
    "close_stream",
    "hold",
    "cancel",
    "recover",
    "target",
)
LOUD = (*SAFE, "take", "release", "abandon", "disable", "stop", "estop")
CLIENTS = (OWNER, OWNER, OWNER, OWNER, "stranger", "b" * 64)

EXPECTED = {
    Code.BAD_REQUEST, Code.UNSUPPORTED_VERSION, Code.WRONG_SHAPE, Code.NOT_FINITE, Code.OUT_OF_RANGE, Code.UNKNOWN_MOTION,
    Code.UNKNOWN_STREAM, Code.NOT_OWNER, Code.LEASE_HELD, Code.LEASE_STALE, Code.STOPPED,
}  # fmt: skip
"""Refusals that must be among the answers; else the fuzz did not get past the decoder."""


class Question:
    """A query that remembers how it was answered."""

    __slots__ = ("answers", "dropped", "encoding", "key", "payload", "received_ns")

    def __init__(self, key: str, payload: bytes, encoding: str, received_ns: int) -> None:
        self.key, self.payload, self.encoding, self.received_ns = key, payload, encoding, received_ns
        self.answers: list[tuple[bytes, str]] = []
        self.dropped = 0

    def answer(self, payload: bytes, encoding: str) -> None:
        self.answers.append((payload, encoding))

    def drop(self) -> None:
        self.dropped += 1


class Judge(Monitor):
    """The monitor, told when requests arrived: a tick may answer a stop and a motion that was asked for after it."""

    def __init__(self, pair: Pair) -> None:
        super().__init__(pair)
        self.arrived_ns: dict[tuple[str, int], int] = {}
        self.stopped_ns = 0

    def note(self, event: Event) -> None:
        """Take note of a request that the engine gets."""
        if isinstance(event, CommandRequested):
            self.arrived_ns[event.client_id, event.request_id] = event.received_ns
            if isinstance(event.request, (Stop, Estop)):
                self.stopped_ns = max(self.stopped_ns, event.received_ns)

    def _stopped_at_once(self, output: Output) -> None:
        frames = output.frames
        for reply in output.replies:
            moves = reply.refusal is None and ("motion_id" in reply.facts or "stream_id" in reply.facts)
            if moves and self.arrived_ns.get((reply.client_id, reply.request_id), 0) > self.stopped_ns:
                frames = tuple(frame for frame in frames if frame.kind is not FrameKind.MOTION)
        self.arrived_ns.clear()
        super()._stopped_at_once(replace(output, frames=frames))


class Plane:
    """The local plane in front of a pair, without sockets and threads: what the daemon's loop does on each tick."""

    def __init__(self, pair: Pair) -> None:
        self.pair = pair
        self.monitor = Judge(pair)
        self.outbox = Outbox(describe(pair.settings, socket="/tmp/gw.sock", pid=1))
        self.inbox = Inbox(self.outbox)
        self.outbox.add_audience(self)
        self.waiting: list[Question] = []
        self.notices = self.snapshots = self.repeated = 0
        self.followed: set[int] = set()
        """Streams of which a target was accepted."""
        self._seen: OrderedDict[int, Reply] = OrderedDict()
        self.codes: Counter[str] = Counter()
        self.moved: Counter[FrameKind] = Counter()
        pair.on_step = self.see

    def ask(self, key: str, payload: bytes, encoding: str) -> None:
        question = Question(key, payload, encoding, self.pair.now_ns)
        self.waiting.append(question)
        self.inbox.ask(question)
        while self.inbox.sort(0):
            pass

    def tick(self) -> None:
        for event in self.inbox.poll():
            self.monitor.note(event)
            self.pair.receive(event)
        self.pair.step()

    def settle(self) -> None:
        """Tick until everything is answered: once at least, and for as many ticks as the inbox spreads requests over."""
        self.tick()
        until_ns = self.pair.now_ns + protocol.REPLY_WITHIN_NS
        while self.waiting:
            assert self.pair.now_ns < until_ns, f"{len(self.waiting)} questions have no answer"
            self.tick()

    def see(self, output: Output) -> None:
        """Judge a tick's frames, and send what it gives."""
        self.monitor.see(replace(output, replies=tuple(filter(self._is_new, output.replies))))
        self.moved.update(frame.kind for frame in output.frames)
        self.outbox.send(output.replies, output.notices)
        if output.snapshot is not None:
            self.outbox.publish_snapshot(output.snapshot)
        while self.outbox.deliver(0):
            pass
        self.outbox.expire(self.pair.now_ns)
        self._judge_answers()

    def _is_new(self, reply: Reply) -> bool:
        """Return whether a reply was made in this tick; a command with a used number gets the old one again."""
        is_new = id(reply) not in self._seen
        self._seen[id(reply)] = reply  # kept, so that no other object gets its id
        if len(self._seen) > 2 * REPLIES_KEPT:
            self._seen.popitem(last=False)
        self.repeated += not is_new
        return is_new

    def _judge_answers(self) -> None:
        """What was answered was answered once, in its own encoding, with a message of the protocol."""
        answered = [question for question in self.waiting if question.answers or question.dropped]
        self.waiting = [question for question in self.waiting if not (question.answers or question.dropped)]
        for question in answered:
            assert len(question.answers) == 1 and not question.dropped, (question.payload[:200], question.answers)
            payload, encoding = question.answers[0]
            assert encoding == (protocol.JSON if question.encoding == protocol.JSON else protocol.MSGPACK)
            if question.key == protocol.INFO_KEY:
                assert protocol.decode_info(payload, encoding) == describe(
                    self.pair.settings, socket="/tmp/gw.sock", pid=1
                )
                continue
            if question.key == protocol.SNAPSHOT_KEY:
                assert protocol.decode_snapshot(payload, encoding).seq > 0
                continue
            reply = protocol.decode_reply(payload, encoding)
            if reply.refusal is None:
                self.codes["accepted"] += 1
                continue
            assert Code(reply.refusal.code) in CODES, reply.refusal
            assert reply.refusal.message and reply.refusal.code != Code.INTERNAL, reply.refusal
            self.codes[reply.refusal.code] += 1

    # as an audience
    def wants_snapshots(self) -> bool:
        return True

    def put_snapshot(self, payload: bytes, seq: int) -> None:
        snapshot = protocol.decode_snapshot(payload)
        assert snapshot.seq == seq
        self.snapshots += 1
        self.followed.update(target.stream_id for target in snapshot.targets if target.seq)

    def put_notice(self, payload: bytes) -> None:
        assert protocol.decode_notice(payload).message
        self.notices += 1


class Attacker:
    """Makes payloads that a client might send: good ones of this very moment, and what became of them."""

    def __init__(self, rng: random.Random, plane: Plane, nurse: Nurse) -> None:
        self.rng = rng
        self.plane = plane
        self.nurse = nurse
        self.sent: Counter[str] = Counter()
        self._next_id = 1

    def attack(self, kinds: tuple[str, ...]) -> None:
        """Send one payload."""
        rng = self.rng
        kind = rng.choice(kinds)
        message = self.target() if kind == "target" else self.command(kind)
        is_json = rng.random() < 0.45
        encoding = protocol.JSON if is_json else rng.choice((protocol.MSGPACK, ""))
        fate = rng.random()
        if fate < 0.03:
            self.sent["monster"] += 1
            payload = monster(rng, message, is_json=is_json)
        else:
            self.sent[
                "good" if fate < 0.2 else "twisted" if fate < 0.5 else "mutated" if fate < 0.85 else "scratched"
            ] += 1
            if 0.2 <= fate < 0.5:
                message = twisted(rng, message)
            elif 0.5 <= fate < 0.85:
                message = mutated(rng, message)
            payload = as_json(message) if is_json else as_msgpack(message)
            if fate >= 0.85:
                payload = scratched(rng, payload)
        if rng.random() < 0.01:
            encoding = rng.choice((protocol.JSON, protocol.MSGPACK, "application/cbor", "\x1b[2J", "x" * 5_000))
        if kind == "target":
            self.plane.inbox.put_target(self.target_key(), payload, encoding, self.plane.pair.now_ns)
        else:
            key = (
                protocol.COMMAND_KEY if rng.random() < 0.995 else rng.choice((protocol.INFO_KEY, protocol.SNAPSHOT_KEY))
            )
            self.plane.ask(key, payload, encoding)

    def epoch(self) -> int:
        return self.rng.choice((*[self.nurse.epoch] * 8, self.nurse.epoch - 1, 0, 2**62))

    def target(self) -> dict[str, Any]:
        rng = self.rng
        q_rad = self.goal(rng.choice(list(Side)), overshoot=0.05)
        return {
            "epoch": self.epoch(),
            "seq": self.plane.pair.now_ns // 1000 + rng.choice((0, 0, 0, -(10**6))),
            "q_rad": q_rad,
        }

    def target_key(self) -> str:
        rng = self.rng
        stream: object = self.plane.pair.engine.open_stream_id or 1
        if rng.random() < 0.15:
            stream = rng.choice(
                ("", "x", "-1", "007", "1_0", "0x1", "1e3", "٣", "9" * 5_000, 2**64, "1/2", " 1", stream)
            )
        return f"{protocol.ROOT}/target/{rng.choice((*CLIENTS, '', '人', 'x' * 300))}/{stream}"

    def goal(self, side: Side, overshoot: float = 0.02) -> list[float]:
        """Return seven joints, mostly inside the limits [rad]."""
        rng = self.rng
        bounds = zip(robot.JOINT_LOWER_RAD[side], robot.JOINT_UPPER_RAD[side], strict=True)
        return [rng.uniform(low - overshoot * rng.random(), high) for low, high in bounds]

    def command(self, kind: str) -> dict[str, Any]:
        rng, epoch = self.rng, self.epoch()
        engine = self.plane.pair.engine
        sides = rng.choice((["left"], ["right"], ["left", "right"]))
        extra: dict[str, Any] = {}
        if kind in ("acquire", "take"):
            extra = {"name": rng.choice(("a", "人", "x" * 64)), "pid": rng.randrange(2**20)}
            extra |= {"reason": "for fun"} if kind == "take" else {"on_loss": rng.choice(("hold", "pause"))}
        elif kind in ("stop", "estop"):
            extra = {"reason": rng.choice(TEXTS)}
        elif kind == "move":
            extra = {
                "epoch": epoch,
                "targets_rad": {side: self.goal(Side(side)) for side in sides},
                "speed": rng.choice((1.0, 0.5, 0.05, 1, 5e-324, 1e-9)),
                "tolerance_rad": rng.choice((None, 0.05, 1e-4)),
                "on_limit": rng.choice(("reject", "clip", "clip")),
            }
            if rng.random() < 0.2:
                extra |= {"relative": True, "targets_rad": {sides[0]: [rng.uniform(-0.1, 0.1) for _ in range(7)]}}
        elif kind == "open_stream":
            extra = {
                "epoch": epoch,
                "side": sides[0],
                "on_limit": "clip",
                "expiry_ns": rng.choice((None, 50_000_000, 10**9)),
            }
        elif kind == "close_stream":
            extra = {"epoch": epoch, "stream_id": rng.choice((engine.open_stream_id or 1, 1, 2**62))}
        elif kind == "hold":
            extra = {"epoch": epoch, "sides": sides}
        elif kind == "cancel":
            extra = {"epoch": epoch, "motion_id": rng.choice((1, self.plane.codes["accepted"], 2**62))}
        elif kind != "recover":
            extra = {"epoch": epoch}
        client = rng.choice(CLIENTS)
        self._next_id += rng.random() < 0.97  # else the number of the command before
        return {
            "version": rng.choice((*[protocol.PROTOCOL_VERSION] * 60, 0, 2)),
            "client_id": client,
            "request_id": self._next_id,
            "request": {"type": kind, **extra},
        }


def lives(rng: random.Random, plane: Plane, *, is_wild: bool) -> None:
    """Sometimes send signs of life, and of death, of clients that exist and that do not."""
    if rng.random() < 0.02:
        plane.inbox.put_keepalive(rng.choice((*CLIENTS, "", "x" * 999)), plane.pair.now_ns)
    if rng.random() < 0.005:
        plane.inbox.put_gone(rng.choice((OWNER, "stranger") if is_wild else ("stranger", "", "人")), plane.pair.now_ns)


@pytest.fixture
def plane() -> Plane:
    """Give a plane before a pair that was never asked anything."""
    pair = Pair(Settings(local=LocalSettings(snapshot_hz=10.0)))
    pair.topics = (*map(robot.arm_state, Side), robot.FSM_STATE, robot.CURRENT_MODE)
    pair.run_until(lambda: pair.state == "READ_ONLY" and pair.knows_mode)
    return Plane(pair)


@pytest.mark.parametrize("seed", SEEDS)
def test_hostile_payloads_are_answered_once_and_nothing_invalid_leaves(plane: Plane, seed: int) -> None:
    """Each request gets one reply with a known code or facts, no exception escapes, every invariant holds on every tick."""
    rng = random.Random(seed)
    pair, nurse = plane.pair, Nurse(plane.pair)
    attacker = Attacker(rng, plane, nurse)
    active = objects = 0
    for number in range(PAYLOADS):
        is_wild = number % BLOCK < WILD
        if number % PER_TICK == 0:
            plane.settle()
            if not is_wild and not nurse.is_well:
                nurse.revive()
            active += nurse.is_well
            pair.frames.clear()
            pair.notices.clear()
            pair.replies.clear()
        if number == PAYLOADS // 5:
            objects = _objects()
            gc.disable()
        lives(rng, plane, is_wild=is_wild)
        attacker.attack(LOUD if is_wild else SAFE)
        pair.now_ns += 400_000
    plane.settle()
    assert gc.collect() < 300, "what was sent left cycles behind, and the daemon collects none"
    assert _objects() < objects + 3_000 + 4 * REPLIES_KEPT, "more is kept than the replies for those who ask again"
    _assert_bounded(plane)

    nurse.revive()
    nurse.move_home()
    assert active > 0.6 * PAYLOADS / PER_TICK, f"the robot was ACTIVE in {active} of {PAYLOADS // PER_TICK} ticks only"
    assert plane.moved[FrameKind.MOTION] > PAYLOADS / 50, plane.moved
    assert len(plane.followed) > 10, "hardly a streamed target was followed"
    missing = {code.value for code in EXPECTED} - plane.codes.keys()
    assert not missing, f"never answered: {missing}, but {plane.codes}"
    print(f"\n{PAYLOADS} payloads {dict(attacker.sent)}, answers {dict(plane.codes)}")
    print(f"{nurse.revivals} revivals, active in {active} ticks, {plane.repeated} repeated, frames {dict(plane.moved)}")
    print(
        f"{len(plane.followed)} streams followed, {plane.inbox.malformed} malformed, {plane.inbox.overflown} too many"
    )


@pytest.mark.parametrize("kind", ["stop", "estop"])
def test_a_stop_stops_under_a_used_number(plane: Plane, kind: str) -> None:
    """A repeated number gets the first reply again and nothing is done, but a stop is never refused: it is done."""
    nurse = Nurse(plane.pair)
    nurse.revive()
    for request in ({"type": "hold", "epoch": nurse.epoch, "sides": ["left"]}, {"type": kind}):
        message = {"version": protocol.PROTOCOL_VERSION, "client_id": "novice", "request_id": 1, "request": request}
        plane.ask(protocol.COMMAND_KEY, as_json(message), protocol.JSON)
        plane.settle()
    assert plane.pair.engine.latches.keys() == {Code.ESTOP if kind == "estop" else Code.STOPPED_BY_OTHER}


def _objects() -> int:
    """Return how many objects there are, after a collection of cycles."""
    gc.collect()
    return len(gc.get_objects())


def _assert_bounded(plane: Plane) -> None:
    """What the daemon keeps of requests is as much as it says."""
    engine, inbox, outbox = plane.pair.engine, plane.inbox, plane.outbox
    assert len(engine._answered) <= REPLIES_KEPT
    assert not engine._targets and not engine._commands
    assert not outbox._pending and not outbox._taken and outbox._jobs.empty()
    assert not inbox._targets and not inbox._seen and not inbox._gone
    snapshot = plane.pair.see()
    assert len(snapshot.motions) <= ENDED_KEPT + 2 and len(snapshot.targets) <= 10
