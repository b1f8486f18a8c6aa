"""Tests of what leaves the daemon for its clients."""

from __future__ import annotations

import pytest
from tests.api.handler import AskedQuestion, KeptAudience, RequestHandler

from gateway.api import protocol
from gateway.api.outbox import MAX_UNSENT
from gateway.core.messages import events
from gateway.errors import Code, Refusal
from tests.api.samples import command
from tests.api.stand_in import a_snapshot


@pytest.fixture
def handler():
    """An outbox whose threads are the test."""
    return RequestHandler()


def ask(handler, request_id=1, **kwargs):
    """Ask for a recovery; returns the question."""
    question = handler.ask(protocol.encode(command(protocol.Recover(), request_id)), **kwargs)
    handler.run()
    return question


def reply(request_id=1, **kwargs):
    """Return the engine's reply to it."""
    return events.Reply(client_id="c0ffee", request_id=request_id, **kwargs)


def test_a_reply_finds_its_question_once(handler):
    """One question, one answer; a second reply to it goes nowhere."""
    question = ask(handler)
    handler.inbox.poll()
    handler.outbox.send([reply(facts={"epoch": 4}), reply(facts={"epoch": 5}), reply(99)], [])
    assert question.answers == []  # the loop does not send
    handler.run()
    assert question.reply.facts == {"epoch": 4}


def test_a_question_asked_again_is_answered_with_the_first(handler):
    """The same number from the same client: one reply of the engine answers both."""
    first, second = ask(handler), ask(handler)
    assert len(handler.inbox.poll()) == 2
    handler.outbox.send([reply(refusal=Refusal(code=Code.LATCHED, message="m"))], [])
    handler.run()
    assert first.code == second.code == "LATCHED"


def test_a_reply_names_the_newest_snapshot_that_may_not_show_it(handler):
    """A client that waits for the effect looks at later snapshots only."""
    handler.outbox.publish_snapshot(a_snapshot(seq=41))
    question = ask(handler)
    handler.inbox.poll()
    handler.outbox.send([reply()], [])
    handler.outbox.publish_snapshot(a_snapshot(seq=42))
    handler.run()
    assert question.reply.after_seq == 41


def test_a_question_that_the_loop_took_and_forgot_is_unknown(handler):
    """A command that was taken may have run: OUTCOME_UNKNOWN, after two seconds."""
    question = ask(handler, received_ns=0)
    handler.inbox.poll()
    handler.outbox.expire(protocol.REPLY_WITHIN_NS)
    handler.run()
    assert question.answers == []
    handler.outbox.expire(protocol.REPLY_WITHIN_NS + 1)
    handler.run()
    assert question.code == "OUTCOME_UNKNOWN" and handler.outbox.unanswered == 1
    handler.outbox.send([reply()], [])
    handler.run()
    assert len(question.answers) == 1


def test_facts_and_snapshots_are_answered_by_the_plane_itself(handler):
    """Info and snapshot need no engine; a snapshot comes in JSON too."""
    info = handler.ask(key=protocol.INFO_KEY, encoding=protocol.JSON)
    early = handler.ask(key=protocol.SNAPSHOT_KEY)
    handler.run()
    assert protocol.decode_info(*info.answers[0]).pid == 1
    assert early.code == "STATE_STALE"
    handler.outbox.publish_snapshot(a_snapshot(seq=3))
    typed, packed = (
        handler.ask(key=protocol.SNAPSHOT_KEY, encoding=protocol.JSON),
        handler.ask(key=protocol.SNAPSHOT_KEY),
    )
    handler.run()
    assert typed.answers[0][0].startswith(b'{"seq":3,')
    assert protocol.decode_snapshot(*typed.answers[0]) == protocol.decode_snapshot(*packed.answers[0])
    assert handler.inbox.poll() == []


def test_routes_are_told_as_they_are_now(handler):
    """What discovery knows is asked for with each question; before anybody knows, there is nothing."""
    first = handler.ask(key=protocol.ROUTES_KEY)
    handler.run()
    assert protocol.decode_routes(*first.answers[0]).routes == {}
    handler.outbox.routes = lambda: protocol.Routes(routes={"/fsm_state": "ready"}, bridge_version="1.5", undelivered=3)
    second = handler.ask(key=protocol.ROUTES_KEY, encoding=protocol.JSON)
    handler.run()
    told = protocol.decode_routes(*second.answers[0])
    assert (told.routes, told.bridge_version, told.undelivered) == ({"/fsm_state": "ready"}, "1.5", 3)


