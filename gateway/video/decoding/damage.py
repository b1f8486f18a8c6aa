"""Which pictures can be trusted: clean ones are intact, and predicted from nothing that is damaged or missing. Pure.

Decoders do not tell: libavcodec conceals what is missing and flags nothing. Only the packets' numbers do.

```
intact key picture (IDR, CRA, BLA)    clean again
intact recovery point                 clean again when as many pictures as it says were intact after it, too
RASL picture after a CRA              predicted from before that: clean only if what came before it was clean as well
any other                             as clean as the one before it, if nothing of it or between them is missing
```

A stream with neither periodic key pictures nor recovery points stays damaged from its first loss until its sender begins
anew: nobody can know when the damage has left the picture. `diagnosis.why` says so.
"""

from __future__ import annotations

from dataclasses import dataclass

from gateway.video.hevc.access_unit import AccessUnit

__all__ = ["MAX_RANGES", "Damage", "Verdict"]

MAX_RANGES = 64
"""So many lost ranges are remembered at most, the newest ones."""

Ranges = tuple[tuple[int, int], ...]


@dataclass(frozen=True, slots=True)
class Verdict:
    """What is known of a picture before it is decoded.

    Attributes:
        is_decodable: Whether a decoder can do anything with it: from the first key picture of a sender on.
        begins: Whether decoding begins with it: what a decoder holds is another sender's.
        clean: Whether it will be what the sender meant.
        lost: What was lost since the last clean picture: ranges of sequence numbers (first, last).
    """

    is_decodable: bool
    begins: bool = False
    clean: bool = False
    lost: Ranges = ()


class Damage:
    """Follows prediction from picture to picture. A picture that is not given here counts as missing."""

    def __init__(self) -> None:
        self._before: AccessUnit | None = None  # None: decoding has not begun
        self._is_clean = False
        self._was_clean = False  # before the newest key picture, for its RASL pictures
        self._until_recovered: int | None = None
        self._lost: Ranges = ()
        self._lost_before: Ranges = ()  # the newest key picture

    def begin_anew(self) -> None:
        """Take in that the decoder has lost everything it held."""
        self._before = None

    def judge(self, unit: AccessUnit) -> Verdict:
        """Return what is to be known of the next picture."""
        begins = self._before is None or unit.life != self._before.life
        if begins:
            self._before, self._is_clean, self._was_clean, self._until_recovered = None, False, False, None
            self._lost = ()
            can_begin = unit.is_irap or unit.recovers_after is not None
            if not (can_begin and unit.has_parameter_sets):
                return Verdict(is_decodable=False, lost=unit.lost)
        follows = self._before is not None and unit.follows(self._before)
        self._before = unit
        self._lost = (*self._lost, *unit.lost)[-MAX_RANGES:]
        if unit.is_irap and unit.is_intact:
            self._was_clean = follows and self._is_clean
            self._lost_before = self._lost
            self._is_clean = True
        else:
            self._go_on(unit, follows=follows)
        lost = self._lost
        if self._is_clean:
            self._lost, self._until_recovered = (), None
            lost = self._lost_before if unit.is_rasl and not self._was_clean else ()
        clean = self._is_clean and (self._was_clean or not unit.is_rasl)
        return Verdict(is_decodable=True, begins=begins, clean=clean, lost=lost)

    def _go_on(self, unit: AccessUnit, *, follows: bool) -> None:
        """Take in a picture that heals nothing by itself, or only after some more."""
        if not unit.is_intact:
            self._is_clean, self._until_recovered = False, None
            return
        if not follows:
            self._is_clean, self._until_recovered = False, None
        if self._is_clean:
            return
        if self._until_recovered is not None:
            self._until_recovered -= 1
        elif unit.recovers_after is not None:
            self._until_recovered = unit.recovers_after
        if self._until_recovered is not None and self._until_recovered <= 0:
            self._is_clean, self._was_clean = True, False
