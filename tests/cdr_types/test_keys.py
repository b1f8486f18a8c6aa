from __future__ import annotations

import pytest
import zenoh
from hypothesis import given
from hypothesis import strategies as st

from cdr_types.errors import BadName
from cdr_types.keys import (
    ALL_TOKENS,
    History,
    Qos,
    Reliability,
    Token,
    TokenKind,
    format_token,
    parse_token,
    presence_key,
    topic_to_key,
)

STATE_QOS = Qos(reliability=Reliability.RELIABLE, history=History.KEEP_LAST, depth=10)
CHUNK = st.text("abXY_09", min_size=1, max_size=8)
TOPIC = st.lists(CHUNK, min_size=1, max_size=4).map(lambda chunks: "/" + "/".join(chunks))
ZID = st.text("0123456789abcdef", min_size=1, max_size=32)
TOPIC_TOKEN = st.builds(
    Token,
    zid=ZID,
    kind=st.sampled_from([TokenKind.MP, TokenKind.MS]),
    topic=TOPIC,
    type_name=st.just("sensor_msgs/msg/JointState"),
    qos=st.sampled_from([Qos(), STATE_QOS, Qos(is_keyed=True, user_data="typehash=RIHS01_0;")]),
)
OTHER_TOKEN = st.builds(
    Token,
    zid=ZID,
    kind=st.sampled_from([TokenKind.SS, TokenKind.SC, TokenKind.AS, TokenKind.AC]),
    topic=TOPIC,
    type_name=st.just("std_srvs/srv/Trigger"),
)
PRESENCE = st.builds(Token, zid=ZID, kind=st.just(TokenKind.PRESENCE))


@pytest.mark.parametrize(
    ("topic", "namespace", "key"),
    [
        ("/left_arm/joint_states", "", "left_arm/joint_states"),
        ("/left_arm/joint_states", "/", "left_arm/joint_states"),
        ("/fsm_state", "", "fsm_state"),
        ("/left_arm/joint_states", "/bot1", "bot1/left_arm/joint_states"),
        ("/api/fsm/enable", "bot1", "bot1/api/fsm/enable"),
        ("/api/fsm/enable", "/site/bot1/", "site/bot1/api/fsm/enable"),
    ],
)
def test_a_key_is_the_topic_below_the_namespace(topic, namespace, key):
    """Without the leading slash, absolute names included (wire.md 1.1)."""
    assert topic_to_key(topic, namespace) == key


@pytest.mark.parametrize("topic", ["", "left_arm", "/", "//a", "/a//b", "/a/", "/a/*", "/a/**", "/$*", "/a?b", "/a#b",
                                   "/@ros2_lv", "/a§b"])  # fmt: skip
def test_a_topic_that_is_no_concrete_name_is_refused(topic):
    """A wildcard would command, or listen to, more than one topic."""
    with pytest.raises(BadName):
        topic_to_key(topic)


@pytest.mark.parametrize("namespace", ["a//b", "*", "/bot§1", "@bot"])
def test_a_namespace_obeys_the_rules_of_a_name(namespace):
    """It becomes part of every key."""
    with pytest.raises(BadName) as caught:
        topic_to_key("/fsm_state", namespace)
    assert caught.value.field == "namespace"


def test_the_token_of_a_state_topic():
    """The token that keeps the robot's route alive, as wire.md 3.1 spells it."""
    token = Token(
        zid="1a2b",
        kind=TokenKind.MS,
        topic="/left_arm/joint_states",
        type_name="sensor_msgs/msg/JointState",
        qos=STATE_QOS,
    )
    text = "@/1a2b/@ros2_lv/MS/left_arm§joint_states/sensor_msgs§msg§JointState/:1::0,10"
    assert format_token(token) == text
    assert parse_token(text) == token
    assert token.key == "left_arm/joint_states"


@pytest.mark.parametrize("kind", ["SS", "SC", "AS", "AC"])
def test_the_tokens_of_services_and_actions_have_no_quality(kind):
    """Six parts instead of seven."""
    text = f"@/ff/@ros2_lv/{kind}/bot1§reset/std_srvs§srv§Trigger"
    token = parse_token(text)
    assert token == Token(zid="ff", kind=TokenKind(kind), topic="/bot1/reset", type_name="std_srvs/srv/Trigger")
    assert format_token(token) == text
    assert not token.kind.has_qos


def test_the_presence_of_a_bridge_is_a_token_too():
    """It matches the expression of all tokens, so the parser gets it."""
    assert presence_key("ab12") == "@/ab12/@ros2_lv"
    assert parse_token("@/ab12/@ros2_lv") == Token(zid="ab12", kind=TokenKind.PRESENCE)
    assert parse_token("@/ab12/@ros2_lv").key == ""
    assert ALL_TOKENS == "@/*/@ros2_lv/**"  # `**` alone does not match verbatim chunks (wire.md 4.2)


def test_zenoh_agrees_that_all_tokens_are_matched():
    """The expression meets every kind of token, and no data key."""
    everything = zenoh.KeyExpr(ALL_TOKENS)
    for text in (
        "@/ab/@ros2_lv",
        "@/ab/@ros2_lv/MP/fsm_state/std_msgs§msg§Int32/:1::0,10",
        "@/ab/@ros2_lv/AS/go/x§action§Go",
    ):
        assert everything.intersects(zenoh.KeyExpr(text))
    assert not everything.intersects(zenoh.KeyExpr("left_arm/joint_states"))


@given(st.one_of(TOPIC_TOKEN, OTHER_TOKEN, PRESENCE))
def test_any_token_makes_the_round_trip(token):
    """Every kind, every topic, several qualities."""
    assert parse_token(format_token(token)) == token


