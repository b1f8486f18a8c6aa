"""Tests of what clients send on its way to the engine."""

from __future__ import annotations

import logging

import pytest

from gateway.api import inbox as module
from gateway.api import protocol
from gateway.api.access.roles import Asker
from gateway.api.inbox import (
    MAX_ASIDE,
    MAX_ASIDE_OF_CLIENT,
    MAX_CLIENTS,
    MAX_OF_CLIENT,
    MAX_STREAMS,
    MAX_WAITING,
    PER_POLL,
    READ_BETWEEN,
)
from gateway.core.messages import events
from gateway.errors import Code
from gateway.messages import requests
from tests.api.desk import AskedQuestion, Desk
from tests.api.samples import HOME, Q, command


@pytest.fixture
def desk():
    """An inbox whose threads are the test; two clients are known."""
    desk = Desk()
    for client_id in ("c0ffee", "me"):
        desk.inbox.identities.meet(client_id, "s")
    return desk


def payload(request, request_id=1, **kwargs):
    """Return a command as bytes."""
    return protocol.encode(command(request, request_id, **kwargs))


def test_a_request_reaches_the_loop_with_who_and_when(desk):
    """Client, number and arrival come with the request; the question waits for its reply."""
    data = payload(protocol.Recover(), 7)
    question = desk.ask(data, received_ns=123)
    desk.run()
    (event,) = desk.inbox.poll()
    assert event == events.CommandRequested(
        client_id="c0ffee", request_id=7, request=requests.Recover(), received_ns=123, content=hash(data)
    )
    assert desk.inbox.poll() == [] and question.answers == []


def test_the_name_of_a_user_for_whom_zenoh_vouches_comes_along(desk):
    """People are told it in place of the number that his client is."""
    question = AskedQuestion(payload(protocol.Recover()))
    question.asker = Asker(door="network", user="ann")
    desk.inbox.ask(question)
    desk.run()
    (event,) = desk.inbox.poll()
    assert (event.client_id, event.name) == ("c0ffee", "ann")


def test_another_request_under_a_number_that_still_waits_is_refused(desk):
    """It would be answered with the reply to the first, and not run; the same bytes again wait with the first."""
    first = desk.ask(payload(protocol.Release(epoch=1), 7))
    again = desk.ask(payload(protocol.Release(epoch=1), 7))
    other = desk.ask(payload(protocol.Release(epoch=2), 7))
    stop = desk.ask(payload(protocol.Stop(), 7))
    desk.run()
    assert other.code == "BAD_REQUEST" and first.answers == again.answers == stop.answers == []
    asked = [event.request for event in desk.inbox.poll()]
    assert asked == [requests.Stop(), requests.Release(epoch=1), requests.Release(epoch=1)]


def test_a_stop_finds_room_where_a_flood_has_left_none(desk):
    """What is not read yet is bounded; a stop is refused only by a flood of stops."""
    for n in range(MAX_WAITING + 1):
        last = desk.ask(payload(protocol.Recover(), n))
    stop = desk.ask(payload(protocol.Stop(), 5000))
    desk.run()
    assert last.code == "TIMEOUT" and stop.answers == []
    assert desk.inbox.poll()[0].request == requests.Stop()
    for n in range(2 * MAX_WAITING + 1):
        last = desk.ask(payload(protocol.Stop(), 9000 + n))
    desk.run()
    assert last.code == "TIMEOUT"


def test_json_is_answered_in_json(desk):
    """A question is refused in the encoding in which it was asked."""
    question = desk.ask(b"{}", encoding=protocol.JSON)
    desk.run()
    assert question.answers[0][1] == protocol.JSON and question.code == "BAD_REQUEST"


