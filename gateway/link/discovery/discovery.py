"""What the robot's bridge says about its topics: liveliness tokens and admin space (wire.md 2.5, 3.1, 4, 5).

Products: the readiness of each topic for a person, observations of routes that died or got lost for the engine, robots
that are not one robot under our namespace, and what each bridge says of itself. Rules:

* Tokens come from zenoh's threads and are only noted. Everything else runs in the link's own thread: asking the admin
  space can take a second, which neither a callback nor the loop has.
* No answer means unknown, never failure: an admin space may be closed to us.
* The robot's bridge is whoever announces publishers of our state topics; tokens of other bridges do not make a topic
  ready. Our own tokens do not count.

Knows no session: questions go out through `Ask`. Who else writes commands is not looked at here; it will have a
module of its own beside this one, fed by the same tokens.
"""

from __future__ import annotations

import json
import logging
import threading
from collections.abc import Callable, Iterable, Mapping, Set

from msgspec import Struct

from cdr_types import BadName
from cdr_types.keys import Token, TokenKind, parse_token, topic_to_key
from gateway.api.keys import printable
from gateway.core.messages.events import RobotsAnnounced, RouteObserved
from gateway.errors import Code
from gateway.link.discovery.command_watch import CommandWatch
from gateway.link.discovery.robots import robots_in
from gateway.link.discovery.route_watch import FIRST_DATA_NS, Evidence, RouteWatch
from gateway.robot.topics import FSM_ENABLE, STATE_TOPICS, TOPICS
from gateway.settings.settings import LinkSettings

__all__ = ["Ask", "BridgeFacts", "Discovery", "Finding", "Sight", "TokenTable", "json_object"]

S = 1_000_000_000

READINESS_PERIOD_NS = 5 * S
"""Readiness is looked up this often, and soon after any token came or went."""
MIN_READINESS_PERIOD_NS = S // 2
READY = "ready"

_log = logging.getLogger(__name__)

Ask = Callable[[str], Mapping[str, bytes]]
"""Ask the admin space: a selector in, payloads by key out; empty when nobody answered."""


class Sight(Struct, frozen=True, kw_only=True):
    """What the link sees at one moment.

    Attributes:
        now_ns: Monotonic time [ns].
        up_since_ns: When the transport opened [ns].
        newest_ns: Per state topic the arrival of its newest sample [ns]; None before the first.
    """

    now_ns: int
    up_since_ns: int
    newest_ns: Mapping[str, int | None]


class Finding(Struct, frozen=True, kw_only=True):
    """What came of a step.

    Attributes:
        observations: For the engine.
        revive: State topics whose subscription is to be declared again now.
    """

    observations: tuple[RouteObserved | RobotsAnnounced, ...] = ()
    revive: tuple[str, ...] = ()


class BridgeFacts(Struct, frozen=True, kw_only=True):
    """What a bridge says of itself.

    Attributes:
        version: Empty when it does not say.
        domain: DDS domain behind it; None when it does not say.
    """

    version: str = ""
    domain: int | None = None


class TokenTable:
    """The tokens that are there now. Any thread may write or read; one lock, held for a dictionary operation."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._tokens: dict[str, Token] = {}
        self.revision = 0
        """Rises with every token that comes or goes."""

    def receive(self, keyexpr: str, is_alive: bool) -> None:
        """Note that a token came or went; what is not of the bridge's grammar is ignored."""
        try:
            token = parse_token(keyexpr)
        except BadName as error:
            _log.debug("token %r ignored: %s", keyexpr, error)
            return
        with self._lock:
            self.revision += 1
            if is_alive:
                self._tokens[keyexpr] = token
            else:
                self._tokens.pop(keyexpr, None)

    def all(self) -> tuple[Token, ...]:
        """Return the tokens that are there."""
        with self._lock:
            return tuple(self._tokens.values())


