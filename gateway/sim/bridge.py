"""The robot's side of the wire: a zenoh router that exposes what a ros2dds bridge exposes.

Keys, CDR, QoS, liveliness tokens and admin replies as the bridge shows them (wire reference §1, §2, §4, §5; field
names of the route entries from the plugin's sources). A state route has a reader, and is published, only while a
remote subscriber matches. zenoh's own threads only stamp and enqueue here; everything else happens in the thread
that owns the bridge.

Knows nothing of what a message means.
"""

from __future__ import annotations

import json
from collections import deque
from collections.abc import Callable, Mapping
from typing import Final, cast

import zenoh
from pycdr2 import IdlStruct

from cdr_types import decode, encode
from cdr_types.errors import CdrError
from cdr_types.keys import (
    ALL_TOKENS,
    Qos,
    Reliability,
    Token,
    TokenKind,
    format_token,
    parse_token,
    presence_key,
    topic_to_key,
)
from cdr_types.registry import message_type
from gateway.process.callbacks import direct
from gateway.sim.wire import Arrival

__all__ = ["CONTROL_KEY", "Bridge", "bridge_config"]

CONTROL_KEY: Final = "sim/control"
"""Query key of the simulation's own control channel; no robot has it."""

VERSION: Final = "v1.10.2 (simulated)"
LEASE_MS: Final = 10_000
QOS: Final = Qos(reliability=Reliability.RELIABLE)
"""Reliable, volatile, depth not said: how Fast DDS nodes appear, as text `:1::` (wire reference §4.1)."""

_NODE: Final = "/ta2_sim"


def bridge_config(listen: str) -> zenoh.Config:
    """Return the configuration of the robot's router.

    Args:
        listen: Endpoint, e.g. `tcp/127.0.0.1:9000`.
    """
    config = {
        "mode": "router",
        "listen": {"endpoints": [listen]},
        "connect": {"endpoints": []},
        "scouting": {"multicast": {"enabled": False}, "gossip": {"enabled": False}},
        "timestamping": {"enabled": True},
        "adminspace": {"enabled": True, "permissions": {"read": True, "write": False}},
        "transport": {"link": {"tx": {"lease": LEASE_MS}}, "shared_memory": {"enabled": False}},
    }
    return zenoh.Config.from_json5(json.dumps(config))


class _StateRoute:
    """DDS -> zenoh: a publisher that is active while a remote subscriber matches."""

    def __init__(self, session: zenoh.Session, key: str) -> None:
        self.is_matched = False
        self.is_dead = False
        self.publisher = session.declare_publisher(
            key,
            congestion_control=zenoh.CongestionControl.BLOCK,
            priority=zenoh.Priority.DATA,
            reliability=zenoh.Reliability.RELIABLE,
            allowed_destination=zenoh.Locality.REMOTE,
        )
        self._listener = self.publisher.declare_matching_listener(
            zenoh.handlers.Callback(self._matching_changed, indirect=False)
        )
        # The stub says bool; it is a MatchingStatus, always truthy (wire reference §2.4).
        self._matching_changed(cast(zenoh.MatchingStatus, self.publisher.matching_status))

    def _matching_changed(self, status: zenoh.MatchingStatus) -> None:
        if status.matching and not self.is_matched:
            self.is_dead = False  # a new first subscriber makes a new reader (wire reference §3.1 b)
        self.is_matched = status.matching

    @property
    def is_active(self) -> bool:
        """Whether the bridge reads the topic."""
        return self.is_matched and not self.is_dead


