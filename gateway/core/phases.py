"""What takes time: enabling, stopping, the way back from a stall, the walk, what is owed, and the end.

The supervisor's table says where an event leads; this says when the next step of such a course is due. Looked at once a
tick, after the conditions.
"""

from __future__ import annotations

from gateway.core.conditions import Conditions
from gateway.core.conductor import Conductor
from gateway.core.door import check_start
from gateway.core.events import Level
from gateway.core.motion import PlanFailed, plan
from gateway.core.streams.heartbeat import Beat
from gateway.core.supervisor import STREAMING, State, Trigger
from gateway.errors import Code, Refusal
from gateway.values import FsmState, Side

__all__ = ["WALK_SPEED", "Phases"]

MS = 1_000_000
S = 1_000_000_000

BEAT_DELAY_NS = 30 * MS
"""The first 1.0 leaves this long after the first echo [ns]: the heartbeat has a faster lane and must not overtake it."""

API_FSM = frozenset({FsmState.PAUSE, FsmState.SLOW_START, FsmState.READY})
"""FSM values that an API program meets while nothing is wrong."""

WALK_SPEED = 0.3
"""Factor on the velocity limit while a held reference is led back to its arm."""

EXIT_NS = 4500 * MS
"""The daemon ends at the latest this long after it was asked to [ns] (BEHAVIOUR: < 5 s)."""

EXIT_SETTLE_NS = 50 * MS
"""Frames handed over for sending get this long to leave the process [ns]."""


