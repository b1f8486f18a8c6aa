"""Spacing: parts of the body are kept apart while arms move by joint setpoints, tick by tick.

    next setpoints of both arms, looked at  ->  Look.judge  ->  taken, or a step of the stop instead

Rules
    * On where the configuration asks for it (`model.self_collision`) and the model agrees with the robot, for both arms. When
      it does not, motion by joints goes on as it would without a model, and that is told.
    * An arm that follows a target is slowed down, then stopped, joint by joint: joints that close a gap which would become too
      narrow take a step of their stop, the others go on. So it can always be led away again, also out of where what opens one
      gap closes another.
    * A path or a trajectory is one motion: it ends with COLLISION_AHEAD, and its arms brake.
    * Stops, holds and walks (a reference that is led to where its arm is) are never changed; others mind them.
    * An arm whose joints nobody here commands (end-effector mode, or no stream) stands where it is measured, and may go on as
      far as its measured velocity takes it. That is a guess: by poses it is not moved while this is on (`goal_checks.py`), and
      what moves it by poses when this comes on ends with UNGUARDED: it brakes.
    * It is setpoints that keep the margin. The arms follow them within the bound of the tracking error.

A look at the body costs 0.2 to 0.5 ms. So it serves for the next ticks as well, as far as its bounds let their ways pass, which
costs a third. Wider ways are judged along, as far ahead as there is room (`lookahead.py`), and nothing is asked until the arms
leave them: at 0.3 rad/s in most ticks; at 1 rad/s, with parts near, in two of five.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from gateway.core.body.motions import MotionState
from gateway.core.messages.outputs import Level
from gateway.core.motion.joints.braking import REST
from gateway.core.motion.joints.stops import Stops
from gateway.core.motion.motion import JointReference, ReferenceMode
from gateway.core.motion.space import State
from gateway.core.separation.goal_checks import check_unguarded, whereabouts, why_off
from gateway.core.separation.lookahead import Lookahead, wider
from gateway.core.supervision.coordinator import Coordinator
from gateway.errors import Code
from gateway.kinematics.separation.judgement import Going, Motion, Verdict, Ways
from gateway.kinematics.separation.stopping import STAYS, Extent, stop_extent, way_extent
from gateway.messages.snapshot import SpacingView
from gateway.values import Side, Space, Vector

if TYPE_CHECKING:  # they take numpy along, which a guard has no use for
    from gateway.core.robot_state.body_model import BodyModel
    from gateway.kinematics.collision import CollisionModel
    from gateway.kinematics.separation.approach import Look

__all__ = ["Spacing"]

MS = 1_000_000
S = 1_000_000_000

SHOWN_NS = 100 * MS
"""The nearest pair is looked for this far apart [ns]."""
QUIET_NS = 1 * S
"""A stream that was not held back for so long is told of anew [ns]."""
LOOK_RAD = 0.2
"""A look at the body serves until a joint is so much further than it would have been in that tick [rad]."""
LIMITED_TICKS = 4
"""So many ticks apart the velocity limits are worked out while nothing has to be held back."""
ADRIFT_RADPS = 0.05
"""An arm that nobody here commands stands, below this [rad/s]: noise, and sagging."""

WHOLE = (ReferenceMode.PATH, ReferenceMode.CHUNK)
"""What moves all joints of an arm as one."""

Moved = Mapping[Side, JointReference]


class Spacing:
    """Leads the setpoints of both arms apart."""

    def __init__(self, coordinator: Coordinator) -> None:
        self._coordinator = coordinator
        arm = coordinator.settings.arm
        self._v_radps, self._a_radps2, self._j_radps3 = arm.v_radps, arm.a_radps2, arm.j_radps3
        self._was_off_told = False
        self._lookahead = Lookahead()
        self._look: Look | None = None
        """The last look at the body; None where it is of no use any more."""
        self._ticks = 0
        self._shown_ns = -S
        self._held_ns: dict[Side, int] = {}
        """When each arm that follows a target was held back last [ns]."""

    def look(self, now_ns: int) -> None:
        """Look at the setpoints of this tick before they are taken, and change what has to be changed."""
        model = self._coordinator.model
        if model is None or model.approach is None:
            return
        refusal, here = why_off(self._coordinator, now_ns), whereabouts(self._coordinator)
        why = "" if refusal is None else refusal.message
        moved = self._moved(now_ns)
        is_moving = any(reference.ahead() != reference.state for reference in moved.values())
        self._tell_off(why, now_ns, is_moving=is_moving)
        if why or len(here) < len(Side):
            self._lookahead.drop()
            self._look = None
            self._held_ns.clear()
            for reference in moved.values():
                reference.bound(1.0)
        elif is_moving:
            self._judge(model, here, moved, now_ns)
        if not why:
            self._end_poses(now_ns)
        self._show(model, why=why, now_ns=now_ns)

    def _end_poses(self, now_ns: int) -> None:
        """End what moves arms by poses: it began while nobody kept arms apart, and could not be begun now."""
        body = self._coordinator.body
        for side, arm in body.arms.items():
            if arm.space is Space.POSE and (body.motions.of(side) or body.targets.of(side)):
                refusal = check_unguarded(self._coordinator, (side,), Space.POSE, now_ns)
                assert refusal is not None
                text = f"arms are kept apart again, and {refusal.message}: it brakes"
                self._coordinator.report_ended(body.drop_driver(side, MotionState.ABORTED, refusal.code, text), now_ns)
                self._coordinator.notice(refusal.code, Level.WARNING, text, now_ns, side=side.value)

    def _moved(self, now_ns: int) -> Moved:
        """Return the references of the arms whose next joint setpoint leaves in this tick."""
        arms = self._coordinator.body.joint_arms
        return {
            side: arm.reference
            for side, arm in arms.items()
            if (due_ns := arm.next_due_ns()) is not None and due_ns <= now_ns
        }

    # ------------------------------------------------------------------------------------------------ the rule

    def _judge(self, model: BodyModel, here: Mapping[Side, Vector], moved: Moved, now_ns: int) -> None:
        wanted = {side: reference.ahead() for side, reference in moved.items()}
        assert model.approach is not None and model.collision is not None
        if self._look is not None and self._passes(self._look, here, moved, wanted):
            return
        ways, aims = self._ways(here, here, wanted), self._aims(moved)
        lookahead = self._lookahead.ask(here, ways, wanted, aims)
        look = model.approach.look(here, wider(here, ways if lookahead is None else lookahead, wanted, aims, LOOK_RAD))
        verdict = look.judge(
            Motion(
                wanted=ways,
                braked=lambda: {side: self._braked(side, here[side], ways, moved.get(side)) for side in Side},
                speed_radps={side: wanted[side][1] if side in wanted else REST for side in Side},
                together=self._together(moved),
                course=lambda going: self._stops(here, moved, wanted, ways, going),
                lookahead=lookahead,
            )
        )
        self._look = look
        self._lookahead.keep(here, lookahead, is_free=verdict.has_lookahead)
        if not verdict.is_free:
            self._hold_back(model.collision, here, moved, verdict, now_ns)
        self._bound(moved, verdict.limit_radps)

    def _passes(self, look: Look, here: Mapping[Side, Vector], moved: Moved, wanted: Mapping[Side, State]) -> bool:
        """Whether all may go on, as far as the last look at the body tells."""
        ways = self._ways(look.here, here, wanted)
        if self._lookahead.holds(look.here, ways):
            return True
        lookahead = self._lookahead.ask(look.here, ways, wanted, self._aims(moved))
        passing = look.passing(ways, lookahead)
        if passing is None:
            return False
        self._lookahead.keep(look.here, lookahead, is_free=passing.has_lookahead)
        self._ticks += 1
        if self._ticks % LIMITED_TICKS == 0:
            self._bound(moved, passing.limits({side: wanted[side][1] if side in wanted else REST for side in Side}))
        return True

    def _bound(self, moved: Moved, limit_radps: Mapping[Side, float]) -> None:
        """Limit the velocity of arms that follow targets [rad/s]."""
        for side, reference in moved.items():
            if reference.mode is ReferenceMode.FOLLOW:
                reference.bound(min(1.0, limit_radps[side] / self._v_radps))

    def _aims(self, moved: Moved) -> dict[Side, Vector]:
        return {side: reference.aim_values() for side, reference in moved.items()}

    def _ways(self, origin: Mapping[Side, Vector], here: Mapping[Side, Vector], wanted: Mapping[Side, State]) -> Ways:
        """Return how far the joints may go from where the body was looked at, through where they are now [rad]."""
        return {side: self._way(side, origin[side], here[side], wanted.get(side)) for side in Side}

    def _way(self, side: Side, origin: Vector, here: Vector, wanted: State | None) -> list[Extent]:
        """Return how far an arm may go from an origin, through where it is and the wanted state, and its stop [rad]."""
        a_max, j_max = self._a_radps2, self._j_radps3
        if wanted is not None:
            return [
                way_extent(begin, (q, to), stop_extent(v, a, a_max, j_max))
                for begin, q, to, v, a in zip(origin, here, *wanted, strict=True)
            ]
        arm, measured = self._coordinator.body.joint_arms[side], self._coordinator.store.arm(side)
        if arm.running:  # not due in this tick
            stops = [stop_extent(v, a, a_max, j_max) for v, a in zip(arm.rates, arm.reference.forces, strict=True)]
        else:
            speeds = measured.dq_radps if measured is not None and measured.dq_radps else REST
            stops = [STAYS if abs(v) < ADRIFT_RADPS else stop_extent(v, 0.0, a_max, j_max) for v in speeds]
        return [way_extent(begin, (q,), stop) for begin, q, stop in zip(origin, here, stops, strict=True)]

    def _braked(self, side: Side, here: Vector, ways: Ways, reference: JointReference | None) -> Sequence[Extent]:
        """Return how far the joints of an arm go when they brake now [rad]; on its way where nobody here can brake it."""
        if reference is None or self._coordinator.body.joint_arms[side].is_walking:
            return ways[side]
        return self._way(side, here, here, reference.stop_ahead())

    def _stops(
        self, here: Mapping[Side, Vector], moved: Moved, wanted: Mapping[Side, State], ways: Ways, going: Going
    ) -> Stops:
        """Return how both arms go when some joints take the wanted step, the others one of their stop, and then all brake."""
        after = {
            side: state if all(going[side]) else _mixed(state, moved[side].stop_ahead(), going[side])
            for side, state in wanted.items()
        }
        one = next(iter(moved.values()))
        return Stops(here, after, ways, one.space.limits, one.period_s)

    def _together(self, moved: Moved) -> list[tuple[Side, ...]]:
        """Return which arms can only go on or brake as a whole: those on paths, two of one motion at once."""
        rows: list[tuple[Side, ...]] = []
        for side, reference in moved.items():
            if reference.mode in WHOLE:
                motion = self._coordinator.body.motions.of(side)
                rows.append((side,) if motion is None else tuple(motion.goals))
        return rows

    # ------------------------------------------------------------------------------------------------ what it does

    def _hold_back(
        self, parts: CollisionModel, here: Mapping[Side, Vector], moved: Moved, verdict: Verdict, now_ns: int
    ) -> None:
        """Have joints that may not go on take a step of their stop: alone on a stream, all of them on a path."""
        near = parts.posture(here).told(verdict.pair)
        margin_m = parts.margin_m
        text = (
            f"{near.first} and {near.second} are {1e3 * near.gap_m:.0f} mm apart and might come to "
            f"{1e3 * verdict.kept_m:.0f} mm, {1e3 * margin_m:.0f} mm must stay free"
        )
        body = self._coordinator.body
        for side, reference in moved.items():
            arm, going = body.joint_arms[side], verdict.going[side]
            if all(going) or arm.is_walking:
                continue
            if reference.mode is ReferenceMode.FOLLOW:
                reference.lead(_mixed(reference.ahead(), reference.stop_ahead(), going))
                self._tell_held(side, text, now_ns)
            elif reference.mode in WHOLE:
                ended = body.drop_driver(side, MotionState.ABORTED, Code.COLLISION_AHEAD, f"{text}: it brakes")
                arm.brake()
                self._coordinator.report_ended(ended, now_ns)

    def _tell_held(self, side: Side, parts: str, now_ns: int) -> None:
        told_ns = self._held_ns.get(side)
        self._held_ns[side] = now_ns
        if told_ns is None or now_ns - told_ns > QUIET_NS:
            text = f"the targets of the {side} arm are not followed on: {parts}"
            self._coordinator.notice(Code.COLLISION_AHEAD, Level.WARNING, text, now_ns, side=side.value)

    def _tell_off(self, why: str, now_ns: int, *, is_moving: bool) -> None:
        """Tell once that arms move and are not kept apart, and once that they are again."""
        if why and not self._was_off_told and is_moving:
            self._was_off_told = True
            self._coordinator.notice(Code.UNGUARDED, Level.WARNING, f"arms are not kept apart: {why}", now_ns)
        elif not why and self._was_off_told:
            self._was_off_told = False
            self._coordinator.notice(Code.GUARDED, Level.INFO, "arms are kept apart again", now_ns)

    # ------------------------------------------------------------------------------------------------ what is seen

    def _show(self, model: BodyModel, *, why: str, now_ns: int) -> None:
        """Show the nearest pair of the measured body, ten times a second."""
        if now_ns // SHOWN_NS == self._shown_ns // SHOWN_NS:
            return
        self._shown_ns = now_ns
        assert model.collision is not None
        measured = {side: arm.q_rad for side in Side if (arm := self._coordinator.store.arm(side)) is not None}
        near = None
        if not why and len(measured) == len(Side):
            near = model.collision.posture(measured).nearest()
        self._coordinator.body.spacing = SpacingView(
            on=not why,
            why=why,
            gap_m=None if near is None else near.gap_m,
            first="" if near is None else near.first,
            second="" if near is None else near.second,
            margin_m=model.collision.margin_m,
            held=tuple([side.value for side, at_ns in self._held_ns.items() if now_ns - at_ns < SHOWN_NS]),
        )


def _mixed(wanted: State, braked: State, going: Sequence[bool]) -> State:
    """Return a state of the joints that go on, and of those that take a step of their stop."""
    rows = zip(wanted, braked, strict=True)
    return State(*[tuple([w if go else b for w, b, go in zip(*row, going, strict=True)]) for row in rows])
