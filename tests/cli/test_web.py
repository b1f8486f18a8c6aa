"""`ta2 web`: where it listens, and what beyond this host it refuses to do without."""

from __future__ import annotations

import contextlib
import errno
import getpass
import io
import secrets
import socket
import sys
import threading
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from cryptography.hazmat.primitives import serialization

from gateway.web import users
from tests.cli.shell import Shell
from tests.e2e.system import free_port

TLS = ("--certificate", "a.pem", "--key", "a.key")


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["--host", "robot.lab"], "'robot.lab' is no IP address"),
        (["--host", "10.0.0.7"], "--certificate, --key, --users missing"),
        (["--host", "0.0.0.0", "--users", "u"], "--certificate, --key missing"),
        (["--host", "::", *TLS], "--users missing"),
        (["--host", "0.0.0.0", "--users", "u", *TLS], "names and addresses"),
        (["--certificate", "a.pem"], "belong together"),
        (["--key", "a.key"], "belong together"),
        (["--users", "/nowhere/users"], "--add-user"),
        ([*TLS], "no certificate and key"),
        (["--add-user", "ann"], "in which file?"),
    ],
)
def test_nobody_gets_in_unknown_or_is_overheard(shell: Shell, words: list[str], told: str) -> None:
    """Beyond loopback there are TLS and users, or nothing is served; the remedy is said."""
    pytest.importorskip("starlette")
    done = shell.run("web", "--port", "1", *words)
    assert (done.status, done.out) == (1, "") and told in done.err and " -> " in done.err


@pytest.mark.parametrize(
    ("config", "told"),
    [("[body]\n", "body"), ('[model]\ncalibration = "nowhere.json"\n', "nowhere.json"), (None, "cannot be read")],
)
def test_without_a_usable_body_there_is_the_page_and_its_stop_all_the_same(
    shell: Shell, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, config: str | None, told: str
) -> None:
    """Standard error says why, and so does the page's answer."""
    pytest.importorskip("prometheus_client")
    uvicorn, testclient = pytest.importorskip("uvicorn"), pytest.importorskip("starlette.testclient")
    served = []
    monkeypatch.setattr(uvicorn.Server, "run", lambda self, sockets: served.append(self.config.app))
    path = tmp_path / "config.toml"
    if config is not None:
        path.write_text(config)
    port = free_port()
    done = shell.run("web", "--config", str(path), "--port", str(port), "--json")
    assert done.status == 0 and told in done.err
    known = {"Authorization": f"Bearer {done.json['token']}"}
    with testclient.TestClient(served[0], base_url=f"http://127.0.0.1:{port}", headers=known) as page:
        shape = page.get("/api/body").json()
        assert shape["parts"] == [] and told in shape["why"]
        assert "physical emergency stop" in page.post("/api/stop").text


def test_a_port_that_is_taken_is_told(shell: Shell) -> None:
    """With the option for another one."""
    with socket.create_server(("127.0.0.1", 0)) as taken:
        done = shell.run("web", "--port", str(taken.getsockname()[1]))
    assert done.status == 1 and "cannot be listened on" in done.err and "--port" in done.err


def test_a_key_with_a_passphrase_is_refused_and_not_asked_for(shell: Shell, tmp_path: Path) -> None:
    """Nobody sits before a service."""
    shell.run("keys", "init", "--dir", str(tmp_path))
    own = tmp_path / "ca" / "key.pem"
    key, locked = (
        serialization.load_pem_private_key(own.read_bytes(), None),
        serialization.BestAvailableEncryption(b"secret"),
    )
    own.write_bytes(key.private_bytes(serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, locked))
    done = shell.run("web", "--certificate", str(own.with_name("certificate.pem")), "--key", str(own))
    assert done.status == 1 and "without a passphrase" in done.err


