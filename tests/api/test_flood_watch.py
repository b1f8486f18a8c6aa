"""Tests of the watch over floods: who is hung up on, who is not, and which threads leave real time."""

from __future__ import annotations

import errno
import os
import socket
import threading
from contextlib import suppress

import pytest

from gateway.api import flood_watch
from gateway.api.flood_watch import (
    CALM_NS,
    CLOSE_NS,
    LONGEST_NS,
    LOOKS,
    MOST_AT_ONCE,
    QUIET_NS,
    SHUT_OUT_NS,
    UNREAD_BYTES,
    FloodWatch,
    OrdinaryWhileBusy,
)

MS = 1_000_000


class Place:
    """A listener with connections, the ends of which are in this process; each counts as another process's."""

    def __init__(self, family, address):
        self.listener = socket.socket(family)
        self.listener.bind(address)
        self.listener.listen(64)
        self.address = self.listener.getsockname()
        self.pairs = []
        self.watch = FloodWatch(lambda name: name == self.address)
        self.now_ns = CALM_NS

    def connect(self):
        caller = socket.socket(self.listener.family)
        caller.connect(self.address)
        self.pairs.append((caller, self.listener.accept()[0]))
        return caller

    def look(self):
        self.now_ns += CALM_NS
        self.watch.look(self.now_ns)

    def close(self):
        for end in (self.listener, *(end for pair in self.pairs for end in pair)):
            end.close()

    def is_up(self, caller):
        """Whether nobody has hung up on a caller."""
        caller.setblocking(False)
        try:
            return caller.recv(1) != b""
        except BlockingIOError:
            return True


@pytest.fixture(params=["unix", "tcp"])
def place(request, tmp_path, monkeypatch):
    """A place where clients connect; whatever else this process has open, all of it is looked at."""
    monkeypatch.setattr(flood_watch, "LOOKED_AT", 1_000_000)
    made = (
        Place(socket.AF_UNIX, str(tmp_path / "s"))
        if request.param == "unix"
        else Place(socket.AF_INET, ("127.0.0.1", 0))
    )
    yield made
    made.close()


