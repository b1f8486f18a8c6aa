"""Grippers, chassis and lift of an owned robot. The blocking half of `client`."""

from __future__ import annotations

from typing import TypeVar

from gateway.client.asking.orders import ChassisOrders, GripperOrders, LiftOrders
from gateway.client.asking.velocity_stream import ChassisVelocities, LiftVelocities, VelocityStream
from gateway.client.blocking import run

__all__ = ["ChassisControl", "ChassisStream", "GripperControl", "LiftControl", "LiftStream"]

StreamT = TypeVar("StreamT", bound=VelocityStream)


class GripperControl(GripperOrders):
    """One gripper of a `Control`. It needs its arm: without that stream it has no torque (manual §4.4).

    Before the first command it has no torque. A command holds until the next one, also while the robot is held; it ends
    with the arm's stream: `disable`, `release`, an e-stop, 60 s after a loss.
    """

    def grip(self, force: float = 0.5) -> None:
        """Close with a part of the greatest torque, and hold so.

        Args:
            force: 0 (none) to 1 (1.6 N·m at the motor, manual §4.4).

        Raises:
            NotReady: The arm is not enabled, or the robot not in a state for it.
            Rejected: `force` is no such part.
        """
        run(self._session, self._grip(force))

    def open(self, force: float = 0.5) -> None:
        """Open with a part of the greatest torque, 0 (none) to 1 (2 N·m at the motor, manual §4.4); as `grip`."""
        run(self._session, self._open(force))

    def set(self, raw: float) -> None:
        """Send the robot's own input: 0 opens most, 0.1 is no torque, 1 closes most (manual §4.4); as `grip`."""
        run(self._session, self._set(raw))

    def relax(self) -> None:
        """No torque (0.1, manual §4.4); as `grip`."""
        run(self._session, self._grip(0.0))


class ChassisControl(ChassisOrders):
    """The chassis of a `Control`. It needs the lease, but no enabled arm."""

    def set_velocity(self, vx: float, vy: float, wz: float, *, expiry: float | None = None) -> None:
        """Ramp to a velocity, and keep it until it expires or another one comes; then ramp down.

        Args:
            vx: Along x [m/s]; the speed over the ground counts against the limit, whatever its direction.
            vy: Along y [m/s].
            wz: Around z [rad/s].
            expiry: How long it counts [s], 0.05 to 3; None for the configured time (0.3 s).

        Raises:
            Rejected: NOT_FINITE, or OUT_OF_RANGE with the limit.
            NotReady: The chassis is disabled, or the robot not in a state for it.
        """
        run(self._session, self._set_velocity(vx, vy, wz, expiry))

    def drive_for(self, vx: float, vy: float, wz: float, duration: float) -> None:
        """Drive at a velocity for a time, then ramp down; returns when the commanded velocity is at rest.

        The time counts from the beginning, the way up to the velocity included. There is no odometry: how far the robot
        came, nobody measures (manual §4.5).

        Args:
            vx: Along x [m/s].
            vy: Along y [m/s].
            wz: Around z [rad/s].
            duration: How long [s].

        Raises:
            Aborted: A stop or a loss ended the drive; `.code` says which.
            Rejected: NOT_FINITE, or OUT_OF_RANGE with the limit.
            NotReady: The chassis is disabled, or the robot not in a state for it.
        """
        run(self._session, self._drive_for(vx, vy, wz, duration))

    def stream(self, rate_hz: float = 20.0, *, expiry: float | None = None) -> ChassisStream:
        """Return a stream of velocities, to be used in a `with` block: one drive, which a stop ends for good.

        Args:
            rate_hz: Rate of `tick` [Hz], 5 to 50.
            expiry: A velocity that has no successor for so long makes the chassis ramp down [s]; None for the configured
                time (0.3 s).
        """
        return ChassisStream(self._session, self._control._owned(), rate_hz, expiry)

    def stop(self) -> None:
        """Zeros at once: the robot brakes as quickly as it can (manual §4.5)."""
        run(self._session, self._stop())


class LiftControl(LiftOrders):
    """The lift of a `Control`, on the model that has one. It needs the lease, but no enabled arm.

    Where the lift is, nobody knows: the robot publishes no position of it (manual §4.12).
    """

    def set_velocity(self, velocity: float, *, expiry: float | None = None) -> None:
        """Go up or down until it expires or another one comes; then stop, with the servo on.

        Args:
            velocity: Part of full speed, -1 (down) to 1 (up).
            expiry: How long it counts [s], 0.05 to 3; None for the configured time (0.3 s).

        Raises:
            Rejected: NOT_FINITE, or OUT_OF_RANGE with the limit.
            NotReady: NO_LIFT, LIFT_DISABLED, or the robot is not in a state for it.
        """
        run(self._session, self._set_velocity(velocity, expiry))

    def drive_for(self, velocity: float, duration: float) -> None:
        """Go up or down for a time, then stop, with the servo on.

        Args:
            velocity: Part of full speed, -1 (down) to 1 (up).
            duration: How long [s].

        Raises:
            Aborted: A stop or a loss ended the drive; `.code` says which.
            Rejected: NOT_FINITE, or OUT_OF_RANGE with the limit.
            NotReady: NO_LIFT, LIFT_DISABLED, or the robot is not in a state for it.
        """
        run(self._session, self._drive_for(velocity, duration))

    def stream(self, rate_hz: float = 20.0, *, expiry: float | None = None) -> LiftStream:
        """Return a stream of velocities, to be used in a `with` block: one drive, which a stop ends for good.

        Args:
            rate_hz: Rate of `tick` [Hz], 5 to 50.
            expiry: A velocity that has no successor for so long makes the lift stop [s]; None for the configured time
                (0.3 s).
        """
        return LiftStream(self._session, self._control._owned(), rate_hz, expiry)

    def stop(self) -> None:
        """Stop at once; the servo stays on while somebody owns or holds the robot (manual §4.6)."""
        run(self._session, self._stop())

    def disable(self) -> None:
        """Stop, then take the servo off (manual §4.6)."""
        run(self._session, self._disable())


class _BlockingVelocities(VelocityStream):
    """What both streams wait for."""

    def tick(self) -> None:
        """Send what was set last, and wait for the next instant of the grid.

        Raises:
            Aborted: Something ended the drive; `.code` says what.
            Rejected: What was set is no velocity, or too fast.
        """
        run(self._session, self._tick())

    def __enter__(self: StreamT) -> StreamT:
        run(self._session, self._open())
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        run(self._session, self._close() if kind is None else self._break_off())


class ChassisStream(ChassisVelocities, _BlockingVelocities):
    """A stream of velocities of the chassis. Context manager; its end ramps it down, by an exception without waiting."""


class LiftStream(LiftVelocities, _BlockingVelocities):
    """A stream of velocities of the lift. Context manager; its end stops it, by an exception too."""
