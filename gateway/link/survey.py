"""The state of the wire, put together for people from what discovery, the watch of others and the meter know. Pure.

It asks nothing and waits for nothing: all of it was learnt by the link's own thread, carefully (`foreign_watch`). So it
can be asked for at any time, and a router in trouble is not made worse by a look at it.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence, Set
from itertools import islice

from msgspec import Struct, field
from msgspec.structs import replace

from cdr_types.keys import Token, TokenKind, topic_to_key
from cdr_types.qos import format_qos
from gateway.api.protocol import Announcement, Wire, WireBridge, WireNeighbour, WireTopic
from gateway.errors import Code
from gateway.link.discovery.discovery import BridgeFacts, Discovery
from gateway.link.discovery.robots import robots_in
from gateway.link.discovery.route_watch import silence_ns
from gateway.link.meter import Figure, Meter
from gateway.link.news import TransportNews
from gateway.link.others.foreign_watch import ForeignWatch, Neighbours, Session
from gateway.robot.topics import STATE_TOPICS, TOPICS, Direction
from gateway.settings.settings import LinkSettings

__all__ = ["KEPT", "Known", "gather", "survey"]

KEPT = 64
"""So many neighbours and bridges are told, and of each topic so many announcements: a router may be full of them."""


class Known(Struct, frozen=True, kw_only=True):
    """What is known of a wire at one moment.

    Attributes:
        settings: Endpoint, namespace, model.
        now_ns: Monotonic time [ns].
        zid: Own zenoh id; empty without a session.
        friends: Zenoh ids of other sessions of ours.
        router_zid: Empty without a transport.
        up_since_ns: When the transport opened [ns].
        tokens: Of bridges, and of whoever speaks their language.
        bridges: What bridges say of themselves, by zenoh id.
        written: Per command topic whether the robot's bridge writes it, None when that is not known.
        codes: Per state topic what is wrong with its route, if anything.
        newest_ns: Of each state topic that is subscribed to, arrival of the newest sample [ns]; None before the first.
        figures: What was measured of them.
        refused: Per topic how many samples could not be read, and what was wrong with the last.
        clock_ns: The robot's clock minus ours [ns].
        neighbours: Who else is there.
        undelivered: Frames that were not handed to zenoh.
    """

    settings: LinkSettings
    now_ns: int
    zid: str = ""
    friends: Set[str] = frozenset()
    router_zid: str = ""
    up_since_ns: int = 0
    tokens: Sequence[Token] = ()
    bridges: Mapping[str, BridgeFacts] = field(default_factory=dict)
    written: Mapping[str, bool | None] = field(default_factory=dict)
    codes: Mapping[str, Code | None] = field(default_factory=dict)
    newest_ns: Mapping[str, int | None] = field(default_factory=dict)
    figures: Mapping[str, Figure] = field(default_factory=dict)
    refused: Mapping[str, tuple[int, str]] = field(default_factory=dict)
    clock_ns: int | None = None
    neighbours: Neighbours = field(default_factory=Neighbours)
    undelivered: int = 0


def gather(
    settings: LinkSettings,
    now_ns: int,
    zid: str,
    *,
    transport: TransportNews,
    newest_ns: Mapping[str, int | None],
    meter: Meter,
    discovery: Discovery | None,
    foreign: ForeignWatch | None,
    friends: Set[str],
    undelivered: int,
) -> Wire:
    """Return the state of the wire from the parts of a link, each of which may be read by any thread.

    Without a session `zid` is empty, and `discovery` and `foreign` are None; `newest_ns` is None for a topic before
    its first sample [ns].
    """
    known = Known(
        settings=settings,
        now_ns=now_ns,
        zid=zid,
        friends=friends,
        router_zid=transport.router_zid,
        up_since_ns=transport.up_since_ns,
        newest_ns=newest_ns,
        figures=meter.figures,
        refused=dict(meter.refused),
        clock_ns=meter.clock_ns,
        undelivered=undelivered,
    )
    if discovery is None or foreign is None:
        return survey(known)
    known = replace(known, tokens=discovery.tokens.all(), bridges=discovery.bridges, written=discovery.written)
    return survey(
        replace(known, codes={topic: discovery.code(topic) for topic in newest_ns}, neighbours=foreign.neighbours)
    )


def survey(known: Known) -> Wire:
    """Return the state of the wire."""
    settings = known.settings
    robots = robots_in(known.tokens)
    keys = {topic: topic_to_key(topic, settings.namespace) for topic in TOPICS}
    names = {key: topic for topic, key in keys.items()}
    tokens: dict[tuple[TokenKind, str], list[Token]] = {}
    for token in known.tokens:
        if token.zid != known.zid:
            tokens.setdefault((token.kind, token.key), []).append(token)
    states = {token.zid for topic in STATE_TOPICS for token in tokens.get((TokenKind.MP, keys[topic]), ())}
    topics = (*STATE_TOPICS, *settings.variant.command_topics)
    return Wire(
        endpoint=settings.endpoint,
        namespace=settings.namespace.strip("/"),
        model=settings.model,
        zid=known.zid,
        is_up=bool(known.router_zid),
        up_ns=known.now_ns - known.up_since_ns if known.router_zid else 0,
        router_zid=known.router_zid,
        router_version=known.neighbours.router_version,
        clock_ns=known.clock_ns,
        robots=tuple(robots),
        bridges=tuple(islice(_bridges(known, robots, states), KEPT)),
        topics=tuple(_topic(known, topic, keys[topic], tokens, states) for topic in topics),
        neighbours=tuple(islice(_neighbours(known, names, states), KEPT)),
        undelivered=known.undelivered,
    )


# ------------------------------------------------------------------------------------------------------------- bridges


def _bridges(known: Known, robots: Mapping[str, Sequence[str]], states: Set[str]) -> Iterator[WireBridge]:
    of_robots = {zid for zids in robots.values() for zid in zids}
    there = {token.zid for token in known.tokens if token.kind is TokenKind.PRESENCE} | states | of_robots
    for zid in sorted(there, key=lambda zid: (zid not in states, zid not in of_robots, zid)):
        facts = known.bridges.get(zid, BridgeFacts())
        yield WireBridge(
            zid=zid,
            is_robot=zid in states,
            namespaces=tuple(namespace for namespace, zids in robots.items() if zid in zids),
            version=facts.version,
            domain=facts.domain,
        )


# -------------------------------------------------------------------------------------------------------------- topics


def _topic(
    known: Known, topic: str, key: str, tokens: Mapping[tuple[TokenKind, str], Sequence[Token]], states: Set[str]
) -> WireTopic:
    row = TOPICS[topic]
    is_state = row.direction is Direction.STATE
    kind = TokenKind.MP if is_state else TokenKind.MS
    announced = tuple(
        Announcement(zid=token.zid, type_name=token.type_name, qos="" if token.qos is None else format_qos(token.qos))
        for token in islice((t for t in tokens.get((kind, key), ()) if is_state or t.zid in states), KEPT)
    )
    figure = known.figures.get(topic, Figure())
    newest_ns = known.newest_ns.get(topic)
    if newest_ns is not None and newest_ns < known.up_since_ns:
        newest_ns = None  # over a transport that is gone
    refused, why = known.refused.get(topic, (0, ""))
    route = (
        _state_route(known, topic, newest_ns, bool(announced))
        if is_state
        else _command_route(known, topic, bool(announced))
    )
    if route != "active":
        figure = Figure()  # what came before it stopped says nothing about now
    return WireTopic(
        name=topic,
        key=key,
        is_state=is_state,
        type_name=row.type_name,
        nominal_hz=row.rate_hz,
        announced=announced,
        route=route,
        is_heard=topic in known.newest_ns,
        rate_hz=figure.rate_hz,
        times=figure.times,
        age_ns=None if newest_ns is None else max(0, known.now_ns - newest_ns),
        refused=refused,
        why_refused=why,
    )


def _state_route(known: Known, topic: str, newest_ns: int | None, is_announced: bool) -> str:
    if not known.router_zid:
        return "unknown"
    if newest_ns is not None and known.now_ns - newest_ns <= silence_ns(TOPICS[topic].rate_hz):
        return "active"
    if known.codes.get(topic) is Code.ROUTE_DEAD:
        return "dead"
    if not is_announced:
        return "unannounced" if newest_ns is None and known.codes.get(topic) is not Code.ROUTE_LOST else "lost"
    return "silent" if topic in known.newest_ns else "announced"


def _command_route(known: Known, topic: str, is_announced: bool) -> str:
    if not known.router_zid:
        return "unknown"
    if not is_announced:
        return "unannounced"
    is_written = known.written.get(topic)
    return "announced" if is_written is None else "active" if is_written else "inactive"


# ---------------------------------------------------------------------------------------------------------- neighbours


def _neighbours(known: Known, names: Mapping[str, str], states: Set[str]) -> Iterator[WireNeighbour]:
    """Yield everybody: this session first, then its guard, the robot, gateways, bridges, whoever is just connected."""
    seen, friends = known.neighbours, known.friends
    publishes, listens = _announcing(known, names)
    for zid, topic in seen.publishers:
        publishes.setdefault(zid, set()).add(topic)
    sent: dict[str, dict[str, int]] = {}
    last_ns: dict[str, int] = {}
    for (zid, topic), (count, at_ns) in seen.sent.items():
        sent.setdefault(zid, {})[topic] = count
        last_ns[zid] = max(at_ns, last_ns.get(zid, at_ns))
    gateways = {token.zid for token in seen.gateways}
    armed = {token.zid for token in seen.gateways if token.is_armed}
    bridges = {token.zid for token in known.tokens if token.kind is TokenKind.PRESENCE}
    everybody = {known.zid, *gateways, *bridges, *states, *seen.sessions, *publishes, *sent} - ({""} - sent.keys())
    kinds: dict[str, str] = {}
    for zid in everybody:
        kinds[zid] = (
            "self" if zid and zid == known.zid
            else "guard" if zid in friends
            else "gateway" if zid in gateways
            else "robot" if zid in states or (zid and zid == known.router_zid)
            else "bridge" if zid in bridges
            else "session"
        )  # fmt: skip
    order = ("self", "guard", "robot", "gateway", "bridge", "session")
    for zid in sorted(everybody, key=lambda zid: (order.index(kinds[zid]), zid)):
        session = seen.sessions.get(zid, Session("router" if zid and zid == known.router_zid else "", ""))
        yield WireNeighbour(
            zid=zid,
            kind=kinds[zid],
            is_armed=zid in armed,
            whatami=session.whatami,
            address=session.address,
            publishes=tuple(sorted(publishes.get(zid, ()))),
            listens=tuple(sorted(listens.get(zid, ()))),
            sent=sent.get(zid, {}),
            sent_age_ns=max(0, known.now_ns - last_ns[zid]) if zid in last_ns else None,
        )


def _announcing(known: Known, names: Mapping[str, str]) -> tuple[dict[str, set[str]], dict[str, set[str]]]:
    """Return by zenoh id the command topics that it announces to publish, and the state topics that it listens to."""
    publishes: dict[str, set[str]] = {}
    listens: dict[str, set[str]] = {}
    for token in known.tokens:
        topic = names.get(token.key)
        if topic is None:
            continue
        is_command = TOPICS[topic].direction is Direction.COMMAND
        if token.kind is TokenKind.MP and is_command:
            publishes.setdefault(token.zid, set()).add(topic)
        elif token.kind is TokenKind.MS and not is_command:
            listens.setdefault(token.zid, set()).add(topic)
    return publishes, listens
