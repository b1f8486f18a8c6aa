"""Asking a policy's server in a thread of its own: whoever plays chunks orders one, and goes on playing until it is there."""

from __future__ import annotations

import time
from collections.abc import Callable
from queue import Empty, Queue, SimpleQueue

from msgspec import Struct

from gateway.errors import Code, GatewayError, failure
from gateway.policy.chunks import Chunk, chunk_of
from gateway.policy.lerobot import LeRobotServer
from gateway.policy.local_server import LocalPolicy
from gateway.policy.observing import Observation, Observer
from gateway.policy.openpi import PolicyServer
from gateway.policy.policy_map import Actions
from gateway.process.threads import Lost, supervised

__all__ = ["RATES", "Answer", "Asking"]

RATES = ("fps", "hz", "control_hz")
"""Names under which a server's metadata say how many steps a second there are; the first one counts."""


class Answer(Struct, frozen=True, kw_only=True):
    """A chunk, and what it was made from.

    Attributes:
        chunk: What the policy wants.
        observation: What it was shown.
        delay_ns: From its being shown to the answer [ns].
    """

    chunk: Chunk
    observation: Observation
    delay_ns: int


class Asking:
    """One order, one answer or error. Connects by itself when there is no connection, again only to the same policy.

    Args:
        server: Who is asked.
        observer: Looks just before.
        layout: Of its actions.
        period_ns: From step to step [ns].
        now_ns: The monotonic clock [ns].
    """

    def __init__(
        self,
        server: PolicyServer | LeRobotServer | LocalPolicy,
        observer: Observer,
        layout: Actions,
        period_ns: int,
        now_ns: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        self._server, self._observer, self._layout = server, observer, layout
        self._period_ns, self._now_ns = period_ns, now_ns
        self._policy = self._said() if server.is_connected else None
        self._orders: SimpleQueue[bool] = SimpleQueue()
        self._answers: Queue[Answer | GatewayError] = Queue()  # a simple one of Python 3.10 may wait 0 s for ever
        self._thread = supervised(self._run, "ta2-policy-server", on_lost=self._lost)
        self._thread.start()

    def order(self) -> None:
        """Have it asked; never waits."""
        self._orders.put(True)

    def answer(self, timeout_s: float) -> Answer | GatewayError | None:
        """Return the next answer, or why there is none; None when neither came in time."""
        try:
            return self._answers.get(timeout=max(0.0, timeout_s))
        except Empty:
            return None

    def close(self) -> None:
        """Hang up, and end the thread."""
        self._orders.put(False)
        self._server.close()
        self._thread.join(1.0)

    def _run(self) -> None:
        while self._orders.get():
            try:
                self._answers.put(self._asked())
            except GatewayError as error:
                self._answers.put(error)

    def _asked(self) -> Answer:
        if not self._server.is_connected:
            self._server.connect()
            said = self._said()
            if self._policy not in (None, said):
                self._server.close()
                message = (
                    f"another policy answers at {self._server.url}: it says {said}, at first it was {self._policy}"
                )
                raise failure(
                    Code.BAD_REQUEST, message, field="policy", hint="begin anew, at its rate and with its task"
                )
            self._policy = said
        seen = self._observer.observe()
        asked_ns = self._now_ns()
        answer = self._server.ask(seen.values)
        delay_ns = self._now_ns() - asked_ns
        chunk = chunk_of(answer, self._layout, seen.observed_ns, self._period_ns)
        return Answer(chunk=chunk, observation=seen, delay_ns=delay_ns)

    def _said(self) -> str:
        """Return what a server says of its policy that a run is begun with."""
        told = self._server.metadata
        return ", ".join(f"{key} {told[key]!r}" for key in (*RATES, "available_tasks") if key in told)

    def _lost(self, lost: Lost) -> None:
        self._answers.put(failure(Code.INTERNAL, str(lost)))
