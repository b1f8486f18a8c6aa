"""Tests of what leaves the daemon for its clients."""

from __future__ import annotations

import pytest

from gateway.api import protocol
from gateway.api.outbox import MAX_UNSENT
from gateway.core.messages import outputs
from gateway.errors import Code, Refusal
from tests.api.desk import AskedQuestion, Desk, KeptAudience
from tests.api.samples import command
from tests.api.stand_in import a_snapshot


@pytest.fixture
def desk():
    """An outbox whose threads are the test."""
    return Desk()


def ask(desk, request_id=1, **kwargs):
    """Ask for a recovery; returns the question."""
    question = desk.ask(protocol.encode(command(protocol.Recover(), request_id)), **kwargs)
    desk.run()
    return question


def reply(request_id=1, **kwargs):
    """Return the engine's reply to it."""
    return outputs.Reply(client_id="c0ffee", request_id=request_id, **kwargs)


def test_a_reply_finds_its_question_once(desk):
    """One question, one answer; a second reply to it goes nowhere."""
    question = ask(desk)
    desk.inbox.poll()
    desk.outbox.send([reply(facts={"epoch": 4}), reply(facts={"epoch": 5}), reply(99)], [])
    assert question.answers == []  # the loop does not send
    desk.run()
    assert question.reply.facts == {"epoch": 4}


def test_a_question_asked_again_is_answered_with_the_first(desk):
    """The same number from the same client: one reply of the engine answers both."""
    first, second = ask(desk), ask(desk)
    assert len(desk.inbox.poll()) == 2
    desk.outbox.send([reply(refusal=Refusal(code=Code.LATCHED, message="m"))], [])
    desk.run()
    assert first.code == second.code == "LATCHED"


def test_a_reply_names_the_newest_snapshot_that_may_not_show_it(desk):
    """A client that waits for the effect looks at later snapshots only."""
    desk.outbox.publish_snapshot(a_snapshot(seq=41))
    question = ask(desk)
    desk.inbox.poll()
    desk.outbox.send([reply()], [])
    desk.outbox.publish_snapshot(a_snapshot(seq=42))
    desk.run()
    assert question.reply.after_seq == 41


def test_a_question_that_the_loop_took_and_forgot_is_unknown(desk):
    """A command that was taken may have run: OUTCOME_UNKNOWN, after two seconds."""
    question = ask(desk, received_ns=0)
    desk.inbox.poll()
    desk.outbox.expire(protocol.REPLY_WITHIN_NS)
    desk.run()
    assert question.answers == []
    desk.outbox.expire(protocol.REPLY_WITHIN_NS + 1)
    desk.run()
    assert question.code == "OUTCOME_UNKNOWN" and desk.outbox.unanswered == 1
    desk.outbox.send([reply()], [])
    desk.run()
    assert len(question.answers) == 1


def test_facts_and_snapshots_are_answered_by_the_plane_itself(desk):
    """Info and snapshot need no engine; a snapshot comes in JSON too."""
    info = desk.ask(key=protocol.INFO_KEY, encoding=protocol.JSON)
    early = desk.ask(key=protocol.SNAPSHOT_KEY)
    desk.run()
    assert protocol.decode_info(*info.answers[0]).pid == 1
    assert early.code == "STATE_STALE"
    desk.outbox.publish_snapshot(a_snapshot(seq=3))
    typed, packed = desk.ask(key=protocol.SNAPSHOT_KEY, encoding=protocol.JSON), desk.ask(key=protocol.SNAPSHOT_KEY)
    desk.run()
    assert typed.answers[0][0].startswith(b'{"seq":3,')
    assert protocol.decode_snapshot(*typed.answers[0]) == protocol.decode_snapshot(*packed.answers[0])
    assert desk.inbox.poll() == []


def test_a_snapshot_that_thousands_ask_for_is_encoded_once(desk, monkeypatch):
    """Once in each encoding, for those who listen as well: a flood of questions must not keep the sender busy without end."""
    encoded, encode = [], protocol.encode
    monkeypatch.setattr(protocol, "encode", lambda *words: encoded.append(words) or encode(*words))
    audience = KeptAudience(listens=True)
    desk.outbox.add_audience(audience)
    for seq in (3, 4):
        desk.outbox.publish_snapshot(a_snapshot(seq=seq))
        asked = [desk.ask(key=protocol.SNAPSHOT_KEY, encoding=(protocol.JSON, "")[n % 2]) for n in range(100)]
        desk.run()
        assert {protocol.decode_snapshot(*question.answers[0]).seq for question in asked} == {seq}
    assert [seq for _, seq in audience.snapshots] == [3, 4] and len(encoded) == 4


