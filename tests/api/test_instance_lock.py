"""Tests of one daemon per socket and robot."""

from __future__ import annotations

import fcntl
import os
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

from gateway.api import instance_lock
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
        with pytest.raises(NotReady, match=str(os.getpid())):  # by the kernel's own list
            InstanceLock(path, "x")
        monkeypatch.setattr(instance_lock, "LOCKS", tmp_path / "none")
        with pytest.raises(NotReady, match="another process") as caught:
            InstanceLock(path, "x")
        assert f"fuser {path}" in caught.value.hint
    path.unlink()
    with pytest.raises(ConfigError):
        InstanceLock(path, "x")


def strangers(monkeypatch, path):
    """Make a file look like another user's that may not even be read."""
    opened, owner = instance_lock._open, instance_lock._owner

    def refuse(name):
        if name == path:
            raise PermissionError(13, "Permission denied")
        return opened(name)

    monkeypatch.setattr(instance_lock, "_open", refuse)
    monkeypatch.setattr(instance_lock, "_owner", lambda name: 4711 if name == path else owner(name))


def test_another_users_closed_file_does_not_block_the_start_for_ever(tmp_path, monkeypatch, caplog):
    """Nobody holds it: we go on beside it, say whose it is and what to do, and are alone all the same."""
    path = tmp_path / "x.lock"
    path.touch()
    with monkeypatch.context() as patched:
        strangers(patched, path)
        first = InstanceLock(path, "robot r")
        assert first.path != path and first.path.name.startswith("x.lock.")
        assert f"{path} of robot r belongs to uid 4711" in caplog.text and f"rm {path}" in caplog.text
        with pytest.raises(NotReady, match=str(os.getpid())):
            InstanceLock(path, "robot r")
    with pytest.raises(NotReady) as caught:  # nor beside it whoever can open the file, as its owner can
        InstanceLock(path, "robot r")
    assert str(first.path) in str(caught.value)
    first.close()
    assert list(tmp_path.iterdir()) == [path]
    InstanceLock(path, "robot r").close()


def test_another_users_closed_file_counts_while_a_process_holds_it(tmp_path, monkeypatch):
    """With its process, its owner, its path and what to do; free when that process ends."""
    path = tmp_path / "x.lock"
    holder = os.open(path, os.O_RDWR | os.O_CREAT)
    fcntl.flock(holder, fcntl.LOCK_EX)
    strangers(monkeypatch, path)
    with pytest.raises(NotReady) as caught:
        InstanceLock(path, "robot r")
    assert "a file of uid 4711" in str(caught.value) and str(path) in str(caught.value)
    assert f"kill {os.getpid()}, as its user or root" in caught.value.hint
    os.close(holder)
    InstanceLock(path, "robot r").close()


def test_our_own_closed_file_is_a_matter_of_configuration(tmp_path, monkeypatch):
    """Only another user's is gone around; a folder that takes no file is named with its owner."""
    path = tmp_path / "x.lock"
    path.touch()
    strangers(monkeypatch, path)
    monkeypatch.setattr(instance_lock.tempfile, "mkstemp", lambda **_: os.open(tmp_path / "no" / "x", os.O_RDWR))
    with pytest.raises(ConfigError, match="a file of uid 4711") as caught:
        InstanceLock(path, "robot r")
    assert f"rm {path}" in caught.value.hint
    monkeypatch.setattr(instance_lock, "_owner", lambda _: os.geteuid())
    with pytest.raises(ConfigError, match="Permission denied"):
        InstanceLock(path, "robot r")


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can be another user")
def test_two_real_users():
    """A file of one, mode 0600, and a daemon of the other; then the one's own daemon finds the other's lock."""
    with tempfile.TemporaryDirectory() as folder:
        os.chmod(folder, 0o1777)
        two_real_users(Path(folder) / "r.lock")


def two_real_users(path):
    """As root and as nobody."""
    path.touch(0o600)
    path.chmod(0o600)
    script = (
        "import os, sys, fcntl; from pathlib import Path; from gateway.api.instance_lock import InstanceLock; "
        "os.setgid(65534); os.setuid(65534); lock = InstanceLock(Path(sys.argv[1]), 'robot r'); "
        "print(lock.path, flush=True); input()"
    )
    other = subprocess.Popen(
        [sys.executable, "-c", script, str(path)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    try:
        assert other.stdout.readline().startswith(f"{path}.")
        with pytest.raises(NotReady, match=f"process {other.pid} of user nobody") as caught:
            InstanceLock(path, "robot r")
        assert "as its user or root" in caught.value.hint
    finally:
        other.communicate("\n", timeout=20)
    InstanceLock(path, "robot r").close()


def test_the_file_can_be_read_by_others_whatever_the_umask(tmp_path):
    """Another user's daemon must see the lock."""
    before = os.umask(0o077)
    try:
        InstanceLock(tmp_path / "x.lock", "x").close()
    finally:
        os.umask(before)
    assert (tmp_path / "x.lock").stat().st_mode & 0o777 == 0o644


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
