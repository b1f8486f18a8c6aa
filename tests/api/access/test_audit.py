"""Tests of the audit log: what is written, that nobody waits for it, and what a full or hung disk does: nothing."""

from __future__ import annotations

import contextlib
import json
import os
import stat
import threading
import time
import weakref

import pytest

from gateway.api import protocol
from gateway.api.access import audit as module
from gateway.api.access.audit import KEPT, LINE_NS, LINES_AT_ONCE, MAX_WAITING, MOST_CLIENTS, TEXT_CHARS, Audit
from gateway.api.access.roles import Asker
from gateway.api.identities import RESERVED, Identities
from gateway.api.outbox import Outbox
from gateway.api.stop_lane import READ_BYTES, StopLane
from gateway.api.translate import describe
from gateway.client import connect
from gateway.core.messages import outputs
from gateway.errors import Code
from gateway.process.threads import take_lost
from gateway.settings.settings import Settings
from gateway.values import Role
from tests.api.daemon import Daemon, eventually
from tests.api.desk import AskedQuestion
from tests.api.samples import REQUESTS, command

ANN = Asker(door="network", user="ann", role=Role.OPERATOR)
HEAD = {"door": "network", "user": "ann", "role": "operator"}


def written(path):
    """Return the lines of a file; blank ones are none."""
    return [line for line in path.read_text().splitlines() if line] if path.is_file() else []


class Book:
    """An audit log, its file and its stop lane."""

    def __init__(self, path, most_bytes=10**6):
        self.path = path
        self.lane = StopLane()
        weakref.finalize(self, self.lane.close)
        self.audit = Audit(str(path), most_bytes, self.lane)
        self.audit.start()

    def lines(self, number=1):
        """Return the lines that were written, as soon as there are so many."""

        def whole():
            found = written(self.path)
            return found if len(found) >= number else None

        return [json.loads(line) for line in eventually(whole, 20.0)]

    def ask(self, request, number=1, asker=ANN, answer=None):
        """Ask for something and have it answered."""
        question = AskedQuestion(received_ns=time.monotonic_ns())
        question.asker = asker
        envelope = command(request, number, client_id="c1")
        reply = protocol.Reply(request_id=number) if answer is None else answer
        self.audit.watched(question, envelope).answer(protocol.encode(reply), protocol.MSGPACK)
        return question


@pytest.fixture
def book(tmp_path):
    """An audit log that writes."""
    book = Book(tmp_path / "audit.jsonl")
    yield book
    book.audit.close(5.0)


def test_each_request_has_a_line_that_says_who_when_what_and_the_answer(book):
    """Refusals, too; nothing of points and targets is in it."""
    book.ask(protocol.Acquire(name="policy", pid=7), answer=protocol.Reply(request_id=1, facts={"epoch": 4}))
    refusal = protocol.RefusalMessage(code="NOT_ENABLED", message="the arms are not enabled")
    book.ask(
        protocol.Move(epoch=4, targets_rad={"left": (0.0,) * 7}),
        2,
        answer=protocol.Reply(request_id=2, refusal=refusal),
    )
    first, second = book.lines(2)
    who = {**HEAD, "client": "c1"}
    assert first.pop("at").endswith("+00:00") and first.pop("at_ns") > 0
    assert first == {**who, "request": "Acquire", "name": "policy", "pid": 7, "answer": "ok", "epoch": 4}
    del second["at"], second["at_ns"]
    assert second == {**who, "request": "Move", "epoch": 4, "answer": "NOT_ENABLED", "message": refusal.message}
    assert stat.S_IMODE(os.stat(book.path).st_mode) == 0o600


def test_every_request_there_is_can_be_written(book):
    """Whatever its fields are."""
    for number, request in enumerate(REQUESTS):
        book.ask(request, number)
    assert [line["request"] for line in book.lines(len(REQUESTS))] == [type(each).__name__ for each in REQUESTS]


def test_what_cannot_be_read_or_gets_no_answer_has_a_line(book):
    """Nobody hides behind nonsense."""
    question = AskedQuestion(b"\xff")
    book.audit.watched(question).drop()
    (line,) = book.lines()
    assert question.dropped and (line["request"], line["answer"]) == ("unread", "none")


