"""Tests of who is who."""

from __future__ import annotations

from gateway.api import protocol
from gateway.api.identities import MOST, MOST_OWNERS, Identities
from gateway.api.inbox import MAX_WAITING
from gateway.core.messages import events
from gateway.messages import requests
from tests.api.desk import AskedQuestion, Desk
from tests.api.samples import Q


def test_the_first_command_binds_an_id_to_its_secret():
    """From then on nobody else passes under it; who was never met is nobody."""
    known = Identities()
    assert not known.is_proven("a", "")
    assert known.meet("a", "s1") and known.meet("a", "s1") and known.is_proven("a", "s1")
    assert not known.meet("a", "s2") and not known.meet("a", "") and not known.is_proven("a", "s2")
    assert not known.meet("a", "s\u00e9")
    assert not known.may_be("b", "") and not known.meet("b", "") and known.secret_of("b") is None


def test_who_is_heard_is_not_forgotten():
    """A flood of made-up clients pushes out those that were silent for longest, never one that sends keepalives."""
    known = Identities()
    known.meet("owner", "s")
    known.meet("silent", "s")
    for number in range(3 * MOST):
        known.meet(f"made up {number}", "x")
        if number % 1000 == 0:
            assert known.is_proven("owner", "s")
    assert known.is_proven("owner", "s") and not known.is_proven("silent", "s")


def test_who_is_pinned_is_never_forgotten():
    """Were it, the next one to come would pass for it: undo its stop, command in its place."""
    known = Identities()
    for client_id in ("owner", "stopper", "other"):
        known.meet(client_id, "s")
    known.pinned = frozenset({"owner", "stopper", "never met", ""})
    for number in range(2 * MOST):
        known.meet(f"made up {number}", "x")
    assert not known.meet("owner", "x") and not known.meet("stopper", "x")
    assert known.meet("owner", "s") and known.meet("stopper", "s") and known.secret_of("other") is None
    known.pinned = frozenset()
    for number in range(2 * MOST):
        known.meet(f"made up {number}", "x")
    assert known.secret_of("stopper") is None


def test_who_owned_the_robot_lately_is_not_forgotten():
    """Its id was shown to everybody: a flood of made-up clients must not give it to whoever comes next."""
    known = Identities()
    for number in range(MOST_OWNERS + 1):
        known.meet(f"owner {number}", "s")
        known.note_owner(f"owner {number}")
        known.note_owner(f"owner {number}")
    for number in range(2 * MOST):
        known.meet(f"made up {number}", "x")
    assert [known.meet(f"owner {number}", "x") for number in range(MOST_OWNERS + 1)] == [True] + [False] * MOST_OWNERS


def said(request, number, secret, client_id="owner"):
    """Return a command of the owner, or of one who says so."""
    return protocol.encode(
        protocol.Command(version=1, client_id=client_id, secret=secret, request_id=number, request=request)
    )


def test_a_stranger_under_the_owners_id_is_nobody():
    """His commands are refused by name, his keepalives and targets are not heard; his stop is a stranger's."""
    desk = Desk()
    desk.ask(said(protocol.Recover(), 1, "s3cret"))
    posed = [
        desk.ask(said(protocol.Recover(), 2, "guess")),
        desk.ask(said(protocol.Release(epoch=1), 3, "")),
    ]
    stop = desk.ask(said(protocol.Stop(), 4, "guess"))
    target = protocol.encode(protocol.Target(epoch=1, seq=1, values=Q))
    for secret in ("", "guess", "*", "**"):
        desk.inbox.put_keepalive(protocol.keepalive_key("owner", secret), 5)
        desk.inbox.put_target(protocol.target_key("owner", 1, secret), target, "", 5)
    desk.inbox.put_keepalive("ta2/1/keepalive/**", 5)
    desk.run()
    stopped, own = desk.inbox.poll()
    assert isinstance(stopped.request, requests.Stop) and stopped.client_id == "stranger" and not stop.answers
    assert own.request_id == 1 and [question.code for question in posed] == ["NOT_OWNER", "NOT_OWNER"]
    assert "'owner'" in posed[0].reply.refusal.message
    desk.inbox.put_keepalive(protocol.keepalive_key("owner", "s3cret"), 6)
    desk.inbox.put_target(protocol.target_key("owner", 1, "s3cret"), target, "", 7)
    seen, followed = desk.inbox.poll()
    assert seen == events.ClientSeen(client_id="owner", at_ns=6)
    assert (followed.client_id, followed.stream_id) == ("owner", 1)


def test_what_is_refused_binds_no_id():
    """Else a flood would push out whoever is known as fast as it can be read, and not only as fast as the loop takes it."""
    desk = Desk()
    desk.ask(said(protocol.Recover(), 0, "s3cret"))
    for number in range(1, MAX_WAITING):
        desk.ask(said(protocol.Recover(), number, "s3cret", f"client{number}"))
    desk.run()
    refused = desk.ask(said(protocol.Recover(), 1, "x", "late"))
    stop = desk.ask(said(protocol.Stop(), 2, "x", "stopper"))
    desk.run()
    known = desk.inbox.identities
    assert refused.code == "TIMEOUT" and known.secret_of("late") is None
    assert known.is_proven("owner", "s3cret") and known.is_proven("stopper", "x") and not stop.answers


def test_of_two_under_one_new_id_the_first_that_is_let_in_has_it():
    """A chunk waits to be worked out; what comes under its client's id meanwhile waits behind it, and is another one's."""
    desk = Desk()
    chunk = protocol.CheckFollow(follow=protocol.Follow(epoch=0, points={"left": (Q, Q)}, dt_s=0.1))
    first = desk.ask(said(chunk, 1, "first"))
    second = desk.ask(said(protocol.Acquire(name="a", pid=1), 2, "second"))
    desk.run()
    assert desk.inbox.identities.is_proven("owner", "first") and not first.answers
    assert second.code == "NOT_OWNER" and [event.request_id for event in desk.inbox.poll()] == [1]


def test_made_up_clients_take_no_place_from_the_owner():
    """Keepalives and targets on keys of nobody are dropped before they are kept: the owner's are heard among 100,000."""
    desk = Desk()
    desk.ask(said(protocol.Recover(), 1, "s"))
    desk.run()
    desk.inbox.poll()
    for number in range(50_000):
        desk.inbox.put_keepalive(protocol.keepalive_key(f"nobody{number}", "x"), number)
        desk.inbox.put_target(protocol.target_key(f"nobody{number}", 1, "x"), b"", "", number)
    desk.inbox.put_keepalive(protocol.keepalive_key("owner", "s"), 5)
    assert desk.inbox.poll() == [events.ClientSeen(client_id="owner", at_ns=5)]


def test_a_question_is_proven_by_its_own_secret():
    """What a stop says of its sender counts only with the secret."""
    desk = Desk()
    desk.ask(said(protocol.Recover(), 1, "s3cret"))
    desk.run()
    desk.stops.proven = desk.inbox.identities.is_proven
    for secret in ("s3cret", "guess"):
        payload = protocol.encode({"client_id": "owner", "secret": secret})
        desk.stops.arrive(protocol.STOP_KEY, payload, 0, AskedQuestion(payload))
    assert [stop.client_id for stop in desk.stops.poll()] == ["owner", "'owner'"]
