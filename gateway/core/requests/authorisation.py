"""Who may do what now: lease, order of stops, takeover, state, latches and the condition of the robot.

It answers; it changes nothing but its own memory of the last stop and the last takeover.
"""

from __future__ import annotations

from collections.abc import Sequence

from gateway.core.limits import validation
from gateway.core.limits.validation import Fitness
from gateway.core.messages.events import CommandRequested
from gateway.core.separation import goal_checks
from gateway.core.supervision.coordinator import Coordinator
from gateway.core.supervision.starting import Starting
from gateway.core.supervision.supervisor import State, Trigger
from gateway.core.supervision.watch import Watch
from gateway.errors import Code, Refusal
from gateway.values import Role, Side, Space

__all__ = ["REFUSAL_TEXT", "Authorisation"]

REFUSAL_TEXT: dict[Code, str] = {
    Code.NOT_OWNER: "nobody owns the robot",
    Code.NO_LINK: "there is no link to the robot, or it has not spoken yet",
    Code.STATE_STALE: "the robot's state is older than 100 ms",
    Code.NOT_ENABLED: "the arms are not enabled",
    Code.ROBOT_PAUSED: "the robot paused by itself; enable() again when it is safe",
    Code.STOPPING: "the arms are coming to rest",
}
"""Words for the refusals of the supervisor's table."""

OF_PEOPLE = (Code.ESTOP, Code.STOPPED_BY_OTHER)
"""Latches that stops leave behind."""

NOT_HEARD = frozenset({Code.NO_LINK, Code.STATE_STALE})
"""Refusals for which the reason may be that the robot stands under another namespace."""


