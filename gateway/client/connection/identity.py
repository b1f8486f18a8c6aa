"""Who a client is: a number that nobody else has, and that tells its own process which clients are its own.

Process ids do not tell: two containers have the same ones.
"""

from __future__ import annotations

import os

__all__ = ["is_of_this_process", "new_client_id"]

TAG_DIGITS = 12

_tags: dict[int, str] = {}
"""Process id -> what the names of its clients begin with. A forked process makes its own."""


def new_client_id() -> str:
    """Return 32 hexadecimal digits; the first ones are the same for all clients of this process."""
    return _tag() + os.urandom((32 - TAG_DIGITS) // 2).hex()


def is_of_this_process(client_id: str) -> bool:
    """Whether a client was made by this process."""
    return client_id.startswith(_tag())


def _tag() -> str:
    pid = os.getpid()
    if pid not in _tags:
        _tags.clear()
        _tags[pid] = os.urandom(TAG_DIGITS // 2).hex()
    return _tags[pid]
