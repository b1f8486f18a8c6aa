"""One zenoh session of the local plane: a listener, its keys, and what arrives there. `service.py` has one or two.

Rules
    * Targets and keepalives are heard on the secret keys of those who matter alone. Nobody is told of these subscriptions.
    * Callbacks run on zenoh's own threads: they stamp and put away, nothing else.
    * Queries are answered from the sender's thread; a query that cannot be answered any more is dropped, never raised.
    * Puts of the daemon are dropped for a client that does not read, never waited for.
"""

from __future__ import annotations

import json
import logging
import time
from collections.abc import Mapping, Set
from functools import partial
from typing import Any

import zenoh

from gateway.api import protocol
from gateway.api.access.roles import Asker
from gateway.api.inbox import Inbox
from gateway.api.question import ZenohQuestion, plain_encoding
from gateway.api.stop_lane import StopLane
from gateway.process.callbacks import direct
from gateway.values import Role

__all__ = ["ZenohPlane"]

TOKENS = 1024
"""May come and go between two calls of `take_departures`; of more, the oldest are forgotten: keepalives decide anyway."""
TOKENS_AT_ONCE = 64

log = logging.getLogger(__name__)


class ZenohPlane:
    """A router session with the queryables, subscribers, publishers and the token of a daemon.

    Args:
        configuration: From `listener`.
        inbox: Where everything that arrives goes, but stops.
        stops: Where stops go.
        roles: Who has which, for whom `configuration` has rules; None where everybody here may ask for everything.

    Raises:
        zenoh.ZError: The listener cannot be opened.
    """

    def __init__(
        self, configuration: dict[str, Any], inbox: Inbox, stops: StopLane, roles: Mapping[str, Role] | None = None
    ) -> None:
        is_socket = str(configuration["listen/endpoints"][0]).startswith("unixsock-stream/")
        door = "socket" if is_socket else "network"
        self._somebody = Asker(door=door, role=Role.ADMIN if roles is None else Role.VIEWER)
        self._users = [Asker(door=door, user=user, role=role) for user, role in (roles or {}).items()]
        self._inbox = inbox
        self._stops = stops
        self._listened = False
        self._lanes: dict[tuple[str, str], list[zenoh.Subscriber[None]]] = {}
        config = zenoh.Config()
        for key, value in configuration.items():
            config.insert_json5(key, json.dumps(value))
        self._session = zenoh.open(config)
        try:
            self._declare()
        except zenoh.ZError:
            self._session.close()  # type: ignore[no-untyped-call]  # as above
            raise

    def _declare(self) -> None:
        session = self._session
        drop = zenoh.CongestionControl.DROP
        self._snapshots = session.declare_publisher(
            protocol.SNAPSHOT_KEY, encoding=protocol.MSGPACK, congestion_control=drop
        )
        self._notices = session.declare_publisher(
            protocol.EVENT_KEY, encoding=protocol.MSGPACK, congestion_control=drop
        )
        self._snapshots.declare_matching_listener(zenoh.handlers.Callback(self._on_matching, indirect=False))
        for key in (protocol.STOP_KEY, protocol.ESTOP_KEY):
            session.declare_queryable(key, zenoh.handlers.Callback(self._on_stop_query, indirect=False))
            session.declare_subscriber(key, zenoh.handlers.Callback(self._on_stop, indirect=False))
        session.declare_queryable(protocol.PING_KEY, zenoh.handlers.Callback(self._on_ping, indirect=False))
        asked = [(key, self._somebody) for key in (protocol.INFO_KEY, protocol.ROUTES_KEY, protocol.SNAPSHOT_KEY)]
        asked += [(protocol.command_key(asker.user), asker) for asker in (self._somebody, *self._users)]
        for key, asker in asked:
            on_query = partial(self._on_query, asker)
            session.declare_queryable(key, zenoh.handlers.Callback(on_query, indirect=False))
        self._tokens = session.liveliness().declare_subscriber(
            protocol.CLIENT_TOKENS, zenoh.handlers.RingChannel(TOKENS)
        )
        live = session.liveliness()
        self._names = [live.declare_token(protocol.user_token(asker.user)) for asker in self._users]
        # Last: who sees the token finds everything else in place.
        self._token = session.liveliness().declare_token(protocol.daemon_token(str(session.zid())))

    # ------------------------------------------------------------------------------------------------ zenoh's threads

    def _on_stop(self, sample: zenoh.Sample) -> None:
        self._stops.arrive(
            str(sample.key_expr), sample.payload.to_bytes(), time.monotonic_ns(), None, self._somebody.door
        )

    def _on_stop_query(self, query: zenoh.Query) -> None:
        question = ZenohQuestion(query, time.monotonic_ns(), self._somebody)
        self._stops.arrive(question.key, question.payload, question.received_ns, question)

    def _on_ping(self, query: zenoh.Query) -> None:
        self._stops.ping(ZenohQuestion(query, time.monotonic_ns(), self._somebody))

    def _on_query(self, asker: Asker, query: zenoh.Query) -> None:
        self._inbox.ask(ZenohQuestion(query, time.monotonic_ns(), asker))

    def _on_target(self, sample: zenoh.Sample) -> None:
        now_ns = time.monotonic_ns()
        self._inbox.put_target(str(sample.key_expr), sample.payload.to_bytes(), plain_encoding(sample.encoding), now_ns)

    def _on_keepalive(self, sample: zenoh.Sample) -> None:
        self._inbox.put_keepalive(str(sample.key_expr), time.monotonic_ns())

    def _on_check_in(self, sample: zenoh.Sample) -> None:
        self._inbox.put_check_in(str(sample.key_expr), time.monotonic_ns())

    def _on_matching(self, status: zenoh.MatchingStatus) -> None:
        self._listened = status.matching

    # ------------------------------------------------------------------------------------------------ the loop

    def take_departures(self) -> None:
        """Put away who has gone since the last call. Never waits.

        Tokens come without a line of Python: a crowd that connects must not have zenoh's threads wait for Python's lock.
        """
        for _ in range(TOKENS_AT_ONCE):
            sample = self._tokens.try_recv()
            if sample is None:
                return
            if sample.kind == zenoh.SampleKind.DELETE:
                self._inbox.put_gone(protocol.token_id(str(sample.key_expr)), time.monotonic_ns(), self._somebody.door)

    # ------------------------------------------------------------------------------------------------ the sender

    def open_lanes(self, lanes: Set[tuple[str, str]]) -> None:
        """Take the targets, keepalives and check-ins of these clients, given with their secrets, and of nobody else.

        What others put on such keys ends in zenoh: it costs no line of Python.
        """
        for lane in self._lanes.keys() - lanes:
            for subscriber in self._lanes.pop(lane):
                subscriber.undeclare()  # type: ignore[no-untyped-call]  # as above
        for lane in lanes - self._lanes.keys():
            takers = zip(
                protocol.lane_keys(*lane), (self._on_target, self._on_keepalive, self._on_check_in), strict=True
            )
            self._lanes[lane] = [self._session.declare_subscriber(key, direct(take)) for key, take in takers]

    def wants_snapshots(self) -> bool:
        """Whether anybody listens to snapshots at present."""
        return self._listened

    def put_snapshot(self, payload: bytes, seq: int) -> None:
        """Send a snapshot; its number goes along, so that a listener can count gaps without decoding."""
        self._put(self._snapshots, payload, str(seq).encode())

    def put_notice(self, payload: bytes, number: int) -> None:
        """Send a notice; its number goes along, so that a listener knows how many it missed."""
        self._put(self._notices, payload, str(number).encode())

    def _put(self, publisher: zenoh.Publisher, payload: bytes, attachment: bytes) -> None:
        try:
            publisher.put(payload, attachment=attachment)
        except zenoh.ZError as error:
            log.debug("a put on %s was not sent: %s", publisher.key_expr, error)

    def close(self) -> None:
        """Close the session; the listener and everything declared go with it."""
        self._session.close()  # type: ignore[no-untyped-call]  # as above
