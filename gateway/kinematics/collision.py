"""Collision: how far the body's parts are from each other, which are nearest, and how that changes with the joints.

Distances are those of the capsules of `capsules.py` in one frame, `chest`: midway between the shoulders, x forward, y left,
z up. A negative distance is how far two parts are inside each other. Plain floats: of some 150 pairs most are told apart by
spheres around them, which is cheaper one by one than a single call of an array library is for all.

How far a pair would come together is told by `Nearness.slopes`: the change of distance by each joint of both arms.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from msgspec import Struct
from msgspec.structs import replace

from gateway.errors import Code, failure
from gateway.kinematics.capsules import BASE, CHEST, Capsule, Hull, hull
from gateway.kinematics.description import Description, arm_joint, shoulder_joint
from gateway.kinematics.placement import Placement, turn_rad
from gateway.kinematics.separation.segments import Segment, nearest, segment
from gateway.kinematics.solving.chain import ArmChain, in_base
from gateway.robot.topics import shoulder_frame
from gateway.values import ARM_DOF, Side, Vector, require_finite

__all__ = ["WIDE_OPEN_M", "CollisionModel", "Nearness", "Posture"]

WIDE_OPEN_M = 0.087
"""Opening of a gripper at its motor's greatest angle [m] (description and §4.4.2): what is taken when nobody tells."""
TOUCHING_M = 1e-9
"""Lines nearer than this have no direction between them: that of the parts' middles is taken [m]."""
ALIKE_RAD = 1e-9
"""Frames that are turned against each other by less are parallel [rad]."""

Point = tuple[float, float, float]


class Nearness(Struct, frozen=True, kw_only=True):
    """Two parts and how near they are.

    Attributes:
        first: Name of one part; always one of an arm.
        second: Name of the other.
        gap_m: Free distance between them; negative when they are inside each other [m].
        first_m: The first one's nearest point on its line, in `chest`, shape (3,) [m].
        second_m: The other's, likewise [m].
        slopes: How the gap changes by each joint, per side shape (7,) [m/rad]; of the nearest points as they are now.
    """

    first: str
    second: str
    gap_m: float
    first_m: Point
    second_m: Point
    slopes: Mapping[Side, Vector]

    def closing_mps(self, dq_radps: Mapping[Side, Sequence[float]]) -> float:
        """Return how quickly the parts come together; negative when they part [m/s].

        Args:
            dq_radps: Joint velocities of both arms, shape (7,) each [rad/s].
        """
        return -sum(s * v for side in Side for s, v in zip(self.slopes[side], dq_radps[side], strict=True))


class Posture:
    """The body at one moment.

    Attributes:
        segments: Line of each capsule in `chest`, in order of the hull.
        middles: Of these lines [m].
        lines: For each arm its joints' points [m] and axes, flat, shape (42,), in its shoulder frame moved to `chest`.
    """

    __slots__ = ("lines", "middles", "model", "segments")

    def __init__(self, model: CollisionModel, segments: list[Segment], lines: dict[Side, list[float]]) -> None:
        self.model = model
        self.segments = segments
        self.middles = [(x + 0.5 * u, y + 0.5 * v, z + 0.5 * w) for x, y, z, u, v, w, _ in segments]
        self.lines = lines

    def nearest(self) -> Nearness:
        """Return the nearest pair."""
        return self.told(self.within(-math.inf)[0][1])

    def within(self, horizon_m: float) -> list[tuple[float, int]]:
        """Return gaps and numbers of the watched pairs with at most this gap [m], the nearest first; at least that one."""
        found: list[tuple[float, int]] = []
        least = math.inf
        segments, middles = self.segments, self.middles
        dist, sqrt = math.dist, math.sqrt
        cut = math.inf
        for number, (i, j, around_m, radii_m) in enumerate(self.model.pairs):
            if dist(middles[i], middles[j]) - around_m > cut:
                continue
            square, _, _ = nearest(segments[i], segments[j])
            gap = sqrt(square) - radii_m
            if gap < least:
                least = gap
                cut = gap if gap > horizon_m else horizon_m
            if gap <= cut:
                found.append((gap, number))
        found.sort()
        return [row for row in found if row[0] <= horizon_m] or found[:1]

    def told(self, number: int) -> Nearness:
        """Return what is known of a watched pair."""
        i, j, _, radii_m = self.model.pairs[number]
        first, second = self.model.capsules[i], self.model.capsules[j]
        square, s, t = nearest(self.segments[i], self.segments[j])
        a, b = at(self.segments[i], s), at(self.segments[j], t)
        normal = self.normal(i, j, a[0] - b[0], a[1] - b[1], a[2] - b[2])
        slopes = {side: [0.0] * ARM_DOF for side in Side}
        for capsule, point, sign in ((first, a, 1.0), (second, b, -1.0)):
            if capsule.side is not None and capsule.after:
                for k, slope in enumerate(along(self.lines[capsule.side], capsule.after, point, normal)):
                    slopes[capsule.side][k] += sign * slope
        return Nearness(
            first=first.name,
            second=second.name,
            gap_m=math.sqrt(square) - radii_m,
            first_m=a,
            second_m=b,
            slopes={side: tuple(row) for side, row in slopes.items()},
        )

    def normal(self, i: int, j: int, x: float, y: float, z: float) -> Point:
        """Return the way x, y, z from capsule j's nearest point to capsule i's [m] as a unit vector."""
        length = math.sqrt(x * x + y * y + z * z)
        if length < TOUCHING_M:
            x, y, z = (one - other for one, other in zip(self.middles[i], self.middles[j], strict=True))
            length = math.sqrt(x * x + y * y + z * z)
            if length < TOUCHING_M:
                return 0.0, 0.0, 1.0
        return x / length, y / length, z / length


