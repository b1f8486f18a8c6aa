"""Rules of `gateway.video.receiving.backlog`: latency does not grow, whatever the taker does; what is dropped is counted."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.video.hevc.access_unit import AccessUnit
from gateway.video.receiving.backlog import BLIND_NS, KEPT_UNITS, MAX_AGE_NS, MAX_UNITS, Keeping, Live
from gateway.video.receiving.counters import Counts, Tally

MS = 1_000_000
S = 1_000_000_000
FRAME_NS = 22_222_222


def unit(seq: int, *, gop: int = 45, size: int = 100) -> AccessUnit:
    """Return a picture that was complete when its turn was, at 45 a second."""
    is_key = gop > 0 and seq % gop == 0
    return AccessUnit(
        data=bytes(size),
        seq=seq,
        rtp_time=2000 * seq,
        first_packet_ns=seq * FRAME_NS - 11 * MS,
        complete_ns=seq * FRAME_NS,
        is_intact=True,
        is_irap=is_key,
        has_parameter_sets=is_key,
        lost=(),
        ssrc=7,
        life=0,
        slice_type=19 if is_key else 1,
    )


class Run:
    """A taker in virtual time, that takes so long for each picture.

    Attributes:
        taken: Each picture, and how long it had waited [ns].
    """

    def __init__(self, units: list[AccessUnit], costs_ns, **options) -> None:
        self.tally = Tally()
        self.backlog = Live(self.tally, **options)
        self.taken: list[tuple[AccessUnit, int]] = []
        free_ns, waiting = 0, list(units)
        while waiting or len(self.backlog):
            while waiting and waiting[0].complete_ns <= free_ns:
                self.backlog.put(waiting.pop(0))
            taken = self.backlog.take(free_ns)
            if taken is not None:
                self.taken.append((taken, free_ns - taken.complete_ns))
                free_ns += costs_ns(taken)
            elif waiting:
                free_ns = max(free_ns, waiting[0].complete_ns)

    @property
    def counts(self) -> Counts:
        """The counters."""
        return self.tally.snapshot()

    @property
    def seqs(self) -> list[int]:
        """Numbers of the pictures taken."""
        return [taken.seq for taken, _ in self.taken]


def test_a_taker_that_is_fast_enough_gets_every_picture_at_once() -> None:
    """13 ms for each: software decoding on one core."""
    run = Run([unit(n) for n in range(900)], lambda _: 13 * MS)
    assert run.seqs == list(range(900)) and run.counts.skipped == 0
    assert max(waited for _, waited in run.taken) < FRAME_NS


@pytest.mark.parametrize("cost_ms", [23, 30, 60, 200, 1500])
@pytest.mark.parametrize("gop", [10, 45, 225])
def test_latency_does_not_grow_when_decoding_is_slower_than_the_stream(cost_ms: int, gop: int) -> None:
    """Two minutes: no picture but one to begin with is ever older than the bound, and all that are dropped are counted."""
    units = [unit(n, gop=gop) for n in range(45 * 120)]
    run = Run(units, lambda _: cost_ms * MS)
    assert all(waited <= MAX_AGE_NS for taken, waited in run.taken if not taken.is_entry)
    assert all(waited <= cost_ms * MS + gop * FRAME_NS for _, waited in run.taken)
    blind = sum(not (b.follows(a) or b.is_entry) for (a, _), (b, _) in pairwise(run.taken))
    assert blind <= run.counts.blind_starts and (gop == 225 or not blind)
    assert len(run.taken) + run.counts.skipped == len(units) and run.counts.skips > 0
    gaps = [b.complete_ns - a.complete_ns for (a, _), (b, _) in pairwise(run.taken)]
    assert max(gaps) <= min(gop * FRAME_NS, BLIND_NS) + 2 * (cost_ms * MS + FRAME_NS) + MAX_AGE_NS, (
        "at most a group of pictures is lost"
    )


def test_after_a_pause_of_the_taker_it_goes_on_with_the_newest_key_picture() -> None:
    """A second's backlog is cut, not worked off; of two key pictures the newer is taken."""
    run = Run([unit(n, gop=10) for n in range(200)], lambda taken: S if taken.seq == 50 else 10 * MS)
    after = run.seqs.index(50) + 1
    assert run.seqs[after] == 90 and run.seqs[after:] == list(range(90, 200))
    assert run.counts.skips == 1 and run.counts.skipped == 39


def test_a_short_pause_is_worked_off() -> None:
    """100 ms cost less than the rest of a group of pictures."""
    run = Run([unit(n) for n in range(200)], lambda taken: 100 * MS if taken.seq == 50 else 10 * MS)
    assert run.seqs == list(range(200)) and run.counts.skipped == 0


def test_a_damaged_key_picture_is_none_to_go_on_with() -> None:
    """The next one that is intact is."""
    units = [replace(unit(n, gop=10), is_intact=n != 90) for n in range(200)]
    run = Run(units, lambda taken: S if taken.seq == 50 else 10 * MS)
    assert run.seqs[run.seqs.index(50) + 1] == 80
    units = [replace(unit(n, gop=10), is_intact=n % 10 != 0 or n in (0, 130)) for n in range(200)]
    run = Run(units, lambda taken: S if taken.seq == 50 else 10 * MS)
    assert run.seqs[run.seqs.index(50) + 1] == 130


