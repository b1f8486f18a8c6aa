"""STALE, and what is owed after a loss: hold on for a while, resume after a short stall, else pay the 0.0.

Rules (BEHAVIOUR, stopping and losing)
    * References at rest are repeated for at most 0.8 s, and only until something speaks that would end HOLDING.
    * A stall is short when the state is fresh again within 0.8 s, the transport was never lost, and an FSM sample that
      came after it began, and after what had queued up in it, says READY. Then 1.0 goes out at once, still in STALE;
      once the arms can be seeded, HOLDING. If that 1.0 turns out to be wrong, 0.0 follows at once.
    * A hold that ended with its 0.8 s just before HOLDING goes on as it was, while the robot cannot have noticed: seeded
      anew the arms would jump under torque.
    * When a stall has outlived the time in which it may resume, 0.0 is sent for 0.3 s, to nobody or to a robot that pauses
      by itself at that time: a bridge hands what a dead node has not taken to the one that starts anew, and 1.0 would start
      the robot. Not where the last that was heard is VR mode or FSM 3-6, nor beside anybody else.
    * After any other loss a 0.0 that is owed leaves only when a mode and an FSM sample that came since say API and 1-2:
      the robot may be somebody else's by now. An e-stop that may not have been heard asks for FSM 1-2 only.

When STALE begins is the supervisor's table; what may leave in it is the gate's word.
"""

from __future__ import annotations

from gateway.core.supervision.coordinator import QUIET, Coordinator
from gateway.core.supervision.starting import Starting
from gateway.core.supervision.supervisor import STREAMING, State, Trigger
from gateway.errors import Code
from gateway.robot.limits import GRIPPER_WATCHDOG_NS
from gateway.values import OWN_FSM, FsmState, Side

__all__ = ["Stall"]

S = 1_000_000_000

RESUME_NS = 1 * S
"""Streams that cannot be seeded within this after the state came back [ns] are given up: an arm's own state is dead."""

STARTED = frozenset({FsmState.SLOW_START, FsmState.READY})


