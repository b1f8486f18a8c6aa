"""The transport over zenoh: a client session on the daemon's unix socket, or on tcp or tls when told so.

Rules
    * Client mode without scouting: this process talks to its daemon and to nobody else. No shared memory.
    * Callbacks run on zenoh's threads and only hand on. They are direct ones: a process that forgets to close can end.
    * The first connection is ours to time out; later ones zenoh restores by itself, with token and subscriptions.
"""

from __future__ import annotations

import atexit
import json
import os
import socket
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgspec
import zenoh
from msgspec import Struct

from gateway.api import protocol
from gateway.api.stop_pipe import drop_stop
from gateway.client.connection.transport import SPAWN_HINT, Receiver
from gateway.errors import Code, GatewayError, failure
from gateway.process.callbacks import direct
from gateway.process.threads import supervised
from gateway.process.zenoh_words import in_words

__all__ = ["Credentials", "ZenohTransport", "client_configuration"]

FILES = ("root_ca", "certificate", "private_key")
"""Which of the credentials are names of files."""

LEASE_MS = 2000
"""Silence after which the daemon calls our connection lost [ms]; its keepalive limit of 250 ms comes long before."""

FLEET_MESSAGE_BYTES = 256 * 1024
"""A larger message ends a connection to a fleet: no robot and no client says so much."""

STALL_US = 500_000
"""A daemon that does not read for so long while a request waits loses this connection [us]."""


_zenoh_pids: set[int] = set()
"""Of this process, once it has opened a session: zenoh's threads are made once, and a fork has none."""


class Credentials(Struct, frozen=True, kw_only=True):
    """Who we are, where a daemon asks for it (network only).

    Attributes:
        user: Name in the daemon's `users_file`; empty for none.
        password: Password there.
        root_ca: PEM file that the daemon's certificate is checked against; needed for `tls/`.
        certificate: PEM file of our own certificate, where the daemon asks for one.
        private_key: PEM file (PKCS8) of its key.
    """

    user: str = ""
    password: str = ""
    root_ca: str = ""
    certificate: str = ""
    private_key: str = ""

    @classmethod
    def from_file(cls, path: str | os.PathLike[str]) -> Credentials:
        """Return what a file says, as `ta2 keys client` writes it: JSON with these fields, file names relative to it.

        Raises:
            Rejected: BAD_REQUEST, it cannot be read, or is something else.
        """
        try:
            with open(path, "rb") as file:
                said = msgspec.json.decode(file.read(), type=dict[str, str])
            folder = os.path.dirname(os.path.abspath(path))
            files = {name: os.path.join(folder, said[name]) for name in FILES if said.get(name)}
            return cls(**{**said, **files})
        except (OSError, TypeError, ValueError) as error:
            message, hint = f"{path} cannot be read as credentials: {error}", "`ta2 keys client` writes such a file"
            raise failure(Code.BAD_REQUEST, message, field="credentials", value=str(path), hint=hint) from None

    def __repr__(self) -> str:
        """Show everything but the password."""
        return f"Credentials(user={self.user!r}, root_ca={self.root_ca!r}, certificate={self.certificate!r})"


