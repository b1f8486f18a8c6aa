"""RTP payloads of H.265 in order -> coded pictures (RFC 7798 section 4.4), each with what is known to be wrong with it.

Rules
    * Single NAL units, aggregation packets (AP) and fragmentation units (FU) are read; PACI packets are counted.
    * A picture ends with the marker, or with the next RTP time. A sender that sets no marker costs a picture of latency;
      markers that are followed by more of the same picture are no longer believed.
    * A picture is intact when it is known to have begun and to have ended, and nothing was lost, malformed or headless
      between. After a loss it is known to have begun when it begins with what only stands at the beginning.
    * The part of a NAL unit before a loss is kept: it can be shown, flagged.
    * Parameter sets are remembered and put before a picture that decoding can begin with, where they are missing.
    * A fragment that is shorter than others was cut short, where the sender makes them of one size (`evenness`).
    * DONL fields (RFC 7798 section 4.4.1) cannot be told from the packets. They make nearly every AP malformed, and the
      first slice of every picture seem missing: `unsupported` says so when it goes on.

Pure: one life of one sender; packets in, pictures out.
"""

from __future__ import annotations

from typing import Final

from gateway.video.hevc.access_unit import AccessUnit
from gateway.video.hevc.nal import HEADER_BYTES, PARAMETER_SETS, NalType, is_valid, nal_type
from gateway.video.hevc.parameter_sets import ParameterSets
from gateway.video.hevc.picture import Picture, joined
from gateway.video.receiving.counters import Tally
from gateway.video.receiving.evenness import Evenness
from gateway.video.receiving.reorder import Ordered

__all__ = ["Depacketiser"]

MAX_MALFORMED: Final = {"ap": 3, "fu": 3, "paci": 3, "head": 6}
"""So many of a kind in a row, and none that is right: the sender uses something that this receiver does not read."""
LYING_MARKERS: Final = 3
"""Markers followed by more of the same picture, after which none is believed."""
MAX_PICTURES_LOST: Final = 10_000
FU_HEADER_BYTES: Final = HEADER_BYTES + 1
_START: Final = 0x80
_END: Final = 0x40
_KIND: Final = 0x3F


