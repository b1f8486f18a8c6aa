"""Streams of targets: one per arm, the newest target of their owner, and an end that is told."""

from __future__ import annotations

import math

import pytest

from gateway.core.body.targets import ENDED_KEPT, TargetBook, TargetStream
from gateway.core.messages.events import TargetArrived
from gateway.errors import Code
from gateway.messages.incoming import OnLimit
from gateway.messages.snapshot import TargetView
from gateway.robot.limits import HOME_Q_RAD, JOINT_UPPER_RAD
from gateway.settings.settings import ArmSettings
from gateway.values import Side, Space, Vector

MS = 1_000_000
S = 1_000_000_000
T0 = 1_000 * S
L, R = Side.LEFT, Side.RIGHT
GOAL = HOME_Q_RAD[L]
OUTSIDE: Vector = (9.0, *GOAL[1:])


@pytest.fixture
def book() -> TargetBook:
    """No stream yet."""
    return TargetBook(ArmSettings())


def opened(
    book: TargetBook, side: Side = L, on_limit: OnLimit = OnLimit.REJECT, expiry_ns: int | None = None
) -> TargetStream:
    """A stream of ann's under epoch 5."""
    return book.open(side, "ann", 5, 0.5, on_limit, expiry_ns)


def target(stream_id: int = 1, seq: int = 1, q_rad: Vector = GOAL, received_ns: int = T0, **who) -> TargetArrived:
    """A target of ann's under epoch 5, unless told otherwise."""
    return TargetArrived(
        stream_id=stream_id, seq=seq, values=q_rad, received_ns=received_ns, **{"client_id": "ann", "epoch": 5, **who}
    )


# ------------------------------------------------------------------------------------------------ the book


def test_an_opened_stream_is_its_arms_until_it_ends(book):
    """One open stream per arm; ids rise and are never given twice."""
    assert (book.of(L), book.running, book.views()) == (None, (), ())
    left, right = opened(book), opened(book, R)
    assert (left.stream_id, right.stream_id) == (1, 2)
    assert (book.of(L), book.of(R), book.running) == (left, right, (left, right))
    book.end(left, Code.CANCELLED)
    assert (book.of(L), book.running, book.find(1)) == (None, (right,), left)
    assert opened(book).stream_id == 3


def test_a_stream_remembers_what_it_was_opened_with(book):
    """Speed, limits and expiry hold for all of its targets; without a word the configured expiry does."""
    stream = opened(book, R, OnLimit.CLIP, 200 * MS)
    assert (stream.side, stream.client_id, stream.epoch) == (R, "ann", 5)
    assert (stream.speed, stream.on_limit, stream.expiry_ns) == (0.5, OnLimit.CLIP, 200 * MS)
    assert opened(book).expiry_ns == 1500 * MS


def test_a_stream_ends_once_and_says_why(book):
    """Whatever comes later, its end stays as it was told."""
    stream = opened(book)
    stream.limited = True
    book.end(stream, Code.CLIENT_LOST)
    book.end(stream, Code.ESTOP)
    assert (stream.is_open, stream.code, stream.limited) == (False, Code.CLIENT_LOST, False)


def test_ended_streams_stay_visible_until_others_take_their_place(book):
    """A client that looks late still learns how its stream ended; memory stays bounded."""
    for _ in range(ENDED_KEPT + 2):
        book.end(opened(book), Code.CANCELLED)
    first, last = opened(book), opened(book, R)
    book.end(last, Code.STOPPED)
    assert [view.stream_id for view in book.views()] == list(range(4, ENDED_KEPT + 5))
    assert book.find(3) is None and book.find(4) is not None and book.find(first.stream_id) is first


def test_a_view_tells_the_whole_stream(book):
    """In words and numbers that any encoder can write."""
    stream = opened(book)
    assert stream.view() == TargetView(
        stream_id=1, side="left", open=True, code="", seq=0, refused=0, refusal_code="", refusal_message="",
        limited=False, space="joint",
    )  # fmt: skip
    book.accept(target(seq=4))
    book.accept(target(seq=5, q_rad=OUTSIDE))
    stream.limited = True
    view = stream.view()
    assert (view.seq, view.refused, view.refusal_code, view.limited) == (4, 1, "OUT_OF_RANGE", True)
    assert "9.0000 rad" in view.refusal_message
    book.end(stream, Code.STOPPED)
    assert (stream.view().open, stream.view().code) == (False, "STOPPED")


# ------------------------------------------------------------------------------------------------ what is followed


def test_a_target_of_the_owner_is_followed(book):
    """Its goal, as it is, on the arm of its stream."""
    stream = opened(book)
    assert book.accept(target(seq=3, received_ns=T0 + 7)) == (stream, GOAL)
    assert (stream.seq, stream.received_ns, stream.refused) == (3, T0 + 7, 0)


def test_a_target_of_no_stream_is_nobodys(book):
    """A late packet of a stream that is not even remembered changes nothing."""
    stream = opened(book)
    assert book.accept(target(stream_id=9)) is None and stream.refused == 0


@pytest.mark.parametrize(("seq", "is_taken"), [(1, False), (6, False), (7, False), (8, True), (100, True)])
def test_an_older_target_is_never_followed(book, seq, is_taken):
    """Datagrams may overtake each other: only a higher number passes, and gaps do not matter."""
    stream = opened(book)
    book.accept(target(seq=7))
    assert (book.accept(target(seq=seq, received_ns=T0 + 1)) is not None) is is_taken
    assert (stream.seq, stream.received_ns) == ((seq, T0 + 1) if is_taken else (7, T0))
    if not is_taken:
        assert stream.refused == 1 and stream.refusal is not None
        refusal = stream.refusal
        assert (refusal.code, refusal.field, refusal.value, refusal.bound) == (Code.BAD_REQUEST, "seq", str(seq), "> 7")


