"""The local plane of a daemon: sockets, threads and locks around the inbox and the outbox.

Rules
    * The constructor takes the locks: a second daemon for the same socket or robot stops here, before it touches
      anything. `open` opens the listeners; `close` gives everything back, in reverse.
    * The unix socket is private until its permission bits stand; a socket file left by a dead daemon is replaced, one
      of a living daemon never is (its lock is held).
    * One thread reads questions, one sends, one answers stops, one looks who floods. The loop thread calls `poll`, `send` and
      `publish_snapshot`, which never wait for a client, and `wait` when it has nothing else to do.
"""

from __future__ import annotations

import logging
import os
import threading
import time
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

import zenoh

from gateway.api import protocol
from gateway.api.access.audit import Audit
from gateway.api.access.roles import read_roles
from gateway.api.address import MAX_GATEWAY_PATH_BYTES, is_private
from gateway.api.bell import Bell
from gateway.api.flood_watch import FloodWatch, OrdinaryWhileBusy
from gateway.api.guard_protocol import guard_socket
from gateway.api.inbox import Inbox
from gateway.api.instance_lock import InstanceLock, robot_lock_path, socket_lock_path
from gateway.api.listener import network_configuration, refused_setting, unix_configuration
from gateway.api.outbox import Outbox
from gateway.api.stop_lane import StopLane
from gateway.api.stop_pipe import StopPipes
from gateway.api.translate import describe
from gateway.api.zenoh_plane import ZenohPlane
from gateway.core.messages import events, outputs
from gateway.messages.snapshot import Snapshot
from gateway.process.threads import supervised
from gateway.process.zenoh_words import in_words
from gateway.settings.settings import LocalSettings, Settings

__all__ = ["LocalPlane"]

IDLE_S = 0.1
"""How long a thread waits for work before it looks at its other duties [s]."""

AUDIT_CLOSE_S = 0.5
"""How long is waited for the disk with the audit log [s]."""

log = logging.getLogger(__name__)


