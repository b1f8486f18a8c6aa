"""Tests of figures as people read them."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.cli.terminal.figures import (
    age_limit_ns,
    age_text,
    fsm_text,
    joints_text,
    rate_text,
    since_text,
    topic_text,
)

MS = 1_000_000
S = 1_000_000_000


@pytest.mark.parametrize(
    ("age_ns", "text"),
    [
        (None, "-"),
        (0, "0.0 ms"),
        (4_210_000, "4.2 ms"),
        (42 * MS, "42 ms"),
        (999 * MS, "999 ms"),
        (1500 * MS, "1.5 s"),
        (99 * S, "99.0 s"),
        (100 * S, "2 min"),
        (7200 * S, "2 h"),
        (4 * 86400 * S + 43200 * S, "4 d"),
    ],
)
def test_ages_have_the_unit_that_fits(age_ns, text):
    """Two or three figures and a unit."""
    assert age_text(age_ns) == text


@given(st.integers(0, 900 * 86400 * S))
def test_no_age_is_wider_than_its_column(age_ns):
    """Seven characters, whatever the age."""
    assert len(age_text(age_ns)) <= 7 and len(since_text(age_ns)) <= 7


@given(st.floats(0.0, 9_999.0))
def test_no_rate_is_wider_than_its_column(rate_hz):
    """Five characters, whatever the rate."""
    assert len(rate_text(rate_hz)) <= 5


def test_small_things():
    """Names, states and joints as they are shown; a clock that ran out shows zero."""
    assert since_text(-5) == "0.0 s"
    assert rate_text(0.0) == "-" and rate_text(19.96) == "20.0" and rate_text(199.6) == "200"
    assert joints_text((0.1, -1.25)) == "+0.100 -1.250"
    assert topic_text("/api/fsm/enable") == "fsm/enable" and topic_text("/fsm_state") == "fsm_state"
    assert fsm_text(2) == "READY (2)" and fsm_text(None) == "unknown" and fsm_text(9) == "? (9)"


@pytest.mark.parametrize(
    ("topic", "limit_ns"),
    [("/left_arm/joint_states", 100 * MS), ("/fsm_state", 500 * MS), ("/api/current_mode", 3 * S), ("/new", 3 * S)],
)
def test_a_topic_is_old_when_the_gateway_calls_it_old(topic, limit_ns):
    """100 ms for the fast states, 0.5 s for the FSM, 3 s for the mode; the longest for a topic that is not known."""
    assert age_limit_ns(topic) == limit_ns
