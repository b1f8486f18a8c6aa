"""A robot's member in its fleet: hands on between the fleet's zenoh router and the gateway on this host, key by key.

Rules
    * A process of its own, and to the gateway one more client: what happens at the router ends here. A crash, a flood or a
      stall costs the fleet this robot, and an owner in the fleet his robot, as if his connection had broken.
    * On the router the keys are the gateway's own in the namespace `fleet/NAME`: clients and their secrets are the same.
    * A stop is dropped into the gateway's pipe as it arrives, before all else; then gateway and guard are asked about it.
    * Targets, keepalives and check-ins are heard on the secret keys of those alone whom the gateway gave something to own.
    * To the gateway all of the fleet is one client of its socket, an admin. So what only admins may, taking the robot from
      its owner and recovering from others' stops, is refused here, unless whoever began this said that all there are admins.
    * While another has this name, nothing but stops and views is served: nobody shall move two robots at once.
    * Callbacks hand on or put away; what waits is bounded, and what goes on in a second.
"""

from __future__ import annotations

import contextlib
import logging
import queue
import threading
import time
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

import zenoh

from gateway.api import protocol
from gateway.api.access.roles import Asker
from gateway.api.guard_protocol import Ask
from gateway.api.question import ZenohQuestion, reply_encoding
from gateway.api.stop_pipe import drop_stop
from gateway.client.asking.guard_stop import stop_at_guard
from gateway.client.connection.over_zenoh import Credentials, client_configuration
from gateway.errors import Code
from gateway.process.callbacks import direct
from gateway.process.threads import supervised
from gateway.process.zenoh_words import in_words

__all__ = ["Member"]

OPENING_S = 2.0
"""Longest wait for one try to connect [s]."""
STOP_S = 1.0
"""Longest wait for the gateway's answer to a stop, before its guard is asked [s]."""
QUESTIONS_HZ, PUTS_HZ = 200, 2000
"""So many requests of all, and puts of one owner, go on in a second, and as many at once."""
STOP_KEPT_NS = 3_000_000_000
"""Who asked longer ago about a stop has gone: he is not answered any more [ns]."""
NAMESAKES_S = 5.0
"""Pause between two looks whether namesakes are still there [s]."""
STOPS = (protocol.STOP_KEY, protocol.ESTOP_KEY)
FOR_ADMINS = (protocol.Take, protocol.Recover)
"""What the gateway's roles would keep from somebody; which stop is whose, for `Recover`, nobody knows here."""
MOST_WAITING, MOST_TOKENS, MOST_LANES = 256, 256, 32

T = TypeVar("T")

log = logging.getLogger(__name__)


