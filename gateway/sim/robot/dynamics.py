"""How the robot's parts move under what its rules ask of them: as lags and speeds, or as bodies with forces.

The rules (state machine, watchdogs, modes, clipping, ramps, torque table) are the same for both and know nothing of this;
a dynamics only turns them into motion.
"""

from __future__ import annotations

from gateway.sim.robot.manual import Side
from gateway.sim.robot.parts import Dynamics, Parts
from gateway.sim.robot.settings import SimSettings

__all__ = ["FirstOrder", "PhysicsMissing", "dynamics_of"]


class PhysicsMissing(ImportError):
    """MuJoCo was asked for and is not installed."""


class FirstOrder:
    """Every part moves by its own exact solution, whatever the length of the step."""

    def __init__(self, parts: Parts) -> None:
        self._parts = parts

    def move(self, now_ns: int, duration_ns: int) -> None:
        """Let time pass."""
        parts = self._parts
        for side in Side:
            parts.arms[side].move(duration_ns)
            parts.grippers[side].move(duration_ns)
        parts.chassis.move(duration_ns)
        if parts.lift is not None:
            parts.lift.move_to(now_ns + duration_ns)

    def begin(self, now_ns: int) -> None:
        """Nothing is ever lost."""

    def shed(self, now_ns: int) -> None:
        """Nothing is ever too late: a long step costs what a short one does."""

    def pace(self) -> None:
        """It has no time of its own."""

    def positions(self) -> None:
        """There is no scene."""

    def report(self) -> None:
        """There is nothing beyond the parts."""


def dynamics_of(settings: SimSettings, parts: Parts, start_ns: int) -> Dynamics:
    """Return the dynamics that the settings ask for.

    Raises:
        PhysicsMissing: MuJoCo is asked for and not installed.
    """
    if settings.physics == "kinematic":
        return FirstOrder(parts)
    try:
        from gateway.sim.physics.bodies import Bodies  # MuJoCo: only who asks for it has it
    except ModuleNotFoundError as error:
        if error.name != "mujoco":
            raise
        raise PhysicsMissing(
            "physics 'mujoco' needs MuJoCo, which is not installed: pip install 'teleavatar-gateway[sim]', "
            "in a checkout .venv/bin/pip install -e '.[sim]'"
        ) from error
    return Bodies(parts, start_ns, settings)
