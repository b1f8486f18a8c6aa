"""Going on in another process's place: what is shown to it, whether it may hold, and how it begins.

Two processes may go on: the guard when its daemon is dead, and a restarted daemon from a guard that holds.

Rules (BEHAVIOUR, the guard)
    * A hold goes on only from ACTIVE, HOLDING or braking, with fresh state, FSM READY, API mode, the last setpoint at
      most 150 ms old, no e-stop latched and nobody else's writing: the robot's own watchdogs have not acted yet (manual §4.3).
    * It goes on exactly where the last setpoint was, with its velocity and acceleration, and brakes; chassis and lift
      stop. Nothing of what moved before moves on: motions and targets died with whoever had them.
    * Where a hold may not go on, whatever is on the wire ends: 0.0 if it is owed, chassis zeros, lift stop. A 0.0 never
      in VR mode or beside FSM 3-6: somebody else's robot would pause.
    * Nothing ends twice: when the other's last tick is older than the robot's own watchdog (1 s of FSM and chassis, 3 s of
      the lift; manual §4.5 to 4.7), the robot has ended it, and what is on the wire now is somebody else's. A guard or a
      daemon that was itself stopped meanwhile must not pause a robot that another one commands. An e-stop's 0.0 leaves
      however late it is.
    * What was latched stays latched: a stop of the last instant may not have reached the disk.
    * A guard does not wait out a stall: stale state ends its hold with 0.0.

It knows neither shared memory nor processes. When a takeover is due is known to `guardian.py` and to the daemon.
"""

from __future__ import annotations

from collections.abc import Callable

from gateway.core.messages.events import GuardSeen, HeldElsewhere, TakenOver
from gateway.core.messages.held import Held, HeldArm
from gateway.core.messages.outputs import Level
from gateway.core.motion.motion import PlanFailed
from gateway.core.streams.heartbeat import Beat
from gateway.core.supervision.coordinator import AT_BASE, QUIET, Coordinator
from gateway.core.supervision.supervisor import State, Trigger
from gateway.errors import Code
from gateway.robot.limits import CHASSIS_WATCHDOG_NS, FSM_WATCHDOG_NS, GRIPPER_RELAXED, LIFT_WATCHDOG_NS
from gateway.values import OWN_FSM, FsmState, Vector

__all__ = ["LAST_FRAME_NS", "LATCHED_BEFORE", "Takeover"]

MS = 1_000_000
S = 1_000_000_000

LAST_FRAME_NS = 150 * MS
"""A setpoint older than this is no reference any more [ns]: the robot's zero-velocity protection has acted (§4.3)."""

LATCHED_BEFORE = "latched by the process that commanded the robot before; its log says why"

HOLDABLE = {State.ACTIVE.value: State.HOLDING, State.HOLDING.value: State.HOLDING, State.STOPPING.value: State.STOPPING}
"""From which states a hold goes on, and as what."""

Resume = Callable[[str, Vector, Vector], None]
"""Tells the gate with which frame a topic goes on: topic, values, step from the one before."""


