"""Rules of `gateway.video.receiving.counters`: numbers that do not change once they were read, and no name that is none."""

from __future__ import annotations

import pytest

from gateway.video.receiving.counters import Counts, Tally


def test_a_snapshot_does_not_change_and_cannot_be_changed() -> None:
    """Whoever holds it can compare it with a later one."""
    tally = Tally()
    tally.add(lost=3, late=1)
    counts = tally.snapshot()
    tally.add(lost=4)
    assert (counts.lost, counts.late) == (3, 1) and tally.snapshot().since(counts) == Counts(lost=4)
    with pytest.raises(AttributeError):
        counts.lost = 0  # type: ignore[misc]


def test_a_counter_that_does_not_exist_is_refused() -> None:
    """A slip of the pen must not count nowhere."""
    with pytest.raises(KeyError, match="losst"):
        Tally().add(losst=1)


def test_every_counter_says_what_it_counts() -> None:
    """The numbers are read by people."""
    text = Counts.__doc__ or ""
    assert all(f"{name}: " in text for name in Counts.__slots__)


def test_datagrams_that_are_no_rtp_are_summed_up() -> None:
    """Another payload type is RTP all the same."""
    assert Counts(too_short=1, bad_version=2, bad_header=4, bad_padding=8, empty=16, bad_payload_type=32).bad_rtp == 31