@pytest.fixture
def file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A file of users, whose passwords are cheap."""
    monkeypatch.setattr(users, "COST", "16:8:1")
    return tmp_path / "users"


def test_a_password_is_typed_twice(shell: Shell, file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """And shown nowhere; two that differ write nothing."""
    typed = ["correct horse", "correct hose", "correct horse", "correct horse"]
    monkeypatch.setattr(sys.stdin, "isatty", lambda: True, raising=False)
    monkeypatch.setattr(getpass, "getpass", lambda _: typed.pop(0) if typed else broken_off())
    done = shell.run("web", "--add-user", "ann", "--users", str(file))
    assert done.status == 1 and "differ" in done.err and not file.exists()
    done = shell.run("web", "--add-user", "ann", "--users", str(file))
    assert done.status == 0 and "ann may log in" in done.out and "horse" not in done.out
    assert users.is_password("correct horse", users.read_users(file)["ann"])
    done = shell.run("web", "--add-user", "bob", "--users", str(file))
    assert done.status == 1 and "0 characters" in done.err and list(users.read_users(file)) == ["ann"]


def broken_off() -> str:
    """As Ctrl-D."""
    raise EOFError


def test_a_script_gives_the_password_as_a_line(shell: Shell, file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of its standard input: no other user of this host sees it among the processes."""
    monkeypatch.setattr(sys, "stdin", io.StringIO("correct horse\nmore"))
    assert shell.run("web", "--add-user", "ann", "--users", str(file)).status == 0
    assert users.is_password("correct horse", users.read_users(file)["ann"])
    monkeypatch.setattr(sys, "stdin", io.StringIO(""))
    assert shell.run("web", "--add-user", "bob", "--users", str(file)).status == 1
    assert list(users.read_users(file)) == ["ann"]


# -------------------------------------------------------------------------------------- over sockets, as it is served

KNOWN = "Authorization: Bearer the-secret\r\n"
Connect = Callable[[], contextlib.AbstractContextManager[socket.socket]]


@pytest.fixture
def served(shell: Shell, monkeypatch: pytest.MonkeyPatch) -> Callable[[Callable[[Connect], None]], None]:
    """Serve on loopback, without a gateway, while a story goes on with connections to it."""
    pytest.importorskip("prometheus_client")
    uvicorn = pytest.importorskip("uvicorn")
    serve = uvicorn.Server.run
    monkeypatch.setattr(secrets, "token_urlsafe", lambda _: "the-secret")

    def during(story: Callable[[Connect], None]) -> None:
        def run(server, sockets: list[socket.socket]) -> None:
            @contextlib.contextmanager
            def connect() -> Iterator[socket.socket]:
                with socket.socket() as peer:
                    peer.settimeout(60.0)
                    for buffer in (socket.SO_SNDBUF, socket.SO_RCVBUF):
                        peer.setsockopt(socket.SOL_SOCKET, buffer, 16_384)
                    peer.connect(sockets[0].getsockname())
                    yield peer

            serving = threading.Thread(target=serve, args=(server, sockets))
            serving.start()
            try:
                story(connect)
            finally:
                server.should_exit = True
                serving.join()

        monkeypatch.setattr(uvicorn.Server, "run", run)
        assert shell.run("web", "--port", str(free_port())).status == 0

    return during


def asked(peer: socket.socket, head: str, body: bytes = b"") -> bytes:
    """Ask for something; return the head of the answer."""
    peer.sendall(f"{head}\r\nHost: 127.0.0.1\r\n".encode() + body)
    answer = b""
    while b"\r\n\r\n" not in answer:
        answer += peer.recv(1) or pytest.fail("it was hung up on")
    return answer


@pytest.mark.parametrize("path", ["/api/state", "/api/stop"])
@pytest.mark.parametrize("length", ["Transfer-Encoding: chunked", "Content-Length: 100000000"])
def test_who_sends_a_body_without_end_is_answered_and_hung_up_on(served, path: str, length: str) -> None:
    """Else whoever reaches the port keeps the server busy by it, for ever, and others' stops waiting."""
    part = b"1\r\nx\r\n" * 200

    def story(connect: Connect) -> None:
        with connect() as peer:
            answer = asked(peer, f"POST {path} HTTP/1.1", f"{length}\r\n\r\n".encode() + part * 4)
            assert answer.startswith(b"HTTP/1.1 401" if path == "/api/state" else b"HTTP/1.1 503")
            with pytest.raises(ConnectionError):
                for _ in range(2000):
                    peer.sendall(part)
        with connect() as peer:
            for _ in range(2):
                asked(peer, "HEAD / HTTP/1.1", b"Content-Length: 2\r\n\r\n{}")

    served(story)


