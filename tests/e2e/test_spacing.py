"""Arms are kept apart, end to end: real daemon, simulated robot, public API; the measured arms are judged."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

import pytest

from gateway.client import Robot
from gateway.errors import Code, GatewayError, Rejected
from gateway.robot.limits import HOME_Q_RAD
from gateway.values import Side
from tests.e2e.system import System, steady, wait_for
from tests.kinematics.guarded_arms import MARGIN_M, MEET, model

pytestmark = [
    pytest.mark.e2e,
    pytest.mark.alone,
    pytest.mark.body_free("it is setpoints that keep the margin, and they are the same whatever follows them"),
]

Systems = Callable[..., System]
STARVED = {
    Code.PART_LOST,
    Code.PART_STALE,
    Code.STATE_STALE,
    Code.MODEL_UNKNOWN,
    Code.STREAM_ENDED,
    Code.TARGET_EXPIRED,
}
"""What a machine without time for daemon, robot or client gives."""
SAG_M = 0.004
"""How much nearer the simulated arms come than their setpoints."""
HOME, TOGETHER = ({side.value: goals[side] for side in Side} for goals in (HOME_Q_RAD, MEET))


def is_on(robot: Robot) -> bool:
    """Whether arms are kept apart."""
    return robot.state.spacing is not None and robot.state.spacing.on


def lead(robot: Robot, streams, goals, seconds: float) -> list[float]:
    """Stream targets of both arms; return the gaps between the measured parts meanwhile [m]."""
    gaps_m, until = [], time.monotonic() + seconds
    while time.monotonic() < until:
        for side, out in streams.items():
            out.set(goals[side])
        state = robot.state
        measured = {side: tuple(map(float, state.arm(side.value).q)) for side in Side}
        gaps_m.append(model().posture(measured).nearest().gap_m)
        time.sleep(0.05)
    return gaps_m


def work(robot: Robot) -> None:
    """Go home, be refused, stream both hands together and home again."""
    with robot.control() as own:
        own.enable(timeout=15.0)
        own.move_to(HOME).result(timeout=30.0)
        with pytest.raises(Rejected) as refused:
            own.move_to(TOGETHER)
        assert refused.value.code is Code.GOAL_TOO_NEAR and "left_palm and right_palm" in refused.value.message
        with own.left_arm.stream(rate_hz=20) as left, own.right_arm.stream(rate_hz=20) as right:
            streams = {"left": left, "right": right}
            gaps_m = lead(robot, streams, TOGETHER, 6.0)
            spacing = robot.state.spacing
            assert spacing is not None and spacing.on and spacing.held and spacing.gap_m is not None
            assert MARGIN_M - SAG_M <= min(gaps_m) < MARGIN_M + 0.01 and spacing.gap_m >= MARGIN_M - SAG_M
            gaps_m = lead(robot, streams, HOME, 6.0)
            assert min(gaps_m) >= MARGIN_M - SAG_M
            for side in Side:
                assert tuple(map(float, robot.state.arm(side.value).q_ref)) == pytest.approx(HOME_Q_RAD[side], abs=1e-6)


@pytest.mark.thorough
def test_both_hands_that_are_led_together_stop_before_they_meet(tmp_path: Path, systems: Systems) -> None:
    """Refused as a goal; as streams slowed down and held back with the margin left; led home again."""

    def attempt(folder: Path) -> list[str]:
        system = systems(folder, config="[model]\nself_collision = true\n")
        with system.connect("spacing") as robot:
            wait_for(lambda: is_on(robot), "arms that are kept apart", 5.0, lambda: str(robot.state.spacing))
            try:
                work(robot)
            except GatewayError as error:
                if error.code not in STARVED:
                    raise
                return [f"this host had no time: {error}"]
        system.close()
        return []

    steady(attempt, tmp_path)
