"""Rules of `gateway.link.survey`: what is known of a wire becomes routes, bridges and neighbours. Everything is given here."""

from __future__ import annotations

import pytest

from cdr_types.keys import Qos, Reliability, Token, TokenKind, topic_to_key
from gateway.errors import Code
from gateway.link.discovery.discovery import BridgeFacts
from gateway.link.meter import Figure
from gateway.link.others.foreign_watch import Neighbours, Session
from gateway.link.others.gateway_token import GatewayToken
from gateway.link.survey import KEPT, Known, survey
from gateway.robot.topics import (
    COMMAND_TOPICS,
    CURRENT_MODE,
    FSM_ENABLE,
    JOINT_STATE,
    STATE_TOPICS,
    TOPICS,
    VARIANTS,
    arm_state,
    joint_command,
)
from gateway.settings.settings import LinkSettings
from gateway.values import Side
from tests.changed import replace

MS = 1_000_000
S = 1_000_000_000
OWN, BRIDGE, HOST, OTHER = "0e11", "b1d6e", "4057", "6a7e"
ARM, MODE = arm_state(Side.LEFT), CURRENT_MODE
COMMAND = joint_command(Side.LEFT)
NOW_NS = 100 * S


def token(topic: str, kind: TokenKind, zid: str = BRIDGE, namespace: str = "", type_name: str = "") -> Token:
    """Return a token of a topic."""
    name = f"/{topic_to_key(topic, namespace)}"
    qos = Qos(reliability=Reliability.RELIABLE)
    return Token(zid=zid, kind=kind, topic=name, type_name=type_name or TOPICS[topic].type_name, qos=qos)


def announced(namespace: str = "") -> tuple[Token, ...]:
    """Return the tokens of a healthy robot."""
    return (
        Token(zid=BRIDGE, kind=TokenKind.PRESENCE),
        *(token(topic, TokenKind.MP, namespace=namespace) for topic in STATE_TOPICS),
        *(token(topic, TokenKind.MS, namespace=namespace) for topic in COMMAND_TOPICS),
    )


def known(**changes) -> Known:
    """Return what is known of a healthy wire, changed as asked."""
    healthy = Known(
        settings=LinkSettings(),
        now_ns=NOW_NS,
        zid=OWN,
        router_zid=BRIDGE,
        up_since_ns=10 * S,
        tokens=announced(),
        bridges={BRIDGE: BridgeFacts(version="v1.10.2", domain=29)},
        written=dict.fromkeys(COMMAND_TOPICS, True),
        codes=dict.fromkeys(STATE_TOPICS),
        newest_ns=dict.fromkeys(STATE_TOPICS, NOW_NS - 3 * MS),
        figures={topic: Figure(rate_hz=TOPICS[topic].rate_hz) for topic in STATE_TOPICS},
        neighbours=Neighbours(router_version="v1.10.2-abc", sessions={OWN: Session("client", "tcp/1.2.3.4:5")}),
    )
    return replace(healthy, **changes)


def row(topic: str, **changes):
    """Return one topic of the survey."""
    return next(row for row in survey(known(**changes)).topics if row.name == topic)


def without(*topics: str) -> tuple[Token, ...]:
    """Return the tokens of a robot that does not announce these."""
    return tuple(t for t in announced() if f"/{t.key}" not in topics)


# -------------------------------------------------------------------------------------------------------------- topics


def test_a_healthy_wire_is_all_active():
    """Every topic of the model, states first, with type, key, QoS as in the token, rate and age."""
    wire = survey(known())
    assert [t.name for t in wire.topics] == [*STATE_TOPICS, *VARIANTS["standard"].command_topics]
    assert {t.route for t in wire.topics} == {"active"} and wire.is_up and wire.up_ns == 90 * S
    arm = wire.topics[0]
    assert (arm.key, arm.is_state, arm.rate_hz, arm.age_ns, arm.times) == (ARM[1:], True, 200.0, 3 * MS, 1.0)
    assert [(a.zid, a.qos) for a in arm.announced] == [(BRIDGE, ":1::")]
    assert (wire.router_version, wire.robots, wire.namespace) == ("v1.10.2-abc", ("",), "")


