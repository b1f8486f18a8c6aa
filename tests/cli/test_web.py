"""`ta2 web`: where it listens, and what beyond this host it refuses to do without."""

from __future__ import annotations

import getpass
import io
import socket
import sys
from pathlib import Path

import pytest
from cryptography.hazmat.primitives import serialization

from gateway.web import users
from tests.cli.shell import Shell

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
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
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
