"""One daemon per socket and per robot on this host: locks that the kernel lets go of when their holder dies.

Rules
    * `flock` on a file that is never removed: removing it would let two holders lock two files of one name. The lock is
      what counts; the text in the file only tells people who holds it.
    * The file is opened without following links and is not passed on to programs that the daemon starts.
    * Another user's file that cannot be opened counts while a process holds it, as /proc/locks has it, or nobody could ever
      start behind a file that somebody left there. Where none does, we go on with a file of our own beside it, under a name
      that nobody could take before, and say so. Whoever has a lock looks for held ones of that kind behind it: two who
      start at once may both be refused, and never both go on. A process in a container of its own is not in /proc/locks:
      the claim on the robot's router still is between those two.
    * A robot is known by its endpoint, however spelt. Two names of one machine are two robots here; the token on the
      robot's own router tells gateways apart across hosts and names.
"""

from __future__ import annotations

import contextlib
import errno
import fcntl
import hashlib
import logging
import os
import pwd
import tempfile
from collections.abc import Iterator
from pathlib import Path

from gateway.errors import Code, GatewayError, failure
from gateway.robot.endpoint import robot_name

__all__ = ["InstanceLock", "robot_lock_path", "socket_lock_path"]

_log = logging.getLogger(__name__)

LOCKS = Path("/proc/locks")
READING = os.O_RDONLY | os.O_CLOEXEC | os.O_NOFOLLOW | os.O_NONBLOCK
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

    Attributes:
        path: The file that is locked: `path`, or one beside it where that is another user's and cannot be opened.
    """

    def __init__(self, path: Path, what: str) -> None:
        self.what = what
        self._is_own = False
        self._file = -1
        self.path = path
        try:
            self._file = _open(path)
        except OSError as error:
            self._go_beside(error)
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            for other in _beside(path):
                if other != self.path and _is_held(other):
                    raise _held(what, other, _holder(other))
        except OSError as error:
            holder = _holder(self.path) or _read(self._file)
            self._let_go()
            if error.errno not in (errno.EWOULDBLOCK, errno.EACCES):
                raise _unusable(self.path, what, error) from None
            raise _held(what, self.path, holder) from None
        except BaseException:
            self._let_go()
            raise
        self._write(f"{os.getpid()} {what}\n")

    def close(self) -> None:
        """Let go; the file stays, empty, unless nobody else can know its name. May be called again."""
        if self._file >= 0:
            self._write("")
            self._let_go()

    def _let_go(self) -> None:
        if self._is_own:
            self.path.unlink(missing_ok=True)
        os.close(self._file)
        self._file = -1

    def __enter__(self) -> InstanceLock:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _go_beside(self, error: OSError) -> None:
        """Take a file of our own where another user's cannot be opened and no process holds it."""
        path, owner = self.path, _owner(self.path)
        if owner is None or owner == os.geteuid():
            raise _unusable(path, self.what, error) from None
        if holder := _holder(path):
            raise _held(self.what, path, holder) from None
        try:
            self._file, name = tempfile.mkstemp(prefix=f"{path.name}.", dir=path.parent)
            os.fchmod(self._file, 0o644)
        except OSError:
            raise _unusable(path, self.what, error) from None
        self.path, self._is_own = Path(name), True
        _log.error(
            "the lock %s of %s belongs to %s and cannot be opened (%s); no process is seen to hold it: going on with %s. "
            "Have it removed by them or by root: rm %s",
            *(path, self.what, _user(owner), error.strerror, name, path),
        )

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
        endpoint: zenoh endpoint of the robot's router, however spelt.
        directory: Where to put it; by default the host's directory for locks, or the one for temporary files.
        namespace: Of the robot's bridge: two robots may stand behind one router.
    """
    if directory is None:
        usable = LOCK_DIRECTORY.is_dir() and os.access(LOCK_DIRECTORY, os.W_OK)
        directory = LOCK_DIRECTORY if usable else Path(tempfile.gettempdir())
    return directory / f"ta2-robot-{hashlib.sha256(robot_name(endpoint, namespace).encode()).hexdigest()[:16]}.lock"


def _open(path: Path) -> int:
    """Return a lock file, opened.

    Raises:
        OSError: It cannot be made, or not be opened.
    """
    try:
        file = os.open(path, (READING & ~os.O_ACCMODE) | os.O_RDWR | os.O_CREAT, 0o644)
    except OSError as error:
        if error.errno not in (errno.EACCES, errno.EPERM):
            raise
        return os.open(path, READING)  # somebody else's: a lock needs no right to write
    with contextlib.suppress(OSError):  # whatever the umask: another user of this host must see the lock and its holder
        if os.fstat(file).st_uid == os.geteuid():
            os.fchmod(file, 0o644)
    return file


def _beside(path: Path) -> Iterator[Path]:
    """Return the file of a name, and those that were taken in its place."""
    yield path
    with contextlib.suppress(OSError):
        yield from (entry for entry in path.parent.iterdir() if entry.name.startswith(f"{path.name}."))


def _is_held(path: Path) -> bool:
    try:
        file = os.open(path, READING)
    except FileNotFoundError:
        return False
    except OSError:
        return _holder(path) != ""
    try:
        fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except OSError:
        return True
    finally:
        os.close(file)
    return False


def _holder(path: Path) -> str:
    """Return the id of the process that holds a lock on a file, as the kernel has it; empty when none is seen."""
    try:
        file = os.lstat(path)
        lines = LOCKS.read_text().splitlines()
    except OSError:
        return ""
    place = f"{os.major(file.st_dev):02x}:{os.minor(file.st_dev):02x}:{file.st_ino}"
    held = (line.split() for line in lines if " FLOCK " in line and "->" not in line)  # an arrow: it waits for it
    return next((fields[4] for fields in held if fields[5] == place), "")


def _owner(path: Path) -> int | None:
    try:
        return os.lstat(path).st_uid
    except OSError:
        return None


def _user(uid: int) -> str:
    try:
        return f"user {pwd.getpwuid(uid).pw_name} (uid {uid})"
    except KeyError:
        return f"uid {uid}"


def _read(file: int) -> str:
    """Return the process that a file names: its owner may have written anything."""
    with contextlib.suppress(OSError):
        holder = os.pread(file, 200, 0).decode(errors="replace").partition(" ")[0].strip()
        return holder if holder.isdecimal() else ""
    return ""


def _held(what: str, path: Path, holder: str) -> GatewayError:
    who = f"process {holder}" if holder else "another process"
    owner, user = _owner(path), _owner(Path(f"/proc/{holder}")) if holder else None
    whom = "" if user is None or user == os.geteuid() else f" of {_user(user)}"
    of = "" if owner is None or owner == os.geteuid() else f", a file of {_user(owner)}"
    by = ", as its user or root" if whom or of else ""
    remedy = f"kill {holder}" if holder else f"fuser {path} tells its process"
    return failure(
        Code.OTHER_GATEWAY,
        f"{who}{whom} is already the gateway of {what} (lock {path}{of})",
        field="pid",
        value=holder,
        hint=f"stop it first ({remedy}{by}), or choose another socket and robot",
    )


def _unusable(path: Path, what: str, error: OSError) -> GatewayError:
    owner = _owner(path)
    of = "" if owner is None or owner == os.geteuid() else f", a file of {_user(owner)}"
    return failure(
        Code.BAD_CONFIG,
        f"the lock of {what} cannot be taken at {path}{of}: {error.strerror}",
        field="socket",
        value=str(path),
        hint=f"have its owner or root remove it: rm {path}" if of else "choose a directory that this user may write to",
    )
