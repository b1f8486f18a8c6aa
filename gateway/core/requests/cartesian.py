"""Carries out poses for arms in joint mode, by the body model: straight motions, and joint motions to a pose.

The robot takes joints from such an arm, and poses are ours to turn into joints. So they are accepted only while the model
agrees with the robot (`body_model.py`), and a motion whose model begins to differ is aborted: its arms brake.

A straight motion takes milliseconds to work out. It is accepted as `queued`, what drove its arms ends, and once they are at
rest some pieces of the work are done in every tick. It begins when all of it is known to be possible, from exactly where the
arms were; else it ends aborted, with the first place that is not, and nothing has moved. Until then it can be cancelled,
superseded and stopped as any motion. A joint motion to a pose begins at once, as `move_to` does; where parts of the body are
kept apart its way is looked at before, likewise. A goal that leaves too little room is refused at once: the whole posture of a
joint motion, of a straight one the hands, which its poses place however the arms will be bent.
"""

from __future__ import annotations

from collections.abc import Generator, Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, TypeAlias

from msgspec import Struct

from gateway.core.body.motions import Motion, MotionState
from gateway.core.limits import validation
from gateway.core.limits.pose_validation import check_frame, check_pose, check_pose_tolerance
from gateway.core.messages.events import CommandRequested
from gateway.core.motion.lines.line_curve import place
from gateway.core.motion.lines.line_gaps import too_near
from gateway.core.motion.lines.line_path import LinePath
from gateway.core.motion.lines.line_plan import Body, Going, plan_lines
from gateway.core.motion.motion import Path, PlanFailed
from gateway.core.requests.authorisation import Authorisation
from gateway.core.requests.moves import Answer, Moves
from gateway.core.separation.goal_checks import check_goals
from gateway.core.supervision.coordinator import Coordinator
from gateway.core.supervision.supervisor import Trigger
from gateway.errors import Code, Refusal
from gateway.messages.requests import MovePose
from gateway.robot.topics import ARM_JOINTS
from gateway.values import EePose, Side, Space, Vector

if TYPE_CHECKING:  # it takes numpy along, which a guard has no use for
    from gateway.core.robot_state.body_model import BodyModel
    from gateway.kinematics.collision import CollisionModel

__all__ = ["PIECES", "Cartesian"]

PIECES = 3
"""Pieces of work in one tick; each takes about 0.1 ms."""
STEP_RAD = 0.03
"""Joint travel between two postures of a joint motion that are looked at."""

Paths: TypeAlias = Mapping[Side, "LinePath | Path"]
Work: TypeAlias = Generator[None, None, "Paths | Refusal"]


class _Job(Struct, kw_only=True):
    """A motion that is being worked out.

    Attributes:
        motion: Its record.
        request: What is asked for.
        targets: Per arm where its end effector shall be.
        goals_rad: Per arm where its joints shall be; empty for a straight motion.
        work: What is left of it; None until all arms are at rest.
    """

    motion: Motion
    request: MovePose
    targets: Mapping[Side, EePose]
    goals_rad: Mapping[Side, Vector]
    work: Work | None = None


