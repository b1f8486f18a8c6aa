"""Grippers, chassis and lift under asyncio: the twin of `parts`, class for class, which documents what each method does.

Import these names from `gateway.client.aio`.
"""

from __future__ import annotations

from typing import TypeVar

from gateway.client.asking.orders import ChassisOrders, GripperOrders, LiftOrders
from gateway.client.asking.velocity_stream import ChassisVelocities, LiftVelocities, VelocityStream
from gateway.client.awaiting import run

__all__ = ["ChassisControl", "ChassisStream", "GripperControl", "LiftControl", "LiftStream"]

StreamT = TypeVar("StreamT", bound=VelocityStream)


class GripperControl(GripperOrders):
    """One gripper of a `Control`. As `client.GripperControl`: it needs its arm, and keeps what it was told."""

    async def grip(self, force: float = 0.5) -> None:
        """Close with a part of the greatest torque, 0 to 1, and hold so."""
        await run(self._session, self._grip(force))

    async def open(self, force: float = 0.5) -> None:
        """Open with a part of the greatest torque, 0 to 1."""
        await run(self._session, self._open(force))

    async def set(self, raw: float) -> None:
        """Send the robot's own input: 0 opens most, 0.1 is no torque, 1 closes most (manual §4.4)."""
        await run(self._session, self._set(raw))

    async def relax(self) -> None:
        """No torque (0.1, manual §4.4)."""
        await run(self._session, self._grip(0.0))


class ChassisControl(ChassisOrders):
    """The chassis of a `Control`. As `client.ChassisControl`: it needs the lease, but no enabled arm."""

    async def set_velocity(self, vx: float, vy: float, wz: float, *, expiry: float | None = None) -> None:
        """Ramp to a velocity [m/s, rad/s], and keep it until it expires [s] or another one comes; then ramp down."""
        await run(self._session, self._set_velocity(vx, vy, wz, expiry))

    async def drive_for(self, vx: float, vy: float, wz: float, duration: float) -> None:
        """Drive at a velocity for a time [s], then ramp down; returns when the commanded velocity is at rest."""
        await run(self._session, self._drive_for(vx, vy, wz, duration))

    def stream(self, rate_hz: float = 20.0, *, expiry: float | None = None) -> ChassisStream:
        """Return a stream of velocities, to be used in `async with`: one drive, which a stop ends for good."""
        return ChassisStream(self._session, self._control._owned(), rate_hz, expiry)

    async def stop(self) -> None:
        """Zeros at once: the robot brakes as quickly as it can (manual §4.5)."""
        await run(self._session, self._stop())


class LiftControl(LiftOrders):
    """The lift of a `Control`, on the model that has one. As `client.LiftControl`: nobody knows where it is."""

    async def set_velocity(self, velocity: float, *, expiry: float | None = None) -> None:
        """Go up or down, -1 to 1, until it expires [s] or another one comes; then stop, with the servo on."""
        await run(self._session, self._set_velocity(velocity, expiry))

    async def drive_for(self, velocity: float, duration: float) -> None:
        """Go up or down for a time [s], then stop, with the servo on."""
        await run(self._session, self._drive_for(velocity, duration))

    def stream(self, rate_hz: float = 20.0, *, expiry: float | None = None) -> LiftStream:
        """Return a stream of velocities, to be used in `async with`: one drive, which a stop ends for good."""
        return LiftStream(self._session, self._control._owned(), rate_hz, expiry)

    async def stop(self) -> None:
        """Stop at once; the servo stays on while somebody owns or holds the robot (manual §4.6)."""
        await run(self._session, self._stop())

    async def disable(self) -> None:
        """Stop, then take the servo off (manual §4.6)."""
        await run(self._session, self._disable())


class _AwaitedVelocities(VelocityStream):
    """What both streams wait for."""

    async def tick(self) -> None:
        """Send what was set last, and wait for the next instant of the grid."""
        await run(self._session, self._tick())

    async def __aenter__(self: StreamT) -> StreamT:
        await run(self._session, self._open())
        return self

    async def __aexit__(self, kind: type[BaseException] | None, *_: object) -> None:
        await run(self._session, self._close() if kind is None else self._break_off())


class ChassisStream(ChassisVelocities, _AwaitedVelocities):
    """A stream of velocities of the chassis. As `client.ChassisStream`."""


class LiftStream(LiftVelocities, _AwaitedVelocities):
    """A stream of velocities of the lift. As `client.LiftStream`."""
