"""Tests of the local plane over real zenoh on loopback: sockets, locks, who may do what."""

from __future__ import annotations

import json
import os
import signal
import socket
import stat
import subprocess
import sys
import threading
import time

import pytest
import zenoh
from msgspec import structs

from gateway.api import protocol
from gateway.api.flood_watch import SENDER, name_of
from gateway.api.guard_protocol import guard_socket
from gateway.api.identities import MOST
from gateway.api.keys import ESTOP_KEY
from gateway.api.recorder_protocol import recorder_socket
from gateway.api.service import LocalPlane
from gateway.api.stop_pipe import stop_pipe
from gateway.errors import Code, ConfigError, NotReady
from gateway.messages import requests
from gateway.process.threads import take_lost
from gateway.settings.settings import LinkSettings, LocalSettings, Settings
from tests.api.daemon import Daemon, eventually, settings_for
from tests.api.samples import Q, command

pytestmark = pytest.mark.e2e

OPEN = {"tcp_open_to_every_user_of_this_host": True}


def test_nobody_passes_under_the_id_of_the_owner_or_of_who_stopped(tmp_path):
    """However many clients come; nothing that who stopped puts is taken for that."""
    plane = LocalPlane(settings_for(tmp_path), tmp_path)
    try:
        known = plane._inbox.identities
        for client_id in ("owner", "stopper"):
            known.meet(client_id, "s")
        plane.heed(frozenset({"owner"}), "stopper")
        assert plane._heeded == {"owner"}
        for number in range(MOST + 1):
            known.meet(f"made up {number}", "x")
        assert not known.meet("owner", "x") and not known.meet("stopper", "x")
        plane.heed(frozenset())
        assert known.pinned == {""}
    finally:
        plane.close()


def session_to(endpoint, **settings):
    """Return a plain zenoh client session: somebody without our library."""
    config = zenoh.Config()
    defaults = {
        "mode": "client",
        "connect/endpoints": [endpoint],
        "connect/timeout_ms": 2000,
        "connect/exit_on_failure": True,
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
    }
    for key, value in (defaults | settings).items():
        config.insert_json5(key, json.dumps(value))
    return zenoh.open(config)


@pytest.fixture
def daemon(tmp_path):
    """A daemon on a unix socket of this test."""
    with Daemon(tmp_path) as daemon:
        yield daemon


@pytest.fixture
def stranger(daemon):
    """A zenoh session of somebody without our library."""
    with session_to(f"unixsock-stream/{daemon.socket}") as session:
        yield session


def ask(session, key, payload=b"", encoding=protocol.MSGPACK, timeout=3.0):
    """Return all answers to a query, as bytes."""
    replies = session.get(key, payload=payload, encoding=encoding, timeout=timeout)
    return [reply.ok.payload.to_bytes() for reply in replies if reply.ok is not None]


def test_the_socket_is_for_owner_and_group_only(daemon):
    """The socket has mode 0660 from the start, and its directory is not open to others."""
    assert stat.S_IMODE(os.stat(daemon.socket).st_mode) == 0o660
    assert stat.S_ISSOCK(os.stat(daemon.socket).st_mode)


def test_zenohs_senders_are_known_by_their_name(stranger):
    """They stay in real time while others flood; a thread that ended has no name."""
    assert ask(stranger, protocol.INFO_KEY)
    names = {name_of(int(number)).partition("-")[0] for number in os.listdir("/proc/self/task")}
    assert {SENDER.removesuffix("-"), "rx"} <= names
    with pytest.raises(OSError):
        name_of(2**22 + 1)


def test_another_mode_and_a_new_directory_are_made_as_configured(tmp_path):
    """A configured mode is kept; a directory that is missing is made for user and group."""
    socket = tmp_path / "new" / "deep" / "gw.sock"
    with Daemon(tmp_path, socket=str(socket), socket_mode=0o600):
        assert stat.S_IMODE(os.stat(socket).st_mode) == 0o600
        assert stat.S_IMODE(os.stat(socket.parent).st_mode) & 0o027 == 0
    assert not socket.exists()


