"""A stream of joint targets as its commander sees it: set, tick, end. Shared by the blocking and the async stream.

Rules
    * A target is checked here like the daemon checks it, so that the mistake is told where it was made. What `set` returns
      is what goes out.
    * `tick` paces on an absolute grid: a late tick is not caught up, its periods are skipped and counted.
    * A stream that ended, or a target that was refused, is told at the next `tick`, with code and message.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from gateway.api import protocol
from gateway.client.procedures import Procedure, open_stream, request
from gateway.client.requests import joints, read_only, seconds, within_limits
from gateway.client.session import Lease, Session
from gateway.client.watching import pause
from gateway.errors import Code, Refusal, to_exception

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import ArrayLike, NDArray

__all__ = ["TargetStream"]


class TargetStream:
    """One stream of targets for one arm.

    Args:
        session: Of this client.
        lease: Under which it runs.
        side: `left` or `right`.
        rate_hz: Of `tick` [Hz], 1 to 100.
        speed: Factor on the velocity limit, 0 < speed <= 1.
        on_limit: `reject` or `clip`.
        expiry: Life of a target [s]; None for the configured one.
    """

    def __init__(
        self,
        session: Session,
        lease: Lease,
        side: protocol.SideName,
        *,
        rate_hz: float,
        speed: float,
        on_limit: protocol.OnLimitName,
        expiry: float | None,
    ) -> None:
        if not (math.isfinite(rate_hz) and 1.0 <= rate_hz <= 100.0):
            raise to_exception(
                Refusal(
                    code=Code.OUT_OF_RANGE,
                    message=f"rate_hz is {rate_hz:g} Hz, targets are taken at 1 to 100 Hz",
                    field="rate_hz",
                    value=f"{rate_hz:g}",
                    bound="[1, 100]",
                    unit="Hz",
                )
            )
        self.side = side
        self.skipped = 0
        self._session = session
        self._lease = lease
        self._on_limit = on_limit
        self._period_ns = round(1e9 / rate_hz)
        self._opening = protocol.OpenStream(
            epoch=lease.epoch,
            side=side,
            speed=float(speed),
            on_limit=on_limit,
            expiry_ns=None if expiry is None else seconds("expiry", expiry),
        )
        self._stream_id = 0
        self._q: tuple[float, ...] = ()
        self._after_seq = 0
        self._seq = 0
        self._refused = 0
        self._due_ns = 0
        self._view: protocol.TargetView | None = None

    @property
    def q(self) -> NDArray[np.float64]:
        """Where the arm is being sent [rad], shape (7,): first where the stream starts, then the last target that was set."""
        return read_only(self._q)

    @property
    def limited(self) -> bool:
        """Whether the arm lags because the targets ask for more than the limits allow."""
        self._look()
        return self._view is not None and self._view.limited

    @property
    def accepted(self) -> int:
        """How many targets were sent when the last accepted one was."""
        self._look()
        return 0 if self._view is None else self._view.seq

    def set(self, q: ArrayLike) -> NDArray[np.float64]:
        """Send a target; never waits.

        Args:
            q: Seven joints [rad], in the order of manual §4.0.3.

        Returns:
            What really goes out [rad], shape (7,): as given, or clipped when the stream was opened so.

        Raises:
            Rejected: WRONG_SHAPE, NOT_FINITE or OUT_OF_RANGE; nothing was sent.
            Disconnected: The daemon is gone.
            LeaseError: This control is over.
        """
        self._require_open()
        info = self._session.info
        assert info is not None, "acquire() has fetched it"
        values = within_limits(self.side, joints(self.side, q), info, self._on_limit)
        self._seq += 1
        target = protocol.Target(epoch=self._lease.epoch, seq=self._seq, q_rad=values)
        self._session.put_target(self._stream_id, target)
        self._q = values
        return read_only(values)

    # ------------------------------------------------------------------------------------------------ for the shells

    def _open(self) -> Procedure[None]:
        if self._stream_id:
            raise to_exception(Refusal(code=Code.STREAM_ENDED, message="a stream is used once; open a new one"))
        self._session.require_lease(self._lease)
        self._stream_id, self._q, self._after_seq = yield from open_stream(self._session, self._opening)
        self._due_ns = self._session.transport.now_ns()

    def _tick(self) -> Procedure[None]:
        self._check()
        now_ns = self._session.transport.now_ns()
        self._due_ns += self._period_ns
        if now_ns > self._due_ns:
            missed = -(-(now_ns - self._due_ns) // self._period_ns)
            self._due_ns += missed * self._period_ns
            self.skipped += missed
        yield from pause(self._due_ns)
        self._check()

    def _close(self) -> Procedure[None]:
        if self._session.lease == self._lease:
            yield from request(self._session, protocol.CloseStream(epoch=self._lease.epoch, stream_id=self._stream_id))

    # ------------------------------------------------------------------------------------------------ inside

    def _require_open(self) -> None:
        if not self._stream_id:
            raise to_exception(
                Refusal(code=Code.UNKNOWN_STREAM, message="this stream was not opened", hint="use it in a `with` block")
            )
        self._session.require_lease(self._lease)
        self._session.require_daemon(self._lease.daemon)

    def _look(self) -> bool:
        """Look up this stream in the newest snapshot; False when that is too old to list it."""
        sighting = self._session.sighting()
        if sighting is None or sighting.view.seq <= self._after_seq:
            return False
        found = (view for view in sighting.view.targets if view.stream_id == self._stream_id)
        self._view = next(found, None)
        return True

    def _check(self) -> None:
        """Raise what has happened to the stream since the last look."""
        self._require_open()
        if not self._look():
            return
        view = self._view
        if view is None or not view.open:
            code = Code.STREAM_ENDED.value if view is None else view.code
            message = f"stream {self._stream_id} of the {self.side} arm ended"
            raise to_exception(protocol.refusal_of(protocol.RefusalMessage(code=code, message=message)))
        if view.refused > self._refused:
            self._refused = view.refused
            raise to_exception(
                protocol.refusal_of(protocol.RefusalMessage(code=view.refusal_code, message=view.refusal_message))
            )
