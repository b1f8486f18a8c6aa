"""Space: what the one core of motion (`motion.py`) needs to know of where it moves: joints, or poses of an end effector.

A *state* is a place and its first two derivatives. Joints are R^7, and derivatives have as many numbers as the place. A pose
is R^3 x SO(3): a position and a unit quaternion, seven numbers; its derivatives have six, the angular ones about the frame's
axes, in the tangent at the present orientation. A *course* gives states by its own time.

`joints.braking.Braking` and `poses.pose_state.PoseDynamics` are the two spaces: the limits, and the stop that keeps them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Generic, NamedTuple, Protocol, TypeVar

from gateway.values import ValueRefused, Vector, require_finite

__all__ = ["Course", "MotionSpace", "PlanFailed", "SpaceT", "Start", "State", "check_finite", "check_speed"]


class State(NamedTuple):
    """One instant of a motion.

    Attributes:
        values: The setpoint: seven joints [rad], or x, y, z [m], qx, qy, qz, qw.
        v: Its velocity, shape (7,) [rad/s], or linear, then angular, shape (6,) [m/s, rad/s].
        a: Its acceleration, likewise [rad/s²], [m/s², rad/s²].
    """

    values: Vector
    v: Vector
    a: Vector

    @property
    def is_at_rest(self) -> bool:
        """Whether nothing moves."""
        return not any(self.v) and not any(self.a)


class Course(Protocol):
    """What a reference can follow: the state as a function of the course's own time. It ends at rest."""

    @property
    def start(self) -> State:
        """The state at time 0."""

    @property
    def duration_s(self) -> float:
        """Time until it rests [s]."""

    def at(self, time_s: float) -> State:
        """Return the state then; asked at multiples of the period."""


class MotionSpace(Protocol):
    """Limits of one arm's motion, and what keeps them."""

    @property
    def period_s(self) -> float:
        """Time between setpoints [s]."""

    @property
    def home(self) -> State:
        """What a reference holds before it is seeded."""

    def check_place(self, name: str, values: Sequence[float]) -> State:
        """Return the state at rest there, inside the limits; raise PlanFailed, with `name`, where there is none."""

    def check_entry(self, values: Sequence[float], rates: Sequence[float], forces: Sequence[float]) -> State:
        """Return a state that keeps all limits, also while it brakes; raise PlanFailed where it does not."""

    def halt(self, state: State) -> Course:
        """Return the quickest way to rest; it cannot fail."""

    def halted(self, state: State) -> Vector:
        """Return where that ends."""

    def settle(self, state: State, last: State) -> State:
        """Return a state as it is handed out after the last one: without what rounding, or a choice of sign, put on it."""


SpaceT = TypeVar("SpaceT", bound=MotionSpace)


@dataclass(frozen=True, slots=True)
class Start(Generic[SpaceT]):
    """Where a plan begins: the state of one arm's reference, and its limits."""

    state: State
    space: SpaceT


class PlanFailed(ValueError):
    """An input or a plan cannot be used; nothing has changed.

    Attributes:
        joint: Which joint, e.g. `left arm joint 4`; empty when none is to blame.
        value: The offending value; NaN when there is none.
        bound: The bound as text; empty when there is none.
    """

    def __init__(self, message: str, *, joint: str = "", value: float = math.nan, bound: str = "") -> None:
        super().__init__(message)
        self.joint = joint
        self.value = value
        self.bound = bound


def check_finite(name: str, values: Sequence[float], size: int) -> Vector:
    """Return values as a vector when there are so many finite ones.

    Raises:
        PlanFailed: With the name.
    """
    vector = tuple(values)
    try:
        require_finite(name, vector, size)
    except ValueRefused as refused:
        raise PlanFailed(str(refused)) from refused
    return vector


def check_speed(speed: float) -> float:
    """Return the factor when 0 < speed <= 1.

    Raises:
        PlanFailed: With value and bound.
    """
    if not 0.0 < speed <= 1.0:
        raise PlanFailed(f"speed is {speed}, a factor in (0, 1] is needed", value=speed, bound="(0, 1]")
    return speed
