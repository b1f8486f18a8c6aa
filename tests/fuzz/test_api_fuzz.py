"""Hostile payloads of the local API against an engine that drives a robot: every one is answered once, in words.

They take the daemon's own way (inbox, decoder, translator, engine, outbox) into a pair of engine and simulated robot in
virtual time, while the monitor of the invariants judges every frame that leaves. A nurse keeps the robot enabled, so
that hostile motion requests meet arms that can move.
"""

from __future__ import annotations

import gc
import math
import random
import weakref
from collections import Counter, OrderedDict
from collections.abc import Callable
from typing import Any, get_args

import pytest
from msgspec import structs

from gateway.api import protocol
from gateway.api.access.roles import Asker
from gateway.api.inbox import Inbox
from gateway.api.outbox import Outbox
from gateway.api.stop_lane import StopLane
from gateway.api.translate import describe
from gateway.core.body.motions import ENDED_KEPT
from gateway.core.engine import Output
from gateway.core.messages.events import CommandRequested, Event
from gateway.core.messages.outputs import FrameKind, Reply
from gateway.core.requests.answers import REPLIES_KEPT
from gateway.errors import CODES, Code
from gateway.messages.requests import Estop, Stop
from gateway.robot.limits import JOINT_LOWER_RAD, JOINT_UPPER_RAD
from gateway.robot.topics import CURRENT_MODE, FSM_STATE, arm_state, ee_pose
from gateway.settings.settings import LinkSettings, LocalSettings, Settings
from gateway.sim.robot.settings import SimSettings
from gateway.values import Side
from tests.fuzz.hostile import TEXTS, as_json, as_msgpack, monster, mutated, scratched, twisted
from tests.fuzz.inventor import KINDS, Inventor
from tests.fuzz.nurse import OWNER, Nurse
from tests.invariants import Monitor
from tests.pair import MS, Pair
from tests.thoroughness import IS_THOROUGH, either

pytestmark = pytest.mark.slow

PAYLOADS = either(12_000, 25_000)
PER_TICK = 20
"""Payloads that lie there together when the loop looks."""
BLOCK = 1_000
"""Payloads from one wild spell to the next."""
WILD = either(160, 80)
"""Of a block, so many may be well-formed stops, takeovers and releases; then the nurse comes. More where blocks are few: each
kind is to be accepted at least once."""

HARSH = ("take", "release", "abandon", "disable", "stop", "estop")
"""Kinds that end what the nurse has brought about."""
SAFE = (*(kind for kind in KINDS if kind not in HARSH), "move", "move_pose", *("open_stream",) * 3, *("target",) * 4)
LOUD = (*SAFE, *HARSH, *("disable",) * 2)
ROBOTS = {
    1: {},
    2: {"right_mode": "pose", "model": "lift"},
    3: {"left_mode": "pose", "model": "standard"},
    4: {"left_mode": "pose", "right_mode": "pose", "model": "lift"},
}
"""By seed, the robot: both arms in joint mode, one of each, both in end-effector mode; with and without a lift."""
SEEDS = tuple(ROBOTS) if IS_THOROUGH else (2,)
"""All of them in CI, before a release with a hundred thousand payloads; else the robot with one arm of each, and a lift."""
CLIENTS = (OWNER, OWNER, OWNER, OWNER, "stranger", "b" * 64)

EXPECTED = {
    Code.BAD_REQUEST, Code.UNSUPPORTED_VERSION, Code.WRONG_SHAPE, Code.NOT_FINITE, Code.OUT_OF_RANGE, Code.UNKNOWN_MOTION,
    Code.UNKNOWN_STREAM, Code.NOT_OWNER, Code.LEASE_HELD, Code.LEASE_STALE, Code.STOPPED,
}  # fmt: skip
"""Refusals that must be among the answers; else the fuzz did not get past the decoder."""


class Question:
    """A query that remembers how it was answered."""

    __slots__ = ("answers", "dropped", "encoding", "key", "kind", "payload", "received_ns")
    asker = Asker()

    def __init__(self, key: str, payload: bytes, encoding: str, received_ns: int, kind: str) -> None:
        self.key, self.payload, self.encoding, self.received_ns = key, payload, encoding, received_ns
        self.kind = kind
        self.answers: list[tuple[bytes, str]] = []
        self.dropped = 0

    def answer(self, payload: bytes, encoding: str) -> None:
        self.answers.append((payload, encoding))

    def drop(self) -> None:
        self.dropped += 1


