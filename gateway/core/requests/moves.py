"""Carries out the owner's motion requests: move, stream, hold, cancel.

What may pass is the word of `authorisation.py` and of `limits/validation.py`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TypeAlias

from gateway.core.body.motions import Motion, MotionState
from gateway.core.limits import validation
from gateway.core.limits.admittance_rules import check_admittance
from gateway.core.limits.pose_validation import check_frame, check_pose, check_pose_tolerance
from gateway.core.messages.events import CommandRequested, TargetArrived
from gateway.core.motion.bounds import no_arm
from gateway.core.motion.gap import Gap
from gateway.core.motion.motion import PlanFailed
from gateway.core.motion.poses.admittance import VirtualMass
from gateway.core.requests.admitting import felt
from gateway.core.requests.authorisation import Authorisation
from gateway.core.requests.touches import Touches
from gateway.core.separation import goal_checks
from gateway.core.supervision.coordinator import Coordinator
from gateway.core.supervision.supervisor import State, Trigger
from gateway.errors import Code, Refusal
from gateway.messages.incoming import OnLimit
from gateway.messages.requests import Cancel, CloseStream, Hold, Move, MovePose, OpenStream
from gateway.values import Side, Space, Vector

__all__ = ["Answer", "Facts", "Moves"]

Facts = Mapping[str, object]
Answer: TypeAlias = Facts | Refusal
"""What a request gets: facts to go on with, or why nothing was done."""


class Moves:
    """Motion requests of the owner."""

    def __init__(self, coordinator: Coordinator, authorisation: Authorisation) -> None:
        self._coordinator = coordinator
        self._authorisation = authorisation
        self.touches = Touches(coordinator, authorisation)
        """What ends motions and streams at a touch."""

    def move(self, command: CommandRequested, request: Move, now_ns: int) -> Answer:
        """Plan and begin a point-to-point motion of one or both arms."""
        coordinator = self._coordinator
        sides = tuple(side for side in Side if side in request.targets_rad)
        if not sides:
            return no_arm("targets_rad")
        refusal = (
            self._authorisation.motion(command, request.epoch, sides, now_ns)
            or validation.check_speed(request.speed)
            or validation.check_tolerance(request.tolerance_rad)
        )
        if refusal is not None:
            return refusal
        goals: dict[Side, Vector] = {}
        clipped: dict[str, list[int]] = {}
        for side in sides:
            values, reference = request.targets_rad[side], coordinator.body.arms[side].values
            if request.relative and len(values) == len(reference):
                values = tuple(a + b for a, b in zip(reference, values, strict=True))
            goal = validation.check_goal(side, values, coordinator.settings.arm, request.on_limit)
            if isinstance(goal, Refusal):
                return goal
            goals[side] = goal.values
            if goal.clipped:
                clipped[side.value] = list(goal.clipped)
        tolerance_rad = coordinator.settings.arm.settle_rad if request.tolerance_rad is None else request.tolerance_rad
        too_near = goal_checks.check_goals(coordinator, goals, now_ns)
        if too_near is not None:
            return too_near
        answer = self._go(command, request, goals, Gap(tolerance_rad), now_ns)
        if isinstance(answer, Refusal):
            return answer
        return {**answer, "q_rad": {side.value: list(goal) for side, goal in goals.items()}, "clipped": clipped}

    def move_pose(self, command: CommandRequested, request: MovePose, now_ns: int) -> Answer:
        """Plan and begin a straight motion of one or both end effectors."""
        coordinator = self._coordinator
        settings = coordinator.settings.pose
        sides = tuple(side for side in Side if side in request.targets)
        if not sides:
            return no_arm("targets")
        refusal = self._authorisation.motion(
            command, request.epoch, sides, now_ns, Space.POSE
        ) or validation.check_speed(request.speed)
        if refusal is not None:
            return refusal
        tolerance = check_pose_tolerance(request.tolerance_m, request.tolerance_rad, settings)
        if isinstance(tolerance, Refusal):
            return tolerance
        goals: dict[Side, Vector] = {}
        clipped: dict[str, list[int]] = {}
        for side in sides:
            goal = check_frame(side, request.frames.get(side, "")) or check_pose(
                side, request.targets[side], settings, request.on_limit
            )
            if isinstance(goal, Refusal):
                return goal
            goals[side] = goal.values
            if goal.clipped:
                clipped[side.value] = list(goal.clipped)
        answer = self._go(command, request, goals, tolerance, now_ns)
        if isinstance(answer, Refusal):
            return answer
        return {**answer, "values": {side.value: list(goal) for side, goal in goals.items()}, "clipped": clipped}

    def _go(
        self,
        command: CommandRequested,
        request: Move | MovePose,
        goals: Mapping[Side, Vector],
        tolerance: Gap,
        now_ns: int,
    ) -> Answer:
        """Plan a motion to checked goals, take the arms over, and begin it."""
        coordinator = self._coordinator
        feelers = self.touches.feelers(command, request, tuple(goals), now_ns)
        if isinstance(feelers, Refusal):
            return feelers
        try:
            paths = coordinator.body.plan(goals, request.speed)
        except PlanFailed as failed:
            return Refusal(code=Code.PLAN_FAILED, message=f"no path inside the limits: {failed}")
        self.free(tuple(goals), MotionState.SUPERSEDED, Code.SUPERSEDED, "a later motion took the arm over", now_ns)
        coordinator.fire(Trigger.ARM_MOTION, now_ns, "the owner moves")
        duration_ns = max(path.duration_ns for path in paths.values())
        space = coordinator.body.arms[next(iter(goals))].space
        motion = coordinator.body.motions.open(goals, tolerance, duration_ns, space=space)
        motion.feelers = feelers
        for side, path in paths.items():
            coordinator.body.arms[side].follow_path(path, request.epoch)
        return {"motion_id": motion.motion_id, "duration_ns": duration_ns}

    def free(self, sides: Sequence[Side], state: MotionState, code: Code, message: str, now_ns: int) -> None:
        """End what drives these arms; they brake until something else moves them."""
        ended: list[Motion] = []
        for side in sides:
            ended += self._coordinator.body.drop_driver(side, state, code, message)
        self._coordinator.report_ended(ended, now_ns)

    def open_stream(self, command: CommandRequested, request: OpenStream, now_ns: int) -> Answer:
        """Open a stream of targets for one arm; it starts at the present reference."""
        coordinator = self._coordinator
        refusal = (
            self._authorisation.motion(command, request.epoch, (request.side,), now_ns, request.space)
            or (check_frame(request.side, request.frame) if request.space is Space.POSE else None)
            or validation.check_speed(request.speed)
            or validation.check_expiry(request.expiry_ns)
            or (None if request.admittance is None else check_admittance(request.admittance, request.space))
        )
        if refusal is None and request.admittance is not None:
            force = felt(coordinator, request.side, now_ns)
            refusal = force if isinstance(force, Refusal) else None
        if refusal is not None:
            return refusal
        feelers = self.touches.feelers(command, request, (request.side,), now_ns)
        if isinstance(feelers, Refusal):
            return feelers
        self.free((request.side,), MotionState.SUPERSEDED, Code.SUPERSEDED, "a stream took the arm over", now_ns)
        coordinator.fire(Trigger.ARM_MOTION, now_ns, "the owner streams")
        stream = coordinator.body.targets.open(
            request.side,
            command.client_id,
            request.epoch,
            request.speed,
            request.on_limit,
            request.expiry_ns,
            request.space,
        )
        stream.feelers = feelers
        reference = coordinator.body.arms[request.side].reference
        if request.admittance is None:
            return {"stream_id": stream.stream_id, "values": list(reference.values)}
        wish = request.admittance
        stream.mass = VirtualMass(wish.mass, wish.damping, wish.stiffness)
        anchor = check_pose(request.side, reference.rest_values(), coordinator.settings.pose, OnLimit.CLIP)
        assert not isinstance(anchor, Refusal), "a setpoint is a pose; at the end of the reach rounding may be beyond"
        return {"stream_id": stream.stream_id, "values": list(anchor.values)}

    def take_target(self, target: TargetArrived, now_ns: int) -> None:
        """Follow a streamed target if it may be followed; its stream says why not."""
        coordinator = self._coordinator
        if self._authorisation.is_before_stop(target.received_ns):
            return
        accepted = coordinator.body.targets.accept(target)
        if accepted is None:
            return
        stream, values = accepted
        if stream.mass is not None:
            stream.mass.anchor = values
            return
        if coordinator.state is not State.ACTIVE:
            return
        arm = coordinator.body.arms[stream.side]
        arm.follow_target(values, stream.speed * coordinator.body.speed_ratio[arm.space], stream.epoch)
        due_ns = arm.next_due_ns()
        stream.lead_ns = None if due_ns is None else due_ns - target.received_ns

    def close_stream(self, command: CommandRequested, request: CloseStream, now_ns: int) -> Answer:
        """End a stream of targets: the arm brakes and holds."""
        refusal = self._authorisation.owner(command, request.epoch)
        if refusal is not None:
            return refusal
        stream = self._coordinator.body.targets.find(request.stream_id)
        if stream is None:
            return Refusal(
                code=Code.UNKNOWN_STREAM, message=f"there is no stream {request.stream_id}", field="stream_id"
            )
        if stream.is_open:
            self.free((stream.side,), MotionState.CANCELLED, Code.CANCELLED, "closed", now_ns)
        return {"code": stream.code.value if stream.code else ""}

    def hold(self, command: CommandRequested, request: Hold, now_ns: int) -> Answer:
        """End what drives the named arms; they brake and hold."""
        if not request.sides:
            return no_arm("sides")
        refusal = self._authorisation.owner(command, request.epoch)
        if refusal is not None:
            return refusal
        self.free(request.sides, MotionState.CANCELLED, Code.CANCELLED, "hold was asked for", now_ns)
        for side in request.sides:
            if self._coordinator.body.arms[side].running:
                self._coordinator.body.arms[side].brake()
        return {}

    def cancel(self, command: CommandRequested, request: Cancel, now_ns: int) -> Answer:
        """End one motion; its arms brake and hold."""
        refusal = self._authorisation.owner(command, request.epoch)
        if refusal is not None:
            return refusal
        motion = self._coordinator.body.motions.find(request.motion_id)
        if motion is None:
            return Refusal(
                code=Code.UNKNOWN_MOTION, message=f"there is no motion {request.motion_id}", field="motion_id"
            )
        if motion.is_running:
            self.free(tuple(motion.goals), MotionState.CANCELLED, Code.CANCELLED, "cancelled by the owner", now_ns)
        return {"state": motion.state.value}