class Depacketiser:
    """One life of a sender."""

    def __init__(self, tally: Tally, *, ssrc: int, life: int, seq: int) -> None:
        self.seq = seq
        """Of the next picture."""
        self.period = 0
        """Usual distance of two pictures [ticks]; 0 before it is known."""
        self._tally = tally
        self._ssrc = ssrc
        self._life = life
        self._sets = ParameterSets()
        self._picture: Picture | None = None
        self._lost: list[tuple[int, int]] = []  # before the next picture
        self._is_between = False  # whether the last packet ended a picture
        self._has_orphans = True  # whether fragments without a beginning are a loss that is known already
        self._sees_delimiters = False
        self._ended_time: int | None = None  # of the last picture that a marker ended
        self._early_markers = 0
        self._last_time: int | None = None  # of the last picture handed out
        self._in_a_row = dict.fromkeys(MAX_MALFORMED, 0)
        self._evenness = Evenness()

    @property
    def knows_parameter_sets(self) -> bool:
        """Whether a VPS, an SPS and a PPS have come."""
        return self._sets.is_complete

    @property
    def is_in_picture(self) -> bool:
        """Whether a picture has begun and not ended."""
        return self._picture is not None

    @property
    def awaits(self) -> bytes:
        """What the next fragment begins with; see `Picture.awaits`."""
        return b"" if self._picture is None else self._picture.awaits

    @property
    def unsupported(self) -> str:
        """What in the stream goes on being malformed: `ap`, `fu`, `paci` or `head`; empty when nothing does."""
        return next((kind for kind, most in MAX_MALFORMED.items() if self._in_a_row[kind] >= most), "")

    def push(self, ordered: Ordered, rtp_time: int, now_ns: int) -> list[AccessUnit]:
        """Take the next packet; return the pictures that are complete now.

        RTP time is unwrapped [ticks].
        """
        picture, packet = self._picture, ordered.packet
        if (
            picture is not None
            and packet.payload[:FU_HEADER_BYTES] == picture.awaits
            and picture.rtp_time == rtp_time
            and not (ordered.lost or packet.is_marked or picture.is_full)
        ):  # nearly always: the next fragment
            picture.arrive(ordered.arrived_ns)
            self._go_on(picture, packet.payload[FU_HEADER_BYTES:], ends=False)
            return []
        done: list[AccessUnit] = []
        gap = [(ordered.seq - ordered.lost, ordered.seq - 1)] if ordered.lost else []
        if picture is not None:
            if gap:
                picture.lose(gap)
            if picture.rtp_time != rtp_time:
                if not gap:
                    self._tally.add(no_marker=1)
                    self._end_fragments()
                done += self._finish(picture, now_ns)
                picture = None
        if ordered.lost:
            self._has_orphans = True
        if picture is None:
            picture = self._begin(rtp_time, gap)
        picture.arrive(ordered.arrived_ns)
        self._unpack(picture, packet.payload)
        if packet.is_marked and self._early_markers < LYING_MARKERS:
            self._end_fragments()
            done += self._finish(picture, now_ns)
            self._ended_time = rtp_time
        return done

    def extend(self, pieces: list[bytes]) -> None:
        """Take the next fragments of the unfinished NAL unit, without their headers, each of the size of the one before."""
        assert self._picture is not None
        self._evenness.repeat(len(pieces))
        self._picture.add_fragments(*pieces)

    def _begin(self, rtp_time: int, gap: list[tuple[int, int]]) -> Picture:
        is_begun = self._is_between and not gap
        if is_begun:
            self._has_orphans = False
        if is_begun and rtp_time == self._ended_time == self._last_time:
            self._early_markers += 1
            self._tally.add(early_markers=1)
        self._picture = Picture(rtp_time, is_begun=is_begun)
        self._picture.lost = joined(self._lost, gap)
        self._lost, self._is_between = [], False
        return self._picture

    def _unpack(self, picture: Picture, payload: bytes) -> None:
        if picture.is_full:
            self._tally.add(oversize=picture.cut())
            return
        kind = nal_type(payload)
        if kind == NalType.FU:
            self._fragment(picture, payload)
            return
        self._end_fragments()
        if kind <= NalType.LAST_SINGLE and is_valid(payload):
            self._add(picture, payload)
        elif kind == NalType.AP:
            self._aggregate(picture, payload)
        elif kind == NalType.PACI:
            self._malformed(picture, "paci", "paci")
        else:
            self._malformed(picture, "malformed_nal")

    def _add(self, picture: Picture, nal: bytes) -> None:
        picture.add(nal, sees_delimiters=self._sees_delimiters)
        self._look_into(picture, nal)
        self._has_orphans = False

    def _look_into(self, picture: Picture, nal: bytes) -> None:
        kind = nal_type(nal)
        if kind in PARAMETER_SETS:
            if self._sets.keep(nal):
                self._tally.add(parameter_sets=1)
            else:
                self._malformed(picture, "malformed_nal")
        elif kind == NalType.AUD:
            self._sees_delimiters = True

    def _aggregate(self, picture: Picture, payload: bytes) -> None:
        at, nals = HEADER_BYTES, []
        while at < len(payload):
            size = int.from_bytes(payload[at : at + 2], "big")
            nal = payload[at + 2 : at + 2 + size]
            if len(nal) < size or not is_valid(nal):
                self._malformed(picture, "malformed_ap", "ap")
                return
            nals.append(nal)
            at += 2 + size
        if not nals:
            self._malformed(picture, "malformed_ap", "ap")
            return
        self._in_a_row["ap"] = 0
        for nal in nals:
            self._add(picture, nal)

    def _fragment(self, picture: Picture, payload: bytes) -> None:
        flags = payload[HEADER_BYTES] if len(payload) > FU_HEADER_BYTES else _START | _END
        kind, piece = flags & _KIND, payload[FU_HEADER_BYTES:]
        starts, ends = bool(flags & _START), bool(flags & _END)
        nal = bytes((payload[0] & ~(_KIND << 1) | kind << 1, *payload[1:HEADER_BYTES])) + piece
        awaits = payload[:HEADER_BYTES] + bytes((kind,))
        if (starts and ends) or not is_valid(nal):
            self._malformed(picture, "malformed_fu", "fu")
        elif starts:
            self._end_fragments()
            self._has_orphans = False
            self._evenness.begin(len(piece))
            picture.begin_fragments(nal, awaits, sees_delimiters=self._sees_delimiters)
        elif picture.awaits == awaits:
            self._go_on(picture, piece, ends=ends)
        elif not self._has_orphans:
            self._malformed(picture, "malformed_fu", "fu")

    def _go_on(self, picture: Picture, piece: bytes, *, ends: bool) -> None:
        """Add the next fragment, or the last one, to the unfinished NAL unit."""
        if self._evenness.is_cut_short(len(piece), is_last=ends):
            self._tally.add(cut_short=1)
            picture.break_off()
            self._has_orphans = True
            return
        picture.add_fragments(piece)
        if ends:
            self._in_a_row["fu"] = 0
            nal = picture.end_fragments()
            if nal_type(nal) in PARAMETER_SETS:
                self._look_into(picture, nal)

    def _end_fragments(self) -> None:
        """Something else comes: a NAL unit that is unfinished now stays so."""
        if self._picture is not None and self._picture.awaits:
            self._malformed(self._picture, "malformed_fu", "fu")

    def _malformed(self, picture: Picture, counter: str, kind: str = "") -> None:
        self._tally.add(**{counter: 1})
        picture.break_off()
        self._has_orphans = True
        if kind:
            self._in_a_row[kind] += 1

    def _finish(self, picture: Picture, now_ns: int) -> list[AccessUnit]:
        self._picture = None
        self._is_between = True
        if picture.slice_type is None:  # parameter sets or SEI of their own; or its slices are all lost
            self._lost = picture.lost
            if picture.is_broken and not picture.lost:  # nothing else says to those behind it that one is missing
                self.seq += 1
                self._last_time = picture.rtp_time
                self._tally.add(pictures_lost=1)
            return []
        if not picture.lost and not picture.is_broken:
            self._in_a_row["head"] = self._in_a_row["head"] + 1 if picture.is_headless else 0
            self._tally.add(headless=picture.is_headless)
        data, has_sets, was_added = picture.coded(self._sets)
        is_irap, is_intact = picture.is_irap(), picture.is_intact()
        is_entry = is_irap or picture.recovers_after is not None
        self._tally.add(
            pictures=1,
            broken=not is_intact,
            idrs=picture.slice_type in (NalType.IDR_W_RADL, NalType.IDR_N_LP),
            cras=is_irap and picture.slice_type not in (NalType.IDR_W_RADL, NalType.IDR_N_LP),
            recovery_points=picture.recovers_after is not None and not is_irap,
            parameter_sets_added=was_added,
            parameter_sets_missing=is_entry and not has_sets,
        )
        unit = AccessUnit(
            data=data,
            seq=self._seq_of(picture),
            rtp_time=picture.rtp_time,
            first_packet_ns=now_ns if picture.first_ns is None else picture.first_ns,
            complete_ns=now_ns,
            is_intact=is_intact,
            is_irap=is_irap,
            has_parameter_sets=has_sets,
            lost=tuple(picture.lost),
            ssrc=self._ssrc,
            life=self._life,
            slice_type=picture.slice_type,
            recovers_after=picture.recovers_after,
        )
        self.seq = unit.seq + 1
        self._last_time = picture.rtp_time
        return [unit]

    def _seq_of(self, picture: Picture) -> int:
        """Return a picture's number, where those that are lost have theirs by the time between it and the one before."""
        step = 0 if self._last_time is None else picture.rtp_time - self._last_time
        if step <= 0:
            return self.seq
        if not picture.lost:
            self.period = step if not self.period or step < self.period else self.period + (step - self.period) // 8
            return self.seq
        missing = min(round(step / self.period) - 1, MAX_PICTURES_LOST) if self.period else 0
        self._tally.add(pictures_lost=max(0, missing))
        return self.seq + max(0, missing)
