"""Slowing: streams of poses to an arm in end-effector mode are followed slower where its joints would have to race.

    measured joints + the setpoint's velocity, now and ahead  ->  joint speeds (by the Jacobian)  ->  part of the speed limits

The robot's own IK decides where joints go (manual §4.2), and near a singularity a calm motion of the hand is a wild one of the
elbow or the wrist. What the hand is told is ours: its linear and angular speed limits are multiplied by one factor, such that
the fastest joint, with the shortest joint velocities that do it, stays at `model.singularity_radps`.

Rules
    * On where the configuration asks for it (`model.singularity_slowdown`) and the model agrees with the arm. When it does not,
      poses are followed as without a model, and that is told.
    * It depends on the direction: across a stretched arm nothing is slowed. Where the factor is 1 no setpoint is another.
    * It never stops an arm: what a joint is thought to do is bounded (`dexterity.FLOOR`), so that some part of the speed is
      always left, a tenth with the defaults, towards a singularity and away from it.
    * Three places are looked at in turn, a setpoint each: where the arm is, where it will have answered and braked, and half
      way. The factor falls to the least of them quickly and rises slowly, so that what was seen ahead is not forgotten before
      the arm is there; ruckig takes the speed there inside its acceleration and jerk.
    * Only streams. Paths and trajectories of poses are timed as a whole before they begin: ask for less speed. Setpoints of
      joints need none of it: their speed is bounded joint by joint, wherever the arm is; so are those of motions to a pose by
      the model, and straight ways are slowed where they are planned (`line_clock.py`).

It is a prediction of the first order: what the robot's IK does with the seventh joint is its own affair.

A look costs one Jacobian for each arm that follows poses, some 40 µs, and nothing otherwise.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

from gateway.core.messages.outputs import Level
from gateway.core.motion.motion import PoseReference, ReferenceMode
from gateway.core.motion.poses.pose_state import PoseDynamics
from gateway.core.supervision.coordinator import Coordinator
from gateway.errors import Code, Refusal
from gateway.messages.body_views import SlowingView
from gateway.values import ARM_DOF, Side, Vector

if TYPE_CHECKING:  # it takes numpy along, which a guard has no use for
    from gateway.core.robot_state.body_model import BodyModel

__all__ = ["Slowing", "predicted"]

RESPONSE_S = 0.1
"""An arm is behind its setpoint by about so long, the robot's IK and our own link included [s]."""
PLACES = (0.0, 1.0, 0.5)
"""Parts of the way ahead that are looked at, in turn. The arm's own place comes first: the others are found from there."""
SOON_S = 0.1
"""Ahead it goes as it does now and so long of its present acceleration [s]: streams change their direction."""
FALL_PER_S = 30.0
"""How quickly the factor may fall [1/s]; ruckig takes longer for the speed."""
RISE_PER_S = 1.0
"""How quickly it may rise [1/s]."""
HELD = 0.8
"""From this part of what it may on an arm goes as fast as it may: along several axes it is not quite all of it."""


class Sight(NamedTuple):
    """What one place tells.

    Attributes:
        factor: Part of the speed limits at which the fastest joint is at its bound there; above 1 where it is slower.
        joint: The fastest, from 0.
        radps: How fast it would be at the full limits [rad/s].
    """

    factor: float
    joint: int
    radps: float


CLEAR = Sight(math.inf, 0, 0.0)
"""Nothing moves."""
STILL: Vector = (0.0,) * ARM_DOF

NOT_ASKED = Refusal(
    code=Code.MODEL_OFF,
    message="section [model] of the configuration does not ask for it",
    field="model.singularity_slowdown",
    value="false",
)


def predicted(dq_radps: Sequence[float], share: float, bound_radps: float) -> Sight:
    """Return what joint velocities tell.

    Args:
        dq_radps: Of the joints, shape (7,) [rad/s], not all 0, for what the end effector does ...
        share: ... which is this part of its speed limits, above 0.
        bound_radps: What the fastest joint may do [rad/s].
    """
    sizes = [abs(dq) for dq in dq_radps]
    fastest = max(sizes)
    return Sight(share * bound_radps / fastest, sizes.index(fastest), fastest / share)


class _Gauge:
    """What is known of one arm that follows poses."""

    def __init__(self) -> None:
        self.turn = 0
        self.factor = 1.0
        self.sights = [CLEAR] * len(PLACES)
        self.share = 0.0
        """Part of the speed limits that it goes at."""
        self.going: Vector = ()
        """How the joints go [rad/s], as fast as they may; empty before the first look."""

    @property
    def worst(self) -> Sight:
        """The place that asks for most."""
        return min(self.sights)


