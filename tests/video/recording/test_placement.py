"""Rules of `gateway.video.recording.placement`: RTP time within a life, arrival across lives, never backwards."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

from hypothesis import given
from hypothesis import strategies as st

from gateway.video.hevc.access_unit import CLOCK_HZ, AccessUnit
from gateway.video.recording.placement import RUNAWAY_S, Placement

S = 1_000_000_000
UNIT = AccessUnit(
    data=b"",
    seq=0,
    rtp_time=0,
    first_packet_ns=0,
    complete_ns=0,
    is_intact=True,
    is_irap=False,
    has_parameter_sets=False,
    lost=(),
    ssrc=1,
    life=0,
)


def at(rtp_time: int, arrival_ns: int, life: int = 0) -> AccessUnit:
    """Return a picture of these times."""
    return replace(UNIT, rtp_time=rtp_time, first_packet_ns=arrival_ns, life=life)


def places(*units: AccessUnit) -> list[int]:
    """Return where pictures stand, one after another."""
    placement = Placement()
    return [placement.place(unit) for unit in units]


def test_within_a_life_rtp_time_counts_and_arrival_does_not() -> None:
    """The sender's clock is exact; packets arrive with the network's jitter."""
    assert places(at(777, 0), at(2777, 90 * S // 1000), at(4779, 91 * S // 1000)) == [0, 2000, 4002]


def test_a_new_sender_goes_on_as_long_after_the_last_picture_as_it_arrived_after_it() -> None:
    """Its RTP time begins anywhere; half a second of silence is half a second in the recording."""
    assert places(at(500, 0), at(2500, S), at(9, S + S // 2, life=1), at(2009, 2 * S, life=1)) == [
        0,
        2000,
        47_000,
        49_000,
    ]


def test_a_sender_whose_time_ran_away_goes_on_by_arrival() -> None:
    """A jump of RTP time that no clock explains would leave a hole of hours."""
    leap = 3600 * CLOCK_HZ
    found = places(at(0, 0), at(2000, S // 45), at(leap, 2 * S // 45), at(leap + 2000, 3 * S // 45))
    assert found == [0, 2000, 4000, 6000]


def test_a_host_that_was_asleep_keeps_the_senders_time() -> None:
    """Packets that waited in the socket's buffer arrive in one moment, and those after them were lost."""
    asleep_s = RUNAWAY_S + 2
    late = asleep_s * S
    units = [at(0, 0), at(2000, late), at(4000, late), at(asleep_s * CLOCK_HZ, late)]
    assert places(*units) == [0, 2000, 4000, asleep_s * CLOCK_HZ]


@given(
    st.lists(st.tuples(st.integers(0, 1 << 40), st.integers(0, 1 << 45), st.integers(0, 3)), min_size=1, max_size=30)
)
def test_times_always_rise(times: list[tuple[int, int, int]]) -> None:
    """No container takes a picture that stands before the one before it, whatever a sender says."""
    found = places(*(at(*one) for one in times))
    assert found[0] == 0
    assert all(a < b for a, b in pairwise(found))
