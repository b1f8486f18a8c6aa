"""Our claim to command the robot, shown to other gateways: the `armed` token, looked around again before the first frame.

    none -> (wanted, nobody else armed) shown -> 150 ms -> looked again -> confirmed
                                                          -> somebody armed with a smaller zenoh id: none

Rules (BEHAVIOUR, starting: two gateways or owners acquire at once)
    * A gateway that sees another one armed shows no claim of its own, so an established one is never disturbed.
    * Of two that show their claims at the same time the larger zenoh id yields; the smaller waits until it has.
    * A claim is kept until the last frame has left, whoever else appears: the supervisor's table says what stops.
    * After a new link nothing is claimed for 0.1 s: the tokens of others are still on their way.

It does not know what is sent, nor how a token is shown.
"""

from __future__ import annotations

from collections.abc import Sequence

__all__ = ["GIVE_UP_NS", "LINK_SETTLE_NS", "LOOK_AGAIN_NS", "Claim"]

MS = 1_000_000

LOOK_AGAIN_NS = 150 * MS
"""Between showing the claim and the first frame [ns]."""

LINK_SETTLE_NS = 100 * MS
"""After a link came up [ns]; tokens of others arrive some milliseconds after it."""

GIVE_UP_NS = 1000 * MS
"""A larger zenoh id that has not yielded after this [ns] does not know the rule: we yield."""


class Claim:
    """One gateway's claim."""

    def __init__(self) -> None:
        self.number = 0
        """Rises with every claim; shown with it. 0 while nothing is claimed."""
        self.is_confirmed = False
        """Whether frames may leave that are no stop frames."""
        self._last = 0
        self._link_ns: int | None = None
        self._shown_ns: int | None = None

    @property
    def is_open(self) -> bool:
        """Whether it is shown and may still be withdrawn: of two that claim at once one will yield."""
        return self.number > 0 and not self.is_confirmed

    def link_up(self, now_ns: int) -> None:
        """A transport opened."""
        self.link_down()
        self._link_ns = now_ns

    def link_down(self) -> None:
        """The transport is lost, and our token with it."""
        self._link_ns = None
        self.withdraw()

    def shown(self, number: int, at_ns: int) -> None:
        """Our token is out; that of an earlier claim does not count."""
        if number and number == self.number:
            self._shown_ns = at_ns

    def withdraw(self) -> None:
        """Claim nothing any more."""
        self.number, self.is_confirmed, self._shown_ns = 0, False, None

    def step(self, now_ns: int, *, is_wanted: bool, is_used: bool, own_zid: str, rivals: Sequence[str]) -> None:
        """Take the step that is due.

        A claim is wanted while somebody owns the robot or arms are held, and used while frames are sent, stop frames
        included: then it is kept. The empty zenoh id is the smallest.
        """
        if self.number == 0:
            is_settled = self._link_ns is not None and now_ns - self._link_ns >= LINK_SETTLE_NS
            if is_wanted and is_settled and not rivals:
                self._last += 1
                self.number = self._last
        elif not (is_wanted or is_used):
            self.withdraw()
        elif self.is_confirmed:
            if rivals and not is_used:
                self.withdraw()
        elif self._shown_ns is not None and now_ns - self._shown_ns >= LOOK_AGAIN_NS:
            if not rivals:
                self.is_confirmed = True
            elif any(_rank(zid) < _rank(own_zid) for zid in rivals) or now_ns - self._shown_ns >= GIVE_UP_NS:
                self.withdraw()


def _rank(zid: str) -> int:
    return int(zid, 16) if zid else 0
