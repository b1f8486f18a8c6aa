"""What the robot is doing by itself, as triggers of the supervisor: levels, looked at on every tick.

Rules
    * Most serious first: after a trigger has moved the state, the rest is looked at again from the new state.
    * Nothing here acts. It reads the store, the body and the supervisor.
    * A sample decides only when it can be an answer: FSM values count for READY and for a fall only when they arrived
      after our first heartbeat of this enabling.
"""

from __future__ import annotations

from collections.abc import Iterator

from gateway.core.supervision.coordinator import QUIET, Coordinator
from gateway.core.supervision.supervisor import STREAMING, State, Trigger
from gateway.errors import Code
from gateway.robot.topics import arm_state
from gateway.values import OWN_FSM, FsmState, Side

__all__ = ["Conditions"]

REFUSED_NS = 200_000_000
"""A sample that was refused longer ago does not tell why a part's state is old now [ns]."""

STARTED_NS = 150_000_000
"""A robot that says PAUSE so long after our first 1.0 has not heard it [ns]: three of its FSM samples (manual §4.11.1)."""


class Conditions:
    """Reads the robot's condition."""

    def __init__(self, coordinator: Coordinator) -> None:
        self._coordinator = coordinator
        self._off_since_ns: dict[Side, int | None] = dict.fromkeys(Side, None)
        self._saw_slow_start = False
        self.first_beat_ns: int | None = None
        """When the first 1.0 of the present enabling left [ns]; None before it."""

    def enabling_begins(self) -> None:
        """A new enabling has begun: earlier FSM samples are no answers to it."""
        self._saw_slow_start = False
        self.first_beat_ns = None

    def is_unfollowed(self, now_ns: int) -> bool:
        """Return whether the robot drives no arm: it is heard, and says that its FSM is PAUSE (manual §4.11.1).

        While a first 1.0 may be under way the word is old: the robot may have started, and the arm have sunk onto its
        setpoint, before the FSM is heard again.
        """
        store, beat_ns = self._coordinator.store, self.first_beat_ns
        is_paused = store.is_fresh(now_ns) and store.fsm(now_ns) == FsmState.PAUSE
        if not is_paused or self._coordinator.state is not State.ENABLING or beat_ns is None:
            return is_paused
        return (store.fsm_received_ns or 0) > beat_ns + STARTED_NS

    def look(self, now_ns: int) -> Iterator[tuple[Trigger, str]]:
        """Give the triggers that hold now, most serious first, each with its reason."""
        coordinator = self._coordinator
        store, state = coordinator.store, coordinator.state
        if not coordinator.transport_up:
            yield Trigger.TRANSPORT_LOST, "no transport to the robot's router"
            return
        wrong = store.name_order_wrong(now_ns)
        if wrong is not None:
            yield Trigger.JOINT_ORDER, wrong
        if not store.is_fresh(now_ns):
            if state not in QUIET:
                age_ns = store.link_age_ns(now_ns) or 0
                yield Trigger.STALE, f"the newest state is {age_ns / 1e6:.0f} ms old, 100 ms is the bound"
            return
        if state in QUIET:
            return  # the way back depends on how long it was gone: see `stall.py`
        yield from self._others(now_ns)
        yield from self._mode(now_ns)
        if state in STREAMING:
            yield from self._fsm(now_ns)
            yield from self._arms(now_ns)
            yield from self._tracking(now_ns)

    def _others(self, now_ns: int) -> Iterator[tuple[Trigger, str]]:
        coordinator = self._coordinator
        others = coordinator.others
        if others.is_alone:
            return
        is_open = (
            coordinator.state is State.ENABLING and not coordinator.claim.is_confirmed
        )  # one of the two will yield
        if not is_open and (rivals := others.armed_text()):
            yield Trigger.OTHER_GATEWAY, f"another {rivals}"
        if sent := others.arm_data_text(now_ns):
            yield Trigger.FOREIGN_DATA, f"commands that we did not send: {sent}"
        if writers := others.writer_text(now_ns):
            yield Trigger.FOREIGN_TOKEN, f"somebody else commands the robot: {writers}"
        if (sent or writers) and any(ground.is_driven for ground in coordinator.body.drives):
            yield Trigger.FOREIGN_BESIDE_DRIVE, f"somebody else commands the robot: {sent or writers}"

    def _mode(self, now_ns: int) -> Iterator[tuple[Trigger, str]]:
        mode, state = self._coordinator.store.mode(now_ns), self._coordinator.state
        if mode is None:
            yield Trigger.MODE_UNKNOWN, "/api/current_mode has not been heard for 3 s"
        elif not mode.api:
            if state is not State.READ_ONLY:
                yield Trigger.VR_MODE, "the robot was switched to VR mode"
        elif not self._coordinator.able_arms(now_ns):
            yield Trigger.NO_ARM, "no arm is enabled any more in the robot's system configuration"

    def _fsm(self, now_ns: int) -> Iterator[tuple[Trigger, str]]:
        store, is_enabling = self._coordinator.store, self._coordinator.state is State.ENABLING
        value = store.fsm(now_ns)
        is_answer = self.first_beat_ns is not None and (store.fsm_received_ns or 0) > self.first_beat_ns
        if value is None:
            yield Trigger.FSM_DEAD, "/fsm_state has not been heard for 0.5 s"
        elif value not in OWN_FSM:
            yield (
                Trigger.FSM_FOREIGN,
                f"the robot's FSM is {value}: VR single arm, playback or unknown (manual §4.11.1)",
            )
        elif value == FsmState.ERROR:
            yield Trigger.FSM_ERROR, "the robot's FSM is ERROR (-1): control or motor fault (manual §4.11.1)"
        elif value == FsmState.READY:
            if is_answer if is_enabling else self._coordinator.state is State.PAUSED:
                yield Trigger.FSM_READY, "the robot's FSM is READY"
        elif value == FsmState.SLOW_START:
            self._saw_slow_start = is_answer
            yield Trigger.FSM_SLOW_START, "the robot's FSM fell back to SLOW_START: a pause too short to be seen"
        else:
            if is_enabling and self._saw_slow_start:
                yield Trigger.FSM_FELL, "the robot's FSM fell from SLOW_START to PAUSE while enabling"
            yield Trigger.FSM_PAUSE, self._pause_reason()

    def _pause_reason(self) -> str:
        """Say whose pause it is: in STOPPING our own 0.0 asked for it, unless the arms are still braking."""
        if self._coordinator.state is State.STOPPING and self._coordinator.body.is_at_rest:
            return "the robot's FSM is PAUSE, as our 0.0 asked for"
        return "the robot's FSM is PAUSE: it paused by itself, perhaps a physical stop"

    def _arms(self, now_ns: int) -> Iterator[tuple[Trigger, str]]:
        coordinator = self._coordinator
        for side, code in coordinator.lost_arms(now_ns).items():
            if code is Code.ARM_DISABLED:
                yield Trigger.ARM_DISABLED, self._why_unfit(side, now_ns)
            else:
                why = coordinator.store.why_not_believed(arm_state(side), REFUSED_NS, now_ns)
                said = f": its samples are not believed, {why}" if why else ""
                yield Trigger.PART_DEAD, f"the state of the {side} arm is older than 100 ms{said}"
        if not coordinator.sides:
            yield Trigger.NO_ARM, "no arm that was enabled is left"

    def _why_unfit(self, side: Side, now_ns: int) -> str:
        """Say what happened to an arm in the robot's system configuration."""
        if side in (self._coordinator.able_arms(now_ns) or ()):
            space = self._coordinator.body.arms[side].space
            return (
                f"{Code.WRONG_CONTROL_MODE}: the {side} arm left {space} mode in the robot's system configuration; "
                "the next enable() takes it up in its new mode"
            )
        return f"the {side} arm was disabled in the robot's system configuration"

    def _tracking(self, now_ns: int) -> Iterator[tuple[Trigger, str]]:
        tracking_ns = self._coordinator.settings.arm.tracking_ns
        for side, arm in self._coordinator.body.arms.items():
            measured = self._coordinator.measured(side)
            off = arm.distance(measured) if arm.running and measured is not None else None
            if off is None or not off.exceeds(arm.tracking):
                self._off_since_ns[side] = None
                continue
            since_ns = self._off_since_ns[side]
            if since_ns is None:
                self._off_since_ns[side] = since_ns = now_ns
            if now_ns - since_ns >= tracking_ns:
                yield (
                    Trigger.TRACKING,
                    f"the {side} arm is {off.text(arm.space)} from its setpoint for {tracking_ns / 1e9:.1f} s, "
                    f"{arm.tracking.text(arm.space)} is the bound",
                )