def test_stops_come_first_then_signs_of_life_targets_requests_departures(desk):
    """Whatever arrived before a stop, the stop is first; an emergency stop is before it."""
    desk.ask(payload(protocol.Recover(), 1))
    desk.inbox.put_target(
        protocol.target_key("c0ffee", 2, "s"), protocol.encode(protocol.Target(epoch=1, seq=1, values=Q)), "", 5
    )
    desk.inbox.put_keepalive(protocol.keepalive_key("c0ffee", "s"), 6)
    desk.inbox.put_gone("other", 7)
    desk.ask(payload(protocol.Stop(), 2))
    desk.ask(payload(protocol.Estop(), 3))
    desk.run()
    arrived = desk.inbox.poll()
    assert [type(event).__name__ for event in arrived] == [
        "CommandRequested",
        "CommandRequested",
        "ClientSeen",
        "TargetArrived",
        "CommandRequested",
        "ClientGone",
    ]
    assert [type(e.request).__name__ for e in arrived if isinstance(e, events.CommandRequested)] == [
        "Estop",
        "Stop",
        "Recover",
    ]
    assert arrived[2] == events.ClientSeen(client_id="c0ffee", at_ns=6)
    assert arrived[5] == events.ClientGone(client_id="other", at_ns=7)


def test_only_the_newest_target_of_a_stream_counts(desk):
    """A flood of targets costs one decoding a tick; each stream keeps its own newest."""
    for seq in range(1, 1001):
        for stream in (1, 2):
            target = protocol.Target(epoch=1, seq=seq * stream, values=Q)
            desk.inbox.put_target(protocol.target_key("me", stream, "s"), protocol.encode(target), "", seq)
    arrived = desk.inbox.poll()
    assert [(e.client_id, e.stream_id, e.seq, e.received_ns) for e in arrived] == [
        ("me", 1, 1000, 1000),
        ("me", 2, 2000, 1000),
    ]
    assert desk.inbox.poll() == []


def test_only_the_newest_sign_of_life_counts(desk):
    """Keepalives of one client between two polls are one."""
    for at_ns in range(100):
        desk.inbox.put_keepalive(protocol.keepalive_key("me", "s"), at_ns)
    assert desk.inbox.poll() == [events.ClientSeen(client_id="me", at_ns=99)]


@pytest.mark.parametrize(
    ("key", "data"),
    [
        (protocol.target_key("me", 1, "s"), b"rubbish"),
        (f"{protocol.ROOT}/target/me/first", protocol.encode(protocol.Target(epoch=1, seq=1, values=Q))),
        (f"{protocol.ROOT}/target/me", protocol.encode(protocol.Target(epoch=1, seq=1, values=Q))),
        (protocol.target_key("me", 1, "s"), b"\x00" * (protocol.MAX_PAYLOAD_BYTES + 1)),
    ],
)
def test_a_target_that_cannot_be_read_is_counted_and_nothing_else(desk, key, data):
    """Nobody waits for an answer to a target: it is counted and logged, and the loop goes on."""
    desk.inbox.put_target(key, data, "", 0)
    assert desk.inbox.poll() == [] and desk.inbox.malformed == 1


def test_streams_and_clients_are_bounded(desk):
    """Keys that a hostile client invents do not fill the memory."""
    for number in range(MAX_STREAMS + 10):
        desk.inbox.put_target(
            protocol.target_key("me", number, "s"), protocol.encode(protocol.Target(epoch=1, seq=1, values=Q)), "", 0
        )
    for number in range(MAX_CLIENTS + 10):
        desk.inbox.identities.meet(f"client{number}", "s")
        desk.inbox.put_keepalive(protocol.keepalive_key(f"client{number}", "s"), 0)
        desk.inbox.put_gone(f"client{number}", 0)
    assert desk.inbox.overflown == 30
    assert len(desk.inbox.poll()) == MAX_STREAMS + 2 * MAX_CLIENTS


