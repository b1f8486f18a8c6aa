"""Who sends more than can be read is hung up on, and no flood takes the processor from those who command the robot.

zenoh reads all connections, the robot's too, in the same few threads, as fast as it can. Under SCHED_FIFO a flood would have
them use up all real time that the kernel grants, after which nobody's thread runs for a while, the loop's neither.

Rules
    * Suspected is a process of whose connections more lies unread than a healthy client ever leaves there. Where that is so
      for several looks in turn, and each time another number of bytes, it sends faster than we read: it is hung up on. A
      number that stays says that we do not read, and is nobody's fault.
    * A process of this host that floods again is shut out for a while, each time for longer: zenoh's clients connect again by
      themselves and declare all that they had, and what they had declared costs time with each that comes and goes.
    * Knows a process by what the kernel says of the socket's other end. Where it says nothing (another host, another
      container), each connection counts for itself.
    * Where there are too many connections, some of the place that has most of them are hung up on: of a process here, else
      of another host, or of a user in containers. So there is room for whoever comes to stop. One process may not even have
      half as many. Of a process the oldest go, which it has lost sight of; of a place the newest: who was there stays.
    * While this process is busy, all of its threads are ordinary ones until it was calm for a second, all but those that
      connect before others: but the loop's, and those that send, without which its setpoints would leave late.

Asks the kernel only, never zenoh. Who floods is looked for in a thread of its own, since that takes a millisecond. Whether
this process is busy is the loop's to see, since nobody else gets to run then.
"""

from __future__ import annotations

import logging
import os
import random
import resource
import socket
import struct
import threading
import time
from array import array
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from fcntl import ioctl
from pathlib import Path
from termios import FIONREAD

__all__ = [
    "CALM_NS",
    "CLOSE_NS",
    "LONGEST_NS",
    "LOOKS",
    "MOST_AT_ONCE",
    "SENDER",
    "SHUT_OUT_NS",
    "UNREAD_BYTES",
    "FloodWatch",
    "OrdinaryWhileBusy",
    "name_of",
]

MS = 1_000_000
CALM_NS = 40 * MS
"""From look to look [ns], as long as nobody is suspected."""
QUIET_NS = 400 * MS
"""The same while this process does little [ns]: what is sent to it is read, then."""
QUIET_SHARE = 0.15
"""Of one core."""
CLOSE_NS = 10 * MS
"""From look to look while somebody is [ns]."""
UNREAD_BYTES = 8 * 1024
"""What an owner who streams targets sends in a quarter of a second."""
LOOKS = 4
"""A client that asks for large things waits for each answer: it is seen with unread bytes twice at most."""
MOST_CONNECTIONS = 96
"""More do not stay, but where each is another process's of this host."""
MOST_OF_ONE = 48
"""Nor of one process: zenoh takes leave of all of them at once when it dies, and of 96 that took it 100 ms on a slow host (3 of
16 times), in which nobody read what the robot says."""
SHUT_OUT_NS, LONGEST_NS = 4000 * MS, 64_000 * MS
"""So long a process that floods again is hung up on whenever it connects, each time twice as long, and at most [ns]. At its
first time it is not, and it is forgotten after the longest: it may be a client of a host that stalled, an owner's even."""
LOOKED_AT = 128
"""So many open files are looked at, picked at random where there are more: a look must not keep Python's lock for long."""
MOST_AT_ONCE = 16
"""So many are hung up on at a look: zenoh has work with each."""
BUSY_SHARE = 0.4
"""Of one core: a robot at full load, with its client, takes 0.2."""
CALMED_NS = 1000 * MS
SENDER = "tx-"
"""zenoh's threads that send, the robot's setpoints too: what they have to do is what we say, and no flood makes it more."""
RECEIVERS = ("rx-", "net-", "app-")
"""zenoh's threads that floods keep busy; every other one but `ACCEPTORS` is Python's."""
ACCEPTORS = "acc-"
"""zenoh's threads that open connections and close them: no more than any program of whoever does nothing else."""
AS_OTHERS = 0
BEFORE_OTHERS = -5
"""Nice value of busy receivers: before other programs, but the owner's on the same core must get its share, too.
At -20 its keepalives stayed away for 250 ms in 7 of 18 floods of half-open connections on a loaded host, at -8 in none."""
FIRST_OF_ALL = -20
"""Nice value of Python's threads meanwhile: one that waits for a core while it has Python's lock keeps the loop waiting, too.
At -5 setpoints came up to 45 ms apart under half-open connections (p99 20 ms), at -20 up to 14 ms (12 ms). Not of the one that
works out chunks: its work has no end, and zenoh's threads, on the same core, would not hear the robot (p99 15 to 19 ms, 13)."""
LOG_APART_NS = 1000 * MS

log = logging.getLogger(__name__)


class Process(str):
    """Name of a process of this host."""