def test_a_person_can_ask_in_json(daemon, stranger):
    """Without our library: a command, the facts and a snapshot in JSON."""
    payload = protocol.encode(command(protocol.Acquire(name="curl", pid=1)), protocol.JSON)
    (reply,) = ask(stranger, protocol.COMMAND_KEY, payload, protocol.JSON)
    assert json.loads(reply)["facts"] == {"epoch": 1}
    (info,) = ask(stranger, protocol.INFO_KEY, encoding=protocol.JSON)
    assert json.loads(info)["model"] == "standard"
    (snapshot,) = ask(stranger, protocol.SNAPSHOT_KEY, encoding=protocol.JSON)
    assert json.loads(snapshot)["lease"]["name"] == "curl"


@pytest.mark.parametrize(("key", "kind"), [(protocol.STOP_KEY, requests.Stop), (protocol.ESTOP_KEY, requests.Estop)])
def test_ten_bytes_from_any_program_are_a_stop(daemon, stranger, key, kind):
    """A put of anything, a query with anything or nothing, and a delete: each is the stop; a query is answered in JSON."""
    stranger.put(key, b"0123456789")
    eventually(lambda: daemon.engine.requests)
    (reply,) = ask(stranger, key, b'{"version": 99, "request": null}', protocol.JSON)
    assert json.loads(reply)["facts"] == {"stop_undelivered": False}
    assert len(ask(stranger, key)) == 1
    stranger.delete(key)
    eventually(lambda: len(daemon.engine.requests) == 4)
    assert all(isinstance(request, kind) for _, request in daemon.engine.requests)


class Panic(BaseException):
    """As zenoh's own: none of Python's errors."""


def test_a_panic_in_a_callback_is_logged_and_the_next_stop_is_served(daemon, stranger, monkeypatch, caplog):
    """By zenoh, which ends the call and nothing else: callback, connection and queryable go on."""
    arrive, panics = daemon.plane._stops.arrive, [Panic("first"), Panic("second")]

    def panic_twice(*arguments):
        arrive(*arguments)
        if panics:
            raise panics.pop(0)

    monkeypatch.setattr(daemon.plane._stops, "arrive", panic_twice)
    stranger.put(protocol.STOP_KEY, b"")
    eventually(lambda: len(daemon.engine.requests) == 1)
    ask(stranger, protocol.STOP_KEY)
    assert len(ask(stranger, protocol.STOP_KEY)) == 1 and not panics
    assert len(daemon.engine.requests) == 3
    assert "Panic: first" in caplog.text and "Panic: second" in caplog.text


def test_a_panic_in_a_thread_of_the_plane_is_told_and_the_next_request_is_served(daemon, stranger, monkeypatch):
    """Each of the three is begun anew: until the daemon has ended it answers, and stops above all."""
    take_lost()
    for part, name, thread in (
        (daemon.plane._inbox, "sort", "ta2-api-read"),
        (daemon.plane._outbox, "deliver", "ta2-api-send"),
        (daemon.plane._stops, "deliver", "ta2-api-stop"),
    ):
        work = getattr(part, name)

        def panic_once(timeout_s, part=part, name=name, work=work):
            monkeypatch.setattr(part, name, work)
            raise Panic("boom")

        monkeypatch.setattr(part, name, panic_once)
        (lost,) = eventually(take_lost)
        assert lost.name == thread and lost.why.endswith("Panic: boom")
        assert len(ask(stranger, protocol.INFO_KEY)) == len(ask(stranger, protocol.STOP_KEY)) == 1


GIANT = """
import sys
from gateway.api import protocol
from tests.api.test_service import ask, session_to
with session_to(f"unixsock-stream/{sys.argv[1]}") as giant:
    ask(giant, protocol.COMMAND_KEY, b"x" * 1_000_000, timeout=0.5)
"""
"""A process of its own: all connections of one that floods are hung up on."""


