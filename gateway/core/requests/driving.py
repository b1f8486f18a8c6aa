"""Carries out the owner's requests for chassis and lift. What may pass is `authorisation.py`'s and `ground_rules.py`'s word.

Stopping them is the owner's in every state, on a model that has them: a stop frame is never held back.
"""

from __future__ import annotations

from gateway.codes import Code
from gateway.core.limits import ground_rules as rules
from gateway.core.limits.validation import check_expiry
from gateway.core.messages.events import CommandRequested
from gateway.core.requests.authorisation import Authorisation
from gateway.core.requests.moves import Answer
from gateway.core.streams.ground import LIFT_OFF
from gateway.core.streams.lift import LiftStream
from gateway.core.supervision.coordinator import Coordinator
from gateway.errors import Refusal
from gateway.messages.requests import DisableLift, DriveChassis, DriveLift, StopChassis, StopLift

__all__ = ["Driving"]


class Driving:
    """Requests for chassis and lift."""

    def __init__(self, coordinator: Coordinator, authorisation: Authorisation) -> None:
        self._coordinator = coordinator
        self._authorisation = authorisation

    def may_drive_chassis(self, command: CommandRequested, epoch: int, now_ns: int) -> Refusal | None:
        """Refuse unless the owner may drive the chassis now, at whatever velocity."""
        return self._authorisation.ground(command, epoch, now_ns) or rules.check_chassis(
            self._coordinator.store.mode(now_ns), self._coordinator.store.fsm(now_ns)
        )

    def may_drive_lift(self, command: CommandRequested, epoch: int, now_ns: int) -> Refusal | None:
        """Refuse unless the owner may drive the lift of a model that has one now, at whatever velocity."""
        store = self._coordinator.store
        return self._authorisation.ground(command, epoch, now_ns) or rules.check_lift(
            store.mode(now_ns), store.fsm(now_ns)
        )

    def drive_chassis(self, command: CommandRequested, request: DriveChassis, now_ns: int) -> Answer:
        """Begin a drive of the chassis, or go on with one at another velocity."""
        coordinator = self._coordinator
        velocity = (request.vx_mps, request.vy_mps, request.wz_radps)
        refusal = (
            self.may_drive_chassis(command, request.epoch, now_ns)
            or rules.check_chassis_velocity(velocity, coordinator.settings.chassis)
            or check_expiry(request.expiry_ns)
        )
        if refusal is not None:
            return refusal
        expiry_ns = coordinator.settings.chassis.expiry_ns if request.expiry_ns is None else request.expiry_ns
        chassis = coordinator.body.chassis
        ended = chassis.drive(
            velocity,
            epoch=request.epoch,
            expires_ns=command.received_ns + expiry_ns,
            now_ns=now_ns,
            drive_id=request.drive_id,
        )
        return _over("chassis", request.drive_id, ended) if ended else {"drive_id": chassis.drive_id}

    def stop_chassis(self, command: CommandRequested, request: StopChassis, now_ns: int) -> Answer:
        """Zeros for the chassis, at once."""
        refusal = self._authorisation.owner(command, request.epoch)
        if refusal is not None:
            return refusal
        chassis = self._coordinator.body.chassis
        chassis.end(Code.STOPPED)
        chassis.stop(now_ns)
        return {}

    def drive_lift(self, command: CommandRequested, request: DriveLift, now_ns: int) -> Answer:
        """Begin a drive of the lift, or go on with one at another velocity."""
        coordinator, lift = self._coordinator, self._coordinator.body.lift
        if lift is None:
            return self._authorisation.owner(command, request.epoch) or rules.no_lift()
        refusal = (
            self.may_drive_lift(command, request.epoch, now_ns)
            or rules.check_lift_velocity(request.velocity, coordinator.settings.lift)
            or check_expiry(request.expiry_ns)
        )
        if refusal is not None:
            return refusal
        expiry_ns = coordinator.settings.lift.expiry_ns if request.expiry_ns is None else request.expiry_ns
        ended = lift.drive(
            request.velocity,
            epoch=request.epoch,
            expires_ns=command.received_ns + expiry_ns,
            now_ns=now_ns,
            drive_id=request.drive_id,
        )
        return _over("lift", request.drive_id, ended) if ended else {"drive_id": lift.drive_id}

    def stop_lift(self, command: CommandRequested, request: StopLift, now_ns: int) -> Answer:
        """Stop the lift, at once; its servo stays on."""
        lift = self._lift(command, request.epoch)
        if isinstance(lift, Refusal):
            return lift
        lift.end(Code.STOPPED)
        lift.stop(now_ns)
        return {}

    def disable_lift(self, command: CommandRequested, request: DisableLift, now_ns: int) -> Answer:
        """Stop the lift, and take its servo off after that."""
        lift = self._lift(command, request.epoch)
        if isinstance(lift, Refusal):
            return lift
        lift.end(Code.STOPPED)
        lift.stop(now_ns)
        lift.then(LIFT_OFF)
        return {}

    def _lift(self, command: CommandRequested, epoch: int) -> LiftStream | Refusal:
        return self._authorisation.owner(command, epoch) or self._coordinator.body.lift or rules.no_lift()


def _over(what: str, drive_id: int, code: Code) -> Refusal:
    """Return the refusal of a velocity for a drive that something has ended."""
    return Refusal(
        code=code,
        message=f"drive {drive_id} of the {what} is over: {code}",
        field="drive_id",
        value=str(drive_id),
        hint="begin another drive when it is safe",
    )
