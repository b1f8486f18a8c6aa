"""The lane of stops: whatever arrives on their keys is the stop. It passes nothing that other requests pass.

Rules
    * Nothing is judged on the way: no version, no field, no number, no encoding, no size. The payload is read only for
      who asks and why, as far as it can be, and not before the stop itself is on its way.
    * No lock and no queue is shared with other requests, and the answer has a thread of its own. A stop rings a bell that
      ends the loop's sleep.
    * Bounded: of more than `MAX_WAITING` stops that no tick has taken yet, the later ones become one, which nobody has
      proven to be his own: whoever is among them, the robot stays stopped. The loop makes it: nobody comes to one that was
      answered meanwhile.

Does not know zenoh or the engine; arrival times are stamped by its callers.
"""

from __future__ import annotations

import itertools
import logging
import queue
from collections import deque
from collections.abc import Callable, Sequence
from typing import Any

import msgspec

from gateway.api import protocol
from gateway.api.bell import Bell
from gateway.api.keys import printable
from gateway.api.question import Question
from gateway.api.stop_pipe import MAP_MARKS, may_be_map
from gateway.api.translate import to_reply
from gateway.core.messages import events, outputs
from gateway.messages import requests

__all__ = ["ANSWERING_NS", "FIRST_NUMBER", "MAX_WAITING", "READ_BYTES", "StopLane"]

MAX_WAITING = 16
"""Stops that may wait for the loop by themselves; it takes all of them at its next tick."""
MAX_SHARING = 1024
"""Questions that may wait to share an answer; more get none, and stop all the same."""
ANSWERING_NS = 500_000_000
"""The thread that answers is alive which has answered a question that is not older than this [ns]."""
READ_BYTES = 4096
"""A longer payload is not looked at: it is a stop without a name or a reason."""
FIRST_NUMBER = 2**62 + 1
"""Numbers of stops in the engine: above those that clients give their requests."""
NAME_CHARS = 64
"""Of a name."""
SOMEBODY = "somebody"

log = logging.getLogger(__name__)