def test_a_process_that_does_little_looks_seldom(place):
    """A busy process, one that suspects somebody, and everyone at times looks at its files: else all that is sent is read."""
    watch, looks = place.watch, []
    watch.look, look = lambda now_ns: looks.append(now_ns) or look(now_ns), watch.look
    now_ns, used_ns = watch._glanced_ns, watch._used_ns

    def glance(share):
        nonlocal now_ns, used_ns
        now_ns, used_ns = now_ns + CALM_NS, used_ns + int(share * CALM_NS)
        before = len(looks)
        watch.glance(now_ns, used_ns)
        return len(looks) > before

    assert glance(0.0)  # the first
    quiet = [glance(0.1) for _ in range(2 * QUIET_NS // CALM_NS)]
    assert quiet.count(True) == 2 and not any(quiet[:8])
    assert glance(0.2) and not glance(0.1)
    place.connect().send(bytes(UNREAD_BYTES + 1))
    assert glance(0.2) and watch.due_ns == now_ns + CLOSE_NS and glance(0.0)


def test_who_sends_faster_than_is_read_is_hung_up_on(place, caplog):
    """Unread bytes that are many and change from look to look are a flood; it is ended and told once a second."""
    caller = place.connect()
    for number in range(LOOKS):
        assert place.is_up(caller)
        caller.send(bytes(UNREAD_BYTES + 1 if number == 0 else 1))
        place.look()
    assert not place.is_up(caller)
    assert place.watch.ended == 1 and caplog.text.count("flooded by") == 1


def test_a_process_that_floods_again_is_shut_out_each_time_for_longer(place, monkeypatch):
    """By itself zenoh connects again, with all that was declared. Nobody else of this host or another is kept out with it."""
    others = set()
    peer = flood_watch._peer
    monkeypatch.setattr(flood_watch, "_peer", lambda end: "other" if end.fileno() in others else peer(end))

    def shut_out_ns():
        """Flood once and return how long connections are ended after that."""
        caller = place.connect()
        for number in range(LOOKS):
            caller.send(bytes(UNREAD_BYTES + 1 if number == 0 else 1))
            place.look()
        assert not place.is_up(caller)
        began_ns = place.now_ns
        while not place.is_up(caller):
            assert place.now_ns == began_ns or place.watch.due_ns == place.now_ns + CLOSE_NS
            for end in place.pairs.pop():
                end.close()
            caller = place.connect()
            place.look()
        return place.now_ns - began_ns

    bystander = place.connect()
    others.add(place.pairs[0][1].fileno())
    is_known = place.listener.family == socket.AF_UNIX
    first_ns = shut_out_ns()  # it may be an honest client's of a host that stalled
    assert first_ns <= CALM_NS
    assert shut_out_ns() == (SHUT_OUT_NS if is_known else CALM_NS)
    assert shut_out_ns() == (2 * SHUT_OUT_NS if is_known else CALM_NS)
    place.now_ns += 2 * LONGEST_NS
    assert shut_out_ns() == first_ns
    assert place.is_up(bystander)


def test_who_is_not_read_is_nobodys_fault(place):
    """A large request that lies there unread while this process stands still ends nothing."""
    caller = place.connect()
    caller.send(bytes(2 * UNREAD_BYTES))
    for _ in range(3 * LOOKS):
        place.look()
    assert place.is_up(caller) and place.watch.ended == 0


def test_small_things_are_no_flood(place):
    """However often, what stays below the bound is a client's good right."""
    caller = place.connect()
    for _ in range(3 * LOOKS):
        caller.send(bytes(100))
        place.look()
    assert place.is_up(caller)


def test_others_connections_are_left_alone(place):
    """Sockets at which this plane does not listen, the robot's say, are not looked at."""
    place.watch._is_own = lambda name: False
    caller = place.connect()
    for _ in range(3 * LOOKS):
        caller.send(bytes(2 * UNREAD_BYTES // LOOKS))
        place.look()
    assert place.is_up(caller)


def test_it_looks_closer_while_somebody_is_suspected(place):
    """Seldom as long as all is well, more often afterwards."""
    place.look()
    assert place.watch.due_ns == place.now_ns + CALM_NS
    place.connect().send(bytes(2 * UNREAD_BYTES))
    place.look()
    assert place.watch.due_ns == place.now_ns + CLOSE_NS


def test_a_crowd_makes_room(place, monkeypatch, caplog):
    """Of too many connections those of the busiest process go, the oldest first, a few at each look, and never the last."""
    monkeypatch.setattr(flood_watch, "MOST_CONNECTIONS", 4)
    for name in ("_peer", "_place"):
        monkeypatch.setattr(flood_watch, name, lambda connection: "crowd")
    callers = [place.connect() for _ in range(MOST_AT_ONCE + 8)]
    place.look()
    assert [place.is_up(caller) for caller in callers[:MOST_AT_ONCE]] == [False] * MOST_AT_ONCE
    assert all(place.is_up(caller) for caller in callers[MOST_AT_ONCE:])
    assert "crowded by crowd" in caplog.text


def test_one_process_is_a_crowd_sooner(place, monkeypatch, caplog):
    """There is room for more, yet what one process has too many of goes: zenoh takes leave of them all at once when it dies."""
    monkeypatch.setattr(flood_watch, "MOST_OF_ONE", 4)
    callers = [place.connect() for _ in range(8)]
    of_one = {served.fileno() for _, served in place.pairs[2:]}
    monkeypatch.setattr(flood_watch, "_peer", lambda end: "one" if end.fileno() in of_one else end.fileno())
    place.look()
    assert [place.is_up(caller) for caller in callers] == [True, True, False, False, True, True, True, True]
    assert "crowded by one" in caplog.text
    place.look()
    assert all(map(place.is_up, callers[4:])), "no more of them than are too many"


def test_as_many_processes_may_stay_as_there_are(place, monkeypatch):
    """Where each connection is another process's of this host nobody is in the way of anybody."""
    monkeypatch.setattr(flood_watch, "MOST_CONNECTIONS", 2)
    monkeypatch.setattr(flood_watch, "_place", lambda connection: connection.fileno())
    callers = [place.connect() for _ in range(6)]
    place.look()
    assert all(place.is_up(caller) for caller in callers)


def test_a_crowd_of_one_host_makes_room_however_many_processes_it_has(place, monkeypatch, caplog):
    """And of one user's containers. The newest go: whoever was there before the crowd stays, in its place or another."""
    monkeypatch.setattr(flood_watch, "MOST_CONNECTIONS", 4)
    if place.listener.family == socket.AF_UNIX:
        monkeypatch.setattr(flood_watch, "_credentials", lambda connection: (0, 1000, 1000))
        crowd = "user 1000's containers"
    else:
        crowd = "host 127.0.0.1"
    callers = [place.connect() for _ in range(8)]
    elsewhere = {place.pairs[n][1].fileno() for n in (6, 7)}
    real = flood_watch._place
    monkeypatch.setattr(
        flood_watch, "_place", lambda connection: "person" if connection.fileno() in elsewhere else real(connection)
    )
    place.look()
    assert [place.is_up(caller) for caller in callers] == [True, True, False, False, False, False, True, True]
    assert f"crowded by {crowd}" in caplog.text


def test_processes_are_told_apart_as_far_as_the_kernel_knows(place):
    """By their process id on this host, by address and port else."""
    caller = place.connect()
    peer = flood_watch._peer(place.pairs[0][1])
    if place.listener.family == socket.AF_UNIX:
        assert peer == f"process {os.getpid()}"
    else:
        assert peer == str(caller.getsockname())


def test_a_connection_that_is_closed_in_this_moment_hides_nobody(place, monkeypatch):
    """By zenoh, while a look goes on: the others are judged all the same."""
    closed, flooder = place.connect(), place.connect()
    peer = flood_watch._peer

    def just_closed(connection):
        if connection.fileno() == place.pairs[0][1].fileno():
            raise OSError(errno.EBADF, "closed")
        return peer(connection)

    monkeypatch.setattr(flood_watch, "_peer", just_closed)
    for _ in range(LOOKS + 2):
        for caller in (closed, flooder):
            with suppress(BrokenPipeError, ConnectionResetError):  # hung up on
                caller.send(bytes(UNREAD_BYTES + 1))
        place.look()
    assert place.is_up(closed) and not place.is_up(flooder)


def test_who_hangs_up_in_the_moment_of_a_look_keeps_nobody_from_being_looked_at(place, monkeypatch):
    """The kernel knows no address of it any more; a crowd that comes and goes makes room all the same."""
    monkeypatch.setattr(flood_watch, "MOST_CONNECTIONS", 2)
    callers = [place.connect() for _ in range(6)]
    gone = {place.pairs[0][1].fileno()}

    def crowd(connection):
        if connection.fileno() in gone:
            raise OSError(errno.ENOTCONN, "not connected")
        return "crowd"

    monkeypatch.setattr(flood_watch, "_place", crowd)
    place.look()
    assert [place.is_up(caller) for caller in callers] == [True, True, True, False, False, False]


def test_without_files_to_open_a_crowd_makes_room_all_the_same(place, monkeypatch):
    """It took them all: none is needed to hang up, and what would need one goes on without."""
    monkeypatch.setattr(flood_watch, "MOST_CONNECTIONS", 4)
    for name in ("_peer", "_place"):
        monkeypatch.setattr(flood_watch, name, lambda connection: "crowd")
    callers = [place.connect() for _ in range(6)]
    monkeypatch.setattr(os, "listdir", none_left)
    place.look()
    assert [place.is_up(caller) for caller in callers] == [False, False, True, True, True, True]
    OrdinaryWhileBusy()._lower()


def none_left(path):
    """List a folder when no file can be opened."""
    raise OSError("too many open files")


NAMES = {10: "tx-0\n", 7: "rx-0\n", 12: "acc-0\n"}


@pytest.fixture
def scheduler(monkeypatch):
    """A kernel in which all threads but this one are under SCHED_FIFO: thread -> policy and priority."""
    nices = {}
    sender = {10: (os.SCHED_FIFO, 40)}
    others = {7: (os.SCHED_FIFO, 40), 8: (os.SCHED_FIFO, 39), 11: (os.SCHED_FIFO, 39), 12: (os.SCHED_FIFO, 40)}
    threads = {threading.get_native_id(): (os.SCHED_FIFO, 60)} | others | sender
    monkeypatch.setattr(flood_watch, "name_of", lambda number: NAMES.get(number, "python\n"))
    monkeypatch.setattr(os, "listdir", lambda path: [str(number) for number in (*threads, 9)])
    monkeypatch.setattr(os, "sched_getscheduler", lambda number: threads[number][0] if number in threads else gone())
    monkeypatch.setattr(os, "sched_getparam", lambda number: os.sched_param(threads[number][1]))
    monkeypatch.setattr(os, "getpriority", lambda which, number: nices.get(number, 0))
    monkeypatch.setattr(os, "setpriority", lambda which, number, nice: nices.__setitem__(number, nice))
    monkeypatch.setattr(
        os,
        "sched_setscheduler",
        lambda number, policy, param: threads.__setitem__(number, (policy, param.sched_priority)),
    )

    def gone():
        raise ProcessLookupError

    return threads, nices


def test_a_number_that_is_another_programs_by_now_gets_no_real_time(scheduler, monkeypatch):
    """A thread that was lowered has ended; nothing is given back while nobody can tell which are there."""
    scheduler, nices = scheduler
    ordinary = OrdinaryWhileBusy()
    now_ns, used_ns = ordinary._looked_ns, ordinary._used_ns
    ordinary.judge(now_ns + 100 * MS, used_ns + 100 * MS)
    assert scheduler[7] == scheduler[8] == (os.SCHED_OTHER, 0)
    with monkeypatch.context() as later:
        later.setattr(os, "listdir", none_left)
        ordinary.judge(now_ns + 1300 * MS, used_ns + 100 * MS)
    assert scheduler[8] == (os.SCHED_OTHER, 0) and ordinary.lowered
    with monkeypatch.context() as later:
        later.setattr(os, "listdir", lambda path: ["8"])
        ordinary.judge(now_ns + 1400 * MS, used_ns + 100 * MS)
    assert scheduler[7] == (os.SCHED_OTHER, 0) and nices[7] == -5
    assert scheduler[8] == (os.SCHED_FIFO, 39) and nices[8] == 0 and not ordinary.lowered


def test_busy_threads_leave_real_time_and_come_back(scheduler):
    """All but the loop's and the sender's, as long as this process is busy and a second longer; each to where it was."""
    loop, (scheduler, nices) = threading.get_native_id(), scheduler
    before = dict(scheduler)
    ordinary = OrdinaryWhileBusy(lambda number: number == 11)
    now_ns, used_ns = ordinary._looked_ns, ordinary._used_ns
    ordinary.judge(now_ns + 100 * MS, used_ns + 20 * MS)
    assert scheduler == before, "a robot's usual load"
    ordinary.judge(now_ns + 200 * MS, used_ns + 110 * MS)
    assert scheduler == {
        loop: (os.SCHED_FIFO, 60), 7: (os.SCHED_OTHER, 0), 8: (os.SCHED_OTHER, 0), 10: (os.SCHED_FIFO, 40),
        11: (os.SCHED_OTHER, 0), 12: (os.SCHED_OTHER, 0),
    }, "setpoints leave in time"  # fmt: skip
    assert nices[7] == -5, "before others, but the owner's program on the same core still runs: at -20 it did not"
    assert nices[8] == -20, "whoever may hold Python's lock, for which the loop waits, waits for no core"
    assert nices[11] == -5, "it has work for as long as others ask, and would keep the robot from being heard"
    assert nices[12] == 0, "who does nothing but connect gets no more of a core than any program"
    scheduler[7] = (os.SCHED_FIFO, 40)  # a new link has raised it again
    ordinary.judge(now_ns + 300 * MS, used_ns + 200 * MS)
    assert scheduler[7] == (os.SCHED_OTHER, 0)
    ordinary.judge(now_ns + 1200 * MS, used_ns + 210 * MS)
    assert scheduler[7] == (os.SCHED_OTHER, 0), "not calm for long enough"
    ordinary.judge(now_ns + 1400 * MS, used_ns + 220 * MS)
    assert scheduler == before and ordinary.lowered == {}
    assert nices == {7: 0, 8: 0, 11: 0, 12: 0}, "what they start would have it, too"