@pytest.mark.parametrize(
    ("changes", "route"),
    [
        ({"newest_ns": {ARM: NOW_NS - 499 * MS}}, "active"),
        ({"newest_ns": {ARM: NOW_NS - 501 * MS}}, "silent"),
        ({"newest_ns": {ARM: None}}, "silent"),
        ({"newest_ns": {ARM: 9 * S}, "tokens": without(ARM)}, "unannounced"),
        ({"newest_ns": {ARM: NOW_NS - S}, "codes": {ARM: Code.ROUTE_DEAD}}, "dead"),
        ({"newest_ns": {ARM: NOW_NS - S}, "tokens": without(ARM), "codes": {ARM: Code.ROUTE_LOST}}, "lost"),
        ({"newest_ns": {ARM: None}, "tokens": without(ARM)}, "unannounced"),
        ({"newest_ns": {ARM: None}, "tokens": without(ARM), "codes": {ARM: Code.ROUTE_LOST}}, "lost"),
        ({"newest_ns": {}}, "announced"),
        ({"newest_ns": {ARM: NOW_NS}, "tokens": without(ARM)}, "active"),
        ({"router_zid": ""}, "unknown"),
    ],
)
def test_what_comes_is_active_and_what_does_not_has_a_reason(changes, route):
    """Samples are the proof; without them the admin space, the tokens, and what was heard before decide."""
    assert row(ARM, **changes).route == route


def test_a_slow_topic_may_be_silent_for_three_of_its_periods():
    """`/api/current_mode` comes once a second (manual §4.11.2)."""
    assert row(MODE, newest_ns={MODE: NOW_NS - 2900 * MS}).route == "active"
    assert row(MODE, newest_ns={MODE: NOW_NS - 3100 * MS}).route == "silent"


@pytest.mark.parametrize(
    ("changes", "route"),
    [
        ({"written": {COMMAND: False}}, "inactive"),
        ({"written": {COMMAND: None}}, "announced"),
        ({"written": {}}, "announced"),
        ({"tokens": without(COMMAND)}, "unannounced"),
        ({"tokens": (*without(COMMAND), token(COMMAND, TokenKind.MS, HOST))}, "unannounced"),
        ({"router_zid": ""}, "unknown"),
    ],
)
def test_a_command_reaches_the_robot_when_its_bridge_says_so(changes, route):
    """Somebody else who listens is not the robot; a closed admin space leaves the tokens."""
    assert row(COMMAND, **changes).route == route


def test_a_topic_that_does_not_come_has_no_rate():
    """What came before it stopped says nothing about now; its age is still told."""
    silent = row(ARM, newest_ns={ARM: NOW_NS - 2 * S})
    assert (silent.route, silent.rate_hz, silent.times, silent.age_ns) == ("silent", 0.0, 1.0, 2 * S)


def test_ages_of_an_earlier_transport_count_for_nothing():
    """What was heard before the link was lost is no proof of anything."""
    assert row(ARM, newest_ns={ARM: 9 * S}).age_ns is None
    assert row(ARM, newest_ns={ARM: NOW_NS + 5}).age_ns == 0  # it came while the survey was made


def test_refused_samples_and_copies_are_told_per_topic():
    """With the reason of the last."""
    changes = {"refused": {ARM: (3, "too short")}, "figures": {ARM: Figure(rate_hz=200.0, times=3.0)}}
    arm = row(ARM, **changes)
    assert (arm.refused, arm.why_refused, arm.times) == (3, "too short", 3.0)
    assert (row(MODE, **changes).refused, row(MODE, **changes).rate_hz) == (0, 0.0)


def test_all_announcements_of_a_topic_are_kept_but_our_own():
    """Two bridges, another type: whoever looks must see it."""
    more = (token(ARM, TokenKind.MP, HOST, type_name="a/msg/B"), token(ARM, TokenKind.MP, OWN))
    assert [(a.zid, a.type_name) for a in row(ARM, tokens=(*announced(), *more)).announced] == [
        (BRIDGE, JOINT_STATE),
        (HOST, "a/msg/B"),
    ]


def test_a_namespace_is_before_the_keys_and_not_before_the_names():
    """Robots under other namespaces are listed, and not ours."""
    settings = LinkSettings(namespace="/bot1")
    wire = survey(known(settings=settings, tokens=(*announced("bot1"), *announced("bot2"))))
    assert (wire.namespace, wire.robots) == ("bot1", ("bot1", "bot2"))
    assert wire.topics[0].key == f"bot1{ARM}" and {t.route for t in wire.topics} == {"active"}
    assert [(b.namespaces, b.is_robot) for b in wire.bridges] == [(("bot1", "bot2"), True)]
    elsewhere = survey(known(tokens=announced("bot2"), newest_ns=dict.fromkeys(STATE_TOPICS)))
    assert elsewhere.robots == ("bot2",) and not elsewhere.bridges[0].is_robot
    assert {t.route for t in elsewhere.topics} == {"unannounced"}


