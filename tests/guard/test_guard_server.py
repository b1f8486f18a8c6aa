"""The guard's socket and who comes to it: stops while it acts, a daemon that takes the hold over, and everybody else."""

from __future__ import annotations

import contextlib
import os
import select
import socket
import stat
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgspec
import pytest

from gateway.api.guard_protocol import (
    MAX_PACKET_BYTES,
    GuardAnswer,
    GuardQuestion,
    guard_socket,
    packed,
    read_answer,
    read_dropped,
    read_question,
    robot_name,
)
from gateway.api.keys import ESTOP_KEY, STOP_KEY
from gateway.api.stop_pipe import drop_stop
from gateway.client.asking import guard_stop
from gateway.client.asking.guard_stop import stop_at_guard
from gateway.client.asking.results import StopResult
from gateway.core.engine import Engine
from gateway.core.guardian import Phase
from gateway.core.messages.events import CommandRequested, GuardSeen, HeldElsewhere, TakenOver
from gateway.errors import Code
from gateway.guard import guard_server
from gateway.guard.guard_server import MOST_CALLERS, MOST_NEWCOMERS, GuardServer
from gateway.guard.successor import HoldSuccessor
from gateway.messages.requests import Estop
from gateway.robot.limits import HOME_Q_RAD
from gateway.settings.settings import Settings
from tests.behaviour.scene import LEAN
from tests.guarded import Guarded
from tests.pair import S

ROBOT = robot_name("tcp/192.168.1.30:9000", "/lab/")


class Place:
    """A guard's server and a guardian, in one process; virtual time."""

    def __init__(self, folder: Path, *, is_acting: bool = True) -> None:
        self.path = folder / "gw.sock.guard"
        self.server = GuardServer(str(self.path), 0o660, ROBOT)
        self.server.open()
        self.pair = Guarded()
        self.pair.topics = LEAN
        self.callers: list[socket.socket] = []
        if is_acting:
            epoch = self.pair.activate()
            self.pair.move(epoch, HOME_Q_RAD)
            self.pair.run(0.3)
            self.pair.die()
            self.pair.run(0.1)

    def call(self) -> socket.socket:
        """Connect."""
        caller = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        caller.settimeout(5.0)
        caller.connect(str(self.path))
        self.callers.append(caller)
        return caller

    def poll(self) -> list[tuple[int, GuardQuestion]]:
        return self.server.poll(self.pair.guardian, self.pair.now_ns)

    def ask(self, caller: socket.socket, **question: Any) -> GuardAnswer:
        """Ask something that needs no engine."""
        caller.send(packed(GuardQuestion(**question)))
        assert self.poll() == []
        return read_answer(caller.recv(MAX_PACKET_BYTES))

    def close(self) -> None:
        for caller in self.callers:
            caller.close()
        self.server.close()


@pytest.fixture
def place(tmp_path: Path) -> Iterator[Place]:
    """A guard that holds."""
    made = Place(tmp_path)
    yield made
    made.close()


# ------------------------------------------------------------------------------------------------ the protocol


def test_messages_come_back_as_they_were() -> None:
    """And nonsense is refused with one kind of error."""
    question = GuardQuestion(ask="estop", client="ann", reason="smoke")
    assert read_question(packed(question)) == question
    answer = GuardAnswer(phase="acting", pid=4, state="HOLDING", done=True, latches={"ESTOP": "smoke"})
    assert read_answer(packed(answer)) == answer
    for nonsense in (b"", b"{}", b'{"ask": "dance"}', b"\xff", b'{"ask":"status","x":' + b"[" * 8000):
        with pytest.raises(ValueError):
            read_question(nonsense)


def test_the_guards_socket_lies_beside_the_daemons() -> None:
    """Whoever finds the one finds the other."""
    assert guard_socket(Path("/run/ta2/gateway.sock")) == Path("/run/ta2/gateway.sock.guard")


# ------------------------------------------------------------------------------------------------ the server


def test_the_socket_is_private_and_goes_with_the_desk(place: Place) -> None:
    """Permission bits as configured; a later guard's socket stays."""
    assert stat.S_IMODE(place.path.stat().st_mode) == 0o660
    later = GuardServer(str(place.path), 0o600)
    later.open()
    place.server.close()
    assert place.path.exists()
    later.close()
    assert not place.path.exists()


