"""Fires the supervisor's triggers and carries out what its table says, on the body, the latches and the lease.

Everything that moves the supervisor goes through `fire`; nothing else changes its state. What is to be told is collected.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING

from gateway.core.body.body import Body
from gateway.core.body.motions import Motion, MotionState
from gateway.core.messages.events import SettingsRead
from gateway.core.messages.outputs import Level, Notice, Remembered
from gateway.core.others.claim import Claim
from gateway.core.others.guarding import Guarding
from gateway.core.others.others import Others
from gateway.core.robot_state.store import Store
from gateway.core.streams.heartbeat import Beat
from gateway.core.supervision.endpoints import Endpoints
from gateway.core.supervision.lease import Lease
from gateway.core.supervision.supervisor import (
    ARMED,
    BASE,
    END_CODE,
    LATCH_CODE,
    STREAMING,
    Action,
    Cell,
    State,
    Supervisor,
    Trigger,
)
from gateway.errors import Code, Refusal
from gateway.robot.topics import CURRENT_MODE
from gateway.settings.settings import Settings
from gateway.values import CurrentMode, Side, Space, Vector

if TYPE_CHECKING:  # it takes numpy along, which a guard has no use for
    from gateway.core.robot_state.body_model import BodyModel
    from gateway.core.robot_state.contact import Contacts

__all__ = ["AT_BASE", "QUIET", "Coordinator", "EnableRecord"]

QUIET = frozenset({State.OFFLINE, State.STALE})
"""States in which the robot is not heard."""

AT_BASE = frozenset({State.OFFLINE, State.READ_ONLY, State.IDLE})
"""States in which nothing is held."""

LOSES_AN_ARM = frozenset({Trigger.ARM_DISABLED, Trigger.PART_DEAD})

AS_ASKED = frozenset({MotionState.REACHED, MotionState.TOUCHED, MotionState.SUPERSEDED})
"""Ends of motions that are no news to whoever asked for them."""

LEVELS_THAT_STAY = frozenset({Trigger.FSM_READY, Trigger.FSM_SLOW_START})
"""Conditions that ask for 0.0 in PAUSED on every tick: a repetition that found no hearing is not begun anew by them."""


class EnableRecord:
    """How the latest `enable` went."""

    def __init__(self) -> None:
        self.attempt = 0
        """Number of the latest enabling; 0 before the first."""
        self.sides: tuple[Side, ...] = ()
        """Arms that it is about."""
        self.outcome = "none"
        """`none`, `running`, `ok` or `failed`."""
        self.code: Code | None = None
        """Why it failed; None else."""
        self.message = ""

    def begin(self, sides: tuple[Side, ...]) -> None:
        """Another one begins, for these arms."""
        self.attempt += 1
        self.sides, self.outcome, self.code, self.message = sides, "running", None, ""

    def blame(self, code: Code, message: str) -> None:
        """Note why it fails; the first reason counts."""
        if self.code is None:
            self.code, self.message = code, message


class Coordinator:
    """Supervisor, body, lease and store, moving together."""

    def __init__(self, settings: Settings, remembered: Remembered, model: BodyModel | None = None) -> None:
        self.settings = settings
        self.reading: SettingsRead | None = None
        """How the latest reading of the settings file went; None before the first one since the start."""
        self.model = model
        self.store = Store(settings.enable)
        self.lease = Lease(settings.loss, remembered.epoch)
        self.supervisor = Supervisor(remembered.latches)
        self.endpoints = Endpoints()
        self.body = Body(settings)
        self.others = Others(remembered.zids, settings.foreign.policy)
        self.claim = Claim()
        self.notices: list[Notice] = []
        self.transport_up = False
        """Whether a transport to the robot's router is open."""
        self.router_zid = ""
        self.routers = remembered.routers
        self.routes: dict[str, str] = {}
        """What discovery said last about the way of a topic."""
        self.other_robot: Refusal | None = None  # robots that are not one robot where we listen
        self.resuming = False
        """STALE only: 1.0 is sent again after a short stall, until the streams are seeded."""
        self.stale_hold = False
        """STALE only: constant hold frames go on."""
        self.can_resume = False
        """STALE only: the stall began in ACTIVE or HOLDING and nothing has ended the hold since."""
        self.quiet_ns = 0
        """When the robot was last not heard [ns]: OFFLINE or STALE, however short."""
        self.is_estop_unheard = Code.ESTOP in remembered.latches
        """Whether an e-stop is latched and the robot was not seen to pause since."""
        self.is_exiting = False
        self.guard = Guarding()
        self.enable = EnableRecord()
        self._mode: CurrentMode | None = None
        self._able: tuple[Side, ...] | None = None

    # ------------------------------------------------------------------------------------------------ saying

    def notice(self, code: Code, level: Level, message: str, now_ns: int, /, **facts: str) -> None:
        """Say something to people and logs."""
        self.notices.append(Notice(code=code, level=level, message=message, at_ns=now_ns, facts=facts))

    def report_ended(self, motions: list[Motion], now_ns: int) -> None:
        """Say how motions ended."""
        for motion in motions:
            level = Level.INFO if motion.state in AS_ASKED else Level.WARNING
            text = f"motion {motion.motion_id} {motion.state.value}"
            self.notice(
                Code.MOTION_ENDED,
                level,
                f"{text}: {motion.message}" if motion.message else text,
                now_ns,
                motion_id=str(motion.motion_id),
                state=motion.state.value,
                code=motion.code.value if motion.code else "",
            )

    # ------------------------------------------------------------------------------------------------ where we are

    def base(self, now_ns: int) -> State:
        """Return where the gateway rests: OFFLINE, STALE, READ_ONLY or IDLE."""
        if not self.transport_up or self.store.link_age_ns(now_ns) is None:
            return State.OFFLINE
        if not self.store.is_fresh(now_ns):
            return State.STALE
        mode = self.store.mode(now_ns)
        in_vr = mode is not None and not mode.api
        return State.READ_ONLY if in_vr or self.lease.owner is None else State.IDLE

    @property
    def state(self) -> State:
        """The supervisor's state."""
        return self.supervisor.state

    @property
    def sides(self) -> tuple[Side, ...]:
        """Arms that are streamed, or about to be."""
        if self.state is State.ENABLING:
            return self.enable.sides
        return tuple([side for side, arm in self.body.arms.items() if arm.running])

    def forget_state(self) -> None:
        """Forget what was heard of the robot: the transport was lost, the robot restarted, or this host slept."""
        self.store.reset()
        if self.model is not None:
            self.model.forget()

    @property
    def contacts(self) -> Contacts | Refusal:
        """What pulls at the arms, or why nobody works that out."""
        if self.model is not None and self.model.contacts is not None:
            return self.model.contacts
        message = "nobody feels what pushes the arms: section [model] of the configuration does not ask for dynamics"
        hint = "set `dynamics = true` there, and start the gateway anew"
        return Refusal(code=Code.MODEL_OFF, message=message, field="model.dynamics", value="false", hint=hint)

    def model_refusal(self, side: Side, now_ns: int) -> Refusal | None:
        """Return why an arm may not be moved by the body model; None while that agrees with the robot."""
        if self.model is None:
            message = "there is no body model: section [model] of the configuration switches it off"
            return Refusal(code=Code.MODEL_OFF, message=message, field="model.check", value="false")
        return self.model.refusal(side, now_ns)

    def able_arms(self, now_ns: int) -> tuple[Side, ...] | None:
        """Return the arms that are enabled, so that they take setpoints of one space; None while the mode is unknown."""
        mode = self.store.mode(now_ns)
        if mode is not self._mode:  # it comes once a second, and is asked for on every tick
            self._mode = mode
            self._able = None if mode is None else mode.enabled_arms
        return self._able

    @property
    def is_posing(self) -> bool:
        """Whether an enabled arm is in end-effector mode, as the robot said last."""
        mode = self.store.value(CURRENT_MODE)
        return isinstance(mode, CurrentMode) and mode.is_posing

    def fit_arms(self, now_ns: int) -> tuple[Side, ...] | None:
        """Return the able arms that take setpoints in the space of their streams; None while the mode is unknown."""
        able = self.able_arms(now_ns)
        if able is None or self._mode is None:
            return None
        mode = self._mode
        return tuple([side for side in able if self.body.arms[side].space is mode.space(side)])

    def choose_spaces(self, sides: Iterable[Side], now_ns: int) -> None:
        """Choose the streams of these arms by the robot's mode, as far as it is known; a stream that runs is kept."""
        mode = self.store.mode(now_ns)
        for side in sides:
            if mode is not None and not self.body.arms[side].running:
                self.body.choose(side, mode.space(side))

    def part_fresh(self, side: Side, now_ns: int) -> bool:
        """Return whether what an arm's stream is judged by is fresh: its joints, in pose space its pose as well."""
        return self.store.part_fresh(side, now_ns, needs_pose=self.body.arms[side].space is Space.POSE)

    def seedable(self, side: Side, now_ns: int) -> bool:
        """Return whether an arm's stream may start from its measured state (`Store.seedable`)."""
        needs_pose = self.body.arms[side].space is Space.POSE
        return self.store.seedable(side, now_ns, needs_pose=needs_pose) and self.agreed(side, now_ns)

    def agreed(self, side: Side, now_ns: int) -> bool:
        """Return whether an arm's latest samples say the same, and its pose as far as the body model can tell."""
        store, needs_pose = self.store, self.body.arms[side].space is Space.POSE
        if not self.part_fresh(side, now_ns) or not store.agreed(side, needs_pose):
            return False
        arm, pose = store.arm(side), store.pose(side)
        if self.model is None or arm is None or pose is None or not store.part_fresh(side, now_ns, needs_pose=True):
            return True
        return not self.model.contradicts(side, arm.q_rad, pose, now_ns)

    def measured(self, side: Side) -> Vector | None:
        """Return where an arm was last measured, in the space of its stream; None before the first sample."""
        if self.body.arms[side].space is Space.POSE:
            pose = self.store.pose(side)
            return None if pose is None else pose.values
        arm = self.store.arm(side)
        return None if arm is None else arm.q_rad

    def lost_arms(self, now_ns: int) -> dict[Side, Code]:
        """Return which of `sides` cannot go on: ARM_DISABLED (or in another control mode), or PART_LOST (state dead)."""
        able = self.fit_arms(now_ns)
        lost: dict[Side, Code] = {}
        for side in self.sides:
            if able is not None and side not in able:
                lost[side] = Code.ARM_DISABLED
            elif not self.part_fresh(side, now_ns):
                lost[side] = Code.PART_LOST
        return lost

    # ------------------------------------------------------------------------------------------------ moving

    def fire(self, trigger: Trigger, now_ns: int, message: str = "") -> Cell:
        """Do what the table says for a trigger in the present state; return that cell: when it refuses, nothing was done."""
        cell = self.supervisor.cell(trigger)
        if cell.refuse is not None:
            return cell
        message = message or trigger.value
        lost = self.lost_arms(now_ns) if trigger in LOSES_AN_ARM else {}
        for action in cell.do:
            if action is Action.CUT and lost:
                self._end_shared_motions(lost, message, now_ns)
            self._do(action, trigger, message, now_ns)
        if cell.to == BASE:
            self.go(self.base(now_ns), now_ns, message)
            self.give_up_resuming()
        elif isinstance(cell.to, State):
            self.go(cell.to, now_ns, message)
        for side, code in lost.items():
            if code is Code.ARM_DISABLED:
                self._let_go(side)
        return cell

    def _end_shared_motions(self, lost: Mapping[Side, Code], message: str, now_ns: int) -> None:
        """A motion of two arms of which one is lost ends for both, with a code for each."""
        for motion in self.body.motions.running:
            if len(motion.goals) > 1:
                codes = {side: lost.get(side, Code.PART_LOST) for side in motion.goals}
                each = ", ".join(f"{side} arm {code}" for side, code in codes.items())
                code = next(code for side, code in codes.items() if side in lost)
                self.body.motions.end(motion, MotionState.ABORTED, code, f"{each}: {message}")
                self.report_ended([motion], now_ns)

    def _let_go(self, side: Side) -> None:
        """The robot takes no more setpoints for an arm: its stream is silent until the next `enable`."""
        self.enable.sides = tuple(other for other in self.enable.sides if other is not side)
        self.body.arms[side].stop()

    def go(self, to: State, now_ns: int, why: str) -> None:
        """Enter a state and bring the streams in line with it."""
        came_from = self.state
        if not self.supervisor.move(to, now_ns):
            return
        if came_from is State.ENABLING:
            self._close_enabling(to, why)
        body = self.body
        self.resuming, body.gives_way = False, to is State.HOLDING and came_from is State.ACTIVE
        self.can_resume = to is State.STALE and came_from in {State.ACTIVE, State.HOLDING}
        self.stale_hold = (
            to is State.STALE
            and came_from in {State.ACTIVE, State.HOLDING, State.PAUSED}
            and bool(body.running_arms)
            and body.is_at_rest
        )
        if to not in STREAMING and not self.stale_hold:
            body.silence_arms()
        if to in {State.ACTIVE, State.HOLDING, State.PAUSED}:
            for arm in body.running_arms:
                arm.go_live()
        if to not in ARMED and body.heartbeat.beat is Beat.ONE:
            body.heartbeat.silence()
        if to in QUIET:
            self.quiet_ns = now_ns
        if to in AT_BASE:
            self.lease.end_clocks()  # nothing is held any more, so nothing has to go down
        level = Level.WARNING if to in {State.PAUSED, State.STALE, State.OFFLINE} else Level.INFO
        self.notice(
            Code.STATE_CHANGED, level, f"{came_from} -> {to}: {why}", now_ns, came_from=came_from.value, to=to.value
        )

    def _close_enabling(self, to: State, why: str) -> None:
        self.enable.outcome = "ok" if to is State.ACTIVE else "failed"
        if to is not State.ACTIVE:
            self.enable.blame(Code.NOT_ENABLED, why)

    def give_up_resuming(self) -> None:
        """Something ended the hold for good: whatever is still sent because of a short stall falls silent."""
        self.can_resume = False
        if self.state is State.STALE:
            self.stale_hold = False
            self.body.silence_arms()
            self.stop_resuming()

    def stop_resuming(self) -> None:
        """The way back from a short stall is interrupted: no 1.0 any more."""
        if self.resuming:
            self.resuming = False
            self.body.heartbeat.silence()

    def _do(self, action: Action, trigger: Trigger, message: str, now_ns: int) -> None:
        body = self.body
        if action is Action.CUT:
            code = END_CODE.get(trigger, Code.STREAM_ENDED)
            if self.state is State.ENABLING:
                self.enable.blame(code, message)
            self.report_ended(body.cut(code, message), now_ns)
            body.ground_cut(code, now_ns)
        elif action is Action.ZERO:
            self._zero(trigger, now_ns)
        elif action is Action.ZERO_IF_OWED:
            if body.heartbeat.is_owed:
                self._zero(trigger, now_ns)
        elif action is Action.ZERO_ONCE:
            body.heartbeat.zero_once(now_ns)
        elif action is Action.SILENCE:
            body.heartbeat.silence()
        elif action is Action.LATCH:
            self.latch(LATCH_CODE[trigger], message, now_ns)
        elif action is Action.GROUND_CUT:
            body.ground_cut(END_CODE[trigger], now_ns)
        elif action is Action.GROUND_STOP:
            body.ground_stop(now_ns)
        elif action is Action.LIFT_OFF:
            body.lift_off(now_ns)
        else:
            self.lease.clear(now_ns)
            self.notice(Code.LEASE_CHANGED, Level.WARNING, f"the lease is free: {message}", now_ns)

    def _zero(self, trigger: Trigger, now_ns: int) -> None:
        """Begin to repeat 0.0. Without transport only an e-stop's: any other might arrive at somebody else's robot."""
        heartbeat = self.body.heartbeat
        if trigger is Trigger.ESTOP:
            self.is_estop_unheard = True
            heartbeat.zeros(now_ns, is_estop=True)
        elif self.transport_up and not (trigger in LEVELS_THAT_STAY and self._was_unheard):
            heartbeat.zeros(now_ns)

    @property
    def _was_unheard(self) -> bool:
        gave_up_ns = self.body.heartbeat.gave_up_at_ns
        return gave_up_ns is not None and gave_up_ns >= self.supervisor.since_ns

    def latch(self, code: Code, message: str, now_ns: int) -> None:
        """Add a cause to the latches."""
        if self.supervisor.latch(code, message):
            self.notice(Code.LATCH_CHANGED, Level.ERROR, f"latched {code}: {message}", now_ns, code=code.value)

    def remembered(self) -> Remembered:
        """Return what must survive a restart of the daemon."""
        latches = self.endpoints.beside(self.supervisor.latches)
        return Remembered(epoch=self.lease.epoch, latches=latches, zids=self.others.friends, routers=self.routers)
