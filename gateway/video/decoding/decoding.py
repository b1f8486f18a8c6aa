"""From coded pictures to frames: takes the next one, judges it, decodes it, publishes what comes out. One thread's work.

What can be decoded is published, damaged or not, and says so; strict mode withholds what is not clean.
"""

from __future__ import annotations

import logging
import time
from dataclasses import dataclass

from gateway.video.decoding.damage import Damage, Verdict
from gateway.video.decoding.decoder import DecodedPicture, Decoder
from gateway.video.decoding.frame import Frame
from gateway.video.decoding.newest import Newest
from gateway.video.decoding.rgb import LazyRgb, RgbConverter
from gateway.video.hevc.access_unit import AccessUnit
from gateway.video.receiving.health import Meter
from gateway.video.receiving.tap import AccessUnits

__all__ = ["Decoding"]

logger = logging.getLogger(__name__)

HELD_BACK = 16
"""A decoder may hold so many pictures back for reordering, at most (H.265, A.4.2); with more it makes nothing of them."""
PATIENCE_S = 0.5
"""A thread that waits for pictures looks so often whether it shall end [s]."""


@dataclass(frozen=True, slots=True)
class _Given:
    """What a picture was decoded from, without its bytes."""

    rtp_time: int
    first_packet_ns: int
    life: int
    verdict: Verdict


class Decoding:
    """Decodes one stream into frames.

    The decoder is closed at the end.
    """

    def __init__(
        self,
        units: AccessUnits,
        newest: Newest,
        decoder: Decoder,
        converter: RgbConverter,
        *,
        is_strict: bool = False,
        first_seq: int = 0,
        meter: Meter | None = None,
    ) -> None:
        self._units = units
        self._newest = newest
        self._decoder = decoder
        self._converter = converter
        self._is_strict = is_strict
        self._seq = first_seq
        self._damage = Damage()
        self._is_ending = False
        self._barren = 0
        self.meter = meter or Meter()

    def end(self) -> None:
        """Let `run` return soon."""
        self._is_ending = True

    def run(self) -> None:
        """Decode until the end; then the decoder is closed, and nobody waits for frames any more."""
        error: Exception | None = None
        try:
            while not self._is_ending and not self._units.is_over:
                if (unit := self._units.take(PATIENCE_S)) is not None:
                    self.decode(unit)
        except Exception as failure:
            logger.error("the thread that decodes the video ended", exc_info=failure)
            error = failure
        finally:
            self._decoder.close()
            self._newest.close(error)

    def decode(self, unit: AccessUnit) -> None:
        """Decode a coded picture; publish what comes out."""
        began_ns = time.monotonic_ns()
        verdict = self._damage.judge(unit)
        if not verdict.is_decodable:
            self.meter.add(undecodable=1)
            return
        errors = self._decoder.errors
        given = _Given(unit.rtp_time, unit.first_packet_ns, unit.life, verdict)
        pictures = self._decoder.decode(unit, given, begins=verdict.begins)
        self._barren = 0 if pictures else self._barren + 1
        if self._decoder.errors != errors or self._barren > HELD_BACK:
            self.meter.refused(began_ns)
        if self._decoder.has_begun_anew:
            self._damage.begin_anew()
        for picture in pictures:
            self._publish(picture, began_ns)

    def _publish(self, decoded: DecodedPicture[_Given], began_ns: int) -> None:
        given = decoded.mark
        if self._is_strict and not given.verdict.clean:
            self.meter.add(withheld=1)
            return
        now_ns = time.monotonic_ns()
        frame = Frame(
            source=LazyRgb(self._converter, decoded.picture),
            seq=self._seq,
            rtp_time=given.rtp_time,
            received_ns=given.first_packet_ns,
            published_ns=now_ns,
            clean=given.verdict.clean,
            lost=given.verdict.lost,
            life=given.life,
        )
        self._seq += 1
        # Counted first: who is handed it finds it in the figures.
        self.meter.published(now_ns, now_ns - given.first_packet_ns, now_ns - began_ns, clean=given.verdict.clean)
        self._newest.publish(frame)
