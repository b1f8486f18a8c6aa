"""What an owner asks of grippers, chassis and lift, without waiting: procedures that the blocking and the async parts run.

What is said, in which units, to which request it becomes, stands here once; the two fronts only say how they wait.
"""

from __future__ import annotations

from gateway.api import protocol
from gateway.client.asking import ground
from gateway.client.asking.ownership import Ownership
from gateway.client.asking.procedures import Procedure, request
from gateway.client.asking.requests import seconds
from gateway.client.connection.session import Session

__all__ = ["ChassisOrders", "GripperOrders", "LiftOrders"]


class _Orders:
    """Orders to a part of the robot."""

    def __init__(self, control: Ownership) -> None:
        self._control = control

    @property
    def _session(self) -> Session:
        return self._control._session

    def _ask(self, command: protocol.Request) -> Procedure[None]:
        yield from request(self._session, command)


class GripperOrders(_Orders):
    """Orders to one gripper."""

    def __init__(self, control: Ownership, side: protocol.SideName) -> None:
        super().__init__(control)
        self.side = side

    def _set(self, raw: float) -> Procedure[None]:
        return ground.set_gripper(self._session, self._control._owned(), self.side, raw)

    def _grip(self, force: float) -> Procedure[None]:
        return self._set(ground.closing(force))

    def _open(self, force: float) -> Procedure[None]:
        return self._set(ground.opening(force))


class ChassisOrders(_Orders):
    """Orders to the chassis."""

    def _set_velocity(self, vx: float, vy: float, wz: float, expiry: float | None) -> Procedure[int]:
        expiry_ns = None if expiry is None else seconds("expiry", expiry)
        return ground.drive_chassis(self._session, self._control._owned(), (vx, vy, wz), expiry_ns)

    def _drive_for(self, vx: float, vy: float, wz: float, duration: float) -> Procedure[None]:
        duration_ns = seconds("duration", duration)
        return ground.drive_chassis_for(self._session, self._control._owned(), (vx, vy, wz), duration_ns)

    def _stop(self) -> Procedure[None]:
        return self._ask(protocol.StopChassis(epoch=self._control.epoch))


class LiftOrders(_Orders):
    """Orders to the lift."""

    def _set_velocity(self, velocity: float, expiry: float | None) -> Procedure[int]:
        expiry_ns = None if expiry is None else seconds("expiry", expiry)
        return ground.drive_lift(self._session, self._control._owned(), velocity, expiry_ns)

    def _drive_for(self, velocity: float, duration: float) -> Procedure[None]:
        duration_ns = seconds("duration", duration)
        return ground.drive_lift_for(self._session, self._control._owned(), velocity, duration_ns)

    def _stop(self) -> Procedure[None]:
        return self._ask(protocol.StopLift(epoch=self._control.epoch))

    def _disable(self) -> Procedure[None]:
        return self._ask(protocol.DisableLift(epoch=self._control.epoch))
