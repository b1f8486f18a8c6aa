"""Line gaps: whether the body keeps free of itself along a row of postures, looked at only as often as that takes.

Between two postures no point of an arm goes further than the sum of its joints' travel times its length. So where the gap
is wide, many postures are passed over that cannot have used it up; where it is narrow, each one is looked at. A motion that
begins inside the margin may go on as long as it comes no nearer.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Mapping, Sequence
from typing import TYPE_CHECKING

from gateway.errors import Code, Refusal
from gateway.values import Side, Vector

if TYPE_CHECKING:  # it takes numpy along, which a guard has no use for
    from gateway.kinematics.collision import CollisionModel, Nearness

__all__ = ["LENGTH_M", "too_near"]

LENGTH_M = 0.75
"""No point of an arm, the gripper with it, is further from the axis of any of its joints [m]."""
CLOSER_M = 1e-6
"""Coming nearer by less is rounding [m]."""

Postures = Sequence[Mapping[Side, Vector]]
Told = Callable[[int], str]
"""Says in words where on the way a posture is, by its number."""


def too_near(
    model: CollisionModel, margin_m: float, postures: Postures, told: Told
) -> Generator[None, None, Refusal | None]:
    """Look for the first posture that leaves too little free, one look at a time.

    `postures` are joints of both arms one after the other, the first as they are now, shape (7,) each [rad].
    """
    least_m, number = margin_m, 0
    while number < len(postures):
        nearest = model.posture(postures[number]).nearest()
        if number == 0:
            least_m = min(margin_m, nearest.gap_m - CLOSER_M)
        elif nearest.gap_m < least_m:
            return _refusal(nearest, margin_m, told(number))
        number = _next(postures, number, nearest.gap_m - least_m)
        yield
    return None


def _next(postures: Postures, number: int, room_m: float) -> int:
    """Return the first posture after one at which the room may have been used up; the last one is never passed over."""
    last = len(postures) - 1
    used_m, ahead = 0.0, number
    while used_m <= room_m and ahead < last:
        used_m += LENGTH_M * sum(
            abs(b - a) for side in Side for a, b in zip(postures[ahead][side], postures[ahead + 1][side], strict=True)
        )
        ahead += 1
    return max(ahead if used_m <= room_m else ahead - 1, number + 1)


def _refusal(nearest: Nearness, margin_m: float, where: str) -> Refusal:
    return Refusal(
        code=Code.COLLISION_AHEAD,
        message=f"{where} {nearest.first} would be {1e3 * nearest.gap_m:.0f} mm from {nearest.second}, "
        f"{1e3 * margin_m:.0f} mm have to stay free",
        field=nearest.first,
        value=f"{nearest.gap_m:.6g}",
        bound=f"{margin_m:g}",
        unit="m",
    )
