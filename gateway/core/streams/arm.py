"""One arm's stream of joint setpoints (manual §4.3): 100 Hz, from its seed on without a gap until it is stopped.

What moves the setpoint is the reference (`motion.py`); this class says when a setpoint is due and of which kind it is:
ECHO while it only repeats where the arm was found, MOTION while the owner's path or targets move it, WALK while a held
reference is led back to the arm, BRAKE while it comes to rest, HOLD while it repeats itself.
"""

from __future__ import annotations

from collections.abc import Iterator
from operator import sub

from gateway import robot
from gateway.core.events import Frame, FrameKind
from gateway.core.motion import JointLimits, JointReference, Path, ReferenceMode
from gateway.core.streams.grid import Grid
from gateway.core.streams.stream import SentLog
from gateway.settings import ArmSettings
from gateway.values import Side, Vector

__all__ = ["ArmStream"]


class ArmStream:
    """Joint setpoints of one arm.

    Args:
        side: Which arm.
        settings: Limits and rate.
    """

    def __init__(self, side: Side, settings: ArmSettings) -> None:
        self.topic = robot.joint_command(side)
        self.log = SentLog()
        limits = JointLimits(
            v_radps=settings.v_radps,
            a_radps2=settings.a_radps2,
            j_radps3=settings.j_radps3,
            lower_rad=tuple(settings.lower_rad[side]),
            upper_rad=tuple(settings.upper_rad[side]),
        )
        self.reference = JointReference(limits, 1.0 / settings.rate_hz)
        self.running = False
        """Whether frames are being sent."""
        self.epoch = 0
        """Lease epoch under which the latest motion was commanded; 0 when none was since the start."""
        self._grid = Grid(settings.rate_hz)
        self._is_first = False
        self._is_echoing = False
        self._is_walking = False

    def start(self, q_rad: Vector, now_ns: int) -> None:
        """Begin to echo a measured position; the only way in which the setpoint may jump.

        Args:
            q_rad: Where the arm is, shape (7,) [rad], inside the limits.
            now_ns: Monotonic time [ns].

        Raises:
            PlanFailed: It is not inside the limits; nothing has changed.
        """
        self.reference.seed(q_rad)
        self.epoch = 0
        self.running, self._is_first, self._is_echoing, self._is_walking = True, True, True, False
        self.log.end()
        self._grid.start(now_ns)

    def stop(self) -> None:
        """Go silent."""
        self.running = self._is_echoing = self._is_walking = False
        self.log.end()

    def go_live(self) -> None:
        """The robot follows now: what was an echo is a held reference from here on."""
        self._is_echoing = False

    def follow_path(self, path: Path, epoch: int) -> None:
        """Follow this arm's part of a planned path, for the owner of `epoch`."""
        self.reference.start(path)
        self.epoch, self._is_walking = epoch, False

    def follow_target(self, q_rad: Vector, speed: float, epoch: int) -> None:
        """Follow a streamed target, shape (7,) [rad], for the owner of `epoch`."""
        self.reference.follow(q_rad, speed)
        self.epoch, self._is_walking = epoch, False

    def walk(self, path: Path) -> None:
        """Lead the held reference back to the measured arm; nobody's motion."""
        self.reference.start(path)
        self.epoch, self._is_walking = 0, True

    def brake(self) -> None:
        """Come to rest inside the limits, then hold."""
        self._is_walking = False
        self.reference.brake()

    @property
    def is_at_rest(self) -> bool:
        """Whether the setpoint stands still; a path or a target may be pending."""
        return self.reference.is_at_rest

    @property
    def is_walking(self) -> bool:
        """Whether the reference is being led back to the arm."""
        return self._is_walking and self.reference.mode is ReferenceMode.PATH

    def distance_rad(self, q_rad: Vector) -> float:
        """Return the largest joint distance between the setpoint and a measured position [rad]."""
        distances: Iterator[float] = map(abs, map(sub, self.reference.q_rad, q_rad))
        return max(distances)

    def next_due_ns(self) -> int | None:
        """Return the next instant of the grid [ns]; None when silent."""
        return self._grid.next_ns() if self.running else None

    def _kind(self) -> FrameKind:
        if self._is_first:
            return FrameKind.ECHO
        mode = self.reference.mode
        if mode is ReferenceMode.BRAKE:
            return FrameKind.BRAKE
        if mode is ReferenceMode.HOLD:
            return FrameKind.ECHO if self._is_echoing else FrameKind.HOLD
        return FrameKind.WALK if self._is_walking else FrameKind.MOTION

    def frame(self, now_ns: int) -> Frame | None:
        """Return the setpoint that is due now, or None. The reference advances one nominal period per frame.

        Args:
            now_ns: Monotonic time [ns].
        """
        if not self.running:
            return None
        due_ns = self._grid.due(now_ns)
        if due_ns is None:
            return None
        kind = self._kind()
        self._is_first = False
        q_rad = self.reference.step()
        return Frame(topic=self.topic, values=q_rad, kind=kind, epoch=self.epoch, due_ns=due_ns)