# ---------------------------------------------------------------------------------------------------------- neighbours


def test_everybody_has_one_line_and_a_kind():
    """This session, its guard, the robot, another gateway, a host's bridge, a plain client; in this order."""
    sessions = {zid: Session("client", f"tcp/10.0.0.{n}:1") for n, zid in enumerate((OWN, "9a", OTHER, HOST, "c1"))}
    neighbours = Neighbours(sessions=sessions, gateways={GatewayToken("9a", False), GatewayToken(OTHER, True)})
    tokens = (*announced(), Token(zid=HOST, kind=TokenKind.PRESENCE), token(ARM, TokenKind.MS, HOST))
    wire = survey(known(neighbours=neighbours, tokens=tokens, friends={"9a"}))
    told = [(who.zid, who.kind, who.is_armed) for who in wire.neighbours]
    assert told == [
        (OWN, "self", False), ("9a", "guard", False), (BRIDGE, "robot", False),
        (OTHER, "gateway", True), (HOST, "bridge", False), ("c1", "session", False),
    ]  # fmt: skip
    assert wire.neighbours[4].listens == (ARM,) and wire.neighbours[4].address == "tcp/10.0.0.3:1"
    assert [(bridge.zid, bridge.is_robot, bridge.version) for bridge in wire.bridges] == [
        (BRIDGE, True, "v1.10.2"),
        (HOST, False, ""),
    ]


def test_who_announces_commands_or_sends_them_is_told_with_the_topics():
    """By a token, as a declared publisher, by data; also whoever does not say who he is."""
    neighbours = Neighbours(
        publishers={("c1", COMMAND)}, sent={("", COMMAND): (4, NOW_NS - S), ("c1", FSM_ENABLE): (2, NOW_NS + 9)}
    )
    wire = survey(known(neighbours=neighbours, tokens=(*announced(), token(COMMAND, TokenKind.MP, HOST))))
    by_zid = {who.zid: who for who in wire.neighbours}
    assert by_zid[HOST].publishes == (COMMAND,) == by_zid["c1"].publishes
    assert by_zid["c1"].sent == {FSM_ENABLE: 2} and by_zid[""].sent == {COMMAND: 4}
    assert (by_zid[""].sent_age_ns, by_zid["c1"].sent_age_ns, by_zid[HOST].sent_age_ns) == (S, 0, None)
    assert by_zid[""].kind == "session" and by_zid[HOST].kind == "session"  # no presence token: who knows what it is


def test_a_router_full_of_tokens_makes_no_endless_page():
    """The first of each are told, ours and the robot's among them, however many there are."""
    crowd = [f"c{n:05x}" for n in range(20_000)]
    tokens = (
        *(Token(zid=zid, kind=TokenKind.PRESENCE) for zid in crowd),
        *(token(ARM, TokenKind.MP, zid) for zid in crowd),
    )
    wire = survey(known(tokens=(*tokens, *announced())))
    assert len(wire.neighbours) == len(wire.bridges) == KEPT == len(wire.topics[0].announced)
    assert wire.neighbours[0].kind == "self"


def test_a_router_that_is_no_bridge_is_the_robots_too():
    """Router and bridge may be two processes (wire.md, terms)."""
    wire = survey(known(router_zid="70e7"))
    told = {who.zid: (who.kind, who.whatami) for who in wire.neighbours}
    assert "70e7" not in told  # the robot's bridge is there; a router that the router does not list is not made up
    sessions = {"70e7": Session("router", "")}
    wire = survey(known(router_zid="70e7", neighbours=Neighbours(sessions=sessions)))
    assert {who.zid: who.kind for who in wire.neighbours}["70e7"] == "robot"


def test_without_a_session_only_the_settings_are_known():
    """Nothing else is made up."""
    wire = survey(Known(settings=LinkSettings(endpoint="tcp/10.0.0.7:9000"), now_ns=NOW_NS))
    assert (wire.endpoint, wire.is_up, wire.up_ns) == ("tcp/10.0.0.7:9000", False, 0)
    assert wire.neighbours == () and wire.bridges == () and {t.route for t in wire.topics} == {"unknown"}
