"""The parts that move, and what a dynamics does with them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

from gateway.sim.robot.arm import SimArm
from gateway.sim.robot.chassis import SimChassis
from gateway.sim.robot.gripper import SimGripper
from gateway.sim.robot.journal import Journal
from gateway.sim.robot.lift import SimLift
from gateway.sim.robot.manual import Side

__all__ = ["Dynamics", "Parts", "WorldUnstable"]


class WorldUnstable(RuntimeError):
    """The solver lost the world: positions or speeds became invalid."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Parts:
    """The parts that move.

    Attributes:
        arms: By side.
        grippers: By side.
        chassis: Chassis.
        lift: Lift, None on models without one.
        journal: For what there is to tell.
    """

    arms: Mapping[Side, SimArm]
    grippers: Mapping[Side, SimGripper]
    chassis: SimChassis
    lift: SimLift | None
    journal: Journal


class Dynamics(Protocol):
    """Moves the parts."""

    def move(self, now_ns: int, duration_ns: int) -> None:
        """Let time pass; nothing changes about what the rules ask meanwhile.

        Raises:
            WorldUnstable: Forces had no solution.
        """

    def begin(self, now_ns: int) -> None:
        """Go on from now: what took long before anything moved is no lost time."""

    def shed(self, now_ns: int) -> None:
        """Give up what can no longer be caught up with: for who steps in real time, before each step."""

    def pace(self) -> dict[str, object] | None:
        """Return how its own time passes, JSON-able; None where it has none."""

    def positions(self) -> list[float] | None:
        """Return where everything is, for who draws the scene; None where there is none."""

    def report(self) -> dict[str, object] | None:
        """Return what there is to tell beyond the parts, JSON-able; None for nothing."""
