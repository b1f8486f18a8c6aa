"""The robot's command side as one thing: all streams, the motions and targets that drive them, and the cuts.

It knows how an action of the supervisor's table is carried out; it does not know when (supervisor), whether (validation, gate)
or who asked (handler).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from functools import partial

from gateway.core.body.motions import Motion, MotionBook, MotionState
from gateway.core.body.targets import TargetBook
from gateway.core.motion.motion import Path, PosePath, plan, plan_poses
from gateway.core.motion.tolerance import first_beyond
from gateway.core.motion.tracker import Outcome
from gateway.core.streams.arm import ArmStream
from gateway.core.streams.chassis import ChassisStream
from gateway.core.streams.gripper import GripperStream
from gateway.core.streams.ground import LIFT_OFF, GroundStream
from gateway.core.streams.heartbeat import HeartbeatStream
from gateway.core.streams.lift import LiftStream
from gateway.core.streams.pose import PoseStream
from gateway.core.streams.setpoints import SetpointStream
from gateway.core.streams.stream import Stream
from gateway.errors import Code
from gateway.messages.snapshot import SlowingView, SpacingView, TouchView
from gateway.settings.settings import Settings
from gateway.values import Side, Space, Vector

__all__ = ["Body"]


class Body:
    """Streams and what drives them."""

    def __init__(self, settings: Settings) -> None:
        self.grippers = {side: GripperStream(side, partial(self._is_streamed, side)) for side in Side}
        self.joint_arms = {side: ArmStream(side, settings.arm) for side in Side}
        self.pose_arms = {side: PoseStream(side, settings.pose) for side in Side}
        self.arms: dict[Side, SetpointStream] = dict(self.joint_arms)
        """Per arm the stream of the space in which the robot takes its setpoints, as known when it was last chosen."""
        self.heartbeat = HeartbeatStream(settings.enable.zero_timeout_ns)
        self.chassis = ChassisStream(settings.chassis)
        self.lift = LiftStream() if settings.link.variant.has_lift else None
        self.motions = MotionBook(settings.arm, settings.pose)
        self.targets = TargetBook(settings.arm, settings.pose)
        self.speed_ratio = dict.fromkeys(Space, 1.0)
        """Part of their speed limits that the arms may have now: settings that were read anew may have lowered them."""
        self.gives_way = False
        """Whether references that are off by more than the bound are to be led to their arms once these are at rest."""
        self.spacing: SpacingView | None = None
        """How near parts of the body are to each other; None where nobody asked for them to be kept apart."""
        self.slowing: dict[Side, SlowingView] = {}
        """How near a singularity each arm is whose poses are streamed."""
        self.touches: dict[Side, TouchView] = {}
        """The last touch of each arm that ended what moved it."""
        self.drives: tuple[GroundStream, ...] = (self.chassis,) if self.lift is None else (self.chassis, self.lift)
        """Chassis and, where there is one, lift."""
        self.streams: tuple[Stream, ...] = (
            *self.grippers.values(),
            *self.joint_arms.values(),
            *self.pose_arms.values(),
            self.heartbeat,
            *self.drives,
        )
        """All streams. Grippers before their arms: 0.10 is there before the torque. Arms before the heartbeat, which never
        overtakes the setpoint of its tick."""

    def renew(self, settings: Settings) -> None:
        """Take settings that were read anew; speed limits from the next plan and the next target on, and never raised."""
        arm, pose = settings.arm, settings.pose
        joints = self.joint_arms[Side.LEFT].reference.space.limits
        hand = self.pose_arms[Side.LEFT].reference.space.limits
        self.speed_ratio[Space.JOINT] = min(arm.v_radps / joints.v_radps, 1.0)
        self.speed_ratio[Space.POSE] = min(pose.v_mps / hand.v_mps, pose.w_radps / hand.w_radps, 1.0)
        self.motions.renew(arm, pose)
        self.targets.renew(arm)

    def _is_streamed(self, side: Side) -> bool:
        return self.arms[side].running

    def stream(self, side: Side, space: Space) -> SetpointStream:
        """Return the stream of an arm in a space."""
        return self.joint_arms[side] if space is Space.JOINT else self.pose_arms[side]

    @property
    def running_arms(self) -> tuple[SetpointStream, ...]:
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

    def choose(self, side: Side, space: Space) -> None:
        """Make the stream of a space the arm's own; one of the other space falls silent first."""
        if self.arms[side].space is not space:
            self.arms[side].stop()
            self.arms[side] = self.stream(side, space)

    def plan(self, goals: Mapping[Side, Vector], speed: float) -> dict[Side, Path | PosePath]:
        """Plan one motion of the named arms, each in the space of its stream; those of one space end together.

        Raises:
            PlanFailed: A goal cannot be reached inside the limits, or no plan is found; nothing has changed.
        """
        joints = {side: goal for side, goal in goals.items() if self.arms[side].space is Space.JOINT}
        poses = {side: goal for side, goal in goals.items() if side not in joints}
        paths: dict[Side, Path | PosePath] = {}
        if joints:
            paths |= self.plan_joints(joints, speed)
        if poses:
            references = {side: self.pose_arms[side].reference for side in poses}
            paths |= plan_poses(references, poses, speed * self.speed_ratio[Space.POSE])
        return paths

    def plan_joints(self, goals: Mapping[Side, Vector], speed: float) -> dict[Side, Path]:
        """Plan one motion of the joints of the named arms, as `plan`."""
        references = {side: self.joint_arms[side].reference for side in goals}
        return plan(references, goals, speed * self.speed_ratio[Space.JOINT])

    def next_due_ns(self) -> int | None:
        """Return the earliest instant at which a stream is due [ns]; None when all are silent."""
        earliest_ns = None
        for stream in self.streams:
            due_ns = stream.next_due_ns()
            if due_ns is not None and (earliest_ns is None or due_ns < earliest_ns):
                earliest_ns = due_ns
        return earliest_ns

    # ------------------------------------------------------------------------------------------------ cuts

    def cut(self, code: Code, message: str) -> list[Motion]:
        """End all motions and streams of targets; running arms brake. Return the motions that ended.

        Args:
            code: Why, for the motions; later targets of the streams get STREAM_ENDED with it.
            message: The same in words.
        """
        self.gives_way, ended = False, list(self.motions.running)
        for motion in ended:
            self.motions.end(motion, MotionState.ABORTED, code, message)
        for stream in self.targets.running:
            self.targets.end(stream, code)
        for arm in self.running_arms:
            arm.brake()
        for gripper in self.grippers.values():
            gripper.cancel()
        return ended

    def ground_cut(self, code: Code, now_ns: int) -> None:
        """End the drives of chassis and lift, and stop what is being driven; what others drive is left alone."""
        for ground in self.drives:
            ground.cut(code, now_ns)

    def ground_stop(self, now_ns: int) -> None:
        """Stop chassis and lift, whoever drove them."""
        for ground in self.drives:
            ground.end(Code.STOPPED)
            ground.stop(now_ns)

    def lose_transport(self, now_ns: int) -> None:
        """What is under way to chassis and lift does not arrive."""
        for ground in self.drives:
            ground.lose(now_ns)

    def find_transport(self, now_ns: int) -> None:
        """Stop frames of chassis and lift that may not have arrived are sent again, if the robot still drives by them."""
        for ground in self.drives:
            ground.find(now_ns)

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
            for other in motion.goals:
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
            if not motion.is_planned:
                continue
            broken = self._broken(motion, measured)
            if broken is not None:
                self.motions.end(motion, MotionState.ABORTED, *broken)
            else:
                progress = {side: self.arms[side].reference.progress for side in motion.goals}
                self.motions.advance(motion, progress, motion.where(measured), now_ns)
            if motion.state is MotionState.ABORTED:  # nothing of it is sent any more, however much was left
                for side in motion.goals:
                    self.arms[side].brake()
        return [motion for motion in running if not motion.is_running]

    def _broken(self, motion: Motion, measured: Mapping[Side, Vector | None]) -> tuple[Code, str] | None:
        """Return why a trajectory cannot go on: it ran out, was lost, or an arm is too far from it."""
        if motion.terms is None:
            return None
        for side in motion.goals:
            tracker = self.stream(side, motion.space).reference.tracker
            if tracker is None:
                continue  # the arm was taken away in this tick, which ends the motion with a code of its own
            if tracker.outcome is Outcome.UNDERRUN:
                return Code.UNDERRUN, f"the {side} arm ran off the end of the chunk and no other followed: it brakes"
            if tracker.outcome is Outcome.LOST:
                return Code.CANNOT_JOIN, f"the {side} arm cannot follow the chunk inside its limits: it brakes"
            q_rad = measured[side]
            if q_rad is None or tracker.outcome is not None or not tracker.has_joined:
                continue
            tolerances = motion.terms.tolerances
            off = first_beyond(tolerances.space, tracker.place_in(0.0), q_rad, tolerances.path[side])
            if off is not None:
                text = f"{side} arm {off} from the trajectory, {off.bound} {off.unit} is asked for"
                return Code.PATH_TOLERANCE, f"{text} ({motion.progress:.0%} of it was sent)"
        return None

    def expire_targets(self, now_ns: int) -> Iterable[Side]:
        """Brake the arms whose last target has expired; return their sides."""
        sides = []
        for stream in self.targets.expired(now_ns):
            self.arms[stream.side].brake()
            sides.append(stream.side)
        return sides
