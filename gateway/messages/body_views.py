"""What the outside may see of what the body model does to motion. Part of the snapshot; import the names from `snapshot.py`."""

from __future__ import annotations

from msgspec import Struct

__all__ = ["SlowingView", "SpacingView"]


class SpacingView(Struct, frozen=True, kw_only=True):
    """How near parts of the body are to each other, as measured, and whether arms are kept apart.

    Attributes:
        on: Whether setpoints are kept from bringing parts nearer than the margin.
        why: Why not; empty while they are.
        gap_m: Free distance of the nearest pair, negative inside each other [m]; None while it is off.
        first: Name of one part of that pair, e.g. `left_palm`; empty while it is off.
        second: Name of the other.
        margin_m: What has to stay free [m].
        held: Arms whose targets are not followed on because of it: `left`, `right`.
    """

    on: bool
    why: str
    gap_m: float | None
    first: str
    second: str
    margin_m: float
    held: tuple[str, ...]


class SlowingView(Struct, frozen=True, kw_only=True):
    """How near a singularity an arm is whose poses are streamed, in the direction in which it goes.

    Attributes:
        on: Whether its poses are followed slower near singularities.
        why: Why not; empty while they are.
        speed_ratio: Part of the speed limits that is left, linear and angular alike; 1 while nothing is slowed.
        held: Whether that is what holds it back: it goes as fast as it may.
        joint: The joint that would be fastest at the full limits, 1 to 7; 0 while nothing moves, and while it is off.
        joint_radps: How fast that would be [rad/s]; 0 likewise.
        bound_radps: How fast it may be [rad/s].
    """

    on: bool
    why: str
    speed_ratio: float
    held: bool
    joint: int
    joint_radps: float
    bound_radps: float