def test_the_socket_of_a_killed_guard_is_swept_and_that_of_a_living_one_stays(tmp_path: Path) -> None:
    """Nobody listens at what a kill leaves behind."""
    path = tmp_path / "x"
    server = GuardServer(str(path), 0o600)
    server.sweep()
    left = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    left.bind(str(path))
    left.listen(1)
    server.sweep()
    assert path.exists()
    left.close()
    server.sweep()
    assert not path.exists()


def test_no_answer_is_too_long_for_a_packet(place: Place) -> None:
    """A latch that names everybody on the robot must not hide a hold."""
    for code in (Code.FOREIGN_WRITER, Code.STOPPED_BY_OTHER, Code.TRACKING_ERROR):
        place.pair.guardian.engine.takeover.latch(code, "x" * MAX_PACKET_BYTES, place.pair.now_ns)
    caller = place.call()
    assert 9000 < place.ask(caller, ask="status").left_ms <= 10_000
    answer = place.ask(caller, ask="hand_over")
    assert answer.done and len(packed(answer)) < MAX_PACKET_BYTES


def test_a_desk_without_a_place_is_no_reason_not_to_guard(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    """It says so, and answers nobody."""
    server = GuardServer(str(tmp_path / "no folder" / "x"), 0o600)
    server.open()
    assert server.files == []
    assert "cannot be asked" in caplog.text
    server.close()


def test_a_guard_that_watches_stops_nothing_and_says_so(tmp_path: Path) -> None:
    """A living daemon is asked itself."""
    place = Place(tmp_path, is_acting=False)
    caller = place.call()
    for ask in ("status", "stop", "estop", "hand_over", "taken"):
        answer = place.ask(caller, ask=ask)
        assert (answer.phase, answer.done, answer.pid) == ("watching", False, os.getpid())
        assert msgspec.json.decode(answer.held) is None
    place.close()


@pytest.mark.parametrize("ask", ["stop", "estop"])
def test_a_stop_goes_to_the_engine_and_is_answered_when_it_was_done(place: Place, ask: str) -> None:
    """With whether it left for the robot."""
    caller = place.call()
    caller.send(packed(GuardQuestion(ask=ask, client="ann", reason="smoke")))
    ((number, question),) = place.poll()
    assert (question.ask, question.reason) == (ask, "smoke")
    place.server.stopped(number, place.pair.guardian, place.pair.now_ns, is_undelivered=True)
    answer = read_answer(caller.recv(MAX_PACKET_BYTES))
    assert (answer.done, answer.undelivered) == (True, True)


def test_nonsense_ends_a_connection_and_nothing_else(place: Place) -> None:
    """Others are served on."""
    bad, good = place.call(), place.call()
    bad.send(b"dance")
    assert place.poll() == []
    assert bad.recv(10) == b""
    assert place.ask(good, ask="status").phase == "acting"


STOPS = [
    (b"stop", "stop", "", ""),
    (b"  ESTOP!", "estop", "!", ""),
    (b"e-stop smoke \xff", "estop", "smoke \ufffd", ""),
    (b'{"ask": "Stop", "client": "ann", "reason": "smoke"}', "stop", "smoke", "ann"),
    (b'{"reason": 5, "client": "ann", "ask" : "estop", "more": []}', "estop", "", "ann"),
    (b'{"ask": "estop", "volume": 11}', "estop", "", ""),
    (b'{"ask":"estop","reason":"' + b"x" * MAX_PACKET_BYTES, "estop", "x" * 256, ""),
    (packed(GuardQuestion(ask="stop", reason="y" * 9000, client="z" * 5000)), "stop", "y" * 256, "z" * 256),
    (b"stop" + b"\0" * 60_000, "stop", "?" * 256, ""),
    (b"stop \x1b[2J a\nforged line", "stop", "?[2J a?forged line", ""),
    (b'[[["stop', "stop", "", ""),
    (b'{"ask":"estop","x":' + b"[" * 8000, "estop", "", ""),
]


@pytest.mark.parametrize(("packet", "ask", "reason", "client"), STOPS)
def test_a_stop_is_its_arrival_however_it_is_written(
    place: Place, packet: bytes, ask: str, reason: str, client: str
) -> None:
    """Cut, of other types, with more in it, in plain words: name and reason as far as they can be read."""
    place.call().send(packet)
    ((_, question),) = place.poll()
    assert (question.ask, question.reason, question.client) == (ask, reason, client)


@pytest.mark.parametrize(
    "packet",
    [b"stopwatch", b"nonstop", b'{"ask": "dance", "reason": "\\"ask\\": \\"stop\\""}', b'{"ask": "unstop"}', b""],
)
def test_what_names_no_stop_is_none(packet: bytes) -> None:
    """A word in a reason asks for nothing."""
    with pytest.raises(ValueError):
        read_question(packet)


def test_what_was_dropped_beside_the_daemons_socket_is_read_while_the_guard_acts(tmp_path: Path) -> None:
    """Before, it is the daemon's to read: it lies there still when that is dead."""
    daemon = tmp_path / "gw.sock"
    waiting, acting = Place(tmp_path, is_acting=False), Place(tmp_path)
    for place in (waiting, acting):
        place.server.close()
        place.server = GuardServer(str(place.path), 0o600, daemon=daemon)
        place.server.open()
    drop_stop(daemon, ESTOP_KEY, b'{"name": "Ann", "reason": "smoke"}')
    drop_stop(daemon, STOP_KEY, b"no JSON")
    assert waiting.poll() == []
    (first, estop), (second, stop) = acting.poll()
    assert estop == GuardQuestion(ask="estop", client="Ann", reason="smoke")
    assert stop == GuardQuestion(ask="stop", reason="no JSON")
    assert first == second == 0 and acting.poll() == []
    acting.server.stopped(first, acting.pair.guardian, acting.pair.now_ns, is_undelivered=False)  # nobody
    for place in (waiting, acting):
        place.close()


def test_a_dropped_map_that_is_no_whole_json_shows_nobodys_secret() -> None:
    """Reasons are shown to everybody; it is a stop all the same."""
    for payload in (msgspec.msgpack.encode({"secret": "s3cret"}), b'nt": "a", "secret": "s3cret"}', b'{"secret": "s3c'):
        assert read_dropped(payload, "stop") == GuardQuestion(ask="stop")


def test_a_guard_without_pipes_works_all_the_same(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    """The folder of the daemon's socket is gone, say."""
    place = Place(tmp_path)
    place.server.close()
    place.server = GuardServer(str(place.path), 0o600, daemon=tmp_path / "gone" / "gw.sock")
    place.server.open()
    assert place.ask(place.call(), ask="status").phase == "acting" and "no pipes for stops" in caplog.text
    place.close()


def test_idle_callers_shut_nobody_out(place: Place) -> None:
    """Whoever comes is heard; the most silent connection goes, and never more stay than agreed."""
    idle = [place.call() for _ in range(MOST_CALLERS)]
    assert place.poll() == []
    place.pair.run(0.01)
    place.ask(idle[0], ask="status")
    for ask in ("stop", "estop"):
        place.pair.run(0.01)
        place.call().send(packed(GuardQuestion(ask=ask)))
        ((_, question),) = place.poll()
        assert question.ask == ask
    assert len(place.server.files) == MOST_CALLERS + 1
    assert place.ask(idle[0], ask="status").phase == "acting"  # heard later than the others
    assert idle[1].recv(10) == idle[2].recv(10) == b""


def test_the_busiest_process_of_the_busiest_user_makes_room(place: Place, monkeypatch: pytest.MonkeyPatch) -> None:
    """Silent or not, those who are few keep their places."""
    who: list[tuple[int, int]] = []
    monkeypatch.setattr(guard_server, "peer", lambda _: who.pop(0))

    def come(uid: int, pid: int) -> socket.socket:
        who.append((uid, pid))
        caller = place.call()
        place.pair.run(0.01)
        place.poll()
        return caller

    other_user, other_process = come(7, 70), come(8, 80)
    crowd = [come(8, 81) for _ in range(2 * MOST_CALLERS)]
    assert place.ask(other_user, ask="status").phase == place.ask(other_process, ask="status").phase == "acting"
    assert crowd[0].recv(10) == b""
    assert place.ask(crowd[-1], ask="status").phase == "acting"


def test_one_look_lets_in_so_many_and_no_more(place: Place) -> None:
    """However many come, a tick is not late for them."""
    for _ in range(MOST_NEWCOMERS + 5):
        place.call()
    place.poll()
    assert place.server._last == MOST_NEWCOMERS
    place.poll()
    assert place.server._last == MOST_NEWCOMERS + 5


def test_a_caller_that_never_reads_delays_nobody(place: Place) -> None:
    """Its answers are dropped."""
    deaf, good = place.call(), place.call()
    deaf.setblocking(False)
    for _ in range(2000):
        with contextlib.suppress(BlockingIOError):
            deaf.send(packed(GuardQuestion(ask="status")))
        place.poll()
    assert place.ask(good, ask="status").phase == "acting"


def test_the_heir_and_a_stop_under_way_keep_their_places(place: Place) -> None:
    """A crowd cannot take the hold back from a daemon, nor the answer from who stops."""
    successor, stopping = place.call(), place.call()
    place.poll()
    stopping.send(b"stop")
    ((number, _),) = place.poll()
    assert place.ask(successor, ask="hand_over").done
    for _ in range(2):
        for _ in range(MOST_NEWCOMERS):
            place.call()
        place.poll()
    place.server.stopped(number, place.pair.guardian, place.pair.now_ns, is_undelivered=False)
    assert read_answer(stopping.recv(MAX_PACKET_BYTES)).done
    assert place.pair.guardian.phase is Phase.HANDED
    assert place.ask(successor, ask="taken").done


def test_the_next_daemon_keeps_its_place_while_it_waits(place: Place, monkeypatch: pytest.MonkeyPatch) -> None:
    """Hung up on by a crowd it would begin beside the hold. One of them, of the guard's user: no crowd of daemons does."""
    who = [(os.geteuid(), pid) for pid in range(1, 4 * MOST_CALLERS)]
    who.insert(0, (os.geteuid() + 4711, 99))
    monkeypatch.setattr(guard_server, "peer", lambda _: who.pop(0))
    stranger, successor = place.call(), place.call()
    place.ask(stranger, ask="status", client="daemon")
    place.ask(successor, ask="status", client="daemon")
    for _ in range(2 * MOST_CALLERS):
        place.pair.run(0.01)
        place.ask(place.call(), ask="status", client="daemon")
    assert place.ask(successor, ask="hand_over", client="daemon").done
    assert [caller.is_successor for caller in place.server._callers.values()].count(True) == 1


@pytest.mark.parametrize(("uid", "is_given"), [(os.geteuid(), True), (0, True), (os.geteuid() + 4711, False)])
def test_only_the_daemons_user_and_root_are_given_the_hold(
    place: Place, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture, uid: int, *, is_given: bool
) -> None:
    """Anybody of the socket's group may stop; the hold goes to a daemon of the same user. Told once."""
    monkeypatch.setattr(guard_server, "peer", lambda _: (uid, 99))
    caller = place.call()
    for _ in range(1 if is_given else 3):
        answer = place.ask(caller, ask="hand_over")
        assert answer.done is is_given
        assert (msgspec.json.decode(answer.held) is not None) is is_given
    assert place.pair.guardian.is_holding is not is_given
    assert caplog.text.count(f"process 99 of user {uid}") == (0 if is_given else 1)
    if not is_given:
        caller.send(b"estop")
        assert [question.ask for _, question in place.poll()] == ["estop"]


HOSTILE = """
import contextlib, itertools, resource, socket, sys
resource.setrlimit(resource.RLIMIT_NOFILE, (min(1024, resource.getrlimit(resource.RLIMIT_NOFILE)[1]),) * 2)
def come(n):
    caller = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET | socket.SOCK_NONBLOCK)
    with contextlib.suppress(OSError):
        caller.connect(sys.argv[1])
        if n % 4 == 1: caller.send(b"g" * 60_000)
        if n % 4 == 2: caller.send(b'{"ask": "status"}')
    return caller
callers = [come(n) for n in range(500)]
print("there", flush=True)
for n in itertools.count():  # whoever was turned away comes again, for ever
    with contextlib.suppress(BlockingIOError):
        try: gone = not callers[n % 500].recv(9)
        except BlockingIOError: raise
        except OSError: gone = True
        if gone: callers[n % 500].close(); callers[n % 500] = come(n)
"""


def test_500_hostile_connections_of_one_process_do_not_keep_a_stop_away(place: Place) -> None:
    """Half-open, garbage, huge, never reading, coming again at once: a stop is made within a second all the same."""
    hostile = subprocess.Popen([sys.executable, "-c", HOSTILE, str(place.path)], stdout=subprocess.PIPE)
    looks_s: list[float] = []
    try:
        assert hostile.stdout is not None
        assert hostile.stdout.readline() == b"there\n"
        address = str(place.path).removesuffix(".guard")
        for ask in ("stop", "estop", "stop"):
            took: list[float] = []

            def stop(ask: Any = ask, took: list[float] = took) -> None:
                begun_s = time.monotonic()
                assert stop_at_guard(address, ask, "smoke", "ann") == StopResult(undelivered=False, by_guard=True)
                took.append(time.monotonic() - begun_s)

            for _ in range(10):
                _look(place, looks_s)
            asking = threading.Thread(target=stop)
            asking.start()
            while asking.is_alive():
                _look(place, looks_s)
            assert took and took[0] < 1.0, took
            print(f"{ask}: {took[0] * 1e3:.1f} ms")
        assert len(place.server.files) <= MOST_CALLERS + 1
        looks_s.sort()
        middle_ms, longest_ms = looks_s[len(looks_s) // 2] * 1e3, looks_s[-1] * 1e3
        print(f"{len(looks_s)} looks of {middle_ms:.2f} ms, longest {longest_ms:.2f} ms; let in: {place.server._last}")
    finally:
        hostile.kill()
        hostile.wait(10)
        hostile.stdout.close()


def _look(place: Place, looks_s: list[float]) -> None:
    """One round of the guard's loop: wait for its tick or for somebody, look, and carry out what was asked."""
    select.select(place.server.files, [], [], 0.01)
    begun_s = time.thread_time()
    for number, _ in place.poll():
        place.server.stopped(number, place.pair.guardian, place.pair.now_ns, is_undelivered=False)
    looks_s.append(time.thread_time() - begun_s)


@pytest.mark.parametrize("ask", ["stop", "estop"])
def test_a_stop_that_is_read_with_the_question_for_the_hold_is_carried_out_first(place: Place, ask: Any) -> None:
    """Handed over in that look, the guard would tick no more: no frame, no latch, no reply. The next daemon asks again."""
    person, daemon = place.call(), place.call()
    person.send(packed(GuardQuestion(ask=ask, client="ann")))
    daemon.send(packed(GuardQuestion(ask="hand_over", client="daemon")))
    assert [question.ask for _, question in place.poll()] == [ask]
    answer = read_answer(daemon.recv(MAX_PACKET_BYTES))
    assert not answer.done and msgspec.json.decode(answer.held) is None and place.pair.guardian.is_holding
    assert place.ask(daemon, ask="hand_over", client="daemon").done


def test_a_caller_that_hangs_up_before_it_has_the_hold_gives_it_back(place: Place) -> None:
    """The daemon died: the guard goes on."""
    caller = place.call()
    answer = place.ask(caller, ask="hand_over")
    assert answer.done and place.pair.guardian.phase is Phase.HANDED
    caller.close()
    place.poll()
    assert place.pair.guardian.is_holding


def test_only_whoever_was_given_the_hold_can_say_that_it_has_it(place: Place) -> None:
    """Anybody else's word changes nothing."""
    successor, other = place.call(), place.call()
    place.ask(successor, ask="hand_over")
    assert not place.ask(other, ask="taken").done
    assert place.pair.guardian.phase is Phase.HANDED
    assert place.ask(successor, ask="taken").done
    assert place.pair.guardian.phase is Phase.DONE


# ------------------------------------------------------------------------------------------------ the client's side


def test_a_client_is_told_of_no_stop_that_was_not_made(tmp_path: Path) -> None:
    """No guard, a guard that does not answer sense, an address without one: None."""
    assert stop_at_guard(str(tmp_path / "gw.sock"), "stop", "", "ann") is None
    assert stop_at_guard("tcp/127.0.0.1:7448", "stop", "", "ann") is None
    assert stop_at_guard("nonsense", "stop", "", "ann") is None


def test_a_stop_in_the_instant_before_the_guard_acts_is_made(place: Place, monkeypatch: pytest.MonkeyPatch) -> None:
    """The daemon is dead and nobody listens yet: asked again, it is stopped."""
    place.server.close()
    monkeypatch.setattr(guard_stop.time, "sleep", lambda _: place.path.exists() or place.server.open())
    results: list[object] = []
    address = str(place.path).removesuffix(".guard")
    asking = threading.Thread(target=lambda: results.append(stop_at_guard(address, "stop", "smoke", "ann")))
    asking.start()
    while asking.is_alive():
        for number, _ in place.poll():
            place.server.stopped(number, place.pair.guardian, place.pair.now_ns, is_undelivered=False)
        asking.join(0.005)
    assert results == [StopResult(undelivered=False, by_guard=True)]


def test_a_guard_that_answered_nobody_in_time_is_asked_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A host so busy that the guard was not let run for the whole of a try; the stop is made, and who asked knows it."""
    monkeypatch.setattr(guard_stop, "ANSWER_S", 0.05)
    results: list[object] = []
    with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as listener:
        listener.bind(str(tmp_path / "gw.sock.guard"))
        listener.listen(4)
        asking = threading.Thread(
            target=lambda: results.append(stop_at_guard(str(tmp_path / "gw.sock"), "stop", "smoke", "ann"))
        )
        asking.start()
        for is_answered in (False, True):
            caller, _ = listener.accept()
            with caller:
                assert read_question(caller.recv(MAX_PACKET_BYTES)).ask == "stop"
                if is_answered:
                    caller.send(packed(GuardAnswer(phase="acting", pid=1, state="HOLDING", done=True)))
                else:
                    assert not caller.recv(MAX_PACKET_BYTES), "who asked has given up, and asks anew"
        asking.join(10.0)
    assert results == [StopResult(undelivered=False, by_guard=True)]


def test_a_guard_that_talks_nonsense_is_asked_once(tmp_path: Path) -> None:
    """What it did is not known, so nothing is claimed."""
    path = tmp_path / "gw.sock.guard"
    with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as listener:
        listener.bind(str(path))
        listener.listen(1)
        results: list[object] = []
        asking = threading.Thread(
            target=lambda: results.append(stop_at_guard(str(tmp_path / "gw.sock"), "estop", "", "ann"))
        )
        asking.start()
        caller, _ = listener.accept()
        assert read_question(caller.recv(MAX_PACKET_BYTES)).ask == "estop"
        caller.send(b"dance")
        asking.join(10.0)
        caller.close()
    assert results == [None]


# ------------------------------------------------------------------------------------------------ the successor


class Successor:
    """A new daemon's engine that hears the robot, and its successor."""

    def __init__(self, place: Place) -> None:
        self.place = place
        self.engine = place.pair.start_daemon()
        self.latches: dict[Code, str] = {}
        self.successor = HoldSuccessor(
            place.path, self.engine, self.latches.__setitem__, ROBOT, lambda: place.pair.now_ns
        )
        self.events: list[Any] = []

    def step(self, *, is_confirmed: bool = True) -> None:
        """One tick of both."""
        pair = self.place.pair
        pair.step()
        self.place.poll()
        events = self.successor.poll(pair.now_ns)
        for event in events:
            self.engine.receive(event, pair.now_ns)
        self.events += events
        self.engine.tick(pair.now_ns)
        if is_confirmed:
            self.successor.confirm()
            self.place.poll()


def successor_of(place: Place) -> Successor:
    """Look while the server answers: the guard's loop and the daemon's are two processes."""
    found: list[Successor] = []
    looking = threading.Thread(target=lambda: found.append(Successor(place)))
    looking.start()
    while looking.is_alive():
        place.poll()
        looking.join(0.005)
    return found[0]


def test_a_restarted_daemon_asks_when_it_can_hold_and_takes_it_in_one_tick(place: Place) -> None:
    """Held elsewhere, then taken over, then confirmed: the guard ends."""
    successor = successor_of(place)
    for _ in range(300):
        successor.step()
        if place.pair.guardian.phase is Phase.DONE:
            break
    kinds = [type(event) for event in successor.events]
    assert kinds == [HeldElsewhere, HeldElsewhere, TakenOver]
    assert [event.is_held for event in successor.events[:2]] == [True, False]
    assert successor.engine.state.value == "HOLDING"
    assert successor.engine.takeover.refused == ""
    assert place.pair.guardian.phase is Phase.DONE
    assert successor.successor.poll(place.pair.now_ns) == []


def test_a_hold_is_confirmed_before_a_frame_leaves(place: Place) -> None:
    """A daemon that dies between its tick and that leaves the hold to the guard that had it, and to nobody else."""
    successor = successor_of(place)
    while successor.engine.state.value != "HOLDING":
        successor.step(is_confirmed=False)
    assert place.pair.guardian.phase is Phase.HANDED
    successor.successor.close()
    place.poll()
    assert place.pair.guardian.is_holding


def test_a_daemon_waits_for_a_guard_of_its_own_before_it_takes_a_hold(place: Place) -> None:
    """Two seconds at most: until then nobody would hold if it died. A hold that ends soon is taken at once."""
    successor = successor_of(place)
    pair = place.pair
    successor.engine.receive(GuardSeen(pid=41, zid="", is_linked=False, at_ns=pair.now_ns), pair.now_ns)
    begun_ns = pair.now_ns
    while pair.guardian.phase is not Phase.DONE:
        successor.step()
    assert pair.now_ns - begun_ns >= 2 * S


def test_a_hold_that_ends_soon_is_taken_without_waiting_for_a_guard(place: Place) -> None:
    """Better held by a daemon without a guard than by nobody."""
    successor = successor_of(place)
    pair = place.pair
    successor.engine.receive(GuardSeen(pid=41, zid="", is_linked=False, at_ns=pair.now_ns), pair.now_ns)
    begun_ns = pair.now_ns
    successor.successor._down_ns = pair.now_ns + 2 * S
    while pair.guardian.phase is not Phase.DONE:
        successor.step()
    assert pair.now_ns - begun_ns < 2 * S


def test_what_was_sent_to_another_robot_is_not_taken_over(place: Place, caplog: pytest.LogCaptureFixture) -> None:
    """A daemon for the next robot on the same socket begins as ever: those setpoints are not its own robot's."""
    engine = Engine(Settings())
    found: list[HoldSuccessor] = []
    looking = threading.Thread(
        target=lambda: found.append(
            HoldSuccessor(place.path, engine, lambda *_: None, robot_name("tcp/10.0.0.2:9000", ""))
        )
    )
    looking.start()
    while looking.is_alive():
        place.poll()
        looking.join(0.005)
    assert found[0].poll(place.pair.now_ns) == []
    assert "another robot: tcp/192.168.1.30:9000/lab" in caplog.text
    assert place.pair.guardian.is_holding


def test_a_guard_that_hangs_is_not_waited_for_for_ever(place: Place) -> None:
    """Stopped while it held: nobody could ever enable the robot again else."""
    successor = successor_of(place)
    pair, successor = place.pair, successor.successor
    assert successor.poll(pair.now_ns) == [HeldElsewhere(is_held=True, at_ns=pair.now_ns)]
    for after_s in (1, 5, 10, 14):
        assert successor.poll(pair.now_ns + after_s * S) == []
    late_ns = pair.now_ns + 15 * S
    assert successor.poll(late_ns) == [HeldElsewhere(is_held=False, at_ns=late_ns)]
    assert successor.poll(late_ns) == []


def test_a_guard_that_ends_first_leaves_a_daemon_that_begins_as_ever(place: Place) -> None:
    """Nothing is taken; enabling is free again."""
    successor = successor_of(place)
    successor.step()
    place.server.close()
    events = successor.successor.poll(place.pair.now_ns)
    assert events == [HeldElsewhere(is_held=False, at_ns=place.pair.now_ns)]
    assert successor.successor.poll(place.pair.now_ns) == []


def test_latches_of_the_guard_come_with_its_hold(place: Place) -> None:
    """A stop at the guard's socket holds motion off in the next daemon, too."""
    place.pair.guardian.engine.takeover.latch(Code.STOPPED_BY_OTHER, "smoke", place.pair.now_ns)
    successor = successor_of(place)
    for _ in range(300):
        successor.step()
        if place.pair.guardian.phase is Phase.DONE:
            break
    assert successor.latches == {Code.STOPPED_BY_OTHER: "smoke"}


def test_an_estop_at_the_guard_while_the_next_daemon_waits_is_latched_there(place: Place) -> None:
    """It ends the hold, so nothing is handed over; who asked was told that it was done, and nothing moves unasked after it."""
    successor = successor_of(place)
    pair = place.pair
    successor.engine.receive(GuardSeen(pid=41, zid="", is_linked=False, at_ns=pair.now_ns), pair.now_ns)
    for _ in range(20):
        successor.step()
    assert not successor.latches and pair.guardian.is_holding, "it waits for a guard of its own"
    caller = place.call()
    caller.send(packed(GuardQuestion(ask="estop", client="ann", reason="smoke")))
    ((number, question),) = place.poll()
    caller.close()
    pair.guardian.receive(
        CommandRequested(
            client_id=question.client, request_id=number, request=Estop(reason=question.reason), received_ns=pair.now_ns
        ),
        pair.now_ns,
    )
    for _ in range(30):
        successor.step()
    assert "smoke" in successor.latches[Code.ESTOP] and not successor.successor._is_taken
    successor.latches.clear()
    for _ in range(30):
        successor.step()
    assert not successor.latches, "once: what a person has cleared since is not latched anew"
    successor.successor.close()


def test_no_hold_is_taken_from_another_users_guard(
    place: Place, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """Whoever listens where a guard would tells no setpoints to a daemon of this user."""
    monkeypatch.setattr("gateway.guard.successor.peer", lambda _: (os.geteuid() + 1, 99))
    successor = successor_of(place)
    assert successor.successor.poll(place.pair.now_ns) == [] and "no guard of an earlier daemon of ours" in caplog.text
    assert place.pair.guardian.is_holding


def test_a_hold_that_is_not_understood_is_left_to_the_guard(place: Place, monkeypatch: pytest.MonkeyPatch) -> None:
    """A guard of another release: it gets its hold back at once, and goes on."""
    successor = successor_of(place)
    while not successor.successor._is_asked:
        successor.step()
    strange = GuardAnswer(phase="handed", pid=1, state="HOLDING", done=True, held=msgspec.Raw(b'{"shape": "new"}'))
    monkeypatch.setattr(successor.successor, "_heard", lambda: strange)
    place.poll()
    assert place.pair.guardian.phase is Phase.HANDED
    events = successor.successor.poll(place.pair.now_ns)
    assert events == [HeldElsewhere(is_held=False, at_ns=place.pair.now_ns)]
    place.poll()
    assert place.pair.guardian.is_holding


def test_without_a_guard_that_acts_there_is_nothing_to_take(tmp_path: Path) -> None:
    """No socket, or a guard that watches."""
    engine = Engine(Settings())
    successor = HoldSuccessor(tmp_path / "nothing", engine, lambda *_: None, ROBOT)
    assert successor.poll(1 * S) == []
    successor.close()
    place = Place(tmp_path, is_acting=False)
    found: list[HoldSuccessor] = []
    looking = threading.Thread(target=lambda: found.append(HoldSuccessor(place.path, engine, lambda *_: None, ROBOT)))
    looking.start()
    while looking.is_alive():
        place.poll()
        looking.join(0.005)
    assert found[0].poll(1 * S) == []
    place.close()