class Authorisation:
    """Answers whether a request may pass."""

    def __init__(self, coordinator: Coordinator, starting: Starting) -> None:
        self._coordinator = coordinator
        self._starting = starting
        self.watch = Watch(coordinator)
        """Over stop endpoints."""
        self._last_stop_ns = -1
        self._takeover_epoch = 0

    def name_of(self, command: CommandRequested) -> str:
        """Return what people call whoever asks: by the name that came along, as owner, or as stop endpoint; else his id."""
        owner = self._coordinator.lease.owner
        as_owner = owner.name if owner is not None and owner.client_id == command.client_id else ""
        as_endpoint = self._coordinator.endpoints.name_of(command.client_id)
        return command.name or as_owner or as_endpoint or command.client_id

    def note_stop(self, received_ns: int, client_id: str = "", *, latches: bool = True) -> None:
        """Remember a stop: requests and targets that arrived before it move nothing and never will.

        Args:
            received_ns: When it arrived [ns].
            client_id: Whose it is.
            latches: Whether it is about to be latched; the owner's own stop is not.
        """
        supervisor = self._coordinator.supervisor
        self._last_stop_ns = max(self._last_stop_ns, received_ns)
        if not self._is_stopped():
            supervisor.stopper = client_id if latches else ""
        elif supervisor.stopper != client_id:
            supervisor.stopper = ""

    def _is_stopped(self) -> bool:
        return any(code in self._coordinator.supervisor.latches for code in OF_PEOPLE)

    def by_force(self, command: CommandRequested) -> Refusal | None:
        """Refuse to take the robot from its owner to whoever is no admin."""
        owner = self._coordinator.lease.owner
        if command.role is Role.ADMIN or owner is None or owner.client_id == command.client_id:
            return None
        return _for_admins(
            command, f"may not take the robot from {owner.name}", "wait until it is free, or ask an admin"
        )

    def recovery(self, command: CommandRequested) -> Refusal | None:
        """Refuse to undo the stops, and to let the silent stop endpoints go, of others to whoever is no admin."""
        if command.role is Role.ADMIN:
            return None
        coordinator = self._coordinator
        if self._is_stopped() and self._coordinator.supervisor.stopper != command.client_id:
            return _for_admins(command, "may not undo the stop of somebody else", "ask an admin, or whoever stopped")
        if coordinator.endpoints.silent or Code.ENDPOINT_SILENT in coordinator.supervisor.latches:
            return _for_admins(
                command, "may not let a silent stop endpoint go", "see that it is heard, or ask an admin"
            )
        return None

    def note_takeover(self, epoch: int) -> None:
        """Remember a takeover: the new owner waits until the former owner's motion has come to rest."""
        self._takeover_epoch = epoch

    def is_before_stop(self, received_ns: int) -> bool:
        """Return whether something that arrived then came before the last stop."""
        return received_ns <= self._last_stop_ns

    def owner(self, command: CommandRequested, epoch: int) -> Refusal | None:
        """Refuse anybody but the owner with the current epoch."""
        if self._coordinator.is_exiting:
            return Refusal(code=Code.EXITING, message="the daemon is ending")
        return self._coordinator.lease.check(command.client_id, epoch)

    def after_stop(self, command: CommandRequested) -> Refusal | None:
        """Refuse what was sent before the last stop."""
        if not self.is_before_stop(command.received_ns):
            return None
        return Refusal(code=Code.STOPPED, message="the robot was stopped after this request was sent")

    def state(self, trigger: Trigger, now_ns: int) -> Refusal | None:
        """Refuse what the supervisor's table refuses in the present state."""
        coordinator = self._coordinator
        code = coordinator.supervisor.cell(trigger).refuse
        if code is None:
            return None
        if coordinator.state is State.READ_ONLY and coordinator.lease.owner is not None:
            refusal = validation.check_mode(coordinator.store.mode(now_ns))
            if refusal is not None:
                return refusal
        if (
            code in NOT_HEARD
            and coordinator.other_robot is not None
            and coordinator.other_robot.code is Code.OTHER_NAMESPACE
        ):
            return coordinator.other_robot
        return Refusal(code=code, message=REFUSAL_TEXT[code])

    def latches(self) -> Refusal | None:
        """Refuse while something is latched."""
        return validation.latched(self._coordinator.supervisor.latches)

    def held_elsewhere(self) -> Refusal | None:
        """Refuse while the guard of an earlier daemon holds the robot: two would command it."""
        guard = self._coordinator.guard
        if not guard.is_held_elsewhere(self._coordinator.others.armed_friends):
            return None
        then = "this daemon is about to take the hold over" if guard.earlier_holds else "it ends by itself within 10 s"
        message = f"the guard of an earlier daemon holds the robot; {then}"
        return Refusal(code=Code.HELD_BY_GUARD, message=message)

    def beside_others(self, now_ns: int) -> Refusal | None:
        """Refuse to begin beside a second robot, or whoever else commands ours; of two that claim it at once one yields."""
        coordinator = self._coordinator
        if coordinator.other_robot is not None and coordinator.other_robot.code is Code.TWO_ROBOTS:
            return coordinator.other_robot
        refusal = coordinator.others.objection(now_ns)
        is_open = coordinator.claim.is_open
        return None if refusal is not None and refusal.code is Code.OTHER_GATEWAY and is_open else refusal

    def motion(
        self, command: CommandRequested, epoch: int, sides: Sequence[Side], now_ns: int, space: Space = Space.JOINT
    ) -> Refusal | None:
        """Refuse unless the owner may move these arms now."""
        coordinator = self._coordinator
        refusal = (
            self.owner(command, epoch)
            or self.after_stop(command)
            or self.state(Trigger.ARM_MOTION, now_ns)
            or self.latches()
            or self.watch.refusal()
            or self._takeover(epoch)
        )
        if refusal is not None:
            return refusal
        moved = {*sides, *coordinator.sides}  # an arm that must be held, too, but cannot, would end the motion at once
        fitness = Fitness(
            mode=coordinator.store.mode(now_ns),
            part_fresh={side: coordinator.part_fresh(side, now_ns) for side in moved},
            streaming={side: coordinator.body.arms[side].running for side in moved},
            spaces={side: space if side in sides else coordinator.body.arms[side].space for side in moved},
        )
        ordered = (*sides, *(side for side in coordinator.sides if side not in sides))
        return (
            validation.check_arms(fitness, ordered)
            or self._held(now_ns)
            or goal_checks.check_unguarded(coordinator, sides, space, now_ns)
        )

    def ground(self, command: CommandRequested, epoch: int, now_ns: int) -> Refusal | None:
        """Refuse unless the owner may drive chassis or lift now; neither needs the arms to be enabled."""
        return (
            self.owner(command, epoch)
            or self.after_stop(command)
            or self.state(Trigger.GROUND_COMMAND, now_ns)
            or self.latches()
            or self.watch.refusal()
            or self.held_elsewhere()
            or self.beside_others(now_ns)
            or self._takeover(epoch)
        )

    def _held(self, now_ns: int) -> Refusal | None:
        """Refuse while a held reference is away from its arm: a motion would begin with a jerk, and end as an error."""
        coordinator = self._coordinator
        if coordinator.body.is_walking:
            return Refusal(
                code=Code.STOPPING, message="the held reference is walking back to the arm; wait until it is there"
            )
        if coordinator.state is State.HOLDING:
            for side, off in self._starting.strayed(now_ns).items():
                arm = coordinator.body.arms[side]
                in_m = off.m > arm.tracking.m
                return Refusal(
                    code=Code.TRACKING_ERROR,
                    message=f"the {side} arm is {off.text(arm.space)} from where it is held, "
                    f"{arm.tracking.text(arm.space)} is the bound",
                    field=f"{side}_arm",
                    value=f"{off.m if in_m else off.rad:.6g}",
                    bound=str(arm.tracking.m if in_m else arm.tracking.rad),
                    unit="m" if in_m else "rad",
                    hint="call enable(): the held reference walks back to the arm",
                )
        return None

    def _takeover(self, epoch: int) -> Refusal | None:
        if epoch != self._takeover_epoch:
            return None
        if not self._coordinator.body.is_at_rest:
            return Refusal(
                code=Code.TAKEOVER_BRAKING, message="the arms are still braking from the former owner's motion"
            )
        self._takeover_epoch = 0
        return None


def _for_admins(command: CommandRequested, what: str, hint: str) -> Refusal:
    return Refusal(
        code=Code.NOT_PERMITTED,
        message=f"this user, {command.role}, {what}",
        field="role",
        value=command.role.value,
        bound=Role.ADMIN.value,
        hint=hint,
    )
