"""What leaves the daemon for its clients: replies, notices, snapshots, facts.

Rules
    * The loop thread only puts things here; encoding and sending happen in the thread that calls `deliver`. A client
      that does not read can hold that thread for a moment, never the loop.
    * Every question that was accepted is answered once: with the engine's reply, or after 2 s with what is known:
      TIMEOUT when the loop had not taken the command (then it never will), OUTCOME_UNKNOWN when it had. A question that
      is asked again while the first waits is answered together with it.
    * Of the snapshots only the newest is sent, and only while somebody listens.

Does not know zenoh; clocks are read by its caller.
"""

from __future__ import annotations

import logging
import queue
import threading
from collections.abc import Callable, Sequence
from functools import partial

from gateway.api import protocol
from gateway.api.question import Audience, Question, reply_encoding
from gateway.api.stop_lane import StopLane
from gateway.api.translate import to_notice, to_refusal, to_reply
from gateway.core.messages import outputs
from gateway.errors import Code, Refusal
from gateway.messages.snapshot import Snapshot

__all__ = ["MAX_UNSENT", "Outbox"]

MAX_UNSENT = 4096
"""Things waiting to be sent; beyond it notices are dropped and questions finished without an answer."""

NO_ROUTES = protocol.Routes(routes={}, bridge_version="", undelivered=0)
"""What is told before anybody knows of the robot's bridge."""

log = logging.getLogger(__name__)


