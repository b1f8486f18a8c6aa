"""Tests of one daemon per socket and robot."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

from gateway.api.instance_lock import InstanceLock, robot_lock_path, socket_lock_path
from gateway.errors import Code, ConfigError, NotReady


def test_a_second_holder_is_refused_with_the_first_ones_pid(tmp_path):
    """Who comes second learns who holds it and how to end that."""
    with InstanceLock(tmp_path / "x.lock", "socket /x"):
        with pytest.raises(NotReady) as caught:
            InstanceLock(tmp_path / "x.lock", "socket /x")
        assert caught.value.code is Code.OTHER_GATEWAY and caught.value.value == str(os.getpid())
        assert "socket /x" in str(caught.value) and f"kill {os.getpid()}" in caught.value.hint
    with InstanceLock(tmp_path / "x.lock", "socket /x") as again:
        again.close()
        again.close()


def test_a_dead_holder_holds_nothing(tmp_path):
    """The kernel lets go of a lock whose process was killed; its file does not matter."""
    script = (
        "import sys, time; from pathlib import Path; from gateway.api.instance_lock import InstanceLock; "
        "lock = InstanceLock(Path(sys.argv[1]), 'robot r'); print('held', flush=True); time.sleep(60)"
    )
    holder = subprocess.Popen(
        [sys.executable, "-c", script, str(tmp_path / "r.lock")], stdout=subprocess.PIPE, text=True
    )
    try:
        assert holder.stdout.readline().strip() == "held"
        with pytest.raises(NotReady, match=str(holder.pid)):
            InstanceLock(tmp_path / "r.lock", "robot r")
    finally:
        holder.kill()
        holder.wait(10)
        holder.stdout.close()
    InstanceLock(tmp_path / "r.lock", "robot r").close()


def test_children_do_not_inherit_the_lock(tmp_path):
    """A program that the daemon starts must not keep its lock alive."""
    lock = InstanceLock(tmp_path / "x.lock", "x")
    child = subprocess.Popen(
        [sys.executable, "-c", "print('up', flush=True); input()"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        close_fds=False,
    )
    try:
        assert child.stdout.readline() == b"up\n"
        lock.close()
        InstanceLock(tmp_path / "x.lock", "x").close()
    finally:
        child.communicate(b"\n", timeout=20)


def test_a_link_is_not_followed(tmp_path):
    """A link in a directory that others may write to could make us write anywhere."""
    (tmp_path / "x.lock").symlink_to(tmp_path / "elsewhere")
    with pytest.raises(ConfigError) as caught:
        InstanceLock(tmp_path / "x.lock", "x")
    assert caught.value.code is Code.BAD_CONFIG and not (tmp_path / "elsewhere").exists()


def test_a_directory_that_is_not_there_is_a_matter_of_configuration(tmp_path):
    """A path where no lock can be says so."""
    with pytest.raises(ConfigError, match="missing"):
        InstanceLock(tmp_path / "missing" / "x.lock", "x")


def test_another_users_file_can_be_locked_and_names_its_holder(tmp_path, monkeypatch):
    """A file that may only be read is locked all the same: a lock needs no right to write."""
    path = tmp_path / "x.lock"
    path.write_text("")
    real = os.open

    def read_only(name, flags, mode=0o777):
        if flags & os.O_CREAT:
            raise PermissionError(13, "Permission denied")
        return real(name, flags, mode)

    monkeypatch.setattr("gateway.api.instance_lock.os.open", read_only)
    with InstanceLock(path, "x"):
        with pytest.raises(NotReady, match="another process"):
            InstanceLock(path, "x")
    path.unlink()
    with pytest.raises(ConfigError):
        InstanceLock(path, "x")


def test_a_robot_is_known_by_its_endpoint(tmp_path):
    """Case, options and the name of this host do not make another robot; a port does."""
    same = {
        robot_lock_path(endpoint, tmp_path)
        for endpoint in (
            "tcp/127.0.0.1:9000",
            "TCP/127.0.0.1:9000",
            "tcp/localhost:9000",
            "tcp/127.0.0.1:9000#so_sndbuf=1",
        )
    }
    assert len(same) == 1 and robot_lock_path("tcp/127.0.0.1:9001", tmp_path) not in same
    assert robot_lock_path("tcp/127.0.0.1:9000").parent.is_dir()
    named = {robot_lock_path("tcp/127.0.0.1:9000", tmp_path, name) for name in ("bot1", "/bot1/", "bot2")}
    assert len(named) == 2 and not named & same  # several robots may stand behind one router
    assert socket_lock_path(tmp_path / "gw.sock") == tmp_path / "gw.sock.owner"


def test_the_directory_for_temporary_files_serves_where_there_is_none_for_locks(tmp_path, monkeypatch):
    """A host without a directory for locks has one for temporary files."""
    monkeypatch.setattr("gateway.api.instance_lock.LOCK_DIRECTORY", tmp_path / "none")
    assert robot_lock_path("tcp/h:1").parent.is_dir()
