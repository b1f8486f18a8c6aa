"""Touches: motions and streams that were asked to end at one, and the gateway's own bound on what a hand is pushed with.

    what is felt in this tick  ->  a touch?  ->  the arm brakes in this tick  ->  at rest  ->  back along the way it came

Rules
    * Nothing begins that could not feel its touch: no dynamics, nothing known of the arm, a threshold that the estimate cannot
      tell from nothing, a direction that this posture does not feel. When that is lost on the way, the arm brakes and holds.
    * A touch ends what moved the arm, for good: what was under way to it comes too late. What is to end at a touch itself is
      refused while the arm goes back, and for `QUIET_NS` after the touch, unless who asks has been told of that touch.
    * The way back is a motion of its own, under the lease and the checks of the one that was touched; whatever ends a motion
      ends it. It goes from point to point to where the setpoints were that far back.
    * The gateway's own bound (section [model]) ends whatever moves the arm, and refuses all that would move it for `QUIET_NS`.
      What pushes an arm that is held is not counted: then it takes that much more, so that one can move away.
    * An estimate, never a safety function: whoever asked for no touch moves an arm whose pushes are unknown, too.

A look costs about 0.06 ms for each arm that feels, and nothing otherwise.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping, Sequence
from typing import NamedTuple

from gateway.core.body.feeler import SURE, Feeler, Push, axis_of, push_of, unknown
from gateway.core.body.motions import Motion, MotionState
from gateway.core.body.targets import TargetStream
from gateway.core.messages.events import CommandRequested
from gateway.core.messages.outputs import Level
from gateway.core.motion.motion import PlanFailed, ReferenceMode
from gateway.core.requests.authorisation import Authorisation
from gateway.core.separation.goal_checks import check_goals
from gateway.core.supervision.coordinator import Coordinator
from gateway.errors import Code, Refusal
from gateway.messages.body_views import ContactView, TouchView
from gateway.messages.requests import Follow, Move, MovePose, OpenStream
from gateway.values import Side, Space, Vector

__all__ = ["QUIET_NS", "Touches"]

QUIET_NS = 500_000_000
"""So long after a touch nothing is begun by whoever does not know of it [ns]."""
BACK_SPEED = 0.25
"""Factor on the velocity limits on the way back."""
STEP_M, PLACES = 0.001, 256
"""Places on the way are noted this far apart [m], so many of them: more than the farthest way back."""
STILL = frozenset({ReferenceMode.HOLD, ReferenceMode.BRAKE})

Mover = Motion | TargetStream


class _Place(NamedTuple):
    """A setpoint on the way, where it puts the hand, and how long the way was until there [m]."""

    values: Vector
    p_m: Vector
    way_m: float


class _Back(NamedTuple):
    """A way back that waits for the arm to be at rest."""

    motion: Motion
    side: Side
    feeler: Feeler


class Touches:
    """Feels, and ends what is touched."""

    def __init__(self, coordinator: Coordinator, authorisation: Authorisation) -> None:
        self._coordinator = coordinator
        self._authorisation = authorisation
        self._number = 0
        self._ways: dict[Side, deque[_Place]] = {}
        self._backs: list[_Back] = []
        bounds = {side: coordinator.settings.model.touch_n(side) for side in Side}
        self._own = {side: Feeler(force_n=bound_n) for side, bound_n in bounds.items() if bound_n}
        self._was_unfelt_told: set[Side] = set()

    # ------------------------------------------------------------------------------------------------ what is asked

    def feelers(
        self,
        command: CommandRequested,
        request: Move | MovePose | Follow | OpenStream,
        sides: Sequence[Side],
        now_ns: int,
    ) -> Mapping[Side, Feeler] | Refusal:
        """Return what a motion of these arms is to end at, none for most, or why it must not begin."""
        until = request.until
        for side in sides:
            refusal = self._too_soon(side, None if until is None else until.seen, now_ns)
            if refusal is not None:
                return refusal
        if until is None:
            return {}
        axis = axis_of(until)
        if isinstance(axis, Refusal):
            return axis
        contacts = self._coordinator.contacts
        if isinstance(contacts, Refusal):
            return contacts
        for side in sides:
            push = push_of(contacts.view(side, now_ns), axis)
            if push.why:
                return unknown(side, push.why)
            least_n = SURE * push.sd_n
            if until.force_n < least_n:
                return Refusal(
                    code=Code.OUT_OF_RANGE,
                    message=f"a touch of the {side} hand with {until.force_n:g} N cannot be told from none, one with "
                    f"{least_n:.1f} N can ({SURE} standard deviations)",
                    field="until.force_n",
                    value=f"{until.force_n:g}",
                    bound=f">= {least_n:.3g}",
                    unit="N",
                    hint="give a greater force_n, or a direction, or run `ta2 identify --dynamics`",
                )
        return {
            side: Feeler(
                force_n=until.force_n, axis=axis, back_off_m=until.back_off_m, command=command, epoch=request.epoch
            )
            for side in sides
        }

    def _too_soon(self, side: Side, seen: int | None, now_ns: int) -> Refusal | None:
        """Refuse what may have been asked for before its sender knew of a touch; `seen` is None for what feels nothing."""
        touch = self._coordinator.body.touches.get(side)
        if touch is None or (seen is None and not touch.is_own) or (seen or 0) >= touch.number:
            return None
        back = self._coordinator.body.motions.find(touch.back_id) if touch.back_id else None
        if now_ns - touch.at_ns >= QUIET_NS and (back is None or not back.is_running):
            return None
        return Refusal(
            code=Code.CONTACT,
            message=f"the {side} hand was touched (touch {touch.number}) and this was asked for without knowing of it",
            field=f"{side}_arm",
            value=str(seen or 0),
            bound=str(touch.number),
            hint="look at the touch (result(), or the error of the stream), then ask again",
        )

    # ------------------------------------------------------------------------------------------------ one tick

    def look(self, now_ns: int) -> None:
        """Feel, end what is touched, and go on with the ways back."""
        body = self._coordinator.body
        for side, arm in body.arms.items():
            mover = body.motions.of(side) or body.targets.of(side)
            feeler = None if mover is None else mover.feelers.get(side)
            if feeler is None:
                self._ways.pop(side, None)
            own = self._own.get(side)
            if not arm.running or (feeler is None and own is None):
                continue
            contacts = self._coordinator.contacts
            if isinstance(contacts, Refusal):
                continue  # the bound asks for dynamics, and a guard of the daemon has none
            view = contacts.view(side, now_ns)
            if mover is not None and feeler is not None:
                self._note(side)
                push = push_of(view, feeler.axis)
                if push.why:
                    self._end_blind(side, push.why, now_ns)
                    continue
                if feeler.feels(push, now_ns):
                    self._end(side, mover, feeler, push, view, now_ns)
                    continue
            if own is not None:
                self._bound(side, own, mover, view, now_ns)
        for back in tuple(self._backs):
            self._go_back(back, now_ns)

    def _bound(self, side: Side, own: Feeler, mover: Mover | None, view: ContactView, now_ns: int) -> None:
        """Keep to the gateway's own bound."""
        coordinator, push = self._coordinator, push_of(view, ())
        if push.why:
            if mover is not None and side not in self._was_unfelt_told:
                self._was_unfelt_told.add(side)
                text = f"the {side} arm moves, and nobody feels what pushes it: {push.why}"
                coordinator.notice(Code.CONTACT_UNKNOWN, Level.WARNING, text, now_ns, side=side.value)
            return
        self._was_unfelt_told.discard(side)
        bound_n = coordinator.settings.model.touch_n(side)
        if push.force_n <= bound_n or coordinator.body.arms[side].reference.mode in STILL:
            own.force_n, own.over_ns = bound_n + (push.force_n if push.force_n > bound_n else 0.0), None
        elif mover is not None and own.feels(push, now_ns):
            self._end(side, mover, own, push, view, now_ns)

    def _note(self, side: Side) -> None:
        """Note where the hand is on its way."""
        arm, model = self._coordinator.body.arms[side], self._coordinator.model
        assert model is not None, "who feels has a model"
        p_m = arm.values[:3] if arm.space is Space.POSE else model.arms[side].forward(arm.values).p_m
        way = self._ways.setdefault(side, deque(maxlen=PLACES))
        gone_m = math.dist(p_m, way[-1].p_m) if way else 0.0
        if not way or gone_m >= STEP_M:
            way.append(_Place(arm.values, p_m, gone_m + (way[-1].way_m if way else 0.0)))

    def _end_blind(self, side: Side, why: str, now_ns: int) -> None:
        """Nobody would feel the touch any more: the arm brakes and holds."""
        refusal = unknown(side, why)
        text = f"{refusal.message}: it brakes"
        coordinator = self._coordinator
        ended = coordinator.body.drop_driver(side, MotionState.ABORTED, refusal.code, text)
        coordinator.report_ended(ended, now_ns)
        coordinator.notice(refusal.code, Level.WARNING, text, now_ns, side=side.value)

    def _end(self, side: Side, mover: Mover, feeler: Feeler, push: Push, view: ContactView, now_ns: int) -> None:
        """A touch: what moves the arm ends, and it brakes in this tick."""
        coordinator, is_own = self._coordinator, feeler.command is None
        body, model, measured = coordinator.body, coordinator.model, coordinator.store.arm(side)
        assert model is not None and measured is not None, "who feels has heard joints"
        self._number += 1
        there = self._way_back(side, feeler)
        mover.touch = touch = TouchView(
            number=self._number,
            side=side.value,
            at_ns=now_ns,
            force_n=push.force_n,
            sd_n=push.sd_n,
            threshold_n=feeler.force_n,
            direction=feeler.axis,
            wrench=view.wrench,
            frame=view.frame,
            p_m=model.arms[side].forward(measured.q_rad).p_m,
            is_own=is_own,
            back_id=0 if there is None else body.motions.next_id,
        )
        body.touches[side] = touch
        text = f"the {side} hand was pushed with {push.force_n:.1f} N, {feeler.force_n:.3g} N is the bound"
        state = MotionState.ABORTED if is_own else MotionState.TOUCHED
        coordinator.report_ended(body.drop_driver(side, state, Code.CONTACT, text), now_ns)
        level = Level.WARNING if is_own else Level.INFO
        coordinator.notice(Code.CONTACT, level, text, now_ns, side=side.value, touch=str(touch.number))
        if there is not None:
            motion = body.motions.open({side: there}, None, 0, space=body.arms[side].space)
            motion.is_planned = False
            self._backs.append(_Back(motion, side, feeler))

    # ------------------------------------------------------------------------------------------------ the way back

    def _way_back(self, side: Side, feeler: Feeler) -> Vector | None:
        """Return where a hand is led back to; None where that is not asked for, or it has not come any way yet."""
        way = self._ways.get(side)
        if not feeler.back_off_m or way is None or len(way) == 1:
            return None
        there_m = way[-1].way_m - feeler.back_off_m
        return next((place for place in reversed(way) if place.way_m <= there_m), way[0]).values

    def _go_back(self, back: _Back, now_ns: int) -> None:
        """Begin a way back once its arm is at rest, if it may begin."""
        coordinator, motion, side, command = self._coordinator, back.motion, back.side, back.feeler.command
        arm = coordinator.body.arms[side]
        if not motion.is_running:
            self._backs.remove(back)
        elif arm.is_at_rest and command is not None:
            self._backs.remove(back)
            refusal = self._authorisation.motion(command, back.feeler.epoch, (side,), now_ns, motion.space)
            if refusal is None and motion.space is Space.JOINT:
                refusal = check_goals(coordinator, motion.goals, now_ns)
            try:
                paths = {} if refusal is not None else coordinator.body.plan(motion.goals, BACK_SPEED)
            except PlanFailed as failed:
                refusal = Refusal(code=Code.PLAN_FAILED, message=f"no path inside the limits: {failed}")
            if refusal is not None:
                coordinator.body.motions.end(motion, MotionState.ABORTED, refusal.code, refusal.message)
                coordinator.report_ended([motion], now_ns)
                return
            motion.is_planned, motion.duration_ns = True, paths[side].duration_ns
            arm.follow_path(paths[side], back.feeler.epoch)
