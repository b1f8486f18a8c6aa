"""Tests of where a daemon is looked for."""

from __future__ import annotations

import os
import socket

import pytest

from gateway.api import address
from gateway.api.protocol import AddressRefused, default_socket, find_socket, parse_address


@pytest.mark.parametrize(
    ("text", "locator"),
    [
        ("/run/ta2/gateway.sock", "unixsock-stream//run/ta2/gateway.sock"),
        ("unix:/run/ta2/gateway.sock", "unixsock-stream//run/ta2/gateway.sock"),
        ("unix:/a/../b.sock", "unixsock-stream//b.sock"),
        ("tcp/127.0.0.1:7448", "tcp/127.0.0.1:7448"),
        ("tls/robot.lab:7448", "tls/robot.lab:7448"),
        ("tcp/[::1]:7448", "tcp/[::1]:7448"),
    ],
)
def test_addresses_are_what_people_type(text, locator):
    """A path, with or without unix:, or a network address; shown again as it can be typed."""
    parsed = parse_address(text)
    assert parsed.locator == locator
    assert parse_address(str(parsed)) == parsed


def test_relative_paths_become_absolute(monkeypatch, tmp_path):
    """Zenoh wants absolute paths; people type relative ones."""
    monkeypatch.chdir(tmp_path)
    assert parse_address("./gw.sock").path == tmp_path / "gw.sock"
    assert parse_address("unix:gw.sock").path == tmp_path / "gw.sock"


@pytest.mark.parametrize(
    "text",
    [
        *("", "unix:", "gw.sock", "http://x", "tcp/:1", "tcp/host", "tcp/host:0", "tcp/host:x", "tcp/h:70000"),
        *("tcp/h:1#a=b", "/a;b", "/a?b", "/a#b", "/" + "x" * 107, "/so\udce4ck"),
    ],
)
def test_what_is_none_is_refused(text, monkeypatch):
    """No address, options of the endpoint, and paths that no unix socket can have are refused."""
    monkeypatch.delenv("TA2_FLEET", raising=False)
    with pytest.raises(AddressRefused):
        parse_address(text)


def test_the_default_is_this_users_runtime_directory():
    """XDG_RUNTIME_DIR if there is one, else a directory of this user in /tmp; TA2_SOCKET before both."""
    assert str(default_socket({"XDG_RUNTIME_DIR": "/run/user/7"})) == "/run/user/7/ta2/gateway.sock"
    assert str(default_socket({})) == f"/tmp/ta2-{os.getuid()}/gateway.sock"
    assert str(default_socket({"TA2_SOCKET": "unix:/s/x.sock", "XDG_RUNTIME_DIR": "/r"})) == "/s/x.sock"
    with pytest.raises(AddressRefused):
        default_socket({"TA2_SOCKET": "tcp/127.0.0.1:1"})


def test_a_client_finds_the_socket_that_exists(tmp_path, monkeypatch):
    """A client looks where a daemon may be; when there is none it names the default."""
    runtime = tmp_path / "runtime"
    (runtime / "ta2").mkdir(parents=True, mode=0o700)
    host = tmp_path / "host" / "gateway.sock"
    host.parent.mkdir(mode=0o755)
    monkeypatch.setattr(address, "SYSTEM_SOCKET", host)
    environ = {"XDG_RUNTIME_DIR": str(runtime)}
    own = runtime / "ta2" / "gateway.sock"
    assert find_socket(environ) == own
    with socket.socket(socket.AF_UNIX) as listener:
        listener.bind(str(host))
        assert find_socket(environ) == host
        with socket.socket(socket.AF_UNIX) as mine:
            mine.bind(str(own))
            assert find_socket(environ) == own
            assert find_socket({**environ, "TA2_SOCKET": "/x/y.sock"}) == address.Path("/x/y.sock")


def test_a_socket_in_somebody_elses_directory_is_passed_over(tmp_path, monkeypatch):
    """Nobody is led to a socket in a directory that others may write to, or behind a link."""
    open_to_all = tmp_path / "open"
    open_to_all.mkdir()
    open_to_all.chmod(0o777)
    with socket.socket(socket.AF_UNIX) as listener:
        listener.bind(str(open_to_all / "gateway.sock"))
        monkeypatch.setattr(address, "SYSTEM_SOCKET", open_to_all / "gateway.sock")
        assert find_socket({"XDG_RUNTIME_DIR": str(tmp_path)}) == tmp_path / "ta2" / "gateway.sock"
        assert find_socket({"XDG_RUNTIME_DIR": str(tmp_path), "TA2_SOCKET": "/x/y.sock"}) == address.Path("/x/y.sock")
    link = tmp_path / "link"
    link.symlink_to(tmp_path)
    assert not address.is_private(link) and not address.is_private(tmp_path / "missing")
    assert address.is_private(tmp_path)


def test_nobody_waits_for_a_socket_in_somebody_elses_directory(tmp_path, monkeypatch):
    """Where there is none yet, the next place is named; where there is no other, the folder and the remedy."""
    runtime, host = tmp_path / "ta2", tmp_path / "host"
    for folder in (runtime, host):
        folder.mkdir()
    runtime.chmod(0o777)
    places = (runtime / "gateway.sock", host / "gateway.sock")
    monkeypatch.setattr(address, "_candidates", lambda environ: places)
    assert find_socket({}) == places[1]
    host.chmod(0o777)
    with pytest.raises(AddressRefused, match=f"into {runtime}: .* TA2_SOCKET"):
        find_socket({})
    host.rmdir()
    assert find_socket({}) == places[1]
    host.symlink_to(tmp_path / "missing")
    with pytest.raises(AddressRefused):
        find_socket({})
    monkeypatch.undo()
    assert find_socket({"XDG_RUNTIME_DIR": str(tmp_path)}).parent != runtime


def test_a_bare_name_is_a_robot_of_the_fleet_that_the_environment_names(monkeypatch):
    """Without one it is no address; a fleet is a router or a file, and an address shows what a person would type."""
    monkeypatch.delenv("TA2_FLEET", raising=False)
    for text in ("robot-7", "gw.sock"):
        with pytest.raises(address.AddressRefused):
            address.parse_address(text)
    with pytest.raises(address.AddressRefused):
        address.fleet_address()
    monkeypatch.setenv("TA2_FLEET", "tls/fleet:7447")
    found = address.parse_address("robot-7")
    assert (found.locator, found.robot, found.path, str(found)) == ("tls/fleet:7447", "robot-7", None, "robot-7")
    monkeypatch.setenv("TA2_FLEET", "/etc/ta2/fleet.json5")
    found = address.parse_address("robot-7")
    assert (found.locator, found.file, found.robot) == ("", "/etc/ta2/fleet.json5", "robot-7")
    assert str(address.fleet_address()) == "/etc/ta2/fleet.json5"
    for text in ("*", "a*", "-a", "a b", "$x", "a" * 64):
        with pytest.raises(address.AddressRefused):
            address.parse_address(text)
    assert address.parse_address("./robot-7").path is not None
