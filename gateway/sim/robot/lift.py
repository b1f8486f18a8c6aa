"""The simulated lift of the lift model: a servo with enable, soft limits and a 3 s watchdog.

Rules (§4.6): `[velocity, enable]`; motor speed is -velocity x 150 rad/s, so positive input raises; `[0, 1]` stops
and keeps the servo enabled; enable <= 0.5 stops, then cuts the servo; more than 3 s of silence stops, then disables;
FSM ERROR stops; the speed is reduced before a soft limit and never leads beyond it; a message needs two finite
values.

Choices: 150 rad/s is 0.5 m/s (the description's joint limit), ramps are 1 m/s², inputs beyond +-1 are cut. Stepped
on its own fixed 5 ms grid, so that the way it goes does not depend on how the model is stepped. Position: 0 at the
top, positive lower, 0..0.74 m (description); no topic reports it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

from gateway.sim.robot.journal import Journal
from gateway.sim.robot.manual import LIFT_MOTOR_RADPS, LIFT_WATCHDOG_NS, MS, S

__all__ = ["LOWEST_M", "SimLift"]

LOWEST_M: Final = 0.74
"""Lowest position below the top [m] (published description)."""

_METRES_PER_RAD: Final = 0.5 / LIFT_MOTOR_RADPS
_RAMP_RADPS2: Final = 1.0 / _METRES_PER_RAD
_GRID_NS: Final = 5 * MS


class SimLift:
    """State and rules of the lift.

    Attributes:
        lowered_m: Position below the top [m].
        motor_radps: Motor speed, positive lowers [rad/s].
        is_powered: Whether the servo is enabled.
        is_configured: Configuration switch of §2.3.
        has_error: FSM is in ERROR.
    """

    def __init__(self, journal: Journal, start_ns: int, *, is_configured: bool, lowered_m: float = 0.30) -> None:
        self.lowered_m = lowered_m
        self.motor_radps = 0.0
        self.is_powered = False
        self.is_configured = is_configured
        self.has_error = False
        self._wanted_01 = 0.0
        self._wants_power = False
        self._journal = journal
        self._last_ns: int | None = None
        self._stepped_ns = start_ns

    def command(self, data: Sequence[float], now_ns: int) -> bool:
        """Take `[normalised velocity, enable]`; return whether it was accepted."""
        subject = "lift servo cmd"
        if not self.is_configured:
            self._journal.note(now_ns, "LIFT_DISABLED", subject, "not enabled in the configuration (§4.6)")
            return False
        if len(data) < 2 or not all(map(math.isfinite, data[:2])):
            self._journal.note(now_ns, "REFUSED_LIFT", subject, f"{list(data)}: two finite values needed (§4.6)")
            return False
        velocity = min(max(float(data[0]), -1.0), 1.0)
        if velocity != data[0]:
            self._journal.note(now_ns, "CLIPPED", subject, f"{data[0]} cut to {velocity} (§4.6)")
        self._last_ns = now_ns
        self._wants_power = data[1] > 0.5
        self._wanted_01 = velocity if self._wants_power else 0.0
        self.is_powered = self.is_powered or self._wants_power
        return True

    @property
    def deadline_ns(self) -> int | None:
        """When a silent stream ends: the first instant more than 3 s after the last command [ns]."""
        return None if self._last_ns is None else self._last_ns + LIFT_WATCHDOG_NS + 1

    def expire(self, now_ns: int) -> None:
        """Stop and give up the servo when the deadline has passed."""
        deadline_ns = self.deadline_ns
        if deadline_ns is not None and now_ns >= deadline_ns:
            self._last_ns = None
            if self._wants_power:
                self._journal.note(now_ns, "LIFT_WATCHDOG", "lift", "no command for 3 s, stopping (§4.6)")
            self._wanted_01, self._wants_power = 0.0, False

    def move_to(self, now_ns: int) -> None:
        """Let time pass up to the last point of the lift's grid that is not after `now_ns`."""
        while self._stepped_ns + _GRID_NS <= now_ns:
            self._stepped_ns += _GRID_NS
            if self.is_powered:
                self._step(_GRID_NS / S)

    def _step(self, dt_s: float) -> None:
        wanted = 0.0 if self.has_error else -self._wanted_01 * LIFT_MOTOR_RADPS
        room_m = LOWEST_M - self.lowered_m if wanted > 0.0 else self.lowered_m
        slowest = math.sqrt(2.0 * _RAMP_RADPS2 * max(room_m, 0.0) / _METRES_PER_RAD)
        wanted = math.copysign(min(abs(wanted), slowest), wanted)
        change = min(abs(wanted - self.motor_radps), _RAMP_RADPS2 * dt_s)
        self.motor_radps += math.copysign(change, wanted - self.motor_radps)
        lowered_m = self.lowered_m + self.motor_radps * _METRES_PER_RAD * dt_s
        self.lowered_m = min(max(lowered_m, 0.0), LOWEST_M)
        if self.lowered_m != lowered_m:
            self.motor_radps = 0.0
        if self.motor_radps == 0.0 and not self._wants_power:
            self.is_powered = False
