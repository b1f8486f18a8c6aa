"""Tests of the lane of stops: whatever arrives on their keys is the stop."""

from __future__ import annotations

import pytest

from gateway.api import protocol
from gateway.api.stop_lane import ANSWERING_NS, FIRST_NUMBER, MAX_SHARING, MAX_WAITING, READ_BYTES, StopLane
from gateway.core.messages import outputs
from gateway.messages import requests
from tests.api.desk import AskedQuestion, Desk
from tests.api.samples import command

S = 1_000_000_000


@pytest.fixture
def lane():
    """A lane on which one client is proven by its secret."""
    lane = StopLane()
    lane.proven = lambda client_id, secret: (client_id, secret) == ("c0ffee", "s3cret")
    yield lane
    lane.close()


SPOILT = {
    "nothing": b"",
    "ten bytes": b"0123456789",
    "a later version": protocol.encode({"version": 99, "client_id": "a", "request_id": 1, "request": {"type": "x"}}),
    "an unknown field": protocol.encode({"reason": "r", "colour": [1, {}]}),
    "a dot in the id": protocol.encode({"client_id": "web.page"}),
    "65 characters": protocol.encode({"client_id": "x" * 65}),
    "no number": protocol.encode({"client_id": "a", "request": {"type": "stop"}}),
    "a long reason": protocol.encode({"reason": "x" * 3000}),
    "a null reason": protocol.encode({"reason": None}, protocol.JSON),
    "json without its encoding": b'{"reason": "r"}',
    "a lone surrogate": b'{"reason": "\\ud800"}',
    "no text": b"\xff\xfe\x00",
    "cut off": protocol.encode({"reason": "rrrr"})[:-2],
    "numbers for names": b"\x82\x01\x02\x03\x04",
    "nested without end": b"[" * 4000,
    "64 kB": b"x" * 65536,
}


@pytest.mark.parametrize("key", [protocol.STOP_KEY, protocol.ESTOP_KEY])
@pytest.mark.parametrize("payload", SPOILT.values(), ids=SPOILT)
def test_whatever_arrives_is_the_stop(lane, key, payload):
    """No version, field, number, encoding, text or size keeps a stop away, with a question or without one."""
    question = AskedQuestion(payload, key)
    lane.arrive(key, payload, 5, question)
    lane.arrive(key, payload, 6)
    first, second = lane.poll()
    kind = requests.Estop if key == protocol.ESTOP_KEY else requests.Stop
    assert type(first.request) is type(second.request) is kind
    assert (first.received_ns, second.received_ns) == (5, 6)
    assert lane.answer(outputs.Reply(client_id=first.client_id, request_id=first.request_id, facts={"n": 1}), 3)
    assert lane.deliver(0) and not question.dropped
    assert question.reply.facts == {"n": 1} and question.reply.after_seq == 3


@pytest.mark.parametrize(
    ("payload", "client_id", "reason"),
    [
        (b"", "somebody", ""),
        (b"smoke!", "somebody", "smoke!"),
        (b'"smoke!"', "somebody", "smoke!"),
        (b'{"reason": "smoke!", "name": "page"}', "'page'", "smoke!"),
        (protocol.encode({"reason": "a\nb", "client_id": "c0ffee"}), "'c0ffee'", "a?b"),
        (protocol.encode({"client_id": "c0ffee", "secret": "guess"}), "'c0ffee'", ""),
        (protocol.encode({"client_id": "c0ffee", "secret": "s3cret", "name": "me"}), "c0ffee", ""),
        (b"x" * (READ_BYTES + 1), "somebody", ""),
        (b"smoke\r", "somebody", "smoke"),
    ],
)
def test_name_and_reason_are_read_as_far_as_they_can_be(lane, payload, client_id, reason):
    """Nobody is taken for a client by what he calls himself, only by its secret."""
    lane.arrive(protocol.STOP_KEY, payload, 0)
    (stop,) = lane.poll()
    assert (stop.client_id, stop.request.reason) == (client_id, reason)


