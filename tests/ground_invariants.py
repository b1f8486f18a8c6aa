"""The invariants of the design for grippers, chassis and lift, judged on every tick by what left and what the robot did."""

from __future__ import annotations

from gateway.core.engine import Output
from gateway.core.messages.outputs import Frame, FrameKind
from gateway.robot.topics import CHASSIS_VELOCITY, LIFT_COMMAND, gripper_command, joint_command, pose_command
from gateway.values import Side, Vector
from tests.pair import MS, Pair, S

__all__ = ["GROUND_TOPICS", "GroundMonitor"]

WHEELS, LIFT = CHASSIS_VELOCITY, LIFT_COMMAND
GROUND_TOPICS = (WHEELS, LIFT)
HEARD = {side: (pose_command(side), joint_command(side)) for side in Side}
"""Per arm what it listens to in its control mode (manual §2.3)."""
GRIPS = {gripper_command(side): side for side in Side}
DRIVEN_IN = {"IDLE", "ENABLING", "ACTIVE", "HOLDING"}
HELD_IN = {"ACTIVE", "HOLDING"}
ZEROS: Vector = (0.0, 0.0, 0.0)


class _Ground:
    """What was sent to one group since it was last silent."""

    def __init__(self) -> None:
        self.last: Vector | None = None
        self.was_driven = False
        self.is_excused = False
        self.stops_since_ns: int | None = None
        self.last_stop_ns = 0


