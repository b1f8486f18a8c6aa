"""A stream of velocities as its commander sees it: set, tick, end. Shared by the blocking and the async streams.

It is one drive: the first tick after a stop, whoever asked for it, raises with what ended the drive, and nothing is driven
on. A block that is left by an exception takes the velocity back without waiting for the standstill. `set` sends nothing;
`tick` sends what was set last and paces, on an absolute grid: a late tick is skipped and counted.
"""

from __future__ import annotations

from abc import ABC, abstractmethod

from gateway.api import protocol
from gateway.client.asking.ground import drive_chassis, drive_lift, rest_chassis
from gateway.client.asking.procedures import Procedure, request
from gateway.client.asking.requests import number, seconds
from gateway.client.asking.watching import pause
from gateway.client.connection.session import Lease, Session
from gateway.errors import Code, GatewayError, failure

__all__ = ["ChassisVelocities", "LiftVelocities", "VelocityStream"]


class VelocityStream(ABC):
    """One drive, renewed by `tick`.

    `rate_hz` of `tick` is 5 to 50; without an expiry [s] a velocity lives as long as configured.
    """

    def __init__(self, session: Session, lease: Lease, rate_hz: float, expiry: float | None) -> None:
        rate_hz = number("rate_hz", rate_hz)
        if not 5.0 <= rate_hz <= 50.0:  # NaN compares false
            raise failure(
                Code.OUT_OF_RANGE,
                f"rate_hz is {rate_hz:g} Hz, velocities are taken at 5 to 50 Hz",
                field="rate_hz",
                value=f"{rate_hz:g}",
                bound="[5, 50]",
                unit="Hz",
                hint="stay inside the bound",
            )
        self.skipped = 0
        self._session = session
        self._lease = lease
        self._expiry_ns = None if expiry is None else seconds("expiry", expiry)
        self._period_ns = round(1e9 / rate_hz)
        self._drive_id = 0
        self._due_ns = 0

    @abstractmethod
    def _send(self) -> Procedure[int]:
        """Send what was set last, in this drive."""

    @abstractmethod
    def _rest(self) -> Procedure[None]:
        """End the drive, and wait until it is at its end."""

    @abstractmethod
    def _halt(self) -> Procedure[object]:
        """Take the velocity back, without waiting for the standstill."""

    def _open(self) -> Procedure[None]:
        self._drive_id = yield from self._send()
        self._due_ns = self._session.transport.now_ns()

    def _tick(self) -> Procedure[None]:
        if not self._drive_id:
            raise failure(Code.STREAM_ENDED, "this stream was not entered, or has ended")
        yield from self._send()
        now_ns = self._session.transport.now_ns()
        self._due_ns += self._period_ns
        if now_ns > self._due_ns:
            missed = (now_ns - self._due_ns) // self._period_ns + 1
            self.skipped += missed
            self._due_ns += missed * self._period_ns
        yield from pause(self._due_ns)

    def _close(self) -> Procedure[None]:
        if self._drive_id:
            yield from self._rest()
            self._drive_id = 0

    def _break_off(self) -> Procedure[None]:
        """End by an exception, which is the one to tell: what is still driven ends now, not when its velocity expires."""
        if self._drive_id:
            try:
                yield from self._halt()
            except GatewayError:
                return  # it is over, or nobody answers; then it expires
            finally:
                self._drive_id = 0


class ChassisVelocities(VelocityStream):
    """Velocities of the chassis."""

    def __init__(self, session: Session, lease: Lease, rate_hz: float, expiry: float | None) -> None:
        super().__init__(session, lease, rate_hz, expiry)
        self._velocity = (0.0, 0.0, 0.0)

    def set(self, vx: float, vy: float, wz: float) -> None:
        """Say what the next `tick` sends: vx, vy [m/s], wz [rad/s]."""
        self._velocity = (number("vx", vx), number("vy", vy), number("wz", wz))

    def _send(self) -> Procedure[int]:
        return drive_chassis(self._session, self._lease, self._velocity, self._expiry_ns, self._drive_id)

    def _rest(self) -> Procedure[None]:
        return rest_chassis(self._session, self._lease, self._drive_id)

    def _halt(self) -> Procedure[object]:
        return drive_chassis(self._session, self._lease, (0.0, 0.0, 0.0), None, self._drive_id)


class LiftVelocities(VelocityStream):
    """Velocities of the lift."""

    def __init__(self, session: Session, lease: Lease, rate_hz: float, expiry: float | None) -> None:
        super().__init__(session, lease, rate_hz, expiry)
        self._velocity = 0.0

    def set(self, velocity: float) -> None:
        """Say what the next `tick` sends: -1 (down) to 1 (up)."""
        self._velocity = number("velocity", velocity)

    def _send(self) -> Procedure[int]:
        return drive_lift(self._session, self._lease, self._velocity, self._expiry_ns, self._drive_id)

    def _rest(self) -> Procedure[None]:
        yield from self._halt()

    def _halt(self) -> Procedure[object]:
        return request(self._session, protocol.StopLift(epoch=self._lease.epoch))
