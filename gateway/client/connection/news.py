"""What the daemon told, kept for those who read it: the newest notices, and honest numbers of those that are missing.

Rules
    * Bounded: the newest `KEPT` notices are kept. Every reader has a place of its own; whoever is too slow is told how
      many it missed, and so is everybody about those that were lost between daemon and client (the daemon numbers them).
    * That the connection broke, and that it is back, stands between the notices: who reads on knows that there is a gap.

Guarded by the session's condition.
"""

from __future__ import annotations

from collections import deque

from gateway.api import protocol
from gateway.errors import Code

__all__ = ["KEPT", "News"]

KEPT = 1000
"""Notices kept for those who read them."""


class News:
    """The newest notices.

    Attributes:
        dropped: Notices that nobody here could read: lost on the way, or pushed out before anybody read them.
    """

    def __init__(self) -> None:
        self.dropped = 0
        self._kept: deque[protocol.Notice] = deque()
        self.end = 0
        """Place after the newest notice; places count from 0 and are never used again."""
        self._read_up_to = 0
        self._expected: int | None = None

    @property
    def begin(self) -> int:
        """Place of the oldest notice that is kept."""
        return self.end - len(self._kept)

    # ------------------------------------------------------------------------------------------------ what comes in

    def take(self, notice: protocol.Notice, number: int) -> None:
        """Keep a notice of the daemon.

        Args:
            notice: As it came.
            number: Its number at the daemon, rising by one; 0 when it has none.
        """
        if number:
            if self._expected is not None:
                if number < self._expected:
                    return  # it was here already
                if number > self._expected:
                    self.dropped += number - self._expected
                    self._keep(_lost(number - self._expected, notice.at_ns))
            self._expected = number + 1
        self._keep(notice)

    def begin_anew(self) -> None:
        """Expect the numbers of another daemon, which count from one."""
        self._expected = 1

    def tell_disconnected(self, address: str, now_ns: int) -> None:
        """Keep that the connection broke; `now_ns` is of this host's monotonic clock."""
        self._keep(
            protocol.Notice(
                code=Code.DISCONNECTED.value,
                level="warning",
                message=f"the connection to the daemon at {address} broke",
                at_ns=now_ns,
            )
        )

    def tell_connected(self, address: str, now_ns: int, is_same: bool) -> None:
        """Keep that a daemon is there again, and whether it is the one of before."""
        which = "the daemon is back" if is_same else "another daemon answers; what the earlier one did is over"
        self._keep(
            protocol.Notice(
                code=Code.CONNECTED.value,
                level="info" if is_same else "warning",
                message=f"{which} ({address})",
                at_ns=now_ns,
                facts={"daemon": "same" if is_same else "another"},
            )
        )

    def _keep(self, notice: protocol.Notice) -> None:
        self._kept.append(notice)
        self.end += 1
        if len(self._kept) > KEPT:
            self._kept.popleft()
            if self._read_up_to < self.begin:
                self.dropped += 1

    # ------------------------------------------------------------------------------------------------ who reads

    def takeover(self, epoch: int) -> str:
        """Return who took the robot from whom and why, where that was told of this epoch; else nothing."""
        for notice in reversed(self._kept):
            if notice.code == Code.LEASE_CHANGED.value and notice.facts.get("epoch") == str(epoch):
                return notice.message
        return ""

    def read(self, place: int) -> tuple[protocol.Notice, int, int] | None:
        """Return the notice at a place, the place after it, and how many were pushed out unread before it.

        Returns:
            None when there is none yet. When notices are missing, the first thing returned says so.
        """
        if place < self.begin:
            missing = self.begin - place
            return _lost(missing, self._kept[0].at_ns), self.begin, missing
        if place >= self.end:
            return None
        notice = self._kept[place - self.begin]
        self._read_up_to = max(self._read_up_to, place + 1)
        missing = int(notice.facts["lost"]) if notice.code == Code.NOTICES_LOST.value else 0
        return notice, place + 1, missing


def _lost(count: int, at_ns: int) -> protocol.Notice:
    return protocol.Notice(
        code=Code.NOTICES_LOST.value,
        level="warning",
        message=f"{count} notices were lost before the next one",
        at_ns=at_ns,
        facts={"lost": str(count)},
    )