def test_snapshots_are_sent_while_somebody_listens_and_only_the_newest(handler):
    """Nobody listens: nothing is encoded. The sender is behind: it sends the newest."""
    audience, deaf = KeptAudience(listens=False), KeptAudience(listens=False)
    handler.outbox.add_audience(audience)
    handler.outbox.add_audience(deaf)
    handler.outbox.publish_snapshot(a_snapshot(seq=1))
    handler.run()
    assert audience.snapshots == []
    audience.listens = True
    for seq in (2, 3, 4):
        handler.outbox.publish_snapshot(a_snapshot(seq=seq))
    handler.run()
    assert [seq for _, seq in audience.snapshots] == [4] and audience.snapshots[0][0].seq == 4
    handler.outbox.publish_snapshot(a_snapshot(seq=5))
    handler.run()
    assert [seq for _, seq in audience.snapshots] == [4, 5] and deaf.snapshots == []


def test_a_sender_faster_than_the_loop_does_not_end_the_snapshots(handler, monkeypatch):
    """The sender may send a snapshot before the loop is back from queueing it; the next one is sent all the same."""
    audience = KeptAudience()
    handler.outbox.add_audience(audience)
    put = handler.outbox._put

    def put_and_send(job, question=None):
        is_queued = put(job, question)
        handler.run()
        return is_queued

    monkeypatch.setattr(handler.outbox, "_put", put_and_send)
    for seq in (1, 2, 3):
        handler.outbox.publish_snapshot(a_snapshot(seq=seq))
    assert [seq for _, seq in audience.snapshots] == [1, 2, 3]


def test_notices_go_to_every_audience_in_order(handler):
    """A notice reaches all who listen, wherever they are connected."""
    audiences = [KeptAudience(), KeptAudience(listens=False)]
    for audience in audiences:
        handler.outbox.add_audience(audience)
    notices = [events.Notice(code=Code.WALK, level=events.Level.INFO, message=str(n), at_ns=n) for n in range(3)]
    handler.outbox.send([], notices)
    handler.run()
    assert all([notice.message for notice in audience.notices] == ["0", "1", "2"] for audience in audiences)
    assert all(audience.numbers == [1, 2, 3] for audience in audiences)


def test_what_cannot_be_encoded_is_a_bug_told_to_the_one_who_asked(handler):
    """A fact without a form on the wire becomes INTERNAL; a snapshot without one is skipped; the plane goes on."""
    audience = KeptAudience()
    handler.outbox.add_audience(audience)
    question = ask(handler)
    handler.inbox.poll()
    handler.outbox.send([reply(facts={"thing": object()})], [])
    handler.outbox.publish_snapshot(a_snapshot(seq=1, latches={"X": object()}))
    broken = handler.ask(key=protocol.SNAPSHOT_KEY)
    handler.run()
    assert question.code == "INTERNAL" and question.reply.request_id == 1
    assert broken.code == "INTERNAL" and audience.snapshots == []
    handler.outbox.publish_snapshot(a_snapshot(seq=2))
    handler.run()
    assert [seq for _, seq in audience.snapshots] == [2]


def test_a_sender_that_hangs_costs_no_memory(handler):
    """Notices are dropped and questions finished without an answer when nothing is being sent; later all is well."""
    audience = KeptAudience()
    handler.outbox.add_audience(audience)
    notice = events.Notice(code=Code.WALK, level=events.Level.INFO, message="m", at_ns=1)
    handler.outbox.send([], [notice] * (MAX_UNSENT + 7))
    assert handler.outbox.dropped == 7
    question = AskedQuestion(key=protocol.INFO_KEY)
    handler.outbox.tell_info(question)
    assert question.dropped and question.answers == []
    handler.outbox.publish_snapshot(a_snapshot(seq=1))
    handler.run()
    assert len(audience.notices) == MAX_UNSENT and audience.snapshots == []
    handler.outbox.send([], [notice])
    handler.run()
    assert audience.numbers[-2:] == [MAX_UNSENT, MAX_UNSENT + 8]  # who listens sees that seven are missing
    handler.outbox.publish_snapshot(a_snapshot(seq=2))
    handler.run()
    assert len(audience.snapshots) == 1


def test_waiting_for_something_to_send_ends(handler):
    """deliver() waits as long as it is told, and is woken."""
    assert handler.outbox.deliver(0.01) is False
    handler.outbox.wake()
    assert handler.outbox.deliver(10.0) is True
    handler.outbox._send_snapshot()  # nothing was published yet: nothing to send