def test_rubbish_is_answered_with_a_code_and_the_daemon_lives(daemon, stranger):
    """Whatever is asked gets one typed answer; what is too large for a message ends only its sender's connection."""
    for payload, code in ((b"rubbish", "BAD_REQUEST"), (b"x" * 100_000, "BAD_REQUEST"), (b"", "BAD_REQUEST")):
        (answer,) = ask(stranger, protocol.COMMAND_KEY, payload)
        assert protocol.decode_reply(answer).refusal.code == code
    stranger.put(protocol.target_key("me", 1, "s"), b"rubbish")
    stranger.put(protocol.target_key("me", 1, "s"), b"")
    subprocess.run([sys.executable, "-c", GIANT, str(daemon.socket)], check=True, timeout=60.0)
    (answer,) = ask(stranger, protocol.COMMAND_KEY, protocol.encode(command(protocol.Recover())))
    assert protocol.decode_reply(answer).refusal is None
    assert daemon.plane._inbox.malformed == 3, "puts of somebody who owns nothing do not come so far"


def test_a_client_cannot_pose_as_the_daemon(daemon, stranger):
    """A client that puts snapshots or notices, answers commands, or shows a daemon's token is not heard by others."""
    heard = []
    callback = zenoh.handlers.Callback
    with session_to(f"unixsock-stream/{daemon.socket}") as victim:
        for key in (protocol.SNAPSHOT_KEY, protocol.EVENT_KEY):
            victim.declare_subscriber(key, callback(lambda s: heard.append(s.payload.to_bytes()), indirect=False))
        victim.liveliness().declare_subscriber(
            protocol.DAEMON_TOKENS,
            callback(lambda s: heard.append(str(s.key_expr).encode()), indirect=False),
            history=True,
        )
        eventually(lambda: len(heard) > 5)
        poser = stranger.declare_queryable(protocol.COMMAND_KEY)
        token = stranger.liveliness().declare_token(protocol.daemon_token("poser"))
        for _ in range(20):
            stranger.put(protocol.SNAPSHOT_KEY, b"forged")
            stranger.put(protocol.EVENT_KEY, b"forged")
            time.sleep(0.005)
        answers = ask(victim, protocol.COMMAND_KEY, protocol.encode(command(protocol.Recover())))
        assert len(answers) == 1 and protocol.decode_reply(answers[0]).refusal is None
        assert b"forged" not in heard and not any(b"poser" in entry for entry in heard)
        assert poser.try_recv() is None
        token.undeclare()


def test_a_client_cannot_watch_what_others_command(daemon, stranger):
    """Targets, keepalives and tokens of clients are between them and the daemon."""
    overheard = []
    listen = zenoh.handlers.Callback(lambda s: overheard.append(str(s.key_expr)), indirect=False)
    for key in (protocol.TARGET_KEYS, protocol.KEEPALIVE_KEYS, "ta2/**", "**"):
        stranger.declare_subscriber(key, listen)
    stranger.liveliness().declare_subscriber(protocol.CLIENT_TOKENS, listen, history=True)
    with session_to(f"unixsock-stream/{daemon.socket}") as owner:
        token = owner.liveliness().declare_token(protocol.client_token("owner"))
        acquire = protocol.Acquire(name="owner", pid=1)
        ask(owner, protocol.COMMAND_KEY, protocol.encode(command(acquire, client_id="owner")))
        for seq in range(1, 20):
            owner.put(
                protocol.target_key("owner", 1, "s"), protocol.encode(protocol.Target(epoch=1, seq=seq, values=Q))
            )
            owner.put(protocol.keepalive_key("owner", "s"), b"")
            time.sleep(0.005)
        eventually(lambda: "owner" in daemon.engine.seen and daemon.engine.targets)
        token.undeclare()
        eventually(lambda: daemon.engine.gone == ["owner"])
    assert [key for key in overheard if not key.startswith((protocol.SNAPSHOT_KEY, protocol.EVENT_KEY))] == []


