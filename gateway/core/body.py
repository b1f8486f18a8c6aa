"""The robot's command side as one thing: all streams, the motions and targets that drive them, and the cuts.

It knows how an action of the supervisor's table is carried out; it does not know when (supervisor), whether (door, gate)
or who asked (desk).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from gateway import robot
from gateway.core.motions import Motion, MotionBook, MotionState
from gateway.core.streams.arm import ArmStream
from gateway.core.streams.ground import LIFT_OFF, StopRepeater
from gateway.core.streams.heartbeat import HeartbeatStream
from gateway.core.streams.stream import Stream
from gateway.core.targets import TargetBook
from gateway.errors import Code
from gateway.settings import Settings
from gateway.values import Side, Vector

__all__ = ["Body"]


class Body:
    """Streams and what drives them.

    Args:
        settings: Limits, rates and the robot's model.
    """

    def __init__(self, settings: Settings) -> None:
        self.arms = {side: ArmStream(side, settings.arm) for side in Side}
        self.heartbeat = HeartbeatStream(settings.enable.zero_timeout_ns)
        self.chassis = StopRepeater(robot.CHASSIS_VELOCITY)
        self.lift = StopRepeater(robot.LIFT_COMMAND) if settings.link.variant.has_lift else None
        self.motions = MotionBook(settings.arm)
        self.targets = TargetBook(settings.arm)
        ground: tuple[Stream, ...] = (self.chassis,) if self.lift is None else (self.chassis, self.lift)
        self.streams: tuple[Stream, ...] = (*self.arms.values(), self.heartbeat, *ground)
        """All streams, arms first: a heartbeat never overtakes the setpoint of its tick."""

    @property
    def running_arms(self) -> tuple[ArmStream, ...]:
        """Arm streams that send."""
        return tuple(arm for arm in self.arms.values() if arm.running)

    @property
    def is_at_rest(self) -> bool:
        """Whether no running arm stream moves its setpoint."""
        return all(arm.is_at_rest for arm in self.running_arms)

    @property
    def is_walking(self) -> bool:
        """Whether a held reference is being led back to its arm."""
        return any(arm.is_walking for arm in self.running_arms)

    def next_due_ns(self) -> int | None:
        """Return the earliest instant at which a stream is due [ns]; None when all are silent."""
        instants = [due for due in (stream.next_due_ns() for stream in self.streams) if due is not None]
        return min(instants, default=None)

    # ------------------------------------------------------------------------------------------------ cuts

    def cut(self, code: Code, message: str) -> list[Motion]:
        """End all motions and streams of targets; running arms brake. Return the motions that ended.

        Args:
            code: Why, for the motions; later targets of the streams get STREAM_ENDED with it.
            message: The same in words.
        """
        ended = list(self.motions.running)
        for motion in ended:
            self.motions.end(motion, MotionState.ABORTED, code, message)
        for stream in self.targets.running:
            self.targets.end(stream, code)
        for arm in self.running_arms:
            arm.brake()
        return ended

    def ground_stop(self, now_ns: int) -> None:
        """Stop chassis and lift, whoever drove them."""
        self.chassis.stop(now_ns)
        if self.lift is not None:
            self.lift.stop(now_ns)

    def lift_off(self, now_ns: int) -> None:
        """Take the lift's servo off after it has stopped; only where a stop of ours is under way or was asked for."""
        if self.lift is not None and self.lift.running:
            self.lift.then(LIFT_OFF)

    def silence_arms(self) -> None:
        """Stop all arm streams."""
        for arm in self.running_arms:
            arm.stop()

    # ------------------------------------------------------------------------------------------------ one arm's driver

    def drop_driver(self, side: Side, state: MotionState, code: Code, message: str) -> list[Motion]:
        """End what drives an arm; the other arms of a shared motion brake and hold. Return the motions that ended."""
        ended = []
        motion = self.motions.of(side)
        if motion is not None:
            self.motions.end(motion, state, code, message)
            ended.append(motion)
            for other in motion.goals_rad:
                self.arms[other].brake()
        stream = self.targets.of(side)
        if stream is not None:
            self.targets.end(stream, code)
            self.arms[side].brake()
        return ended

    def advance_motions(self, measured: Mapping[Side, Vector | None], now_ns: int) -> list[Motion]:
        """Take note of what was sent and measured; return the motions that ended."""
        running = self.motions.running
        for motion in running:
            progress = {side: self.arms[side].reference.progress for side in motion.goals_rad}
            self.motions.advance(motion, progress, measured, now_ns)
        return [motion for motion in running if not motion.is_running]

    def expire_targets(self, now_ns: int) -> Iterable[Side]:
        """Brake the arms whose last target has expired; return their sides."""
        sides = []
        for stream in self.targets.expired(now_ns):
            self.arms[stream.side].brake()
            sides.append(stream.side)
        return sides
