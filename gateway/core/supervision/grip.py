"""Whether a gripper seems to hold something: an estimate, because the robot does not say (manual §4.4, §4.12).

It is taken to hold while all of this is so: it is told to close, with at least 0.1 N·m of feed-forward torque; its motor
has stood still (slower than 0.05 rad/s) for 0.3 s; and it stands still more than 0.03 rad short of closed, which is where
`model.left_gripper_closed_rad` says. A gripper that blocks for another reason, or holds something thinner than that, is taken
for the wrong thing. Where its state is not fresh, without a velocity, or nothing is sent to it, nobody can tell; nor where the
FSM is neither SLOW_START nor READY: whether a PAUSE leaves it the torque that its arm's stream keeps alive, the manual does not
say (§4.1, §4.4).
"""

from __future__ import annotations

from gateway.core.supervision.coordinator import Coordinator
from gateway.robot.limits import gripper_torque_nm
from gateway.robot.topics import gripper_state
from gateway.values import FsmState, MotorState, Side

__all__ = ["CLOSING_NM", "OPEN_RAD", "STILL_NS", "STILL_RADPS", "Grips"]

MS = 1_000_000
DRIVEN = (FsmState.SLOW_START, FsmState.READY)
STATES = {side: gripper_state(side) for side in Side}

CLOSING_NM = 0.1
"""Least torque that closes [N·m]."""
STILL_RADPS = 0.05
"""A motor slower than this stands still [rad/s]."""
STILL_NS = 300 * MS
"""... when it lasts this long [ns]."""
OPEN_RAD = 0.03
"""A motor angle more than this above that of a closed gripper is not closed [rad]."""


class Grips:
    """Looks at both grippers."""

    def __init__(self, coordinator: Coordinator) -> None:
        self._coordinator = coordinator
        self._still_since_ns: dict[Side, int | None] = dict.fromkeys(Side, None)

    def step(self, now_ns: int) -> None:
        """Look once."""
        for side, gripper in self._coordinator.body.grippers.items():
            gripper.is_holding = self._look(side, gripper.raw, now_ns) if gripper.running else None

    def _look(self, side: Side, raw: float, now_ns: int) -> bool | None:
        store = self._coordinator.store
        topic = STATES[side]
        motor, age_ns = store.value(topic), store.age_ns(topic, now_ns)
        settings = self._coordinator.settings
        is_fresh = age_ns is not None and age_ns <= settings.enable.stale_ns
        is_driven = store.fsm(now_ns) in DRIVEN
        if not is_driven or not is_fresh or not isinstance(motor, MotorState) or not motor.dq_radps:
            self._still_since_ns[side] = None
            return None
        short_rad = motor.q_rad[0] - settings.model.gripper_closed_rad(side)
        is_still_open = abs(motor.dq_radps[0]) < STILL_RADPS and short_rad > OPEN_RAD
        if not (is_still_open and gripper_torque_nm(raw) <= -CLOSING_NM):
            self._still_since_ns[side] = None
            return False
        since_ns = self._still_since_ns[side]
        if since_ns is None:
            self._still_since_ns[side] = since_ns = now_ns
        return now_ns - since_ns >= STILL_NS