class FloodWatch:
    """Hangs up on those who send more than can be read.

    Args:
        is_own: Whether a local address is one at which this plane listens.
    """

    def __init__(self, is_own: Callable[[object], bool]) -> None:
        self.ended = 0
        """Connections that were ended."""
        self._is_own = is_own
        self.due_ns = 0
        """When to look next [ns]."""
        self._logged_ns = 0
        self._looked_ns = 0
        self._glanced_ns, self._used_ns = time.monotonic_ns(), time.process_time_ns()
        self._seen = 0
        """Files that were open at the last look."""
        self._other_files = len(os.listdir("/proc/self/fd"))
        """Those that were open before anybody connected: a count asks the kernel about each, so it is left out below them."""
        self._unread: dict[object, int] = {}
        """What each peer that is suspected had unread at the last look [bytes]."""
        self._strikes: Counter[object] = Counter()
        self._shut_out: dict[object, tuple[int, int]] = {}
        """Processes that flooded: until when they are hung up on, and for how long the next time [ns]."""

    def glance(self, now_ns: int, used_ns: int) -> None:
        """Look, unless there was a look lately and this process has done little since the last glance.

        Args:
            now_ns: Monotonic time [ns].
            used_ns: Processor time that this process has used [ns].
        """
        is_quiet = used_ns - self._used_ns < QUIET_SHARE * (now_ns - self._glanced_ns)
        self._glanced_ns, self._used_ns = now_ns, used_ns
        if is_quiet and not self._unread and not self._shut_out and now_ns - self._looked_ns < QUIET_NS:
            self.due_ns = now_ns + CALM_NS
        else:
            self.look(now_ns)

    def look(self, now_ns: int) -> None:
        """Look who sends too much.

        Args:
            now_ns: Monotonic time [ns].
        """
        self._looked_ns, self.due_ns = now_ns, now_ns + CALM_NS
        unread: Counter[object] = Counter()
        self._shut_out = {peer: known for peer, known in self._shut_out.items() if now_ns < known[0] + LONGEST_NS}
        shut_out = {peer for peer, (until_ns, _) in self._shut_out.items() if now_ns < until_ns}
        for connection, peer, _, count in self._connections(unread_only=not shut_out):
            if peer in shut_out:
                with suppress(OSError):  # closed in this moment
                    connection.shutdown(socket.SHUT_RDWR)
            else:
                unread[peer] += count
        self._make_room(now_ns)
        before, self._unread = self._unread, {peer: count for peer, count in unread.items() if count > UNREAD_BYTES}
        self._strikes = Counter(
            {peer: self._strikes[peer] + 1 for peer, count in self._unread.items() if before.get(peer) != count}
        )
        if self._unread or shut_out:
            self.due_ns = now_ns + CLOSE_NS
        flooding = {peer for peer, strikes in self._strikes.items() if strikes >= LOOKS}
        if flooding:
            self._hang_up(flooding, now_ns)

    def _hang_up(self, peers: set[object], now_ns: int) -> None:
        self._end(peers, MOST_AT_ONCE)
        for peer in peers:
            del self._strikes[peer], self._unread[peer]
            if isinstance(peer, Process):  # of others each connection has a name of its own
                _, next_ns = self._shut_out.get(peer, (0, 0))
                self._shut_out[peer] = now_ns + next_ns, min(2 * next_ns, LONGEST_NS) or SHUT_OUT_NS
        self._tell(f"flooded by {', '.join(map(str, peers))}", now_ns)

    def _make_room(self, now_ns: int) -> None:
        if self._seen - self._other_files <= min(MOST_CONNECTIONS, MOST_OF_ONE):
            return
        found = [(peer, place) for _, peer, place, _ in self._connections(unread_only=False)]
        peers, places = Counter(peer for peer, _ in found), Counter(place for _, place in found)
        for held, excess in (
            (places, len(found) - MOST_CONNECTIONS),
            (peers, max(peers.values(), default=0) - MOST_OF_ONE),
        ):
            busiest, count = held.most_common(1)[0] if held else (None, 0)
            if excess > 0 and count > 1:
                most = min(excess, count - 1, MOST_AT_ONCE)
                self._end({busiest}, most, newest_first=busiest not in peers)
                self._tell(f"crowded by {busiest}", now_ns)
                return

    def _end(self, meant: set[object], most: int, *, newest_first: bool = False) -> None:
        for connection, peer, place, _ in self._connections(unread_only=False, newest_first=newest_first):
            if most > 0 and not meant.isdisjoint((peer, place)):
                with suppress(OSError):  # closed in this moment
                    connection.shutdown(socket.SHUT_RDWR)
                    self.ended += 1
                    most -= 1

    def _tell(self, what: str, now_ns: int) -> None:
        if now_ns >= self._logged_ns:
            self._logged_ns = now_ns + LOG_APART_NS
            log.warning("%s: hung up (on %d connections so far)", what, self.ended)

    def _connections(
        self, *, unread_only: bool = True, newest_first: bool = False
    ) -> Iterator[tuple[socket.socket, object, object, int]]:
        """Yield the connections that clients have opened: each with its peer, its place and how much is unread [bytes].

        By the numbers of their files, of which a new one has the lowest that is free.

        Args:
            unread_only: Only those with unread bytes.
            newest_first: In the order in which those come that were opened last.
        """
        unread = array("i", [0])
        files: Sequence[int]
        try:
            files = sorted(map(int, os.listdir("/proc/self/fd")))
        except OSError:  # no more files can be opened: all there may be are
            files = range(resource.getrlimit(resource.RLIMIT_NOFILE)[0])
        self._seen = len(files)
        if self._seen > LOOKED_AT:
            files = sorted(random.sample(files, LOOKED_AT))
        for number in reversed(files) if newest_first else files:
            with suppress(OSError):  # no socket, or closed in this moment
                ioctl(number, FIONREAD, unread)
                if unread[0] or not unread_only:
                    connection = socket.socket(fileno=number)
                    try:
                        if self._is_own(connection.getsockname()):
                            yield connection, _peer(connection), _place(connection), unread[0]
                    finally:
                        connection.detach()  # it is zenoh's


