"""Why there is no picture, or no good one: what is wrong, in words, with a remedy. Of the video, as `ta2 why` of the robot.

Pure: what is known and the time in, findings out; the worst first.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final, NamedTuple

from gateway.video.errors import VideoCode
from gateway.video.receiving.counters import Counts
from gateway.video.receiving.stream import StreamFacts

__all__ = ["DecoderFacts", "Facts", "Finding", "why"]

S: Final = 1_000_000_000
SILENT_NS: Final = S
"""No packet for longer is told [ns]: 45 pictures."""
ENTRY_NS: Final = 3 * S // 2
"""No picture to begin with for longer is told [ns]; one IDR each second is usual."""
NO_IDR_NS: Final = 10 * S
"""A stream without an IDR for longer is told to have no periodic one [ns]."""
TOLD_NS: Final = 10 * S
"""A restart of the sender is told for so long [ns]."""

UNSUPPORTED: Final = {
    "ap": "aggregation packets go on being malformed though none is lost: the sender may use DONL fields",
    "fu": "fragments go on not fitting together though none is lost: the sender may use DONL fields, or another codec",
    "paci": "the sender uses PACI packets (RFC 7798 section 4.4.4), which this receiver does not read",
    "head": "the first slice of every picture seems missing though no packet is lost: the sender may use DONL fields",
}
"""What goes on being malformed; DONL fields cannot be told from the packets."""
PLAIN_PAYLOAD: Final = (
    "set sprop-max-don-diff to 0 at the sender (no DONL, RFC 7798 section 7.1), no PACI, and H.265 as codec"
)


class Finding(NamedTuple):
    """Something that is wrong.

    Attributes:
        code: Stable code.
        message: One sentence with the numbers.
        hint: What to do.
    """

    code: VideoCode
    message: str
    hint: str


@dataclass(frozen=True, slots=True, kw_only=True)
class DecoderFacts:
    """What a decoder knows of itself.

    Attributes:
        name: What decodes.
        frames: Published.
        recent_frames: Published in the time of `Facts.recent`.
        recent_errors: Pictures in that time that it could make nothing of.
        decode_ms: Usual time for one picture [ms].
    """

    name: str
    frames: int
    recent_frames: int
    recent_errors: int
    decode_ms: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Facts:
    """What is known.

    Attributes:
        started_ns: When receiving began, monotonic [ns].
        port: UDP port.
        payload_type: The one that is wanted.
        sources: Addresses that are listened to; None: all.
        asked_bytes: Receive buffer asked for.
        granted_bytes: Receive buffer granted.
        counts: Counted since the receiver was made.
        recent: Counted in the last seconds.
        recent_since_ns: When those began [ns].
        stream: What was seen of the stream.
        error: What ended receiving; empty when nothing did.
        decoder: What the decoder knows; None without one.
    """

    started_ns: int
    port: int
    payload_type: int
    sources: tuple[str, ...] | None
    asked_bytes: int
    granted_bytes: int
    counts: Counts
    recent: Counts
    recent_since_ns: int
    stream: StreamFacts
    error: str = ""
    decoder: DecoderFacts | None = None


def why(facts: Facts, now_ns: int) -> tuple[Finding, ...]:
    """Return what is wrong, the worst first; empty when nothing is."""
    heard_ns = facts.stream.packet_ns
    is_heard = heard_ns is not None and now_ns - heard_ns < SILENT_NS
    parts = (
        _of_an_error(facts),
        _of_packets(facts, now_ns) if is_heard else _of_silence(facts, now_ns),
        _of_pictures(facts, now_ns) if is_heard else (),
        _of_this_host(facts),
    )
    return tuple(finding for part in parts for finding in part)


def _of_an_error(facts: Facts) -> Iterator[Finding]:
    if facts.error:
        yield Finding(
            VideoCode.RECEIVER_FAILED,
            f"receiving ended: {facts.error}",
            "start the receiver again; report the message if it comes back",
        )


def _of_silence(facts: Facts, now_ns: int) -> Iterator[Finding]:
    """No packet of the stream comes: because nothing does, or because all that comes is refused."""
    stream, recent = facts.stream, facts.recent
    since_ns = facts.started_ns if stream.datagram_ns is None else stream.datagram_ns
    if now_ns - since_ns < SILENT_NS:
        if recent.bad_source:
            yield Finding(
                VideoCode.WRONG_SOURCE,
                f"packets come from {stream.wrong_source}, but only {_listed(facts)} is listened to",
                f"give {stream.wrong_source} as the robot's address if that is the robot, else find out who sends them",
            )
        if recent.bad_payload_type:
            yield Finding(
                VideoCode.WRONG_PAYLOAD_TYPE,
                f"packets arrive but their payload type is {stream.wrong_payload_type}, not {facts.payload_type}",
                f"receive with payload type {stream.wrong_payload_type}, or set {facts.payload_type} at the sender (§5.1)",
            )
        if recent.bad_rtp:
            yield _not_rtp(facts)
        return
    silent_s = (now_ns - since_ns) / S
    if stream.packet_ns is not None:
        yield Finding(
            VideoCode.STREAM_STOPPED,
            f"no packets for {silent_s:.1f} s: the stream came from {stream.source} and stopped",
            "check that the robot is on and its cameras are enabled, then the cable; it goes on by itself when they come",
        )
        return
    yield Finding(
        VideoCode.NO_PACKETS,
        f"no packets on udp port {facts.port} for {silent_s:.1f} s",
        "check in the robot's system configuration that the remote IP is this host's (`ip route get ROBOT` tells it as "
        f"src) and the port is {facts.port}; then this host's firewall: "
        f"sudo ufw allow from {_listed(facts, 'ROBOT')} to any port {facts.port} proto udp (§2.6.3)",
    )


def _of_packets(facts: Facts, now_ns: int) -> Iterator[Finding]:
    """Packets of the stream come; not all of them, or others as well."""
    recent, stream = facts.recent, facts.stream
    seconds = max(0.1, (now_ns - facts.recent_since_ns) / S)
    if recent.lost:
        part = 100 * recent.lost / max(1, recent.lost + recent.packets)
        where = (
            "see RECEIVE_BUFFER_FULL: they were lost on this host"
            if recent.kernel_dropped
            else "use a cable instead of Wi-Fi; look for errors with `ip -s link`, and for other load on the network"
        )
        yield Finding(
            VideoCode.LOSS,
            f"{recent.lost} packets lost in {seconds:.1f} s ({part:.2g} %): {recent.broken} of "
            f"{recent.pictures} pictures damaged, {recent.pictures_lost} missing",
            where,
        )
    if recent.late:
        yield Finding(
            VideoCode.LATE_PACKETS,
            f"{recent.late} packets came after they had been given up: the network swaps more than the window holds",
            "find out which switch or Wi-Fi swaps packets, or make the window wider (at most 32 packets)",
        )
    if recent.cut_short:
        yield Finding(
            VideoCode.CUT_SHORT,
            f"{recent.cut_short} packets came without their end in {seconds:.1f} s: {recent.broken} of "
            f"{recent.pictures} pictures damaged; the last packet of a picture may have been cut, too, which nobody sees",
            "find out what stands between robot and host: a tunnel or relay with a smaller packet size, and mend that",
        )
    if recent.bad_ssrc or recent.bad_source:
        others = f"{recent.bad_ssrc + recent.bad_source} packets of another sender"
        yield Finding(
            VideoCode.SECOND_SENDER,
            f"{others} were refused in {seconds:.1f} s"
            + (f", the last from {stream.wrong_source}" if recent.bad_source else ""),
            f"find out who else sends to udp port {facts.port}, and let the firewall pass the robot only (§2.6.3)",
        )
    if recent.bad_rtp > recent.packets // 100:
        yield _not_rtp(facts)
    if stream.life and stream.life_ns is not None and now_ns - stream.life_ns < TOLD_NS:
        yield Finding(
            VideoCode.SENDER_RESTARTED,
            f"the sender began anew {(now_ns - stream.life_ns) / S:.1f} s ago; restarts so far: {stream.life}",
            "look at the robot if it goes on: its encoder is restarted, or two senders take turns",
        )


def _of_pictures(facts: Facts, now_ns: int) -> Iterator[Finding]:
    """Packets of the stream come; what is wrong with the pictures in them."""
    stream, recent, decoder = facts.stream, facts.recent, facts.decoder
    life_ns = facts.started_ns if stream.life_ns is None else stream.life_ns
    has_begun = stream.entry_ns is not None and stream.entry_ns >= life_ns
    if stream.unsupported:
        yield Finding(VideoCode.UNSUPPORTED_PAYLOAD, UNSUPPORTED[stream.unsupported], PLAIN_PAYLOAD)
    elif not has_begun and now_ns - life_ns > ENTRY_NS:
        yield _no_beginning(facts, (now_ns - life_ns) / S)
    elif has_begun and now_ns - max(life_ns, stream.idr_ns or 0) > NO_IDR_NS:
        yield _no_idr(facts, (now_ns - max(life_ns, stream.idr_ns or 0)) / S)
    elif decoder is not None and decoder.recent_errors and not decoder.recent_frames:
        yield Finding(
            VideoCode.UNDECODABLE,
            f"{decoder.name} makes nothing of the pictures ({decoder.recent_errors} errors, no frame), though packets come",
            "record some seconds with `ta2 video record` and look at them with another player; "
            "if that shows nothing either, the sender uses DONL fields or another codec",
        )
    if recent.no_marker > recent.pictures // 2 or recent.early_markers:
        yield Finding(
            VideoCode.NO_MARKER,
            "the sender does not set the marker at the end of its pictures: each waits for the next one, "
            "and the latency is one picture more",
            "set the marker bit on the last packet of each picture at the sender (RFC 7798 section 4.1)",
        )
    if recent.skipped:
        spent = "" if decoder is None else f" ({decoder.name}: {decoder.decode_ms:.1f} ms for one)"
        yield Finding(
            VideoCode.DECODER_SLOW,
            f"decoding fell behind {recent.skips} times: {recent.skipped} pictures were dropped to stay live{spent}",
            "give this host less load or more cores, decode on a GPU, or look at fewer pictures",
        )


def _no_beginning(facts: Facts, seconds: float) -> Finding:
    recent = facts.recent
    if not facts.stream.knows_parameter_sets:
        return Finding(
            VideoCode.NO_PARAMETER_SETS,
            f"packets come for {seconds:.1f} s, but no complete VPS, SPS and PPS: nothing can be decoded without them",
            "restart the robot's video: it may send them only when it begins. Let its encoder repeat them with each IDR",
        )
    entries = recent.idrs + recent.cras + recent.recovery_points
    if entries:
        return Finding(
            VideoCode.NO_KEYFRAME,
            f"no intact key picture for {seconds:.1f} s: {entries} came lately, and all were damaged",
            "mend the loss first; smaller key pictures (a lower bitrate) get through more often",
        )
    return Finding(
        VideoCode.NO_KEYFRAME,
        f"no key picture yet for {seconds:.1f} s: decoding can begin with an IDR, a CRA or a recovery point only",
        "wait for one, or restart the robot's video; let its encoder send an IDR each second",
    )


def _no_idr(facts: Facts, seconds: float) -> Finding:
    recent = facts.recent
    if recent.cras:
        rest = "its key pictures are CRA: decoding can begin there, without the pictures that refer to earlier ones"
    elif recent.recovery_points:
        rest = "it has recovery points (intra refresh): after a loss pictures stay flagged until one has healed them"
    else:
        rest = "nor a CRA or a recovery point: after a loss all pictures stay flagged, and nobody else can begin"
    return Finding(
        VideoCode.NO_PERIODIC_IDR,
        f"the stream has had no IDR for {seconds:.0f} s; {rest}",
        "let the robot's encoder send an IDR each second if pictures must heal fast",
    )


def _of_this_host(facts: Facts) -> Iterator[Finding]:
    larger = f"sudo sysctl -w net.core.rmem_max={facts.asked_bytes}, then start the receiver again"
    if facts.recent.kernel_dropped:
        yield Finding(
            VideoCode.RECEIVE_BUFFER_FULL,
            f"this host dropped {facts.recent.kernel_dropped} datagrams lately: its receive buffer of "
            f"{facts.granted_bytes} bytes was full",
            f"give this host less load; {larger}"
            if facts.granted_bytes < facts.asked_bytes
            else "give this host less load",
        )
    if facts.recent.recorder_dropped:
        yield Finding(
            VideoCode.RECORDER_SLOW,
            f"{facts.recent.recorder_dropped} pictures were not recorded: writing is slower than the stream",
            "record to a faster disk",
        )
    if facts.granted_bytes < facts.asked_bytes:
        yield Finding(
            VideoCode.RECEIVE_BUFFER_CAPPED,
            f"the receive buffer has {facts.granted_bytes} bytes instead of {facts.asked_bytes}: "
            "this host's kernel allows no more",
            f"raise it: {larger}",
        )


def _not_rtp(facts: Facts) -> Finding:
    recent = facts.recent
    return Finding(
        VideoCode.NOT_RTP,
        f"{recent.bad_rtp} of {recent.datagrams} datagrams lately are no RTP: {recent.too_short} too short, "
        f"{recent.bad_version} of another version, {recent.bad_header + recent.bad_padding + recent.empty} malformed",
        f"find out what else sends to udp port {facts.port}, and give one of them another port",
    )


def _listed(facts: Facts, otherwise: str = "everybody") -> str:
    return otherwise if facts.sources is None else ", ".join(facts.sources)
