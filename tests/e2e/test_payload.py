"""Weighing end to end, on a robot with forces whose masses and friction are up to 8 % off and whose efforts are noisy."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from gateway.client import Control, Payload, Robot
from gateway.errors import GatewayError
from gateway.robot.limits import HOME_Q_RAD
from gateway.sim.physics.robot_xml import PADS_M
from gateway.values import Side
from tests.e2e.system import System, wait_for
from tests.sim.physics.mujoco_needed import REASON

pytest.importorskip("mujoco", reason=REASON)
pytest.importorskip("pinocchio", reason="pinocchio is not installed: pip install 'teleavatar-gateway[body]'")

pytestmark = [
    pytest.mark.e2e,
    pytest.mark.alone,
    pytest.mark.sim_only("what is weighed hangs in the simulation with forces, whatever the wire is"),
]

HELD_KG = 0.3
ATTEMPTS = 6
"""Each takes ten seconds, and any stall of a tenth of a second rightly ends it."""


def persistently(robot: Robot, do: Callable[[Control], Payload]) -> Payload:
    """Own the robot, enable it and do something; again where a machine that stood still ended it."""
    for attempt in range(ATTEMPTS):
        try:
            with robot.control(take="weigh", on_exit="hold") as own:
                own.enable(timeout=15.0)
                return do(own)
        except GatewayError:
            if attempt == ATTEMPTS - 1:
                raise
    raise AssertionError


def test_what_the_hand_holds_is_weighed_to_a_tenth_on_a_robot_that_differs(
    tmp_path: Path, systems: Callable[..., System]
) -> None:
    """Beside the empty hand: its own moving parts, and what the masses are off by, are no part of it."""
    system = systems(
        tmp_path,
        config="[model]\ndynamics = true\n[arm]\nsettle_ms = 100\n",
        sim_options=("--physics", "mujoco", "--differs", "8", "--seed", "5"),
        has_guard=False,
    )
    with system.connect("weigher") as robot:

        def empty_hand(own: Control) -> Payload:
            own.left_arm.move_to(HOME_Q_RAD[Side.LEFT]).result(timeout=60.0)
            wait_for(lambda: robot.state.left_arm.contact.is_known, "a model that agrees", tell=system.logs)
            return own.left_arm.payload()

        def full_hand(own: Control) -> Payload:
            own.left_arm.move_to(empty.q_rad[0]).result(timeout=60.0)
            return own.left_arm.payload(empty=empty)

        empty = persistently(robot, empty_hand)
        system.control.ask("fault", fault="load", side="left", kg=HELD_KG)
        found = persistently(robot, full_hand)
        told = wait_for(lambda: robot.state.left_arm.contact.payload, "a payload that is counted on", tell=system.logs)
    assert found.mass == pytest.approx(HELD_KG, rel=0.1) and told.mass == found.mass
    assert found.com is not None and np.abs(np.array(found.com[:2]) - PADS_M[:2]).max() < 0.05
    assert empty.mass > 0.05, "the hand's moving parts, which no description has"