class Member:
    """One robot on its fleet's router, from `run` to `close`.

    Args:
        fleet: The fleet's router.
        name: Of the robot there.
        gateway: The robot's own, a unix socket.
        as_admin: Whether whoever gets into the fleet may take the robot from its owner, and recover.
    """

    def __init__(self, fleet: protocol.Address, name: str, gateway: Path, *, as_admin: bool = False) -> None:
        self.namesakes: set[str] = set()
        """Others that have this name now."""
        self._name, self._path, self._as_admin = name, gateway, as_admin
        self._addresses = (protocol.parse_address(f"unix:{gateway}"), fleet)
        self._sessions: list[zenoh.Session] = []
        self._views: zenoh.Subscriber[None] | None = None
        self._may_ask = {is_stop: _bucket(QUESTIONS_HZ) for is_stop in (False, True)}
        self._jobs: queue.Queue[Callable[[], object]] = queue.Queue(MOST_WAITING)
        self._stops: queue.Queue[ZenohQuestion] = queue.Queue(MOST_WAITING)
        """Those that the gateway did not answer."""
        self._is_viewed = self._serves = False
        self._looked_s = 0.0
        """When namesakes were last asked for."""
        self._alive: dict[str, zenoh.Session] = {}
        """Tokens here, and where they are to be shown."""
        self._tokens: dict[str, Any] = {}
        """Those that are."""
        self._lanes: dict[tuple[str, str], list[Any]] = {}
        self._owner, self._endpoints = ("", ""), set[tuple[str, str]]()
        """Whose lanes count: of who was given the robot last, and of stop endpoints."""
        self._ended = threading.Event()

    def run(self) -> None:
        """Be in the fleet until `close`. Waits for gateway and router as long as it takes."""
        for address in self._addresses:
            while not self._ended.is_set():
                try:
                    self._sessions.append(zenoh.open(client_configuration(address, Credentials(), OPENING_S)))
                    break
                except zenoh.ZError as error:
                    log.warning("%s does not answer yet: %s", address.locator or address.file, in_words(error))
                self._ended.wait(1.0)
        if not self._ended.is_set():
            self._join(*self._sessions)
            # Without it this is no member: the process ends, and is begun anew.
            # Asking a guard takes up to seconds, and holds up nobody else: it has a thread of its own.
            for work, name in ((self._work, "ta2-fleet"), (self._ask_guards, "ta2-fleet-guard")):
                supervised(work, name, may_return=self._ended.is_set, on_lost=lambda _: self._ended.set()).start()
            log.info("%s is in the fleet at %s", self._name, self._addresses[1].locator or self._addresses[1].file)
        self._ended.wait()

    def close(self) -> None:
        """Leave the fleet; `run` returns. May be called again."""
        self._ended.set()
        while self._sessions:
            self._sessions.pop().close()  # type: ignore[no-untyped-call]  # zenoh's stubs leave the return type out

    def _join(self, local: zenoh.Session, fleet: zenoh.Session) -> None:
        self._local, self._fleet = local, fleet
        views = [
            fleet.declare_publisher(key, encoding=protocol.MSGPACK, congestion_control=zenoh.CongestionControl.DROP)
            for key in (protocol.SNAPSHOT_KEY, protocol.EVENT_KEY)
        ]
        self._snapshots = views[0]
        views[0].declare_matching_listener(direct(self._on_matching))
        local.declare_subscriber(protocol.EVENT_KEY, direct(partial(_hand_on, views[1])))
        for key in STOPS:
            fleet.declare_subscriber(key, direct(partial(self._on_stop, key)))
        for key in (*STOPS, protocol.COMMAND_KEY, protocol.INFO_KEY, protocol.ROUTES_KEY, protocol.SNAPSHOT_KEY):
            fleet.declare_queryable(key, direct(partial(self._on_query, key)))
        for here, keys, there in (
            (local, protocol.DAEMON_TOKENS, fleet),
            (fleet, protocol.CLIENT_TOKENS, local),
        ):
            here.liveliness().declare_subscriber(keys, direct(partial(self._on_token, there)), history=True)
        self._me = protocol.MEMBER_TOKENS.replace("*", str(fleet.zid()))
        fleet.liveliness().declare_subscriber(protocol.MEMBER_TOKENS, direct(self._on_member), history=True)
        # Last: who sees the token finds everything else in place. Shown first, then looked for: of two, one sees the other.
        self._token = fleet.liveliness().declare_token(self._me)
        for token in fleet.liveliness().get(protocol.MEMBER_TOKENS, timeout=OPENING_S):
            if token.ok is not None:
                self._note(str(token.ok.key_expr), is_there=True)
        self._serves = True

    # ------------------------------------------------------------------------------------------------ zenoh's threads

    def _on_stop(self, key: str, sample: zenoh.Sample) -> None:
        self._stop(key, sample.payload.to_bytes())

    def _stop(self, key: str, payload: bytes) -> None:
        if not drop_stop(self._path, key, payload):
            _put(self._local, key, payload, protocol.JSON)

    def _on_query(self, key: str, query: zenoh.Query) -> None:
        question = ZenohQuestion(query, time.monotonic_ns(), Asker())
        question.key = key  # it may have been asked of many at once
        question.encoding = (question.encoding or protocol.JSON) if key in STOPS else reply_encoding(question)
        lane, request = None, None
        if key in STOPS:
            self._stop(key, question.payload)
        elif key == protocol.COMMAND_KEY:
            try:
                command = protocol.decode_command(question.payload, question.encoding)
                refused = self._refused(command)
            except protocol.Malformed as error:  # a gateway of a later release might read in it what is for admins
                why = error.refusal
                refusal = protocol.RefusalMessage(code=why.code.value, message=why.message, hint=why.hint)
                refused = protocol.Reply(request_id=0, refusal=refusal)
            if refused is not None:
                question.answer(protocol.encode(refused, question.encoding), question.encoding)
                return
            lane, request = _lane_of(command), command.request
        if not self._may_ask[key in STOPS]() or not (self._serves or key in STOPS):
            question.drop()
            return
        answers: list[bytes] = []

        def take(reply: zenoh.Reply) -> None:
            if reply.ok is not None and not answers:
                answers.append(reply.ok.payload.to_bytes())

        def finish() -> None:
            if key in STOPS and not answers:
                _into(self._stops, question, question.drop)
            elif lane and answers:  # what is given can be used as soon as its owner hears of it
                give: Callable[[], object] = partial(self._give, question, lane, request, answers[0])
                _into(self._jobs, give, question.drop)
            elif answers:
                question.answer(answers[0], question.encoding)
            else:
                question.drop()

        try:
            self._local.get(
                key,
                zenoh.handlers.Callback(take, finish, indirect=False),
                payload=question.payload,
                encoding=question.encoding,
                timeout=STOP_S if key in STOPS else protocol.REPLY_WITHIN_NS / 1e9,
                congestion_control=zenoh.CongestionControl.DROP,  # a gateway that does not read keeps no stop waiting here
                consolidation=zenoh.ConsolidationMode.NONE,
                express=True,
            )
        except zenoh.ZError:  # closed in this moment
            finish()

    def _refused(self, command: protocol.Command) -> protocol.Reply | None:
        if self.namesakes:
            code, count = Code.OTHER_GATEWAY, len(self.namesakes) + 1
            message = f"{count} gateways are {self._name!r} in this fleet: none of them is moved from there"
            hint = "give each a name of its own; stops reach all of them"
        elif not self._as_admin and isinstance(command.request, FOR_ADMINS):
            code, kind = Code.NOT_PERMITTED, type(command.request).__name__
            message = f"{kind} is for admins, and in the fleet nobody is one for {self._name!r}"
            hint = (
                "do it on the robot's host, or begin its `ta2 fleet join` with --as-admin: everybody there is one then"
            )
        else:
            return None
        refusal = protocol.RefusalMessage(code=code.value, message=message, hint=hint)
        return protocol.Reply(request_id=command.request_id, refusal=refusal)

    def _on_matching(self, status: zenoh.MatchingStatus) -> None:
        self._is_viewed = status.matching

    def _on_token(self, there: zenoh.Session, sample: zenoh.Sample) -> None:
        key = str(sample.key_expr)
        if sample.kind == zenoh.SampleKind.DELETE:
            self._alive.pop(key, None)
        elif "*" not in key and (there is self._fleet or len(self._alive) < MOST_TOKENS):
            self._alive[key] = there

    def _on_member(self, sample: zenoh.Sample) -> None:
        self._note(str(sample.key_expr), is_there=sample.kind != zenoh.SampleKind.DELETE)

    def _note(self, member: str, *, is_there: bool) -> None:
        before = len(self.namesakes)
        if member == self._me:
            return
        if not is_there:
            self.namesakes.discard(member)
        elif before < MOST_TOKENS:
            self.namesakes.add(member)
        if len(self.namesakes) != before:  # zenoh may show one again
            self._tell_namesakes()

    def _tell_namesakes(self) -> None:
        tail = "nothing but stops comes from the fleet" if self.namesakes else "it can be moved from the fleet again"
        log.warning("%s: %d others have this name there; %s", self._name, len(self.namesakes), tail)

    def _on_lane(self, may_pass: Callable[[], bool], sample: zenoh.Sample) -> None:
        key = str(sample.key_expr)
        if "*" in key or self.namesakes or not may_pass():  # a key for everybody at once proves no secret
            return
        payload = sample.payload.to_bytes()
        if len(payload) <= protocol.MAX_PAYLOAD_BYTES:
            _put(self._local, key, payload, str(sample.encoding))

    # ------------------------------------------------------------------------------------------------ own thread

    def _look_for_namesakes(self) -> None:
        """Ask whether they are still there: one whose end was told before it was first heard of would stay for ever."""
        now_s = time.monotonic()
        if not self.namesakes or now_s < self._looked_s + NAMESAKES_S:
            return
        self._looked_s = now_s
        known, found, failed = frozenset(self.namesakes), set[str](), list[bool]()

        def take(reply: zenoh.Reply) -> None:
            if reply.ok is None:
                failed.append(True)
            else:
                found.add(str(reply.ok.key_expr))

        def finish() -> None:
            gone = known - found
            if gone and not failed and self._me in found:  # else a router that does not answer
                self.namesakes.difference_update(gone)
                self._tell_namesakes()

        handler = zenoh.handlers.Callback(take, finish, indirect=False)
        self._fleet.liveliness().get(protocol.MEMBER_TOKENS, handler, timeout=OPENING_S)

    def _work(self) -> None:
        while not self._ended.is_set():
            with contextlib.suppress(queue.Empty, zenoh.ZError):  # a session that is closed in this moment
                self._show()
                self._look_for_namesakes()
                self._jobs.get(timeout=0.05)()

    def _show(self) -> None:
        """Show the tokens that are alive, and listen to the gateway's snapshots while somebody in the fleet does."""
        alive = dict(self._alive)
        for key in self._tokens.keys() - alive.keys():
            self._tokens.pop(key).undeclare()
        for key in alive.keys() - self._tokens.keys():
            self._tokens[key] = alive[key].liveliness().declare_token(key)
        if self._is_viewed and self._views is None:
            take = direct(partial(_hand_on, self._snapshots))
            self._views = self._local.declare_subscriber(protocol.SNAPSHOT_KEY, take)
        elif not self._is_viewed and self._views is not None:
            views, self._views = self._views, None
            views.undeclare()  # type: ignore[no-untyped-call]  # as above

    def _give(self, question: ZenohQuestion, lane: tuple[str, str], request: object, payload: bytes) -> None:
        """Hear an owner or a stop endpoint whom the gateway has taken, then tell him so."""
        with contextlib.suppress(protocol.Malformed):
            if protocol.decode_reply(payload, question.encoding).refusal is None:
                self._hear(lane, request)
        question.answer(payload, question.encoding)

    def _hear(self, lane: tuple[str, str], request: object) -> None:
        if isinstance(request, protocol.LeaveEndpoint):
            return self._endpoints.discard(lane)
        if lane not in self._lanes:
            if len(self._lanes) >= MOST_LANES:  # who has gone needs none, nor who owned the robot before its last owner
                kept = {one for one in (self._owner, *self._endpoints) if protocol.client_token(one[0]) in self._tokens}
                for left in self._lanes.keys() - kept:
                    for subscriber in self._lanes.pop(left):
                        subscriber.undeclare()
                self._endpoints &= kept
            take = direct(partial(self._on_lane, _bucket(PUTS_HZ)))
            self._lanes[lane] = [self._fleet.declare_subscriber(key, take) for key in protocol.lane_keys(*lane)]
        if isinstance(request, protocol.RegisterEndpoint):
            self._endpoints.add(lane)
        else:
            self._owner = lane

    # ------------------------------------------------------------------------------------------------ another one

    def _ask_guards(self) -> None:
        """Ask the guard of a gateway that does not answer what became of stops in the pipe: once for all that wait."""
        while not self._ended.is_set():
            asked: list[ZenohQuestion] = []
            with contextlib.suppress(queue.Empty):
                asked.append(self._stops.get(timeout=0.05))
                while len(asked) < MOST_WAITING:
                    asked.append(self._stops.get_nowait())
            for key in STOPS:
                self._ask_guard(key, [question for question in asked if question.key == key])

    def _ask_guard(self, key: str, asked: Sequence[ZenohQuestion]) -> None:
        since_ns = time.monotonic_ns() - STOP_KEPT_NS
        for late in (question for question in asked if question.received_ns < since_ns):
            late.drop()
        if not (waiting := [question for question in asked if question.received_ns >= since_ns]):
            return
        ask: Ask = "stop" if key == protocol.STOP_KEY else "estop"
        done = stop_at_guard(f"unix:{self._path}", ask, "from the fleet", "ta2 fleet")
        for question in waiting:
            if done is None:
                question.drop()
                continue
            facts = {"stop_undelivered": done.undelivered, "by_guard": True}
            question.answer(
                protocol.encode(protocol.Reply(request_id=0, facts=facts), question.encoding), question.encoding
            )