MOVES = {"motion_id", "stream_id", "drive_id", "raw"}
"""What answers to requests that move something say; `raw` is a gripper's."""


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
            moves = reply.refusal is None and reply.facts.keys() & MOVES
            if moves and self.arrived_ns.get((reply.client_id, reply.request_id), 0) > self.stopped_ns:
                frames = tuple(frame for frame in frames if frame.kind is not FrameKind.MOTION)
        self.arrived_ns.clear()
        super()._stopped_at_once(structs.replace(output, frames=frames))


class Plane:
    """The local plane in front of a pair, without sockets and threads: what the daemon's loop does on each tick."""

    def __init__(self, pair: Pair) -> None:
        self.pair = pair
        self.monitor = Judge(pair)
        stops = StopLane()
        weakref.finalize(self, stops.close)
        self.outbox = Outbox(describe(pair.settings, socket="/tmp/gw.sock", pid=1), stops)
        self.inbox = Inbox(self.outbox)
        self.outbox.add_audience(self)
        self.waiting: list[Question] = []
        self.notices = self.snapshots = self.repeated = 0
        self.followed: set[int] = set()
        """Streams of which a target was accepted."""
        self._seen: OrderedDict[int, Reply] = OrderedDict()
        self.codes: Counter[str] = Counter()
        self.accepted: Counter[str] = Counter()
        """By kind of request."""
        self.moved: Counter[FrameKind] = Counter()
        self.topics: Counter[str] = Counter()
        """Frames that moved something, by topic."""
        pair.on_step = self.see

    def ask(self, key: str, payload: bytes, encoding: str, kind: str = "") -> None:
        question = Question(key, payload, encoding, self.pair.now_ns, kind)
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
        self.monitor.see(structs.replace(output, replies=tuple(filter(self._is_new, output.replies))))
        self.moved.update(frame.kind for frame in output.frames)
        self.topics.update(frame.topic for frame in output.frames if frame.kind is FrameKind.MOTION)
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
                self.accepted[question.kind] += 1
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

    def put_notice(self, payload: bytes, number: int) -> None:
        assert protocol.decode_notice(payload).message
        self.notices += 1


