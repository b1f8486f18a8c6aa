"""What a client knows: newest snapshot, notices, daemon, lease. Shared by the blocking and the async shell.

Rules
    * The daemon's messages come from other threads; everything is guarded by one condition, which is notified on each
      change. A snapshot is decoded when somebody looks at it, once.
    * A process that was forked after `connect()` has none of zenoh's threads: it is told so instead of hanging.
    * The lease is kept alive by a beat of its own from `acquire` on. Letting go of the robot without a word, by
      `abandon` or by dying, leaves it held.

It sends and remembers; waiting is the shells' business (`waits` says for what), and what to send is `procedures`'.
"""

from __future__ import annotations

import contextlib
import logging
import os
import secrets
import threading
import weakref
from collections.abc import Callable, Iterator

from gateway.api import protocol
from gateway.client.connection.forgotten import close_forgotten, weakly
from gateway.client.connection.identity import new_client_id
from gateway.client.connection.inlet import Inlet
from gateway.client.connection.news import News
from gateway.client.connection.records import Lease, Motion, Sighting
from gateway.client.connection.transport import SPAWN_HINT, Transport
from gateway.errors import Code, GatewayError, failure

__all__ = ["Lease", "Motion", "Session", "Sighting"]

GONE_NS = 1_000_000_000
"""A daemon that is away for longer is gone; shorter is a hiccup of the connection [ns]."""

log = logging.getLogger(__name__)


