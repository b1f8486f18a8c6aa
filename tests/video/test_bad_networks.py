"""What bad networks do to pictures, from packets to pixels in virtual time: nothing damaged is ever called clean.

Small pictures in many small packets, so that a picture has as many as a full-size one. What is right is known: each
picture shown is compared with what an undisturbed decoder makes of what was sent, pixel by pixel, and by its code.
"""

from __future__ import annotations

import itertools
import random
from dataclasses import dataclass, field, replace
from functools import cache
from typing import Any, NamedTuple

import av
import numpy as np
import pytest

from gateway.sim.camera.composite import Size
from gateway.sim.camera.film import Film
from gateway.sim.camera.hevc import Coding, KeyFrames
from gateway.sim.camera.rtp import Packetiser
from gateway.video.decoding.damage import Damage
from gateway.video.decoding.decoder import Decoder
from gateway.video.receiving.counters import Counts
from gateway.video.receiving.stream import Stream
from tests.thoroughness import either
from tests.video.bad_network import ROBOT, BadNetwork, Faults
from tests.video.code_reader import read_composite

SMALL = Size(160, 340)
GOP = 15
PERIOD_NS = 22_222_222
PACKET_BYTES = 300
"""A picture has about 20 packets, an IDR 75."""


class Shown(NamedTuple):
    """A picture that a user would get.

    Attributes:
        number: Which one of those sent, from 0.
        clean: What is said of it.
        code: What stands in its pixels; None when crops disagree or cannot be read.
        is_right: Whether it is what was sent.
    """

    number: int
    clean: bool
    code: int | None
    is_right: bool


@dataclass
class Outcome:
    """Of one play."""

    shown: list[Shown] = field(default_factory=list)
    counts: Counts = field(default_factory=Counts)

    def numbers(self, *, clean: bool) -> list[int]:
        """Return which pictures were shown, as clean or as damaged."""
        return [one.number for one in self.shown if one.clean is clean]

    @property
    def lies(self) -> list[Shown]:
        """Damaged pictures that were called clean."""
        return [one for one in self.shown if one.clean and not one.is_right]


@cache
def film(**settings: Any) -> Film:
    """Return some seconds of pictures, encoded once."""
    words = {"width": SMALL.width, "height": SMALL.height, "gop": GOP, "bit_rate_bps": 2_000_000, **settings}
    return Film.of(Coding(**words), 4 * GOP)


@cache
def truth(**settings: Any) -> tuple[np.ndarray, ...]:
    """Return the luma of every picture of the film as an undisturbed decoder shows it."""
    decoder = av.CodecContext.create("hevc", "r")
    decoder.thread_type = "SLICE"
    units = film(**settings).pictures
    frames = [frame for unit in units for frame in decoder.decode(av.Packet(unit.data))] + decoder.decode(None)
    return tuple(luma(frame) for frame in frames)


def luma(frame: av.VideoFrame) -> np.ndarray:
    """Return a picture's luma."""
    plane = frame.planes[0]
    return np.frombuffer(plane, np.uint8).reshape(-1, plane.line_size)[: frame.height, : frame.width]