class ZenohTransport:
    """A way to a daemon over zenoh.

    Args:
        address: Where it listens.
        credentials: Who we are; None for a unix socket and for a listener on this host without users.
    """

    def __init__(self, address: protocol.Address, credentials: Credentials | None = None) -> None:
        self.address = str(address)
        self._target = address
        self._credentials = credentials or Credentials()
        self._session: zenoh.Session | None = None
        self._receiver: Receiver | None = None
        self._declared: list[object] = []  # what zenoh would undeclare if we let go of it
        self._pid = os.getpid()
        self._user = ""
        """Under which name the daemon knows us; empty where it gives none."""

    def open(self, client_id: str, receiver: Receiver, timeout_s: float) -> None:
        """Connect, show the token, listen. Raises `Disconnected` when nobody listens there."""
        if _zenoh_pids and os.getpid() not in _zenoh_pids:
            raise _disconnected("this process was forked from one that had connected: zenoh hangs here", SPAWN_HINT)
        path = self._target.path
        if path is not None and not path.exists():
            raise _disconnected(f"there is no socket at {path}")
        if path is not None and not _is_listened_at(path):  # zenoh would wait its whole time for what is over
            if not path.is_socket():
                raise _disconnected(f"{path} is no socket", "name the gateway's socket, which `ta2 run` shows")
            raise _disconnected(f"nobody listens at {path}: the gateway there has ended")
        _zenoh_pids.add(os.getpid())
        try:
            session = zenoh.open(client_configuration(self._target, self._credentials, timeout_s))
        except zenoh.ZError as error:
            hint = "" if path is not None else "check host, port, user, password and certificates; see the daemon's log"
            raise _disconnected(
                f"nobody answers at {self.address} within {timeout_s:g} s ({in_words(error)})", hint
            ) from None
        self._session, self._receiver = session, receiver
        atexit.register(self._close_with_python)
        callback = zenoh.handlers.Callback
        session.declare_subscriber(protocol.SNAPSHOT_KEY, direct(self._on_snapshot))
        session.declare_subscriber(protocol.EVENT_KEY, callback(self._on_notice, indirect=False))
        self._declared.append(session.liveliness().declare_token(protocol.client_token(client_id)))
        if path is None:  # before the daemon's token: who sees that knows his name
            session.liveliness().declare_subscriber(
                protocol.USER_TOKENS, callback(self._on_user, indirect=False), history=True
            )
        session.liveliness().declare_subscriber(
            protocol.DAEMON_TOKENS, callback(self._on_token, indirect=False), history=True
        )

    def close(self) -> None:
        """Disconnect. May be called again."""
        atexit.unregister(self._close_with_python)
        session, self._session = self._session, None
        self._declared.clear()
        if session is not None:
            session.close()  # type: ignore[no-untyped-call]  # zenoh's stubs leave the return type out

    def _close_with_python(self) -> None:
        """End the callbacks: one that comes while Python ends is a segmentation fault (in 20 of 468 processes, at 4 kHz)."""
        if os.getpid() == self._pid:  # a forked process has none of zenoh's threads, which would be waited for
            self.close()

    def ask(self, key: str, payload: bytes, timeout_s: float, on_done: Callable[[bytes | None], None]) -> None:
        """Ask; `on_done` is called once, from a thread of zenoh."""
        session = self._session
        if session is None:
            on_done(None)
            return
        answer = _Answer(on_done)
        if key == protocol.COMMAND_KEY:
            key = protocol.command_key(self._user)
        try:
            session.get(
                key,
                zenoh.handlers.Callback(answer.take, answer.finish, indirect=False),
                payload=payload,
                encoding=protocol.MSGPACK,
                timeout=timeout_s,
                consolidation=zenoh.ConsolidationMode.NONE,
                express=True,
            )
        except zenoh.ZError:  # closed in this moment
            answer.finish()

    def drop(self, key: str, payload: bytes) -> None:
        """Drop a stop into its pipe beside the socket: nothing of zenoh comes between it and the daemon."""
        if self._target.path is not None:
            drop_stop(self._target.path, key, payload)

    def put(self, key: str, payload: bytes) -> None:
        """Send without waiting; lost when the daemon is not there or does not read."""
        session = self._session
        if session is None:
            return
        try:
            session.put(
                key,
                payload,
                encoding=protocol.MSGPACK,
                congestion_control=zenoh.CongestionControl.DROP,
                express=True,
            )
        except zenoh.ZError:  # closed in this moment: as lost as any put without a daemon
            return

    def now_ns(self) -> int:
        """Return CLOCK_MONOTONIC [ns]."""
        return time.monotonic_ns()

    def wait(self, changed: threading.Condition, timeout_s: float) -> None:
        """Wait for a notification, at most `timeout_s`."""
        changed.wait(timeout_s)

    def every(self, period_ns: int, beat: Callable[[], None], on_lost: Callable[[str], None]) -> Callable[[], None]:
        """Call `beat` from a thread of its own, on an absolute grid; missed beats are skipped."""
        return Pulse(period_ns, beat, on_lost).stop

    # ------------------------------------------------------------------------------------------------ zenoh's threads

    def _on_snapshot(self, sample: zenoh.Sample) -> None:
        now_ns = time.monotonic_ns()
        seq = sample.attachment
        if self._receiver is not None and seq is not None:
            self._receiver.on_snapshot(sample.payload.to_bytes(), int(seq.to_bytes()), now_ns)

    def _on_notice(self, sample: zenoh.Sample) -> None:
        if self._receiver is not None:
            number = sample.attachment
            self._receiver.on_notice(sample.payload.to_bytes(), 0 if number is None else int(number.to_bytes()))

    def _on_user(self, sample: zenoh.Sample) -> None:
        user = protocol.token_id(str(sample.key_expr))
        if sample.kind == zenoh.SampleKind.PUT:
            self._user = user
        elif self._user == user:
            self._user = ""

    def _on_token(self, sample: zenoh.Sample) -> None:
        if self._receiver is not None:
            self._receiver.on_daemon(str(sample.key_expr), sample.kind == zenoh.SampleKind.PUT)


