"""What clients send, on its way to the engine: questions, streamed targets, keepalives, departures.

Rules
    * Whoever brings something in (a zenoh callback) only puts it here. One thread reads questions (`sort`); the loop
      thread takes everything (`poll`) and is the only one that does.
    * Stops have keys and a lane of their own (`stop_lane`). One that comes among other requests is a stop as well: an
      emergency stop, then a stop, come first out of `poll`, whatever lies before them.
    * Of the targets of a stream, and of the keepalives of a client, only the newest is kept: a flood costs nothing.
    * A command whose sender was already told that it did not run is not handed to the loop any more; a stop always is.
    * Chunks take milliseconds to work out. They are put aside, with whatever the same client sends after them, until
      nothing else is left to read, or much was: no stop waits for more than one of them.
    * Who owns the robot, or watches it, waits for nobody else: his requests come first, and have room where others have none.
    * Everything is bounded, for each client by itself, too. What does not fit or cannot be read is counted, told to its
      sender where it can be told, and logged at most once a second.

Does not know zenoh or the engine; arrival times are stamped by its callers.
"""

from __future__ import annotations

import logging
import queue
import threading
from collections import deque
from collections.abc import Callable, Iterator

from msgspec import structs

from gateway.api import protocol
from gateway.api.access.audit import Audit
from gateway.api.access.roles import not_permitted
from gateway.api.identities import Identities
from gateway.api.keys import printable
from gateway.api.outbox import Outbox
from gateway.api.question import Question
from gateway.api.translate import to_request, to_target
from gateway.core.messages import events
from gateway.core.requests.answers import number_was_used
from gateway.errors import Code, Refusal
from gateway.messages import requests

__all__ = [
    "MAX_ASIDE",
    "MAX_ASIDE_OF_CLIENT",
    "MAX_CLIENTS",
    "MAX_OF_CLIENT",
    "MAX_STREAMS",
    "MAX_WAITING",
    "PER_POLL",
    "READ_BETWEEN",
    "Inbox",
]

MAX_WAITING = 1024
"""Questions that may wait; more are refused with TIMEOUT. Ten a second are usual."""
MAX_OF_CLIENT = 64
"""Of one client that many, and of each of those who own or watch the robot however many others wait."""
MAX_STREAMS = 64
"""Streams whose targets are kept between two polls; two are usual."""
MAX_CLIENTS = 256
"""Clients whose keepalives, and whose departures, are kept between two polls."""
MAX_ASIDE = 16
"""Requests that may wait beside and behind chunks which are still to be worked out; a client that streams chunks has one."""
MAX_ASIDE_OF_CLIENT = 8
"""The same for each client, and of those who own or watch the robot beside all others."""
READ_BETWEEN = 64
"""So many questions are read before the next of those aside, however many there are."""
PER_POLL = 4
"""Requests handed out at a poll, stops not counted: planning a motion takes a millisecond, and setpoints must leave in time.
A chunk is the last one of its poll: getting two arms onto it in mid-motion takes as long as the others together."""
STRANGER = "stranger"
"""Whose stop it is that came under the id of a client whose secret its sender does not have."""
LOG_PERIOD_NS = 1_000_000_000

log = logging.getLogger(__name__)

_Lane = deque[events.CommandRequested]


