"""A stream of targets, of joints or of poses, as its commander sees it. Shared by the blocking and the async streams.

Rules
    * A target is checked here like the daemon checks it, so that the mistake is told where it was made. What `set` returns
      is what goes out.
    * `tick` paces on an absolute grid: a late tick is not caught up, its periods are skipped and counted. A paced stream
      moves its instants to where the next target is just in time for a setpoint (`phase`).
    * A stream that ended, or a target that was refused, is told at the next `tick`, with code and message.
    * Where the hand yields (`admittance`), targets are its anchors: `tick` repeats the last one, as a sign of life.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from msgspec import Struct

from gateway.api import protocol
from gateway.client.asking.phase import Phase
from gateway.client.asking.poses import numbers, within_reach
from gateway.client.asking.procedures import Procedure, open_stream, request
from gateway.client.asking.requests import chosen, joints, number, read_only, seconds, within_limits
from gateway.client.asking.watching import pause
from gateway.client.connection.session import Lease, Session
from gateway.errors import Code, failure, to_exception

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import ArrayLike, NDArray

__all__ = ["JointTargets", "PoseTargets", "StreamOptions", "TargetStream"]


class StreamOptions(Struct, frozen=True, kw_only=True):
    """How a stream is to run.

    Attributes:
        rate_hz: Of `tick` [Hz], 1 to 100.
        speed: Factor on the velocity limit, 0 < speed <= 1.
        on_limit: `reject` or `clip`.
        expiry: Life of a target [s]; None for the configured one.
        paced: Whether ticks are moved to where the next target is just in time.
        until: A touch at which it ends; None for none.
    """

    rate_hz: float
    speed: float
    on_limit: protocol.OnLimitName
    expiry: float | None
    paced: bool = True
    until: protocol.Until | None = None


class TargetStream:
    """One stream of targets for one arm; `JointTargets` and `PoseTargets` say what a target is.

    The frame is the arm's own shoulder for poses, empty for joints.
    """

    def __init__(
        self,
        session: Session,
        lease: Lease,
        side: protocol.SideName,
        options: StreamOptions,
        frame: str = "",
        admittance: protocol.Admittance | None = None,
    ) -> None:
        rate_hz = number("rate_hz", options.rate_hz)
        if not (math.isfinite(rate_hz) and 1.0 <= rate_hz <= 100.0):
            raise failure(
                Code.OUT_OF_RANGE,
                f"rate_hz is {rate_hz:g} Hz, targets are taken at 1 to 100 Hz",
                field="rate_hz",
                value=f"{rate_hz:g}",
                bound="[1, 100]",
                unit="Hz",
                hint="stay inside the bound",
            )
        self.side = side
        self.skipped = 0
        self._session = session
        self._lease = lease
        self._on_limit: protocol.OnLimitName = options.on_limit
        self._period_ns = round(1e9 / rate_hz)
        self._phase = Phase(self._period_ns) if options.paced else None
        self._opening = protocol.OpenStream(
            epoch=lease.epoch,
            side=protocol.Side(side),
            space=protocol.Space.POSE if frame else protocol.Space.JOINT,
            frame=frame,
            speed=number("speed", options.speed),
            on_limit=chosen(protocol.OnLimit, "on_limit", options.on_limit),
            expiry_ns=None if options.expiry is None else seconds("expiry", options.expiry),
            until=options.until,
            admittance=admittance,
        )
        self._stream_id = 0
        self._values: tuple[float, ...] = ()
        self._after_seq = 0
        self._seq = 0
        self._refused = 0
        self._due_ns = 0
        self._view: protocol.TargetView | None = None

    def __repr__(self) -> str:
        """Show what it is, and how many targets were set."""
        return f"<stream {self._stream_id or 'not opened'} of the {self.side} arm: {self._seq} targets set>"

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

    @property
    def touch(self) -> protocol.TouchView | None:
        """The touch that ended the stream: force, wrench, place and time; None else."""
        self._look()
        return None if self._view is None else self._view.touch

    def check(self) -> None:
        """Raise what has happened to the stream since the last look; never waits. For loops that somebody else paces.

        Raises:
            GatewayError: The stream has ended, or a target was refused; class, `.code` and message say why.
        """
        self._require_open()
        if not self._look():
            return
        view = self._view
        if view is not None and view.touch is not None:
            self._session.touch_seen = max(self._session.touch_seen, view.touch.number)
        if view is None or not view.open:
            code = Code.STREAM_ENDED.value if view is None else view.code
            message = f"stream {self._stream_id} of the {self.side} arm ended"
            raise to_exception(protocol.refusal_of(protocol.RefusalMessage(code=code, message=message)))
        if view.refused > self._refused:
            self._refused = view.refused
            raise to_exception(
                protocol.refusal_of(protocol.RefusalMessage(code=view.refusal_code, message=view.refusal_message))
            )

    def _put(self, values: tuple[float, ...]) -> None:
        self._seq += 1
        target = protocol.Target(epoch=self._lease.epoch, seq=self._seq, values=values)
        if self._phase is not None:
            self._phase.sent(self._seq, self._session.transport.now_ns())
        self._session.put_target(self._stream_id, target)
        self._values = values

    # ------------------------------------------------------------------------------------------------ for the shells

    def _open(self) -> Procedure[None]:
        if self._stream_id:
            raise failure(Code.STREAM_ENDED, "a stream is used once; open a new one")
        self._session.require_lease(self._lease)
        self._stream_id, self._values, self._after_seq = yield from open_stream(self._session, self._opening)
        self._due_ns = self._session.transport.now_ns()

    def _tick(self) -> Procedure[None]:
        self.check()
        if self._opening.admittance is not None:
            self._put(self._values)  # its anchor is what says that somebody is there
        now_ns = self._session.transport.now_ns()
        self._due_ns += self._period_ns
        if now_ns > self._due_ns:
            missed = -(-(now_ns - self._due_ns) // self._period_ns)
            self._due_ns += missed * self._period_ns
            self.skipped += missed
        wake_ns = self._due_ns
        if self._phase is not None:
            wake_ns, self._due_ns = self._phase.wake(self._due_ns, now_ns)
        yield from pause(wake_ns)
        self.check()

    def _close(self) -> Procedure[None]:
        if self._session.holds(self._lease):
            yield from request(self._session, protocol.CloseStream(epoch=self._lease.epoch, stream_id=self._stream_id))

    # ------------------------------------------------------------------------------------------------ inside

    def _require_open(self) -> None:
        if not self._stream_id:
            raise failure(Code.UNKNOWN_STREAM, "this stream was not opened", hint="use it in a `with` block")
        self._session.require_lease(self._lease)
        self._session.require_daemon(self._lease.daemon)

    def _info(self) -> protocol.Info:
        """Return the daemon's facts, for a stream that is open."""
        self._require_open()
        info = self._session.info
        assert info is not None, "acquire() has fetched it"
        return info

    def _look(self) -> bool:
        """Look up this stream in the newest snapshot; False when that is too old to list it."""
        sighting = self._session.sighting()
        if sighting is None or sighting.view.seq <= self._after_seq:
            return False
        found = (view for view in sighting.view.targets if view.stream_id == self._stream_id)
        self._view = view = next(found, None)
        info = self._session.info
        if self._phase is not None and info is not None and view is not None and view.lead_ns is not None:
            setpoint_ns = round(1e9 / (info.pose_rate_hz if self._opening.frame else info.arm_rate_hz))
            self._phase.hear(view.seq, view.lead_ns, setpoint_ns, self._session.transport.now_ns())
        return True