class Attacker:
    """Makes payloads that a client might send: good ones of this very moment, and what became of them."""

    def __init__(self, rng: random.Random, plane: Plane, nurse: Nurse) -> None:
        self.rng = rng
        self.plane = plane
        self.nurse = nurse
        self.sent: Counter[str] = Counter()
        self.inventor = Inventor(rng, self.hints())
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
            if kind != "target" and isinstance(message, dict) and rng.random() < 0.98:
                message = {**message, "secret": "s"}
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
            self.plane.ask(key, payload, encoding, kind)

    def epoch(self) -> int:
        return self.rng.choice((*[self.nurse.epoch] * 8, self.nurse.epoch - 1, 0, 2**62))

    def target(self) -> dict[str, Any]:
        rng = self.rng
        side = rng.choice(list(Side))
        return {
            "epoch": self.epoch(),
            "seq": self.plane.pair.now_ns // 1000 + rng.choice((0, 0, 0, -(10**6))),
            "values": self.place(side) if side in self.nurse.poses else self.goal(side, overshoot=0.05),
        }

    def target_key(self) -> str:
        rng = self.rng
        stream: object = self.plane.pair.engine.open_stream_id or 1
        if rng.random() < 0.15:
            stream = rng.choice(
                ("", "x", "-1", "007", "1_0", "0x1", "1e3", "٣", "9" * 5_000, 2**64, "1/2", " 1", stream)
            )
        return f"{protocol.ROOT}/target/{rng.choice((*CLIENTS, '', '人', 'x' * 300))}/{stream}/s"

    # what makes sense, by the name of a field

    def hints(self) -> dict[str, Callable[[], Any]]:
        rng, engine = self.rng, self.plane.pair.engine
        return {
            "name": lambda: rng.choice(("a", "人", "x" * 64)),
            "pid": lambda: rng.randrange(2**20),
            "epoch": self.epoch,
            "speed": lambda: rng.choice((1.0, 0.5, 0.05, 1, 5e-324, 1e-9)),
            "tolerance_rad": lambda: rng.choice((None, 0.05, 1e-4)),
            "tolerance_m": lambda: rng.choice((None, 0.005, 1e-4)),
            "on_limit": lambda: rng.choice(("reject", "clip", "clip")),
            "relative": lambda: rng.random() < 0.2,
            "targets_rad": lambda: {side.value: self.goal(side) for side in self.some(joint=True)},
            "targets": lambda: {side.value: self.place(side) for side in self.some(joint=False)},
            "frames": lambda: {side.value: f"{side.value}_shoulder_base" for side in Side},
            "expiry_ns": lambda: rng.choice((None, 50_000_000, 10**9)),
            "stream_id": lambda: rng.choice((engine.open_stream_id or 1, 1, 2**62)),
            "motion_id": lambda: rng.choice((1, self.plane.codes["accepted"], 2**62)),
            "drive_id": lambda: rng.choice((0, 0, 0, self.drive_id())),
            "vx_mps": lambda: rng.choice((0.0, 0.1, -0.2, 0.3)),
            "vy_mps": lambda: rng.choice((0.0, 0.05, -0.1)),
            "wz_radps": lambda: rng.choice((0.0, 0.2, -0.4)),
            "velocity": lambda: rng.choice((0.0, 0.3, -0.3)),
            "raw": lambda: rng.choice((0.0, 0.1, 0.55, 1.0)),
            "reason": lambda: rng.choice(TEXTS),
            "follow": self.chunk,
        }

    def drive_id(self) -> int:
        seen = self.plane.pair.snapshot
        return 1 if seen is None else seen.drive.drive_id

    def some(self, *, joint: bool) -> list[Side]:
        """Return arms, mostly those whose mode fits."""
        fitting = [side for side in Side if (side not in self.nurse.poses) is joint]
        sides = fitting if fitting and self.rng.random() < 0.9 else list(Side)
        return sides if self.rng.random() < 0.5 else [self.rng.choice(sides)]

    def goal(self, side: Side, overshoot: float = 0.02) -> list[float]:
        """Return seven joints, mostly inside the limits [rad]."""
        rng = self.rng
        bounds = zip(JOINT_LOWER_RAD[side], JOINT_UPPER_RAD[side], strict=True)
        return [rng.uniform(low - overshoot * rng.random(), high) for low, high in bounds]

    def place(self, side: Side) -> list[float]:
        """Return a pose near a good one of this arm: x, y, z [m], qx, qy, qz, qw."""
        rng = self.rng
        good = self.nurse.start[side]
        quat = [part + rng.uniform(-0.2, 0.2) for part in good[3:]]
        norm = math.hypot(*quat)
        return [*(part + rng.uniform(-0.05, 0.05) for part in good[:3]), *(part / norm for part in quat)]

    def chunk(self) -> dict[str, Any]:
        """Return a trajectory that begins where arms are, or nearly, and mostly keeps the limits."""
        rng, arms = self.rng, self.nurse.places()
        is_joint = rng.random() < 0.5
        sides = self.some(joint=is_joint)
        size, count = rng.choice((0.0, 0.01, 0.05, 0.3)), rng.choice((2, 5, 20, 20, 60))
        scale, at = (1.0, rng.randrange(7)) if is_joint else (0.1, rng.randrange(3))
        ways = [scale * size * (1.0 - math.cos(3.0 * n / count)) for n in range(count)]
        points = {
            side.value: [[q + (way if n == at else 0.0) for n, q in enumerate(arms[side])] for way in ways]
            for side in sides
        }
        wishes: dict[str, Any] = {
            "type": "follow",
            "epoch": self.epoch(),
            "points": points,
            "space": "joint" if is_joint else "pose",
            "frames": {side.value: f"{side.value}_shoulder_base" for side in sides},
            "dt_s": rng.choice((0.05, 0.1, 0.02)),
        }
        also = {
            "stretch": rng.choice((1.0, 3.0)),
            "smoothing_s": rng.choice((0.0, 0.1)),
            "open_end": True,
            "start_in_ns": rng.choice((-100_000_000, 0, 200_000_000)),
            "start_at_ns": self.plane.pair.now_ns + rng.randint(-(10**8), 10**9),
            "path_tolerance": {sides[0].value: [0.2] * 7 if is_joint else [0.02, None]},
            "goal_tolerance": {sides[0].value: [None] * 7 if is_joint else [0.01, 0.1]},
            "goal_time_ns": rng.choice((None, 10**9)),
        }
        return wishes | {name: value for name, value in also.items() if rng.random() < 0.25}

    def command(self, kind: str) -> dict[str, Any]:
        rng = self.rng
        request = self.chunk() if kind == "follow" and rng.random() < 0.8 else self.inventor.request(kind)
        if kind == "move" and request.get("relative") and rng.random() < 0.9:
            request["targets_rad"] = {
                side.value: [rng.uniform(-0.1, 0.1) for _ in range(7)] for side in self.some(joint=True)
            }
        if kind == "open_stream" and rng.random() < 0.9:
            side = Side(request.get("side", "left"))
            request["space"], request["frame"] = "joint", ""
            if side in self.nurse.poses:
                request["space"], request["frame"] = "pose", f"{side.value}_shoulder_base"
        client = rng.choice(CLIENTS)
        self._next_id += rng.random() < 0.97  # else the number of the command before
        return {
            "version": rng.choice((*[protocol.PROTOCOL_VERSION] * 60, 0, 2)),
            "client_id": client,
            "request_id": self._next_id,
            "request": request,
        }