def test_only_those_who_matter_are_heard(daemon, stranger):
    """Targets and keepalives of others, exact or to everybody at once, end in zenoh: this process is not called."""
    reached = []
    inbox = daemon.plane._inbox
    for name in ("put_target", "put_keepalive", "put_check_in"):
        real = getattr(inbox, name)
        setattr(inbox, name, lambda key, *rest, real=real: (reached.append(key), real(key, *rest)))
    interest = stranger.declare_publisher(protocol.KEEPALIVE_KEYS)  # it is told of all that matches, if it may be
    acquire = protocol.Acquire(name="owner", pid=1)
    asked = protocol.encode(structs.replace(command(acquire, client_id="owner"), secret="s3cret"))
    with session_to(f"unixsock-stream/{daemon.socket}") as owner:
        (answer,) = ask(owner, protocol.COMMAND_KEY, asked)
        assert protocol.decode_reply(answer).refusal is None
        parts = ("*", "s$*", "$*t", "s$*t", "$*3$*r$*")  # of a secret: one that is heard tells how it is spelt
        for key in (
            "other/s3cret",
            "owner/guessed",
            "owner",
            "**",
            "*/*",
            "o$*/s$*",
            *(f"owner/{part}" for part in parts),
        ):
            stranger.put(f"{protocol.ROOT}/keepalive/{key}", b"")
            stranger.put(f"{protocol.ROOT}/check_in/{key}", b"")
        for key in ("owner/1/guessed", "owner/1", "**", "*/*/*", "owner/*/*", *(f"owner/1/{part}" for part in parts)):
            stranger.put(f"{protocol.ROOT}/target/{key}", b"")
        assert len(ask(stranger, protocol.INFO_KEY)) == 1  # behind all of these
        mine = [protocol.keepalive_key("owner", "s3cret"), protocol.target_key("owner", 1, "s3cret")]
        for key in mine:
            owner.put(key, b"")
        eventually(lambda: reached == mine)
        assert not interest.matching_status.matching, "the owner's secret was told"
        daemon.engine.free()
        (answer,) = ask(owner, protocol.COMMAND_KEY, protocol.encode(command(protocol.Recover(), client_id="other")))
        owner.put(mine[0], b"")
        assert len(ask(owner, protocol.INFO_KEY)) == 1
    assert reached == mine, "who owns nothing any more is heard"


def test_the_admin_space_is_closed(daemon, stranger):
    """Nobody reads or changes the configuration of the daemon's session."""
    zid = protocol.token_id(str(next(iter(stranger.liveliness().get(protocol.DAEMON_TOKENS))).ok.key_expr))
    assert ask(stranger, f"@/{zid}/**", timeout=0.5) == [] and ask(stranger, "@/*/router", timeout=0.5) == []


def test_snapshots_are_made_only_while_somebody_listens(daemon, stranger):
    """The first listener starts them, the last one to leave ends them."""
    (plane,) = daemon.plane._planes
    assert not plane.wants_snapshots()
    heard = []
    subscriber = stranger.declare_subscriber(
        protocol.SNAPSHOT_KEY, zenoh.handlers.Callback(lambda s: heard.append(s), indirect=False)
    )
    eventually(lambda: len(heard) > 10)
    first = heard[5]
    numbers = [int(sample.attachment.to_bytes()) for sample in heard[:10]]
    assert numbers == sorted(set(numbers)), "numbers rise; a reader that was busy misses some"
    assert str(first.encoding) == protocol.MSGPACK
    assert protocol.decode_snapshot(first.payload.to_bytes()).seq == int(first.attachment.to_bytes())
    subscriber.undeclare()
    eventually(lambda: not plane.wants_snapshots())


