"""What came, what was lost, and why: one number for each kind, counted from the receiver's start on.

The receiving thread counts with a `Tally`; everybody else is given `Counts`, which never change.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

__all__ = ["Counts", "Tally"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Counts:
    """The numbers at one instant.

    Attributes:
        datagrams: All that came to the port.
        datagram_bytes: Their payloads [bytes].
        kernel_dropped: Datagrams that the full receive buffer of the socket had no room for.
        bad_source: From an address that is not the robot's.
        too_short: Shorter than an RTP header.
        bad_version: Not RTP version 2.
        bad_payload_type: RTP of another payload type.
        bad_header: The list of sources or the extension ends behind the datagram.
        bad_padding: More padding than there is room for.
        empty: Nothing behind the header.
        bad_ssrc: Of another sender, while the one listened to was heard.
        packets: RTP packets of the stream, duplicates and late ones included.
        lost: Given up: their place in the sequence was passed.
        late: Came after they had been given up.
        duplicates: Came again.
        reordered: Came after a later one, in time to be put in their place.
        strays: Far off in the sequence.
        resyncs: Jumps of the sequence that were followed.
        lives: Senders, or starts of one.
        time_jumps: Jumps of the RTP time within an unbroken sequence.
        time_falls: Pictures with an earlier RTP time than the one before; they are given the next tick.
        malformed_ap: Aggregation packets that do not add up.
        malformed_fu: Fragments that do not fit together though none is lost.
        malformed_nal: NAL units or payloads whose header is invalid.
        cut_short: Fragments of another size than the others, from a sender that makes them of one size.
        paci: PACI packets, which this receiver does not read (RFC 7798 section 4.4.4).
        pictures: Access units made.
        broken: Those of them that are not intact.
        pictures_lost: Of which nothing came, by the RTP time (an estimate), or nothing that can be read.
        abandoned: Begun, and given up since their sender was.
        oversize: Larger than any picture could be; cut off.
        headless: Whose first slice is not there though no packet is lost.
        idrs: IDR pictures.
        cras: CRA and BLA pictures.
        recovery_points: Pictures with a recovery point SEI.
        parameter_sets: VPS, SPS and PPS that came in the stream.
        parameter_sets_added: Pictures that decoding can begin with, and that were given the ones remembered.
        parameter_sets_missing: Pictures that decoding could have begun with, had parameter sets been known.
        no_marker: Pictures that ended without a marker though no packet is lost.
        early_markers: Markers that were followed by more of the same picture.
        skipped: Pictures dropped since the decoder was behind.
        skips: How often it was.
        blind_starts: How often it went on without a picture that decoding can begin with, since none came.
        recorder_dropped: Pictures that another taker was too slow for.
    """

    datagrams: int = 0
    datagram_bytes: int = 0
    kernel_dropped: int = 0
    bad_source: int = 0
    too_short: int = 0
    bad_version: int = 0
    bad_payload_type: int = 0
    bad_header: int = 0
    bad_padding: int = 0
    empty: int = 0
    bad_ssrc: int = 0
    packets: int = 0
    lost: int = 0
    late: int = 0
    duplicates: int = 0
    reordered: int = 0
    strays: int = 0
    resyncs: int = 0
    lives: int = 0
    time_jumps: int = 0
    time_falls: int = 0
    malformed_ap: int = 0
    malformed_fu: int = 0
    malformed_nal: int = 0
    cut_short: int = 0
    paci: int = 0
    pictures: int = 0
    broken: int = 0
    pictures_lost: int = 0
    abandoned: int = 0
    oversize: int = 0
    headless: int = 0
    idrs: int = 0
    cras: int = 0
    recovery_points: int = 0
    parameter_sets: int = 0
    parameter_sets_added: int = 0
    parameter_sets_missing: int = 0
    no_marker: int = 0
    early_markers: int = 0
    skipped: int = 0
    skips: int = 0
    blind_starts: int = 0
    recorder_dropped: int = 0

    @property
    def bad_rtp(self) -> int:
        """Datagrams that are no RTP at all."""
        return self.too_short + self.bad_version + self.bad_header + self.bad_padding + self.empty

    def since(self, before: Counts) -> Counts:
        """Return what was counted since another instant."""
        return Counts(**{name: getattr(self, name) - getattr(before, name) for name in NAMES})


NAMES = tuple(field.name for field in fields(Counts))


class Tally:
    """Counts up, in one thread at a time; any thread may take a snapshot."""

    def __init__(self) -> None:
        self._counts = dict.fromkeys(NAMES, 0)

    def arrive(self, size: int) -> None:
        """Count a datagram of so many bytes: for each, so cheaply."""
        counts = self._counts
        counts["datagrams"] += 1
        counts["datagram_bytes"] += size

    def accept(self) -> None:
        """Count a packet of the stream: for each, so cheaply."""
        self._counts["packets"] += 1

    def accept_all(self, count: int, size: int) -> None:
        """Count so many datagrams of so many bytes each, all of them packets of the stream."""
        self.add(datagrams=count, datagram_bytes=count * size, packets=count)

    def add(self, **counts: int) -> None:
        """Add to the counters named.

        Raises:
            KeyError: If there is no such counter.
        """
        for name, count in counts.items():
            self._counts[name] += count

    def snapshot(self) -> Counts:
        """Return the numbers of now."""
        return Counts(**self._counts)