def test_a_recovery_point_is_one_to_go_on_with() -> None:
    """Streams with intra refresh have nothing else."""
    units = [replace(unit(n, gop=0), recovers_after=10 if n % 20 == 0 else None) for n in range(200)]
    run = Run(units, lambda taken: S if taken.seq == 50 else 10 * MS)
    assert run.seqs[run.seqs.index(50) + 1] == 80


def test_pictures_that_refer_to_what_was_dropped_are_dropped_with_it() -> None:
    """RASL pictures behind the CRA that it goes on with, whether they wait already or come later."""
    units = [replace(unit(n, gop=20), slice_type=21 if n % 20 == 0 else 9 if n % 20 < 4 else 1) for n in range(200)]
    for pause_ms in (670, 720, 790):
        run = Run(units, lambda taken, ms=pause_ms: ms * MS if taken.seq == 50 else 10 * MS)
        after = run.seqs.index(50) + 1
        assert run.seqs[after : after + 2] == [80, 84] and run.seqs[:after] == list(range(51))
        assert run.seqs[after + 1 :] == list(range(84, 200)), "later ones refer to what was taken"
        assert len(run.seqs) + run.counts.skipped == 200
    run = Run(units, lambda taken: 180 * MS if taken.seq == 56 else 10 * MS)
    assert run.seqs == [*range(57), 60, *range(64, 200)], "the CRA was in time, and became the way out later"
    run = Run(units, lambda taken: 300 * MS if taken.seq == 62 else 10 * MS)
    assert run.seqs == [*range(63), 80, *range(84, 200)], "the CRA came when all was dropped already"


def test_a_stream_without_key_pictures_goes_on_after_a_while_with_whatever_comes() -> None:
    """Late is worse than damaged: the hole tells that it is."""
    run = Run([unit(n, gop=0) for n in range(400)], lambda taken: S if taken.seq == 50 else 10 * MS)
    after = run.seqs.index(50) + 1
    taken, waited = run.taken[after]
    assert not taken.follows(run.taken[after - 1][0]) and waited < FRAME_NS
    assert run.counts.blind_starts == 1 and taken.complete_ns - (50 * FRAME_NS + S) <= BLIND_NS + 2 * FRAME_NS


def test_time_on_the_network_is_no_backlog() -> None:
    """A key picture that takes 400 ms to come over a slow network is the newest there is."""
    late = [replace(unit(n), first_packet_ns=unit(n).complete_ns - 400 * MS) for n in range(200)]
    assert Run(late, lambda _: 10 * MS).counts.skipped == 0


@pytest.mark.parametrize("gop", [45, 0, 1_000_000])
def test_what_waits_is_bounded_while_nobody_takes(gop: int) -> None:
    """By a group of pictures, or by the room there is."""
    backlog = Live(Tally())
    for n in range(20_000):
        backlog.put(unit(n, gop=gop))
        assert len(backlog) <= (gop + 8 if gop == 45 else MAX_UNITS)


@given(
    costs=st.lists(st.integers(1, 400), min_size=1, max_size=30),
    keys=st.sets(st.integers(0, 299)),
    broken=st.sets(st.integers(0, 299)),
)
def test_no_taker_ever_gets_an_old_picture_in_the_middle_of_a_group(costs, keys, broken) -> None:
    """For any cost of each picture and any stream; every picture is taken once or counted as dropped."""
    units = [replace(unit(n, gop=0), is_irap=n in keys, is_intact=n not in broken) for n in range(300)]
    run = Run(units, lambda taken: costs[taken.seq % len(costs)] * MS)
    assert all(waited <= MAX_AGE_NS or taken.is_entry for taken, waited in run.taken)
    assert run.seqs == sorted(set(run.seqs)) and len(run.seqs) + run.counts.skipped == 300
    holes = [b for (a, _), (b, _) in pairwise(run.taken) if not b.follows(a)]
    assert sum(not taken.is_entry for taken in holes) <= run.counts.blind_starts


def test_one_who_keeps_gets_everything_however_late() -> None:
    """A recorder may pause for seconds."""
    keeping = Keeping(tally := Tally())
    for n in range(KEPT_UNITS):
        keeping.put(unit(n))
    taken = [keeping.take(100 * S) for _ in range(len(keeping))]
    assert taken == [unit(n) for n in range(KEPT_UNITS)]
    assert keeping.take(100 * S) is None and tally.snapshot().recorder_dropped == 0


def test_without_room_the_newest_are_dropped_up_to_a_key_picture() -> None:
    """What waits already can still be written; what is dropped is counted, and not as what the decoder dropped."""
    keeping = Keeping(tally := Tally(), max_bytes=2000)
    taken = []
    for n in range(100):
        keeping.put(unit(n, gop=10))
        if n >= 50 and (one := keeping.take(0)) is not None:
            taken.append(one.seq)
    taken += [one.seq for _ in range(len(keeping)) if (one := keeping.take(0)) is not None]
    assert taken[:20] == list(range(20)) and taken[20] % 10 == 0
    assert taken[20:] == list(range(taken[20], 100))
    assert tally.snapshot().recorder_dropped == 100 - len(taken) and tally.snapshot().skipped == 0


def test_one_who_keeps_goes_on_without_a_key_picture_too() -> None:
    """In a stream that has none, once there is room."""
    keeping = Keeping(Tally(), max_bytes=1000)
    for n in range(200):
        keeping.put(unit(n, gop=0))
    assert len(keeping) == 10
    for _ in range(10):
        keeping.take(0)
    keeping.put(unit(300, gop=0))
    assert keeping.take(0) == unit(300, gop=0)