def test_a_second_daemon_for_the_socket_or_the_robot_is_refused(daemon, tmp_path):
    """The second one stops before it touches anything, and says which process is in its way."""
    with pytest.raises(NotReady) as caught:
        LocalPlane(daemon.settings, tmp_path)
    assert caught.value.code is Code.OTHER_GATEWAY and f"socket {daemon.socket}" in str(caught.value)
    elsewhere = Settings(local=LocalSettings(socket=str(tmp_path / "other.sock")), link=daemon.settings.link)
    with pytest.raises(NotReady) as caught:
        LocalPlane(elsewhere, tmp_path)
    assert f"robot {daemon.settings.link.endpoint}" in str(caught.value) and str(os.getpid()) in str(caught.value)
    other = Settings(local=elsewhere.local, link=LinkSettings(endpoint="tcp/another:9000"))
    LocalPlane(other, tmp_path).close()  # the failed attempt above has left nothing locked
    assert stat.S_ISSOCK(os.stat(daemon.socket).st_mode)


DAEMON_SCRIPT = """
import sys, time
from pathlib import Path
from tests.api.daemon import Daemon
with Daemon(Path(sys.argv[1])) as daemon:
    print("up", flush=True)
    time.sleep(60)
"""


def start_daemon(directory):
    """Start a daemon in a process of its own."""
    process = subprocess.Popen([sys.executable, "-c", DAEMON_SCRIPT, str(directory)], stdout=subprocess.PIPE, text=True)
    assert process.stdout.readline().strip() == "up"
    return process


def end(process):
    """Kill a process that was started here, frozen or not."""
    process.send_signal(signal.SIGCONT)
    process.kill()
    process.wait(10)
    process.stdout.close()


def test_the_socket_of_a_killed_daemon_is_taken_over(tmp_path):
    """What a killed daemon left (socket file, lock files) does not stop the next one; a living one does."""
    process = start_daemon(tmp_path)
    try:
        with pytest.raises(NotReady, match=str(process.pid)):
            LocalPlane(settings_for(tmp_path), tmp_path)
    finally:
        end(process)
    assert (tmp_path / "gw.sock").exists()
    with Daemon(tmp_path) as daemon, session_to(f"unixsock-stream/{daemon.socket}") as client:
        assert len(ask(client, protocol.INFO_KEY)) == 1


def test_a_frozen_client_does_not_hold_up_the_others(daemon, tmp_path):
    """A client that stops reading while snapshots run and replies wait for it delays nobody else for long."""
    script = (
        "import sys, time, json; from tests.api.test_service import session_to; from gateway.api import protocol; "
        "from tests.api.samples import command; import zenoh\n"
        "s = session_to(sys.argv[1])\n"
        "s.declare_subscriber(protocol.SNAPSHOT_KEY, zenoh.handlers.Callback(lambda _: None, indirect=False))\n"
        "print('up', flush=True)\n"
        "n = 0\n"
        "while True:\n"
        "    n += 1\n"
        "    s.get(protocol.INFO_KEY, zenoh.handlers.Callback(lambda _: None, indirect=False), timeout=20)\n"
        "    time.sleep(0.0005)\n"
    )
    frozen = subprocess.Popen(
        [sys.executable, "-c", script, f"unixsock-stream/{daemon.socket}"], stdout=subprocess.PIPE, text=True
    )
    try:
        assert frozen.stdout.readline().strip() == "up"
        time.sleep(0.3)
        frozen.send_signal(signal.SIGSTOP)
        with session_to(f"unixsock-stream/{daemon.socket}") as client:
            slowest = 0.0
            deadline = time.monotonic() + 3.0
            number = 0
            while time.monotonic() < deadline:
                number += 1
                started = time.monotonic()
                payload = protocol.encode(command(protocol.Stop(), number))
                assert len(ask(client, protocol.COMMAND_KEY, payload)) == 1
                slowest = max(slowest, time.monotonic() - started)
        assert slowest < 1.0
    finally:
        end(frozen)


def test_closing_leaves_no_thread_and_no_socket(tmp_path):
    """After close() everything is given back, ten times in a row."""
    before = threading.active_count()
    for _ in range(10):
        with Daemon(tmp_path) as daemon:
            assert daemon.socket.exists()
        assert not daemon.socket.exists()
    assert threading.active_count() == before
    daemon.plane.close()


