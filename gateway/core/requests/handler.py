"""Answers requests: who may ask, whether its input is valid, what it sets in motion, and the one reply.

Order of the checks: lease, state of the gateway, latches, condition of the robot, then the input itself. `stop` and
`estop` need no lease and are never refused. Nothing waits here: what takes time is seen in the snapshot.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import TypeAlias

from gateway.core.limits import validation
from gateway.core.messages.events import CommandRequested, TargetArrived
from gateway.core.messages.outputs import Level
from gateway.core.requests.admitting import Admitting
from gateway.core.requests.authorisation import REFUSAL_TEXT, Authorisation
from gateway.core.requests.cartesian import Cartesian
from gateway.core.requests.driving import Driving
from gateway.core.requests.follows import Follows
from gateway.core.requests.gripping import Gripping
from gateway.core.requests.moves import Answer, Facts, Moves
from gateway.core.requests.weighing import Weighing
from gateway.core.supervision.coordinator import Coordinator
from gateway.core.supervision.phases import Phases
from gateway.core.supervision.supervisor import State, Trigger
from gateway.errors import Code, Refusal
from gateway.messages.requests import (
    Abandon,
    Acquire,
    Cancel,
    CheckFollow,
    CloseStream,
    Disable,
    DisableLift,
    DriveChassis,
    DriveLift,
    Enable,
    Estop,
    Follow,
    Hold,
    LeaveEndpoint,
    Move,
    MovePose,
    OpenStream,
    Recover,
    RegisterEndpoint,
    Release,
    SetGripper,
    SetPayload,
    Stop,
    StopChassis,
    StopLift,
    Take,
    Weigh,
)
from gateway.values import FsmState, Side

__all__ = ["May", "RequestHandler"]

May: TypeAlias = Callable[[CommandRequested, int, int], Refusal | None]
"""Says whether a request may be carried out now: who asks, under which epoch, and the time [ns]."""


class RequestHandler:
    """Carries out requests."""

    def __init__(self, coordinator: Coordinator, phases: Phases) -> None:
        self._coordinator = coordinator
        self._phases = phases
        self._authorisation = Authorisation(coordinator, phases.starting)
        self.watch = watch = self._authorisation.watch
        """Over stop endpoints."""
        self._moves = Moves(coordinator, self._authorisation)
        driving = Driving(coordinator, self._authorisation)
        gripping = Gripping(coordinator, self._authorisation)
        weighing = Weighing(coordinator, self._authorisation)
        follows = Follows(coordinator, self._authorisation, self._moves)
        self._admitting = Admitting(coordinator)
        self._cartesian = Cartesian(coordinator, self._authorisation, self._moves)
        self.may: dict[str, May] = {
            "enable": self._may_enable,
            **{f"{side}_arm": partial(self._may_move, side) for side in Side},
            **{f"{side}_gripper": partial(gripping.may_grip, side) for side in Side},
            "chassis": driving.may_drive_chassis,
            **({} if coordinator.body.lift is None else {"lift": driving.may_drive_lift}),
        }
        """By kind of request what refuses it now, whatever its input: who asks, under which epoch, and when."""
        self._answers: dict[type, Callable[..., Answer]] = {
            Acquire: self._acquire,
            Take: self._take,
            Release: self._release,
            Abandon: self._abandon,
            Enable: self._enable,
            Disable: self._disable,
            Move: self._moves.move,
            Follow: follows.follow,
            CheckFollow: follows.check,
            MovePose: self._cartesian.move_pose,
            OpenStream: self._moves.open_stream,
            CloseStream: self._moves.close_stream,
            Hold: self._moves.hold,
            Cancel: self._moves.cancel,
            SetGripper: gripping.set_gripper,
            SetPayload: weighing.set_payload,
            Weigh: weighing.weigh,
            DriveChassis: driving.drive_chassis,
            StopChassis: driving.stop_chassis,
            DriveLift: driving.drive_lift,
            StopLift: driving.stop_lift,
            DisableLift: driving.disable_lift,
            Stop: self._stop,
            Estop: self._estop,
            Recover: self._recover,
            RegisterEndpoint: watch.register,
            LeaveEndpoint: watch.leave,
        }

    def answer(self, command: CommandRequested, now_ns: int) -> Answer:
        """Carry out one request; return facts for the caller, or why nothing was done."""
        return self._answers[type(command.request)](command, command.request, now_ns)

    def _may_move(self, side: Side, command: CommandRequested, epoch: int, now_ns: int) -> Refusal | None:
        """Judge a motion in the space in which the arm is streamed, or would be."""
        arm, mode = self._coordinator.body.arms[side], self._coordinator.store.mode(now_ns)
        space = arm.space if arm.running or mode is None else mode.space(side)
        return self._authorisation.motion(command, epoch, (side,), now_ns, space)

    # ------------------------------------------------------------------------------------------------ the lease

    def _acquire(self, command: CommandRequested, request: Acquire, now_ns: int) -> Answer:
        if self._coordinator.is_exiting:
            return Refusal(code=Code.EXITING, message="the daemon is ending")
        was = self._coordinator.lease.epoch if self._coordinator.lease.owner else 0
        epoch = self._coordinator.lease.acquire(command.client_id, request.name, request.pid, request.on_loss, now_ns)
        if isinstance(epoch, Refusal):
            return epoch
        if epoch != was:
            self._coordinator.notice(
                Code.LEASE_CHANGED,
                Level.INFO,
                f"{request.name} (pid {request.pid}) owns the robot, epoch {epoch}",
                now_ns,
            )
        self._coordinator.fire(Trigger.ACQUIRE, now_ns, f"{request.name} acquired the lease")
        return {"epoch": epoch}

    def _take(self, command: CommandRequested, request: Take, now_ns: int) -> Answer:
        if self._coordinator.is_exiting:
            return Refusal(code=Code.EXITING, message="the daemon is ending")
        lease = self._coordinator.lease
        owner = lease.owner
        refusal = self._authorisation.by_force(command)
        if refusal is not None:
            return refusal
        epoch = lease.take(command.client_id, request.name, request.pid, request.reason, request.on_loss, now_ns)
        if isinstance(epoch, Refusal):
            return epoch
        if owner is not None and owner.client_id == command.client_id:
            return {"epoch": epoch}
        former = owner.name if owner else "nobody"
        message = f"{request.name} (pid {request.pid}) took the robot from {former}: {request.reason}"
        self._coordinator.notice(Code.LEASE_CHANGED, Level.WARNING, message, now_ns, epoch=str(epoch))
        self._coordinator.fire(Trigger.TAKE, now_ns, message)
        self._authorisation.note_takeover(epoch)
        return {"epoch": epoch}

    def _release(self, command: CommandRequested, request: Release, now_ns: int) -> Answer:
        refusal = self._coordinator.lease.release(command.client_id, request.epoch, now_ns)
        if refusal is not None:
            return refusal
        self._coordinator.notice(Code.LEASE_CHANGED, Level.INFO, "the lease was released", now_ns)
        self._coordinator.fire(Trigger.RELEASE, now_ns, "the owner released the lease")
        return {}

    def _abandon(self, command: CommandRequested, request: Abandon, now_ns: int) -> Answer:
        return self._coordinator.lease.abandon(command.client_id, request.epoch, now_ns) or {}

    # ------------------------------------------------------------------------------------------------ enable, disable

    def _enable(self, command: CommandRequested, request: Enable, now_ns: int) -> Answer:
        coordinator = self._coordinator
        sides = self._sides_to_enable(command, request.epoch, now_ns)
        if isinstance(sides, Refusal):
            return sides
        if coordinator.state is State.HOLDING:
            refusal = self._phases.starting.join(now_ns) or self._phases.starting.walk(now_ns)
            if refusal is not None:
                return refusal
        if coordinator.supervisor.cell(Trigger.ENABLE).to is not State.ENABLING:
            outcome = "running" if coordinator.state is State.ENABLING else "ok"
            return {"attempt": coordinator.enable.attempt, "outcome": outcome, "walking": coordinator.body.is_walking}
        coordinator.fire(Trigger.ENABLE, now_ns, "the owner enables")
        self._phases.enabling.begin(sides, now_ns)
        return {"attempt": coordinator.enable.attempt, "outcome": coordinator.enable.outcome, "walking": False}

    def _sides_to_enable(self, command: CommandRequested, epoch: int, now_ns: int) -> tuple[Side, ...] | Refusal:
        """Return the arms whose streams an `enable` would start, none when it is under way or done, or why it is refused."""
        refusal = (
            self._authorisation.owner(command, epoch)
            or self._authorisation.after_stop(command)
            or self._authorisation.state(Trigger.ENABLE, now_ns)
            or self._authorisation.latches()
            or self.watch.refusal()
            or self._authorisation.held_elsewhere()
        )
        if refusal is not None:
            return refusal
        if self._coordinator.supervisor.cell(Trigger.ENABLE).to is not State.ENABLING:
            return ()
        return self._authorisation.beside_others(now_ns) or self._enable_sides(now_ns)

    def _may_enable(self, command: CommandRequested, epoch: int, now_ns: int) -> Refusal | None:
        sides = self._sides_to_enable(command, epoch, now_ns)
        return sides if isinstance(sides, Refusal) else None

    def _enable_sides(self, now_ns: int) -> tuple[Side, ...] | Refusal:
        """Return the arms whose streams an enabling would start, or why it cannot begin."""
        store = self._coordinator.store
        mode = store.mode(now_ns)
        refusal = validation.check_mode(mode)
        if refusal is not None or mode is None:
            return refusal or Refusal(code=Code.INTERNAL, message="a mode that is unknown was let pass")
        if not mode.enabled_arms:
            return Refusal(
                code=Code.NO_ARM_ENABLED, message="no arm is enabled in the robot's system configuration (manual §2.3)"
            )
        refusal = self._fsm_refusal(now_ns)
        if refusal is not None:
            return refusal
        self._coordinator.choose_spaces(mode.enabled_arms, now_ns)
        for side in mode.enabled_arms:
            if not self._coordinator.part_fresh(side, now_ns):
                return Refusal(
                    code=Code.PART_STALE,
                    message=f"the state of the {side} arm is older than 100 ms",
                    field=f"{side}_arm",
                )
            refusal = self._phases.starting.why_not(side)
            if refusal is not None:
                return refusal
        return mode.enabled_arms

    def _fsm_refusal(self, now_ns: int) -> Refusal | None:
        value = self._coordinator.store.fsm(now_ns)
        if value is None:
            return Refusal(code=Code.FSM_UNKNOWN, message="/fsm_state has not been heard for 0.5 s (manual §4.11.1)")
        if value == FsmState.ERROR:
            return Refusal(
                code=Code.FSM_ERROR, message="the robot's FSM is ERROR (-1): control or motor fault (manual §4.11.1)"
            )
        if self._coordinator.body.heartbeat.is_ending:
            return Refusal(
                code=Code.FSM_BUSY, message="0.0 is still being sent: the robot has not reported PAUSE since"
            )
        if value != FsmState.PAUSE:
            return Refusal(
                code=Code.FSM_BUSY,
                message=f"the robot's FSM is {value}, PAUSE (0) is needed to begin (manual §4.11.1)",
                field="fsm_state",
                value=str(value),
                bound="0",
            )
        return None

    def _disable(self, command: CommandRequested, request: Disable, now_ns: int) -> Answer:
        refusal = self._authorisation.owner(command, request.epoch)
        if refusal is not None:
            return refusal
        self._coordinator.fire(Trigger.DISABLE, now_ns, "the owner disables")
        return {}

    def take_target(self, target: TargetArrived, now_ns: int) -> None:
        """Follow a streamed target if it may be followed; its stream says why not."""
        self._moves.take_target(target, now_ns)

    def move_on(self, now_ns: int) -> None:
        """Go on with requests that take more than one tick."""
        self._cartesian.step(now_ns)
        self._moves.touches.look(now_ns)
        self._admitting.step(now_ns)

    # ------------------------------------------------------------------------------------------------ stop, recover

    def _stop(self, command: CommandRequested, request: Stop, now_ns: int) -> Answer:
        owner = self._coordinator.lease.owner
        is_owner = owner is not None and owner.client_id == command.client_id
        who = "the owner" if is_owner else self._authorisation.name_of(command)
        message = f"stop() by {who}" + (f": {request.reason}" if request.reason else "")
        self._authorisation.note_stop(command.received_ns, command.client_id, latches=not is_owner)
        self._coordinator.fire(Trigger.OWNER_STOP if is_owner else Trigger.OTHER_STOP, now_ns, message)
        return self._delivery(now_ns)

    def _estop(self, command: CommandRequested, request: Estop, now_ns: int) -> Answer:
        message = f"estop() by {self._authorisation.name_of(command)}" + (
            f": {request.reason}" if request.reason else ""
        )
        self._authorisation.note_stop(command.received_ns, command.client_id)
        self._coordinator.fire(Trigger.ESTOP, now_ns, message)
        return self._delivery(now_ns)

    def _delivery(self, now_ns: int) -> Facts:
        if self._coordinator.transport_up:
            return {"stop_undelivered": False}
        self._coordinator.notice(
            Code.STOP_UNDELIVERED,
            Level.ERROR,
            "there is no transport to the robot: the stop cannot be delivered; use the physical emergency stop",
            now_ns,
        )
        return {"stop_undelivered": True}

    def _recover(self, command: CommandRequested, request: Recover, now_ns: int) -> Answer:
        coordinator = self._coordinator
        latches = dict(coordinator.supervisor.latches)
        if coordinator.state in {State.OFFLINE, State.STALE}:
            code = Code.NO_LINK if coordinator.state is State.OFFLINE else Code.STATE_STALE
            return Refusal(code=code, message=f"recover() needs to see the robot: {REFUSAL_TEXT[code]}")
        refusal = (
            self._authorisation.recovery(command)
            or self._authorisation.after_stop(command)
            or self._persisting(latches, now_ns)
            or self.watch.may_recover(request)
        )
        if refusal is not None:
            return refusal
        coordinator.supervisor.clear()
        coordinator.is_estop_unheard = False
        who = self._authorisation.name_of(command)
        if latches:
            coordinator.notice(
                Code.LATCH_CHANGED, Level.INFO, f"recover() by {who} cleared {', '.join(latches)}", now_ns
            )
        dismissed = self.watch.dismiss(who, request, now_ns)
        if coordinator.state is State.HOLDING and self.watch.refusal() is None:
            refusal = self._phases.starting.walk(now_ns)
            if refusal is not None:
                coordinator.notice(refusal.code, Level.WARNING, refusal.message, now_ns)
        return {"cleared": [code.value for code in latches], **({"dismissed": dismissed} if dismissed else {})}

    def _persisting(self, latches: Mapping[Code, str], now_ns: int) -> Refusal | None:
        """Refuse while the cause of a latch is still there. An FSM that fell silent in ERROR counts as still there."""
        store = self._coordinator.store
        if Code.FSM_ERROR in latches and store.fsm_raw == FsmState.ERROR:
            return Refusal(
                code=Code.LATCH_PERSISTS, message="the robot's FSM is still ERROR (-1)", field=Code.FSM_ERROR.value
            )
        objection = self._coordinator.others.objection(now_ns)
        if Code.FOREIGN_WRITER in latches and objection is not None and objection.code is Code.FOREIGN_WRITER:
            return Refusal(code=Code.LATCH_PERSISTS, message=objection.message, field=Code.FOREIGN_WRITER.value)
        wrong = store.name_order_wrong(now_ns)
        if Code.JOINT_ORDER in latches and wrong is not None:
            return Refusal(code=Code.LATCH_PERSISTS, message=wrong, field=Code.JOINT_ORDER.value)
        if self._phases.is_broken:
            message = "this gateway is still the one that is broken: it ends now"
            return Refusal(code=Code.LATCH_PERSISTS, message=message, field=Code.GATEWAY_BROKEN.value)
        return None
