"""Who is logged in, and how often somebody may try.

Rules
    * One password is tried at a time, and one of each address waits for that: guessing costs one core at most.
    * Wrong passwords count for five minutes against where they came from and against whom they were for; an IPv6 network
      (/64) counts as one. A right password is refused while there were too many: it may have been guessed.
    * A session ends by itself, by logging out, and with the server. Nothing keeps the word itself that its browser says.
"""

from __future__ import annotations

import asyncio
import hashlib
import logging
import secrets
import time
from collections import deque
from collections.abc import Callable
from ipaddress import IPv6Address, ip_address

from msgspec import Struct, field

__all__ = ["Logins", "Session", "TooMany", "network_of"]

_log = logging.getLogger(__name__)

SESSION_S = 12 * 3600.0
WINDOW_S = 300.0
"""So long a wrong password counts [s]."""
MOST_OF_ADDRESS = 10
MOST_OF_USER = 20
MOST_WAITING = 8
MOST_SESSIONS = 1000


class TooMany(Exception):
    """Not now: too many wrong passwords, sessions, or others who wait."""


class Session(Struct, kw_only=True, eq=False):
    """One login.

    Attributes:
        name: Of the user.
        ends_s: When it ends by itself, on the clock of its `Logins` [s].
        over: Set when it ended earlier.
    """

    name: str
    ends_s: float
    over: asyncio.Event = field(default_factory=asyncio.Event)


def network_of(host: str) -> str:
    """Return what one peer can choose its addresses from: itself, or its IPv6 network."""
    try:
        address = ip_address(host.partition("%")[0])
    except ValueError:
        return host
    if isinstance(address, IPv6Address):
        return str(address.ipv4_mapped or IPv6Address(int(address) >> 64 << 64))
    return str(address)


class Logins:
    """Sessions and failures.

    Args:
        is_right: Whether a user (name) has a password; slow.
        clock_s: Monotonic [s].
    """

    def __init__(self, is_right: Callable[[str, str], bool], clock_s: Callable[[], float] = time.monotonic) -> None:
        self._is_right = is_right
        self._clock_s = clock_s
        self._sessions: dict[bytes, Session] = {}
        self._failed: deque[tuple[float, str, str]] = deque()
        self._waiting: set[str] = set()
        self._trying = asyncio.Lock()

    async def login(self, name: str, password: str, host: str) -> str | None:
        """Return the word of a new session; None where name or password is wrong.

        Raises:
            TooMany: Nothing was tried.
        """
        address = network_of(host)
        if address in self._waiting or len(self._waiting) >= MOST_WAITING:
            raise TooMany
        self._waiting.add(address)
        try:
            async with self._trying:
                self._require(name, address)
                failed = (self._clock_s(), address, name)  # until it is known to be right
                self._failed.append(failed)
                is_right = await asyncio.to_thread(self._is_right, name, password)
        finally:
            self._waiting.discard(address)
        if not is_right:
            _log.warning("wrong password for %r from %s", name[:40], host)
            return None
        self._failed.remove(failed)
        word = secrets.token_urlsafe(32)
        self._sessions[_digest(word)] = Session(name=name, ends_s=self._clock_s() + SESSION_S)
        _log.warning("%s logged in from %s", name, host)
        return word

    def session(self, word: str) -> Session | None:
        """Return the session that a word belongs to, while it lasts."""
        session = self._sessions.get(_digest(word))
        return session if session is not None and self.left_s(session) > 0.0 else None

    def left_s(self, session: Session) -> float:
        """Return how long a session lasts from now on [s]; not above 0 when it is over."""
        return 0.0 if session.over.is_set() else session.ends_s - self._clock_s()

    def logout(self, session: Session) -> None:
        """End a session, and what is open by it."""
        session.over.set()

    def _require(self, name: str, address: str) -> None:
        since_s = self._clock_s() - WINDOW_S
        while self._failed and self._failed[0][0] <= since_s:
            self._failed.popleft()
        of_address = sum(failed[1] == address for failed in self._failed)
        if of_address >= MOST_OF_ADDRESS or sum(failed[2] == name for failed in self._failed) >= MOST_OF_USER:
            raise TooMany
        self._sessions = {word: session for word, session in self._sessions.items() if self.left_s(session) > 0.0}
        if len(self._sessions) >= MOST_SESSIONS:
            raise TooMany


def _digest(word: str) -> bytes:
    return hashlib.sha256(word.encode("utf-8", "surrogatepass")).digest()