# -------------------------------------------------------------------------------------------------------- the network


def test_the_network_is_shut_unless_configured(daemon):
    """By default nothing of the daemon listens on any port."""
    mine = {
        os.readlink(f"/proc/self/fd/{fd}")
        for fd in os.listdir("/proc/self/fd")
        if os.path.exists(f"/proc/self/fd/{fd}")
    }
    listening = set()
    for table in ("/proc/net/tcp", "/proc/net/tcp6"):
        with open(table) as lines:
            listening |= {f"socket:[{line.split()[9]}]" for line in list(lines)[1:] if line.split()[3] == "0A"}
    assert not mine & listening


def test_a_port_on_this_host_serves_like_the_socket(tmp_path):
    """A loopback listener answers too, beside the socket."""
    with Daemon(tmp_path, tcp="127.0.0.1:19310", **OPEN), session_to("tcp/127.0.0.1:19310") as client:
        assert len(ask(client, protocol.INFO_KEY)) == 1


def test_a_token_that_is_shown_at_the_port_ends_no_owner_at_the_socket(tmp_path):
    """Snapshots show an owner's id; whoever takes back a token of that name has taken back his own."""
    with (
        Daemon(tmp_path, tcp="127.0.0.1:19315", **OPEN) as daemon,
        session_to(f"unixsock-stream/{daemon.socket}") as owner,
        session_to("tcp/127.0.0.1:19315") as viewer,
    ):
        acquire = structs.replace(command(protocol.Acquire(name="owner", pid=1), client_id="owner"), secret="s3cret")
        ask(owner, protocol.COMMAND_KEY, protocol.encode(acquire))
        for client_id in ("owner", "viewer"):
            viewer.liveliness().declare_token(protocol.client_token(client_id)).undeclare()
        eventually(lambda: "viewer" in daemon.engine.gone)
        assert "owner" not in daemon.engine.gone
        owner.liveliness().declare_token(protocol.client_token("owner")).undeclare()
        eventually(lambda: "owner" in daemon.engine.gone)


def test_a_port_on_this_host_that_asks_nobody_is_refused_at_start(tmp_path):
    """Every user of the host reaches loopback: it is open to them in words only, and nothing stays locked."""
    with pytest.raises(ConfigError, match="every user of this host"):
        LocalPlane(settings_for(tmp_path, tcp="127.0.0.1:19314"), tmp_path)
    LocalPlane(settings_for(tmp_path), tmp_path).close()


def test_listening_beyond_this_host_without_users_is_refused_at_start(tmp_path):
    """The daemon does not start, and nothing stays locked."""
    with pytest.raises(ConfigError, match="users_file"):
        LocalPlane(settings_for(tmp_path, tcp="0.0.0.0:19311"), tmp_path)
    LocalPlane(settings_for(tmp_path), tmp_path).close()


def test_who_cannot_listen_takes_no_pipe_away_that_a_guard_reads(tmp_path):
    """The guard of the daemon before goes on with its hold, and with the stops that are dropped there."""
    with socket.socket() as taken, socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as guard:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        plane = LocalPlane(settings_for(tmp_path, tcp=f"127.0.0.1:{taken.getsockname()[1]}", **OPEN), tmp_path)
        pipe = stop_pipe(plane.socket, ESTOP_KEY)
        guard.bind(str(guard_socket(plane.socket)))
        with pytest.raises(ConfigError):
            plane.open()
        assert pipe.is_fifo()
        guard_socket(plane.socket).unlink()
        plane = LocalPlane(settings_for(tmp_path, tcp=f"127.0.0.1:{taken.getsockname()[1]}", **OPEN), tmp_path)
        with pytest.raises(ConfigError):
            plane.open()
        assert not pipe.exists(), "nobody else reads it"


