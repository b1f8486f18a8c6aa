"""Owning the robot without waiting: what a control does, as procedures. Shared by the blocking and the async control."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from gateway.api import protocol
from gateway.client.asking import procedures
from gateway.client.asking.chunks import Wishes, follow
from gateway.client.asking.options import OnExitName
from gateway.client.asking.poses import PoseLike, move_pose
from gateway.client.asking.procedures import Procedure
from gateway.client.asking.requests import SIDES, move, seconds
from gateway.client.connection.session import Lease, Motion, Session
from gateway.errors import Code, failure

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

__all__ = ["Accepted", "Ownership"]

Accepted = tuple[Session, Lease, Motion, Mapping[str, Any]]
"""What a handle is made of: session, lease, motion and the facts of the reply."""


class Ownership:
    """One lease, from acquiring to its end.

    `take` is the reason to take the robot from its owner, None to ask for a free one; `timeout_ns` is for acquiring
    and for ending, each.
    """

    def __init__(
        self,
        session: Session,
        on_loss: protocol.OnLossName,
        on_exit: OnExitName,
        take: str | None,
        timeout_ns: int,
    ) -> None:
        self._session = session
        self._on_loss = on_loss
        self._on_exit = on_exit
        self._take = take
        self._timeout_ns = timeout_ns
        self._lease: Lease | None = None

    @property
    def epoch(self) -> int:
        """Number of this lease; every command carries it.

        Raises:
            LeaseError: NOT_OWNER, this control was not entered or has ended.
            Disconnected: This process was forked.
        """
        return self._owned().epoch

    @property
    def is_open(self) -> bool:
        """Whether this control was acquired by this process, neither given back nor left, and did not end with its daemon."""
        return self._lease is not None and self._session.holds(self._lease)

    def __repr__(self) -> str:
        """Show whose it is, and whether it still is."""
        if self._lease is None:
            return f"<control for {self._session.name!r}, not entered>"
        return f"<control for {self._session.name!r}, epoch {self._lease.epoch}, {'open' if self.is_open else 'ended'}>"

    def _owned(self) -> Lease:
        lease = self._lease
        if lease is None:
            raise failure(Code.NOT_OWNER, "this control was not entered")
        self._session.require_lease(lease)
        return lease

    def _acquire(self) -> Procedure[None]:
        self._lease = yield from procedures.acquire(self._session, self._on_loss, self._take, self._timeout_ns)

    def _release(self) -> Procedure[None]:
        lease = self._lease
        if lease is not None and self.is_open:
            yield from procedures.release(self._session, lease, self._timeout_ns)

    def _leave(self) -> Procedure[None]:
        lease = self._lease
        if lease is not None and self.is_open:
            yield from procedures.abandon(self._session, lease)

    def _end(self) -> Procedure[None]:
        """End normally, as was asked for at the beginning; who did not hear of a lost keepalive hears of it now."""
        unkept = self._session.unkept
        if unkept is not None and unkept[0] == self._lease and not self._session.is_unkept_heard:
            self._owned()
        return self._release() if self._on_exit == "release" else self._leave()

    def _break_off(self) -> None:
        """End by an exception: leave the robot held, without waiting."""
        if self.is_open:
            self._session.abandon(self._lease)

    def _enable(self, timeout: float) -> Procedure[None]:
        yield from procedures.enable(self._session, self._owned(), seconds("timeout", timeout))

    def _disable(self, timeout: float) -> Procedure[None]:
        yield from procedures.disable(self._session, self._owned(), seconds("timeout", timeout))

    def _hold(self, sides: tuple[protocol.Side, ...] = SIDES) -> Procedure[None]:
        yield from procedures.request(self._session, protocol.Hold(epoch=self.epoch, sides=sides))

    def _move(
        self,
        targets: Mapping[str, ArrayLike],
        relative: bool,
        speed: float,
        tolerance: float | None,
        on_limit: protocol.OnLimitName,
        until: protocol.Until | None,
    ) -> Procedure[Accepted]:
        lease = self._owned()
        command = move(
            lease.epoch,
            targets,
            relative=relative,
            speed=speed,
            tolerance_rad=tolerance,
            on_limit=on_limit,
            until=until,
        )
        return (yield from self._start(lease, command))

    def _follow(self, points: Mapping[str, ArrayLike], dt: float | None, wishes: Wishes) -> Procedure[Accepted]:
        lease = self._owned()
        return (yield from self._start(lease, follow(lease.epoch, points, dt, **wishes)))

    def _start(self, lease: Lease, command: protocol.Move | protocol.Follow | protocol.MovePose) -> Procedure[Accepted]:
        motion, facts = yield from procedures.start_motion(self._session, command)
        return self._session, lease, motion, facts

    def _move_pose(
        self,
        targets: Mapping[str, PoseLike],
        straight: bool,
        speed: float,
        tolerance_m: float | None,
        tolerance_rad: float | None,
        on_limit: protocol.OnLimitName,
        until: protocol.Until | None,
    ) -> Procedure[Accepted]:
        lease = self._owned()
        command = move_pose(
            lease.epoch,
            targets,
            straight=straight,
            speed=speed,
            tolerance_m=tolerance_m,
            tolerance_rad=tolerance_rad,
            on_limit=on_limit,
            until=until,
        )
        return (yield from self._start(lease, command))