class Discovery:
    """Follows the robot's bridge.

    `friends` are zenoh ids of other sessions of ours, and may grow; topics that are not heard may be silent as they
    like.

    Attributes:
        tokens: Fed by the link's liveliness subscriber.
        version: The bridge's version as it says; empty until it was read.
        bridges: What each bridge has said of itself, by zenoh id; replaced as a whole, for any thread.
        written: Per command topic whether the robot's bridge writes it, None when that cannot be read; the same.
    """

    def __init__(
        self,
        settings: LinkSettings,
        own_zid: str,
        ask: Ask,
        friends: Set[str] = frozenset(),
        topics: Iterable[str] = STATE_TOPICS,
    ) -> None:
        self.tokens = TokenTable()
        self.version = ""
        self.bridges: Mapping[str, BridgeFacts] = {}
        self.written: Mapping[str, bool | None] = {}
        self._namespace = settings.namespace.strip("/")
        self._robots: Mapping[str, tuple[str, ...]] = {}
        self._robots_revision = -1
        self._told_robots: tuple[tuple[str, ...], tuple[str, ...]] = ((), ())
        self._own_zid = own_zid
        self._friends = friends
        self._ask = ask
        self._api = topic_to_key("/api", settings.namespace)
        self._keys = {topic: topic_to_key(topic, settings.namespace) for topic in TOPICS}
        self._commands = settings.variant.command_topics
        self._watches = {topic: RouteWatch(TOPICS[topic]) for topic in topics}
        self._command_watch = CommandWatch()
        self._readiness = dict.fromkeys((*self._watches, *self._commands), "unknown: not connected yet")
        self._revision = -1
        self._looked_ns = 0
        self._asked_bridges: frozenset[str] = frozenset()
        self._heartbeat_words = READY

    def readiness(self) -> dict[str, str]:
        """Return, per topic of this model, a few words that a person understands. Any thread."""
        return dict(self._readiness)

    def code(self, topic: str) -> Code | None:
        """Return what is known to be wrong with a state topic's route: ROUTE_DEAD, ROUTE_LOST, else None. Any thread."""
        return self._watches[topic].code if topic in self._watches else None

    def lose(self) -> None:
        """Forget readiness: there is no transport any more."""
        self._readiness = dict.fromkeys(self._readiness, "unknown: no transport to the robot")
        self._revision = -1
        self._command_watch.forget()
        self.bridges, self.written, self._told_robots = {}, {}, ((), ())
        self._asked_bridges = frozenset()

    def step(self, sight: Sight) -> Finding:
        """Look once; may take seconds while the admin space does not answer. The link's own thread only."""
        announced = self._announced(TokenKind.MP)
        observations: list[RouteObserved | RobotsAnnounced] = [*self._look_for_robots(sight)]
        silent: list[str] = []
        for topic, watch in self._watches.items():
            newest_ns = sight.newest_ns[topic]
            is_announced = topic in announced
            change = watch.observe(sight.now_ns, sight.up_since_ns, newest_ns, is_announced=is_announced)
            if change is not None:
                observations.append(change)
            if is_announced and watch.is_silent(sight.now_ns, sight.up_since_ns, newest_ns):
                silent.append(topic)
        revive = self._look_into(silent, announced, sight.now_ns, observations)
        listening = {topic: zids for topic, zids in self._announced(TokenKind.MS).items() if topic in self._commands}
        change = self._command_watch.observe(sight.now_ns, listening, self._robot_zids(announced))
        if change is not None:
            observations.append(change)
        self._refresh_readiness(sight, announced, silent)
        words = self._readiness[FSM_ENABLE]  # for the engine to say when 1.0 does nothing
        if words != self._heartbeat_words and not (words.startswith(READY) and self._heartbeat_words == READY):
            self._heartbeat_words = words
            observations.append(RouteObserved(topic=FSM_ENABLE, code=None, message=words, at_ns=sight.now_ns))
        for observation in observations:
            if isinstance(observation, RobotsAnnounced):
                continue  # the engine tells
            _log.log(
                logging.INFO if observation.code is None else logging.WARNING,
                "%s%s",
                "" if observation.code is None else f"{observation.code}: ",
                observation.message,
            )
        return Finding(observations=tuple(observations), revive=revive)

    # ---------------------------------------------------------------------------------------------------- tokens

    def _announced(self, kind: TokenKind) -> dict[str, set[str]]:
        """Return who announces which of our topics: topic -> zenoh ids."""
        topics = {f"/{key}": topic for topic, key in self._keys.items()}
        found: dict[str, set[str]] = {}
        for token in self.tokens.all():
            topic = topics.get(token.topic)
            if token.kind is kind and topic is not None and token.zid != self._own_zid:
                found.setdefault(topic, set()).add(token.zid)
        return found

    def _robot_zids(self, announced: Mapping[str, set[str]]) -> set[str]:
        return set().union(*(zids for topic, zids in announced.items() if topic in self._watches))

    def _look_for_robots(self, sight: Sight) -> Iterable[RobotsAnnounced]:
        """Tell of robots under other namespaces when nothing came from ours, of several under ours, and when that is over."""
        revision = self.tokens.revision
        if revision != self._robots_revision:
            self._robots_revision, self._robots = revision, robots_in(self.tokens.all())
        is_heard = any(
            newest_ns is not None and newest_ns >= sight.up_since_ns for newest_ns in sight.newest_ns.values()
        )
        is_early = sight.now_ns - sight.up_since_ns < FIRST_DATA_NS
        here = self._robots.get(self._namespace, ())
        elsewhere = () if here or is_heard or is_early else tuple(self._robots)
        twins = here if len(here) > 1 else ()
        if (elsewhere, twins) != self._told_robots:
            self._told_robots = elsewhere, twins
            yield RobotsAnnounced(elsewhere=elsewhere, twins=twins, at_ns=sight.now_ns)

    # ---------------------------------------------------------------------------------------------------- routes

    def _look_into(
        self,
        silent: Iterable[str],
        announced: Mapping[str, set[str]],
        now_ns: int,
        observations: list[RouteObserved | RobotsAnnounced],
    ) -> tuple[str, ...]:
        """Look silent, announced topics up in the admin space; return those to be revived."""
        topics = [topic for topic in silent if self._watches[topic].wants_evidence(now_ns)]
        if not topics:
            return ()
        routes = self._routes("pub", "**")
        revive: list[str] = []
        for topic in topics:
            zids = announced[topic]
            fields = next((f for zid, key, f in routes if key == self._keys[topic] and zid in zids), None)
            change, is_due = self._watches[topic].judge(now_ns, self._evidence(fields, zids))
            if change is not None:
                observations.append(change)
            if is_due:
                revive.append(topic)
        return tuple(revive)

    def _evidence(self, fields: Mapping[str, object] | None, robot_zids: set[str]) -> Evidence:
        reader = None if fields is None else fields.get("dds_reader")
        if fields is None or not isinstance(reader, str):
            return Evidence(has_reader=None)
        if reader:
            return Evidence(has_reader=True)
        return Evidence(has_reader=False, others=self._others(fields, robot_zids))

    def _others(self, route: Mapping[str, object], robot_zids: set[str]) -> tuple[str, ...]:
        """Return who else may subscribe: bridges that the route names, sessions at the routers, with their addresses.

        Routers are not asked who subscribes: an answer to that can hang them (`foreign_watch`).
        """
        zids = {entry.partition(":")[0] for entry in _strings(route.get("remote_routes"))}
        addresses: dict[str, str] = {}
        for place, payload in self._ask("@/*/router").items():
            for peer in _objects(json_object(payload).get("sessions")):
                zid = str(peer.get("peer"))
                for link in _objects(peer.get("links")):
                    addresses[zid] = str(link.get("dst"))
                zids.add(zid)
            zids.discard(_zid_of(place))
        zids -= {self._own_zid, *self._friends, *robot_zids}
        return tuple(f"{zid} at {addresses[zid]}" if zid in addresses else zid for zid in sorted(zids))

    def _routes(self, direction: str, keys: str) -> list[tuple[str, str, Mapping[str, object]]]:
        """Return zenoh id, key and fields of each topic route that is told about; `direction` is pub or sub."""
        wanted = set(self._keys.values())
        routes = []
        for place, payload in self._ask(f"@/*/ros2/route/topic/{direction}/{keys}").items():
            key = place.partition(f"/ros2/route/topic/{direction}/")[2]
            if key in wanted:
                routes.append((_zid_of(place), key, json_object(payload)))
        return routes

    # ------------------------------------------------------------------------------------------------- readiness

    def _refresh_readiness(self, sight: Sight, announced: Mapping[str, set[str]], silent: Iterable[str]) -> None:
        age_ns = sight.now_ns - self._looked_ns
        revision = self.tokens.revision
        if age_ns < (READINESS_PERIOD_NS if revision == self._revision else MIN_READINESS_PERIOD_NS):
            return
        self._looked_ns, self._revision = sight.now_ns, revision
        robot_zids = self._robot_zids(announced)
        self._read_bridges(robot_zids)
        self._readiness = {
            **{topic: self._state_words(topic, topic in announced, topic in silent) for topic in self._watches},
            **self._command_words(robot_zids),
        }

    def _state_words(self, topic: str, is_announced: bool, is_silent: bool) -> str:
        code = self._watches[topic].code
        if code is Code.ROUTE_DEAD:
            return "route dead: the robot's bridge does not read it"
        if not is_announced:
            return "not announced: the robot's node is away, or its part is switched off"
        return "announced, silent" if is_silent else "ready"

    def _command_words(self, robot_zids: set[str]) -> dict[str, str]:
        listening = self._announced(TokenKind.MS)
        routes = self._routes("sub", f"{self._api}/**")
        active = {key: fields.get("is_active") for zid, key, fields in routes if zid in robot_zids}
        known = {topic: active.get(self._keys[topic]) for topic in self._commands}
        self.written = {topic: is_active if isinstance(is_active, bool) else None for topic, is_active in known.items()}
        words = {}
        for topic in self._commands:
            if not listening.get(topic, set()) & robot_zids:
                words[topic] = "not announced: nobody on the robot listens to it"
            elif self.written[topic] is False:
                words[topic] = "inactive: the robot's bridge does not write it; restart the robot's bridge"
            elif self.written[topic] is True:
                words[topic] = READY
            else:
                words[topic] = "ready, as far as the tokens tell (admin space not readable)"
        return words

    def _read_bridges(self, robot_zids: set[str]) -> None:
        """Read what bridges say of themselves: when one came, and as long as the robot's has not said anything."""
        bridges = frozenset(t.zid for t in self.tokens.all() if t.kind is TokenKind.PRESENCE) | robot_zids
        is_read = not robot_zids or any(self.bridges[zid].version for zid in robot_zids & self.bridges.keys())
        if is_read and bridges <= self._asked_bridges:
            return
        self._asked_bridges = bridges
        versions = {_zid_of(place): payload for place, payload in self._ask("@/*/ros2/version").items()}
        configs = {_zid_of(place): payload for place, payload in self._ask("@/*/ros2/config").items()}
        facts = {}
        for zid in bridges:
            domain = json_object(configs.get(zid, b"")).get("domain")
            version = printable(versions.get(zid, b"").decode(errors="replace").strip().strip('"'))
            facts[zid] = BridgeFacts(version=version, domain=domain if isinstance(domain, int) else None)
        self.bridges = facts
        version = next((facts[zid].version for zid in sorted(robot_zids) if facts[zid].version), "")
        if version and version != self.version:
            self.version = version
            _log.info("the robot's bridge %s is version %s", ", ".join(sorted(robot_zids)), version)


def _zid_of(place: str) -> str:
    """Return the zenoh id in `@/<zid>/...`."""
    return place.removeprefix("@/").partition("/")[0]


def json_object(payload: bytes) -> Mapping[str, object]:
    """Return the JSON object of an admin entry, its texts as they can be shown; empty when it is none."""
    try:
        fields = _shown(json.loads(payload))
    except (ValueError, RecursionError):
        return {}
    return fields if isinstance(fields, dict) else {}


def _shown(value: object) -> object:
    if isinstance(value, dict):
        return {name: _shown(item) for name, item in value.items()}
    if isinstance(value, list):
        return [_shown(item) for item in value]
    return printable(value) if isinstance(value, str) else value


def _objects(value: object) -> list[Mapping[str, object]]:
    return [item for item in value if isinstance(item, dict)] if isinstance(value, list) else []


def _strings(value: object) -> list[str]:
    return [item for item in value if isinstance(item, str)] if isinstance(value, list) else []
