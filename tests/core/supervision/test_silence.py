"""Silence: how long somebody was not heard, and what one pause of this process explains of it."""

from __future__ import annotations

from gateway.core.supervision.silence import DOUBT_NS, LATE_NS, Silence

MS = 1_000_000
BOUND_NS = 250 * MS


def test_silence_lasts_since_the_last_sign_of_life():
    """It is judged at a look."""
    silence = Silence(1000 * MS)
    assert silence.ns == 0
    silence.look(1300 * MS, 0)
    assert silence.ns == 300 * MS and silence.patience_ns(BOUND_NS) == BOUND_NS
    silence.heard_ns = 1250 * MS
    assert silence.ns == 50 * MS


def test_ordinary_jitter_explains_nothing():
    """A tick that is 20 ms late grants nobody anything."""
    silence = Silence()
    silence.look(100 * MS, LATE_NS)
    assert silence.patience_ns(BOUND_NS) == BOUND_NS


def test_the_longest_pause_counts_and_never_the_sum():
    """A shorter one changes nothing; a longer one takes its place."""
    silence = Silence()
    for now_ms, late_ms, explained_ms in ((100, 50, 50), (200, 30, 50), (400, 90, 90), (500, 60, 90)):
        silence.look(now_ms * MS, late_ms * MS)
        assert silence.patience_ns(BOUND_NS) == BOUND_NS + explained_ms * MS


def test_a_pause_before_the_last_sign_of_life_explains_nothing():
    """Only the part of it that lies behind that sign counts."""
    silence = Silence()
    silence.look(200 * MS, 100 * MS)
    silence.heard_ns = 170 * MS
    assert silence.patience_ns(BOUND_NS) == BOUND_NS + 30 * MS
    silence.heard_ns = 201 * MS
    assert silence.patience_ns(BOUND_NS) == BOUND_NS


def test_who_is_silent_for_long_is_doubted_whatever_explains_it():
    """100 ms beyond the bound, even where a pause of a second explains more."""
    silence = Silence()
    silence.look(BOUND_NS + DOUBT_NS, 1000 * MS)
    assert not silence.is_doubted(BOUND_NS)
    silence.look(BOUND_NS + DOUBT_NS + 1, 1000 * MS)
    assert silence.is_doubted(BOUND_NS) and silence.ns < silence.patience_ns(BOUND_NS)
