"""One open zenoh session to the robot's router, with everything declared on it.

Order of the declarations: the token that a gateway is here, command keys, transport events, our other liveliness tokens,
subscriptions, tokens of others, and last, or when it is wanted, what others command. A token per state topic comes before
its subscription, since without it somebody else's leaving subscriber ends our state for good (wire.md fact 8). After a
reconnect zenoh declares all of it again by itself.

Callbacks only stamp and store. They run in Python threads of their own, one per subscription (`indirect=True`): called
directly from zenoh's one reader thread, each sample would wait for the GIL in line with all others. Two runs each with
1,800 samples/s and a busy Python thread beside, on a shared machine with two cores, latency in the middle / 99 %:
3-4 / 26-45 ms against 380-470 / 1,270-1,320 ms (switch interval 5 ms), 0.6-1.3 / 3-36 ms against 0.7-4.7 / 59-82 ms
(0.5 ms); alike with a quiet GIL (0.15-0.3 ms). The price: these threads keep a process alive until the session closes.
Topics whose mailbox is a tray have no callback at all: zenoh keeps their latest samples until the loop looks.

Commands are put DROP, express and to REMOTE only, on declared keys but without declared publishers: the router would list
those, and an answer to who asks for them can hang it (`foreign_watch`; a put costs the same, 15 to 30 µs). The heartbeat
has its own priority, so that a late 0.0 is neither dropped behind setpoints nor overtaken (wire.md 7.3). Never `delete`.
"""

from __future__ import annotations

import contextlib
import logging
import threading
import time
from collections.abc import Callable, Collection, Mapping, Sequence
from functools import partial
from itertools import islice
from typing import Any

import zenoh
from msgspec import Struct

from cdr_types.keys import (
    ALL_TOKENS,
    History,
    Qos,
    Reliability,
    Token,
    TokenKind,
    format_token,
    topic_to_key,
)
from gateway.link.mailbox import CAPACITY, Mailbox, Tray
from gateway.link.others.gateway_token import format_gateway_token, gateway_tokens
from gateway.process.threads import supervised
from gateway.robot.topics import FSM_ENABLE, TOPICS
from gateway.settings.settings import LinkSettings

__all__ = ["RobotSession", "SessionListener"]

ASK_TIMEOUT_S = 1.0
ASK_ANSWERS = 1024
"""Most answers to one question that can wait to be read."""
ASK_POLL_S = 0.005
REDECLARE_PAUSE_S = 0.2
"""Between undeclaring and declaring a dead route's subscription: 0.05 is enough for the bridge (wire.md 3.1 b), the rest
lets daemon and guard be out together."""

RING_SAMPLES = 256
"""Samples that zenoh keeps for a tray: more than a second of a fast topic."""

STATE_QOS = Qos(reliability=Reliability.RELIABLE, history=History.KEEP_LAST, depth=10)
"""What our tokens announce: the QoS of the state topics (manual §4.1.1)."""

_log = logging.getLogger(__name__)


class SessionListener(Struct, frozen=True, kw_only=True):
    """Where the callbacks put things. All of them only store; any thread.

    Attributes:
        mailboxes: Per state topic that is heard; a tray gets no callback.
        transport: Called with zenoh id of the router, whether the transport opened, and when [ns].
        token: Called with the key expression of a liveliness token and whether it is there.
        gateway: The same for the token of a gateway.
    """

    mailboxes: Mapping[str, Mailbox]
    transport: Callable[[str, bool, int], None]
    token: Callable[[str, bool], None]
    gateway: Callable[[str, bool], None]