def test_stops_are_written_whichever_way_they_come(book):
    """With who says so and why, as far as it can be read; a payload that is too long is not kept."""
    book.audit.note_stop(protocol.ESTOP_KEY, b'{"name": "page", "reason": "smoke"}', 5, "pipe")
    book.audit.note_stop(protocol.STOP_KEY, b"x" * (READ_BYTES + 9), 5, "network")
    question = AskedQuestion(b"a hand", protocol.STOP_KEY)
    reply = protocol.encode(protocol.Reply(request_id=1))
    book.audit.watched(question).answer(reply, protocol.MSGPACK)
    assert len(question.answers) == 1
    lines = book.lines(3)
    assert [line["request"] for line in lines] == ["Estop", "Stop", "Stop"]
    assert (lines[0]["client"], lines[0]["reason"], lines[0]["door"]) == ("'page'", "smoke", "pipe")
    assert lines[1]["client"] == "somebody" and "reason" not in lines[1] and "user" not in lines[1]
    assert (lines[2]["reason"], lines[2]["answer"]) == ("a hand", "ok")


def test_a_stop_of_a_proven_client_has_its_id_and_its_name(book):
    """The id joins the lines of one connection; of a stop that nobody has proven there is what it calls itself."""
    book.lane.proven = lambda client_id, secret: (client_id, secret) == ("c1", "s3cret")
    payload = b'{"client_id": "c1", "secret": "s3cret", "name": "page", "reason": "smoke"}'
    book.audit.note_stop(protocol.STOP_KEY, payload, 5, "pipe")
    (line,) = book.lines()
    assert (line["client"], line["name"], line["reason"]) == ("c1", "page", "smoke")


def test_a_flood_of_one_hides_nobody_else(book):
    """Each user, and stops, have lines of their own; what was too much is counted in the next line."""
    for number in range(4 * LINES_AT_ONCE):
        book.ask(protocol.Recover(), number)
    book.ask(protocol.Recover(), 1, Asker(door="network", user="bob"))
    book.audit.note_stop(protocol.STOP_KEY, b"", 5, "pipe")
    lines = book.lines(LINES_AT_ONCE + 2)
    assert {"bob", "ann"} <= {line.get("user") for line in lines} and any(line["request"] == "Stop" for line in lines)
    assert sum(line.get("lost", 0) for line in lines) == book.audit.lost > 0


@pytest.mark.parametrize(
    "drive",
    [protocol.DriveChassis(epoch=4, vx_mps=0.1, vy_mps=0.0, wz_radps=0.0), protocol.DriveLift(epoch=4, velocity=1.0)],
)
def test_driving_hides_nothing_else_that_its_driver_asks_for(book, drive):
    """A velocity that is taken is one of many. One that is refused is a line as any other."""
    for number in range(2 * LINES_AT_ONCE):
        book.ask(drive, number)
    assert book.audit.lost
    refusal = protocol.RefusalMessage(code="NOT_OWNER", message="bob owns the robot")
    book.ask(drive, 1, answer=protocol.Reply(request_id=1, refusal=refusal))
    book.ask(protocol.Recover(), 2)
    lines = [line for line in book.lines(LINES_AT_ONCE + 2) if line["answer"] != "ok" or line["request"] == "Recover"]
    assert [line["request"] for line in lines] == [type(drive).__name__, "Recover"]


def test_whoever_floods_for_long_wears_no_earlier_lines_out(book, monkeypatch):
    """Some at once, then one a second, each of bounded length whatever is asked."""
    now_ns = time.monotonic_ns()
    monkeypatch.setattr(module.time, "monotonic_ns", lambda: now_ns)
    text = "\x01\u2028\U0001f600\n" * 1000
    for _ in range(10):
        for number in range(2 * LINES_AT_ONCE):
            book.ask(protocol.Take(name=text, pid=1, reason=text), number)
        now_ns += LINE_NS
    lines = book.lines(LINES_AT_ONCE + 9)
    book.audit.close(5.0)
    assert len(written(book.path)) == len(lines) == LINES_AT_ONCE + 9
    assert {len(line["reason"]) for line in lines} == {len(line["name"]) for line in lines} == {TEXT_CHARS}
    assert max(map(len, written(book.path))) < 1000 and lines[0]["name"].isprintable()