@pytest.mark.parametrize(
    ("data", "code"),
    [
        (b"rubbish", "BAD_REQUEST"),
        (b"", "BAD_REQUEST"),
        (payload(protocol.Recover(), version=9), "UNSUPPORTED_VERSION"),
        (payload(protocol.Follow(epoch=1, points={"left": (Q[:3], Q)}, dt_s=0.1)), "WRONG_SHAPE"),
        (b"x" * (protocol.MAX_PAYLOAD_BYTES + 1), "BAD_REQUEST"),
    ],
)
def test_what_cannot_be_a_request_is_answered_at_once(desk, data, code):
    """The engine never sees it; the sender gets the code."""
    question = desk.ask(data)
    desk.run()
    assert question.code == code and desk.inbox.poll() == []


def test_a_flood_of_questions_is_refused_not_queued(desk):
    """More questions than anybody needs are told that they were not run; nothing is lost silently."""
    senders = [f"client{number % 32}" for number in range(MAX_WAITING + 5)]
    questions = [desk.ask(payload(protocol.Recover(), n, client_id=sender)) for n, sender in enumerate(senders)]
    desk.run()
    handed_out = [desk.inbox.poll() for _ in range(MAX_WAITING // PER_POLL + 1)]
    assert [len(events) for events in handed_out] == [PER_POLL] * (MAX_WAITING // PER_POLL) + [0]
    assert [q.code for q in questions[MAX_WAITING:]] == ["TIMEOUT"] * 5
    assert desk.inbox.overflown == 5


def test_a_flood_delays_only_the_client_that_sends_it(desk):
    """A few requests a tick, the clients in turn, each one's in its order: planning must not hold up the setpoints."""
    for number in range(40):
        desk.ask(payload(protocol.Recover(), number, client_id="flood"))
    desk.ask(payload(protocol.Recover(), 7, client_id="owner"))
    desk.ask(payload(protocol.Recover(), 8, client_id="owner"))
    desk.run()
    polls = [[(e.client_id, e.request_id) for e in desk.inbox.poll()] for _ in range(2)]
    assert polls[0] == [("flood", 0), ("owner", 7), ("flood", 1), ("owner", 8)]
    assert polls[1] == [("flood", n) for n in range(2, 6)]


def test_one_client_leaves_room_for_the_others(desk):
    """Its own flood is refused before anybody else's request is."""
    flood = [desk.ask(payload(protocol.Recover(), number, client_id="flood")) for number in range(MAX_OF_CLIENT + 3)]
    other = desk.ask(payload(protocol.Recover(), 1, client_id="other"))
    desk.run()
    assert [question.code for question in flood[MAX_OF_CLIENT:]] == ["TIMEOUT"] * 3 and not other.answers
    assert not any(question.answers for question in flood[:MAX_OF_CLIENT])


def test_whoever_owns_the_robot_is_heard_however_many_others_ask(desk):
    """At once, too, in his order, and in turn with whoever watches; his own flood is bounded all the same."""
    for number in range(MAX_WAITING):
        desk.ask(payload(protocol.Recover(), 1, client_id=f"client{number}"))
    desk.run()
    desk.inbox.identities.pinned = frozenset({"owner", "watcher", ""})
    late = desk.ask(payload(protocol.Recover(), 1, client_id="late"))
    mine = [desk.ask(payload(protocol.Recover(), number, client_id="owner")) for number in range(MAX_OF_CLIENT + 1)]
    theirs = [desk.ask(payload(protocol.Recover(), number, client_id="watcher")) for number in range(2)]
    desk.run()
    assert late.code == mine[-1].code == "TIMEOUT"
    assert not any(question.answers for question in (*mine[:-1], *theirs))
    polls = [[(event.client_id, event.request_id) for event in desk.inbox.poll()] for _ in range(2)]
    assert polls[0] == [("owner", 0), ("watcher", 0), ("owner", 1), ("client0", 1)]
    assert polls[1] == [("watcher", 1), ("owner", 2), ("owner", 3), ("client1", 1)]


def test_a_stop_gets_through_a_full_lane(desk):
    """When the loop hangs and requests pile up, a stop and an emergency stop still have their place."""
    for number in range(MAX_WAITING + 3):
        desk.ask(payload(protocol.Recover(), number))
        desk.run()
    stops = [desk.ask(payload(protocol.Stop(), 10_000 + number)) for number in range(MAX_WAITING + 3)]
    for _ in range(2):
        desk.run()
    estop = desk.ask(payload(protocol.Estop(), 99_999))
    desk.run()
    assert [type(e.request).__name__ for e in desk.inbox.poll()][:2] == ["Estop", "Stop"]
    assert estop.answers == [] and stops[0].answers == []


def test_a_request_that_was_given_up_does_not_run_later(desk):
    """Who was told that a command did not run can rely on it; a stop runs all the same."""
    late = desk.ask(payload(protocol.Recover(), 1), received_ns=0)
    stop = desk.ask(payload(protocol.Stop(), 2), received_ns=0)
    desk.run()
    desk.outbox.expire(protocol.REPLY_WITHIN_NS + 1)
    desk.run()
    assert late.code == "TIMEOUT" and "was not run" in late.reply.refusal.message and stop.code == "TIMEOUT"
    assert [type(event.request).__name__ for event in desk.inbox.poll()] == ["Stop"]


def test_complaints_are_logged_once_a_second(desk, caplog):
    """A client that sends rubbish at a high rate does not fill the log."""
    with caplog.at_level(logging.WARNING, logger=module.__name__):
        for n in range(2500):
            desk.inbox.ask(AskedQuestion(b"rubbish", received_ns=n * 1_000_000))
            desk.run()
    assert len(caplog.records) == 3 and desk.inbox.malformed == 2500


def test_what_a_client_sent_cannot_forge_lines_of_the_log(desk, caplog):
    """Names of fields and keys come from outside: in the log they are one short line of printable characters."""
    forged = b'{"version":1,"client_id":"a","request_id":1,"request":{"type":"recover","\\n\\u001b[2Jnow":1}}'
    with caplog.at_level(logging.WARNING, logger=module.__name__):
        desk.inbox.ask(AskedQuestion(forged, encoding=protocol.JSON, received_ns=0))
        desk.run()
        target = protocol.encode(protocol.Target(epoch=1, seq=1, values=Q))
        desk.inbox.put_target(f"{protocol.ROOT}/target/me\n/{'9' * 60_000}", target, "", 2_000_000_000)
        desk.inbox.poll()
    assert len(caplog.records) == 2 and desk.inbox.malformed == 2
    assert all(line.getMessage().isprintable() and len(line.getMessage()) < 500 for line in caplog.records)


def test_waiting_for_a_question_ends(desk):
    """sort() waits as long as it is told, and is woken."""
    assert desk.inbox.sort(0.01) is False
    desk.inbox.wake()
    assert desk.inbox.sort(10.0) is True
    assert Code.TIMEOUT.value == "TIMEOUT"


@pytest.fixture
def rung(desk):
    """How often the loop's rest was ended, in a list."""
    rung = []
    desk.inbox.on_arrival = lambda: rung.append(1)
    return rung


def test_a_request_ends_the_wait_of_a_loop_that_rests(desk, rung):
    """Whether it is a stop or any other; what was taken ends no wait any more."""
    for number, request in enumerate((protocol.Stop(), protocol.Estop(), protocol.Recover())):
        desk.ask(payload(request, number))
        desk.run()
        assert len(rung) == number + 1
        desk.inbox.poll()
        assert not desk.inbox.has_more


def test_requests_that_one_poll_left_end_the_next_wait(desk):
    """A poll hands out only so many: the rest of them must not wait for the rest of the loop."""
    for number in range(PER_POLL + 1):
        desk.ask(payload(protocol.Recover(), number))
    desk.run()
    assert len(desk.inbox.poll()) == PER_POLL
    assert desk.inbox.has_more
    assert len(desk.inbox.poll()) == 1
    assert not desk.inbox.has_more


@pytest.mark.parametrize("is_chunk", [False, True])
def test_whoever_is_heeded_keeps_nobody_away(desk, is_chunk):
    """Of four requests in a row three are the owner's or a stop endpoint's; a chunk of theirs counts as a poll."""
    desk.inbox.identities.pinned = frozenset({"me"})
    for number in range(20):
        desk.ask(chunk(number, client_id="me") if is_chunk else payload(protocol.Recover(), number, client_id="me"))
    desk.ask(payload(protocol.Recover(), 1))
    desk.run()
    served = [[event.client_id for event in desk.inbox.poll()] for _ in range(2)]
    assert served == ([["me"], ["c0ffee", "me"]] if is_chunk else [["me", "me", "me", "c0ffee"], ["me"] * 4])


def test_signs_of_life_and_targets_end_no_wait(desk, rung):
    """They come 20 to 100 times a second, and say nothing while nobody owns the robot."""
    desk.inbox.put_keepalive(protocol.keepalive_key("c0ffee", "s"), 6)
    desk.inbox.put_gone("other", 7)
    desk.inbox.put_target(protocol.target_key("c0ffee", 2, "s"), b"", "", 5)
    assert not rung and not desk.inbox.has_more


# ------------------------------------------------------------------------------------------------- chunks


def chunk(request_id, **kwargs):
    """A chunk as bytes."""
    return payload(protocol.Follow(epoch=1, points={"left": (Q, Q)}, dt_s=0.1), request_id, **kwargs)


def test_no_stop_waits_behind_chunks_that_are_still_to_be_worked_out(desk):
    """Whoever sends them: they are put aside until nothing else is left to read."""
    for number in range(4):
        desk.ask(chunk(number, client_id=f"c{number}"))
    desk.ask(payload(protocol.Stop(), 9))
    for _ in range(5):
        assert desk.inbox.sort(0)
    assert [type(event.request).__name__ for event in desk.inbox.poll()] == ["Stop"]
    desk.run()
    for _ in range(4):
        assert [type(event.request).__name__ for event in desk.inbox.poll()] == ["Follow"]


def test_what_a_client_sends_after_a_chunk_stays_after_it(desk):
    """A hold must not be overtaken by the chunk that it ends; other clients do not wait, and neither does a stop."""
    desk.ask(chunk(1))
    desk.ask(payload(protocol.Hold(epoch=1, sides=("left",)), 2))
    desk.ask(payload(protocol.Recover(), 1, client_id="other"))
    desk.ask(payload(protocol.Estop(), 3))
    desk.run()
    polls = [desk.inbox.poll() for _ in range(2)]
    arrived = [[(event.client_id, type(event.request).__name__) for event in poll] for poll in polls]
    assert arrived == [[("c0ffee", "Estop"), ("other", "Recover"), ("c0ffee", "Follow")], [("c0ffee", "Hold")]]


def test_a_chunk_is_the_last_request_of_its_poll(desk):
    """One tick plans the way of two arms onto one chunk, and no second one; what is only judged does not count so much."""
    checked = protocol.CheckFollow(follow=protocol.Follow(epoch=0, points={"left": (Q, Q)}, dt_s=0.1))
    for number in range(2):
        desk.ask(payload(checked, number, client_id="looks"))
        desk.ask(chunk(number))
    desk.run()
    kinds = [[type(event.request).__name__ for event in desk.inbox.poll()] for _ in range(3)]
    assert kinds == [["CheckFollow", "Follow"], ["CheckFollow", "Follow"], []]


def test_a_flood_of_chunks_is_refused(desk):
    """16 may wait; the others are told that they were not run."""
    checked = protocol.CheckFollow(follow=protocol.Follow(epoch=0, points={"left": (Q, Q)}, dt_s=0.1))
    questions = [desk.ask(payload(checked, n, client_id=f"client{n}")) for n in range(MAX_ASIDE + 3)]
    for _ in questions:
        assert desk.inbox.sort(0)
    assert desk.inbox.overflown == 3
    desk.run()
    assert [question.code for question in questions if question.answers] == ["TIMEOUT"] * 3
    assert len(desk.inbox.poll()) == PER_POLL


def test_one_clients_chunks_leave_room_for_the_others(desk):
    """Of one that many may wait."""
    questions = [desk.ask(chunk(number)) for number in range(MAX_ASIDE_OF_CLIENT + 2)]
    for _ in questions:
        assert desk.inbox.sort(0)
    desk.run()
    assert [question.code for question in questions if question.answers] == ["TIMEOUT"] * 2


def test_an_owners_chunk_waits_for_nobody_elses(desk):
    """It has room beside all others, and is worked out before them; so is what he sends behind it."""
    checked = protocol.CheckFollow(follow=protocol.Follow(epoch=0, points={"left": (Q, Q)}, dt_s=0.1))
    for number in range(MAX_ASIDE):
        desk.ask(payload(checked, number, client_id=f"client{number}"))
    mine = [desk.ask(chunk(1)), desk.ask(payload(protocol.Hold(epoch=1, sides=("left",)), 2))]
    desk.inbox.identities.pinned = frozenset({"c0ffee"})
    for _ in range(MAX_ASIDE + 4):
        assert desk.inbox.sort(0)
    assert not any(question.answers for question in mine)
    arrived = [(event.client_id, type(event.request).__name__) for event in (*desk.inbox.poll(), *desk.inbox.poll())]
    assert arrived[:2] == [("c0ffee", "Follow"), ("c0ffee", "Hold")]


def test_what_lies_aside_has_its_turn_however_much_there_is_to_read(desk):
    """Whoever asks without end keeps no chunk from being worked out."""
    desk.ask(chunk(1))
    assert desk.inbox.sort(0)
    for _ in range(READ_BETWEEN + 1):
        desk.ask(b"", key=protocol.INFO_KEY)
    for _ in range(READ_BETWEEN):
        assert desk.inbox.sort(0)
    assert [type(event.request).__name__ for event in desk.inbox.poll()] == ["Follow"]


def test_nobody_goes_by_another_door_than_his_own(desk):
    """A viewer at the port shows the token of an owner at the socket, and takes it back: the owner is there all the same."""
    desk.ask(payload(protocol.Recover(), 1, client_id="owner"))
    desk.run()
    desk.inbox.poll()
    for client_id, door, goes in (("owner", "network", False), ("owner", "socket", True), ("unheard", "network", True)):
        desk.inbox.put_gone(client_id, 7, door)
        assert [event.client_id for event in desk.inbox.poll()] == [client_id] * goes


def test_a_chunk_that_is_none_is_refused_without_the_loop(desk):
    """The first offending point is told by the thread that read it."""
    question = desk.ask(payload(protocol.Follow(epoch=1, points={"left": (Q, Q[:3])}, dt_s=0.1)))
    desk.run()
    assert question.code == "WRONG_SHAPE" and question.reply.refusal.field == "left_arm[1]"
    assert desk.inbox.poll() == []


def test_waiting_for_work_ends_when_something_lies_aside(desk):
    """The reader does not sleep over it."""
    desk.ask(chunk(1))
    assert desk.inbox.sort(10.0) and desk.inbox.sort(10.0)
    assert len(desk.inbox.poll()) == 1


def test_the_largest_chunk_fits_into_a_request(desk):
    """450 points of both arms with times, as msgpack."""
    lefts, rights = tuple([Q] * 450), tuple([HOME] * 450)
    request = protocol.Follow(
        epoch=2**62, points={"left": lefts, "right": rights}, times_s=tuple(0.1 * n for n in range(450))
    )
    sent = payload(request, 2**62, client_id="f" * 32)
    assert len(sent) <= protocol.MAX_PAYLOAD_BYTES
    question = desk.ask(sent)
    desk.run()
    assert not question.answers and len(desk.inbox.poll()) == 1
