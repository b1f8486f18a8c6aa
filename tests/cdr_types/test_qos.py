from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cdr_types.errors import BadName
from cdr_types.qos import Durability, History, Qos, Reliability, format_qos, parse_qos

RELIABLE, TRANSIENT_LOCAL = Reliability.RELIABLE, Durability.TRANSIENT_LOCAL

# The forms seen on a real bridge or printed by its source (wire.md 4.1).
SEEN = {
    ":::": Qos(),
    "K:::": Qos(is_keyed=True),
    ":1::0,10": Qos(reliability=RELIABLE, history=History.KEEP_LAST, depth=10),
    ":1:0:0,10": Qos(reliability=RELIABLE, durability=Durability.VOLATILE, history=History.KEEP_LAST, depth=10),
    ":1:1:": Qos(reliability=RELIABLE, durability=TRANSIENT_LOCAL),
    ":1::": Qos(reliability=RELIABLE),
    "::1:": Qos(durability=TRANSIENT_LOCAL),
    ":0::1,-1": Qos(reliability=Reliability.BEST_EFFORT, history=History.KEEP_ALL, depth=-1),
    ":1::0,10:typehash=RIHS01_ab;": Qos(
        reliability=RELIABLE, history=History.KEEP_LAST, depth=10, user_data="typehash=RIHS01_ab;"
    ),
    ":::0,5:a:b:c": Qos(history=History.KEEP_LAST, depth=5, user_data="a:b:c"),
    "::::": Qos(user_data=""),
}

ANY_QOS = st.builds(
    lambda history, **others: Qos(history=history[0], depth=history[1], **others),
    history=st.one_of(st.just((None, None)), st.tuples(st.sampled_from(History), st.integers(-1, 2**31 - 1))),
    is_keyed=st.booleans(),
    reliability=st.none() | st.sampled_from(Reliability),
    durability=st.none() | st.sampled_from(Durability),
    user_data=st.none() | st.text(st.characters(exclude_characters="/*$?#"), max_size=10),
)


@pytest.mark.parametrize(("text", "qos"), SEEN.items())
def test_every_form_of_the_bridge_is_read_and_written(text, qos):
    """Each field may be empty; what was read is written back the same."""
    assert parse_qos(text) == qos
    assert format_qos(qos) == text


@given(ANY_QOS)
def test_any_quality_makes_the_round_trip(qos):
    """Writing loses nothing."""
    assert parse_qos(format_qos(qos)) == qos


@given(st.text(st.sampled_from(":,K01-9a"), max_size=12))
def test_any_text_is_read_or_refused(text):
    """No other exception than a BadName, and what is read is stable."""
    try:
        qos = parse_qos(text)
    except BadName:
        return
    assert parse_qos(format_qos(qos)) == qos


@pytest.mark.parametrize(
    ("text", "field"),
    [
        ("", "qos"),
        ("::", "qos"),
        ("k:::", "qos.is_keyed"),
        (":2::", "qos.reliability"),
        (":x::", "qos.reliability"),
        (":١::", "qos.reliability"),  # a digit for int(), not for the bridge
        ("::4:", "qos.durability"),
        (":::2,1", "qos.history"),
        (":::0", "qos.history"),
        (":::0,", "qos"),
        (":::,5", "qos"),
        (":::0,x", "qos.depth"),
        (":::0,99999999999", "qos.depth"),
        (":1::0,10:a/b", "qos.user_data"),
        (":1::0,10:*", "qos.user_data"),
    ],
)
def test_what_the_grammar_does_not_know_is_refused(text, field):
    """The error names the field; a bridge of another dialect is noticed, not misread."""
    with pytest.raises(BadName) as caught:
        parse_qos(text)
    assert caught.value.field == field


@pytest.mark.parametrize("fields", [{"history": History.KEEP_LAST}, {"depth": 1}])
def test_history_and_depth_belong_together(fields):
    """One without the other cannot be spelled."""
    with pytest.raises(BadName, match="together"):
        Qos(**fields)


@pytest.mark.parametrize("user_data", ["a/b", "*", "$", "?", "#"])
def test_user_data_stays_within_its_part_of_the_key(user_data):
    """A slash would begin another part, a wildcard would match other tokens."""
    with pytest.raises(BadName):
        Qos(user_data=user_data)


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("::", "qos: '::' is no valid name: a QoS has at least four fields between colons"),
        ("k:::", "qos.is_keyed: 'k' is no valid name: K or empty"),
        (":2::", "qos.reliability: '2' is no valid name: one of 0, 1 or empty"),
        (":x::", "qos.reliability: 'x' is no valid name: a decimal number or empty"),
        (":::0", "qos.history: '0' is no valid name: <history>,<depth> or empty"),
        (":::,5", "qos: (None, 5) is no valid name: history and depth are given together or not at all"),
        (":1::0,10:*", "qos.user_data: '*' is no valid name: user data must not contain / * $ ? #"),
    ],
)
def test_what_is_wrong_is_told_in_one_sentence(text, sentence):
    """Which field, what was found, and what is right."""
    with pytest.raises(BadName) as caught:
        parse_qos(text)
    assert str(caught.value) == sentence