class GroundMonitor:
    """Watches chassis, lift and grippers of a pair.

    Args:
        pair: The pair.
    """

    def __init__(self, pair: Pair) -> None:
        self.pair = pair
        self.grounds = {topic: _Ground() for topic in GROUND_TOPICS}
        self.grips: dict[str, float] = {}
        self.engaged = dict.fromkeys(Side, False)
        self.unsolved = dict.fromkeys(Side, (0, -S))
        """Per arm how many poses the robot's IK refused, and when that number rose last [ns]."""
        self.held_since_ns: int | None = None
        self.may_drive = False
        """Whether a velocity was accepted since the last stop, and since the state last forbade one."""
        self.driven = 0
        self.gripped = 0
        self.is_beside_gateway = False
        """Whether another gateway is armed: the lift is its business."""

    def note_restart(self) -> None:
        """The daemon died: what it sent is over; what ends it is the guard's (DESIGN §8.8)."""
        self.grounds = {topic: _Ground() for topic in GROUND_TOPICS}
        self.grips.clear()
        self.may_drive, self.held_since_ns = False, None

    def see(self, output: Output, *, state: str, epoch: int, is_latched: bool, is_late: bool) -> None:
        """Judge one tick.

        Args:
            output: Of the engine.
            state: Of the supervisor, after the tick.
            epoch: The newest one that was given.
            is_latched: Whether a latch refuses motion.
            is_late: Whether a tick was late within the last moments.
        """
        pair = self.pair
        stopped = any("stop_undelivered" in reply.facts for reply in output.replies)
        self.may_drive = self.may_drive and state in DRIVEN_IN and not stopped
        self.may_drive = self.may_drive or any("drive_id" in reply.facts for reply in output.replies)
        for frame in output.frames:
            if frame.topic in self.grounds:
                self._ground(frame, state, epoch, is_latched)
            elif frame.topic in GRIPS:
                self._grip(frame)
        running = set(pair.engine.running_topics)
        for topic, ground in self.grounds.items():
            theirs = not pair.is_up or not pair.robot.api_mode or pair.robot.fsm.published not in (-1, 0, 1, 2)
            ground.is_excused = ground.is_excused or theirs or self.is_beside_gateway
            if topic not in running:
                self._ended(topic, ground)
                self.grounds[topic] = _Ground()
        for topic in GRIPS.keys() - running:
            self.grips.pop(topic, None)
        self._torque(state, running, is_late=is_late)
        counts = pair.robot.journal.counts
        for what in ("CHASSIS_NODE_DIED", "CHASSIS_SPEED_INVALID", "REFUSED_RANGE", "REFUSED_LIFT"):
            assert not counts.get(what), f"the robot complains: {what} (2)"

    def _ground(self, frame: Frame, state: str, epoch: int, is_latched: bool) -> None:
        ground, now_ns = self.grounds[frame.topic], self.pair.now_ns
        if frame.kind is FrameKind.STOP:
            stops = {WHEELS: (ZEROS,), LIFT: ((0.0, 1.0), (0.0, 0.0))}[frame.topic]
            assert frame.values in stops, f"{frame} is no stop (2)"
            if ground.stops_since_ns is None:
                ground.stops_since_ns = now_ns
            ground.last_stop_ns = now_ns
        else:
            self.driven += 1
            assert frame.kind is FrameKind.MOTION and state in DRIVEN_IN, f"{frame} left in {state} (3)"
            assert self.may_drive, f"{frame} left without a velocity that was accepted since the last stop (5)"
            assert frame.epoch == epoch, f"{frame} left, {epoch} owns (6)"
            assert not is_latched, f"{frame} left while something is latched (3)"
            age_ns = self.pair.state_age_ns
            assert age_ns is not None and age_ns <= 100 * MS, f"{frame} left with state {age_ns} ns old (3)"
            ground.was_driven, ground.stops_since_ns = True, None
            if frame.topic == WHEELS:
                self._ramp(ground.last or ZEROS, frame.values)
        ground.last = frame.values

    def _ramp(self, before: Vector, after: Vector) -> None:
        """Invariant 1: what is commanded the robot can follow."""
        settings = self.pair.settings.chassis
        for old, new in zip(before, after, strict=True):
            grows = abs(new) > abs(old) and old * new >= 0.0
            bound = (settings.up_mps2 if grows else settings.down_mps2) * 0.05 + 1e-6
            assert abs(new - old) <= bound, f"{before} -> {after} is no ramp (1)"
        assert max(map(abs, after[:2])) <= settings.v_mps + 1e-9 and abs(after[2]) <= settings.w_radps + 1e-9

    def _ended(self, topic: str, ground: _Ground) -> None:
        """Invariant 8: a second of zeros, or servo off."""
        if not ground.was_driven:
            return
        if topic == WHEELS:
            since_ns = ground.stops_since_ns
            assert since_ns is not None and ground.last_stop_ns - since_ns >= 1 * S, "too few zeros at the end (8)"
        else:
            assert ground.last == (0.0, 0.0) or ground.is_excused, f"the lift ended with {ground.last} (8)"

    def _grip(self, frame: Frame) -> None:
        last = self.grips.get(frame.topic)
        if frame.kind is FrameKind.HOLD:
            assert last is None or frame.values == (last,), f"{frame} after {last}: a hold changes nothing (3)"
        elif frame.kind is FrameKind.MOTION:
            self.gripped += 1
        (self.grips[frame.topic],) = frame.values

    def _torque(self, state: str, running: set[str], *, is_late: bool) -> None:
        """A gripper's torque is never cancelled for want of arm frames while the robot is held.

        A pose that the robot's IK cannot solve is not passed on to the motors (manual §4.10), and it is their stream that
        keeps the torque (§4.4). Nobody is told of it, so nobody can keep that grip.
        """
        pair = self.pair
        is_held = state in HELD_IN and pair.is_up and not pair.is_frozen and not pair.is_deaf and not is_late
        if not is_held:
            self.held_since_ns = None
        elif self.held_since_ns is None:
            self.held_since_ns = pair.now_ns
        lasted = self.held_since_ns is not None and pair.now_ns - self.held_since_ns > 300 * MS
        for topic, side in GRIPS.items():
            is_engaged = pair.robot.grippers[side].is_engaged
            arm = pair.robot.arms[side]
            lives = pair.robot.fsm.published in (1, 2) and arm.is_enabled and pair.robot.api_mode
            lives = lives and HEARD[side][int(arm.mode)] in running  # else it hears none of our frames
            if arm.unsolved != self.unsolved[side][0]:
                self.unsolved[side] = (arm.unsolved, pair.now_ns)
            lives = lives and pair.now_ns - self.unsolved[side][1] > 100 * MS
            if self.engaged[side] and not is_engaged and lasted and lives and topic in self.grips:
                raise AssertionError(f"the {side} gripper lost its torque in {state} (grip)")
            self.engaged[side] = is_engaged
