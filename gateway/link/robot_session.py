"""One open zenoh session to the robot's router, with everything declared on it.

Order of the declarations: publishers, transport events, our own liveliness tokens, subscriptions, tokens of others.
Publishers come first because zenoh drops what is put before the router has said who listens: when the first state
comes, commands get through. A token per state topic comes before its subscription, since without it somebody else's
leaving subscriber ends our state for good (wire.md fact 8). After a reconnect zenoh declares all of it again by itself.

Callbacks only stamp and store. They run in Python threads of their own, one per subscription (`indirect=True`): called
directly from zenoh's one reader thread, each sample would wait for the GIL in line with all others. Two runs each with
1,800 samples/s and a busy Python thread beside, on a shared machine with two cores, latency in the middle / 99 %:
3-4 / 26-45 ms against 380-470 / 1,270-1,320 ms (switch interval 5 ms), 0.6-1.3 / 3-36 ms against 0.7-4.7 / 59-82 ms
(0.5 ms); alike with a quiet GIL (0.15-0.3 ms). The price: these threads keep a process alive until the session closes.

Publishers are DROP, express and REMOTE only; the heartbeat has its own priority, so that a late 0.0 is neither dropped
behind setpoints nor overtaken (wire.md 7.3). Never `delete`.
"""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import zenoh

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
from gateway import robot
from gateway.link.mailbox import Mailbox
from gateway.settings import LinkSettings

__all__ = ["RobotSession", "SessionListener"]

ASK_TIMEOUT_S = 1.0
ASK_ANSWERS = 1024
"""Most answers to one question that can wait to be read."""
ASK_POLL_S = 0.005
REDECLARE_PAUSE_S = 0.05
"""Between undeclaring and declaring a dead route's subscription (wire.md 3.1 b)."""

STATE_QOS = Qos(reliability=Reliability.RELIABLE, history=History.KEEP_LAST, depth=10)
"""What our tokens announce: the QoS of the state topics (manual §4.1.1)."""

_log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True, kw_only=True)
class SessionListener:
    """Where the callbacks put things. All of them only store; any thread.

    Attributes:
        mailboxes: Per state topic.
        transport: Called with zenoh id of the router, whether the transport opened, and when [ns].
        token: Called with the key expression of a liveliness token and whether it is there.
    """

    mailboxes: Mapping[str, Mailbox]
    transport: Callable[[str, bool, int], None]
    token: Callable[[str, bool], None]


class RobotSession:
    """Declares everything on an open session and keeps it referenced: commands at once, the rest with `listen`.

    Args:
        session: Open zenoh session; whoever opened it closes it, and everything declared goes with it.
        settings: Namespace and model.
        listener: Where the callbacks put things.
        clock: Monotonic clock [ns].
    """

    def __init__(
        self, session: zenoh.Session, settings: LinkSettings, listener: SessionListener, clock: Callable[[], int]
    ) -> None:
        self._session = session
        self._clock = clock
        self._listener = listener
        self._keys = {topic: topic_to_key(topic, settings.namespace) for topic in robot.TOPICS}
        self.zid = str(session.zid())
        self._publishers = {topic: self._publisher(topic) for topic in settings.variant.command_topics}
        self._subscribers: dict[str, zenoh.Subscriber[None]] = {}
        self._kept: list[Any] = []  # Any: whatever zenoh declares; dropping one would undeclare it

    def listen(self) -> None:
        """Declare everything that comes in; from here on the listener is called."""
        session, callback = self._session, zenoh.handlers.Callback
        self._kept.append(session.info.declare_transport_events_listener(callback(self._on_transport), history=True))
        self._kept += [session.liveliness().declare_token(self._own_token(topic)) for topic in robot.STATE_TOPICS]
        self._subscribers = {topic: self._subscribe(topic) for topic in robot.STATE_TOPICS}
        self._kept.append(session.liveliness().declare_subscriber(ALL_TOKENS, callback(self._on_token), history=True))

    def put(self, topic: str, payload: bytes) -> bool:
        """Send a payload; return False when the session is closed."""
        try:
            self._publishers[topic].put(payload)
        except zenoh.ZError as error:
            _log.debug("%s not sent: %s", topic, error)
            return False
        return True

    def matching(self) -> dict[str, bool]:
        """Return, per command topic, whether the router knows a subscriber."""
        # The stub says bool; it is an object that is always true (wire.md 2.4).
        return {topic: bool(getattr(p.matching_status, "matching", False)) for topic, p in self._publishers.items()}

    def redeclare(self, topic: str, closing: threading.Event) -> None:
        """Undeclare a state topic's subscription, wait 50 ms, declare it again; its token stays.

        When that fails the topic has no subscription; the next call declares one.
        """
        subscriber = self._subscribers.pop(topic, None)
        if subscriber is not None:
            subscriber.undeclare()  # type: ignore[no-untyped-call]  # zenoh's stub gives no types here
        closing.wait(REDECLARE_PAUSE_S)
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
                type_name=robot.TOPICS[topic].type_name,
                qos=STATE_QOS,
            )
        )

    def _subscribe(self, topic: str) -> zenoh.Subscriber[None]:
        put, clock = self._listener.mailboxes[topic].put, self._clock

        def receive(sample: zenoh.Sample) -> None:
            received_ns = clock()
            put(sample.payload.to_bytes(), received_ns)

        return self._session.declare_subscriber(self._keys[topic], zenoh.handlers.Callback(receive))

    def _publisher(self, topic: str) -> zenoh.Publisher:
        is_heartbeat = topic == robot.FSM_ENABLE
        return self._session.declare_publisher(
            self._keys[topic],
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
