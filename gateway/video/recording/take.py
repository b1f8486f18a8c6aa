"""One recording: its file and its index, written picture by picture. Knows no thread and no clock but the wall's offset.

Rules
    * It begins at the first intact IRAP that has its parameter sets: what came before cannot be decoded.
    * So does every new sender; pictures of it before that are told as dropped.
    * Damaged pictures are recorded as they came, and marked: what is left of them is for the user to judge.
    * Arrivals are by the wall clock of its begin, kept by the monotonic one, as in a bag: no step of the host's clock shows.
"""

from __future__ import annotations

import platform
import time
from dataclasses import dataclass, replace
from datetime import datetime, timezone
from pathlib import Path

from gateway import __version__
from gateway.video.decoding.damage import Damage
from gateway.video.decoding.libav import av
from gateway.video.hevc.access_unit import AccessUnit
from gateway.video.recording.container import Container
from gateway.video.recording.index import Dropped, End, Header, IndexWriter, Picture, index_path
from gateway.video.recording.placement import Placement

__all__ = ["Counts", "Take"]

S = 1_000_000_000


@dataclass(frozen=True, slots=True, kw_only=True)
class Counts:
    """How far a recording is.

    Attributes:
        pictures: In it.
        damaged: Of these, not clean.
        dropped: Arrived after it began, and are not in it.
        skipped: Arrived before it could begin.
        size: Of its pictures [bytes].
        newest_pts: Where the newest one stands [ticks]; -1 before the first.
    """

    pictures: int = 0
    damaged: int = 0
    dropped: int = 0
    skipped: int = 0
    size: int = 0
    newest_pts: int = -1


class Take:
    """Writes a recording.

    Args:
        path: Of its file, .mkv or .mp4; there must be no such file, nor its index.
        robot: Address that pictures are taken from; empty for anybody's.

    Raises:
        Rejected: BAD_REQUEST, no format goes by such a name.
        OSError: A file exists, or cannot be written.
    """

    def __init__(self, path: Path, robot: str = "") -> None:
        self.path = path
        self._robot = robot
        self._container = Container(path)
        try:
            self._index = IndexWriter(index_path(path))
        except OSError:
            self._container.close()
            path.unlink()
            raise
        self._anchor_ns = time.time_ns() - time.monotonic_ns()
        self._placement = Placement()
        self._damage = Damage()
        self._life: int | None = None
        self.counts = Counts()

    def write(self, unit: AccessUnit) -> None:
        """Take in the next picture.

        Raises:
            OSError: It cannot be written.
        """
        if not unit.data or (unit.life != self._life and not self._can_begin(unit)):
            if self._life is None:
                self.counts = replace(self.counts, skipped=self.counts.skipped + 1)
            else:
                self.drop(1, "of a new sender before its first intact IRAP" if unit.data else "nothing is left of it")
            return
        self._life = unit.life
        pts, clean, counts = self._placement.place(unit), self._damage.judge(unit).clean, self.counts
        try:
            self._container.write(unit, pts)
        except av.InvalidDataError:
            self.drop(1, "no container takes what is left of it")
            return
        picture = Picture(
            n=counts.pictures,
            pts=pts,
            seq=unit.seq,
            rtp_time=unit.rtp_time,
            life=unit.life,
            ssrc=unit.ssrc,
            arrival_ns=unit.first_packet_ns,
            arrival_wall_ns=unit.first_packet_ns + self._anchor_ns,
            size=len(unit.data),
            irap=unit.is_irap,
            intact=unit.is_intact,
            clean=clean,
            lost=unit.lost,
        )
        self._index.write(picture)
        self.counts = replace(
            counts,
            pictures=counts.pictures + 1,
            damaged=counts.damaged + (not clean),
            size=counts.size + len(unit.data),
            newest_pts=pts,
        )

    def drop(self, count: int, why: str) -> None:
        """Note that pictures which arrived are not in it.

        Raises:
            OSError: It cannot be written.
        """
        self.counts = replace(self.counts, dropped=self.counts.dropped + count)
        self._index.write(Dropped(count=count, why=why))

    def end(self, why: str) -> None:
        """End it; without a picture, nothing is left of it.

        Raises:
            OSError: The end cannot be written; what stands in the file is readable.
        """
        try:
            self._container.close()
            self._index.write(End(why=why, pictures=self.counts.pictures, dropped=self.counts.dropped))
        finally:
            self._index.close()
            if self._life is None:
                self.path.unlink(missing_ok=True)
                index_path(self.path).unlink(missing_ok=True)

    def _can_begin(self, unit: AccessUnit) -> bool:
        """Return whether decoding can begin with the first picture of a sender; begin the recording with the first of all."""
        if not (unit.is_irap and unit.is_intact and unit.has_parameter_sets):
            return False
        if self._life is None:
            if not self._container.open(unit):
                return False
            self._write_header(unit)
        return True

    def _write_header(self, unit: AccessUnit) -> None:
        wall_ns = unit.first_packet_ns + self._anchor_ns
        versions = {"gateway": __version__, "python": platform.python_version(), "av": av.__version__} | {
            name: ".".join(map(str, version)) for name, version in av.library_versions.items()
        }
        self._index.write(
            Header(
                file=self.path.name,
                robot=self._robot,
                ssrc=unit.ssrc,
                started=datetime.fromtimestamp(wall_ns / S, timezone.utc).isoformat(),
                started_wall_ns=wall_ns,
                started_ns=unit.first_packet_ns,
                width=self._container.width,
                height=self._container.height,
                versions=versions,
            )
        )