class RobotSession:
    """Declares everything on an open session and keeps it referenced: commands at once, the rest with `listen`.

    Args:
        session: Open zenoh session; whoever opened it closes it, and everything declared goes with it.
        settings: Namespace and model.
        listener: Where the callbacks put things.
        clock: Monotonic clock [ns].
        is_reader: Whether it only looks: no token of ours, no command.
    """

    def __init__(
        self,
        session: zenoh.Session,
        settings: LinkSettings,
        listener: SessionListener,
        clock: Callable[[], int],
        *,
        is_reader: bool = False,
    ) -> None:
        self._session = session
        self._clock = clock
        self._listener = listener
        self._keys = {topic: topic_to_key(topic, settings.namespace) for topic in TOPICS}
        self.zid = str(session.zid())
        self._namespace = settings.namespace
        self._command_keys = topic_to_key("/api", settings.namespace) + "/**"
        self._is_reader = is_reader
        if not is_reader:
            self._presence = session.liveliness().declare_token(
                format_gateway_token(self.zid, settings.namespace, is_armed=False)
            )
        commands = () if is_reader else settings.variant.command_topics
        self._puts = {topic: self._sender(topic) for topic in commands}
        self._subscribers: dict[str, zenoh.Subscriber[Any]] = {}  # Any: with a callback or with a ring
        self._commands: Callable[[], Sequence[zenoh.Sample]] = tuple
        self._hearing = threading.Lock()
        self._kept: list[Any] = []  # Any: whatever zenoh declares; dropping one would undeclare it

    def listen(self) -> None:
        """Declare everything that comes in; from here on the listener is called."""
        session, callback = self._session, zenoh.handlers.Callback
        self._kept.append(session.info.declare_transport_events_listener(callback(self._on_transport), history=True))
        tokens = () if self._is_reader else map(self._own_token, self._listener.mailboxes)
        self._kept += [session.liveliness().declare_token(token) for token in tokens]
        self._subscribers = {topic: self._subscribe(topic) for topic in self._listener.mailboxes}
        for keys, take in ((ALL_TOKENS, self._on_token), (gateway_tokens(self._namespace), self._on_gateway)):
            self._kept.append(session.liveliness().declare_subscriber(keys, callback(take), history=True))

    def hear_commands(self) -> None:
        """Hear the commands of others from now on. Any thread; returns at once: to declare takes long where the link hangs.

        Never undone: a subscriber that leaves may end what others hear (wire.md fact 8).
        """
        supervised(self._hear_commands, "hear-commands").start()

    def _hear_commands(self) -> None:
        with self._hearing, contextlib.suppress(zenoh.ZError):  # closed: the next session is asked in its turn
            if self._commands is tuple:
                # Of remote origin: our own puts do not come back. A ring that the loop empties: nothing wakes while nobody
                # sends.
                ring = self._session.declare_subscriber(
                    self._command_keys, zenoh.handlers.RingChannel(CAPACITY), allowed_origin=zenoh.Locality.REMOTE
                )
                self._kept.append(ring)
                self._commands = _drain(ring.try_recv)

    def declare_armed(self) -> Callable[[], None]:
        """Show other gateways that we command the robot; return what ends that.

        Raises:
            zenoh.ZError: The session is closed.
        """
        token = self._session.liveliness().declare_token(format_gateway_token(self.zid, self._namespace, is_armed=True))
        return token.undeclare

    def put(self, topic: str, payload: bytes) -> bool:
        """Send a payload; return False when the session is closed."""
        try:
            self._puts[topic](payload)
        except zenoh.ZError as error:
            _log.debug("%s not sent: %s", topic, error)
            return False
        return True

    def take_commands(self, take: Callable[[str, str], None]) -> None:
        """Hand over the commands of other sessions that have come since the last call. One thread only; never waits.

        Args:
            take: Called with the data key and the zenoh id of who stamped it; empty when nobody did.
        """
        for sample in self._commands():
            stamp = sample.timestamp
            take(str(sample.key_expr), "" if stamp is None else str(stamp.get_id()))

    def redeclare(self, topics: Collection[str], closing: threading.Event) -> None:
        """Undeclare the subscriptions of state topics, wait a moment, declare them again; their tokens stay.

        When that fails a topic has no subscription; the next call declares one.
        """
        for topic in topics:
            subscriber = self._subscribers.pop(topic, None)
            if subscriber is not None:
                subscriber.undeclare()  # type: ignore[no-untyped-call]  # zenoh's stub gives no types here
        closing.wait(REDECLARE_PAUSE_S)
        for topic in topics:
            self._subscribers[topic] = self._subscribe(topic)

    def ask(self, selector: str, closing: threading.Event) -> dict[str, bytes]:
        """Ask every queryable under a selector and return payloads by key; at most a second, less when closing."""
        answers: dict[str, bytes] = {}
        channel: zenoh.handlers.FifoChannel[zenoh.Reply] = zenoh.handlers.FifoChannel(ASK_ANSWERS)
        replies = self._session.get(selector, channel, target=zenoh.QueryTarget.ALL, timeout=ASK_TIMEOUT_S)
        end_s = time.monotonic() + 1.5 * ASK_TIMEOUT_S
        while time.monotonic() < end_s:
            try:
                reply = replies.try_recv()
            except zenoh.ZError:  # all answers are in
                break
            if reply is None:
                if closing.wait(ASK_POLL_S):
                    break
            elif reply.ok is not None:
                answers[str(reply.ok.key_expr)] = reply.ok.payload.to_bytes()
        return answers

    # -------------------------------------------------------------------------------------------------- declarations

    def _own_token(self, topic: str) -> str:
        return format_token(
            Token(
                zid=self.zid,
                kind=TokenKind.MS,
                topic=f"/{self._keys[topic]}",
                type_name=TOPICS[topic].type_name,
                qos=STATE_QOS,
            )
        )

    def _subscribe(self, topic: str) -> zenoh.Subscriber[Any]:
        mailbox, clock = self._listener.mailboxes[topic], self._clock
        if isinstance(mailbox, Tray):
            not_before_ns = clock()
            ring = self._session.declare_subscriber(self._keys[topic], zenoh.handlers.RingChannel(RING_SAMPLES))
            mailbox.attach(_drain(ring.try_recv), not_before_ns)
            return ring
        put = mailbox.put

        def receive(sample: zenoh.Sample) -> None:
            received_ns = clock()
            put(sample.payload.to_bytes(), received_ns)

        return self._session.declare_subscriber(self._keys[topic], zenoh.handlers.Callback(receive))

    def _sender(self, topic: str) -> Callable[[bytes], None]:
        is_heartbeat = topic == FSM_ENABLE
        return partial(
            self._session.put,
            self._session.declare_keyexpr(self._keys[topic]),
            congestion_control=zenoh.CongestionControl.DROP,
            express=True,
            priority=zenoh.Priority.REAL_TIME if is_heartbeat else zenoh.Priority.INTERACTIVE_HIGH,
            allowed_destination=zenoh.Locality.REMOTE,
        )

    # ----------------------------------------------------------------------------------------------------- callbacks

    def _on_transport(self, event: zenoh.TransportEvent) -> None:
        at_ns = self._clock()
        self._listener.transport(str(event.transport.zid), event.kind == zenoh.SampleKind.PUT, at_ns)

    def _on_token(self, sample: zenoh.Sample) -> None:
        self._listener.token(str(sample.key_expr), sample.kind == zenoh.SampleKind.PUT)

    def _on_gateway(self, sample: zenoh.Sample) -> None:
        self._listener.gateway(str(sample.key_expr), sample.kind == zenoh.SampleKind.PUT)


def _drain(try_recv: Callable[[], zenoh.Sample | None]) -> Callable[[], Sequence[zenoh.Sample]]:
    """Return what empties a ring; it is empty, too, when there is no subscription any more."""

    def drain() -> Sequence[zenoh.Sample]:
        try:
            return list(islice(iter(try_recv, None), CAPACITY))
        except zenoh.ZError:  # undeclared, or its session is closed
            return ()

    return drain
