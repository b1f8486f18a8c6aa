"""Chunks as a user gives them: what is no array of numbers, and what is no number, is refused and never converted."""

from __future__ import annotations

import numpy as np
import pytest

from gateway.client.asking.chunks import follow
from gateway.errors import Code, Rejected

ROW = [0.1] * 7


def refusal(points=(ROW, ROW), dt=0.1, **how):
    """The exception of a request that must be refused."""
    with pytest.raises(Rejected) as caught:
        follow(1, {"left": points}, dt, **how)
    return caught.value


def test_whatever_numpy_takes_as_rows_is_taken():
    """Lists, tuples, arrays; a tolerance for all joints or one for each."""
    for points in ([ROW, ROW], (tuple(ROW), tuple(ROW)), np.full((2, 7), 0.1)):
        asked = follow(1, {"left": points}, np.float32(0.5), stretch=2, path_tolerance=0.2, goal_tolerance=[None] * 7)
        assert asked.points == {"left": (tuple(ROW), tuple(ROW))} and (asked.dt_s, asked.stretch) == (0.5, 2.0)
        assert asked.path_tolerance == {"left": (0.2,) * 7} and asked.goal_tolerance == {"left": (None,) * 7}


@pytest.mark.parametrize(
    "points",
    [
        [["0.1"] * 7] * 2,
        [[True] * 7] * 2,
        [[*ROW[:6], "0.1"]],
        [[*ROW[:6], 10**400]],
        [ROW, ROW[:6]],
        ROW,
        "points",
        [[1j] * 7],
    ],
)
def test_what_is_no_array_of_rows_is_refused(points):
    """Texts and truth values as well, whatever numpy makes of them."""
    error = refusal(points)
    assert (error.code, error.field) == (Code.WRONG_SHAPE, "left_arm")


@pytest.mark.parametrize("times", [["0.0", "0.1"], [False, True], [[0.0, 0.1]], "now"])
def test_what_is_no_row_of_times_is_refused(times):
    """One number for each point [s]."""
    error = refusal(dt=None, times=times)
    assert (error.code, error.field) == (Code.WRONG_SHAPE, "times")


@pytest.mark.parametrize("value", ["0.5", True, b"1", np.bool_(1), [0.5]])
@pytest.mark.parametrize("name", ["dt", "stretch", "smoothing", "start_at", "start_in", "goal_time"])
def test_a_text_or_a_truth_value_is_no_number(name, value):
    """It is refused with the name of what it was given for."""
    error = refusal(**{name: value})
    assert (error.code, error.field) == (Code.BAD_REQUEST, name)


@pytest.mark.parametrize("name", ["path_tolerance", "goal_tolerance"])
@pytest.mark.parametrize("value", ["0.5", True, [*ROW[:6], "0.1"], [*ROW[:6], True]])
def test_a_text_or_a_truth_value_is_no_tolerance(name, value):
    """A text is a sequence too, but not of tolerances."""
    error = refusal(**{name: value})
    assert (error.code, error.field) == (Code.BAD_REQUEST, name)


def test_tolerances_come_in_as_many_as_there_are_joints_or_parts_of_a_pose():
    """Seven for joints; for poses two, of metres and radians: one for both cannot be meant."""
    assert refusal(path_tolerance=[0.1, 0.2]).code is Code.WRONG_SHAPE
    how = {"frames": {"left": "left_shoulder_base"}}
    assert refusal(path_tolerance=0.1, **how).code is Code.WRONG_SHAPE
    assert follow(1, {"left": [ROW]}, 0.1, path_tolerance=(0.1, 0.2), **how).path_tolerance == {"left": (0.1, 0.2)}


@pytest.mark.parametrize("points", [{}, {"middle": [ROW]}])
def test_a_chunk_needs_an_arm_that_there_is(points):
    """None, or an unknown one."""
    with pytest.raises(Rejected) as caught:
        follow(1, points, 0.1)
    assert caught.value.code is Code.WRONG_SHAPE


def test_a_chunk_begins_at_an_instant_or_after_a_time():
    """Not both; and neither at no time at all."""
    assert refusal(start_at=1.0, start_in=0.1).code is Code.BAD_REQUEST
    assert refusal(start_in=float("nan")).code is Code.OUT_OF_RANGE