def _into(waiting: queue.Queue[T], one: T, otherwise: Callable[[], object]) -> None:
    try:
        waiting.put_nowait(one)
    except queue.Full:
        otherwise()


def _hand_on(publisher: zenoh.Publisher, sample: zenoh.Sample) -> None:
    with contextlib.suppress(zenoh.ZError):  # closed in this moment
        publisher.put(sample.payload, attachment=sample.attachment)


def _put(session: zenoh.Session, key: str, payload: bytes, encoding: str) -> None:
    with contextlib.suppress(zenoh.ZError):  # closed in this moment: as lost as any put without a gateway
        session.put(key, payload, encoding=encoding, congestion_control=zenoh.CongestionControl.DROP, express=True)


def _bucket(hz: int) -> Callable[[], bool]:
    """Return what says whether one more may pass: so many a second, and as many at once."""
    left, at_s = float(hz), time.monotonic()

    def take() -> bool:
        nonlocal left, at_s
        now_s = time.monotonic()
        left, at_s = min(hz, left + (now_s - at_s) * hz), now_s
        passes = left >= 1
        left -= passes
        return passes

    return take


def _lane_of(command: protocol.Command) -> tuple[str, str] | None:
    """Return whom a command would make an owner or a stop endpoint, who sends targets, keepalives or check-ins, or none."""
    asked = (protocol.Acquire, protocol.Take, protocol.RegisterEndpoint, protocol.LeaveEndpoint)
    if isinstance(command.request, asked) and command.secret:
        return command.client_id, command.secret
    return None
