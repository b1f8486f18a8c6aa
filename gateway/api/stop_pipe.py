"""Where a stop is dropped without a connection: two named pipes beside the gateway's socket, `<socket>.stop` and `.estop`.

    echo smoke | dd of=/run/user/1000/ta2/gateway.sock.estop oflag=nonblock conv=nocreat

Whatever is written there is the stop; each line is one, with what the keys of stops take as a payload. No session is opened
for it, and no thread of zenoh, no connection and no lock stands between the writer and the control loop, which sleeps on
these pipes: a crowd that keeps newcomers from connecting keeps no stop away. A full pipe is full of stops.

Rules
    * Who may open the socket may write; nobody but the gateway's user reads, since an owner writes his secret here.
    * A pipe, no socket: nothing but bytes can come through it, and reading it waits for nobody.
    * The guard has the same pipes open, and reads them while it acts: what was written to a gateway that was frozen is not
      lost with it. Only a gateway that ends in order takes them away.
"""

from __future__ import annotations

import contextlib
import fcntl
import os
import stat
from pathlib import Path

from gateway.api.keys import ESTOP_KEY, STOP_KEY

__all__ = ["MAP_MARKS", "MAX_BYTES", "StopPipes", "drop_stop", "may_be_map", "stop_pipe"]

MAX_BYTES = 4096
"""Linux writes so many at once or none (PIPE_BUF): two writers' lines do not mix."""
MOST_LINES = 16
"""Of one reading; the others become one of nobody's: a person's may be among an owner's own, which would not keep the robot
stopped."""
SUFFIXES = {ESTOP_KEY: "estop", STOP_KEY: "stop"}
"""Key of a stop -> how its pipe is called. E-stops are read first."""
MAP_MARKS = frozenset(bytes([mark]) for mark in (*range(0x80, 0x90), 0xDE, 0xDF))
"""First bytes of a map in msgpack."""


def may_be_map(payload: bytes) -> bool:
    """Return whether what came with a stop may be a map or a part of one: it is no text for people, a secret may be in it."""
    is_map = payload[:1] in MAP_MARKS or payload.lstrip().startswith(b"{")
    return is_map or b"secret" in payload.lower().replace(b"\0", b"")


def stop_pipe(socket: Path, key: str) -> Path:
    """Return where stops of a key are dropped for the gateway at this socket.

    Args:
        socket: The gateway's.
        key: `STOP_KEY` or `ESTOP_KEY`.
    """
    return socket.with_name(f"{socket.name}.{SUFFIXES[key]}")


def drop_stop(socket: Path, key: str, payload: bytes) -> bool:
    """Drop a stop, and return whether a gateway or its guard has the pipe open. Never waits, never raises.

    Args:
        socket: The gateway's.
        key: `STOP_KEY` or `ESTOP_KEY`.
        payload: Without a line break; a longer one than `MAX_BYTES` is left away, the stop is not.
    """
    line = payload if len(payload) < MAX_BYTES and b"\n" not in payload else b""
    try:
        pipe = os.open(stop_pipe(socket, key), os.O_WRONLY | os.O_NONBLOCK | os.O_CLOEXEC | os.O_NOFOLLOW)
    except OSError:  # there is none, or nobody reads it
        return False
    try:
        if stat.S_ISFIFO(os.fstat(pipe).st_mode):  # no file that somebody left there
            os.write(pipe, line + b"\n")
            return True
    except BlockingIOError:  # full of stops
        return True
    except OSError:  # nobody reads it any more
        return False
    finally:
        os.close(pipe)
    return False


class StopPipes:
    """The reading ends.

    Args:
        socket: The gateway's.
        mode: Permission bits of the socket.

    Raises:
        OSError: They cannot be made there.
    """

    def __init__(self, socket: Path, mode: int) -> None:
        self._paths = {key: stop_pipe(socket, key) for key in SUFFIXES}
        self._files: dict[str, int] = {}
        try:
            for key, path in self._paths.items():
                self._files[key] = _opened(path, mode & 0o222 | 0o600)
        except OSError:
            self.close()
            raise

    @property
    def files(self) -> list[int]:
        """What to wait for."""
        return list(self._files.values())

    def read(self) -> list[tuple[str, bytes]]:
        """Return the key and the payload of each stop that was dropped since the last call, e-stops first. Never waits."""
        dropped = []
        for key, file in self._files.items():
            with contextlib.suppress(BlockingIOError):  # nothing
                # All that fits into the pipe, or a line would be cut, and half a map is no map but shows what is in it.
                lines = os.read(file, fcntl.fcntl(file, fcntl.F_GETPIPE_SZ)).split(b"\n", MOST_LINES)
                if not lines[-1]:  # nothing after the last line's end
                    lines.pop()
                elif len(lines) > MOST_LINES:
                    lines[-1] = b""
                dropped += [(key, line) for line in lines]
        return dropped

    def close(self, *, is_last: bool = False) -> None:
        """Read no more. May be called again.

        Args:
            is_last: Whether the pipes go, too: nobody else reads them.
        """
        for key, file in self._files.items():
            with contextlib.suppress(OSError):
                if is_last and os.stat(self._paths[key]).st_ino == os.fstat(file).st_ino:
                    os.unlink(self._paths[key])
            os.close(file)
        self._files.clear()


def _opened(path: Path, mode: int) -> int:
    """Return a pipe, made if there is none of ours, for reading; open for writing too, so that it never ends.

    Raises:
        OSError: It cannot be made.
    """
    flags = os.O_RDWR | os.O_NONBLOCK | os.O_CLOEXEC | os.O_NOFOLLOW
    for _ in range(2):
        with contextlib.suppress(FileExistsError):
            os.mkfifo(path, 0o600)
        file = -1
        with contextlib.suppress(OSError):  # a link, or somebody else's
            file = os.open(path, flags)
        if file >= 0:
            status = os.fstat(file)
            if stat.S_ISFIFO(status.st_mode) and status.st_uid == os.geteuid():
                os.fchmod(file, mode)
                return file
            os.close(file)
        os.unlink(path)
    raise FileExistsError(f"{path} is somebody else's")