def name_of(thread_id: int) -> str:
    """Return the name of a thread of this process.

    Raises:
        OSError: It has ended.
    """
    return Path(f"/proc/self/task/{thread_id}/comm").read_text()


def _peer(connection: socket.socket) -> object:
    """Return what tells the process at the other end from others."""
    if connection.family == socket.AF_UNIX:
        pid, _, _ = _credentials(connection)
        return Process(f"process {pid}") if pid else f"connection {connection.fileno()}"
    return f"{connection.getpeername()}"


def _place(connection: socket.socket) -> object:
    """Return what tells where the other end is: the process here, the user whose containers have one, or the host."""
    if connection.family == socket.AF_UNIX:
        pid, user, _ = _credentials(connection)
        return _peer(connection) if pid else f"user {user}'s containers"
    return f"host {connection.getpeername()[0]}"


def _credentials(connection: socket.socket) -> tuple[int, int, int]:
    """Return process, user and group at the other end of a unix socket; process 0 is one of another container."""
    pid, user, group = struct.unpack("iII", connection.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, 12))
    return pid, user, group


class OrdinaryWhileBusy:
    """Takes this process's threads, but the one that calls and those that send, out of real time while they are busy.

    Args:
        is_reader: Whether a thread, by its number, works for whoever asks.
    """

    def __init__(self, is_reader: Callable[[int], bool] = lambda _: False) -> None:
        self._is_reader = is_reader
        self.lowered: dict[int, tuple[int, int, int]] = {}
        """Threads that were taken out of real time, with policy, priority and nice value that they had."""
        self._looked_ns = time.monotonic_ns()
        self._used_ns = time.process_time_ns()
        self._busy_ns = self._looked_ns

    def look(self, now_ns: int) -> None:
        """Judge the time since the last look, if it is time to.

        Args:
            now_ns: Monotonic time [ns].
        """
        if now_ns - self._looked_ns >= CALM_NS:
            self.judge(now_ns, time.process_time_ns())

    def judge(self, now_ns: int, used_ns: int) -> None:
        """Judge the time since the last look.

        Args:
            now_ns: Monotonic time [ns].
            used_ns: Processor time that this process has used [ns].
        """
        is_busy = used_ns - self._used_ns > BUSY_SHARE * (now_ns - self._looked_ns)
        self._looked_ns, self._used_ns = now_ns, used_ns
        if is_busy:
            self._busy_ns = now_ns
            self._lower()
        elif self.lowered and now_ns - self._busy_ns > CALMED_NS:
            try:
                here = set(map(int, os.listdir("/proc/self/task")))
            except OSError:  # no more files: at the next look
                return
            for thread_id, (policy, priority, nice) in self.lowered.items():
                with suppress(OSError):
                    if thread_id not in here:  # it ended, and its number may be another program's by now
                        continue
                    os.setpriority(os.PRIO_PROCESS, thread_id, nice)  # or processes that it starts would have ours
                    os.sched_setscheduler(thread_id, policy, os.sched_param(priority))
            self.lowered.clear()

    def _lower(self) -> None:
        with suppress(OSError):  # as above: no more files
            for thread_id in {int(name) for name in os.listdir("/proc/self/task")} - {threading.get_native_id()}:
                with suppress(OSError):  # it ended
                    policy = os.sched_getscheduler(thread_id)
                    if policy == os.SCHED_OTHER:
                        continue
                    name = name_of(thread_id)  # of few: it takes a file
                    if not name.startswith(SENDER):
                        *_, nice = self.lowered.get(thread_id) or (os.getpriority(os.PRIO_PROCESS, thread_id),)
                        self.lowered[thread_id] = policy, os.sched_getparam(thread_id).sched_priority, nice
                        os.sched_setscheduler(thread_id, os.SCHED_OTHER, os.sched_param(0))
                        os.setpriority(os.PRIO_PROCESS, thread_id, self._busy_nice(thread_id, name))

    def _busy_nice(self, thread_id: int, name: str) -> int:
        if name.startswith(ACCEPTORS):
            return AS_OTHERS
        return BEFORE_OTHERS if name.startswith(RECEIVERS) or self._is_reader(thread_id) else FIRST_OF_ALL
