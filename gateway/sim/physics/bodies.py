"""The robot's parts as bodies: what its rules ask goes to motors, where the motors got to comes back.

Physics has a time of its own: steps of 2 ms on an absolute grid, whatever the steps of the robot, so that the same
messages at the same times give the same world. What the rules ask is taken at the grid's points. A machine that is too
slow for it loses time of physics, never time of the robot: watchdogs and rates stay those of the clock, motions become
slower, and the real-time factor says by how much.
"""

from __future__ import annotations

from typing import Final

from gateway.sim.physics.scene import STEP_NS, THINGS
from gateway.sim.physics.world import World
from gateway.sim.robot.chassis import wheel_matrix
from gateway.sim.robot.manual import MS, S, Side
from gateway.sim.robot.parts import Parts
from gateway.sim.robot.settings import SimSettings

__all__ = ["Bodies"]

_PATIENCE_NS: Final = 20 * MS
"""Further behind than this, time of physics is given up [ns]."""

_SLOW: Final = 0.95
"""A real-time factor below this is told: at once, then with the worst of every ..."""

_TOLD_EVERY_NS: Final = 30 * S
"""... while [ns], and once when it is over."""


class Bodies:
    """Moves the parts in a world with forces.

    Attributes:
        world: The world.
        real_time_factor: Time of physics per time of the robot over the last full second; None before the first.
    """

    def __init__(self, parts: Parts, start_ns: int, settings: SimSettings) -> None:
        """Put the robot where its parts say it is, at rest."""
        self._parts = parts
        self.world = World(has_lift=parts.lift is not None)
        self.real_time_factor: float | None = None
        self._matrix = wheel_matrix()
        self._due_ns = start_ns + STEP_NS
        self._lost_ns = 0
        self._mark_ns, self._mark_steps = start_ns, 0
        self._worst = 1.0
        self._tell_ns: int | None = None  # again, while it is too slow
        if settings.differs_percent:
            noise = self.world.differ(settings.differs_percent, settings.seed)
            for side in Side:
                parts.arms[side].effort_noise_nm = noise[side]
        self.world.pose_base(settings.start_x_m)
        for side in Side:
            self.world.pose_arm(side, parts.arms[side].q_rad)
            gripper = parts.grippers[side]
            self.world.pose_gripper(side, gripper.angle_rad)
            if gripper.object_rad is not None:
                self.world.block_gripper(side, min(gripper.object_rad, gripper.angle_rad))
        if parts.lift is not None:
            self.world.pose_lift(parts.lift.lowered_m)
        self._sense()

    def move(self, now_ns: int, duration_ns: int) -> None:
        """Let time pass.

        Raises:
            WorldUnstable: The solver gave up.
        """
        end_ns = now_ns + duration_ns
        has_stepped = False
        while self._due_ns <= end_ns:
            self._drive(now_ns, self._due_ns)
            self.world.step()
            now_ns, self._due_ns = self._due_ns, self._due_ns + STEP_NS
            has_stepped = True
        if now_ns < end_ns:
            self._drive(now_ns, end_ns)
        if has_stepped:
            self._sense()
        if end_ns - self._mark_ns >= S:
            self._judge(end_ns)

    def _drive(self, now_ns: int, until_ns: int) -> None:
        """Let the rules' own references move on, and tell the motors."""
        parts, world, duration_ns = self._parts, self.world, until_ns - now_ns
        for side in Side:
            world.drive(side, parts.arms[side].guide(duration_ns))
            world.grip(side, parts.grippers[side].effort_nm)
            world.hold(side, parts.arms[side].load_kg)
        parts.chassis.move(duration_ns)
        world.roll(self._matrix @ parts.chassis.velocity)
        if parts.lift is not None:
            parts.lift.move_to(until_ns)
            world.lower(parts.lift.lowered_m)

    def _sense(self) -> None:
        for side in Side:
            self._parts.arms[side].place(*self.world.arm(side))
            self._parts.grippers[side].place(*self.world.gripper(side))

    def _judge(self, now_ns: int) -> None:
        """Say how fast time passes in here."""
        passed_ns = (self.world.steps - self._mark_steps) * STEP_NS
        factor = passed_ns / (now_ns - self._mark_ns)
        is_first = self.real_time_factor is None
        self.real_time_factor = factor
        self._mark_ns, self._mark_steps = now_ns, self.world.steps
        if factor >= _SLOW:
            if is_first or self._tell_ns is not None:
                self._parts.journal.note(now_ns, "PHYSICS", "physics", f"real-time factor {factor:.2f}")
            self._tell_ns = None
            return
        self._worst = min(self._worst, factor)
        if self._tell_ns is None or now_ns >= self._tell_ns:
            text = f"real-time factor {self._worst:.2f}: motions are slower than a robot's"
            self._parts.journal.note(now_ns, "PHYSICS_SLOW", "physics", f"{text}, this machine is too busy or too slow")
            self._worst, self._tell_ns = 1.0, now_ns + _TOLD_EVERY_NS

    def shed(self, now_ns: int) -> None:
        """Give up whole steps that are more than 20 ms behind."""
        steps = (now_ns - _PATIENCE_NS - self._due_ns) // STEP_NS + 1
        if steps > 0:
            self._due_ns += steps * STEP_NS
            self._lost_ns += steps * STEP_NS

    def begin(self, now_ns: int) -> None:
        """Go on from now: what took long before anything moved is no lost time."""
        self._due_ns += max((now_ns - self._due_ns) // STEP_NS + 1, 0) * STEP_NS
        self._lost_ns, self._mark_ns, self._mark_steps = 0, now_ns, self.world.steps

    def pace(self) -> dict[str, object]:
        """Return how time passes in here: as physics has it, what was lost, and the factor."""
        return {
            "time_s": self.world.time_s,
            "lost_s": self._lost_ns / S,
            "real_time_factor": self.real_time_factor,
        }

    def positions(self) -> list[float]:
        """Return where everything is, for who draws it."""
        return self.world.positions()

    def report(self) -> dict[str, object]:
        """Return the world's true state: places on the ground's frame, x forward at the start, z up."""
        x_m, y_m, yaw_rad = self.world.base()
        return {
            **self.pace(),
            "base": {"x_m": x_m, "y_m": y_m, "yaw_rad": yaw_rad},
            "lowered_m": self.world.lowered_m(),
            "openings_m": {side.value: self.world.opening_m(side) for side in Side},
            "things": {name: _placed(self.world, name) for name in THINGS},
            "hands": {side.value: _placed(self.world, f"{side.value}_ee") for side in Side},
        }


def _placed(world: World, name: str) -> dict[str, object]:
    place = world.place(name)
    return {"position_m": list(place.position_m), "quat_xyzw": list(place.quat_xyzw)}