def test_users_need_their_password_on_the_network_and_none_on_the_socket(tmp_path):
    """Usrpwd guards the port; the socket stays guarded by its permission bits alone."""
    users = tmp_path / "users"
    users.write_text("operator:correct horse\n")
    users.chmod(0o600)
    with Daemon(tmp_path, tcp="127.0.0.1:19312", users_file=str(users)) as daemon:
        for credentials in ({}, {"transport/auth/usrpwd": {"user": "operator", "password": "wrong"}}):
            with pytest.raises(zenoh.ZError):
                session_to("tcp/127.0.0.1:19312", **credentials | {"connect/timeout_ms": 400})
        good = {"transport/auth/usrpwd": {"user": "operator", "password": "correct horse"}}
        with session_to("tcp/127.0.0.1:19312", **good) as client:
            assert len(ask(client, protocol.INFO_KEY)) == 1
        with session_to(f"unixsock-stream/{daemon.socket}") as client:
            assert len(ask(client, protocol.INFO_KEY)) == 1


def test_a_port_in_use_is_named(tmp_path):
    """A listener that cannot be opened is a matter of configuration; the socket is given back."""
    with Daemon(tmp_path, tcp="127.0.0.1:19313", **OPEN):
        other = tmp_path / "other"
        other.mkdir()
        plane = LocalPlane(settings_for(other, tcp="127.0.0.1:19313", **OPEN), other)
        with pytest.raises(ConfigError, match="19313"):
            plane.open()
        assert not (other / "gw.sock").exists()
        LocalPlane(settings_for(other), other).close()


@pytest.mark.parametrize("socket", ["tcp/127.0.0.1:1", "relative.sock", "/proc/none/gw.sock"])
def test_a_socket_that_cannot_be_is_a_matter_of_configuration(tmp_path, socket):
    """Paths that no unix socket can have, and directories that cannot be made, are named."""
    with pytest.raises(ConfigError) as caught:
        LocalPlane(settings_for(tmp_path, socket=socket), tmp_path)
    assert caught.value.code is Code.BAD_CONFIG


@pytest.mark.parametrize("letter", ["s", "\xdf"])
@pytest.mark.parametrize("variable", ["", "TA2_SOCKET", "XDG_RUNTIME_DIR"])
def test_the_sockets_beside_a_gateways_fit_into_the_kernels_address_too(tmp_path, monkeypatch, letter, variable):
    """However its path is named: 98 bytes, letters beyond ASCII take more than one; else nobody could ask its guard."""
    monkeypatch.delenv("TA2_SOCKET", raising=False)

    def plane_at(size):
        name = "/ta2/gateway.sock" if variable == "XDG_RUNTIME_DIR" else ""
        wanted = size - len(f"{tmp_path}/{name}")
        path = f"{tmp_path}/{letter * (wanted // len(letter.encode()))}{'.' * (wanted % len(letter.encode()))}"
        monkeypatch.setenv(variable or "UNUSED", path)
        assert len(f"{path}{name}".encode()) == size
        return LocalPlane(settings_for(tmp_path, socket="" if variable else path), tmp_path)

    plane = plane_at(98)
    for beside in (guard_socket(plane.socket), recorder_socket(f"unix:{plane.socket}")):
        with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as listener:
            listener.bind(str(beside))
    plane.close()
    with pytest.raises(ConfigError, match=r"99 bytes are outside \[1, 98\] bytes.* --socket"):
        plane_at(99)


def test_the_default_directory_must_be_this_users(tmp_path, monkeypatch):
    """A default directory that somebody else made is not used."""
    (tmp_path / "ta2").mkdir()
    (tmp_path / "ta2").chmod(0o777)
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    monkeypatch.delenv("TA2_SOCKET", raising=False)
    with pytest.raises(ConfigError, match="somebody else"):
        LocalPlane(settings_for(tmp_path, socket=""), tmp_path)
    (tmp_path / "ta2").rmdir()
    plane = LocalPlane(settings_for(tmp_path, socket=""), tmp_path)
    assert plane.socket == tmp_path / "ta2" / "gateway.sock"
    assert stat.S_IMODE(os.stat(plane.socket.parent).st_mode) == 0o700
    plane.close()