class Cartesian:
    """Poses for arms in joint mode."""

    def __init__(self, coordinator: Coordinator, authorisation: Authorisation, moves: Moves) -> None:
        self._coordinator = coordinator
        self._authorisation = authorisation
        self._moves = moves
        self._jobs: list[_Job] = []

    # ------------------------------------------------------------------------------------------------ what is asked

    def move_pose(self, command: CommandRequested, request: MovePose, now_ns: int) -> Answer:
        """Begin a motion of end effectors to poses, or to work it out; arms in end-effector mode go straight anyway."""
        sides = tuple(side for side in Side if side in request.targets)
        if not sides or any(self._space(side, now_ns) is Space.POSE for side in sides):
            return self._moves.move_pose(command, request, now_ns)
        coordinator = self._coordinator
        refusal = self._authorisation.motion(command, request.epoch, sides, now_ns) or validation.check_speed(
            request.speed
        )
        for side in sides:
            refusal = refusal or coordinator.model_refusal(side, now_ns)
        if refusal is not None or coordinator.model is None:
            return refusal or Refusal(code=Code.INTERNAL, message="no model, and no refusal because of that")
        settings = coordinator.settings.pose
        tolerance = check_pose_tolerance(request.tolerance_m, request.tolerance_rad, settings)
        if isinstance(tolerance, Refusal):
            return tolerance
        poses: dict[Side, Vector] = {}
        clipped: dict[str, list[int]] = {}
        goals_rad: dict[Side, Vector] = {}
        for side in sides:
            goal = check_frame(side, request.frames.get(side, "")) or check_pose(
                side, request.targets[side], settings, request.on_limit
            )
            if isinstance(goal, Refusal):
                return goal
            poses[side] = goal.values
            if goal.clipped:
                clipped[side.value] = list(goal.clipped)
            joints = self._solved(coordinator.model, side, _pose(goal.values))
            if isinstance(joints, Refusal):
                return joints
            goals_rad[side] = joints
        too_near_there = check_goals(coordinator, goals_rad, now_ns, hands_only=request.straight)
        if too_near_there is not None:
            return too_near_there
        facts: dict[str, object] = {
            "values": {side.value: list(goal) for side, goal in poses.items()},
            "clipped": clipped,
        }
        paths: Paths | None = None
        if not request.straight and coordinator.model.collision is None:
            found = self._joint_paths(goals_rad, request.speed)
            if isinstance(found, Refusal):
                return found
            paths = found
        feelers = self._moves.touches.feelers(command, request, sides, now_ns)
        if isinstance(feelers, Refusal):
            return feelers
        message = "a later motion took the arm over"
        self._moves.free(sides, MotionState.SUPERSEDED, Code.SUPERSEDED, message, now_ns)
        coordinator.fire(Trigger.ARM_MOTION, now_ns, "the owner moves")
        motion = coordinator.body.motions.open(poses, tolerance, 0, space=Space.POSE)
        motion.seen = partial(_end_effector, coordinator.model)
        motion.feelers = feelers
        if paths is None:
            motion.is_planned = False
            self._jobs.append(
                _Job(
                    motion=motion,
                    request=request,
                    targets={side: _pose(goal) for side, goal in poses.items()},
                    goals_rad={} if request.straight else goals_rad,
                )
            )
        else:
            self._begin(motion, paths, request.epoch)
        return {"motion_id": motion.motion_id, "duration_ns": motion.duration_ns, **facts}

    def _space(self, side: Side, now_ns: int) -> Space:
        """Return the space in which an arm is streamed, or would be."""
        arm, mode = self._coordinator.body.arms[side], self._coordinator.store.mode(now_ns)
        return arm.space if arm.running or mode is None else mode.space(side)

    def _solved(self, model: BodyModel, side: Side, target: EePose) -> Vector | Refusal:
        """Return the joints for a pose nearest to where the arm is held, of all ways to bend it; or why there are none."""
        arm, held = model.arms[side], self._coordinator.body.joint_arms[side].values
        found = arm.solution(target, held)
        if found is not None:
            return found.q_rad
        ways = arm.branches(target, arm.arm_angle_rad(held)) if arm.shape.is_exact else ()
        hint = "turn the hand otherwise, or move the target"
        for way in ways[:1]:
            n = way.joint
            q, low, high = way.q_rad[n], arm.lower_rad[n], arm.upper_rad[n]
            return Refusal(
                code=Code.OUT_OF_RANGE,
                message=f"no way to bend the {side} arm takes its end effector there inside the limits: with the elbow as it "
                f"hangs, joint {n + 1} ({ARM_JOINTS[side][n]}) would be at {q:.4f} rad, outside [{low:.2f}, {high:.2f}] rad",
                field=f"{side}_arm[{n}]",
                value=f"{q:.6g}",
                bound=f"[{low:g}, {high:g}]",
                unit="rad",
                hint=hint,
            )
        message = f"no joints of the {side} arm take its end effector there: it is out of reach, or turned too far"
        return Refusal(code=Code.OUT_OF_RANGE, message=message, field=f"{side}_arm", hint=hint)

    def _joint_paths(self, goals_rad: Mapping[Side, Vector], speed: float) -> Paths | Refusal:
        try:
            return self._coordinator.body.plan_joints(goals_rad, speed)
        except PlanFailed as failed:
            return Refusal(code=Code.PLAN_FAILED, message=f"no path inside the limits: {failed}")

    # ------------------------------------------------------------------------------------------------ one tick

    def step(self, now_ns: int) -> None:
        """Work out what was asked for, begin what is worked out, and end what the model can no longer carry."""
        for motion in self._coordinator.body.motions.running:
            if motion.seen is not None:
                self._watch(motion, now_ns)
        pieces = PIECES
        for job in tuple(self._jobs):
            if not job.motion.is_running:
                self._jobs.remove(job)
                continue
            job.work = job.work or self._work(job, now_ns)
            while pieces > 0 and job.work is not None:
                pieces -= 1
                try:
                    next(job.work)
                except StopIteration as end:
                    self._jobs.remove(job)
                    self._finish(job, end.value, now_ns)
                    break

    def _watch(self, motion: Motion, now_ns: int) -> None:
        """End a motion whose model does not agree with the robot any more; its arms brake."""
        for side in motion.goals:
            refusal = self._coordinator.model_refusal(side, now_ns)
            if refusal is not None:
                self._abort(motion, refusal, now_ns)
                return

    def _work(self, job: _Job, now_ns: int) -> Work | None:
        """Return the work of a motion, once its arms are at rest."""
        coordinator, model = self._coordinator, self._coordinator.model
        arms = coordinator.body.joint_arms
        if model is None or not all(arms[side].reference.state.is_at_rest for side in job.targets):
            return None
        if model.collision is None:
            body = Body(model=None, margin_m=0.0, q_rad={})
        else:
            q_rad = self._postures(now_ns)
            if isinstance(q_rad, Refusal):
                return _refused(q_rad)
            body = Body(model=model.collision, margin_m=coordinator.settings.model.margin_m, q_rad=q_rad)
        if job.goals_rad and body.model is not None:
            return self._look_ahead(job, body.model, body)
        going = {
            side: Going(
                arm=model.arms[side],
                start=arms[side].reference.here,
                target=target,
                poses=coordinator.body.pose_arms[side].reference.space,
            )
            for side, target in job.targets.items()
        }
        ratio = coordinator.body.speed_ratio
        v_radps = ratio[Space.JOINT] * next(iter(going.values())).start.space.limits.v_radps
        return plan_lines(going, body, job.request.speed * min(ratio.values()), v_radps)

    def _postures(self, now_ns: int) -> dict[Side, Vector] | Refusal:
        """Return the joints of both arms: held, or measured; or that nobody knows them [rad]."""
        coordinator = self._coordinator
        q_rad: dict[Side, Vector] = {}
        for side in Side:
            arm, measured = coordinator.body.joint_arms[side], coordinator.store.arm(side)
            if arm.running:
                q_rad[side] = arm.values
            elif measured is not None and coordinator.store.part_fresh(side, now_ns, needs_pose=False):
                q_rad[side] = measured.q_rad
            else:
                message = f"nobody knows where the {side} arm is, which must not be hit: its state is older than 100 ms"
                return Refusal(code=Code.PART_STALE, message=message, field=f"{side}_arm")
        return q_rad

    def _look_ahead(self, job: _Job, parts: CollisionModel, body: Body) -> Work:
        """Look along a joint motion from rest, which is straight in the joints, before it is planned."""
        ways = {
            side: tuple(b - a for a, b in zip(body.q_rad[side], goal, strict=True))
            for side, goal in job.goals_rad.items()
        }
        count = max(1, *(int(max(map(abs, way)) / STEP_RAD) + 1 for way in ways.values()))
        postures = [
            {
                **body.q_rad,
                **{
                    side: tuple(q + n / count * d for q, d in zip(body.q_rad[side], way, strict=True))
                    for side, way in ways.items()
                },
            }
            for n in range(count + 1)
        ]
        refusal = yield from too_near(parts, body.margin_m, postures, lambda number: place(number / count))
        return refusal or self._joint_paths(job.goals_rad, job.request.speed)

    def _finish(self, job: _Job, found: Paths | Refusal, now_ns: int) -> None:
        """Begin what was worked out, from exactly where it was worked out for; or tell why it cannot be."""
        arms = self._coordinator.body.joint_arms
        if isinstance(found, Refusal):
            self._abort(job.motion, found, now_ns)
        elif any(path.start != arms[side].reference.state for side, path in found.items()):
            message = "the arms are no longer where the motion was worked out for"
            self._abort(job.motion, Refusal(code=Code.PLAN_FAILED, message=message), now_ns)
        else:
            self._begin(job.motion, found, job.request.epoch)

    def _begin(self, motion: Motion, paths: Paths, epoch: int) -> None:
        motion.duration_ns = max(path.duration_ns for path in paths.values())
        motion.is_planned = True
        for side, path in paths.items():
            self._coordinator.body.joint_arms[side].follow_path(path, epoch)

    def _abort(self, motion: Motion, refusal: Refusal, now_ns: int) -> None:
        """End a motion with what was found; its arms brake."""
        coordinator = self._coordinator
        message = f"{refusal.message}; {refusal.hint}" if refusal.hint else refusal.message
        coordinator.body.motions.end(motion, MotionState.ABORTED, refusal.code, message)
        for side in motion.goals:
            coordinator.body.arms[side].brake()
        coordinator.report_ended([motion], now_ns)


def _end_effector(model: BodyModel, side: Side, q_rad: Vector) -> Vector:
    """Return where joints put an end effector: x, y, z [m], qx, qy, qz, qw."""
    return model.arms[side].forward(q_rad).values


def _pose(values: Sequence[float]) -> EePose:
    """Return x, y, z [m], qx, qy, qz, qw as a pose."""
    return EePose(p_m=tuple(values[:3]), quat_xyzw=tuple(values[3:]))


def _refused(refusal: Refusal) -> Work:
    """Return work that ends with a refusal."""
    yield from ()
    return refusal