class Play:
    """The film through a bad network, a receiver and a decoder, in virtual time.

    Args:
        network: On the way.
        packet_bytes: Of the largest packets.
        settings: Of the film's coding.
    """

    def __init__(self, network: BadNetwork, *, packet_bytes: int = PACKET_BYTES, **settings: Any) -> None:
        self.network = network
        self._packet_bytes = packet_bytes
        self.now_ns = 1_000_000_000
        self.outcome = Outcome()
        self.stream = Stream({ROBOT})
        self._settings = settings
        self._pictures = film(**settings).play()
        self._number = itertools.count()
        self._damage, self._decoder = Damage(), Decoder("software", threads=1)
        self._sent: dict[tuple[int, int], int] = {}
        self._packetiser = Packetiser(1, max_bytes=packet_bytes)
        self._lives = itertools.count(2)
        self._tick = 0

    def send(self, count: int, **faults: Any) -> Play:
        """Send so many pictures, with other faults from now on if there are some."""
        if faults:
            self.network.faults = Faults(**faults)
        for coded in itertools.islice(self._pictures, count):
            packets = self._packetiser.packets(coded.data, self._tick)
            timestamp = (self._packetiser.first_timestamp + self._tick) % 2**32
            self._sent[self._packetiser.ssrc, timestamp] = next(self._number)
            for place, packet in enumerate(packets):
                at_ns = self.now_ns + place * PERIOD_NS // (2 * len(packets))
                for datagram in self.network.pass_on(packet):
                    self._show(self.stream.receive(datagram.data, datagram.source, at_ns))
            self._tick += 2000
            self.now_ns += PERIOD_NS
            self._show(self.stream.expire(self.now_ns))
        return self

    def restart(self, gap_s: float = 0.5) -> Play:
        """Let the sender be another one, after a while; it goes on in mid-group wherever the film is."""
        self._packetiser = Packetiser(next(self._lives), max_bytes=self._packet_bytes)
        self._tick = 0
        self.now_ns += int(gap_s * 1e9)
        return self

    def end(self) -> Outcome:
        """Give the decoder back; return what was shown."""
        self._decoder.close()
        return replace(self.outcome, counts=self.stream.tally.snapshot())

    def _show(self, units: list[Any]) -> None:
        right = truth(**self._settings)
        for unit in units:
            verdict = self._damage.judge(unit)
            if not verdict.is_decodable:
                continue
            for made in self._decoder.decode(unit, (unit, verdict), begins=verdict.begins):
                of, verdict_of = made.mark
                number = self._sent.get((of.ssrc, of.rtp_time % 2**32), -1)
                seen = luma(made.picture)
                is_right = bool(np.array_equal(seen, right[number % len(right)]))
                self.outcome.shown.append(Shown(number, verdict_of.clean, read_composite(seen), is_right))


def played(count: int, seed: int = 1, **faults: Any) -> Outcome:
    """Return what is shown of so many pictures."""
    play = Play(BadNetwork(Faults(**faults), seed))
    return play.send(count).end()


def codes_are_right(shown: list[Shown], length: int = 4 * GOP) -> bool:
    """Return whether the pixels of clean pictures say what they should, the same in all six crops."""
    return all(one.code == one.number % length for one in shown if one.clean)


def heals_at_key_frames(shown: list[Shown]) -> bool:
    """Return whether every stretch of damage ends at a picture that decoding can begin with, and nowhere else."""
    ends = [b.number for a, b in itertools.pairwise(shown) if b.clean and not a.clean]
    return all(number % GOP == 0 for number in ends)


def assert_honest(outcome: Outcome) -> None:
    """Assert what holds on every network: nothing strange is shown, nothing damaged called clean, codes agree."""
    assert all(one.number >= 0 for one in outcome.shown), "a picture that nobody sent"
    assert not outcome.lies, outcome.lies[:5]
    assert codes_are_right(outcome.shown)
    order = [one.number for one in outcome.shown]
    assert order == sorted(set(order)), "out of order, or twice"


def test_a_good_network_shows_every_picture_clean_and_right():
    """The judge itself is right: nothing is found where nothing is wrong."""
    outcome = played(200)
    assert_honest(outcome)
    assert outcome.numbers(clean=True) == list(range(200))
    assert outcome.counts.lost == outcome.counts.broken == 0