class CollisionModel:
    """Both arms, the body between them and what they stand on.

    Args:
        description: Numbers of the body.
        shape: Its hull as described; None for our own data.

    Raises:
        ConfigError: BAD_CONFIG, the shoulder frames that are described are not parallel.

    Attributes:
        capsules: Parts of the hull, in its order; those of an arm where its reported joints are at zero.
        chains: Of both arms as calibrated, from the shoulder frames as described: a calibration moves no shoulder.
        margin_m: What has to stay free between any two parts [m].
        pairs: For each watched pair: numbers of its parts, radius of the spheres around both, sum of both radii [m];
            those of two moving parts come first.
    """

    def __init__(self, description: Description, shape: Hull | None = None) -> None:
        shape = hull() if shape is None else shape
        plain = description.described or description
        shoulders = {name: plain.joints[name] for name in map(shoulder_joint, Side)}
        description = replace(description, joints={**description.joints, **shoulders})
        self.capsules = tuple(_carried(capsule, description, plain) for capsule in shape.capsules)
        self.margin_m = shape.margin_m
        self.chains = {side: ArmChain(description, side) for side in Side}
        numbers = {capsule.name: number for number, capsule in enumerate(self.capsules)}
        self.pairs: list[tuple[int, int, float, float]] = []
        for pair in sorted(shape.watched, key=lambda pair: not pair.second.after):
            radii_m = pair.first.radius_m + pair.second.radius_m
            halves_m = 0.5 * (
                math.dist(pair.first.from_m, pair.first.to_m) + math.dist(pair.second.from_m, pair.second.to_m)
            )
            self.pairs.append((numbers[pair.first.name], numbers[pair.second.name], halves_m + radii_m, radii_m))
        left, right = (in_base(description, shoulder_frame(side)) for side in Side)
        turned_rad = math.hypot(*turn_rad(left.rows, right.rows))
        if turned_rad > ALIKE_RAD:
            raise failure(
                Code.BAD_CONFIG,
                f"the two shoulder frames are turned against each other by {turned_rad:.3g} rad, not parallel as on this "
                "robot (A.3)",
                field="model.urdf",
                value=f"{turned_rad:.3g}",
                bound="0",
                unit="rad",
                hint="make them parallel in that description, or leave model.urdf empty",
            )
        origin = tuple(0.5 * (a + b) for a, b in zip(left.p_m, right.p_m, strict=True))
        chest_T_base = Placement(origin, left.rows).inverse()
        self.shoulders = {side: chest_T_base.point(at.p_m) for side, at in ((Side.LEFT, left), (Side.RIGHT, right))}
        self._fixed = [(c, *_ends(c, chest_T_base)) for c in self.capsules if not c.after]
        self._up = chest_T_base.turned((0.0, 0.0, 1.0))
        self._arms = {side: [c for c in self.capsules if c.after and c.side is side] for side in Side}

    def posture(self, q_rad: Mapping[Side, Sequence[float]], lowered_m: float = 0.0) -> Posture:
        """Return the body with its joints at some angles, the grippers wide open.

        Args:
            q_rad: Of both arms, shape (7,) each [rad]; not judged by limits.
            lowered_m: How far the lift is below its top [m]; a body without one is at the top.

        Raises:
            ValueRefused: An arm has another number of angles, or something is not finite.
        """
        segments: list[Segment] = []
        lines: dict[Side, list[float]] = {}
        for side in Side:
            require_finite("q_rad", tuple(q_rad[side]), ARM_DOF)
            lines[side] = self._arm(side, q_rad[side], segments)
        require_finite("lift", (lowered_m,), 1)
        ux, uy, uz = (lowered_m * c for c in self._up)
        for capsule, (ax, ay, az), (bx, by, bz) in self._fixed:
            if capsule.frame == BASE:
                segments.append(segment(ax + ux, ay + uy, az + uz, bx + ux, by + uy, bz + uz))
            else:
                segments.append(segment(ax, ay, az, bx, by, bz))
        return Posture(self, segments, lines)

    def _arm(self, side: Side, q_rad: Sequence[float], segments: list[Segment]) -> list[float]:
        """Add an arm's segments; return its lines."""
        lines, motions = self.chains[side].walk(q_rad)
        sx, sy, sz = self.shoulders[side]
        for capsule in self._arms[side]:
            px, py, pz, xx, xy, xz, yx, yy, yz, zx, zy, zz = motions[capsule.after - 1]
            (ax, ay, az), (bx, by, bz) = capsule.from_m, capsule.to_m
            u, v, w = bx - ax, by - ay, bz - az
            dx, dy, dz = capsule.opens
            ax, ay, az = ax + WIDE_OPEN_M * dx, ay + WIDE_OPEN_M * dy, az + WIDE_OPEN_M * dz
            segments.append(
                (
                    sx + px + xx * ax + xy * ay + xz * az,
                    sy + py + yx * ax + yy * ay + yz * az,
                    sz + pz + zx * ax + zy * ay + zz * az,
                    xx * u + xy * v + xz * w,
                    yx * u + yy * v + yz * w,
                    zx * u + zy * v + zz * w,
                    u * u + v * v + w * w,
                )
            )
        for index in range(0, len(lines), 6):
            lines[index] += sx
            lines[index + 1] += sy
            lines[index + 2] += sz
        return lines