class Inbox:
    """Everything on its way in. See the module for which thread may call what.

    Args:
        outbox: Where refusals go, and where questions wait for the engine's reply.
        audit: Where commands and their answers are written down.
    """

    def __init__(self, outbox: Outbox, audit: Audit | None = None) -> None:
        self._audit = audit
        self.malformed = 0
        self.overflown = 0
        self.identities = Identities()
        """Who is who: which client has which secret."""
        self._outbox = outbox
        self._unread: queue.SimpleQueue[Question | None] = queue.SimpleQueue()
        self._aside: list[tuple[protocol.Command, Question]] = []
        """Chunks to be worked out, and what their clients sent after them."""
        self._read_since = 0
        """Questions that were read since the last one of those."""
        self._lock = threading.Lock()
        self.on_arrival: Callable[[], None] = lambda: None
        """Called after each request, from the reading thread: ends the rest of the loop. Signs of life and targets end none."""
        self._estops: _Lane = deque()
        self._stops: _Lane = deque()
        self._commands: dict[str, _Lane] = {}
        """Per client, those whose turn is next first."""
        self._waiting = 0
        self._favoured = 0  # so many in a row of who is heeded; a chunk counts as a poll
        self._targets: dict[str, tuple[bytes, str, int]] = {}
        self._seen: dict[str, int] = {}
        self._checked_in: dict[str, int] = {}
        self._gone: dict[str, int] = {}
        self._next_log_ns = 0

    # ------------------------------------------------------------------------------------------------ coming in

    def ask(self, question: Question) -> None:
        """Take a question; returns at once. What may be a stop finds room where a flood has left none for others."""
        waiting = self._unread.qsize()
        if waiting < MAX_WAITING or (waiting < 2 * MAX_WAITING and b"stop" in question.payload):
            self._unread.put(question)
            return
        self._complain("overflow", f"{MAX_WAITING} questions wait to be read", question.received_ns)
        self._outbox.refuse(
            self._watched(question) if question.key.startswith(protocol.COMMAND_KEY) else question, 0, _too_many()
        )

    def put_target(self, key: str, payload: bytes, encoding: str, received_ns: int) -> None:
        """Take the newest target of a stream; an older one that was not polled yet is forgotten.

        Args:
            key: Key it was put on; names client and stream.
            payload: Untrusted bytes.
            encoding: zenoh encoding; empty for msgpack.
            received_ns: Local monotonic arrival [ns].
        """
        client_id, _, secret = protocol.put_by(key)
        if not self.identities.is_proven(client_id, secret):  # before anything is kept or decoded
            self._complain("malformed", "a target of nobody that is known", received_ns)
            return
        with self._lock:
            if key in self._targets or len(self._targets) < MAX_STREAMS:
                self._targets[key] = (payload, encoding, received_ns)
                return
        self._complain("overflow", f"{MAX_STREAMS} streams have targets waiting", received_ns)

    def put_keepalive(self, key: str, received_ns: int) -> None:
        """Take a sign of life of a client, on its key."""
        client_id, _, secret = protocol.put_by(key)
        if not self.identities.is_proven(client_id, secret):
            self._complain("malformed", "a keepalive of nobody that is known", received_ns)
            return
        with self._lock:
            if client_id in self._seen or len(self._seen) < MAX_CLIENTS:
                self._seen[client_id] = received_ns
                return
        self._complain("overflow", f"{MAX_CLIENTS} clients send keepalives", received_ns)

    def put_check_in(self, key: str, received_ns: int) -> None:
        """Take a check-in of a stop endpoint, on its key; kept apart from keepalives, which a client sends by itself."""
        client_id, _, secret = protocol.put_by(key)
        if not self.identities.is_proven(client_id, secret):
            self._complain("malformed", "a check-in of nobody that is known", received_ns)
            return
        with self._lock:
            if client_id in self._checked_in or len(self._checked_in) < MAX_CLIENTS:
                self._checked_in[client_id] = received_ns
                return
        self._complain("overflow", f"{MAX_CLIENTS} clients check in", received_ns)

    def put_gone(self, client_id: str, at_ns: int, door: str = "socket") -> None:
        """Take the end of a client's liveliness token at a door; by another one than its own nobody goes."""
        if not self.identities.came_by(client_id, door):
            self._complain("malformed", f"{client_id} is shown at a door by which it did not come", at_ns)
            return
        with self._lock:
            if client_id in self._gone or len(self._gone) < MAX_CLIENTS:
                self._gone[client_id] = at_ns
                return
        self._complain("overflow", f"{MAX_CLIENTS} clients went", at_ns)

    # ------------------------------------------------------------------------------------------------ the reader

    def sort(self, timeout_s: float) -> bool:
        """Read the next question, waiting for it at most `timeout_s`, and lay it where it belongs.

        Returns:
            False when there was none, and nothing that had been put aside.
        """
        if not (self._aside and self._read_since >= READ_BETWEEN):
            try:
                waits = timeout_s > 0 and not self._aside
                question = self._unread.get(timeout=timeout_s) if waits else self._unread.get_nowait()
            except queue.Empty:
                if not self._aside:
                    return False
            else:
                self._read_since += 1
                if question is not None:
                    self._read(question)
                return True
        self._read_since = 0
        pinned = self.identities.pinned
        place = next((n for n, (command, _) in enumerate(self._aside) if command.client_id in pinned), 0)
        self._take(*self._aside.pop(place))
        return True

    def wake(self) -> None:
        """Let a waiting `sort` return."""
        self._unread.put(None)

    def _read(self, question: Question) -> None:
        if question.key == protocol.INFO_KEY:
            self._outbox.tell_info(question)
        elif question.key == protocol.ROUTES_KEY:
            self._outbox.tell_routes(question)
        elif question.key == protocol.SNAPSHOT_KEY:
            self._outbox.tell_snapshot(question)
        else:
            self._read_command(question)

    def _read_command(self, question: Question) -> None:
        try:
            command = protocol.decode_command(question.payload, question.encoding)
        except protocol.Malformed as error:
            self._complain("malformed", str(error), question.received_ns)
            self._outbox.refuse(self._watched(question), 0, error.refusal)
            return
        question = self._watched(question, command)
        refusal = not_permitted(question.asker, command.request)
        if refusal is not None:  # before it costs anything, or binds an id
            self._outbox.refuse(question, command.request_id, refusal)
            return
        is_stop = isinstance(command.request, (protocol.Stop, protocol.Estop))
        if not self.identities.may_be(command.client_id, command.secret):
            self._complain("malformed", f"{command.client_id} is another client's id", question.received_ns)
            if not is_stop:
                self._outbox.refuse(question, command.request_id, _is_another(command.client_id))
                return
            command = structs.replace(command, client_id=STRANGER)  # a stop all the same, and not the owner's
        own = sum(other.client_id == command.client_id for other, _ in self._aside)
        if is_stop or not (own or isinstance(command.request, (protocol.Follow, protocol.CheckFollow))):
            self._take(command, question)
        elif own < MAX_ASIDE_OF_CLIENT and (self._is_heeded(command) or len(self._aside) < MAX_ASIDE):
            self._aside.append((command, question))
        else:
            self._complain("overflow", f"{MAX_ASIDE} requests wait for chunks to be worked out", question.received_ns)
            self._outbox.refuse(question, command.request_id, _too_many())

    def _is_heeded(self, command: protocol.Command) -> bool:
        return command.client_id in self.identities.pinned

    def _watched(self, question: Question, command: protocol.Command | None = None) -> Question:
        return question if self._audit is None else self._audit.watched(question, command)

    def _take(self, command: protocol.Command, question: Question) -> None:
        """Lay a command where the loop finds it, or refuse it."""
        taken = to_request(command.request)
        if isinstance(taken, Refusal):
            self._outbox.refuse(question, command.request_id, taken)
            return
        request, chunk = taken
        event = events.CommandRequested(
            client_id=command.client_id,
            name=question.asker.user,
            request_id=command.request_id,
            request=request,
            received_ns=question.received_ns,
            content=hash(question.payload),
            chunk=chunk,
            role=question.asker.role,
        )
        lane = self._stop_lane(request)
        own = len(self._commands.get(command.client_id, ()))
        is_full = own >= MAX_OF_CLIENT or (self._waiting >= MAX_WAITING and not self._is_heeded(command))
        # Also of stops: as many of them wait for the loop already.
        if is_full if lane is None else len(lane) >= MAX_WAITING:
            self._complain("overflow", f"{MAX_WAITING} requests wait for the control loop", question.received_ns)
            self._outbox.refuse(question, command.request_id, _too_many())
            return
        # Only what is let in binds an id. Another one may have been first under it while a chunk was worked out.
        if command.client_id != STRANGER and not self.identities.meet(
            command.client_id, command.secret, question.asker.door
        ):
            self._outbox.refuse(question, command.request_id, _is_another(command.client_id))
            return
        # First the question, then the event: the reply must find it.
        if not self._outbox.expect(command.client_id, command.request_id, question, is_stop=lane is not None):
            self._outbox.refuse(question, command.request_id, number_was_used(command.request_id))
            return
        if lane is not None:
            lane.append(event)
        else:
            with self._lock:
                self._commands.setdefault(event.client_id, deque()).append(event)
                self._waiting += 1
        self.on_arrival()

    def _stop_lane(self, request: requests.Request) -> _Lane | None:
        if isinstance(request, requests.Estop):
            return self._estops
        return self._stops if isinstance(request, requests.Stop) else None

    # ------------------------------------------------------------------------------------------------ the loop

    @property
    def has_more(self) -> bool:
        """Whether the last poll left requests for the next one."""
        return bool(self._commands)

    def poll(self) -> list[events.Event]:
        """Return what arrived since the last call: stops, then signs of life, targets, other requests, departures."""
        signs = self._seen or self._checked_in or self._gone
        if not (signs or self._commands or self._targets or self._estops or self._stops):
            return []  # what comes in this very moment is found by the next poll
        with self._lock:
            targets, self._targets = self._targets, {}
            seen, self._seen = self._seen, {}
            checked_in, self._checked_in = self._checked_in, {}
            gone, self._gone = self._gone, {}
        arrived: list[events.Event] = []
        for stop in (*_drain(self._estops), *_drain(self._stops)):
            self._outbox.take(stop.client_id, stop.request_id)
            arrived.append(stop)
        arrived += [events.ClientSeen(client_id=client, at_ns=at_ns) for client, at_ns in seen.items()]
        arrived += [events.EndpointHeard(client_id=client, at_ns=at_ns) for client, at_ns in checked_in.items()]
        for key, (payload, encoding, received_ns) in targets.items():
            target = self._read_target(key, payload, encoding, received_ns)
            if target is not None:
                arrived.append(target)
        arrived += self._some_commands()
        arrived += [events.ClientGone(client_id=client, at_ns=at_ns) for client, at_ns in gone.items()]
        return arrived

    def _some_commands(self) -> Iterator[events.CommandRequested]:
        """Give the next few requests, each client's in its order, the clients in turn: a flood delays only who sends it.

        Who owns or watches the robot comes first, but for each fourth time: others may have to take it, or to recover.
        """
        given = 0
        while given < PER_POLL:
            with self._lock:
                pinned = self.identities.pinned if self._favoured < PER_POLL - 1 else ()
                first = next(iter(self._commands), None)
                if first is None:
                    return
                client_id = next((one for one in self._commands if one in pinned), first)
                lane = self._commands.pop(client_id)
                command = lane.popleft()
                self._waiting -= 1
                if lane:
                    self._commands[client_id] = lane  # behind the others
            if self._outbox.take(command.client_id, command.request_id):
                cost = PER_POLL if isinstance(command.request, requests.Follow) else 1
                given, self._favoured = given + cost, self._favoured + cost if client_id in pinned else 0
                yield command

    def _read_target(self, key: str, payload: bytes, encoding: str, received_ns: int) -> events.TargetArrived | None:
        client_id, stream, _ = protocol.put_by(key)
        try:
            target = protocol.decode_target(payload, encoding)
            stream_id = int(stream)
        except ValueError as error:  # `Malformed` is one too
            self._complain("malformed", f"target of {client_id} on stream {stream}: {error}", received_ns)
            return None
        return to_target(target, client_id, stream_id, received_ns)

    def _complain(self, what: str, message: str, now_ns: int) -> None:
        """Count something that was not taken, and log it unless something was logged within the last second."""
        if what == "malformed":
            self.malformed += 1
        else:
            self.overflown += 1
        if now_ns >= self._next_log_ns:
            self._next_log_ns = now_ns + LOG_PERIOD_NS
            said = printable(message)  # field names and keys are the client's own
            log.warning("%s: %s (%d malformed, %d too many)", what, said, self.malformed, self.overflown)


def _drain(lane: _Lane) -> Iterator[events.CommandRequested]:
    """Yield what lies in a lane now; what another thread adds meanwhile comes with the next poll."""
    for _ in range(len(lane)):
        yield lane.popleft()


def _is_another(client_id: str) -> Refusal:
    return Refusal(
        code=Code.NOT_OWNER,
        message=f"the secret of client_id {client_id!r} is missing, or not its own: another connection has it; nothing ran",
        field="secret",
        hint="connect() gives each client an id and a secret of its own; who owns the robot is asked to give it, or take it",
    )


def _too_many() -> Refusal:
    return Refusal(
        code=Code.TIMEOUT,
        message="too many requests wait already; this one was not run",
        hint="send less often, and look whether the control loop runs (`ta2 status`)",
    )
