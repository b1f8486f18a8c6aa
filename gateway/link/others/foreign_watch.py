"""Who else commands the robot, as far as it can be seen from a client session (wire.md 4.3).

```
data        a subscription to the command keys, of remote origin: certain, after the fact, within milliseconds. Whoever puts
            to `api/*/joint_cmd` commands both arms at once
tokens      a ROS publisher behind some bridge, before its first sample (MP tokens)
admin       declared zenoh publishers, as the router lists them: an ad-hoc `put` shows as data only
gateways    their own tokens
```

A host's bridge declares zenoh publishers for all commands that the robot takes, as soon as it is connected and whether or not
a ROS node behind it writes any (measured, 1.10.2): of a bridge only its tokens count, and what it sends.

**An answer to the question who publishes can hang the router for ever** (zenoh 1.10.2 and before, upstream pull request
2619): it answers while it reads its tables, which means to read them again, and a declaration that arrives in between, of
anybody's, waits for the first reader as the second one waits for it. Measured on loopback: a few questions with seven
answers each, beside a client that declares without pause, hung the router within seconds; 50,000 questions without
an answer, or for the list of sessions, did not. Therefore:

* Nobody of us is an answer: our sessions declare no publishers on command keys (`robot_session`), and the pattern asked
  for leaves `/api/current_mode` out, which the robot's bridge publishes. As long as nobody else declares one, the
  question has no answer, and may be asked.
* It is asked only when the router's list of sessions, which is harmless, is the same as at the look before: whoever connects
  declares first of all.
* It is not asked while a host's bridge is there, which would be such an answer; its token tells. Plain zenoh publishers beside
  one are known by what they send. A robot that hangs for ever is worse than a refusal that comes with the first sample.
* Whoever was named is not asked about again before that list changes, or half a minute is over.

Measured against a router of zenoh 1.10.2: our own puts do not come back to a subscription of remote origin on the same
session (0 of 100), so what arrives is somebody else's. It arrives 0.5 ms after the put. Its timestamp carries the zenoh id
of the sender when the sender stamps (this gateway and ROS bridges do), else that of the router: then nobody is named.

zenoh's threads only note tokens. The admin space is asked by the link's own thread. The loop takes samples and polls: a few
comparisons while nothing changes. Whose zenoh id is a friend's is not known here but in the core.
"""

from __future__ import annotations

import threading
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Set

import zenoh
from msgspec import Struct, field

from cdr_types.keys import Token, TokenKind, topic_to_key
from gateway.core.messages.events import Event
from gateway.core.messages.sightings import ForeignData, ForeignTokens, Gateway, GatewayTokens, Means, Writer
from gateway.link.discovery.discovery import Ask, TokenTable, json_object
from gateway.link.others.gateway_token import GatewayToken, parse_gateway_token
from gateway.robot.topics import STATE_TOPICS
from gateway.settings.settings import LinkSettings

__all__ = ["AGAIN_NS", "LOOK_PERIOD_NS", "ForeignWatch", "Neighbours", "Session", "publishers_of"]

S = 1_000_000_000

LOOK_PERIOD_NS = S // 2
"""The router is asked this often [ns] who is connected and, while nobody is named, who publishes: seen within 2 s."""
AGAIN_NS = 30 * S
"""Who was named as a publisher is asked about again after this long [ns], for what changed without a session's end."""
WRITERS_KEPT = 256
"""So many announcements are handed on; a router full of them is refused as one with a few is."""
OTHERS_KEPT = 64
"""So many gateways are handed on."""

SENDERS_KEPT = 64
"""So many senders and topics are counted apart, the first ones."""

ROBOT = "the robot's own bridge"


class Session(Struct, frozen=True):
    """A session that the router has.

    Attributes:
        whatami: `client`, `peer` or `router`.
        address: Its end of the link; empty when the router does not say.
    """

    whatami: str
    address: str


class Neighbours(Struct, frozen=True, kw_only=True):
    """Who was seen, for people.

    Attributes:
        router_version: Of zenoh at the robot's router; empty when it does not say.
        sessions: That the router has, by zenoh id; ours is among them.
        gateways: Tokens of other gateways.
        publishers: Zenoh ids and topics of declared publishers.
        sent: Per zenoh id and command topic, how many samples others sent, and when the last came [ns]; no id where nobody
            was named.
    """

    router_version: str = ""
    sessions: Mapping[str, Session] = field(default_factory=dict)
    gateways: Set[GatewayToken] = frozenset()
    publishers: Set[tuple[str, str]] = frozenset()
    sent: Mapping[tuple[str, str], tuple[int, int]] = field(default_factory=dict)