class LocalPlane:
    """Where clients reach this daemon. Context manager.

    Args:
        settings: Effective settings; `local` says where to listen, `link.endpoint` names the robot.
        lock_directory: Where the lock of the robot lives; by default the host's directory for locks.

    Raises:
        NotReady: OTHER_GATEWAY, another daemon has this socket or this robot; the message names its process id.
        ConfigError: BAD_CONFIG, the socket's path or the network listener cannot be as configured.
    """

    def __init__(self, settings: Settings, lock_directory: Path | None = None) -> None:
        local = settings.local
        protocol.prepare()
        self.socket = _socket_path(local)
        self.info = describe(settings, socket=str(self.socket), pid=os.getpid())
        self._mode = local.socket_mode
        self._roles = read_roles(local.roles_file) if local.roles_file else None
        self._network = network_configuration(local, self._roles)
        self._stops = StopLane()
        self._outbox = Outbox(self.info, self._stops)
        self._audit = Audit(local.audit_log, local.audit_log_mb * 1_000_000, self._stops)
        self._inbox = Inbox(self._outbox, self._audit)
        self._stops.watched, self._stops.on_taken = self._audit.watched, self._audit.note_stop
        self._bell = Bell()  # while the loop rests
        self._stops.on_arrival = self._inbox.on_arrival = self._bell.ring
        self._pipes: StopPipes | None = None
        self._stops.proven = self._inbox.identities.is_proven
        self._planes: list[ZenohPlane] = []
        self._threads: list[threading.Thread] = []
        self._running = False
        _prepare_directory(self.socket, is_default=not local.socket)
        self._floods = FloodWatch(self._is_own)
        self._answering: tuple[int | None, ...] = ()
        """Kernel's ids of the threads that read questions and answer them."""
        self._policy = OrdinaryWhileBusy(lambda thread_id: thread_id in self._answering)
        self._is_closing = threading.Event()
        self._heeded: frozenset[str] = frozenset()
        self._locks = [InstanceLock(socket_lock_path(self.socket), f"socket {self.socket}")]
        try:
            endpoint, namespace = settings.link.endpoint, settings.link.namespace.strip("/")
            name = f"robot {endpoint}" + (f" namespace {namespace}" if namespace else "")
            self._locks.append(InstanceLock(robot_lock_path(endpoint, lock_directory, namespace), name))
        except BaseException:  # whatever it was, the socket must not stay locked by a plane that never was
            self._locks[0].close()
            raise

    def open(self) -> None:
        """Listen. Clients can connect and ask from now on; they are answered when the loop polls.

        Raises:
            ConfigError: BAD_CONFIG, a listener cannot be opened: port in use, directory not writable, bad certificate.
        """
        try:
            self._open_unix()
            self._open_pipes()
            if self._network is not None:
                self._open(self._network, "tcp", self._network["listen/endpoints"][0])
        except BaseException:  # half an opened plane must not stay
            self.close()
            raise
        self._running = True
        self._audit.start()
        for name, work in (
            ("ta2-api-read", self._read),
            ("ta2-api-send", self._send),
            ("ta2-api-stop", self._answer_stops),
            ("ta2-api-floods", self._watch_floods),
        ):
            thread = supervised(work, name, may_return=lambda: not self._running, again=True)
            thread.start()
            self._threads.append(thread)
        self._answering = tuple(thread.native_id for thread in self._threads[:2])

    def _is_own(self, address: object) -> bool:
        """Whether we listen at a local address: a path, or host and port."""
        if isinstance(address, str):
            return address == str(self.socket)
        port = self._network["listen/endpoints"][0].rpartition(":")[2] if self._network else ""
        return isinstance(address, tuple) and str(address[1]) == port

    def _open_unix(self) -> None:
        before = os.umask(0o777 & ~self._mode)  # the socket is never wider than it will be
        try:
            self._open(unix_configuration(self.socket), "socket", str(self.socket))
        finally:
            os.umask(before)
        os.chmod(self.socket, self._mode)

    def _open_pipes(self) -> None:
        try:
            self._pipes = StopPipes(self.socket, self._mode)
        except OSError as error:
            raise refused_setting(
                "socket", str(self.socket), f"no pipes for stops can be made beside it: {error}"
            ) from None

    def _open(self, configuration: dict[str, object], name: str, value: str) -> None:
        try:
            roles = self._roles if configuration is self._network else None  # who may open the socket is an admin
            plane = ZenohPlane(configuration, self._inbox, self._stops, roles)
        except zenoh.ZError as error:
            raise refused_setting(name, value, f"cannot listen there: {in_words(error)}") from None
        self._planes.append(plane)
        self._outbox.add_audience(plane)
        log.info("listening on %s", value)

    def close(self, timeout_s: float = 2.0) -> None:
        """Stop listening, end the threads, give the locks back. May be called again.

        Args:
            timeout_s: How long to wait for what is still to be sent, and for each thread [s].
        """
        self._running = False
        self._is_closing.set()
        self._inbox.wake()
        self._outbox.wake()
        self._stops.wake()
        for thread in self._threads:
            thread.join(timeout_s)
        self._threads.clear()
        while self._planes:
            self._planes.pop().close()
        self._audit.close(AUDIT_CLOSE_S)
        if self._pipes is not None:
            self._pipes.close(is_last=not guard_socket(self.socket).exists())  # a guard that acts reads them still
        for lock in reversed(self._locks):
            lock.close()

    def __enter__(self) -> LocalPlane:
        self.open()
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    # ------------------------------------------------------------------------------------------------ the loop thread

    def poll(self) -> list[events.Event]:
        """Return what clients sent since the last call: stops first. Never waits."""
        self._policy.look(time.monotonic_ns())
        for plane in self._planes:
            plane.take_departures()
        return [*self.poll_stops(), *self._inbox.poll()]

    def poll_stops(self) -> list[events.CommandRequested]:
        """Return the stops that arrived on their own keys, or in their pipes, since the last call. Never waits."""
        self._take_dropped()
        return self._stops.poll()

    def _take_dropped(self) -> None:
        if self._pipes is not None:
            for key, payload in self._pipes.read():
                self._stops.arrive(key, payload, time.monotonic_ns(), None, "pipe")

    def wait_for_stop(self, seconds: float) -> bool:
        """Wait for a stop on its own key or in its pipe, at most so long [s]; return whether there is one."""
        # Not looked at while a stop waits to be polled: a flood of them must not take the processor.
        pipes = [] if self._stops.has_waiting else self._pipe_files
        is_there = self._stops.wait(seconds, pipes)
        if is_there and pipes:
            self._take_dropped()
        return is_there

    @property
    def _pipe_files(self) -> list[int]:
        return [] if self._pipes is None else self._pipes.files

    def wait(self, seconds: float) -> bool:
        """Wait for a request, at most so long [s]; return whether there is one."""
        if self._inbox.has_more:
            return True
        return self._bell.wait(seconds, self._pipe_files)

    def heed(self, client_ids: frozenset[str], stopper_id: str = "", owner_id: str | None = None) -> None:
        """Let those clients, and nobody else, put targets, keepalives and check-ins. Call it before `send`. Never waits.

        They can before the replies of that `send` leave. Nobody else passes under their ids, however many clients come.

        Args:
            client_ids: Of the owner, lost or not, and of the stop endpoints.
            stopper_id: Who alone may undo a stop; nothing that he puts is taken for that.
            owner_id: Who owns the robot; None for nobody.
        """
        self._inbox.identities.pinned = client_ids | {stopper_id}
        if owner_id is not None:
            self._inbox.identities.note_owner(owner_id)
        if client_ids != self._heeded:
            self._heeded = client_ids
            self._outbox.do(partial(self._open_lanes, client_ids))

    def send(self, replies: Sequence[outputs.Reply], notices: Sequence[outputs.Notice]) -> None:
        """Pass on what a tick brought. Never waits. Call it before `publish_snapshot` of the same tick."""
        self._outbox.send(replies, notices)

    def publish_snapshot(self, snapshot: Snapshot) -> None:
        """Pass on the newest snapshot; it is sent while somebody listens. Never waits."""
        self._outbox.publish_snapshot(snapshot)

    @property
    def is_watched(self) -> bool:
        """Whether anybody listens to snapshots at present: else few are enough."""
        return self._outbox.is_watched

    def take_reading(self, reading: events.SettingsRead, settings: Settings | None) -> None:
        """Write down that the settings file was read anew, and say of this daemon what is so now. Never waits.

        Args:
            reading: How it went.
            settings: Those in force from now on; None where nothing was taken. Who is connected knows those from before.
        """
        self._audit.note_reading(reading.message, reading.at_ns, is_refused=reading.is_refused)
        if settings is not None:
            self._outbox.info = self.info = describe(settings, socket=str(self.socket), pid=os.getpid())
            self._audit.most_bytes = settings.local.audit_log_mb * 1_000_000

    def tell_routes_of(self, routes: Callable[[], protocol.Routes]) -> None:
        """Answer questions about the robot's bridge with this; it is called in a thread of this plane."""
        self._outbox.routes = routes

    # ------------------------------------------------------------------------------------------------ own threads

    def _open_lanes(self, client_ids: frozenset[str]) -> None:
        known = ((client_id, self._inbox.identities.secret_of(client_id)) for client_id in client_ids)
        lanes = {(client_id, secret) for client_id, secret in known if secret is not None}
        for plane in self._planes:
            plane.open_lanes(lanes)

    def _read(self) -> None:
        while self._running:
            self._guarded(lambda: self._inbox.sort(IDLE_S))

    def _answer_stops(self) -> None:
        while self._running or self._stops.deliver(0):
            self._guarded(lambda: self._stops.deliver(IDLE_S))

    def _send(self) -> None:
        while self._running or self._outbox.deliver(0):  # what lies there when we close still goes out
            self._guarded(lambda: self._outbox.deliver(IDLE_S))
            self._guarded(lambda: self._outbox.expire(time.monotonic_ns()))

    def _watch_floods(self) -> None:
        while not self._is_closing.wait(max(self._floods.due_ns - time.monotonic_ns(), 0) / 1e9):
            self._guarded(lambda: self._floods.glance(time.monotonic_ns(), time.process_time_ns()))

    def _guarded(self, work: Callable[[], object]) -> None:
        try:
            work()
        except Exception:  # whatever one request does, the others must still be served; logged with its trace
            log.exception("a request could not be served")