def test_the_name_of_a_proven_client_comes_along_and_stands_beside_its_id(lane):
    """Who asks is his id, of which nobody can make anything: people are told the name. Bounded, and printable."""
    who = {"client_id": "c0ffee", "secret": "s3cret"}
    lane.arrive(protocol.STOP_KEY, protocol.encode({**who, "name": "bob\n" + "x" * 100}), 0)
    lane.arrive(protocol.STOP_KEY, protocol.encode({**who, "name": 7}), 0)
    lane.arrive(protocol.STOP_KEY, protocol.encode({**who, "secret": "guess", "name": "bob"}), 0)
    assert [(stop.client_id, stop.name) for stop in lane.poll()] == [
        ("c0ffee", "bob?" + "x" * 60),
        ("c0ffee", ""),
        ("'bob'", ""),
    ]


@pytest.mark.parametrize(
    "payload",
    [
        b'{"client_id": "c0ffee", "secr',
        b' \n{"x',
        b'nt_id": "c0ffee", "secret": "s3cret"}',
        b'"Secret: s3cret"',
        b'[{"secret": "s3cret"}]',
        '{"secret": "s3cret"}'.encode("utf-16"),
        protocol.encode({"client_id": "c0ffee", "secret": "s3cret"})[:-1],
        protocol.encode({"client_id": "c0ffee", "secret": "s3cret"})[1:],
    ],
)
def test_what_may_be_a_part_of_a_map_is_a_stop_without_a_reason(lane, payload):
    """Reasons are shown to everybody: nobody's secret gets there because his line was cut."""
    lane.arrive(protocol.STOP_KEY, payload, 0)
    (stop,) = lane.poll()
    assert stop.request == requests.Stop() and stop.client_id == "somebody"


def test_an_emergency_stop_comes_before_a_stop(lane):
    """Whatever came first."""
    for key in (protocol.STOP_KEY, protocol.ESTOP_KEY, protocol.STOP_KEY):
        lane.arrive(key, b"", 0)
    assert [type(stop.request) for stop in lane.poll()] == [requests.Estop, requests.Stop, requests.Stop]


def test_a_flood_of_stops_is_bounded_and_each_of_them_is_answered(lane):
    """Those beyond the bound share one stop and its answer; an e-stop behind them is not lost among them."""
    asked = [AskedQuestion(key=protocol.STOP_KEY) for _ in range(MAX_WAITING + MAX_SHARING + 1)]
    for question in asked:
        lane.arrive(protocol.STOP_KEY, b"", 0, question)
    lane.arrive(protocol.STOP_KEY, b"", 0)
    lane.arrive(protocol.ESTOP_KEY, b"", 0)
    stops = lane.poll()
    assert len(stops) == MAX_WAITING + 2 and isinstance(stops[0].request, requests.Estop)
    for stop in stops:
        assert lane.answer(outputs.Reply(client_id=stop.client_id, request_id=stop.request_id), 0)
    while lane.deliver(0):
        pass
    assert sum(question.dropped for question in asked) == 1  # it stopped all the same
    assert all(len(question.answers) == 1 for question in asked if not question.dropped)
    assert lane.poll() == [] and lane.taken == len(asked) + 2


@pytest.mark.parametrize("asks", [False, True])
def test_a_stop_behind_many_of_the_owners_is_not_taken_for_one_of_them(lane, asks):
    """His own latches nothing: what is joined is a stop that nobody has proven to be his, and latches."""
    lane.proven = lambda client_id, secret: (client_id, secret) == ("owner", "s3cret")
    own = b'{"client_id": "owner", "secret": "s3cret"}'
    for _ in range(MAX_WAITING + 1):
        lane.arrive(protocol.STOP_KEY, own, 0)
    ann = AskedQuestion(key=protocol.STOP_KEY) if asks else None
    lane.arrive(protocol.STOP_KEY, b'{"name": "ann", "reason": "smoke"}', 0, ann)
    stops = lane.poll()
    assert [stop.client_id for stop in stops] == [*["owner"] * MAX_WAITING, "'owner'"]
    if ann is not None:
        lane.answer(outputs.Reply(client_id=stops[-1].client_id, request_id=stops[-1].request_id), 0)
        assert lane.deliver(0) and len(ann.answers) == 1 and not lane._questions