def at(piece: Segment, part: float) -> Point:
    """Return a point of a segment [m]."""
    x, y, z, u, v, w, _ = piece
    return x + part * u, y + part * v, z + part * w


def along(lines: Sequence[float], count: int, point: Point, direction: Point) -> list[float]:
    """Return how far a point goes in a direction by each of the first joints [m/rad].

    `direction` is a unit vector, shape (3,).
    """
    px, py, pz = point
    nx, ny, nz = direction
    found = []
    for index in range(0, 6 * count, 6):
        x, y, z, ax, ay, az = lines[index : index + 6]
        x, y, z = px - x, py - y, pz - z
        found.append(nx * (ay * z - az * y) + ny * (az * x - ax * z) + nz * (ax * y - ay * x))
    return found


def _carried(capsule: Capsule, description: Description, plain: Description) -> Capsule:
    """Return a part that is given for an arm as described where it is for the same arm as calibrated, both at zero."""
    if capsule.side is None or not capsule.after or description.described is None:
        return capsule
    link = plain.joints[arm_joint(capsule.side, capsule.after)].child
    shoulder = in_base(plain, shoulder_frame(capsule.side))
    moved = shoulder.inverse().after(in_base(description, link)).after(in_base(plain, link).inverse()).after(shoulder)
    begin, end = moved.point(capsule.from_m), moved.point(capsule.to_m)
    return replace(capsule, from_m=begin, to_m=end, opens=moved.turned(capsule.opens))


def _ends(capsule: Capsule, chest_T_base: Placement) -> tuple[Vector, Vector]:
    """Return both ends of a part that no joint moves, in `chest`, lift at its top."""
    if capsule.frame == CHEST:
        return capsule.from_m, capsule.to_m
    return chest_T_base.point(capsule.from_m), chest_T_base.point(capsule.to_m)
