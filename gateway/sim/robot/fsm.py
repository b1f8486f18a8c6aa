"""The robot's state machine: PAUSE, SLOW_START, READY, ERROR, and the states that only VR and playback use.

Rules (§4.7, §4.11.1): 1.0 starts from PAUSE and is the heartbeat; 0.0 pauses at once; longer than 1 s without 1.0
pauses; READY needs the joints near their targets for some checks. Values other than 1.0 and 0.0 mean nothing in the
manual, so they neither feed the watchdog nor pause (choice). ERROR is left only by clearing the fault (choice: the
manual names no way out over the API). Playback and single-arm states are entered by a fault only; 0.0 pauses them as
well, since the topic bypasses the MUX (§3.1.1).

Knows nothing of arms beyond their deviations.
"""

from __future__ import annotations

from collections.abc import Sequence

from gateway.sim.robot.manual import HEARTBEAT_WATCHDOG_NS, READY_CHECKS, READY_TOLERANCE_RAD, Fsm

__all__ = ["StateMachine"]


class StateMachine:
    """State of `/fsm_state`, stepped by commands, deadlines and the 20 Hz check."""

    def __init__(self) -> None:
        self.state = Fsm.PAUSE
        self.is_held = False  # a pause that 1.0 does not end: somebody at the robot keeps it paused
        self._pinned: int | None = None
        self._last_one_ns: int | None = None
        self._settled_checks = 0

    @property
    def published(self) -> int:
        """What `/fsm_state` says: the state, or a pinned value that may be none of §4.11.1."""
        return int(self.state) if self._pinned is None else self._pinned

    @property
    def is_started(self) -> bool:
        """Whether the arms' control chain runs: SLOW_START or READY."""
        return self.state in (Fsm.SLOW_START, Fsm.READY)

    @property
    def deadline_ns(self) -> int | None:
        """When the heartbeat watchdog trips, if it runs [ns]: the first instant more than 1 s after the last 1.0."""
        if not self.is_started or self._last_one_ns is None or self._pinned is not None:
            return None
        return self._last_one_ns + HEARTBEAT_WATCHDOG_NS + 1

    def enable(self, value: float, now_ns: int) -> bool:
        """Take a value of `/api/fsm/enable`; return False when it means nothing."""
        if value == 1.0:
            self._last_one_ns = now_ns
            if self.state is Fsm.PAUSE and not self.is_held and self._pinned is None:
                self.state = Fsm.SLOW_START
                self._settled_checks = 0
            return True
        if value == 0.0:
            self.pause()
            return True
        return False

    def pause(self) -> None:
        """Go to PAUSE at once; ERROR and a pinned state stay."""
        if self.state is not Fsm.ERROR and self._pinned is None:
            self.state = Fsm.PAUSE

    def expire(self, now_ns: int) -> bool:
        """Pause when the heartbeat's deadline has passed; return whether it had."""
        deadline_ns = self.deadline_ns
        if deadline_ns is None or now_ns < deadline_ns:
            return False
        self.state = Fsm.PAUSE
        return True

    def check(self, deviations_rad: Sequence[float]) -> bool:
        """Make the 20 Hz readiness check; return whether READY was reached by it.

        Args:
            deviations_rad: Largest joint deviation from the target of each *enabled* arm [rad]; with no arm enabled
                READY is never reached (choice).
        """
        if self.state is not Fsm.SLOW_START or self._pinned is not None:
            return False
        settled = bool(deviations_rad) and max(deviations_rad) <= READY_TOLERANCE_RAD
        self._settled_checks = self._settled_checks + 1 if settled else 0
        if self._settled_checks < READY_CHECKS:
            return False
        self.state = Fsm.READY
        return True

    def pin(self, value: int | None) -> None:
        """Hold the machine in a state against every event; None lets go, into PAUSE.

        Args:
            value: What `/fsm_state` shall say. A value outside §4.11.1 is published as it is and acts as PAUSE.
        """
        if value == self._pinned:
            return
        self._pinned = value
        self._settled_checks = 0
        known = {int(state) for state in Fsm}
        self.state = Fsm(value) if value is not None and value in known else Fsm.PAUSE