class Session:
    """One client of one daemon.

    Args:
        transport: Way to the daemon; not open yet.
        name: How this client is shown to others.
    """

    def __init__(self, transport: Transport, name: str) -> None:
        self.transport = transport
        self.name = protocol.printable(name)[:64]
        self.client_id = new_client_id()
        self.secret = secrets.token_hex(16)
        self.changed = threading.Condition()
        self.daemon = ""
        self.other_versions: set[str] = set()
        self.info: protocol.Info | None = None
        self.lease: Lease | None = None
        self.unkept: tuple[Lease, str] | None = None
        """The lease whose keepalive ended unasked, and why."""
        self.is_unkept_heard = False
        """Whether its user has been told."""
        self.news = News()
        self.snapshots_dropped = 0
        self.stop_undelivered, self._undelivered_ns = False, 0
        self.pid = os.getpid()
        self.is_closed = False
        """Whether this client was closed."""
        self._gone_since_ns = transport.now_ns()
        self._newest: tuple[bytes, int, int] | None = None
        self._sighting: Sighting | None = None
        self._last_seq = 0
        self._request_id = 0
        self._holding = 0
        self._motions: dict[int, Motion] = {}
        self.touch_seen = 0
        """Number of the newest touch that this program was told of by the daemon that answers now."""
        self._beating: list[Callable[[], None]] = []
        """What ends the keepalive; empty while there is none."""
        self._listeners: list[Callable[[], None]] = []
        self._finalizer: weakref.finalize[..., Session] | None = None

    def open(self, timeout_s: float) -> None:
        """Connect. From here on, a session that nobody holds any more is closed by itself.

        Raises:
            Disconnected: Nobody listens there.
        """
        self._finalizer = weakref.finalize(self, close_forgotten, self.transport, self._beating, self.pid)
        self._finalizer.atexit = False  # a process that ends needs no help, and must not wait for it
        self.transport.open(self.client_id, Inlet(self), timeout_s)
        if self.is_closed:  # meanwhile, by whoever did not want to wait for it any more
            self.transport.close()

    # ------------------------------------------------------------------------------------------------ from the daemon

    def on_snapshot(self, payload: bytes, seq: int, received_ns: int) -> None:
        """Take a snapshot; it is decoded when it is looked at."""
        with self.changed:
            if 0 < self._last_seq < seq:
                self.snapshots_dropped += seq - self._last_seq - 1
            self._last_seq = seq
            self._newest = (payload, seq, received_ns)
        self.notify()

    def on_notice(self, payload: bytes, number: int) -> None:
        """Take a notice; what lies between its number and that of the last one was lost on the way."""
        try:
            notice = protocol.decode_notice(payload)
        except protocol.Malformed as error:
            log.warning("the daemon sent a notice that cannot be read: %s", error)
            return
        with self.changed:
            self.news.take(notice, number)
            if notice.code == Code.STOP_UNDELIVERED.value:
                self.stop_undelivered, self._undelivered_ns = True, notice.at_ns
        self.notify()

    def on_daemon(self, token: str, alive: bool) -> None:
        """Learn that a daemon came or went."""
        version, daemon = protocol.token_version(token), protocol.token_id(token)
        with self.changed:
            if version != str(protocol.PROTOCOL_VERSION):
                (self.other_versions.add if alive else self.other_versions.discard)(version)
            elif alive:
                if daemon != self.daemon:
                    self._meet_another()
                if self.daemon and (self._gone_since_ns or daemon != self.daemon):
                    self.news.tell_connected(self.transport.address, self.transport.now_ns(), daemon == self.daemon)
                self.daemon, self._gone_since_ns = daemon, 0
            elif daemon == self.daemon and not self._gone_since_ns:
                self._gone_since_ns = self.transport.now_ns()
                self.news.tell_disconnected(self.transport.address, self._gone_since_ns)
        self.notify()

    def _meet_another(self) -> None:
        """Forget what another daemon said: it counts snapshots, notices and motions anew, and may have other limits."""
        self._newest = self._sighting = self.info = None
        self._last_seq = self._undelivered_ns = 0
        for motion in self._motions.values():
            motion.missing = True
        self._motions.clear()
        self.touch_seen = 0
        if self.daemon:
            self.news.begin_anew()

    def notify(self) -> None:
        """Wake everybody who waits."""
        with self.changed:
            self.changed.notify_all()
            listeners = list(self._listeners)
        for listener in listeners:
            listener()

    @contextlib.contextmanager
    def listening(self, listener: Callable[[], None]) -> Iterator[None]:
        """Call `listener` on each change, from any thread, while the block runs."""
        with self.changed:
            self._listeners.append(listener)
        try:
            yield
        finally:
            with self.changed:
                self._listeners.remove(listener)

    # ------------------------------------------------------------------------------------------------ what is known

    @property
    def is_connected(self) -> bool:
        """Whether the daemon is there at this moment; never in a forked process."""
        return bool(self.daemon) and not self._gone_since_ns and not self.is_closed and os.getpid() == self.pid

    def require_daemon(self, daemon: str | None = None) -> None:
        """Refuse unless a daemon is there, or was less than a second ago.

        Args:
            daemon: It must be this one; None for any.

        Raises:
            Disconnected: It is gone, another one took its place, the client was closed, or this process was forked.
        """
        self.require_own_process()
        if self.is_closed:
            raise _disconnected("this client was closed", "connect() again")
        if daemon is not None and self.daemon != daemon:
            message = f"the daemon at {self.transport.address} was restarted; what it did before is over"
            raise _disconnected(message, "look at the state, then take the lease with a new control()")
        if not self.daemon or (self._gone_since_ns and self.transport.now_ns() - self._gone_since_ns > GONE_NS):
            raise _disconnected(f"no daemon answers at {self.transport.address}")

    def holds(self, lease: Lease) -> bool:
        """Whether a lease of ours is the present one, of the present daemon; never in a forked process."""
        return self.lease == lease and self.daemon == lease.daemon and os.getpid() == self.pid

    def require_lease(self, lease: Lease) -> None:
        """Refuse when a lease of ours is over.

        Raises:
            LeaseError: LEASE_LOST, the daemon that gave it is gone and another one answers now, or its keepalive ended;
                NOT_OWNER, it was given back, left, or another one took its place.
            Disconnected: This process was forked.
        """
        self.require_own_process()
        if lease.daemon != self.daemon:
            raise failure(
                Code.LEASE_LOST,
                f"the daemon was restarted, and this control (epoch {lease.epoch}) ended with the earlier one",
                hint="look at the state, then take the lease with a new control(); nothing was sent again",
            )
        if self.unkept is not None and self.unkept[0] == lease:
            self.is_unkept_heard = True
            raise failure(
                Code.LEASE_LOST,
                f"this control (epoch {lease.epoch}) ended and the robot is held: {self.unkept[1]}",
                hint="report the trace in this process's log; take the lease with a new control()",
            )
        if self.lease != lease:
            raise failure(
                Code.NOT_OWNER,
                f"this control (epoch {lease.epoch}) has ended",
                hint="take the lease with a new control()",
            )

    def require_own_process(self) -> None:
        """Refuse in a process that was forked after `connect()`."""
        if os.getpid() != self.pid:
            raise _disconnected(f"this process was forked from the one that connected (pid {self.pid})", SPAWN_HINT)

    def sighting(self) -> Sighting | None:
        """Return the newest snapshot, decoded; None before the first.

        Raises:
            ProtocolError: It cannot be read.
        """
        with self.changed:
            if self._newest is not None:
                (payload, _, received_ns), self._newest = self._newest, None
                try:
                    view = protocol.decode_snapshot(payload)
                except protocol.Malformed as error:
                    raise failure(Code.UNSUPPORTED_VERSION, f"the daemon's snapshot is not ours: {error}") from None
                self._sighting = Sighting(view, received_ns, self.daemon)
                if view.at_ns > self._undelivered_ns and view.link.fresh and not view.latches:
                    self.stop_undelivered = False
                self._follow(view)
            return self._sighting

    def observe(self) -> None:
        """Look at the newest snapshot if motions of ours are under way, so that their ends are not missed."""
        with self.changed:
            if any(not motion.ended for motion in self._motions.values()):
                self.sighting()

    def follow(self, motion_id: int, after_seq: int) -> Motion:
        """Keep track of a motion of ours from now on."""
        with self.changed:
            motion = self._motions.setdefault(motion_id, Motion(motion_id, self.daemon, after_seq))
            if self._sighting is not None:
                self._follow(self._sighting.view)
            return motion

    def _follow(self, view: protocol.Snapshot) -> None:
        for motion_id, motion in list(self._motions.items()):
            if view.seq > motion.after_seq:
                found = next((entry for entry in view.motions if entry.motion_id == motion_id), None)
                if found is not None:
                    motion.view = found
                else:
                    motion.missing = not motion.ended
            if motion.ended:
                del self._motions[motion_id]

    # ------------------------------------------------------------------------------------------------ to the daemon

    def next_request_id(self) -> int:
        """Return a number that no request of this client had."""
        with self.changed:
            self._request_id += 1
            return self._request_id

    def encode(self, request: protocol.Request, request_id: int) -> bytes:
        """Return a request in its envelope.

        Raises:
            Rejected: BAD_REQUEST, it holds what has no form there: a text that is no Unicode, say.
        """
        command = protocol.Command(
            version=protocol.PROTOCOL_VERSION,
            client_id=self.client_id,
            secret=self.secret,
            request_id=request_id,
            request=request,
        )
        try:
            return protocol.encode(command, escapes=False)
        except (TypeError, ValueError, OverflowError) as error:
            message, hint = (
                f"{type(request).__name__} cannot be sent: {error}",
                "give text in UTF-8, numbers of 64 bits",
            )
            raise failure(Code.BAD_REQUEST, message, hint=hint) from None

    def put_target(self, stream_id: int, target: protocol.Target) -> None:
        """Send the newest target of a stream."""
        self.require_own_process()
        self.transport.put(protocol.target_key(self.client_id, stream_id, self.secret), protocol.encode(target))

    def keep_alive(self) -> None:
        """Begin to show that this client lives, every 50 ms: for a lease that is asked for next, and for one at a time.

        Raises:
            LeaseError: LEASE_HELD, this client owns the robot, or asks for it.
        """
        beat, lose = weakly(self._beat), weakly(self._lose_beat)
        with self.changed:
            if self._beating:
                lease, hint = self.lease, "use the other control, or end it first"
                does = (
                    "asks for the robot already"
                    if lease is None
                    else f"owns the robot already, under epoch {lease.epoch}"
                )
                raise failure(Code.LEASE_HELD, f"this client {does}", hint=hint)
            self._beating.append(self.transport.every(protocol.KEEPALIVE_PERIOD_NS, beat, lose))

    def _beat(self) -> None:
        lease = self.lease
        if lease is not None and lease.daemon != self.daemon:
            self.let_go(lease)
            return
        if not self._gone_since_ns:  # who answers next may be another daemon, to which this client is nobody
            self.transport.put(protocol.keepalive_key(self.client_id, self.secret), b"")
        try:
            self.observe()
        except GatewayError as error:
            log.warning("%s", error)

    def _lose_beat(self, why: str) -> None:
        """Nothing shows any more that this client lives: end its control, so that it hears of it; the robot is held at once."""
        if self.lease is not None:
            self.unkept, self.is_unkept_heard = (self.lease, why), False
        self.abandon()
        self.notify()

    def own(self, epoch: int) -> Lease:
        """Remember that the robot is ours."""
        self._holding += 1
        self.lease = Lease(epoch=epoch, daemon=self.daemon, holding=self._holding)
        return self.lease

    def let_go(self, lease: Lease | None) -> bool:
        """Forget a lease: it was given back, or lost; None for one that was asked for in vain. Another's stays: False."""
        with self.changed:
            if self.lease is not lease:
                return False
            self.lease = None
            beating, self._beating[:] = list(self._beating), []
        for stop in beating:
            stop()
        return True

    def forget_lost(self) -> None:
        """Let go of a lease that is over: its daemon is gone, somebody has taken it, or it became free."""
        lease = self.lease
        if lease is None:
            return
        if lease.daemon != self.daemon:
            self.let_go(lease)
        elif (seen := self.sighting()) is not None:
            now = seen.view.lease  # a snapshot from before the lease has a smaller epoch
            if now.epoch > lease.epoch or (now.epoch == lease.epoch and not now.owned):
                self.let_go(lease)

    def abandon(self, lease: Lease | None = None) -> None:
        """Leave the robot held, at once and without waiting: what an exception and Ctrl-C do. None: whatever lease there is."""
        lease = lease or self.lease
        if lease is None or os.getpid() != self.pid or not self.let_go(lease) or lease.daemon != self.daemon:
            return
        payload = self.encode(protocol.Abandon(epoch=lease.epoch), self.next_request_id())
        self.transport.ask(protocol.COMMAND_KEY, payload, protocol.REPLY_WITHIN_NS / 1e9, _ignore)

    def close(self) -> None:
        """Disconnect; with the lease, the robot is left held. Does nothing in a forked process."""
        if os.getpid() != self.pid or self.is_closed:
            return
        self.abandon()
        self.is_closed = True
        if self._finalizer is not None:
            self._finalizer.detach()
        self.transport.close()
        self.notify()


def _ignore(_: bytes | None) -> None:
    """Take a reply that nobody waits for."""


def _disconnected(message: str, hint: str = "") -> GatewayError:
    return failure(Code.DISCONNECTED, message, hint=hint)
