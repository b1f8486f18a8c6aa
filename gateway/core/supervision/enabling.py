"""ENABLING: echo where the arms are, then 1.0, until the robot's FSM is READY; bounded, and with what was missing.

    enable -> nobody else claims the robot, steady state for 0.3 s -> echo -> 1.0 after 30 ms -> SLOW_START -> READY

The supervisor's table says what else ends it. From PAUSED the echo begins at once: the streams are live, so there must
be no gap, and the robot does not follow. It stays with the arm until the first 1.0, which waits until the arm's samples agree.
"""

from __future__ import annotations

from gateway.core.messages.outputs import Level
from gateway.core.supervision.conditions import Conditions
from gateway.core.supervision.coordinator import Coordinator
from gateway.core.supervision.starting import Starting
from gateway.core.supervision.supervisor import State, Trigger
from gateway.errors import Code, Refusal
from gateway.robot.topics import FSM_ENABLE
from gateway.values import FsmState, Side

__all__ = ["Enabling"]

MS = 1_000_000
S = 1_000_000_000

BEAT_DELAY_NS = 30 * MS
"""The first 1.0 leaves this long after the first echo [ns]: the heartbeat has a faster lane and must not overtake it."""

NOT_EFFECTIVE_NS = 1500 * MS
"""1.0 for longer than this while the FSM stays PAUSE is told [ns] (BEHAVIOUR, the bridge misbehaves)."""

FSM_NAMES: dict[int | None, str] = {None: "unknown", **{state.value: state.name for state in FsmState}}


class Enabling:
    """The course of one `enable` after the other."""

    def __init__(self, coordinator: Coordinator, conditions: Conditions, starting: Starting) -> None:
        self._coordinator = coordinator
        self._conditions = conditions
        self._starting = starting
        self._started_ns = 0
        self._echo_ns: int | None = None
        self._is_told = False

    def begin(self, sides: tuple[Side, ...], now_ns: int) -> None:
        """ENABLING was entered: seed these arms as soon as their state can be trusted.

        Args:
            sides: Arms that are enabled; each is streamed in the space of its control mode.
            now_ns: Monotonic time [ns].
        """
        coordinator = self._coordinator
        self._started_ns, self._echo_ns, self._is_told = now_ns, None, False
        coordinator.enable.begin(sides)
        coordinator.choose_spaces(sides, now_ns)
        self._conditions.enabling_begins()
        if coordinator.supervisor.came_from is State.PAUSED:
            for side, arm in coordinator.body.arms.items():
                if arm.running and side not in sides:
                    arm.stop()
            self._echo(now_ns)

    def _echo(self, now_ns: int) -> None:
        guard = self._coordinator.guard
        if guard.is_expected and not guard.is_linked:
            message = (
                "the guard does not reach the robot yet: until it does nobody holds the arms when this process dies"
            )
            self._coordinator.notice(Code.GUARD_LOST, Level.WARNING, message, now_ns, pid=str(guard.pid))
        refusal = self._starting.seed(self._coordinator.enable.sides, now_ns)
        if refusal is None:
            self._echo_ns = now_ns
        else:
            self._fail(refusal, now_ns)

    def echo_changed(self, now_ns: int) -> None:
        """What is echoed was set to an arm that has moved meanwhile: the first 1.0 must not overtake that either."""
        if self._echo_ns is not None:
            self._echo_ns = now_ns

    def _fail(self, refusal: Refusal, now_ns: int) -> None:
        self._coordinator.enable.blame(refusal.code, refusal.message)
        self._coordinator.fire(Trigger.ENABLE_TIMEOUT, now_ns, refusal.message)

    def step(self, now_ns: int) -> None:
        """Take the step that is due."""
        coordinator = self._coordinator
        value = coordinator.store.fsm(now_ns)
        if now_ns - self._started_ns > coordinator.settings.enable.timeout_ns:
            seconds = coordinator.settings.enable.timeout_ns / S
            message = f"the robot was not READY within {seconds:.0f} s: {self._missing(now_ns)}"
            self._fail(Refusal(code=Code.ENABLE_TIMEOUT, message=message), now_ns)
        elif self._conditions.first_beat_ns is None and value != FsmState.PAUSE:
            message = f"the FSM went to {FSM_NAMES.get(value, value)} before our first heartbeat: somebody else enables"
            self._fail(Refusal(code=Code.FSM_BUSY, message=message), now_ns)
        elif self._echo_ns is None:
            is_awaited = coordinator.guard.is_awaited(now_ns - self._started_ns)
            if not coordinator.claim.is_confirmed:
                self._wait_for_claim(now_ns)
            elif not is_awaited and all(coordinator.seedable(side, now_ns) for side in coordinator.enable.sides):
                self._echo(now_ns)
        elif self._conditions.first_beat_ns is not None:
            self._tell_if_unheard(value, now_ns)
        elif now_ns - self._echo_ns >= BEAT_DELAY_NS and self._is_agreed(now_ns):
            coordinator.body.heartbeat.ones(now_ns)
            self._conditions.first_beat_ns = now_ns

    def _is_agreed(self, now_ns: int) -> bool:
        """Return whether all samples of late say that the arms are where they are echoed to be: nobody follows yet."""
        return all(self._coordinator.agreed(side, now_ns) for side in self._coordinator.enable.sides)

    def _wait_for_claim(self, now_ns: int) -> None:
        """Nothing leaves before other gateways have seen that we are about to command the robot, or one of them is first."""
        objection = self._coordinator.others.objection(now_ns)
        if self._coordinator.claim.number == 0 and objection is not None:
            self._fail(objection, now_ns)

    def _missing(self, now_ns: int) -> str:
        store = self._coordinator.store
        if not self._coordinator.claim.is_confirmed:
            return "the robot's router has not shown our claim to other gateways"
        if self._echo_ns is None:
            waiting = [
                f"the {side} arm"
                for side in self._coordinator.enable.sides
                if not self._coordinator.seedable(side, now_ns)
            ]
            return f"no 0.3 s of steady, timely state from {' and '.join(waiting)}"
        if self._conditions.first_beat_ns is None:
            waiting = [
                f"the {side} arm"
                for side in self._coordinator.enable.sides
                if not self._coordinator.agreed(side, now_ns)
            ]
            return f"the samples of {' and '.join(waiting)} do not agree: it is being moved, or they are not its own"
        value = store.fsm(now_ns)
        return f"setpoints and heartbeat were sent, the FSM stayed {FSM_NAMES.get(value, value)}"

    def _tell_if_unheard(self, value: int | None, now_ns: int) -> None:
        """Say once that 1.0 does nothing, with what is known of its way to the robot."""
        since_ns = self._conditions.first_beat_ns or now_ns
        if value == FsmState.PAUSE and now_ns - since_ns > NOT_EFFECTIVE_NS and not self._is_told:
            self._is_told = True
            route = self._coordinator.routes.get(FSM_ENABLE, "nothing is known of its route")
            self._coordinator.notice(
                Code.HEARTBEAT_NOT_EFFECTIVE,
                Level.WARNING,
                f"1.0 has been sent for {(now_ns - since_ns) / S:.1f} s and the FSM stays PAUSE; {FSM_ENABLE}: {route}",
                now_ns,
                topic=FSM_ENABLE,
                route=route,
            )