def test_clients_of_the_socket_have_lines_of_their_own(book, monkeypatch):
    """The ids cost nothing, so only so many have; users have theirs all the same, and who is silent makes room."""
    now_ns = time.monotonic_ns()
    monkeypatch.setattr(module.time, "monotonic_ns", lambda: now_ns)

    def ask(client_id, number=1, asker=None):
        before = book.audit.lost
        for _ in range(number):
            question = AskedQuestion(received_ns=now_ns)
            question.asker = asker or Asker(door="socket")
            book.audit.watched(question, command(protocol.Recover(), 1, client_id=client_id)).drop()
        return book.audit.lost - before

    assert ask("flood", 3 * LINES_AT_ONCE) == 2 * LINES_AT_ONCE and ask("a") == 0
    assert [ask(f"made up {number}") for number in range(MOST_CLIENTS - 2)] == [0] * (MOST_CLIENTS - 2)
    assert ask("b", LINES_AT_ONCE) == 0 and ask("c") == 1
    assert ask("c", asker=ANN) == 0
    now_ns += 2 * LINE_NS
    assert ask("c", LINES_AT_ONCE) == 0
    nobody = Asker(door="network", role=Role.VIEWER)
    assert ask("d", LINES_AT_ONCE, nobody) == 0 and ask("e", 3, nobody) == 3, "who has no role has them under any id"


def test_what_nobody_foresaw_costs_a_line_and_nothing_else(book, monkeypatch, caplog):
    """Nobody's robot stops because a line cannot be written; the log says why."""
    with monkeypatch.context() as later:
        later.setattr(module.msgspec.json, "encode", lambda line: {}["unforeseen"])
        book.ask(protocol.Recover())
        eventually(lambda: book.audit.lost == 1, 20.0)
    book.ask(protocol.Recover())
    assert book.lines()[0]["lost"] == 1 and "KeyError: 'unforeseen'" in caplog.text
    with monkeypatch.context() as later:
        later.setattr(book.audit, "_append", lambda line, is_whole: _panic())
        book.ask(protocol.Recover())
        eventually(lambda: "ended unasked" in caplog.text, 20.0)
    book.ask(protocol.Recover())
    assert len(book.lines(2)) == 2 and not take_lost()


def test_a_file_that_is_full_is_set_aside_and_so_many_are_kept(tmp_path):
    """All of them together are bounded, and no line is in two of them."""
    book = Book(tmp_path / "audit.jsonl", most_bytes=600)
    for number in range(40):
        book.ask(protocol.Recover(), number)
    book.audit.close(20.0)
    names = sorted(path.name for path in tmp_path.iterdir())
    assert names == ["audit.jsonl", *(f"audit.jsonl.{number}" for number in range(1, KEPT + 1))]
    for path in tmp_path.iterdir():
        assert path.stat().st_size <= 600 and all(json.loads(line) for line in written(path))


def test_half_a_line_of_an_earlier_run_stays_alone(tmp_path):
    """The next line begins on its own: one that is torn costs one."""
    path = tmp_path / "audit.jsonl"
    path.write_text('{"at": "20')
    book = Book(path)
    book.ask(protocol.Recover())
    book.audit.close(20.0)
    torn, line = written(path)
    assert torn == '{"at": "20' and json.loads(line)["request"] == "Recover"


def test_a_file_that_was_moved_away_is_begun_anew(book):
    """As others rotate it."""
    book.ask(protocol.Recover())
    book.lines()
    book.path.rename(book.path.with_name("old"))
    book.ask(protocol.Recover())
    assert len(book.lines()) == 1


def test_a_link_is_not_followed(tmp_path, caplog):
    """Nobody leads the daemon to write into another file."""
    (tmp_path / "other").write_text("mine")
    path = tmp_path / "audit.jsonl"
    path.symlink_to("other")
    book = Book(path)
    book.ask(protocol.Recover())
    eventually(lambda: book.audit.lost)
    book.audit.close(5.0)
    assert (tmp_path / "other").read_text() == "mine" and "cannot be written" in caplog.text


def test_a_full_disk_is_told_once_and_costs_lines(caplog):
    """It goes on trying; the log says so at most every ten seconds."""
    lane = StopLane()
    audit = Audit("/dev/full", 10**6, lane)
    audit.start()
    for number in range(5):
        audit.note_stop(protocol.STOP_KEY, b"", number, "pipe")
    eventually(lambda: audit.lost == 5, 20.0)
    audit.close(5.0)
    lane.close()
    assert caplog.text.count("the audit log /dev/full cannot be written") == 1


def test_a_part_of_a_line_counts_as_lost(tmp_path, monkeypatch):
    """A disk with room for a few bytes."""
    monkeypatch.setattr(module.os, "write", lambda file, line: 3)
    book = Book(tmp_path / "audit.jsonl")
    book.ask(protocol.Recover())
    eventually(lambda: book.audit.lost == 1)
    book.audit.close(5.0)