def test_routes_are_told_as_they_are_now(desk):
    """What discovery knows is asked for with each question; before anybody knows, there is nothing."""
    first = desk.ask(key=protocol.ROUTES_KEY)
    desk.run()
    assert protocol.decode_routes(*first.answers[0]).routes == {}
    desk.outbox.routes = lambda: protocol.Routes(routes={"/fsm_state": "ready"}, bridge_version="1.5", undelivered=3)
    second = desk.ask(key=protocol.ROUTES_KEY, encoding=protocol.JSON)
    desk.run()
    told = protocol.decode_routes(*second.answers[0])
    assert (told.routes, told.bridge_version, told.undelivered) == ({"/fsm_state": "ready"}, "1.5", 3)


def test_snapshots_are_sent_while_somebody_listens_and_only_the_newest(desk):
    """Nobody listens: nothing is encoded. The sender is behind: it sends the newest."""
    audience, deaf = KeptAudience(listens=False), KeptAudience(listens=False)
    desk.outbox.add_audience(audience)
    desk.outbox.add_audience(deaf)
    desk.outbox.publish_snapshot(a_snapshot(seq=1))
    desk.run()
    assert audience.snapshots == []
    audience.listens = True
    for seq in (2, 3, 4):
        desk.outbox.publish_snapshot(a_snapshot(seq=seq))
    desk.run()
    assert [seq for _, seq in audience.snapshots] == [4] and audience.snapshots[0][0].seq == 4
    desk.outbox.publish_snapshot(a_snapshot(seq=5))
    desk.run()
    assert [seq for _, seq in audience.snapshots] == [4, 5] and deaf.snapshots == []


def test_a_sender_faster_than_the_loop_does_not_end_the_snapshots(desk, monkeypatch):
    """The sender may send a snapshot before the loop is back from queueing it; the next one is sent all the same."""
    audience = KeptAudience()
    desk.outbox.add_audience(audience)
    put = desk.outbox._put

    def put_and_send(job, question=None):
        is_queued = put(job, question)
        desk.run()
        return is_queued

    monkeypatch.setattr(desk.outbox, "_put", put_and_send)
    for seq in (1, 2, 3):
        desk.outbox.publish_snapshot(a_snapshot(seq=seq))
    assert [seq for _, seq in audience.snapshots] == [1, 2, 3]


def test_notices_go_to_every_audience_in_order(desk):
    """A notice reaches all who listen, wherever they are connected."""
    audiences = [KeptAudience(), KeptAudience(listens=False)]
    for audience in audiences:
        desk.outbox.add_audience(audience)
    notices = [outputs.Notice(code=Code.WALK, level=outputs.Level.INFO, message=str(n), at_ns=n) for n in range(3)]
    desk.outbox.send([], notices)
    desk.run()
    assert all([notice.message for notice in audience.notices] == ["0", "1", "2"] for audience in audiences)
    assert all(audience.numbers == [1, 2, 3] for audience in audiences)


def test_what_cannot_be_encoded_is_a_bug_told_to_the_one_who_asked(desk):
    """A fact without a form on the wire becomes INTERNAL; a snapshot without one is skipped; the plane goes on."""
    audience = KeptAudience()
    desk.outbox.add_audience(audience)
    question = ask(desk)
    desk.inbox.poll()
    desk.outbox.send([reply(facts={"thing": object()})], [])
    desk.outbox.publish_snapshot(a_snapshot(seq=1, latches={"X": object()}))
    broken = desk.ask(key=protocol.SNAPSHOT_KEY)
    desk.run()
    assert question.code == "INTERNAL" and question.reply.request_id == 1
    assert broken.code == "INTERNAL" and audience.snapshots == []
    desk.outbox.publish_snapshot(a_snapshot(seq=2))
    desk.run()
    assert [seq for _, seq in audience.snapshots] == [2]


def test_a_sender_that_hangs_costs_no_memory(desk):
    """Notices are dropped and questions finished without an answer when nothing is being sent; later all is well."""
    audience = KeptAudience()
    desk.outbox.add_audience(audience)
    notice = outputs.Notice(code=Code.WALK, level=outputs.Level.INFO, message="m", at_ns=1)
    desk.outbox.send([], [notice] * (MAX_UNSENT + 7))
    assert desk.outbox.dropped == 7
    question = AskedQuestion(key=protocol.INFO_KEY)
    desk.outbox.tell_info(question)
    assert question.dropped and question.answers == []
    desk.outbox.publish_snapshot(a_snapshot(seq=1))
    desk.run()
    assert len(audience.notices) == MAX_UNSENT and audience.snapshots == []
    desk.outbox.send([], [notice])
    desk.run()
    assert audience.numbers[-2:] == [MAX_UNSENT, MAX_UNSENT + 8]  # who listens sees that seven are missing
    desk.outbox.publish_snapshot(a_snapshot(seq=2))
    desk.run()
    assert len(audience.snapshots) == 1


def test_waiting_for_something_to_send_ends(desk):
    """deliver() waits as long as it is told, and is woken."""
    assert desk.outbox.deliver(0.01) is False
    desk.outbox.wake()
    assert desk.outbox.deliver(10.0) is True
    desk.outbox._send_snapshot()  # nothing was published yet: nothing to send
