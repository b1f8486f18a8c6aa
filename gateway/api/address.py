"""Where the daemon is: the default unix socket of this user, and the texts that `connect()` and `--socket` take.

Rules
    * `TA2_SOCKET` names the socket of both sides when set. Else the daemon opens `$XDG_RUNTIME_DIR/ta2/gateway.sock`,
      or `/tmp/ta2-<uid>/gateway.sock` where there is no runtime directory; a client looks at both and at `/run/ta2`.
    * A bare name is a robot of the fleet that `TA2_FLEET` names.
    * Nobody is led to a socket that somebody else put into /tmp: the directory must belong to this user or to root, and
      only its owner may write to it.

Knows paths and locators, opens nothing. Import these names from `gateway.api.protocol`.
"""

from __future__ import annotations

import os
import re
import stat
from collections.abc import Mapping
from pathlib import Path

from msgspec import Struct
from msgspec.structs import replace

__all__ = [
    "FLEET_VARIABLE",
    "GUARD_SUFFIX",
    "MAX_GATEWAY_PATH_BYTES",
    "RECORDER_SUFFIX",
    "ROBOT_NAME",
    "SOCKET_VARIABLE",
    "Address",
    "AddressRefused",
    "default_socket",
    "find_socket",
    "fleet_address",
    "is_private",
    "parse_address",
]

SOCKET_VARIABLE = "TA2_SOCKET"
"""Environment variable that names the socket, for daemon and clients."""

FLEET_VARIABLE = "TA2_FLEET"
"""Environment variable that names the fleet: `tcp/HOST:PORT` or `tls/HOST:PORT` of its zenoh router, or a file of zenoh's own
configuration, with users, passwords and certificates."""

ROBOT_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,62}")
"""A robot's name in its fleet: one chunk of a zenoh key, without wildcards."""

SYSTEM_SOCKET = Path("/run/ta2/gateway.sock")
"""Where a daemon of the whole host listens (its unit names it with `--socket`)."""

MAX_PATH_BYTES = 107
"""Longest path of a unix socket (`sun_path` of Linux without the final zero)."""
GUARD_SUFFIX, RECORDER_SUFFIX = ".guard", ".recorder"
"""How the sockets beside a gateway's are called, of its guard and of a recorder: as its own, with this behind it."""
MAX_GATEWAY_PATH_BYTES = MAX_PATH_BYTES - max(len(GUARD_SUFFIX), len(RECORDER_SUFFIX))
"""Longest path of a gateway's socket: those beside it fit, too."""


class AddressRefused(ValueError):
    """A text is no address of a daemon. The message says what it may look like."""


class Address(Struct, frozen=True, kw_only=True):
    """One way to a daemon.

    Attributes:
        locator: zenoh endpoint, e.g. `unixsock-stream//run/ta2/gateway.sock` or `tcp/127.0.0.1:7448`; empty when `file` has it.
        path: Path of the unix socket, or None for the network.
        file: zenoh configuration of the way there; empty for none.
        robot: Name in the fleet whose router that is; empty for a gateway itself.
    """

    locator: str
    path: Path | None = None
    file: str = ""
    robot: str = ""

    def __str__(self) -> str:
        """Return what a person would type."""
        if self.robot or self.file:
            return self.robot or self.file
        return self.locator if self.path is None else f"unix:{self.path}"


