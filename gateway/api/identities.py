"""Who is who: a client is known by its id, which snapshots show, and proven by its secret, which nothing shows.

The first command under an id binds it to the secret that came along; from then on nobody else passes under it. Ids are
random and shown only when their client owns the robot, long after that. It is bound to the door, too, by which the command
came: what ends at another one is not this client. Any thread may ask.
"""

from __future__ import annotations

import hmac
from collections import OrderedDict
from contextlib import suppress

__all__ = ["MOST", "MOST_OWNERS", "Identities"]

MOST = 4096
"""So many clients are known; who was not heard for longest is forgotten first, and who is pinned never."""
MOST_OWNERS = 16
"""So many who owned the robot are not forgotten for others either."""

RESERVED = frozenset({"somebody", "stranger"})
"""Whose stops those are that nobody signs: were a client called so, they would count as its own."""


class Identities:
    """Ids of clients and their secrets."""

    def __init__(self) -> None:
        self.pinned: frozenset[str] = frozenset()
        """Who is never forgotten: were it, the next one to come would pass for it. Few; replaced by any thread."""
        self.owners: tuple[str, ...] = ()
        """Who owned the robot lately: nobody takes it in their name either. Replaced by any thread."""
        self._secrets: OrderedDict[str, str] = OrderedDict()
        self._doors: dict[str, str] = {}

    def may_be(self, client_id: str, secret: str) -> bool:
        """Return whether a command's sender may be this client: it is nobody's id yet, or its own. Binds nothing.

        Without a secret nobody is anybody: whoever owned the robot so could be passed for by all who read its id.
        """
        known = self._secrets.get(client_id)
        is_free = bool(secret) and client_id not in RESERVED
        return is_free and (known is None or self._matches(client_id, known, secret))

    def meet(self, client_id: str, secret: str, door: str = "socket") -> bool:
        """Take a command's sender: bind a new id, and say whether a known one is proven. For one thread.

        Args:
            client_id: Of the command.
            secret: Of the command.
            door: By which it came.
        """
        if not secret or client_id in RESERVED:
            return False
        known = self._secrets.setdefault(client_id, secret)
        self._doors.setdefault(client_id, door)
        if len(self._secrets) > MOST:
            for kept in (
                *self.owners,
                *self.pinned,
            ):  # to the end; it is there all the time, for those who ask meanwhile
                with suppress(KeyError):
                    self._secrets.move_to_end(kept)
            self._doors.pop(self._secrets.popitem(last=False)[0], None)
        return self._matches(client_id, known, secret)

    def note_owner(self, client_id: str) -> None:
        """Keep who owns the robot from being forgotten until that many others have owned it."""
        if client_id not in self.owners:
            self.owners = (*self.owners[1 - MOST_OWNERS :], client_id)

    def came_by(self, client_id: str, door: str) -> bool:
        """Return whether a client came by this door, or nobody of this id has come yet."""
        return self._doors.get(client_id, door) == door

    def secret_of(self, client_id: str) -> str | None:
        """Return the secret of a client; None when it is not known."""
        return self._secrets.get(client_id)

    def is_proven(self, client_id: str, secret: str) -> bool:
        """Return whether this client is known, and this is its secret."""
        known = self._secrets.get(client_id)
        return known is not None and self._matches(client_id, known, secret)

    def _matches(self, client_id: str, known: str, secret: str) -> bool:
        if not hmac.compare_digest(known.encode(), secret.encode()):
            return False
        try:
            self._secrets.move_to_end(client_id)
        except KeyError:  # forgotten in this moment
            return False
        return True