class JointTargets(TargetStream):
    """A stream of joint targets."""

    @property
    def q(self) -> NDArray[np.float64]:
        """Where the arm is being sent [rad], shape (7,): first where the stream starts, then the last target that was set."""
        return read_only(self._values)

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
        info = self._info()
        self._put(within_limits(self.side, joints(self.side, q), info, self._on_limit))
        return self.q


class PoseTargets(TargetStream):
    """A stream of poses of an end effector, in its arm's shoulder frame; of a hand that yields, of its anchor."""

    @property
    def p(self) -> NDArray[np.float64]:
        """Where it is being sent [m], shape (3,): first where the stream starts, then the last target that was set."""
        return read_only(self._values[:3])

    @property
    def quat_xyzw(self) -> NDArray[np.float64]:
        """Orientation that goes with it, shape (4,)."""
        return read_only(self._values[3:])

    def set(self, p: ArrayLike, quat_xyzw: ArrayLike) -> NDArray[np.float64]:
        """Send a target; never waits.

        Args:
            p: Position in the frame of the stream [m], shape (3,).
            quat_xyzw: Orientation, norm 1, shape (4,); either sign, the shorter way is taken.

        Returns:
            The position that really goes out [m]: as given, or clipped to the reach when the stream was opened so.

        Raises:
            Rejected: WRONG_SHAPE, NOT_FINITE or OUT_OF_RANGE (norm, reach); nothing was sent.
            Disconnected: The daemon is gone.
            LeaseError: This control is over.
        """
        info = self._info()
        self._put(within_reach(self.side, numbers(self.side, p, quat_xyzw), info, self._on_limit))
        return self.p