def parse_address(text: str) -> Address:
    """Return the address behind a text: `unix:/path`, a bare path, `tcp/host:port`, `tls/host:port` or a robot's name.

    Raises:
        AddressRefused: It is neither, or the path is too long for a unix socket.
    """
    for scheme in ("tcp/", "tls/"):
        if text.startswith(scheme):
            host, colon, port = text[len(scheme) :].rpartition(":")
            if not (colon and host and port.isdecimal() and 0 < int(port) < 65536):
                raise AddressRefused(f"{text!r} is no address: {scheme}HOST:PORT with a port from 1 to 65535 is one")
            _refuse_options(text)
            return Address(locator=text)
    if ROBOT_NAME.fullmatch(text) and os.environ.get(FLEET_VARIABLE):
        return replace(fleet_address(), robot=text)
    name = text.removeprefix("unix:").removeprefix("unixsock-stream/")
    if not name or (name == text and not name.startswith(("/", "./", "../", "~"))):
        raise AddressRefused(
            f"{text!r} is no address: unix:PATH, /PATH, ./PATH or tcp/HOST:PORT is one, and NAME with TA2_FLEET"
        )
    _refuse_options(name)
    path = Path(os.path.abspath(Path(name).expanduser()))
    if any("\ud800" <= letter <= "\udfff" for letter in str(path)):
        raise AddressRefused(f"{str(path)!r} is no UTF-8, and zenoh takes no other path: choose one in plain letters")
    if len(os.fsencode(path)) > MAX_PATH_BYTES:
        raise AddressRefused(f"{path} has {len(os.fsencode(path))} bytes, a unix socket has at most {MAX_PATH_BYTES}")
    return Address(locator=f"unixsock-stream/{path}", path=path)


def fleet_address(text: str | None = None) -> Address:
    """Return where a fleet's router is.

    Args:
        text: As `FLEET_VARIABLE` has it, which is what counts when it is None.

    Raises:
        AddressRefused: Nothing names it.
    """
    text = os.environ.get(FLEET_VARIABLE, "") if text is None else text
    if not text:
        raise AddressRefused(
            f"no fleet is named: set {FLEET_VARIABLE} to its router, or to a file of zenoh's configuration"
        )
    return parse_address(text) if text.startswith(("tcp/", "tls/")) else Address(locator="", file=text)


def _refuse_options(text: str) -> None:
    """Refuse what zenoh would read as options of the endpoint."""
    for mark in "#?;":
        if mark in text:
            raise AddressRefused(f"{text!r} contains {mark!r}, which an address may not")


def default_socket(environ: Mapping[str, str] | None = None) -> Path:
    """Return the path at which a daemon of this user listens unless told otherwise."""
    return _candidates(os.environ if environ is None else environ)[0]


def find_socket(environ: Mapping[str, str] | None = None) -> Path:
    """Return the first socket that exists where a daemon may listen; else the first path at which one may be made.

    A socket in a directory that somebody else may write to is passed over, whether it exists or not.

    Raises:
        AddressRefused: There is no other, or `TA2_SOCKET` is no path.
    """
    candidates = _candidates(os.environ if environ is None else environ)
    for path in candidates:
        if len(candidates) == 1 or (path.is_socket() and is_private(path.parent)):
            return path
    for path in candidates:
        if not os.path.lexists(path.parent) or is_private(path.parent):
            return path
    raise AddressRefused(
        f"others may put a socket into {candidates[0].parent}: make it yours alone, or name the socket with {SOCKET_VARIABLE}"
    )


def _candidates(environ: Mapping[str, str]) -> tuple[Path, ...]:
    named = environ.get(SOCKET_VARIABLE, "")
    if named:
        address = parse_address(named)
        if address.path is None:
            raise AddressRefused(f"{SOCKET_VARIABLE}={named!r} is no path of a unix socket")
        return (address.path,)
    uid = os.getuid()
    runtime = environ.get("XDG_RUNTIME_DIR", "")
    first = (Path(runtime) / "ta2" / "gateway.sock",) if runtime else ()
    own = (Path(f"/tmp/ta2-{uid}/gateway.sock"), Path(f"/run/user/{uid}/ta2/gateway.sock"), SYSTEM_SOCKET)
    return (*first, *(path for path in own if path not in first))


def is_private(directory: Path) -> bool:
    """Whether a directory belongs to this user or to root and nobody else may put files into it."""
    try:
        status = os.lstat(directory)
    except OSError:
        return False
    return stat.S_ISDIR(status.st_mode) and status.st_uid in (os.getuid(), 0) and not status.st_mode & stat.S_IWOTH
