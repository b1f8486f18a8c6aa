"""Carries out the owner's trajectories and action chunks: judged whole, joined to the running motion, replaced without a stop.

A chunk has a clock of its own, which runs from its beginning on: `start_at` says when that was or will be. Points whose
time has passed when it arrives are skipped by that clock, not by an estimate of its delay; one that begins in the future
lets the arm go on with the chunk under way until then. A later chunk of the same arms takes the place of what is left.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from gateway.core.body.motions import MotionState, Terms
from gateway.core.limits.pose_validation import check_frame
from gateway.core.messages.events import CommandRequested
from gateway.core.motion.chunk import Chunk, check_jump, check_motion, check_start, prepare
from gateway.core.motion.joints.trajectory import Trajectory
from gateway.core.motion.poses.pose_chunk import check_pose_jump, check_pose_motion
from gateway.core.motion.poses.pose_follower import followed
from gateway.core.motion.poses.pose_trajectory import PoseTrajectory
from gateway.core.motion.tolerance import Tolerances, apart, check_tolerances
from gateway.core.requests.authorisation import Authorisation
from gateway.core.requests.moves import Answer, Moves
from gateway.core.separation.goal_checks import check_goals
from gateway.core.supervision.coordinator import Coordinator
from gateway.core.supervision.supervisor import Trigger
from gateway.errors import Code, Refusal
from gateway.messages.requests import CheckFollow, Follow
from gateway.values import ARM_DOF, Side, Space, Vector

__all__ = ["Follows", "worked_out"]

S = 1_000_000_000


def worked_out(request: Follow | CheckFollow) -> Chunk | Refusal:
    """Return the motion through the points of a chunk, or why there is none.

    It takes milliseconds, which the loop does not have: who reads requests does it, and hands it on with the event.
    """
    follow = request.follow if isinstance(request, CheckFollow) else request
    return prepare(
        follow.points,
        dt_s=follow.dt_s,
        times_s=follow.times_s,
        stretch=follow.stretch,
        smoothing_s=follow.smoothing_s,
        space=follow.space,
    )


class Follows:
    """Trajectories and chunks of the owner."""

    def __init__(self, coordinator: Coordinator, authorisation: Authorisation, moves: Moves) -> None:
        self._coordinator = coordinator
        self._authorisation = authorisation
        self._moves = moves

    def follow(self, command: CommandRequested, request: Follow, now_ns: int) -> Answer:
        """Judge a chunk whole, then begin to follow it with one or both arms."""
        coordinator, chunk = self._coordinator, command.chunk or worked_out(request)
        if isinstance(chunk, Refusal):
            return chunk
        sides = tuple(chunk.trajectories)
        refusal = self._authorisation.motion(command, request.epoch, sides, now_ns, chunk.space)
        if refusal is not None:
            return refusal
        feelers = self._moves.touches.feelers(command, request, sides, now_ns)
        if isinstance(feelers, Refusal):
            return feelers
        judged = self._judge(command, request, chunk, now_ns)
        if isinstance(judged, Refusal):
            return judged
        tolerances, begins_ns = judged
        into_s = (now_ns - begins_ns) / S
        tracks: dict[Side, Callable[[], None]] = {}
        for side in sides:
            track = self._join(side, request, chunk, into_s)
            if isinstance(track, Refusal):
                return track
            tracks[side] = track
        self._moves.free(sides, MotionState.SUPERSEDED, Code.SUPERSEDED, "a later chunk took the arm over", now_ns)
        coordinator.fire(Trigger.ARM_MOTION, now_ns, "the owner's chunk is followed")
        goals = {side: trajectory.points[-1] for side, trajectory in chunk.trajectories.items()}
        ends_ns = begins_ns + round(chunk.duration_s * S)
        terms = Terms(tolerances=tolerances, ends_ns=ends_ns)
        motion = coordinator.body.motions.open(goals, None, ends_ns - now_ns, terms=terms, space=chunk.space)
        motion.feelers = feelers
        for track in tracks.values():
            track()
        return {
            "motion_id": motion.motion_id,
            "duration_ns": motion.duration_ns,
            "begins_ns": begins_ns,
            "q_rad" if chunk.space is Space.JOINT else "values": {side.value: list(q) for side, q in goals.items()},
            "skipped": _passed(chunk, into_s),
            "moved": chunk.moved,
        }

    def check(self, command: CommandRequested, request: CheckFollow, now_ns: int) -> Answer:
        """Judge a chunk as `follow` does, for anybody and in any state; nothing changes.

        What a motion needs besides (lease, mode, fresh state) is told by the snapshot's refusals. The way onto the
        trajectory is not planned: that is done in the tick in which it is followed.
        """
        follow, chunk = request.follow, command.chunk or worked_out(request)
        if isinstance(chunk, Refusal):
            return chunk
        judged = self._judge(command, follow, chunk, now_ns)
        if isinstance(judged, Refusal):
            return judged
        into_s = (now_ns - judged[1]) / S
        away: dict[str, list[float]] = {}
        for side, trajectory in chunk.trajectories.items():
            here, begin = (
                self._whereabouts(side, chunk, into_s, now_ns, rests=not follow.open_end),
                trajectory.at(into_s)[0],
            )
            if here is not None:
                jump = _check_jump(side, chunk.space, begin, into_s, here)
                away[side.value] = list(apart(chunk.space, begin, here))
            else:
                jump = Refusal(
                    code=Code.PART_STALE,
                    message=f"nobody knows where the {side} arm is: its state is older than 100 ms",
                    field=f"{side}_arm",
                )
            if jump is not None and request.from_here:
                return jump
        return {
            "duration_ns": round(chunk.duration_s * S),
            "skipped": _passed(chunk, into_s),
            "moved": chunk.moved,
            "away": away,
        }

    def _judge(
        self, command: CommandRequested, request: Follow, chunk: Chunk, now_ns: int
    ) -> tuple[Tolerances, int] | Refusal:
        """Judge a chunk as such: return its tolerances and when its first point is passed [ns], or what is wrong with it."""
        tolerances = self._tolerances(request, chunk)
        if isinstance(tolerances, Refusal):
            return tolerances
        begins_ns = _begins_ns(command, request, now_ns) + round(chunk.offset_s * S)
        refusal = check_start(now_ns - begins_ns, chunk.duration_s)
        for side in chunk.trajectories:
            refusal = refusal or self._objection(side, request, chunk.trajectories[side])
        if chunk.space is Space.JOINT:
            goals = {side: trajectory.points[-1] for side, trajectory in chunk.trajectories.items()}
            refusal = refusal or check_goals(self._coordinator, goals, now_ns)
        return refusal or (tolerances, begins_ns)

    def _whereabouts(self, side: Side, chunk: Chunk, into_s: float, now_ns: int, *, rests: bool) -> Vector | None:
        """Return where an arm will be when a chunk begins: its reference, else where it was measured; None: unknown."""
        arm, trajectory = self._coordinator.body.stream(side, chunk.space), chunk.trajectories[side]
        if arm.running:
            return arm.reference.origin(arm.reference.prepare(trajectory, into_s, rests=rests))
        store, needs_pose = self._coordinator.store, chunk.space is Space.POSE
        if not store.part_fresh(side, now_ns, needs_pose=needs_pose):
            return None
        pose, measured = store.pose(side), store.arm(side)
        if needs_pose:
            return None if pose is None else pose.values
        return None if measured is None else measured.q_rad

    def _tolerances(self, request: Follow, chunk: Chunk) -> Tolerances | Refusal:
        arm, pose, space = self._coordinator.settings.arm, self._coordinator.settings.pose, chunk.space
        return check_tolerances(
            tuple(chunk.trajectories),
            request.path_tolerance,
            request.goal_tolerance,
            request.goal_time_ns,
            (arm.settle_rad,) * ARM_DOF if space is Space.JOINT else (pose.settle_m, pose.settle_rad),
            arm.settle_timeout_ns,
            space,
        )

    def _objection(self, side: Side, request: Follow, trajectory: Trajectory | PoseTrajectory) -> Refusal | None:
        """Return what is wrong with the motion of an arm as such."""
        if isinstance(trajectory, Trajectory):
            return check_motion(side, trajectory, self._coordinator.settings.arm)
        body = self._coordinator.body
        bounds = followed(body.pose_arms[side].reference.space, body.speed_ratio[Space.POSE])
        return check_frame(side, request.frames.get(side, "")) or check_pose_motion(side, trajectory, bounds)

    def _join(self, side: Side, request: Follow, chunk: Chunk, into_s: float) -> Callable[[], None] | Refusal:
        """Find an arm's way onto its trajectory; return what takes it, or why there is none."""
        arm, trajectory = self._coordinator.body.stream(side, chunk.space), chunk.trajectories[side]
        way = arm.reference.prepare(trajectory, into_s, rests=not request.open_end)
        jump = _check_jump(side, chunk.space, trajectory.at(into_s)[0], into_s, arm.reference.origin(way))
        if jump is not None:
            return jump
        if arm.reference.begin(way):
            return partial(arm.follow_chunk, way, request.epoch)
        return Refusal(
            code=Code.CANNOT_JOIN,
            message=f"the {side} arm cannot get onto the chunk inside its limits before it is over or gone",
            field=f"{side}_arm",
        )


def _check_jump(side: Side, space: Space, begin: Vector, into_s: float, here: Vector) -> Refusal | None:
    if space is Space.POSE:
        return check_pose_jump(side, begin, here)
    return check_jump(side, begin, into_s, here)


def _begins_ns(command: CommandRequested, request: Follow, now_ns: int) -> int:
    """Return when the chunk's time is 0 [ns]."""
    if request.start_at_ns is not None:
        return request.start_at_ns
    return now_ns if request.start_in_ns is None else command.received_ns + request.start_in_ns


def _passed(chunk: Chunk, into_s: float) -> int:
    """Return how many points are skipped, because their time has passed."""
    times_s = next(iter(chunk.trajectories.values())).times_s
    return sum(1 for time_s in times_s if time_s < into_s)