class Phases:
    """Courses of the supervisor that take more than one tick.

    Args:
        conductor: What is moved.
        conditions: What is told that an enabling begins.
    """

    def __init__(self, conductor: Conductor, conditions: Conditions) -> None:
        self._conductor = conductor
        self._conditions = conditions
        self.attempt = 0
        """Number of the latest enabling."""
        self._started_ns = 0
        self._echo_ns: int | None = None
        self._enabling: tuple[Side, ...] = ()
        self._stale_ns = 0
        self._is_zero_due = False
        self._lost_ns = 0
        self._exit_ns: int | None = None
        self._done_ns: int | None = None

    # ------------------------------------------------------------------------------------------------ enabling

    def begin_enabling(self, sides: tuple[Side, ...], now_ns: int) -> None:
        """ENABLING was entered: seed these arms as soon as their state can be trusted."""
        self.attempt += 1
        self._started_ns, self._echo_ns, self._enabling = now_ns, None, sides
        self._conductor.enable_outcome = "running"
        self._conductor.enable_code, self._conductor.enable_message = None, ""
        self._conditions.enabling_begins()
        if self._conductor.supervisor.came_from is State.PAUSED:
            self._seed(now_ns)  # the streams are live and the robot does not follow: no gap, no waiting

    def _seed(self, now_ns: int) -> None:
        conductor = self._conductor
        starts = {}
        for side in self._enabling:
            measured = conductor.store.arm(side)
            if measured is None:
                return
            start = check_start(side, measured.q_rad, conductor.settings.arm)
            if isinstance(start, Refusal):
                conductor.fail_enable(start, now_ns)
                return
            starts[side] = start
        for side, start in starts.items():
            conductor.body.arms[side].start(start.q_rad, now_ns)
            for n in start.clipped:
                conductor.notice(
                    Code.START_AT_LIMIT,
                    Level.WARNING,
                    f"{side} arm joint {n + 1} was found just outside its limit and starts at {start.q_rad[n]:.3f} rad",
                    now_ns,
                )
        for side, arm in conductor.body.arms.items():
            if side not in starts and arm.running:
                arm.stop()
        self._echo_ns = now_ns

    def _enabling_step(self, now_ns: int) -> None:
        conductor = self._conductor
        if now_ns - self._started_ns > conductor.settings.enable.timeout_ns:
            missing = self._missing(now_ns)
            conductor.fail_enable(
                Refusal(
                    code=Code.ENABLE_TIMEOUT,
                    message=f"the robot was not READY within {conductor.settings.enable.timeout_ns / S:.0f} s: {missing}",
                ),
                now_ns,
            )
            return
        value = conductor.store.fsm(now_ns)
        if self._conditions.first_beat_ns is None and value not in {None, FsmState.PAUSE}:
            conductor.fail_enable(
                Refusal(
                    code=Code.FSM_BUSY,
                    message=f"the FSM went to {value} before our first heartbeat: somebody else enables",
                ),
                now_ns,
            )
        elif self._echo_ns is None:
            if all(conductor.store.seedable(side, now_ns) for side in self._enabling):
                self._seed(now_ns)
        elif now_ns - self._echo_ns >= BEAT_DELAY_NS:
            conductor.body.heartbeat.ones(now_ns)
            if self._conditions.first_beat_ns is None:
                self._conditions.first_beat_ns = now_ns

    def _missing(self, now_ns: int) -> str:
        store = self._conductor.store
        waiting = [str(side) for side in self._enabling if not store.seedable(side, now_ns)]
        if self._echo_ns is None:
            return f"no 0.3 s of steady, timely state from the {' and '.join(waiting)} arm"
        value = store.fsm(now_ns)
        names = {state.value: state.name for state in FsmState}
        name = "unknown" if value is None else names.get(value, str(value))
        return f"heartbeat and echoes were sent, the FSM stayed {name}"

    # ------------------------------------------------------------------------------------------------ stale

    def _stale_step(self, now_ns: int) -> None:
        conductor = self._conductor
        gone_ns = now_ns - conductor.supervisor.since_ns
        self._watch_while_stale(now_ns)
        if conductor.stale_hold and gone_ns > conductor.settings.enable.hold_stale_ns:
            conductor.stale_hold = False
            conductor.body.silence_arms()
        if not conductor.store.is_fresh(now_ns):
            if conductor.resuming:  # stale again while resuming: no second try
                conductor.give_up_resuming()
        elif conductor.resuming:
            self._resume_step(now_ns)
        elif conductor.can_resume and gone_ns < conductor.settings.enable.hold_stale_ns:
            self._try_resume(now_ns)
        else:
            self._come_back(now_ns)

    def _watch_while_stale(self, now_ns: int) -> None:
        """The slow topics may still speak: what they say can end the hold and the way back."""
        conductor = self._conductor
        mode, value = conductor.store.mode(now_ns), conductor.store.fsm(now_ns)
        if value == FsmState.ERROR and conductor.body.heartbeat.is_owed:
            conductor.latch(Code.FSM_ERROR, "the robot's FSM went to ERROR (-1) after our heartbeat", now_ns)
        is_vr = mode is not None and not mode.api
        if is_vr or (value is not None and value not in API_FSM):
            conductor.give_up_resuming()

    def _try_resume(self, now_ns: int) -> None:
        conductor = self._conductor
        store = conductor.store
        if (store.fsm_received_ns or 0) <= conductor.supervisor.since_ns:
            return  # no new FSM sample yet (20 Hz); when none comes the stall is no longer short
        if store.fsm(now_ns) == FsmState.READY and store.mode(now_ns) is not None and not conductor.is_exiting:
            conductor.resuming = True
            conductor.body.heartbeat.ones(now_ns)
        else:
            self._come_back(now_ns)

    def _resume_step(self, now_ns: int) -> None:
        conductor = self._conductor
        mode = conductor.store.mode(now_ns)
        if conductor.store.fsm(now_ns) != FsmState.READY or mode is None:
            self._come_back(now_ns)
            return
        sides = tuple(side for side in self._enabling if mode.arm_enabled[side] and mode.joint_mode[side])
        if not sides:
            self._come_back(now_ns)
            return
        if not all(conductor.store.seedable(side, now_ns) for side in sides):
            return
        if not conductor.body.running_arms and not self._reseed(sides, now_ns):
            self._come_back(now_ns)
            return
        conductor.go(State.HOLDING, now_ns, "a short stall is over; the owner resumes explicitly")

    def _reseed(self, sides: tuple[Side, ...], now_ns: int) -> bool:
        """Start silent streams again where the arms are; return whether that was possible."""
        self._enabling = sides
        self._seed(now_ns)
        return bool(self._conductor.body.running_arms)

    def _come_back(self, now_ns: int) -> None:
        self._conductor.give_up_resuming()
        self._conductor.fire(Trigger.FRESH, now_ns, "the robot's state is fresh again")

    # ------------------------------------------------------------------------------------------------ owed zeros

    def _owed_step(self, now_ns: int) -> None:
        """Pay after a loss or a VR spell what is owed: only when FSM is 1-2 and a *new* mode sample says API."""
        conductor = self._conductor
        heartbeat, store, state = conductor.body.heartbeat, conductor.store, conductor.state
        mode, value = store.mode(now_ns), store.fsm(now_ns)
        is_vr = mode is not None and not mode.api
        is_theirs = is_vr or (value is not None and value not in API_FSM)
        if is_theirs and heartbeat.is_ending and not heartbeat.is_estop:
            heartbeat.silence()  # the FSM is driven by VR or playback now: a 0.0 would pause its operator
        if is_vr or state in {State.OFFLINE, State.STALE}:
            self._is_zero_due, self._lost_ns = True, now_ns
            return
        if not self._is_zero_due:
            return
        is_estop = Code.ESTOP in conductor.supervisor.latches
        if state in STREAMING or not (heartbeat.is_owed or is_estop):
            self._is_zero_due = False
            return
        if (store.mode_received_ns or 0) <= self._lost_ns or (store.fsm_received_ns or 0) <= self._lost_ns:
            return  # not heard since: it might be somebody else's by now
        if mode is not None and value is not None:
            self._is_zero_due = False
            if value in {FsmState.SLOW_START, FsmState.READY}:
                heartbeat.zeros(now_ns, is_estop=is_estop)

    # ------------------------------------------------------------------------------------------------ walk

    def walk(self, now_ns: int) -> bool:
        """Lead references that are off by more than the tracking bound back to their arms; return whether one walks."""
        conductor = self._conductor
        bound = conductor.settings.arm.tracking_rad
        goals = {}
        for side, arm in conductor.body.arms.items():
            measured = conductor.store.arm(side)
            if arm.running and measured is not None and arm.distance_rad(measured.q_rad) > bound:
                start = check_start(side, measured.q_rad, conductor.settings.arm)
                if not isinstance(start, Refusal):
                    goals[side] = start.q_rad
        if not goals:
            return False
        try:
            paths = plan({side: conductor.body.arms[side].reference for side in goals}, goals, WALK_SPEED)
        except PlanFailed as failed:
            conductor.notice(
                Code.PLAN_FAILED, Level.ERROR, f"the walk back to the arm cannot be planned: {failed}", now_ns
            )
            return False
        for side, path in paths.items():
            conductor.body.arms[side].walk(path)
        conductor.notice(
            Code.WALK,
            Level.WARNING,
            f"the held reference walks back to the measured {' and '.join(map(str, goals))} arm; the grip is kept",
            now_ns,
        )
        return True

    # ------------------------------------------------------------------------------------------------ one tick

    def step(self, now_ns: int) -> None:
        """Take the steps that are due.

        Args:
            now_ns: Monotonic time [ns].
        """
        conductor = self._conductor
        if conductor.state is State.ENABLING:
            self._enabling_step(now_ns)
        elif conductor.state is State.STOPPING:
            self._stopping_step(now_ns)
        elif conductor.state is State.STALE:
            self._stale_step(now_ns)
        if conductor.state in {State.OFFLINE, State.READ_ONLY, State.IDLE}:
            conductor.go(conductor.base(now_ns), now_ns, "the robot's condition")
        self._owed_step(now_ns)
        self._notice_unheard_stop(now_ns)

    def _stopping_step(self, now_ns: int) -> None:
        conductor = self._conductor
        heartbeat = conductor.body.heartbeat
        if not conductor.body.is_at_rest:
            return
        if heartbeat.gave_up_at_ns is not None and heartbeat.gave_up_at_ns >= conductor.supervisor.since_ns:
            conductor.go(conductor.base(now_ns), now_ns, "FSM 0 was not seen in time")
        elif not heartbeat.is_ending:
            conductor.fire(Trigger.AT_REST, now_ns, "the arms are at rest")

    def _notice_unheard_stop(self, now_ns: int) -> None:
        if self._conductor.body.heartbeat.gave_up_at_ns == now_ns:
            self._conductor.notice(
                Code.STOP_NOT_EFFECTIVE,
                Level.ERROR,
                "0.0 was sent for 2 s and the robot did not report PAUSE: use the physical emergency stop",
                now_ns,
            )

    # ------------------------------------------------------------------------------------------------ the end

    def request_exit(self, now_ns: int) -> None:
        """Begin to end: brake, 0.0, then done."""
        if self._exit_ns is None:
            self._exit_ns = now_ns
            self._conductor.is_exiting = True
            self._conductor.fire(Trigger.EXIT, now_ns, "the daemon was asked to end")

    def is_done(self, now_ns: int) -> bool:
        """Return whether everything that must be sent before the end has been sent."""
        if self._exit_ns is None:
            return False
        body = self._conductor.body
        if self._conductor.state in STREAMING or body.heartbeat.beat is Beat.ZERO or body.chassis.running:
            self._done_ns = None
        elif self._done_ns is None:
            self._done_ns = now_ns
        is_settled = self._done_ns is not None and now_ns - self._done_ns >= EXIT_SETTLE_NS
        return is_settled or now_ns - self._exit_ns > EXIT_NS
