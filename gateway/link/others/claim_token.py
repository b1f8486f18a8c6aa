"""Puts our `armed` token out and takes it in, from a thread of its own: a stalled link can hold a declaration for long.

The loop says which claim it wants to be seen (0: none) and goes on; when the token is out, `shown` is called with that
claim's number. What a claim means is known to `core/others/claim.py`.
"""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable
from typing import Protocol

import zenoh

from gateway.process.threads import supervised

__all__ = ["ClaimToken", "Declares"]

RETRY_S = 0.2
"""After a declaration that failed."""

_log = logging.getLogger(__name__)


class Declares(Protocol):
    """A session that can declare our token."""

    def declare_armed(self) -> Callable[[], None]:
        """Put the token out; return what takes it in."""


class ClaimToken:
    """The token, over all sessions of a link.

    Args:
        shown: Called with the number of a claim when its token is out; in the token's thread.
    """

    def __init__(self, shown: Callable[[int], None]) -> None:
        self._shown = shown
        self._change = threading.Condition()
        self._session: Declares | None = None
        self._wanted = 0
        self._is_closing = False
        self._withdraw: Callable[[], None] | None = None
        self._served = 0
        self._thread = supervised(self._run, "robot-claim", may_return=lambda: self._is_closing)

    def close(self, timeout_s: float) -> bool:
        """End the thread; the session takes the token with it when it closes. Return whether it ended in time."""
        with self._change:
            self._is_closing = True
            self._change.notify()
        if self._thread.ident is not None:
            self._thread.join(timeout_s)
        return not self._thread.is_alive()

    def attach(self, session: Declares | None) -> None:
        """Use another session from now on, or none: the token of the former one went with it.

        A claim is to be shown anew: who knows us by the former session does not know this one yet.
        """
        with self._change:
            self._session, self._withdraw, self._served, self._wanted = session, None, 0, 0
            self._change.notify()

    def show(self, claim: int) -> None:
        """Want a claim to be seen; 0 for none. Never waits."""
        if claim != self._wanted:
            with self._change:
                self._wanted = claim
                self._change.notify()
            if self._thread.ident is None:  # who never commands needs none
                self._thread.start()

    def _run(self) -> None:
        while True:
            with self._change:
                self._change.wait_for(lambda: self._is_closing or self._is_due())
                if self._is_closing:
                    return
                session, wanted, withdraw = self._session, self._wanted, self._withdraw
            try:
                withdraw = self._serve(session, wanted, withdraw)
            except zenoh.ZError as error:
                _log.warning("the token that this gateway commands the robot cannot be declared: %s", error)
                with self._change:
                    self._change.wait_for(lambda: self._is_closing, RETRY_S)
                continue
            with self._change:
                if self._session is session:
                    self._withdraw, self._served = withdraw, wanted
                is_out = self._session is session and wanted > 0
            if is_out:
                self._shown(wanted)

    def _is_due(self) -> bool:
        return self._session is not None and self._served != self._wanted

    def _serve(
        self, session: Declares | None, wanted: int, withdraw: Callable[[], None] | None
    ) -> Callable[[], None] | None:
        """Declare or undeclare; return what takes the token in that is out now."""
        if wanted == 0:
            if withdraw is not None:
                withdraw()
            return None
        if withdraw is not None or session is None:
            return withdraw  # it is out already, for an earlier claim
        return session.declare_armed()
