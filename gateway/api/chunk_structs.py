"""The request for a trajectory or an action chunk as a struct. Import it from `gateway.api.protocol`."""

from __future__ import annotations

from typing import Annotated, Literal

from msgspec import Meta, field

from gateway.api.incoming import Count, Incoming, Joints, Name, SideName

__all__ = ["CheckFollow", "Follow"]

Points = Annotated[tuple[Joints, ...], Meta(max_length=4096)]
Times = Annotated[tuple[float, ...], Meta(max_length=4096)]
Tolerances = Annotated[tuple[float | None, ...], Meta(max_length=64)]
Offset = Annotated[int, Meta(ge=-(2**62), le=2**62)]


class Follow(Incoming, frozen=True):
    """Follow a trajectory or an action chunk with one or both arms, on one clock.

    Reply: `motion_id`, `duration_ns`, `begins_ns`, `skipped` (points whose time had passed), `moved` (by smoothing).

    Attributes:
        epoch: Lease epoch.
        points: Per side 2 to 450 points, both sides as many: seven joints [rad], or x, y, z [m], qx, qy, qz, qw.
        space: Of the points.
        frames: For poses, per side the frame they are in: the arm's own shoulder (manual §4.0.1).
        dt_s: Time from point to point [s]; the first is passed at 0. Either this or `times_s`.
        times_s: When each point is passed, rising, from 0 on [s].
        stretch: Factor by which all of it becomes slower, 1 to 100.
        smoothing_s: Jitter is averaged over so much time on each side of a point [s]; needs `dt_s`.
        open_end: Whether it ends at speed, with a successor to come; else at rest at its last point.
        start_at_ns: When its time is 0, on the monotonic clock of the daemon's host [ns]; null for `start_in_ns`.
        start_in_ns: The same, from the arrival of the request on [ns], negative for the past; null for now.
        path_tolerance: Per side seven tolerances on the way [rad], for poses two [m, rad]; null where there is none.
        goal_tolerance: The same at the end; null for the configured one.
        goal_time_ns: How long after its end it may settle [ns]; null for the configured time.
    """

    epoch: Count
    points: dict[SideName, Points]
    space: Literal["joint", "pose"] = "joint"
    frames: dict[SideName, Name] = field(default_factory=dict)
    dt_s: float | None = None
    times_s: Times | None = None
    stretch: float = 1.0
    smoothing_s: float = 0.0
    open_end: bool = False
    start_at_ns: Count | None = None
    start_in_ns: Offset | None = None
    path_tolerance: dict[SideName, Tolerances] = field(default_factory=dict)
    goal_tolerance: dict[SideName, Tolerances] = field(default_factory=dict)
    goal_time_ns: Count | None = None


class CheckFollow(Incoming, frozen=True):
    """Judge a trajectory or a chunk as `Follow` would, and move nothing. Anybody may ask; it needs no lease.

    What is not judged is whether the robot may move now (the refusals of the snapshot say that), and whether the arms can
    get onto a trajectory that begins at speed. Reply: `duration_ns`, `skipped`, `moved`, and `away`: per side how far it
    begins from where the arm is, per joint [rad] or position and orientation [m, rad].

    Attributes:
        follow: The request to be judged, whatever its epoch.
        from_here: Whether it must also begin near enough to where the arms are now.
    """

    follow: Follow
    from_here: bool = True
