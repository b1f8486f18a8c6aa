"""Tests of joints as bars."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from gateway.cli.terminal.bars import arm_rows, bar
from tests.api.stand_in import a_snapshot
from tests.cli.views import INFO, S, a_view


def styles_at(line, mark):
    """Return the style under a mark."""
    at = line.plain.index(mark)
    return " ".join(str(span.style) for span in line.spans if span.start <= at < span.end)


@pytest.mark.parametrize(
    ("q_rad", "plain", "colour"),
    [
        (-1.0, "├●────────┤", "yellow"),
        (0.0, "├────●────┤", "green"),
        (1.0, "├────────●┤", "yellow"),
        (1.01, "├────────●┤", "red"),
        (-99.0, "├●────────┤", "red"),
    ],
)
def test_a_joint_stands_where_it_is_between_its_limits(q_rad, plain, colour):
    """Left end is the lower limit; near a limit is yellow, beyond one red, and never outside the bar."""
    line = bar(q_rad, None, -1.0, 1.0, 11)
    assert line.plain == plain and colour in styles_at(line, "●")


def test_the_setpoint_shows_where_it_is_elsewhere():
    """The setpoint is beside the joint while it moves, and under it when they agree."""
    assert bar(-0.5, 0.5, -1.0, 1.0, 11).plain == "├──●───◆──┤"
    assert bar(0.5, 0.5, -1.0, 1.0, 11).plain == "├──────●──┤"
    assert bar(None, 0.5, -1.0, 1.0, 11).plain == "├──────◆──┤"
    assert bar(None, None, -1.0, 1.0, 11).plain == "├─────────┤"


@given(
    st.none() | st.floats(-1e9, 1e9),
    st.none() | st.floats(-1e9, 1e9),
    st.floats(-3.0, -0.1),
    st.floats(0.1, 3.0),
    st.integers(0, 120),
)
def test_a_bar_has_its_width(q_rad, q_ref_rad, lower_rad, upper_rad, width):
    """Whatever the numbers: the width asked for, 5 at least."""
    assert bar(q_rad, q_ref_rad, lower_rad, upper_rad, width).cell_len == max(5, width)


@pytest.mark.parametrize("width", [80, 111, 112, 120, 200])
def test_both_arms_have_nine_rows_that_fit(width):
    """A heading, seven joints and the end effector; limits in figures where there is room."""
    rows = list(arm_rows(a_view(), INFO, 0, width))
    assert len(rows) == 9
    assert all(row.cell_len <= width for row in rows)
    assert ("-2.60" in rows[3].plain) == (width >= 112)
    assert "+0.100" in rows[1].plain


def test_an_arm_without_state_says_so():
    """No figure is made up for an arm that was never measured; the setpoint's error is shown while it moves."""
    arm = a_snapshot().arms["left"]
    unknown = a_view(arms={"left": replace(arm, measured=None), "right": arm})
    heading, first, *_ = [row.plain for row in arm_rows(unknown, INFO, 0, 80)]
    assert heading.startswith("LEFT ARM rad - no setpoint") and "1      - ├────" in first
    moving = replace(arm, streaming=True, q_ref_rad=arm.measured.q_rad, tracking_rad=0.012)
    rows = [row.plain for row in arm_rows(a_view(arms={"left": moving, "right": arm}), INFO, S, 80)]
    assert "LEFT ARM rad 1.0 s ◆ off by 0.012" in rows[0]


@pytest.mark.parametrize(("changed", "word"), [("arm_enabled", "disabled"), ("joint_mode", "pose mode")])
def test_an_arm_that_cannot_be_moved_says_why(changed, word):
    """Disabled and end-effector mode stand beside the arm's name."""
    mode = replace(a_snapshot().mode, **{changed: {"left": False, "right": True}})
    heading = next(arm_rows(a_view(mode=mode), INFO, 0, 80)).plain
    assert f"LEFT ARM rad {word}" in heading and f"RIGHT ARM rad {word}" not in heading


def test_an_arm_in_end_effector_mode_shows_its_setpoint_beside_the_measured_place():
    """Both in metres, and the distance between them in the heading."""
    arm = replace(
        a_snapshot().arms["left"],
        space="pose",
        streaming=True,
        ref_p_m=(0.31, 0.1, -0.2),
        tracking_m=0.01,
        tracking_rad=0.0,
    )
    rows = list(arm_rows(a_view(arms={"left": arm, "right": arm}), INFO, 0, 200))
    assert "off by 10.0 mm" in rows[0].plain
    assert "p +0.300 +0.100 -0.200 m ◆ +0.310 +0.100 -0.200" in rows[8].plain


@pytest.mark.parametrize(
    ("model", "text"),
    [
        (None, "p +0.300 +0.100 -0.200 m"),
        ({}, "p +0.300 +0.100 -0.200 m  model 0.2 mm 1.0 mrad"),
        ({"state": "differs", "position_m": 0.0123}, "p +0.300 +0.100 -0.200 m  model DIFFERS 12.3 mm 1.0 mrad"),
        ({"state": "unknown", "position_m": None}, "p +0.300 +0.100 -0.200 m  model unknown"),
        ({"state": "of a later gateway"}, "p +0.300 +0.100 -0.200 m  model OF A LATER GATEWAY 0.2 mm 1.0 mrad"),
    ],
)
def test_how_far_the_body_model_is_from_an_arm_stands_beside_its_place(model, text):
    """Millimetres first: in 80 columns they are still seen; nothing where there is no model."""
    arm = a_snapshot().arms["left"]
    arm = replace(arm, model=None if model is None else replace(arm.model, **model))
    assert list(arm_rows(a_view(arms={"left": arm, "right": arm}), INFO, 0, 200))[8].plain[:98].rstrip() == text
    narrow = list(arm_rows(a_view(arms={"left": arm, "right": arm}), INFO, 0, 80))[8]
    assert narrow.cell_len <= 80 and text[:38] in narrow.plain


def test_a_pose_setpoint_goes_before_a_model_that_agrees():
    """Both do not fit; one that differs is shown wherever there is room."""
    arm = replace(a_snapshot().arms["left"], ref_p_m=(0.31, 0.1, -0.2))
    other = replace(arm, model=replace(arm.model, state="differs"))
    place = list(arm_rows(a_view(arms={"left": arm, "right": other}), INFO, 0, 200))[8].plain
    assert "model" not in place[:99] and "model DIFFERS" in place[99:]