@pytest.mark.parametrize(
    ("faults", "count", "least"),
    [
        ({"loss_p": 0.001}, 600, 0.6),
        ({"loss_p": 0.01}, 300, 0.1),
        ({"burst_p": 0.0005}, 600, 0.6),
        ({"loss_p": 0.05, "swap_p": 0.05}, 150, 0.0),
        ({"truncate_p": 0.005, "truncates_last": False}, 300, 0.1),
    ],
    ids=str,
)
@pytest.mark.parametrize("seed", [1, pytest.param(2, marks=pytest.mark.thorough)])
def test_what_is_lost_is_flagged_until_the_next_whole_idr(faults, count, least, seed):
    """Every picture of which anything came is shown; not one that is damaged, or predicted from damage, is called clean."""
    outcome = played(count, seed, **faults)
    assert_honest(outcome)
    assert heals_at_key_frames(outcome.shown)
    assert outcome.counts.lost + outcome.counts.cut_short > 0 and outcome.numbers(clean=False)
    assert len(outcome.shown) + outcome.counts.pictures_lost > 0.95 * count
    assert len(outcome.numbers(clean=True)) >= least * count
    assert (outcome.counts.cut_short > 0) is ("truncate_p" in faults)
    false_alarms = sum(one.is_right and not one.clean for one in outcome.shown)
    assert false_alarms <= 0.05 * count


@pytest.mark.parametrize("packet_bytes", [1400, 3000])
@pytest.mark.parametrize("seed", range(either(3, 12)))
def test_each_packet_that_is_cut_short_is_flagged_whatever_the_size_of_packets(packet_bytes, seed):
    """But the last one of a NAL unit: a picture has a few packets or only two; nothing of a good network is doubted."""
    network = BadNetwork(seed=seed)
    play = Play(network, packet_bytes=packet_bytes).send(2 * GOP)
    assert play.stream.tally.snapshot().cut_short == 0
    outcome = play.send(150, truncate_p=0.05, truncates_last=False).send(2 * GOP, truncate_p=0.0).end()
    assert_honest(outcome)
    assert network.did["truncate"] > 0 and outcome.numbers(clean=False) and heals_at_key_frames(outcome.shown)
    assert all(one.clean for one in outcome.shown[-GOP:])


@pytest.mark.parametrize(
    ("faults", "counter"),
    [
        ({"swap_p": 0.05}, "reordered"),
        ({"duplicate_p": 0.05}, "duplicates"),
        ({"garbage_p": 0.2}, "bad_version"),
        ({"spoof_p": 0.2}, "bad_source"),
        ({"spoof_p": 0.2, "spoofs_address": True}, "bad_ssrc"),
        ({"swap_p": 0.05, "duplicate_p": 0.05, "garbage_p": 0.2, "spoof_p": 0.2}, "reordered"),
    ],
    ids=str,
)
def test_what_loses_nothing_damages_nothing(faults, counter):
    """Swapped, doubled, strange and foreign packets: counted, and every picture is clean all the same."""
    outcome = played(200, **faults)
    assert_honest(outcome)
    assert outcome.numbers(clean=True) == list(range(200))
    assert getattr(outcome.counts, counter) > 0


@pytest.mark.parametrize(
    "settings",
    [
        {"key_frames": KeyFrames.CRA},
        {"key_frames": KeyFrames.ONCE},
        {"key_frames": KeyFrames.REFRESH},
        {"slices": 3},
        {"is_wavefront": True},
        {"repeats_headers": False},
    ],
    ids=str,
)
def test_no_kind_of_stream_is_judged_too_well(settings):
    """Open groups, no periodic IDR, intra refresh, several slices, parameter sets only once: under loss, and after it."""
    outcome = Play(BadNetwork(Faults(loss_p=0.002), seed=2), **settings).send(150).send(90, loss_p=0.0).end()
    assert_honest(outcome)
    assert outcome.counts.lost > 0 and outcome.numbers(clean=False)
    assert outcome.shown[-1].clean


