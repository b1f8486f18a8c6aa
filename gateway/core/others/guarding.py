"""What this process knows of guards: its own, and one of an earlier daemon that may still hold the robot.

It decides nothing: enabling waits for the own guard for a while, and is refused while the other one holds.
"""

from __future__ import annotations

from collections.abc import Iterable

from gateway.core.messages.events import GuardSeen

__all__ = ["WAIT_NS", "Guarding"]

WAIT_NS = 2_000_000_000
"""How long an enabling waits for a guard that is still connecting [ns]; then it goes on without."""

KNOWS_NS = 1_500_000_000
"""A guard that has been linked for so long knows all that a hold needs [ns]: the mode comes once a second."""


class Guarding:
    """Facts about guards, as the daemon tells them."""

    def __init__(self) -> None:
        self.pid = 0
        """Process id of this daemon's guard; 0 while none runs."""
        self.zid = ""
        """Its zenoh id on the robot plane; empty before it has one."""
        self.is_linked = False
        """Whether it reaches the robot's router."""
        self.lost = 0
        """How many guards this daemon has lost."""
        self.is_expected = False
        """Whether there shall be a guard: its launcher has spoken."""
        self._linked_ns = 0
        self.earlier_holds = False
        """Whether the guard of an earlier daemon holds the robot."""
        self._zids: set[str] = set()

    def is_awaited(self, waited_ns: int) -> bool:
        """Return whether a guard runs that does not reach the robot yet, and is worth waiting for."""
        return self.pid != 0 and not self.is_linked and waited_ns < WAIT_NS

    def could_hold(self, now_ns: int) -> bool:
        """Return whether a guard is linked, and for so long that it could hold what it is left."""
        return self.is_linked and now_ns - self._linked_ns >= KNOWS_NS

    def is_held_elsewhere(self, armed_friends: Iterable[str]) -> bool:
        """Return whether the guard of an earlier daemon holds the robot, within our reach or not.

        A session that this daemon's own guards have had is none of that: the guard has left it, or has ended, and what it
        showed goes away when the router has noticed.

        Args:
            armed_friends: Zenoh ids of sessions of ours that show a claim; one that cannot be reached still does.
        """
        return self.earlier_holds or any(zid not in self._zids for zid in armed_friends)

    def see(self, seen: GuardSeen) -> str:
        """Take note of the guard; return what is worth telling about one that was lost, empty when none was."""
        if not (self.is_linked and seen.zid == self.zid):
            self._linked_ns = seen.at_ns
        self.pid, self.zid, self.is_linked, self.is_expected = seen.pid, seen.zid, seen.is_linked, True
        self._zids.add(seen.zid)
        if not seen.lost:
            return ""
        self.lost += 1
        return f"the guard ended ({seen.lost}); another one is started, control goes on"