class StopLane:
    """Stops on their way in and their answers on the way out."""

    def __init__(self) -> None:
        self.taken = 0
        """Stops that arrived since the start."""
        self.on_arrival: Callable[[], None] = lambda: None
        """Called after each stop, from any thread: wakes whoever waits for more than stops."""
        self.watched: Callable[[Question], Question] = lambda question: question
        """Lets somebody look at the answer to a stop. Must not wait."""
        self.on_taken: Callable[[str, bytes, int, str], None] = lambda key, payload, received_ns, door: None
        """Called after each stop that wants no answer, from any thread: key, payload, arrival [ns], way. Must not wait."""
        self.proven: Callable[[str, str], bool] = lambda client_id, secret: False
        """Whether a client with this id and this secret is who it says."""
        self._numbers = itertools.count(FIRST_NUMBER)
        self._waiting: deque[tuple[int, str, bytes, int, bool]] = deque()
        self._crowd: dict[str, deque[tuple[bytes, int, Question | None]]]
        self._crowd = {key: deque() for key in (protocol.ESTOP_KEY, protocol.STOP_KEY)}
        self._questions: dict[int, list[tuple[Question, str]]] = {}
        # Who waits, with the encoding of each, and for what: None for a ping. None in its place only wakes the thread.
        self._answers: queue.SimpleQueue[tuple[list[tuple[Question, str]], protocol.Reply | None] | None]
        self._answers = queue.SimpleQueue()
        self._answered_ns = 0
        """When the latest question arrived that the thread has answered [ns]."""
        self._bell = Bell()

    def close(self) -> None:
        """Give the bell back; nothing may arrive, and nobody may wait any more."""
        self._bell.close()

    # ------------------------------------------------------------------------------------------------ coming in

    def arrive(
        self, key: str, payload: bytes, received_ns: int, question: Question | None = None, door: str = ""
    ) -> None:
        """Take a stop; any thread. Never refuses, never waits.

        Args:
            key: `STOP_KEY` or `ESTOP_KEY`.
            payload: What came with it; untrusted, and mostly not looked at here.
            received_ns: Local monotonic arrival [ns].
            question: Who waits for the answer; None for a put.
            door: By which way a put came.
        """
        self.taken += 1
        if question is not None:
            question = self.watched(question)
        crowd = self._crowd[key]
        if sum(entry[1] == key for entry in tuple(self._waiting)) < MAX_WAITING:
            self._enter(key, payload, received_ns, question)
        elif len(crowd) < (1 if question is None else MAX_SHARING):
            crowd.append((payload, received_ns, question))
        elif question is not None:
            question.drop()
        self._bell.ring()
        self.on_arrival()
        if question is None:
            self.on_taken(key, payload, received_ns, door)

    def _enter(
        self, key: str, payload: bytes, received_ns: int, question: Question | None, *, may_prove: bool = True
    ) -> int:
        number = next(self._numbers)
        if question is not None:  # before the stop: its answer must find it
            self._questions[number] = [(question, _encoding_of(question, payload))]
        self._waiting.append((number, key, payload, received_ns, may_prove))
        return number

    def ping(self, question: Question) -> None:
        """Take a question that is answered as a stop is, by the thread that answers stops; any thread. Never waits.

        In a crowd it is answered at once while that thread is seen to answer others: nobody can make it look dead by asking.
        """
        if self._answers.qsize() < MAX_WAITING:
            self._answers.put(([(question, "")], None))
        elif question.received_ns - self._answered_ns < ANSWERING_NS:
            question.answer(b"", "")
        else:
            question.drop()

    # ------------------------------------------------------------------------------------------------ the loop

    @property
    def has_waiting(self) -> bool:
        """Whether a stop waits to be polled."""
        return bool(self._waiting) or any(self._crowd.values())

    def wait(self, seconds: float, also: Sequence[int] = ()) -> bool:
        """Wait for a stop; return whether one came since the last call that said so. See `Bell.wait`."""
        return self._bell.wait(seconds, also)

    def poll(self) -> list[events.CommandRequested]:
        """Return the stops that arrived since the last call, e-stops first."""
        arrived: list[events.CommandRequested] = []
        if self.has_waiting:
            self._bell.hush()  # first: what comes from here on rings again
        for key, crowd in self._crowd.items():
            number = 0
            for _ in range(len(crowd)):
                payload, received_ns, question = crowd.popleft()
                if not number:
                    number = self._enter(key, payload, received_ns, question, may_prove=False)
                elif question is not None:
                    self._questions.setdefault(number, []).append((question, _encoding_of(question, payload)))
        while self._waiting:
            number, key, payload, received_ns, may_prove = self._waiting.popleft()
            client_id, name, reason = self.read(payload, may_prove=may_prove)
            is_estop = key == protocol.ESTOP_KEY
            arrived.append(
                events.CommandRequested(
                    client_id=client_id,
                    name=name,
                    request_id=number,
                    request=requests.Estop(reason=reason) if is_estop else requests.Stop(reason=reason),
                    received_ns=received_ns,
                    content=hash(payload),
                )
            )
        arrived.sort(key=lambda stop: isinstance(stop.request, requests.Stop))
        return arrived

    def answer(self, reply: outputs.Reply, after_seq: int) -> bool:
        """Take the engine's reply; False when it is not to a stop of this lane. Never waits."""
        if reply.request_id < FIRST_NUMBER:
            return False
        questions = self._questions.pop(reply.request_id, None)
        if questions:
            self._answers.put((questions, to_reply(reply, after_seq)))
        return True

    # ------------------------------------------------------------------------------------------------ its own thread

    def deliver(self, timeout_s: float) -> bool:
        """Answer those who wait for the next stop that was carried out; False when there was none in time."""
        try:
            job = self._answers.get(timeout=timeout_s) if timeout_s > 0 else self._answers.get_nowait()
        except queue.Empty:
            return False
        if job is not None:
            questions, reply = job
            for question, encoding in questions:
                question.answer(b"" if reply is None else protocol.encode(reply, encoding), encoding)
                self._answered_ns = max(self._answered_ns, question.received_ns)
        return True

    def wake(self) -> None:
        """Let a waiting `deliver` return."""
        self._answers.put(None)

    # ------------------------------------------------------------------------------------------------ inside

    def read(self, payload: bytes, *, may_prove: bool = True) -> tuple[str, str, str]:
        """Return who asks, under which name, and why, as far as the payload tells.

        Who asks is the proven id of a client, else what it calls itself; then there is no name beside it.
        """
        said = _said(payload)
        reason, client_id, secret, name = (_text(said, field) for field in ("reason", "client_id", "secret", "name"))
        if may_prove and client_id and secret and self.proven(client_id, secret):
            return client_id, name[:NAME_CHARS], reason
        # In quotes, which no client id has: nobody is taken for the owner by what he calls himself.
        name = name or client_id
        return (f"'{name[:NAME_CHARS]}'" if name else SOMEBODY), "", reason


def _said(payload: bytes) -> dict[str, Any]:
    """Return the fields of a payload: a map in msgpack or JSON, or plain text, which is the reason.

    What may be a part of a map is no text: nobody's secret becomes a reason.
    """
    if not payload or len(payload) > READ_BYTES:
        return {}
    is_text = not may_be_map(payload)
    for decode in (msgspec.json.decode, msgspec.msgpack.decode):
        try:
            said = decode(payload)
        except (ValueError, RecursionError, msgspec.MsgspecError):
            continue
        if isinstance(said, dict):
            return {key: value for key, value in said.items() if isinstance(key, str)}
        if isinstance(said, str) and is_text:
            return {"reason": said}
    return {"reason": payload.decode("utf-8", "replace").strip()} if is_text else {}


def _text(said: dict[str, Any], name: str) -> str:
    value = said.get(name)
    return printable(value) if isinstance(value, str) else ""


def _encoding_of(question: Question, payload: bytes) -> str:
    """Return how to answer: in msgpack to whoever spoke it or asked for it, else in JSON, which a person can read."""
    is_map = payload[:1] in MAP_MARKS
    return (
        protocol.MSGPACK
        if question.encoding == protocol.MSGPACK or (is_map and not question.encoding)
        else protocol.JSON
    )