def client_configuration(address: protocol.Address, credentials: Credentials, timeout_s: float) -> zenoh.Config:
    """Return the zenoh configuration of a session to a daemon, to a fleet's router, or to a robot there by its own keys.

    Args:
        address: Where.
        credentials: Who we are there, unless its file says it.
        timeout_s: Longest wait for the first connection [s].

    Raises:
        zenoh.ZError: The address is a file that cannot be read.
    """
    settings: dict[str, Any] = {
        "mode": "client",
        "connect/timeout_ms": max(1, int(timeout_s * 1000)),
        "connect/exit_on_failure": True,
        "connect/retry": {"period_init_ms": 50, "period_max_ms": 200, "period_increase_factor": 1.5},
        "listen/endpoints": [],
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
        "transport/shared_memory/enabled": False,
        "transport/link/tx/lease": LEASE_MS,
        "transport/link/tx/queue/congestion_control/block/wait_before_close": STALL_US,
    }
    if address.locator:
        settings["connect/endpoints"] = [address.locator]
    if address.robot:
        settings["namespace"] = f"{protocol.FLEET_ROOT}/{address.robot}"
        settings["transport/link/rx/max_message_size"] = FLEET_MESSAGE_BYTES
    if credentials.user:
        settings["transport/auth/usrpwd"] = {"user": credentials.user, "password": credentials.password}
    if credentials.root_ca:
        tls: dict[str, Any] = {"root_ca_certificate": credentials.root_ca}
        if credentials.certificate:  # without enable_mtls zenoh has it and does not show it
            tls["enable_mtls"] = True
            tls["connect_certificate"] = credentials.certificate
            tls["connect_private_key"] = credentials.private_key
        settings["transport/link/tls"] = tls
    config = zenoh.Config.from_file(address.file) if address.file else zenoh.Config()
    for key, value in settings.items():
        config.insert_json5(key, json.dumps(value))
    return config


class _Answer:
    """Turns the replies of one query into one call."""

    __slots__ = ("_lock", "_on_done")

    def __init__(self, on_done: Callable[[bytes | None], None]) -> None:
        self._on_done: Callable[[bytes | None], None] | None = on_done
        self._lock = threading.Lock()

    def take(self, reply: zenoh.Reply) -> None:
        sample = reply.ok  # an error is a timeout, or a queryable that went: no answer
        if sample is not None:
            self._finish(sample.payload.to_bytes())

    def finish(self) -> None:
        self._finish(None)

    def _finish(self, payload: bytes | None) -> None:
        with self._lock:
            on_done, self._on_done = self._on_done, None
        if on_done is not None:
            on_done(payload)


class Pulse:
    """A daemon thread that beats on an absolute grid until it is stopped, or Python is about to end.

    It must not be inside zenoh then: Python before 3.14 unwinds a daemon thread that comes back, and zenoh's Rust aborts
    the process over that ("exception not rethrown").
    """

    def __init__(self, period_ns: int, beat: Callable[[], None], on_lost: Callable[[str], None]) -> None:
        self._period_ns = period_ns
        self._beat = beat
        self._stopped = threading.Event()
        self._pid = os.getpid()
        atexit.register(self._end_with_python)
        self._thread = supervised(
            self._run, "ta2-keepalive", may_return=self._stopped.is_set, on_lost=lambda lost: on_lost(str(lost))
        )
        self._thread.start()

    def _run(self) -> None:
        now_ns = time.monotonic_ns()
        due_ns = now_ns + self._period_ns
        while not self._stopped.wait(max(0, due_ns - now_ns) / 1e9):
            self._beat()
            now_ns = time.monotonic_ns()
            due_ns += max(1, -(-(now_ns - due_ns) // self._period_ns)) * self._period_ns

    def stop(self) -> None:
        """End; waits for a beat in progress unless the beat itself asks."""
        atexit.unregister(self._end_with_python)
        self._stopped.set()
        if self._thread is not threading.current_thread():
            self._thread.join(1.0)

    def _end_with_python(self) -> None:
        if os.getpid() == self._pid:  # a forked process has no such thread
            self.stop()


def _is_listened_at(path: Path) -> bool:
    """Whether somebody has a socket open, dead or alive: a frozen one may have, and its guard answers for it. Never waits."""
    with socket.socket(socket.AF_UNIX) as knocking:
        knocking.setblocking(False)
        try:
            knocking.connect(str(path))
        except ConnectionRefusedError:
            return False
        except OSError:  # a crowd is before us, or zenoh will say what it is
            pass
    return True


def _disconnected(message: str, hint: str = "") -> GatewayError:
    return failure(Code.DISCONNECTED, message, hint=hint)