@pytest.mark.parametrize(
    "faults",
    [
        {"loss_p": 0.2},
        {"burst_p": 0.01, "burst_length": 50},
        {"is_silent": True},
        {"truncate_p": 0.5},
        {"payload_type": 97},
        {"loss_p": 0.02, "swap_p": 0.1, "duplicate_p": 0.1, "truncate_p": 0.1, "garbage_p": 0.5, "spoof_p": 0.5},
    ],
    ids=str,
)
@pytest.mark.parametrize("count", [3, 70])
def test_a_good_network_is_good_again_within_one_idr(faults, count):
    """Whatever it was before, for long or for short: from the next IDR on all is clean and right, and stays so."""
    play = Play(BadNetwork(Faults(), seed=3)).send(20).send(count, **faults).send(60, loss_p=0.0)
    outcome = play.end()
    first = -(-(20 + count) // GOP) * GOP
    healed = [one for one in outcome.shown if one.number >= first]
    assert [one.number for one in healed] == list(range(first, 80 + count))
    assert all(one.clean and one.is_right for one in healed)


@pytest.mark.parametrize("gap_s", [0.3, 0.5, 5.0])
@pytest.mark.parametrize("before", [GOP * 2, GOP * 2 + 4])
def test_a_sender_that_begins_anew_is_shown_from_its_first_idr(gap_s, before):
    """New SSRC, sequence and timestamp after a gap, at an IDR or in mid-group: the same receiver and decoder go on."""
    outcome = Play(BadNetwork()).send(before).restart(gap_s).send(60).end()
    assert_honest(outcome)
    first = -(-before // GOP) * GOP
    assert outcome.numbers(clean=True) == [*range(before), *range(first, before + 60)]
    assert outcome.counts.lives == 2 and outcome.counts.bad_ssrc == 0


@pytest.mark.parametrize("gap_s", [0.0, 0.05, 0.2])
@pytest.mark.parametrize("before", [GOP * 2, GOP * 2 + 4])
def test_a_sender_that_begins_anew_at_once_is_shown_from_its_first_idr_too(gap_s, before):
    """What it sends until it is believed is kept for it, lest anybody takes the stream over; then nothing is missing."""
    outcome = Play(BadNetwork()).send(before).restart(gap_s).send(60).end()
    assert_honest(outcome)
    first = -(-before // GOP) * GOP
    assert outcome.numbers(clean=True) == [*range(before), *range(first, before + 60)]
    assert outcome.counts.lives == 2


def test_several_restarts_on_a_bad_network_end_well():
    """Senders come and go while packets are lost; garbage and a spoofer do not become one of them."""
    faults = {"loss_p": 0.005, "swap_p": 0.02, "garbage_p": 0.1, "spoof_p": 0.1, "duplicate_p": 0.02}
    play = Play(BadNetwork(seed=5)).send(40, **faults)
    for gap_s in (0.5, 0.4, 1.0):
        play.restart(gap_s).send(40)
    outcome = play.send(2 * GOP, loss_p=0.0).end()
    assert_honest(outcome)
    assert outcome.counts.lives == 4 and outcome.shown[-1].clean


def test_a_wrong_payload_type_shows_nothing_and_is_counted():
    """Of each packet; which type it is can be asked."""
    play = Play(BadNetwork(Faults(payload_type=97))).send(30)
    outcome = play.end()
    assert not outcome.shown
    assert outcome.counts.bad_payload_type == outcome.counts.datagrams > 0
    assert play.stream.facts().wrong_payload_type == 97


WORST = {"loss_p": 0.05, "burst_p": 0.01, "swap_p": 0.3, "duplicate_p": 0.2, "garbage_p": 0.3, "spoof_p": 0.3}
STREAMS: tuple[dict[str, Any], ...] = ({}, {"key_frames": KeyFrames.CRA}, {"slices": 3}, {"is_wavefront": True})


@pytest.mark.parametrize("seed", range(either(6, 40)))
def test_no_network_however_it_changes_makes_a_lie(seed):
    """Anything up to the worst, one after the other, with silence, wrong types and restarts between."""
    chance = random.Random(seed)
    play = Play(BadNetwork(seed=seed), **chance.choice(STREAMS))
    for _ in range(chance.randrange(1, 6)):
        faults: dict[str, Any] = {name: chance.choice((0, 0, most * chance.random())) for name, most in WORST.items()}
        faults |= {"is_silent": chance.random() < 0.1, "payload_type": chance.choice((*[None] * 19, 97))}
        play.send(chance.randrange(1, 60), **faults)
        if chance.random() < 0.3:
            play.restart(chance.choice((0.0, 0.1, 0.3, 0.5, 2.0)))
    assert_honest(play.send(2 * GOP, loss_p=0.0).end())