class Stall:
    """What happens while the robot is not heard, and afterwards."""

    def __init__(self, coordinator: Coordinator, starting: Starting) -> None:
        self._coordinator = coordinator
        self._starting = starting
        self._resumed_ns = 0
        self._silenced: tuple[Side, ...] = ()
        self._silenced_ns = 0
        """Whose hold has ended with its time, and when [ns]."""
        self._quiet_ns = coordinator.quiet_ns
        """When the robot was last not heard, as far as it was looked at [ns]."""
        self._lost_ns: int | None = None
        """When it was last not heard, or in VR mode [ns]; None once what is owed since then is settled."""
        self._estop_lost_ns = self._quiet_ns if coordinator.is_estop_unheard else None
        """When it was last not heard, with an e-stop that it may not know [ns]; None once that is settled."""

    def step(self, now_ns: int) -> None:
        """Take the steps that are due."""
        coordinator = self._coordinator
        if coordinator.state is State.STALE:
            self._while_stale(now_ns)
        if coordinator.state is not State.STALE and coordinator.body.heartbeat.is_last_word:
            coordinator.body.heartbeat.silence()  # a robot that is heard again says itself what is owed to it
        if coordinator.state in QUIET:
            coordinator.quiet_ns = now_ns
        if coordinator.quiet_ns != self._quiet_ns:
            self._quiet_ns = self._lost_ns = self._estop_lost_ns = coordinator.quiet_ns
        self._pay(now_ns)
        self._repeat_estop(now_ns)

    # ------------------------------------------------------------------------------------------------ STALE

    def _while_stale(self, now_ns: int) -> None:
        coordinator = self._coordinator
        gone_ns = now_ns - coordinator.supervisor.since_ns
        is_fresh, limit_ns = coordinator.store.is_fresh(now_ns), coordinator.settings.enable.hold_stale_ns
        if self._is_hold_over(now_ns):
            coordinator.give_up_resuming()
        if coordinator.stale_hold and gone_ns > limit_ns:
            coordinator.stale_hold = False
            self._silenced = tuple(side for side, arm in coordinator.body.arms.items() if arm.running)
            self._silenced_ns = now_ns
            coordinator.body.silence_arms()
        if gone_ns > limit_ns and coordinator.can_resume and not coordinator.resuming:
            coordinator.can_resume = False  # what was held is held no more: an unowned lift goes off
            mode = coordinator.store.mode(now_ns)
            if not is_fresh and mode is not None and mode.api and coordinator.body.heartbeat.is_owed:
                coordinator.body.heartbeat.last_word(now_ns)
        if coordinator.resuming:
            if is_fresh:
                self._resume(now_ns)
            else:
                coordinator.stop_resuming()
        elif is_fresh:
            if coordinator.can_resume and gone_ns < limit_ns:
                self._try_to_resume(now_ns)
            else:
                self._come_back(now_ns)

    def _is_hold_over(self, now_ns: int) -> bool:
        """Return whether a slow topic, which may still be heard, or somebody else says what would end HOLDING."""
        coordinator = self._coordinator
        if coordinator.others.armed or coordinator.others.arm_data_text(now_ns):
            return True  # who only announces commands ends no hold: the grip is kept until somebody sends
        mode, value = coordinator.store.mode(now_ns), coordinator.store.fsm(now_ns)
        if value == FsmState.ERROR and coordinator.body.heartbeat.is_owed:
            coordinator.latch(Code.FSM_ERROR, "the robot's FSM went to ERROR (-1) after our heartbeat", now_ns)
        is_foreign = value is not None and (value not in OWN_FSM or value == FsmState.ERROR)
        return is_foreign or (mode is not None and (not mode.api or not coordinator.fit_arms(now_ns)))

    def _try_to_resume(self, now_ns: int) -> None:
        coordinator = self._coordinator
        timely_ns = coordinator.store.timely_since_ns()
        if timely_ns is None:
            return  # what arrives has waited in the stall: the robot may have been stopped since it was sent
        if (coordinator.store.fsm_received_ns or 0) <= max(timely_ns, coordinator.supervisor.since_ns):
            return  # no new FSM sample yet (20 Hz); when none comes the stall is no longer short
        if coordinator.store.fsm(now_ns) == FsmState.READY:
            coordinator.resuming, self._resumed_ns = True, now_ns
            coordinator.body.heartbeat.ones(now_ns)
        else:
            self._come_back(now_ns)

    def _resume(self, now_ns: int) -> None:
        """1.0 is out again: HOLDING as soon as the arms can be seeded."""
        coordinator = self._coordinator
        able, value = coordinator.fit_arms(now_ns), coordinator.store.fsm(now_ns)
        sides = tuple(side for side in coordinator.enable.sides if able is None or side in able)
        if value is None:
            coordinator.fire(Trigger.FSM_DEAD, now_ns, "/fsm_state has not been heard for 0.5 s")
        elif value != FsmState.READY or not sides or now_ns - self._resumed_ns > RESUME_NS:
            self._come_back(now_ns)
            # Our own 1.0 of a moment ago is out: it may have restarted the robot.
            coordinator.body.heartbeat.zeros(now_ns)
        elif all(coordinator.seedable(side, now_ns) for side in sides):
            unnoticed = self._silenced if now_ns - self._silenced_ns < GRIPPER_WATCHDOG_NS else ()
            if not coordinator.body.running_arms and self._starting.seed(sides, now_ns, unnoticed) is not None:
                self._come_back(now_ns)
            else:
                coordinator.go(State.HOLDING, now_ns, "a short stall is over; the owner resumes explicitly")

    def _come_back(self, now_ns: int) -> None:
        self._coordinator.fire(Trigger.FRESH, now_ns, "the robot's state is fresh again")

    # ------------------------------------------------------------------------------------------------ what is owed

    def _pay(self, now_ns: int) -> None:
        """Send the 0.0 that is owed after a loss or a spell of VR mode, once the robot is known to be ours."""
        coordinator = self._coordinator
        heartbeat, store, state = coordinator.body.heartbeat, coordinator.store, coordinator.state
        mode, value = store.mode(now_ns), store.fsm(now_ns)
        is_vr = mode is not None and not mode.api
        is_theirs = is_vr or (value is not None and value not in OWN_FSM)
        if is_theirs and heartbeat.is_ending and not heartbeat.is_estop:
            heartbeat.silence()  # the FSM is driven by VR or playback now: a 0.0 would pause its operator
        if is_vr or coordinator.others.armed:  # an operator's, or another gateway's: not ours to pause
            self._lost_ns = now_ns
        elif self._lost_ns is not None and state not in QUIET:
            if state in STREAMING or not heartbeat.is_owed:
                self._lost_ns = None
            elif mode is not None and value is not None and self._is_newer(self._lost_ns):
                self._lost_ns = None
                if value in STARTED and coordinator.others.arm_data_text(now_ns):
                    heartbeat.zero_once(now_ns)
                elif value in STARTED:
                    heartbeat.zeros(now_ns)

    def _is_newer(self, than_ns: int) -> bool:
        """Return whether mode and FSM have both been heard since: before, they may be somebody else's."""
        store = self._coordinator.store
        return min(store.mode_received_ns or 0, store.fsm_received_ns or 0) > than_ns

    def _repeat_estop(self, now_ns: int) -> None:
        """Send an e-stop again that may not have been heard; in any mode, as the first time."""
        coordinator = self._coordinator
        heartbeat, store = coordinator.body.heartbeat, coordinator.store
        if not coordinator.is_estop_unheard:
            self._estop_lost_ns = None
        elif coordinator.state not in QUIET and (value := store.fsm(now_ns)) is not None and not heartbeat.is_ending:
            if value == FsmState.PAUSE:
                coordinator.is_estop_unheard = False
            elif self._estop_lost_ns is not None and (store.fsm_received_ns or 0) > self._estop_lost_ns:
                self._estop_lost_ns = None
                if value in STARTED:
                    heartbeat.zeros(now_ns, is_estop=True)
