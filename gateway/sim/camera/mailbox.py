"""How the robot finds pictures that belong together before it stitches them (§5.5): one-slot mailboxes, exact stamps.

Rules
    * Each camera has a mailbox for one picture; a newer one overwrites it and is counted.
    * When all mailboxes are full, the hardware trigger stamps are compared. All equal: these belong together.
    * Otherwise the oldest is dropped, the others stay and wait for its next one. Where several are equally old, all of
      them are dropped (our reading): the newest camera never goes back, so none of them can match any more.

Stamps are whole milliseconds and the comparison is exact: cameras whose stamps differ always by one never match.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Generic, TypeVar

__all__ = ["Mailboxes", "Shot"]

T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class Shot(Generic[T]):
    """One camera's picture.

    Attributes:
        trig_ms: Hardware trigger time [ms].
        picture: What was seen.
    """

    trig_ms: int
    picture: T


class Mailboxes(Generic[T]):
    """One mailbox for each camera.

    Every picture that was put is in exactly one place: put = waiting + cameras * stitched + overwritten + dropped.

    Attributes:
        stitched: Sets of pictures that left together.
        ts_drop: Comparisons that failed; each drops at least one picture.
        overwritten: Pictures of each camera that a newer one replaced.
        dropped: Pictures of each camera that failed comparisons dropped.

    Raises:
        ValueError: If there is no camera.
    """

    def __init__(self, cameras: int) -> None:
        if cameras < 1:
            raise ValueError(f"{cameras} cameras: at least one is needed")
        self._boxes: list[Shot[T] | None] = [None] * cameras
        self.stitched = 0
        self.ts_drop = 0
        self.overwritten = [0] * cameras
        self.dropped = [0] * cameras

    def put(self, camera: int, shot: Shot[T]) -> None:
        """Put a picture into its camera's mailbox.

        Raises:
            IndexError: If there is no such camera.
        """
        if not 0 <= camera < len(self._boxes):
            raise IndexError(f"camera {camera} is outside [0, {len(self._boxes) - 1}]")
        self.overwritten[camera] += self._boxes[camera] is not None
        self._boxes[camera] = shot

    def take(self) -> Sequence[Shot[T]] | None:
        """Return one picture of each camera, all of one trigger, if there are; None when some must be waited for."""
        shots = [shot for shot in self._boxes if shot is not None]
        if len(shots) < len(self._boxes):
            return None
        oldest = min(shot.trig_ms for shot in shots)
        if all(shot.trig_ms == oldest for shot in shots):
            self._boxes = [None] * len(shots)
            self.stitched += 1
            return shots
        self.ts_drop += 1
        for camera, shot in enumerate(shots):
            if shot.trig_ms == oldest:
                self._boxes[camera] = None
                self.dropped[camera] += 1
        return None

    @property
    def waiting(self) -> int:
        """How many mailboxes are full."""
        return sum(shot is not None for shot in self._boxes)