def _socket_path(local: LocalSettings) -> Path:
    try:
        address = protocol.parse_address(local.socket or str(protocol.default_socket()))
    except protocol.AddressRefused as error:
        raise refused_setting("socket", local.socket, str(error)) from None
    if address.path is None:
        raise refused_setting("socket", local.socket, "a path is needed; the network is configured with local.tcp")
    if (size := len(os.fsencode(address.path))) > MAX_GATEWAY_PATH_BYTES:
        bound, hint = (
            f"[1, {MAX_GATEWAY_PATH_BYTES}] bytes",
            "name a shorter path: --socket, local.socket or TA2_SOCKET",
        )
        message = f"{size} bytes are outside {bound}: its guard's and a recorder's are longer names"
        raise refused_setting("socket", str(address.path), message, bound, hint)
    return address.path


def _prepare_directory(socket: Path, *, is_default: bool) -> None:
    """Create the socket's directory for this user (and, where one was named, its group) alone."""
    directory = socket.parent
    try:
        directory.mkdir(mode=0o700 if is_default else 0o750, parents=True, exist_ok=True)
    except OSError as error:
        raise refused_setting("socket", str(socket), f"its directory cannot be created: {error.strerror}") from None
    if is_default and not is_private(directory):
        raise refused_setting("socket", str(socket), f"{directory} belongs to, or may be written by, somebody else")