class Outbox:
    """Everything on its way out. `send` and `publish_snapshot` are for the loop, `deliver` and `expire` for one thread.

    Args:
        info: What this daemon says of itself.
        stops: Answers to stops go this way.

    Attributes:
        info: What this daemon says of itself; another one where settings were read anew.
        routes: Tells how the robot's bridge stands to each topic; any thread.
    """

    def __init__(self, info: protocol.Info, stops: StopLane) -> None:
        self._stops = stops
        self.routes: Callable[[], protocol.Routes] = lambda: NO_ROUTES
        self.unanswered = 0
        self.dropped = 0
        self.info = info
        self._audiences: list[Audience] = []
        self._jobs: queue.SimpleQueue[Callable[[], None] | None] = queue.SimpleQueue()
        self._lock = threading.Lock()
        self._pending: dict[tuple[str, int], list[Question]] = {}
        self._taken: set[tuple[str, int]] = set()
        self._newest: Snapshot | None = None
        self._seq = 0
        self._told = 0
        self._snapshot_waits = False
        self._encoded: dict[tuple[type, str], tuple[object, bytes]] = {}

    # ------------------------------------------------------------------------------------------------ who listens

    def add_audience(self, audience: Audience) -> None:
        """Send notices and snapshots there too."""
        self._audiences.append(audience)

    # ------------------------------------------------------------------------------------------------ questions

    def expect(self, client_id: str, request_id: int, question: Question, *, is_stop: bool = False) -> bool:
        """Remember a question until the engine's reply to it arrives.

        Args:
            client_id: Who asks.
            request_id: Number of the request.
            question: What is asked.
            is_stop: Whether it stops: a stop is taken under any number.

        Returns:
            False when another request under this number still waits: its reply would answer this one, too.
        """
        with self._lock:
            waiting = self._pending.setdefault((client_id, request_id), [])
            if waiting and waiting[0].payload != question.payload and not is_stop:
                return False
            waiting.append(question)
            return True

    def take(self, client_id: str, request_id: int) -> bool:
        """Say that the loop takes a command now. False when its question was already answered: then it must not run."""
        key = (client_id, request_id)
        with self._lock:
            if key not in self._pending:
                return False
            self._taken.add(key)
            return True

    def refuse(self, question: Question, request_id: int, refusal: Refusal) -> None:
        """Answer a question that never reaches the engine.

        Args:
            question: What was asked.
            request_id: Of the command; 0 when it could not be read.
            refusal: Why not.
        """
        reply = protocol.Reply(request_id=request_id, refusal=to_refusal(refusal), after_seq=self._seq)
        self._put(partial(self._answer, question, reply), question)

    def tell_info(self, question: Question) -> None:
        """Answer with what this daemon says of itself."""
        self._put(partial(self._answer, question, self.info), question)

    def tell_routes(self, question: Question) -> None:
        """Answer with how the robot's bridge stands to each topic."""
        self._put(lambda: self._answer(question, self.routes()), question)

    def tell_snapshot(self, question: Question) -> None:
        """Answer with the newest snapshot; with a STATE_STALE reply before the first."""
        newest = self._newest
        if newest is None:
            self.refuse(question, 0, Refusal(code=Code.STATE_STALE, message="the daemon has made no snapshot yet"))
        else:
            self._put(partial(self._answer, question, newest), question)

    # ------------------------------------------------------------------------------------------------ from the loop

    @property
    def is_watched(self) -> bool:
        """Whether anybody listens to snapshots at present."""
        return any(audience.wants_snapshots() for audience in self._audiences)

    def send(self, replies: Sequence[outputs.Reply], notices: Sequence[outputs.Notice]) -> None:
        """Take replies and notices of one tick; returns at once."""
        for reply in replies:
            if not self._stops.answer(reply, self._seq):
                self._jobs.put(partial(self._reply, reply, self._seq))
        for notice in notices:
            self._told += 1  # also those that do not fit: their number is missing, and listeners see that
            self._put(partial(self._notice, notice, self._told))

    def do(self, job: Callable[[], None]) -> None:
        """Let the sender do something before it sends what comes later; returns at once."""
        self._jobs.put(job)

    def publish_snapshot(self, snapshot: Snapshot) -> None:
        """Take the newest snapshot; returns at once. It is sent while somebody listens, and kept for those who ask."""
        self._newest = snapshot
        self._seq = snapshot.seq
        if not self._snapshot_waits and self.is_watched:
            self._snapshot_waits = True  # before it is queued: the sender may have sent it before `_put` returns
            if not self._put(self._send_snapshot):
                self._snapshot_waits = False

    # ------------------------------------------------------------------------------------------------ the sender

    def deliver(self, timeout_s: float) -> bool:
        """Send the next thing, waiting for it at most `timeout_s`. Returns False when there was none."""
        try:
            job = self._jobs.get(timeout=timeout_s) if timeout_s > 0 else self._jobs.get_nowait()
        except queue.Empty:
            return False
        if job is not None:
            job()
        return True

    def wake(self) -> None:
        """Let a waiting `deliver` return."""
        self._jobs.put(None)

    def expire(self, now_ns: int) -> None:
        """Answer questions that have waited for the engine too long.

        Args:
            now_ns: Local monotonic time [ns].
        """
        limit_ns = now_ns - protocol.REPLY_WITHIN_NS
        with self._lock:
            late = [key for key, questions in self._pending.items() if questions[0].received_ns < limit_ns]
            answers = [(key, key in self._taken, self._pending.pop(key)) for key in late]
            self._taken.difference_update(late)
        seconds = protocol.REPLY_WITHIN_NS / 1e9
        for (_, request_id), taken, questions in answers:
            self.unanswered += 1
            if taken:
                refusal = Refusal(
                    code=Code.OUTCOME_UNKNOWN,
                    message=f"the control loop took it and did not answer within {seconds:g} s",
                )
            else:
                message = f"the control loop did not take it within {seconds:g} s; it was not run"
                refusal = Refusal(code=Code.TIMEOUT, message=message)
            for question in questions:
                self.refuse(question, request_id, refusal)

    # ------------------------------------------------------------------------------------------------ inside

    def _put(self, job: Callable[[], None], question: Question | None = None) -> bool:
        """Queue something to be sent; False when it had to be dropped."""
        if self._jobs.qsize() < MAX_UNSENT:
            self._jobs.put(job)
            return True
        self.dropped += 1
        if question is not None:
            question.drop()
        return False

    def _reply(self, reply: outputs.Reply, after_seq: int) -> None:
        key = (reply.client_id, reply.request_id)
        with self._lock:
            questions = self._pending.pop(key, [])
            self._taken.discard(key)
        if questions:
            message = to_reply(reply, after_seq)
            for question in questions:
                self._answer(question, message)

    def _answer(self, question: Question, message: object) -> None:
        encoding = reply_encoding(question)
        try:
            payload = self._payload(message, encoding)
        except (TypeError, ValueError) as error:
            log.error("an answer on %s cannot be encoded: %s", question.key, error)
            refusal = Refusal(code=Code.INTERNAL, message=f"the answer cannot be encoded: {error}")
            request_id = message.request_id if isinstance(message, protocol.Reply) else 0
            payload = protocol.encode(
                protocol.Reply(request_id=request_id, refusal=to_refusal(refusal), after_seq=self._seq), encoding
            )
        question.answer(payload, encoding)

    def _payload(self, message: object, encoding: str) -> bytes:
        """Return a message encoded; what many may ask for, once: a thread without rest keeps zenoh's from hearing the robot."""
        if isinstance(message, protocol.Reply):
            return protocol.encode(message, encoding)
        kept = self._encoded.get((type(message), encoding))
        if kept is None or kept[0] is not message:
            kept = self._encoded[type(message), encoding] = message, protocol.encode(message, encoding)
        return kept[1]

    def _notice(self, notice: outputs.Notice, number: int) -> None:
        payload = protocol.encode(to_notice(notice))
        for audience in self._audiences:
            audience.put_notice(payload, number)

    def _send_snapshot(self) -> None:
        self._snapshot_waits = False
        snapshot = self._newest
        if snapshot is None:
            return
        try:
            payload = self._payload(snapshot, protocol.MSGPACK)
        except (TypeError, ValueError) as error:
            log.error("snapshot %d cannot be encoded: %s", snapshot.seq, error)
            return
        for audience in self._audiences:
            if audience.wants_snapshots():
                audience.put_snapshot(payload, snapshot.seq)
