"""What is seen of others: who is there comes whole, data comes with its arrival, and nothing says who is ours."""

from __future__ import annotations

from typing import get_args

from msgspec import Struct

from gateway.core.messages import sightings
from gateway.core.messages.sightings import ForeignTokens, Gateway, GatewayTokens, Means, Sighting, Writer


def test_the_union_is_everything_that_says_when_it_was_seen():
    """What has an instant is an event; the others are parts of one."""
    things = {thing for thing in vars(sightings).values() if isinstance(thing, type)}
    classes = {thing for thing in things if issubclass(thing, Struct)} - {Struct}
    dated = {one for one in classes if "at_ns" in one.__struct_fields__}
    assert set(get_args(Sighting)) == dated
    assert classes - dated == {Writer, Gateway}


def test_who_is_there_is_told_whole():
    """An empty list says that nobody is there any more: no event about one of them can be lost."""
    assert ForeignTokens(writers=(), at_ns=1).writers == ()
    assert GatewayTokens(gateways=(), at_ns=1).gateways == ()


def test_the_means_are_words_of_the_wire():
    """They are shown to people and scripts as they are."""
    assert [means.value for means in Means] == ["token", "publisher"]