def test_a_wall_clock_that_is_absurd_costs_a_line_and_nothing_else(tmp_path, monkeypatch):
    """Whoever notes a stop does not read it: that may be the control loop."""
    book = Book(tmp_path / "audit.jsonl")
    with monkeypatch.context() as later:
        later.setattr(module.time, "time_ns", lambda: 10**30)
        book.audit.note_stop(protocol.STOP_KEY, b"", 1, "pipe")
        eventually(lambda: book.audit.lost == 1, 20.0)
    book.audit.note_stop(protocol.STOP_KEY, b"", 1, "pipe")
    assert book.lines()[0]["lost"] == 1
    book.audit.close(5.0)


def test_without_a_file_nothing_is_watched():
    """Off by default: a question is what it was."""
    lane = StopLane()
    audit = Audit("", 10**6, lane)
    audit.start()
    question = AskedQuestion()
    assert audit.watched(question, command(protocol.Recover())) is question and audit.watched(question) is question
    audit.note_stop(protocol.STOP_KEY, b"", 1, "pipe")
    assert audit.lost == 0
    audit.close(5.0)
    lane.close()


@pytest.mark.e2e
@pytest.mark.parametrize("disk", ["full", "hung"])
def test_a_person_stops_while_the_disk_is_full_or_hangs(tmp_path, disk):
    """Requests, stops by zenoh and by the pipe are served as ever; memory stays bounded; and the daemon ends."""
    path = tmp_path / "audit.fifo"
    os.mkfifo(path)  # whoever opens it to write waits until somebody reads: nobody does
    with Daemon(tmp_path, audit_log="/dev/full" if disk == "full" else str(path)) as daemon:
        audit = daemon.plane._audit
        with connect(str(daemon.socket), timeout_s=20) as robot:
            robot.recover()
            for _ in range(3):
                robot.stop()
            robot.estop()
            robot.recover()
        assert {"Stop", "Estop", "Recover"} <= set(daemon.engine.names())
        for number in range(MAX_WAITING + 500):
            audit._put(f"user {number}", 1, ANN, dict)
        assert audit._waiting.qsize() <= MAX_WAITING
        eventually(lambda: audit.lost > 0, 20.0)
    threads = {thread.name for thread in threading.enumerate()}
    assert ("ta2-api-audit" in threads) is (disk == "hung")
    if disk == "hung":
        reader = os.open(path, os.O_RDONLY | os.O_NONBLOCK)  # it was waiting for us: what it still has to say, it says
        eventually(lambda: _drained(reader) and not audit._thread.is_alive(), 20.0)
        os.close(reader)


def _panic():
    raise BaseException("of a compiled part")


def _drained(reader):
    with contextlib.suppress(BlockingIOError):
        while os.read(reader, 65536):
            pass
    return True


def test_ids_that_stand_for_nobody_are_nobodys():
    """A client of that name would pass for whoever stopped without one, and undo it."""
    identities = Identities()
    assert {"somebody", "stranger"} == RESERVED
    assert not any(identities.meet(name, "s") or identities.is_proven(name, "s") for name in RESERVED)


def test_the_answer_of_the_engine_reaches_the_line(book):
    """The desk between them keeps the one who watches."""
    outbox = Outbox(describe(Settings(), socket="/s", pid=1), book.lane)
    question = book.audit.watched(AskedQuestion(received_ns=3), command(protocol.Recover(), 9))
    assert outbox.expect("c0ffee", 9, question)
    refusal = outputs.Reply(client_id="c0ffee", request_id=9)
    outbox.send([refusal], [])
    assert outbox.deliver(0)
    assert book.lines()[0]["answer"] == "ok" and Code.NOT_PERMITTED


def test_a_reading_of_the_settings_is_written_with_its_outcome(book):
    """Nobody is named: only this user, and root, can send the signal for it."""
    book.audit.note_reading("arm.v_radps = 0.5", 5, is_refused=False)
    book.audit.note_reading("needs a restart: arm.rate_hz", 6, is_refused=True)
    taken, refused = book.lines(2)
    assert (taken["request"], taken["door"], taken["answer"], taken["message"]) == (
        "Reload", "signal", "ok", "arm.v_radps = 0.5",
    )  # fmt: skip
    assert refused["answer"] == "SETTINGS_REFUSED" and refused["at_ns"] == 6
    Audit("", 1, book.lane).note_reading("m", 5, is_refused=False)
