"""What takes time: enabling, stopping, the way back from a stall, what is owed, and the end.

The supervisor's table says where an event leads; this says when the next step of such a course is due. Looked at once a
tick, after conditions and requests. The longer courses have modules of their own: `enabling.py` and `stall.py`.
"""

from __future__ import annotations

from gateway.core.messages.events import ExitRequested, PartEnded
from gateway.core.messages.outputs import Level
from gateway.core.streams.heartbeat import Beat
from gateway.core.supervision.conditions import Conditions
from gateway.core.supervision.coordinator import AT_BASE, Coordinator
from gateway.core.supervision.enabling import FSM_NAMES, Enabling
from gateway.core.supervision.stall import Stall
from gateway.core.supervision.starting import Starting
from gateway.core.supervision.supervisor import STREAMING, State, Trigger
from gateway.errors import Code

__all__ = ["Phases"]

MS = 1_000_000
S = 1_000_000_000

EXIT_NS = 4500 * MS
"""The daemon ends at the latest this long after it was asked to [ns] (BEHAVIOUR: < 5 s)."""

EXIT_BRAKE_NS = 2200 * MS
"""Arms that still brake this long after it [ns] must do so while 0.0 is sent: it needs 2 s when it is not heard."""

EXIT_SETTLE_NS = 50 * MS
"""Frames handed over for sending get this long to leave the process [ns]."""

TELL_NS = 200 * MS
"""A daemon that is broken goes on for so long in any case [ns]: its notice leaves, and its latch reaches the disk."""

BRAKE_NS = 3 * S
"""Arms that still brake this long after it [ns] are braked on by the guard."""


class Phases:
    """Courses of the supervisor that take more than one tick."""

    def __init__(self, coordinator: Coordinator, conditions: Conditions) -> None:
        self._coordinator = coordinator
        self._conditions = conditions
        self.starting = Starting(coordinator)
        """How streams begin, and how held references get back to their arms."""
        self.enabling = Enabling(coordinator, conditions, self.starting)
        """The course of an `enable`."""
        self._stall = Stall(coordinator, self.starting)
        self._unheard_ns: int | None = None
        self._broken_ns: int | None = None
        self._is_left = False
        self._exit_ns: int | None = None
        self._done_ns: int | None = None

    def step(self, now_ns: int) -> None:
        """Take the steps that are due."""
        coordinator = self._coordinator
        if coordinator.state in STREAMING and self._conditions.is_unfollowed(now_ns) and self.starting.stay(now_ns):
            self.enabling.echo_changed(now_ns)
        if coordinator.state is State.ENABLING:
            self.enabling.step(now_ns)
        elif coordinator.state is State.STOPPING:
            self._stop(now_ns)
        elif coordinator.body.gives_way:
            self._give_way(now_ns)
        self._stall.step(now_ns)
        if coordinator.state in AT_BASE:
            coordinator.go(coordinator.base(now_ns), now_ns, "the robot's condition")
        self._leave(now_ns)
        self._tell_unheard_stop(now_ns)

    def _give_way(self, now_ns: int) -> None:
        """Lead the references of arms that met something to where these are: what is held presses on it no longer."""
        body = self._coordinator.body
        if self._coordinator.lost_arms(now_ns):
            body.gives_way = False  # what happens meanwhile nobody sees
        elif body.is_at_rest:
            refusal = self.starting.walk(now_ns)
            body.gives_way = refusal is not None and refusal.code is Code.PART_STALE  # it moves yet: asked again

    def _stop(self, now_ns: int) -> None:
        """At rest 0.0 is sent; the way to the base is FSM 0, or the end of the repetition."""
        coordinator = self._coordinator
        heartbeat = coordinator.body.heartbeat
        is_late = self._exit_ns is not None and now_ns - self._exit_ns > EXIT_BRAKE_NS
        if heartbeat.gave_up_at_ns is not None and heartbeat.gave_up_at_ns >= coordinator.supervisor.since_ns:
            coordinator.go(coordinator.base(now_ns), now_ns, "FSM 0 was not seen in time")
        elif not heartbeat.is_ending and (coordinator.body.is_at_rest or is_late):
            coordinator.fire(Trigger.AT_REST, now_ns, "the arms are at rest")

    def _tell_unheard_stop(self, now_ns: int) -> None:
        gave_up_ns = self._coordinator.body.heartbeat.gave_up_at_ns
        if gave_up_ns is not None and gave_up_ns != self._unheard_ns:
            name = FSM_NAMES.get(value := self._coordinator.store.fsm(now_ns), str(value))
            self._coordinator.notice(
                Code.STOP_NOT_EFFECTIVE,
                Level.ERROR,
                f"0.0 was sent for 2 s and the robot did not report PAUSE, its FSM is {name}: "
                "use the physical emergency stop",
                now_ns,
            )
        self._unheard_ns = gave_up_ns

    # ------------------------------------------------------------------------------------------------ the end

    @property
    def is_broken(self) -> bool:
        """Whether a part of this process has ended, so that another process must take its place."""
        return self._broken_ns is not None

    def end(self, event: ExitRequested | PartEnded, now_ns: int) -> None:
        """Begin to end: when a part has ended as after a stop, else brake, 0.0, then done."""
        if not isinstance(event, PartEnded):
            return self._request_exit(now_ns)
        coordinator = self._coordinator
        facts = {"trace": event.trace} if event.trace else {}
        coordinator.notice(Code.GATEWAY_BROKEN, Level.ERROR, event.message, now_ns, **facts)
        coordinator.is_exiting = True
        self._broken_ns = now_ns if self._broken_ns is None else self._broken_ns
        coordinator.fire(Trigger.PART_ENDED, now_ns, event.message)

    def _leave(self, now_ns: int) -> None:
        """Leave what a broken daemon holds to its guard, the grip and all; end in order where nothing is held, or no guard."""
        if self._broken_ns is None or now_ns - self._broken_ns < TELL_NS or self._exit_ns is not None:
            return
        coordinator, is_in_time = self._coordinator, now_ns - self._broken_ns <= BRAKE_NS
        if coordinator.state is State.HOLDING and coordinator.guard.is_linked:
            self._is_left = coordinator.guard.could_hold(now_ns) and (coordinator.body.is_at_rest or not is_in_time)
        elif not (
            coordinator.state is State.STALE and coordinator.can_resume and coordinator.guard.is_linked and is_in_time
        ):
            self._request_exit(now_ns)

    def _request_exit(self, now_ns: int) -> None:
        if self._exit_ns is None:
            self._exit_ns = now_ns
            self._coordinator.is_exiting = True
            self._coordinator.fire(Trigger.EXIT, now_ns, "the daemon was asked to end")

    def is_done(self, now_ns: int) -> bool:
        """Return whether everything that must be sent before the end has been sent."""
        if self._exit_ns is None:
            return self._is_left
        body = self._coordinator.body
        is_busy = self._coordinator.state in STREAMING or body.heartbeat.beat is Beat.ZERO
        if is_busy or any(ground.running for ground in body.drives):
            self._done_ns = None
        elif self._done_ns is None:
            self._done_ns = now_ns
        is_settled = self._done_ns is not None and now_ns - self._done_ns >= EXIT_SETTLE_NS
        return is_settled or now_ns - self._exit_ns > EXIT_NS