class Slowing:
    """Bounds the speed of followed poses."""

    def __init__(self, coordinator: Coordinator) -> None:
        self._coordinator = coordinator
        model = coordinator.settings.model
        self._is_asked, self._bound_radps = model.singularity_slowdown, model.singularity_radps
        self._gauges: dict[Side, _Gauge] = {}
        self._was_off_told: set[Side] = set()

    def look(self, now_ns: int) -> None:
        """Look at the arms whose next pose leaves in this tick, before it is taken."""
        body = self._coordinator.body
        for side, arm in body.pose_arms.items():
            due_ns = arm.next_due_ns()
            if due_ns is None or arm.reference.mode is not ReferenceMode.FOLLOW:
                if side in body.slowing:
                    del body.slowing[side]
                    self._gauges.pop(side, None)
            elif due_ns <= now_ns:
                body.slowing[side] = self._followed(side, arm.reference, now_ns)

    def _followed(self, side: Side, reference: PoseReference, now_ns: int) -> SlowingView:
        """Bound the speed of one arm's stream, and return what may be seen of it."""
        coordinator = self._coordinator
        refusal = coordinator.model_refusal(side, now_ns) if self._is_asked else NOT_ASKED
        if refusal is not None:
            self._tell_off(side, refusal, now_ns)
            self._gauges.pop(side, None)
            reference.bound(1.0)
            return self._view(CLEAR, 1.0, refusal.message)
        self._was_off_told.discard(side)
        model, measured = coordinator.model, coordinator.store.arm(side)
        assert model is not None and measured is not None, "a model that agrees was compared with joints"
        gauge = self._gauges.setdefault(side, _Gauge())
        self._judge(model, side, gauge, reference, measured.q_rad)
        reference.bound(gauge.factor)
        held = gauge.factor < 1.0 and gauge.share >= HELD * gauge.factor
        return self._view(gauge.worst, gauge.factor, "", held=held)

    def _tell_off(self, side: Side, refusal: Refusal, now_ns: int) -> None:
        """Tell once that the model does not agree; that there is none, or that nobody asked for it, is no news."""
        if refusal.code is not Code.MODEL_OFF and side not in self._was_off_told:
            self._was_off_told.add(side)
            text = f"poses of the {side} arm are not slowed down near singularities: {refusal.message}"
            self._coordinator.notice(refusal.code, Level.WARNING, text, now_ns, side=side.value)

    def _judge(self, model: BodyModel, side: Side, gauge: _Gauge, reference: PoseReference, q_rad: Vector) -> None:
        """Look at one place, at all of them in the first look; set the factor."""
        for _ in range(1 if gauge.going else len(PLACES)):
            gauge.sights[gauge.turn] = self._sight(model, side, gauge, reference, q_rad)
            gauge.turn = (gauge.turn + 1) % len(PLACES)
        target = min(1.0, gauge.worst.factor)
        if reference.is_at_rest:
            gauge.factor = target
        else:
            period_s = reference.period_s
            gauge.factor = min(max(target, gauge.factor - FALL_PER_S * period_s), gauge.factor + RISE_PER_S * period_s)

    def _sight(self, model: BodyModel, side: Side, gauge: _Gauge, reference: PoseReference, q_rad: Vector) -> Sight:
        """Return what the place whose turn it is tells."""
        part = PLACES[gauge.turn]
        rates = reference.rates if any(reference.rates) else reference.wish()
        there = q_rad
        if part:
            ahead_s = part * (RESPONSE_S + 0.5 * _brake_s(rates, reference.space))
            there = tuple([q + ahead_s * dq for q, dq in zip(q_rad, gauge.going, strict=True)])
            rates = tuple([v + part * SOON_S * a for v, a in zip(rates, reference.forces, strict=True)])
        share = _share(rates, reference.space)
        dq_radps: Vector = model.joint_speeds_radps(side, there, rates) if share else STILL
        sight = predicted(dq_radps, share, self._bound_radps) if share else CLEAR
        if not part:
            slower = min(1.0, sight.factor / share) if share else 0.0
            gauge.share, gauge.going = share, tuple([slower * dq for dq in dq_radps])
        return sight

    def _view(self, worst: Sight, factor: float, why: str, *, held: bool = False) -> SlowingView:
        return SlowingView(
            on=not why,
            why=why,
            speed_ratio=factor,
            held=held,
            joint=worst.joint + 1 if worst.radps else 0,
            joint_radps=worst.radps,
            bound_radps=self._bound_radps,
        )


def _share(rates: Vector, dynamics: PoseDynamics) -> float:
    """Return which part of the speed limits a velocity is, linear or angular."""
    return max(math.hypot(*rates[:3]) / dynamics.linear.speed, math.hypot(*rates[3:]) / dynamics.angular.speed)


def _brake_s(rates: Vector, dynamics: PoseDynamics) -> float:
    """Return how long it takes at most to brake from a velocity [s]."""
    sizes = (math.hypot(*rates[:3]), dynamics.linear), (math.hypot(*rates[3:]), dynamics.angular)
    return max(size / group.a + group.a / group.j for size, group in sizes)
