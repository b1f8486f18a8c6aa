"""Which pictures are clean: intact themselves, and predicted from nothing that is damaged or missing. Pure."""

from __future__ import annotations

from gateway.apps.video.access_unit import AccessUnit

__all__ = ["Chain"]


class Chain:
    """Follows prediction from picture to picture: after a damaged one, none is clean until the next intact IRAP.

    Decoders do not tell: libavcodec conceals what is missing and flags nothing. Only the packets' numbers do.
    """

    def __init__(self) -> None:
        self._is_clean = False
        self._before: AccessUnit | None = None

    def is_clean(self, unit: AccessUnit) -> bool:
        """Take in the next picture that is decoded or recorded; return whether it is clean.

        A picture that is not given here counts as missing: `seq` has a gap there.
        """
        before, self._before = self._before, unit
        if unit.is_irap:
            self._is_clean = unit.is_intact
        else:
            follows = before is not None and unit.life == before.life and unit.seq == before.seq + 1
            self._is_clean = self._is_clean and follows and unit.is_intact and not unit.lost
        return self._is_clean
