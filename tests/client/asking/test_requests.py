"""Tests of what a user says, as requests."""

from __future__ import annotations

import numpy as np
import pytest

from gateway.api.translate import describe
from gateway.client.asking.requests import joints, move, number, read_only, seconds, within_limits
from gateway.core.limits.validation import check_goal
from gateway.errors import Code, Refusal, Rejected, to_exception
from gateway.messages.incoming import OnLimit
from gateway.settings.settings import ArmSettings, Settings
from gateway.values import Side
from tests.changed import replace

INFO = describe(Settings(), socket="/s", pid=1)
MIDDLE = {"left": (0.0, 1.0, -0.5, 1.2, 0.0, 0.0, 0.0), "right": (0.0, -1.0, 0.5, -1.2, 0.0, 0.0, 0.0)}


@pytest.mark.parametrize(
    "q", [[0, 1, 0, 1, 0, 0, 0], np.arange(7), np.float32([0.5] * 7), (0.1,) * 7, np.linspace(0, 1, 14)[::2]]
)
def test_whatever_numpy_takes_as_seven_numbers_is_taken(q):
    """Lists, tuples, integer and strided arrays become seven floats."""
    values = joints("left", q)
    assert len(values) == 7 and all(type(value) is float for value in values)
    assert np.allclose(values, np.asarray(q, dtype=float))


@pytest.mark.parametrize("side", ["left", "right"])
def test_limits_are_judged_as_the_daemon_judges_them(side):
    """Sweep every joint across both bounds: the client refuses and clips exactly what the daemon does."""
    settings = ArmSettings()
    for joint in range(7):
        for edge in (settings.lower_rad[Side(side)][joint], settings.upper_rad[Side(side)][joint]):
            for step in (-0.1, -1e-9, 0.0, 1e-9, 0.1):
                q = list(MIDDLE[side])
                q[joint] = edge + step
                theirs = check_goal(Side(side), q, settings, OnLimit.REJECT)
                clipped = check_goal(Side(side), q, settings, OnLimit.CLIP)
                assert within_limits(side, tuple(q), INFO, "clip") == clipped.values
                if isinstance(theirs, Refusal):
                    with pytest.raises(type(to_exception(theirs))) as caught:
                        within_limits(side, tuple(q), INFO, "reject")
                    ours = caught.value.refusal
                    assert replace(ours, hint="") == replace(theirs, hint="")
                else:
                    assert within_limits(side, tuple(q), INFO, "reject") == theirs.values


@pytest.mark.parametrize(
    "q",
    [["0.1"] * 7, [True] * 7, np.ones(7, dtype=bool), [10**400] * 7, [1j] * 7, [b"1"] * 7, [None, True, *[0.1] * 5]],
)
def test_seven_words_are_no_joints(q):
    """Text, truth values and what no float can hold are refused, not converted."""
    with pytest.raises(Rejected) as caught:
        joints("left", q)
    assert caught.value.code is Code.WRONG_SHAPE and caught.value.field == "left_arm"


def test_a_number_is_whatever_has_one():
    """Integers, numpy scalars and arrays without a dimension become floats; NaN and infinity are judged by others."""
    for value in (1, 0.5, np.float32(0.5), np.int64(3), np.array(2.0), float("inf")):
        assert type(number("x", value)) is float and number("x", value) == value
    with pytest.raises(Rejected) as caught:
        number("force", "0.5")
    assert (caught.value.code, caught.value.field, caught.value.value) == (Code.BAD_REQUEST, "force", "'0.5'")


def test_vectors_handed_out_cannot_be_changed():
    """A reader that writes into a vector is told so, instead of changing somebody's state."""
    with pytest.raises(ValueError, match="read-only"):
        read_only((1.0, 2.0))[0] = 3.0


def test_a_motion_names_its_arms_in_order():
    """Left before right, whatever the order of the mapping; numbers become plain floats."""
    request = move(
        3,
        {"right": np.zeros(7), "left": [1] * 7},
        relative=True,
        speed=np.float32(0.5),
        tolerance_rad=1,
        on_limit="clip",
    )
    assert list(request.targets_rad) == ["left", "right"] and request.epoch == 3 and request.relative
    assert type(request.speed) is float and request.tolerance_rad == 1.0 and request.on_limit == "clip"


def test_times_are_finite_and_not_negative():
    """A time is kept as whole nanoseconds; one that means nothing is refused with its name."""
    assert seconds("timeout", 1.5) == 1_500_000_000 and seconds("timeout", 0) == 0
    for value, code in ((-0.1, Code.OUT_OF_RANGE), (float("inf"), Code.NOT_FINITE), (1e9, Code.OUT_OF_RANGE)):
        with pytest.raises(Rejected) as caught:
            seconds("timeout", value)
        assert caught.value.code is code and caught.value.field == "timeout"
