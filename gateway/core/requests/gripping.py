"""Carries out the owner's requests for grippers. They need their arm: without its stream the robot gives no torque (§4.4)."""

from __future__ import annotations

from gateway.codes import Code
from gateway.core.messages.events import CommandRequested
from gateway.core.motion.bounds import within
from gateway.core.requests.authorisation import Authorisation
from gateway.core.requests.moves import Answer
from gateway.core.supervision.coordinator import Coordinator
from gateway.core.supervision.supervisor import Trigger
from gateway.errors import Refusal
from gateway.messages.requests import SetGripper
from gateway.robot.limits import gripper_torque_nm
from gateway.values import Side

__all__ = ["Gripping"]


class Gripping:
    """Requests for grippers."""

    def __init__(self, coordinator: Coordinator, authorisation: Authorisation) -> None:
        self._coordinator = coordinator
        self._authorisation = authorisation

    def may_grip(self, side: Side, command: CommandRequested, epoch: int, now_ns: int) -> Refusal | None:
        """Refuse unless the owner may command a gripper now, with whatever force."""
        refusal = self._authorisation.motion(command, epoch, (), now_ns)
        if refusal is not None or self._coordinator.body.grippers[side].running:
            return refusal
        return Refusal(
            code=Code.NOT_ENABLED,
            message=f"the {side} arm is not streamed, and without its stream its gripper has no torque (manual §4.4)",
            field=f"{side}_gripper",
            value="off",
            bound="enabled",
            hint="enable the arm in the robot's configuration if it is not, then call enable()",
        )

    def set_gripper(self, command: CommandRequested, request: SetGripper, now_ns: int) -> Answer:
        """Send a gripper another force input."""
        coordinator, name = self._coordinator, f"{request.side}_gripper"
        refusal = self.may_grip(request.side, command, request.epoch, now_ns)
        if refusal is not None:
            return refusal
        hint = "0 opens most, 0.1 is no torque, 1 closes most (manual §4.4)"
        refusal = within(f"the {request.side} gripper's input", request.raw, 0.0, 1.0, field=name, hint=hint)
        if refusal is not None:
            return refusal
        coordinator.fire(Trigger.ARM_MOTION, now_ns, "the owner moves a gripper")
        coordinator.body.grippers[request.side].command(request.raw, request.epoch)
        return {"raw": request.raw, "torque_nm": gripper_torque_nm(request.raw)}