@given(st.text(st.sampled_from("@/§:,MPS01aros2_lv*"), max_size=40) | st.text(max_size=20))
def test_any_text_is_a_token_or_refused(text):
    """Tokens of strangers never raise anything but BadName."""
    for candidate in (text, f"@/ab/@ros2_lv/{text}"):
        try:
            assert parse_token(format_token(parse_token(candidate))) == parse_token(candidate)
        except BadName:
            pass


@pytest.mark.parametrize(
    ("text", "field"),
    [
        ("", "token"),
        ("left_arm/joint_states", "token"),
        ("@/ab", "token"),
        ("@/ab/router", "token"),
        ("x/ab/@ros2_lv", "token"),
        ("@/ab/@ros2_lv/XX/a/b", "token kind"),
        ("@/ab/@ros2_lv/", "token kind"),
        ("@/ab/@ros2_lv/MP/a/b§msg§C", "token"),
        ("@/ab/@ros2_lv/MP/a/b§msg§C/:::/d", "token"),
        ("@/ab/@ros2_lv/SS/a/b§srv§C/:::", "token"),
        ("@/*/@ros2_lv", "zid"),
        ("@/AB/@ros2_lv", "zid"),
        ("@//@ros2_lv", "zid"),
        ("@/" + "a" * 33 + "/@ros2_lv", "zid"),
        ("@/ab/@ros2_lv/MP//b§msg§C/:::", "topic"),
        ("@/ab/@ros2_lv/MP/§a/b§msg§C/:::", "topic"),
        ("@/ab/@ros2_lv/MP/a*/b§msg§C/:::", "topic"),
        ("@/ab/@ros2_lv/MP/a/§/:::", "type_name"),
        ("@/ab/@ros2_lv/MP/a/b§msg§C/::", "qos"),
        ("@/ab/@ros2_lv/MP/\x1b[2J§fsm_state/b§msg§C/:::", "topic"),
        ("@/ab/@ros2_lv/MP/x\n2026-11-29 WARNING forged§fsm_state/b§msg§C/:::", "topic"),
        ("@/ab/@ros2_lv/MP/fsm_state\n/b§msg§C/:::", "topic"),
        ("@/ab/@ros2_lv/MP/x;reboot§fsm_state/b§msg§C/:::", "topic"),
        ("@/ab/@ros2_lv/MP/\u202eé§fsm_state/b§msg§C/:::", "topic"),
        ("@/ab/@ros2_lv/MP/fsm_state/b§msg§C\x07/:::", "type_name"),
    ],
)
def test_what_the_grammar_does_not_know_is_refused(text, field):
    """The error names the part that is wrong."""
    with pytest.raises(BadName) as caught:
        parse_token(text)
    assert caught.value.field == field


@pytest.mark.parametrize(
    "fields",
    [
        {"kind": TokenKind.MP, "topic": "/a", "type_name": "b/msg/C"},
        {"kind": TokenKind.SS, "topic": "/a", "type_name": "b/srv/C", "qos": Qos()},
        {"kind": TokenKind.MS, "topic": "a", "type_name": "b/msg/C", "qos": Qos()},
        {"kind": TokenKind.MS, "topic": "/a", "type_name": "", "qos": Qos()},
        {"kind": TokenKind.PRESENCE, "topic": "/a"},
        {"kind": TokenKind.PRESENCE, "type_name": "b/msg/C"},
        {"kind": TokenKind.PRESENCE, "qos": Qos()},
    ],
)
def test_a_token_that_cannot_be_spelled_cannot_be_built(fields):
    """The constructor refuses what the grammar has no place for."""
    with pytest.raises(BadName):
        Token(zid="ab", **fields)


SENTENCES = (
    (lambda: topic_to_key("left_arm"), "topic: 'left_arm' is no valid name: a topic begins with a slash"),
    (
        lambda: topic_to_key("/a//b"),
        "topic: 'a//b' is no valid name: its parts between slashes are letters, digits and _",
    ),
    (
        lambda: parse_token("@/G/@ros2_lv"),
        "zid: 'G' is no valid name: a zenoh id is 1 to 32 lower-case hexadecimal digits",
    ),
    (lambda: parse_token("/fsm_state"), "token: '/fsm_state' is no valid name: a token begins with @/<zid>/@ros2_lv"),
    (
        lambda: parse_token("@/1a/@ros2_lv/XX/a/b"),
        "token kind: 'XX' is no valid name: one of MP, MS, SS, SC, AS, AC",
    ),
    (
        lambda: parse_token("@/1a/@ros2_lv/SS/a"),
        "token: '@/1a/@ros2_lv/SS/a' is no valid name: a token of kind SS has 6 parts",
    ),
    (
        lambda: Token(zid="1a", kind=TokenKind.MS, topic="/a", type_name="b"),
        "qos: None is no valid name: MP and MS carry a QoS, the other kinds none",
    ),
    (
        lambda: Token(zid="1a", kind=TokenKind.PRESENCE, topic="/a"),
        "topic: '/a' is no valid name: a presence token names no topic and no type",
    ),
    (
        lambda: Token(zid="1a", kind=TokenKind.PRESENCE, type_name="b"),
        "topic: 'b' is no valid name: a presence token names no topic and no type",
    ),
)


@pytest.mark.parametrize(("wrong", "sentence"), SENTENCES)
def test_what_is_wrong_is_told_in_one_sentence(wrong, sentence):
    """Which part, what was found, and what is right."""
    with pytest.raises(BadName) as caught:
        wrong()
    assert str(caught.value) == sentence