def test_a_stop_that_comes_while_the_loop_takes_those_before_it_is_answered_too(lane):
    """It was to share the newest one's answer, which was given meanwhile."""

    class Slow(str):
        """A key; the loop takes and answers everything while it is looked at."""

        def __eq__(self, other):
            for stop in lane.poll():
                lane.answer(outputs.Reply(client_id=stop.client_id, request_id=stop.request_id), 0)
            return str.__eq__(self, other)

        __hash__ = str.__hash__

    for _ in range(MAX_WAITING):
        lane.arrive(protocol.STOP_KEY, b"", 0)
    question = AskedQuestion(key=protocol.STOP_KEY)
    lane.arrive(Slow(protocol.STOP_KEY), b"", 0, question)
    assert lane.has_waiting and lane.wait(0)
    (stop,) = lane.poll()
    lane.answer(outputs.Reply(client_id=stop.client_id, request_id=stop.request_id), 0)
    assert lane.deliver(0) and len(question.answers) == 1 and not lane._questions


def test_a_stop_ends_the_wait_of_the_loop(lane):
    """The bell rings once for all that has come; what was polled already does not ring again."""
    assert not lane.wait(0)
    woken = []
    lane.on_arrival = lambda: woken.append(1)
    lane.arrive(protocol.STOP_KEY, b"", 0)
    lane.arrive(protocol.STOP_KEY, b"", 0)
    assert lane.wait(10) and not lane.wait(0) and len(woken) == 2
    lane.arrive(protocol.STOP_KEY, b"", 0)
    assert len(lane.poll()) == 3 and not lane.wait(0)


def test_answers_to_other_requests_pass_by(lane):
    """Numbers of stops are above those that a client can give."""
    assert not lane.answer(outputs.Reply(client_id="a", request_id=FIRST_NUMBER - 1), 0)


def test_what_lies_in_the_inbox_keeps_no_stop_away():
    """A thousand requests that wait to be read, and an outbox that sends nothing, do not come before it."""
    desk = Desk()
    for number in range(2000):
        desk.ask(protocol.encode(command(protocol.Recover(), number)))
    question = AskedQuestion(key=protocol.ESTOP_KEY)
    desk.stops.arrive(protocol.ESTOP_KEY, b"", 0, question)
    (stop,) = desk.stops.poll()
    desk.outbox.send([outputs.Reply(client_id=stop.client_id, request_id=stop.request_id)], [])
    assert desk.stops.deliver(0) and question.reply.refusal is None


def test_it_closes():
    """The bell's files are given back."""
    lane = StopLane()
    lane.wake()
    assert lane.deliver(1.0)
    lane.close()


def pings(lane, received_ns, count=MAX_WAITING + 1):
    """Ask so often, all in the same moment."""
    questions = [AskedQuestion(key=protocol.PING_KEY, received_ns=received_ns) for _ in range(count)]
    for question in questions:
        lane.ping(question)
    return questions


def test_a_ping_is_answered_as_a_stop_is_and_stops_nothing(lane):
    """By the thread that answers stops, with nothing; while that answers none, more of them than anybody needs are dropped."""
    questions = pings(lane, 10 * S)
    assert not lane.wait(0) and lane.poll() == [] and lane.taken == 0
    while lane.deliver(0):
        pass
    assert [question.answers for question in questions] == [[(b"", "")]] * MAX_WAITING + [[]]
    assert questions[-1].dropped


def test_nobody_can_make_the_answering_thread_look_dead_by_asking(lane):
    """In a crowd a ping is answered at once while that thread answers others; when it does not, none is."""
    pings(lane, 10 * S)
    assert lane.deliver(0)
    pings(lane, 10 * S, 1)  # as many wait as may
    (crowded,) = pings(lane, 10 * S + ANSWERING_NS - 1, 1)
    assert crowded.answers == [(b"", "")] and not crowded.dropped
    (later,) = pings(lane, 10 * S + ANSWERING_NS, 1)
    assert later.dropped and not later.answers