class ForeignWatch:
    """Collects what is seen of others on one session."""

    def __init__(self, settings: LinkSettings, tokens: TokenTable, own_zid: str, clock: Callable[[], int]) -> None:
        self._namespace = settings.namespace
        self._tokens = tokens
        self._own_zid = own_zid
        self._clock = clock
        self._published = publishers_of(settings.namespace)
        self._commands = {topic_to_key(topic, settings.namespace): topic for topic in settings.variant.command_topics}
        self._states = {topic_to_key(topic, settings.namespace) for topic in STATE_TOPICS}
        self._samples: list[tuple[str, str]] = []
        self._lock = threading.Lock()
        self._gateways: frozenset[GatewayToken] = frozenset()
        # Whole values replaced, never changed: written by the link's thread, read by the loop's.
        self._publishers: frozenset[tuple[str, str]] = frozenset()
        self._addresses: Mapping[str, str] = {}
        self._sessions: Mapping[str, Session] = {}
        self._router_version = ""
        self._sent: dict[tuple[str, str], tuple[int, int]] = {}
        self._looked_ns = self._asked_ns = -AGAIN_NS
        self._asked_of: Set[str] = frozenset()
        self._seen: tuple[object, ...] = ()
        self._writers: tuple[Writer, ...] = ()
        self._others: tuple[Gateway, ...] = ()

    # ---------------------------------------------------------------------------------------------- zenoh's threads

    def note_gateway(self, key: str, is_there: bool) -> None:
        """Note that the token of a gateway came or went; ours is left out."""
        token = parse_gateway_token(key, self._namespace)
        if token is None or token.zid == self._own_zid:
            return
        with self._lock:
            self._gateways = self._gateways | {token} if is_there else self._gateways - {token}

    # ---------------------------------------------------------------------------------------------- the link's thread

    def lose(self) -> None:
        """The transport is gone: what the router said is not known any more. Tokens go by themselves."""
        self._publishers, self._addresses = frozenset(), {}
        self._sessions, self._router_version = {}, ""
        self._looked_ns = self._asked_ns = -AGAIN_NS

    def ask(self, now_ns: int, router_zid: str, ask: Ask) -> None:
        """Ask the router who is connected and, when that is harmless, who publishes. May take a second.

        No answer of the admin space means that nothing is known.
        """
        if now_ns - self._looked_ns < LOOK_PERIOD_NS:
            return
        self._looked_ns = now_ns
        place = f"@/{router_zid}/router"
        before = self._addresses.keys()
        fields = json_object(ask(place).get(place, b""))
        self._sessions, self._router_version = _sessions(fields), str(fields.get("version") or "")
        self._addresses = {zid: session.address for zid, session in self._sessions.items() if session.address}
        there = self._addresses.keys()
        gone = before - there
        if gone:
            self._publishers = frozenset((zid, topic) for zid, topic in self._publishers if zid not in gone)
        if there != before or self._has_host(router_zid):
            return  # somebody has just come or gone, and may be declaring; or a bridge would be named
        if self._publishers and there == self._asked_of and now_ns - self._asked_ns < AGAIN_NS:
            return
        self._asked_ns, self._asked_of = now_ns, frozenset(there)
        start = f"{place}/publisher/"
        found: set[tuple[str, str]] = set()
        for answer, payload in ask(f"{place}/{self._published}").items():
            zids = [zid for zid in _zids(payload) if zid != self._own_zid]
            found.update((zid, topic) for topic in self._commanded(answer.removeprefix(start)) for zid in zids)
        self._publishers = frozenset(found)

    # ---------------------------------------------------------------------------------------------- any thread

    @property
    def neighbours(self) -> Neighbours:
        """Everybody who was seen."""
        return Neighbours(
            router_version=self._router_version,
            sessions=self._sessions,
            gateways=self._gateways,
            publishers=self._plain_publishers(self._tokens.all()),
            sent=dict(self._sent),
        )

    # ---------------------------------------------------------------------------------------------- the loop's thread

    def take(self, key: str, sender_zid: str) -> None:
        """Note a sample of remote origin; those on no command key are the robot's own.

        Args:
            key: Data key.
            sender_zid: Zenoh id in its timestamp; empty when it has none.
        """
        self._samples.extend((topic, sender_zid) for topic in self._commanded(key))

    def poll(self, router_zid: str, *, is_new_link: bool) -> list[Event]:
        """Return what has been seen since the last call.

        Args:
            router_zid: Zenoh id of the robot's router: its stamp names nobody.
            is_new_link: A transport opened since: all who are there are told again.
        """
        events: list[Event] = self._data(router_zid) if self._samples else []
        seen = self._tokens.revision, self._gateways, self._publishers, self._addresses
        if seen == self._seen and not is_new_link:
            return events
        self._seen = seen
        now_ns = self._clock()
        writers, gateways = self._who_writes(), self._who_commands()
        if writers != self._writers or is_new_link:
            self._writers = writers
            events.append(ForeignTokens(writers=writers, at_ns=now_ns))
        if gateways != self._others or is_new_link:
            self._others = gateways
            events.append(GatewayTokens(gateways=gateways, at_ns=now_ns))
        return events

    def _commanded(self, key: str) -> Iterable[str]:
        """Return the command topics that a sample or a publisher of a key reaches: of a key with wildcards all it matches."""
        topic = self._commands.get(key)
        if topic is not None:
            return (topic,)
        meant = zenoh.KeyExpr(key) if "*" in key else None
        return [
            topic for key, topic in self._commands.items() if meant is not None and meant.intersects(zenoh.KeyExpr(key))
        ]

    def _data(self, router_zid: str) -> list[Event]:
        now_ns = self._clock()
        found = Counter((topic, "" if zid == router_zid else zid) for topic, zid in self._samples)
        self._samples.clear()
        for (topic, zid), count in found.items():
            if (zid, topic) in self._sent or len(self._sent) < SENDERS_KEPT:
                self._sent[zid, topic] = self._sent.get((zid, topic), (0, 0))[0] + count, now_ns
        return [
            ForeignData(topic=topic, zid=zid, at_ns=now_ns, count=count, link=self._addresses.get(zid, ""))
            for (topic, zid), count in found.items()
        ]

    def _plain_publishers(self, tokens: Iterable[Token]) -> frozenset[tuple[str, str]]:
        """Return who declared a publisher and is no bridge."""
        bridges = {token.zid for token in tokens if token.kind is TokenKind.PRESENCE}
        return frozenset((zid, topic) for zid, topic in self._publishers if zid not in bridges)

    def _has_host(self, router_zid: str) -> bool:
        """Whether a bridge is there that is not the robot's."""
        tokens = self._tokens.all()
        bridges = {token.zid for token in tokens if token.kind is TokenKind.PRESENCE}
        return not bridges <= self._robots(tokens) | {router_zid}

    def _robots(self, tokens: Iterable[Token]) -> set[str]:
        """Return the bridges that announce state of the robot."""
        return {token.zid for token in tokens if token.kind is TokenKind.MP and token.key in self._states}

    def _who_writes(self) -> tuple[Writer, ...]:
        everything = self._tokens.all()
        tokens = [token for token in everything if token.kind is TokenKind.MP]
        robots = self._robots(tokens)
        announced = {(token.zid, self._commands[token.key]) for token in tokens if token.key in self._commands}
        found = [
            *((topic, zid, Means.TOKEN) for zid, topic in announced if zid != self._own_zid),
            *((topic, zid, Means.PUBLISHER) for zid, topic in self._plain_publishers(everything)),
        ]
        return tuple(
            Writer(topic=topic, zid=zid, means=means, link=ROBOT if zid in robots else self._addresses.get(zid, ""))
            for topic, zid, means in sorted(found)[:WRITERS_KEPT]
        )

    def _who_commands(self) -> tuple[Gateway, ...]:
        tokens = self._gateways
        return tuple(
            Gateway(zid=zid, is_armed=GatewayToken(zid, True) in tokens, link=self._addresses.get(zid, ""))
            # Armed ones first: of a router full of names the ones that matter are not left out.
            for zid in sorted({t.zid for t in tokens}, key=lambda z: (GatewayToken(z, True) not in tokens, z))[
                :OTHERS_KEPT
            ]
        )


def publishers_of(namespace: str) -> str:
    """Return where, below a router, it lists publishers of command keys, and of no state topic."""
    return f"publisher/{topic_to_key('/api', namespace)}/*/*"


def _zids(payload: bytes) -> list[str]:
    """Return the zenoh ids in the sources of an admin entry."""
    fields = json_object(payload)
    lists = [fields.get(role) for role in ("routers", "peers", "clients")]
    return [zid for values in lists if isinstance(values, list) for zid in values if isinstance(zid, str)]


def _sessions(fields: Mapping[str, object]) -> dict[str, Session]:
    """Return the sessions that a router has, from its admin entry."""
    sessions = fields.get("sessions")
    found: dict[str, Session] = {}
    for session in sessions if isinstance(sessions, list) else []:
        if not isinstance(session, dict):
            continue
        links = session.get("links")
        ends = [str(link.get("dst")) for link in links if isinstance(link, dict)] if isinstance(links, list) else []
        found[str(session.get("peer"))] = Session(str(session.get("whatami") or ""), ends[-1] if ends else "")
    return found
