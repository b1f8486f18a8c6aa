"""How a stream of setpoints begins where its arm is, and how a held reference gets back to an arm that left it.

Rules
    * A silent stream starts from the measured state. Whether that state can be trusted (`Store.seedable`) is asked by
      whoever starts it; whether it is inside the limits is asked here, for all arms before the first of them starts.
    * A live stream is never seeded anew: its reference is *walked* to the measured arm inside the limits, so that the
      grip is kept. Else the arm would jump, and the owner of an arm that was pushed away would never get it back. It walks only
      to where several samples say that the arm is.
    * While the robot's FSM is PAUSE nobody follows a setpoint, and the arm may sag or be led by hand. There the reference
      is where the arm is: what was ahead of the arm, or left behind by it, must not be followed by whoever lets the robot
      go again. It is set anew when it is more than a start may be off, so a frame that changes it is a start to the gate.
      Only a fresh FSM sample that says PAUSE lets this be done: a robot whose FSM is not heard may be following, and a
      reference that jumps back to an arm at speed would stop it dead.

When this is done is known to `enabling.py`, `stall.py` and the handler.
"""

from __future__ import annotations

from collections.abc import Container, Sequence

from gateway.core.limits.pose_validation import check_pose_start
from gateway.core.limits.validation import check_start
from gateway.core.messages.outputs import Level
from gateway.core.motion.gap import Gap
from gateway.core.motion.motion import PlanFailed
from gateway.core.supervision.coordinator import Coordinator
from gateway.errors import Code, Refusal
from gateway.values import Side, Space, Vector

__all__ = ["WALK_SPEED", "Starting"]

NEAR = {Space.JOINT: Gap(0.01), Space.POSE: Gap(0.01, 0.001)}
"""How far from its arm a stream may start (BEHAVIOUR, starting): a paused reference is not further from it either."""

WALK_SPEED = 0.3
"""Factor on the velocity limit while a held reference is led back to its arm."""


class Starting:
    """Begins streams, and leads references back."""

    def __init__(self, coordinator: Coordinator) -> None:
        self._coordinator = coordinator

    def seed(self, sides: Sequence[Side], now_ns: int, unnoticed: Container[Side] = ()) -> Refusal | None:
        """Start the streams of these arms at their measured positions, or none of them and say why.

        The measured state of `sides` is believed. Those that fell silent at rest, so short a time ago that the robot
        has not noticed, go on from their last setpoint.
        """
        coordinator = self._coordinator
        starts = {}
        for side in sides:
            start = self._start(side)
            if isinstance(start, Refusal):
                return start
            starts[side] = start
        for side, (values, moved) in starts.items():
            coordinator.body.grippers[side].start(now_ns, is_kept=coordinator.resuming)
            arm = coordinator.body.arms[side]
            if side in unnoticed:
                arm.start(arm.values, now_ns)
                continue
            arm.start(values, now_ns)
            for what in moved:
                coordinator.notice(
                    Code.START_AT_LIMIT,
                    Level.WARNING,
                    f"{side} arm {what}",
                    now_ns,
                )
        return None

    def stay(self, now_ns: int) -> bool:
        """Set the references of running arms to where these are, which nobody drives; return whether one changed.

        An arm whose state is not fresh, or that is outside its limits, cannot be followed: its reference is kept, at rest.
        """
        coordinator, is_changed = self._coordinator, False
        for side, arm in coordinator.body.arms.items():
            if not arm.running or not coordinator.part_fresh(side, now_ns):
                continue
            start = self._start(side)
            if isinstance(start, Refusal):
                continue
            if not arm.is_repeating or arm.distance(start[0]).exceeds(NEAR[arm.space]):
                arm.stay_with(start[0])
                is_changed = True
        return is_changed

    def why_not(self, side: Side) -> Refusal | None:
        """Return why a stream cannot start where its arm is now; the arm has been heard."""
        start = self._start(side)
        return start if isinstance(start, Refusal) else None

    def _start(self, side: Side) -> tuple[Vector, tuple[str, ...]] | Refusal:
        """Return where a stream starts, or its reference is led to, and what was moved to a limit for it."""
        settings, measured = self._coordinator.settings, self._measured(side)
        if self._coordinator.body.arms[side].space is Space.POSE:
            pose = check_pose_start(side, measured, settings.pose)
            if isinstance(pose, Refusal):
                return pose
            at_end = f"was found just beyond its reach and starts at {settings.pose.reach_m:.3f} m from the shoulder"
            return pose.values, (at_end,) if pose.clipped else ()
        start = check_start(side, measured, settings.arm)
        if isinstance(start, Refusal):
            return start
        return start.values, tuple(
            f"joint {n + 1} was found just outside its limit and starts at {start.values[n]:.3f} rad"
            for n in start.clipped
        )

    def _measured(self, side: Side) -> Vector:
        measured = self._coordinator.measured(side)
        assert measured is not None, f"the {side} arm was believed before its first sample"
        return measured

    def join(self, now_ns: int) -> Refusal | None:
        """Start the streams of arms that were enabled again while the others were held; HOLDING goes on for all.

        Returns:
            Why an arm that the robot has enabled cannot be started; nothing has started then.
        """
        coordinator = self._coordinator
        able = coordinator.able_arms(now_ns) or ()
        silent = tuple(side for side in able if not coordinator.body.arms[side].running)
        coordinator.choose_spaces(silent, now_ns)
        for side in silent:
            if not coordinator.seedable(side, now_ns):
                return Refusal(
                    code=Code.PART_STALE,
                    message=f"the {side} arm is enabled again, but its state has not been steady and timely for 0.3 s",
                    field=f"{side}_arm",
                )
        refusal = self.seed(silent, now_ns)
        if refusal is None:
            for side in silent:
                coordinator.body.arms[side].go_live()
            coordinator.enable.sides = coordinator.sides
        return refusal

    def strayed(self, now_ns: int) -> dict[Side, Gap]:
        """Return held arms that are further from their reference than the tracking bound, and how far.

        Arms whose state is not fresh are left out: where they are is not known.
        """
        coordinator = self._coordinator
        strayed = {}
        for side, arm in coordinator.body.arms.items():
            if arm.running and coordinator.part_fresh(side, now_ns):
                off = arm.distance(self._measured(side))
                if off.exceeds(arm.tracking):
                    strayed[side] = off
        return strayed

    def walk(self, now_ns: int) -> Refusal | None:
        """Lead references that are off by more than the tracking bound back to their arms; return why none walks, if so."""
        coordinator = self._coordinator
        goals: dict[Side, Vector] = {}
        for side in self.strayed(now_ns):
            if not coordinator.agreed(side, now_ns):
                message = f"the samples of the {side} arm do not agree: it is being moved, or they are not its own"
                return Refusal(code=Code.PART_STALE, message=message, field=f"{side}_arm")
            start = self._start(side)
            if isinstance(start, Refusal):
                return start
            goals[side] = start[0]
        if not goals:
            return None
        try:
            paths = coordinator.body.plan(goals, WALK_SPEED)
        except PlanFailed as failed:
            return Refusal(code=Code.PLAN_FAILED, message=f"no path back to the arm inside the limits: {failed}")
        for side, path in paths.items():
            coordinator.body.arms[side].walk(path)
        coordinator.notice(
            Code.WALK,
            Level.WARNING,
            f"the held reference walks back to the measured {' and '.join(map(str, goals))} arm; the grip is kept",
            now_ns,
        )
        return None