@pytest.mark.parametrize("least_wait_s", [0.0, 3600.0])
def test_silent_connections_keep_no_stop_out(served, monkeypatch: pytest.MonkeyPatch, least_wait_s: float) -> None:
    """Nor those that send a request bit by bit: who waits longest for a whole one goes. Pages stay, and so do new ones."""
    monkeypatch.setattr("gateway.web.listening.MOST_WAITING", 4)
    monkeypatch.setattr("gateway.web.listening.LEAST_WAIT_S", least_wait_s)
    limits = []
    monkeypatch.setattr("gateway.web.listening.open_more_files", lambda: limits.append("raised"))
    upgrade = "Connection: Upgrade\r\nUpgrade: websocket\r\nSec-WebSocket-Version: 13\r\nSec-WebSocket-Key: "
    upgrade += f"{'A' * 22}==\r\n{KNOWN}\r\n"

    def story(connect: Connect) -> None:
        with contextlib.ExitStack() as stack:
            page = stack.enter_context(connect())
            assert asked(page, "GET /api/live HTTP/1.1", upgrade.encode()).startswith(b"HTTP/1.1 101")
            said = (b"", b"POST", b"POST /api/stop HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Length: 9\r\n\r\n", b"")
            crowd = [stack.enter_context(connect()) for _ in range(8)]
            for number, peer in enumerate(crowd):
                peer.sendall(said[number % 4])
            for peer in [] if least_wait_s else crowd[:4]:
                with contextlib.suppress(ConnectionError):
                    assert peer.recv(1) == b""
            stopper = stack.enter_context(connect())
            for _ in range(2):
                assert asked(stopper, "POST /api/stop HTTP/1.1", b"Content-Length: 2\r\n\r\n{}").startswith(
                    b"HTTP/1.1 503"
                )
                stopper.recv(4096)
            page.sendall(b"\x89\x80\0\0\0\0")
            while page.recv(1) != b"\x8a":
                pass
            if least_wait_s:
                crowd[0].setblocking(False)
                with pytest.raises(BlockingIOError):
                    crowd[0].recv(1)
            assert limits == ["raised"]

    served(story)


def test_of_what_a_peer_sends_a_little_is_read_at_a_time(shell: Shell, monkeypatch: pytest.MonkeyPatch) -> None:
    """Else one turn of the event loop goes through 256 kB of chunks of one byte, of each connection that sends them."""
    read = []

    def run(_, sockets: list[socket.socket]) -> None:
        with socket.create_connection(sockets[0].getsockname()) as peer, sockets[0].accept()[0] as connection:
            peer.setblocking(False)
            for _ in range(20):
                with contextlib.suppress(BlockingIOError):
                    peer.send(bytes(262_144))
                read.append(len(connection.recv(262_144)))

    pytest.importorskip("prometheus_client")
    monkeypatch.setattr(pytest.importorskip("uvicorn").Server, "run", run)
    assert shell.run("web", "--port", str(free_port())).status == 0
    assert max(read) <= 32_768


def test_a_page_that_pings_and_takes_no_answers_is_hung_up_on(served) -> None:
    """Else they are kept here without end, for as long as it leaves its connection open."""
    upgrade = "Connection: Upgrade\r\nUpgrade: websocket\r\nSec-WebSocket-Version: 13\r\nSec-WebSocket-Key: "
    upgrade += f"{'A' * 22}==\r\n{KNOWN}\r\n"
    pings = (b"\x89\xfd" + bytes(4 + 125)) * 100

    def story(connect: Connect) -> None:
        with connect() as peer:
            assert asked(peer, "GET /api/live HTTP/1.1", upgrade.encode()).startswith(b"HTTP/1.1 101")
            with pytest.raises(ConnectionError):
                for _ in range(2000):
                    peer.sendall(pings)

    served(story)


def test_who_takes_nothing_for_long_is_gone(shell: Shell, monkeypatch: pytest.MonkeyPatch) -> None:
    """Also who leaves his connection open: the kernel tells, and what was kept for him is forgotten."""
    monkeypatch.setattr("gateway.cli.web.UNTAKEN_MS", 200)

    def run(_, sockets: list[socket.socket]) -> None:
        with socket.create_connection(sockets[0].getsockname()), sockets[0].accept()[0] as connection:
            connection.settimeout(60.0)
            with pytest.raises(OSError) as gone:
                while True:
                    connection.sendall(bytes(262_144))
            assert gone.value.errno == errno.ETIMEDOUT

    pytest.importorskip("prometheus_client")
    monkeypatch.setattr(pytest.importorskip("uvicorn").Server, "run", run)
    assert shell.run("web", "--port", str(free_port())).status == 0
