"""One daemon per socket and per robot on this host: locks that the kernel lets go of when their holder dies.

Rules
    * `flock` on a file that is never removed: removing it would let two holders lock two files of one name. The lock is
      what counts; the text in the file only tells people who holds it.
    * The file is opened without following links and is not passed on to programs that the daemon starts.
    * A robot is known by its endpoint. Two names of one machine are two robots here; the token on the robot's own
      router tells gateways apart across hosts and names.
"""

from __future__ import annotations

import errno
import fcntl
import hashlib
import os
import tempfile
from pathlib import Path

from gateway.errors import Code, GatewayError, Refusal, to_exception

__all__ = ["InstanceLock", "robot_lock_path", "socket_lock_path"]

LOCK_DIRECTORY = Path("/run/lock")
"""Where locks of a host live (Debian and Ubuntu: everybody may create files there)."""


class InstanceLock:
    """The right to be the only daemon for something. Context manager; `close` lets go.

    Args:
        path: File to lock; created when missing.
        what: What it stands for, in the refusal: `socket /run/ta2/gateway.sock`, `robot tcp/192.168.1.20:9000`.

    Raises:
        NotReady: OTHER_GATEWAY, with the process id of the holder; the right is somebody else's.
        ConfigError: BAD_CONFIG, the file cannot be created or opened.
    """

    def __init__(self, path: Path, what: str) -> None:
        self.path = path
        self.what = what
        self._file = _open(path, what)
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            holder = _read(self._file)
            os.close(self._file)
            self._file = -1
            if error.errno not in (errno.EWOULDBLOCK, errno.EACCES):
                raise _unusable(path, what, error) from None
            raise _held(what, path, holder) from None
        self._write(f"{os.getpid()} {what}\n")

    def close(self) -> None:
        """Let go; the file stays, empty. May be called again."""
        if self._file >= 0:
            self._write("")
            os.close(self._file)
            self._file = -1

    def __enter__(self) -> InstanceLock:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _write(self, text: str) -> None:
        """Write who holds the lock. A file of another user can be locked but not written: then nobody is named."""
        try:
            os.ftruncate(self._file, 0)
            os.pwrite(self._file, text.encode(), 0)
        except OSError:
            return


def socket_lock_path(socket: Path) -> Path:
    """Return the file that stands for a socket. Beside it; zenoh has a `.lock` of its own there."""
    return socket.with_name(socket.name + ".owner")


def robot_lock_path(endpoint: str, directory: Path | None = None, namespace: str = "") -> Path:
    """Return the file that stands for a robot on this host.

    Args:
        endpoint: zenoh endpoint of the robot's router; options after `#` or `?` do not matter.
        directory: Where to put it; by default the host's directory for locks, or the one for temporary files.
        namespace: Of the robot's bridge: two robots may stand behind one router.
    """
    if directory is None:
        usable = LOCK_DIRECTORY.is_dir() and os.access(LOCK_DIRECTORY, os.W_OK)
        directory = LOCK_DIRECTORY if usable else Path(tempfile.gettempdir())
    plain = endpoint.split("#")[0].split("?")[0].strip().lower().replace("/localhost:", "/127.0.0.1:")
    plain = f"{plain}/{namespace.strip('/')}".rstrip("/")
    return directory / f"ta2-robot-{hashlib.sha256(plain.encode()).hexdigest()[:16]}.lock"


def _open(path: Path, what: str) -> int:
    flags = os.O_CLOEXEC | os.O_NOFOLLOW
    try:
        # The mode lets another user of this host see the lock and its holder; only ours may write.
        return os.open(path, os.O_RDWR | os.O_CREAT | flags, 0o644)
    except OSError as error:
        if error.errno not in (errno.EACCES, errno.EPERM):
            raise _unusable(path, what, error) from None
    try:  # somebody else's file: a lock needs no right to write
        return os.open(path, os.O_RDONLY | flags)
    except OSError as error:
        raise _unusable(path, what, error) from None


def _read(file: int) -> str:
    return os.pread(file, 200, 0).decode(errors="replace").partition(" ")[0].strip()


def _held(what: str, path: Path, holder: str) -> GatewayError:
    who = f"process {holder}" if holder else "another process"
    return to_exception(
        Refusal(
            code=Code.OTHER_GATEWAY,
            message=f"{who} is already the gateway of {what} (lock {path})",
            field="pid",
            value=holder,
            hint=f"stop it first{f' (kill {holder})' if holder else ''}, or choose another socket and robot",
        )
    )


def _unusable(path: Path, what: str, error: OSError) -> GatewayError:
    return to_exception(
        Refusal(
            code=Code.BAD_CONFIG,
            message=f"the lock of {what} cannot be taken at {path}: {error.strerror}",
            field="socket",
            value=str(path),
            hint="choose a directory that this user may write to",
        )
    )