@pytest.mark.parametrize("epoch", [0, 4, 6])
def test_a_target_of_another_epoch_is_refused(book, epoch):
    """An old epoch never passes (DESIGN §8.6)."""
    stream = opened(book)
    assert book.accept(target(epoch=epoch)) is None
    refusal = stream.refusal
    assert refusal is not None and stream.seq == 0
    assert (refusal.code, refusal.field, refusal.value, refusal.bound) == (Code.LEASE_STALE, "epoch", str(epoch), "5")


def test_another_clients_target_neither_moves_nor_disturbs(book):
    """It is not his stream: the owner's loop must not be told of refusals that are not its own."""
    stream = opened(book)
    assert book.accept(target(seq=50, client_id="bob")) is None
    assert (stream.refused, stream.refusal, stream.seq) == (0, None, 0)
    assert book.accept(target(seq=1)) is not None


def test_a_target_of_an_ended_stream_is_refused_with_the_reason_of_the_end(book):
    """Later targets get STREAM_ENDED (BEHAVIOUR, words: cut)."""
    stream = opened(book)
    book.end(stream, Code.CLIENT_LOST)
    assert book.accept(target()) is None
    assert stream.refusal is not None and stream.refusal.code is Code.STREAM_ENDED
    assert stream.refusal.message == "stream 1 ended with CLIENT_LOST"


@pytest.mark.parametrize(
    ("q_rad", "code"),
    [
        (OUTSIDE, Code.OUT_OF_RANGE),
        ((math.nan, *GOAL[1:]), Code.NOT_FINITE),
        (GOAL[:6], Code.WRONG_SHAPE),
        ((*GOAL, 0.0), Code.WRONG_SHAPE),
    ],
)
def test_a_target_passes_the_door_or_leaves_no_trace(book, q_rad, code):
    """A refused target neither counts as the newest nor keeps the one before it alive."""
    stream = opened(book)
    book.accept(target(seq=1))
    assert book.accept(target(seq=2, q_rad=q_rad, received_ns=T0 + S)) is None
    assert (stream.seq, stream.received_ns, stream.refused) == (1, T0, 1)
    assert stream.refusal is not None and stream.refusal.code is code
    assert book.accept(target(seq=2)) == (stream, GOAL)


def test_a_stream_that_asked_for_clipping_is_clipped(book):
    """Opt-in, per stream; the limits are those of its own arm."""
    stream = opened(book, R, OnLimit.CLIP)
    assert book.accept(target(q_rad=(9.0,) * 7)) == (stream, JOINT_UPPER_RAD[R])
    assert stream.refused == 0


# ------------------------------------------------------------------------------------------------ expiry


def test_a_target_expires_once_when_no_successor_comes(book):
    """Longer than its lifetime ago: told once, so that the arm brakes once (BEHAVIOUR, values)."""
    stream, silent = opened(book, expiry_ns=300 * MS), opened(book, R)
    book.accept(target())
    assert book.expired(T0 + 300 * MS) == []
    assert book.expired(T0 + 300 * MS + 1) == [stream]
    assert book.expired(T0 + 10 * S) == [], "and a stream that never had a target has none to expire"
    assert stream.is_open and silent.is_open


def test_a_successor_keeps_a_stream_alive_and_revives_it(book):
    """The next target goes on after an expiry; the stream is still open."""
    stream = opened(book, expiry_ns=300 * MS)
    for n in range(5):
        book.accept(target(seq=n + 1, received_ns=T0 + n * 200 * MS))
        assert book.expired(T0 + n * 200 * MS + 250 * MS) == []
    assert book.expired(T0 + 2 * S) == [stream]
    book.accept(target(seq=6, received_ns=T0 + 2 * S))
    assert book.expired(T0 + 2 * S + 300 * MS) == []
    assert book.expired(T0 + 3 * S) == [stream]


def test_targets_at_1_hz_are_legal(book):
    """The default lifetime of 1.5 s bridges them (BEHAVIOUR, values)."""
    opened(book)
    for n in range(10):
        book.accept(target(seq=n + 1, received_ns=T0 + n * S))
        assert book.expired(T0 + n * S + 999 * MS) == []


def test_an_ended_stream_does_not_expire(book):
    """Its arm has braked already."""
    stream = opened(book)
    book.accept(target())
    book.end(stream, Code.STOPPED)
    assert book.expired(T0 + 10 * S) == []


def test_a_stream_of_poses_takes_poses(book):
    """Checked as such: reach and norm; the quaternion is normalised."""
    stream = book.open(L, "ann", 5, 1.0, OnLimit.REJECT, None, Space.POSE)
    assert stream.view().space == "pose"
    pose = (0.3, 0.0, -0.2, 0.0, 0.0, 0.6, 0.8)
    assert book.accept(target(q_rad=pose)) == (stream, pytest.approx(pose))
    assert book.accept(target(seq=2, q_rad=(0.5, 0.5, 0.0, 0.0, 0.0, 0.0, 1.0))) is None
    assert stream.refusal.field == "left_arm.p_m" and stream.refused == 1


def test_settings_that_were_read_anew_are_those_of_the_next_stream(book):
    """An open one lives as it was opened."""
    first = opened(book)
    book.renew(ArmSettings(target_expiry_ns=200 * MS))
    assert (first.expiry_ns, opened(book, R).expiry_ns) == (ArmSettings().target_expiry_ns, 200 * MS)