class Bridge:
    """One life of the robot's router, from open to close.

    Attributes:
        arrivals: Samples on command keys, oldest first; the owner takes them out.
        queries: Queries that wait for an answer from the owner's thread.
        zid: Zenoh id of this life.
    """

    def __init__(
        self,
        listen: str,
        states: Mapping[str, str],
        commands: Mapping[str, str],
        clock: Callable[[], int],
        namespace: str = "",
    ) -> None:
        """Listen and announce everything.

        The namespace is put before every key, as a bridge of that option does; empty for none.

        Raises:
            zenoh.ZError: If the endpoint cannot be listened on.
        """
        self.arrivals: deque[Arrival] = deque()
        self.queries: deque[zenoh.Query] = deque()
        self._states, self._commands, self._clock = states, commands, clock
        self._types = {topic: message_type(name) for topic, name in commands.items()}
        self._namespace = namespace
        self._keys = {topic: topic_to_key(topic, namespace) for topic in (*states, *commands)}
        self._topics = {key: topic for topic, key in self._keys.items()}
        self._remote: dict[str, frozenset[str]] = {}  # whole values replaced: read by another thread
        self._session = zenoh.open(bridge_config(listen))
        self.zid = str(self._session.zid())
        self._routes: dict[str, _StateRoute] = {}
        self._subscribers: list[zenoh.Subscriber[None]] = []
        self._tokens: list[zenoh.LivelinessToken] = []
        liveliness = self._session.liveliness()
        self._watch = liveliness.declare_subscriber(ALL_TOKENS, direct(self._token_changed), history=True)
        self._queryables = [
            self._session.declare_queryable(key, direct(self.queries.append), complete=True)
            for key in (CONTROL_KEY, f"@/{self.zid}/ros2/**")
        ]
        self._presence = liveliness.declare_token(presence_key(self.zid))
        self.announce()

    # ---------------------------------------------------------------------------------------------------------- life

    def announce(self) -> None:
        """Make the routes of the robot's node: tokens, publishers, subscribers."""
        if self._routes:
            return
        liveliness = self._session.liveliness()
        for topic in self._states:
            self._routes[topic] = _StateRoute(self._session, self._keys[topic])
            self._tokens.append(liveliness.declare_token(self._token(TokenKind.MP, topic, self._states[topic])))
        for topic in self._commands:
            self._subscribers.append(self._subscribe(topic))
            self._tokens.append(liveliness.declare_token(self._token(TokenKind.MS, topic, self._commands[topic])))

    def retire(self) -> None:
        """Withdraw them: the robot's node is gone, the bridge stays."""
        for token in self._tokens:
            token.undeclare()  # type: ignore[no-untyped-call]  # zenoh's stub has no annotation
        for subscriber in self._subscribers:
            subscriber.undeclare()  # type: ignore[no-untyped-call]  # the same
        for route in self._routes.values():
            route.publisher.undeclare()  # type: ignore[no-untyped-call]  # the same
        self._tokens, self._subscribers, self._routes = [], [], {}

    def companions(self) -> tuple[int, ...]:
        """Return no process: this router lives in the robot's own."""
        return ()

    def close(self) -> None:
        """End the session; safe to call twice."""
        if not self._session.is_closed():
            self._session.close()  # type: ignore[no-untyped-call]  # zenoh's stub has no annotation

    def _subscribe(self, topic: str) -> zenoh.Subscriber[None]:
        arrivals, clock = self.arrivals, self._clock

        def take(sample: zenoh.Sample) -> None:
            now_ns = clock()
            payload = sample.payload.to_bytes() if sample.kind == zenoh.SampleKind.PUT else None
            arrivals.append(Arrival(topic, now_ns, payload))

        return self._session.declare_subscriber(self._keys[topic], direct(take), allowed_origin=zenoh.Locality.REMOTE)

    def _token(self, kind: TokenKind, topic: str, type_name: str) -> str:
        return format_token(Token(zid=self.zid, kind=kind, topic=f"/{self._keys[topic]}", type_name=type_name, qos=QOS))

    def _token_changed(self, sample: zenoh.Sample) -> None:
        """Note a foreign MS or MP token: a remote route of the topic."""
        try:
            token = parse_token(str(sample.key_expr))
        except CdrError:
            return
        if token.kind not in (TokenKind.MP, TokenKind.MS) or token.zid == self.zid:
            return
        wanted = self._states if token.kind is TokenKind.MS else self._commands
        topic = self._topics.get(token.key)
        if topic is not None and topic in wanted:
            name = frozenset({f"{token.zid}:{token.key}"})
            known = self._remote.get(topic, frozenset())
            self._remote[topic] = known | name if sample.kind == zenoh.SampleKind.PUT else known - name

    # ---------------------------------------------------------------------------------------------------------- data

    def wanted(self) -> frozenset[str]:
        """Return the state topics that somebody listens to."""
        return frozenset(topic for topic, route in self._routes.items() if route.is_active)

    def publish(self, topic: str, message: IdlStruct) -> None:
        """Put a message of a state topic; like the bridge, this blocks while a subscriber does not keep up."""
        self._routes[topic].publisher.put(encode(message))

    def read(self, topic: str, payload: bytes) -> IdlStruct:
        """Return the message of a command sample.

        Raises:
            CdrError: If the bytes are no message of the topic's type.
        """
        return decode(payload, self._types[topic])

    def set_dead(self, topic: str, *, is_dead: bool) -> None:
        """Lose or regain the reader of a state topic, or of all (`*`), while everything else looks healthy."""
        for name, route in self._routes.items():
            if topic in (name, "*"):
                route.is_dead = is_dead

    # --------------------------------------------------------------------------------------------------------- admin

    def answer(self, query: zenoh.Query) -> None:
        """Answer a query of the plugin's admin space (wire reference §5.1)."""
        for key, value in self._admin().items():
            if query.key_expr.intersects(key):
                query.reply(key, json.dumps(value), encoding=zenoh.Encoding.APPLICATION_JSON)

    def _admin(self) -> dict[str, object]:
        root = f"@/{self.zid}/ros2"
        entries: dict[str, object] = {
            f"{root}/version": VERSION,
            f"{root}/config": {
                "namespace": f"/{self._namespace.strip('/')}",
                "domain": 29,
                "ros_localhost_only": False,
                "reliable_routes_blocking": True,
            },
            f"{root}/node{_NODE}": {"publishers": sorted(self._states), "subscribers": sorted(self._commands)},
        }
        for number, (topic, route) in enumerate(self._routes.items()):
            entries[f"{root}/route/topic/pub/{self._keys[topic]}"] = {
                **self._entry(topic, self._states[topic]),
                "publication_cache_size": 0,
                "dds_reader": self._guid(number) if route.is_active else "",
                "priority": 5,
            }
        for number, topic in enumerate(self._commands if self._subscribers else ()):
            entries[f"{root}/route/topic/sub/{self._keys[topic]}"] = {
                **self._entry(topic, self._commands[topic]),
                "is_active": True,
                "dds_writer": self._guid(0x100 + number),
                "transient_local": False,
            }
        return entries

    def _entry(self, topic: str, type_name: str) -> dict[str, object]:
        return {
            "ros2_name": topic,
            "ros2_type": type_name,
            "zenoh_key_expr": self._keys[topic],
            "remote_routes": sorted(self._remote.get(topic, ())),
            "local_nodes": [_NODE],
        }

    def _guid(self, number: int) -> str:
        """Return a DDS guid in the form of the plugin: 32 hexadecimal digits."""
        return f"{self.zid[:24]:0<24}{number:06x}07"