def lives(rng: random.Random, plane: Plane, *, is_wild: bool) -> None:
    """Sometimes send signs of life, and of death, of clients that exist and that do not."""
    if rng.random() < 0.02:
        plane.inbox.put_keepalive(protocol.keepalive_key(rng.choice((*CLIENTS, "", "x" * 999)), "s"), plane.pair.now_ns)
    if rng.random() < 0.005:
        plane.inbox.put_gone(rng.choice((OWNER, "stranger") if is_wild else ("stranger", "", "人")), plane.pair.now_ns)


def plane_of(**sim: Any) -> Plane:
    """Return a plane before a pair that was never asked anything."""
    settings = Settings(local=LocalSettings(snapshot_hz=10.0), link=LinkSettings(model=sim.get("model", "standard")))
    pair = Pair(settings, SimSettings(state_period_ns=10 * MS, **sim))
    pair.topics = (*map(arm_state, Side), *map(ee_pose, Side), FSM_STATE, CURRENT_MODE)
    pair.run_until(lambda: pair.state == "READ_ONLY" and pair.knows_mode)
    return Plane(pair)


@pytest.fixture
def plane() -> Plane:
    """Give a plane before a robot in joint mode."""
    return plane_of()


def test_every_kind_of_request_and_every_field_of_it_is_invented() -> None:
    """A request or a field that is new is attacked without anybody's doing; what only few hints know, too."""
    inventor = Inventor(random.Random(1), {})
    for kind in KINDS:
        for _ in range(50):
            made = inventor.request(kind)
            assert made["type"] == kind
    structs = get_args(protocol.Request)
    assert {info.cls for info in KINDS.values()} == set(structs) and set(KINDS) <= {*SAFE, *HARSH}
    assert {f"{kind}.{name}" for kind, info in KINDS.items() for name in info.cls.__struct_fields__} <= inventor.made


@pytest.mark.parametrize("seed", SEEDS)
def test_hostile_payloads_are_answered_once_and_nothing_invalid_leaves(seed: int) -> None:
    """Each request gets one reply with a known code or facts, no exception escapes, every invariant holds on every tick."""
    plane = plane_of(**ROBOTS[seed])
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
    assert len(plane.followed) >= PAYLOADS // 2_500, "hardly a streamed target was followed"
    missing = {code.value for code in EXPECTED} - plane.codes.keys()
    assert not missing, f"never answered: {missing}, but {plane.codes}"
    idle = set(KINDS) - plane.accepted.keys() - nurse.impossible
    assert not idle, f"never accepted: {idle}, but {plane.accepted}"
    assert all(plane.topics[nurse.topic(side)] > PAYLOADS / 200 for side in Side), plane.topics
    print(f"\n{PAYLOADS} payloads {dict(attacker.sent)}, answers {dict(plane.codes)}")
    print(f"accepted {dict(plane.accepted)}, moving {dict(plane.topics)}")
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
        message = {
            "version": protocol.PROTOCOL_VERSION,
            "client_id": "novice",
            "secret": "s",
            "request_id": 1,
            "request": request,
        }
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
    assert len(engine._answered._kept) <= REPLIES_KEPT
    assert not engine._targets and not engine._commands
    assert not outbox._pending and not outbox._taken and outbox._jobs.empty()
    assert not inbox._targets and not inbox._seen and not inbox._gone
    snapshot = plane.pair.see()
    assert len(snapshot.motions) <= ENDED_KEPT + 2 and len(snapshot.targets) <= 10
