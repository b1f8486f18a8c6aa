"""Rules of `gateway.video.receiving.diagnosis`: what is wrong is told in words, with its code and a remedy; else nothing is."""

from __future__ import annotations

from dataclasses import replace

import pytest

from gateway.video.errors import VideoCode
from gateway.video.receiving.counters import Counts
from gateway.video.receiving.diagnosis import NO_IDR_NS, UNSUPPORTED, DecoderFacts, Facts, Finding, why
from gateway.video.receiving.stream import StreamFacts

S = 1_000_000_000
MS = 1_000_000
NOW_NS = 100 * S
ROBOT = "192.168.1.20"
HEALTHY = StreamFacts(
    datagram_ns=NOW_NS - MS,
    packet_ns=NOW_NS - MS,
    entry_ns=NOW_NS - S // 2,
    idr_ns=NOW_NS - S // 2,
    life_ns=NOW_NS - 60 * S,
    life=0,
    ssrc=7,
    source=ROBOT,
    knows_parameter_sets=True,
)
FLOWING = Counts(datagrams=5400, packets=5400, pictures=135, idrs=3)


def facts(stream: StreamFacts = HEALTHY, recent: Counts = FLOWING, **changes) -> Facts:
    """Return facts of a receiver that has run for a minute and a half; nothing is wrong unless it is said."""
    return Facts(
        **{
            "started_ns": NOW_NS - 90 * S,
            "port": 8890,
            "payload_type": 96,
            "sources": (ROBOT,),
            "asked_bytes": 8_000_000,
            "granted_bytes": 8_000_000,
            "counts": recent,
            "recent": recent,
            "recent_since_ns": NOW_NS - 3 * S,
            "stream": stream,
            **changes,
        }
    )


def only(of: Facts) -> Finding:
    """Return the one finding there is."""
    (finding,) = why(of, NOW_NS)
    return finding


def test_nothing_is_said_of_a_good_stream() -> None:
    """No alarm in nominal use."""
    assert why(facts(), NOW_NS) == ()
    decoder = DecoderFacts(name="software", frames=1000, recent_frames=135, recent_errors=0, decode_ms=12.0)
    assert why(facts(decoder=decoder), NOW_NS) == ()


