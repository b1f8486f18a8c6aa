"""Who may log in: a file with a line for each user, `NAME:N:R:P:SALT:HASH` (scrypt, hexadecimal), for its owner alone to read.

It is read anew at each login, so whoever is taken out of it does not get in any more. What is wrong in it lets nobody in.
"""

from __future__ import annotations

import contextlib
import hashlib
import hmac
import os
import re
import secrets
import tempfile
from collections.abc import Mapping
from pathlib import Path

from gateway.errors import Code, GatewayError, failure

__all__ = ["add_user", "is_password", "read_users"]

LEAST_PASSWORD, MOST_PASSWORD = 10, 1000
"""Characters."""
LINE = re.compile(r"([A-Za-z0-9_][\w.-]{0,31}):(\d{1,6}:\d\d?:\d\d?:[0-9a-f]{32,64}:[0-9a-f]{64})", re.ASCII)
COST = "32768:8:3"
"""N, r and p of scrypt: 32 MiB and about a third of a second for one guess."""
NOBODY = f"{COST}:{'00' * 16}:{'00' * 32}"
MOST_MEMORY = 2**28


def read_users(path: Path) -> Mapping[str, str]:
    """Return what stands in the file for each user, by name.

    Raises:
        Rejected: BAD_REQUEST, the file cannot be read, others may read it, or a line is none of ours.
    """
    try:
        with path.open(encoding="utf-8") as file:
            mode = os.fstat(file.fileno()).st_mode & 0o777
            lines = file.read().splitlines()
    except (OSError, UnicodeError) as error:
        why = error.strerror if isinstance(error, OSError) else str(error)
        raise _wrong(path, str(why), "make it: ta2 web --add-user NAME --users FILE") from None
    if mode & 0o077:
        raise _wrong(path, f"others than its owner may use it (mode {mode:o})", f"chmod 600 {path}")
    found = [LINE.fullmatch(line) for line in lines]
    users = {match[1]: match[2] for match in found if match is not None}
    if len(users) < len(lines):
        raise _wrong(path, "a line is wrong, or a name is there twice", "write it with `ta2 web --add-user`")
    return users


def is_password(password: str, kept: str | None) -> bool:
    """Tell whether a password is the one that is kept; as slow where nobody is known by that name."""
    *cost, salt, wanted = (NOBODY if kept is None else kept).split(":")
    found = _scrypt(password[:MOST_PASSWORD], ":".join(cost), salt)
    return hmac.compare_digest(found, wanted) and kept is not None


def add_user(path: Path, name: str, password: str) -> None:
    """Add a user, or give one another password. The file is written whole or not at all, for its owner alone.

    Raises:
        Rejected: BAD_REQUEST, the name or the password is not allowed, or the file cannot be read or written.
    """
    if not LINE.fullmatch(f"{name}:{NOBODY}"):
        hint = "letters, digits, '_', '.' and '-', at most 32"
        raise failure(Code.BAD_REQUEST, f"{name!r} cannot be a user's name", field="--add-user", hint=hint)
    if not LEAST_PASSWORD <= len(password) <= MOST_PASSWORD:
        message = f"the password has {len(password)} characters, {LEAST_PASSWORD} to {MOST_PASSWORD} are allowed"
        raise failure(Code.BAD_REQUEST, message, bound=str(LEAST_PASSWORD), hint="a few words are easily kept in mind")
    salt = secrets.token_hex(16)
    users = {**(read_users(path) if path.exists() else {}), name: f"{COST}:{salt}:{_scrypt(password, COST, salt)}"}
    try:
        _write(path, "".join(f"{name}:{kept}\n" for name, kept in users.items()))
    except OSError as error:
        raise _wrong(path, str(error), "name another file with --users") from None


def _write(path: Path, text: str) -> None:
    handle, new = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")  # nobody but its owner may read it
    try:
        with open(handle, "w", encoding="utf-8") as file:
            if path.exists() and os.geteuid() == 0:  # a service's user reads it on
                os.fchown(handle, path.stat().st_uid, path.stat().st_gid)
            file.write(text)
            file.flush()
            os.fsync(handle)
        Path(new).replace(path)
    except BaseException:
        with contextlib.suppress(OSError):
            Path(new).unlink()
        raise


def _scrypt(password: str, cost: str, salt: str) -> str:
    n, r, p = map(int, cost.split(":"))
    secret = password.encode("utf-8", "surrogatepass")
    return hashlib.scrypt(secret, salt=bytes.fromhex(salt), n=n, r=r, p=p, maxmem=MOST_MEMORY, dklen=32).hex()


def _wrong(path: Path, message: str, hint: str) -> GatewayError:
    return failure(Code.BAD_REQUEST, f"users in {path}: {message}", field="--users", hint=hint)