class Takeover:
    """How this process goes on in another's place.

    A guard never waits out a stall.
    """

    def __init__(self, coordinator: Coordinator, resume: Resume, *, is_guard: bool) -> None:
        self._coordinator = coordinator
        self._resume = resume
        self._is_guard = is_guard
        self.refused = ""
        """Why the latest takeover did not become a hold; empty when it did."""

    # ------------------------------------------------------------------------------------------------ what is shown

    def show(self, now_ns: int) -> Held:
        """Return what is on the wire."""
        coordinator, body = self._coordinator, self._coordinator.body
        arms = {}
        newest_ns = 0
        for side, arm in body.arms.items():
            if arm.running and (last_ns := arm.log.last_ns) is not None:
                arms[side] = HeldArm(
                    topic=arm.topic, values=arm.values, rate=arm.rates, acceleration=arm.reference.forces
                )
                newest_ns = max(newest_ns, last_ns)
        return Held(
            at_ns=now_ns,
            state=coordinator.state.value,
            epoch=coordinator.lease.epoch,
            beat=body.heartbeat.beat.value,
            is_owed=body.heartbeat.is_owed,
            is_estop=coordinator.is_estop_unheard,
            last_frame_ns=newest_ns,
            arms=arms,
            grippers={side: gripper.raw for side, gripper in body.grippers.items() if gripper.running},
            has_chassis=body.chassis.is_on_wire,
            has_lift=body.lift is not None and body.lift.is_on_wire,
            latches=tuple(code.value for code in coordinator.supervisor.latches),
        )

    # ------------------------------------------------------------------------------------------------ going on

    def hear(self, event: TakenOver | HeldElsewhere | GuardSeen, now_ns: int) -> None:
        """Take an event that is about guards."""
        coordinator = self._coordinator
        if isinstance(event, TakenOver):
            self._take(event.held, now_ns)
        elif isinstance(event, HeldElsewhere):
            coordinator.guard.earlier_holds = event.is_held
        else:
            coordinator.others.befriend(event.zid)
            lost = coordinator.guard.see(event)
            if lost:
                coordinator.notice(Code.GUARD_LOST, Level.WARNING, lost, now_ns, pid=str(event.pid))

    def objection(self, now_ns: int) -> str:
        """Return why this process could not hold the robot now, whatever is on the wire; empty when it could."""
        coordinator, store = self._coordinator, self._coordinator.store
        mode, value = store.mode(now_ns), store.fsm(now_ns)
        if coordinator.state not in AT_BASE:
            return f"this process is in {coordinator.state}"
        if not coordinator.transport_up:
            return "there is no transport to the robot's router"
        if not store.is_fresh(now_ns):
            return "the robot's state is older than 100 ms"
        if mode is None or not mode.api:
            return "/api/current_mode is unknown" if mode is None else "the robot is in VR mode"
        if value != FsmState.READY:
            return f"the robot's FSM is {value}, not READY"
        other = coordinator.others.objection(now_ns)
        return other.message if other is not None and other.code is Code.FOREIGN_WRITER else ""

    def is_guard_awaited(self, waited_ns: int) -> bool:
        """Return whether this process has a guard of its own that does not reach the robot yet, and is worth waiting for."""
        return self._coordinator.guard.is_awaited(waited_ns)

    def _take(self, held: Held, now_ns: int) -> None:
        """Go on with what another process had on the wire: hold where that may be, else end it."""
        self._coordinator.others.befriend_predecessor()
        for name in held.latches:
            if name in Code.__members__:
                self.latch(Code(name), LATCHED_BEFORE, now_ns)
        self.refused = self._objection_to(held, now_ns) or self.objection(now_ns) or self._hold(held, now_ns)
        if self.refused:
            self._end(held, now_ns)
            is_over = now_ns - held.at_ns >= FSM_WATCHDOG_NS
            how = "the robot's own watchdogs have ended it" if is_over else "what was on the wire ends"
            message = f"nothing is held: {self.refused}; {how}"
        else:
            message = f"held in the place of a process that was in {held.state}"
        self._coordinator.notice(
            Code.TAKEN_OVER, Level.WARNING, message, now_ns, state=held.state, held=str(not self.refused).lower()
        )

    def latch(self, code: Code, message: str, now_ns: int) -> None:
        """Take a latch over that another process has set, and tell of it. An e-stop is sent again as after a restart."""
        if code is Code.ESTOP and code not in self._coordinator.supervisor.latches:
            self._coordinator.is_estop_unheard = True
        self._coordinator.supervisor.stopper = ""  # the other process knows who it was, this one does not
        self._coordinator.latch(code, message, now_ns)

    def _objection_to(self, held: Held, now_ns: int) -> str:
        if held.state not in HOLDABLE:
            return f"it was in {held.state}"
        if held.beat != Beat.ONE.value or not held.arms:
            return "no setpoints with a heartbeat were out"
        if now_ns - held.last_frame_ns >= LAST_FRAME_NS:
            return f"its last setpoint is {(now_ns - held.last_frame_ns) / MS:.0f} ms old, 150 ms is the bound"
        # It may have come since the hold was asked for: 1.0 would restart the robot.
        return "an e-stop is latched" if Code.ESTOP in self._coordinator.supervisor.latches else ""

    def _hold(self, held: Held, now_ns: int) -> str:
        """Begin to hold, or return why it cannot be."""
        coordinator, body = self._coordinator, self._coordinator.body
        able = coordinator.able_arms(now_ns) or ()
        coordinator.choose_spaces(able, now_ns)
        arms = {side: arm for side, arm in held.arms.items() if side in able and arm.topic == body.arms[side].topic}
        if not arms:
            return "none of its arms takes setpoints any more"
        try:
            for side, arm in arms.items():
                body.arms[side].enter(arm.values, arm.rate, arm.acceleration, now_ns)
        except PlanFailed as failed:
            body.silence_arms()
            return f"it cannot brake inside the limits: {failed}"
        for side, arm in arms.items():
            period_s = body.arms[side].period_s
            step = tuple(period_s * (v - 0.5 * period_s * a) for v, a in zip(arm.rate, arm.acceleration, strict=True))
            self._resume(arm.topic, arm.values, step)
            raw = held.grippers.get(side, GRIPPER_RELAXED)
            body.grippers[side].enter(raw, now_ns)
            self._resume(body.grippers[side].topic, (raw,), (0.0,))
        body.heartbeat.ones(now_ns)
        body.heartbeat.is_owed = True  # the other's 1.0 is out
        self._stop_ground(held, now_ns)
        if held.has_lift and body.lift is not None:
            body.lift.keep(now_ns)
        coordinator.enable.begin(tuple(arms))
        coordinator.enable.outcome = "ok"
        coordinator.go(HOLDABLE[held.state], now_ns, "in the place of a process that ended")
        coordinator.lease.hold_unowned(now_ns)
        return ""

    def _end(self, held: Held, now_ns: int) -> None:
        """End what is on the wire."""
        coordinator = self._coordinator
        heartbeat, store = coordinator.body.heartbeat, coordinator.store
        self._stop_ground(held, now_ns)
        coordinator.body.lift_off(now_ns)
        if now_ns - held.at_ns < FSM_WATCHDOG_NS:
            heartbeat.is_owed = heartbeat.is_owed or held.is_owed or held.beat == Beat.ONE.value
        coordinator.is_estop_unheard = coordinator.is_estop_unheard or held.is_estop
        mode, value = store.mode(now_ns), store.fsm(now_ns)
        is_theirs = (mode is not None and not mode.api) or (value is not None and value not in OWN_FSM)
        if held.is_estop or (heartbeat.is_owed and not is_theirs):
            heartbeat.zeros(now_ns, is_estop=held.is_estop)

    def _stop_ground(self, held: Held, now_ns: int) -> None:
        body, age_ns = self._coordinator.body, now_ns - held.at_ns
        if held.has_chassis and age_ns < CHASSIS_WATCHDOG_NS:
            body.chassis.stop(now_ns)
        if held.has_lift and body.lift is not None and age_ns < LIFT_WATCHDOG_NS:
            body.lift.stop(now_ns)

    # ------------------------------------------------------------------------------------------------ a guard's hold

    def left_ns(self, now_ns: int) -> int:
        """Return how long what is held without an owner will be [ns]; 0 when nothing is."""
        return self._coordinator.lease.view(now_ns).down_in_ns or 0

    def step(self, now_ns: int) -> None:
        """End a guard's hold when the robot is not heard. Called before the tick's own look at the robot."""
        coordinator = self._coordinator
        if not self._is_guard or coordinator.state in AT_BASE or coordinator.state in QUIET:
            return
        if not (coordinator.transport_up and coordinator.store.is_fresh(now_ns)):
            self.give_up("the robot's state is older than 100 ms: the guard's hold ends", now_ns)

    def give_up(self, why: str, now_ns: int) -> None:
        """Let a hold go down: 0.0, and the lift off."""
        self._coordinator.fire(Trigger.HOLD_OVER, now_ns, why)