def test_nothing_is_said_in_the_first_second() -> None:
    """A stream that begins has no picture yet."""
    assert why(facts(StreamFacts(), Counts(), started_ns=NOW_NS - S // 2), NOW_NS) == ()
    young = replace(HEALTHY, entry_ns=None, idr_ns=None, life_ns=NOW_NS - S, knows_parameter_sets=False)
    assert why(facts(young, started_ns=NOW_NS - S), NOW_NS) == ()


def test_silence_from_the_beginning_names_configuration_firewall_and_port() -> None:
    """The three causes that §2.6.3 knows."""
    finding = only(facts(StreamFacts(), Counts()))
    assert finding.code is VideoCode.NO_PACKETS and "no packets on udp port 8890 for 90.0 s" in finding.message
    assert "remote IP" in finding.hint and f"ufw allow from {ROBOT} to any port 8890" in finding.hint
    assert "ip route get" in finding.hint
    assert "from ROBOT to" in only(facts(StreamFacts(), Counts(), sources=None)).hint


def test_a_stream_that_stopped_is_not_one_that_never_came() -> None:
    """It came: address, firewall and port are right."""
    finding = only(facts(replace(HEALTHY, datagram_ns=NOW_NS - 4 * S, packet_ns=NOW_NS - 4 * S), Counts()))
    assert finding.code is VideoCode.STREAM_STOPPED and "4.0 s" in finding.message and ROBOT in finding.message


@pytest.mark.parametrize(
    ("recent", "seen", "code", "words"),
    [
        (
            Counts(bad_payload_type=90),
            {"wrong_payload_type": 97},
            VideoCode.WRONG_PAYLOAD_TYPE,
            "payload type is 97, not 96",
        ),
        (
            Counts(bad_source=90),
            {"wrong_source": "192.168.1.66"},
            VideoCode.WRONG_SOURCE,
            "192.168.1.66, but only 192.168.1.20",
        ),
        (Counts(datagrams=90, too_short=80, bad_version=10), {}, VideoCode.NOT_RTP, "90 of 90 datagrams"),
    ],
)
def test_what_comes_and_is_refused_is_told_with_why(recent: Counts, seen: dict, code: VideoCode, words: str) -> None:
    """Packets arrive, but none of the stream."""
    finding = only(facts(StreamFacts(datagram_ns=NOW_NS - MS, **seen), recent))
    assert finding.code is code and words in finding.message


def test_a_sender_with_the_wrong_type_that_fell_silent_is_silence() -> None:
    """Old findings do not stand for ever."""
    finding = only(facts(StreamFacts(datagram_ns=NOW_NS - 9 * S, wrong_payload_type=97), Counts()))
    assert finding.code is VideoCode.NO_PACKETS and "9.0 s" in finding.message


@pytest.mark.parametrize("kind", ["ap", "fu", "paci", "head"])
def test_an_unsupported_payload_is_named_and_nothing_else_is_guessed(kind: str) -> None:
    """Aggregates, fragments and beginnings that go on being wrong hint at DONL."""
    finding = only(facts(replace(HEALTHY, unsupported=kind, entry_ns=None)))
    assert (finding.code, finding.message) == (VideoCode.UNSUPPORTED_PAYLOAD, UNSUPPORTED[kind])
    assert "DONL" in finding.message + finding.hint


def test_without_parameter_sets_nothing_can_begin() -> None:
    """They may have been sent once, before we listened."""
    finding = only(facts(replace(HEALTHY, entry_ns=None, knows_parameter_sets=False)))
    assert finding.code is VideoCode.NO_PARAMETER_SETS and "restart the robot's video" in finding.hint


def test_no_key_picture_yet_is_told_apart_from_damaged_ones() -> None:
    """The remedies differ."""
    stream = replace(HEALTHY, entry_ns=None, idr_ns=None)
    never = only(facts(stream, replace(FLOWING, idrs=0)))
    damaged = only(facts(stream, FLOWING))
    assert never.code is damaged.code is VideoCode.NO_KEYFRAME
    assert "no key picture yet for 60.0 s" in never.message and "3 came lately, and all were damaged" in damaged.message


def test_a_key_picture_of_the_sender_before_is_none_of_this_one() -> None:
    """Decoding must begin anew."""
    codes = {
        finding.code
        for finding in why(facts(replace(HEALTHY, life=1, life_ns=NOW_NS - 3 * S, entry_ns=NOW_NS - 4 * S)), NOW_NS)
    }
    assert codes == {VideoCode.NO_KEYFRAME, VideoCode.SENDER_RESTARTED}


@pytest.mark.parametrize(
    ("recent", "words"),
    [
        (replace(FLOWING, idrs=0, cras=3), "its key pictures are CRA"),
        (replace(FLOWING, idrs=0, recovery_points=3), "intra refresh"),
        (replace(FLOWING, idrs=0), "nor a CRA or a recovery point"),
    ],
)
def test_a_stream_without_a_periodic_idr_is_named_with_what_it_has_instead(recent: Counts, words: str) -> None:
    """It is shown all the same; what a loss does to it differs."""
    stream = replace(HEALTHY, entry_ns=NOW_NS - S, idr_ns=NOW_NS - NO_IDR_NS - S)
    finding = only(facts(stream, recent))
    assert finding.code is VideoCode.NO_PERIODIC_IDR and words in finding.message


def test_loss_is_told_with_its_part_and_where_it_happened() -> None:
    """On the network, or on this host."""
    recent = replace(FLOWING, lost=54, broken=20, pictures_lost=1)
    finding = only(facts(recent=recent))
    assert (
        finding.code is VideoCode.LOSS
        and "54 packets lost in 3.0 s (0.99 %): 20 of 135 pictures damaged, 1 missing" in finding.message
    )
    here = why(facts(recent=replace(recent, kernel_dropped=54), granted_bytes=200_000), NOW_NS)
    assert [f.code for f in here] == [VideoCode.LOSS, VideoCode.RECEIVE_BUFFER_FULL, VideoCode.RECEIVE_BUFFER_CAPPED]
    assert "sysctl" in here[1].hint


@pytest.mark.parametrize(
    ("recent", "code"),
    [
        ({"late": 3}, VideoCode.LATE_PACKETS),
        ({"cut_short": 3}, VideoCode.CUT_SHORT),
        ({"bad_ssrc": 3}, VideoCode.SECOND_SENDER),
        ({"bad_source": 3}, VideoCode.SECOND_SENDER),
        ({"too_short": 300}, VideoCode.NOT_RTP),
        ({"no_marker": 130}, VideoCode.NO_MARKER),
        ({"early_markers": 3}, VideoCode.NO_MARKER),
        ({"skipped": 20, "skips": 1}, VideoCode.DECODER_SLOW),
        ({"recorder_dropped": 20}, VideoCode.RECORDER_SLOW),
        ({"kernel_dropped": 20}, VideoCode.RECEIVE_BUFFER_FULL),
    ],
)
def test_what_else_is_wrong_with_a_stream_that_flows_has_a_code(recent: dict, code: VideoCode) -> None:
    """One finding for one cause."""
    finding = only(facts(recent=replace(FLOWING, **recent)))
    assert finding.code is code and finding.hint


def test_a_little_garbage_and_one_late_start_are_not_worth_a_word() -> None:
    """Under one part in a hundred."""
    assert why(facts(recent=replace(FLOWING, too_short=5, no_marker=3)), NOW_NS) == ()


def test_a_restart_of_the_sender_is_told_for_ten_seconds() -> None:
    """With how often it was."""
    young = replace(HEALTHY, life=2, life_ns=NOW_NS - 4 * S)
    assert "4.0 s ago; restarts so far: 2" in only(facts(young)).message
    assert why(facts(replace(young, life_ns=NOW_NS - 11 * S)), NOW_NS) == ()


def test_a_decoder_that_makes_nothing_of_the_pictures_is_told() -> None:
    """Packets are all there: it is the codec, or DONL."""
    decoder = DecoderFacts(name="software", frames=0, recent_frames=0, recent_errors=130, decode_ms=0.0)
    finding = only(facts(decoder=decoder))
    assert finding.code is VideoCode.UNDECODABLE and "130 errors" in finding.message


def test_an_error_comes_first() -> None:
    """What follows from it comes behind."""
    findings = why(facts(StreamFacts(), Counts(), error="OSError(100)"), NOW_NS)
    assert [finding.code for finding in findings] == [VideoCode.RECEIVER_FAILED, VideoCode.NO_PACKETS]


def test_every_remedy_begins_with_what_to_do() -> None:
    """As everywhere in the gateway; a code reads as its own text."""
    assert all(str(code) == code.value == code.name for code in VideoCode)
    worst = replace(FLOWING, lost=9, late=9, bad_ssrc=9, too_short=999, no_marker=135, skipped=9, kernel_dropped=9)
    hints = [finding.hint for finding in why(facts(replace(HEALTHY, life=1, life_ns=NOW_NS - 5 * S), worst), NOW_NS)]
    assert len(hints) == 8
    assert all(hint.split()[0] in {"see", "find", "look", "set", "give"} for hint in hints)
