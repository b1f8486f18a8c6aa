"""A hand that yields, end to end: a real daemon that feels, public API. How it moves is proven in virtual time."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from gateway.client import Robot
from gateway.errors import Code, GatewayError, Rejected
from tests.e2e.system import System, wait_for

pytest.importorskip("pinocchio", reason="pinocchio is not installed: pip install 'teleavatar-gateway[body]'")

pytestmark = [
    pytest.mark.e2e,
    pytest.mark.timeout(200),
    pytest.mark.sim_only("its efforts are made up: whatever they push, the way there and back is the same"),
]

Systems = Callable[..., System]
YIELDS = {"frame": "left_shoulder_base", "mass_kg": 10.0, "damping": 1000.0, "speed": 0.01}


def attempt(robot: Robot) -> tuple[str, int]:
    """Let the hand yield for a moment; return the code of what went wrong, and how many signs of life were heard."""
    try:
        with robot.control() as own:
            own.enable(timeout=15.0)
            with pytest.raises(Rejected) as light, own.left_arm.stream("admittance", **{**YIELDS, "damping": 1.0}):
                pass
            assert light.value.bound == "[150, 2000]" and light.value.unit == "N·s/m"
            with own.left_arm.stream("admittance", **YIELDS) as hand:
                for _ in range(10):
                    hand.tick()
                return "", hand.accepted
    except GatewayError as error:  # a machine without time for the robot gives many of them; what lasts fails the test
        return str(error.code), 0


def test_a_client_lets_the_hand_of_a_robot_that_feels_yield(tmp_path: Path, systems: Systems) -> None:
    """As soon as what pulls is known; a mass that might swing is refused with its bound."""
    system = systems(tmp_path, config="[model]\ndynamics = true\n", sim_options=("--left-mode", "pose"))
    seen: list[tuple[str, int]] = []

    def is_heard() -> bool:
        seen.append(attempt(robot))
        return seen[-1][1] > 0

    with system.connect("yielding") as robot:
        wait_for(is_heard, "a hand that yields", 60.0, lambda: f"{seen[-3:]}{system.logs()}")
        assert all(code in set(Code) for code, _ in seen if code)
