"""Tests of how a recording is cut into requests, and how their refusals are led back to the file."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from gateway.cli.motion.passing import (
    LEAST_POINTS,
    PART_POINTS,
    PART_S,
    SHARED_POINTS,
    chosen,
    cut,
    dt_of,
    located,
    space_of,
)
from gateway.cli.motion.recording import Recording
from gateway.errors import Code, Refusal, Rejected, to_exception


def rows(count):
    """So many points that tell one another apart."""
    return np.arange(count * 7.0).reshape(count, 7)


def recording(sides=("left",), count=3, **what):
    """A recording of these arms."""
    return Recording(path=Path("way.csv"), points={side: rows(count) for side in sides}, **what)


@pytest.mark.parametrize("count", [1, 2, PART_POINTS, PART_POINTS + 1, PART_POINTS + LEAST_POINTS, 1000, 5000])
@pytest.mark.parametrize("dt_s", [0.001, 0.02, 0.3, 2.0])
@pytest.mark.parametrize("is_timed", [False, True])
def test_parts_hold_every_point_overlap_and_are_small_enough(count, dt_s, is_timed):
    """Each begins some points before the one before it ends, at the time of its first point; only the last one rests."""
    whole, times_s = rows(count), 1.7e9 + np.arange(count) * dt_s
    parts = list(cut({"left": whole}, times_s if is_timed else None, None if is_timed else dt_s, 1.5))
    assert [part.is_last for part in parts] == [False] * (len(parts) - 1) + [True]
    for part in parts:
        length = len(part.points["left"])
        assert np.array_equal(part.points["left"], whole[part.first : part.first + length])
        assert part.begins_s == pytest.approx(part.first * dt_s * 1.5, abs=1e-6)
        assert length <= 450 and (length <= 2 * LEAST_POINTS or (length - 1) * dt_s * 1.5 <= 2 * PART_S)
        if is_timed:
            assert np.allclose(part.times_s, np.arange(length) * dt_s, atol=1e-6)
    for before, after in pairwise(parts):
        assert after.first == before.first + len(before.points["left"]) - SHARED_POINTS > before.first
    assert parts[-1].first + len(parts[-1].points["left"]) == count


def test_a_short_recording_is_one_request():
    """Nothing is cut that need not be."""
    assert len(list(cut({"left": rows(PART_POINTS)}, None, 0.02, 1.0))) == 1


def test_the_arms_that_are_asked_for_are_chosen():
    """By name; points of an arm without a name need one."""
    both = recording(("left", "right"))
    assert list(chosen(both, "")) == list(chosen(both, "both")) == ["left", "right"]
    assert list(chosen(both, "right")) == ["right"] and list(chosen(recording(("",)), "left")) == ["left"]
    for given, arm, said in (
        (recording(("",)), "", "--arm left"),
        (recording(("",)), "both", "--arm left"),
        (recording(), "right", "it has some for: left"),
        (recording(), "both", "it has some for: left"),
    ):
        with pytest.raises(Rejected) as caught:
            chosen(given, arm)
        assert said in caught.value.hint and caught.value.refusal.field == "file"


def test_space_and_pace_are_said_once():
    """By the file or by the command line; what the file says of its space cannot be denied, its distance can."""
    assert (space_of(recording(), ""), space_of(recording(), "pose"), space_of(recording(space="pose"), "")) == (
        "joint",
        "pose",
        "pose",
    )
    with pytest.raises(Rejected, match="of space pose"):
        space_of(recording(space="pose"), "joint")
    assert dt_of(recording(dt_s=0.5), None) == 0.5 and dt_of(recording(dt_s=0.5), 0.1) == 0.1
    assert dt_of(recording(times_s=np.arange(3.0)), None) is None
    with pytest.raises(Rejected, match="does not say when"):
        dt_of(recording(), None)
    with pytest.raises(Rejected, match="says itself when"):
        dt_of(recording(times_s=np.arange(3.0)), 0.1)


def refuse(code, field, message):
    """Refuse as the gateway does."""
    raise to_exception(Refusal(code=code, message=message, field=field))


def test_a_refusal_of_a_point_says_where_it_stands_in_the_file():
    """Counted from the first point of the file, whichever part it was in."""
    given = recording(count=40, lines=range(3, 43))
    with pytest.raises(Rejected) as caught, located(given, 20):
        refuse(Code.TOO_FAST, "left_arm[5][2]", "left arm point 5 joint 3: 5 rad/s")
    assert caught.value.message == "way.csv line 28: left arm point 25 joint 3: 5 rad/s"
    assert caught.value.refusal.field == "left_arm[25][2]" and caught.value.code is Code.TOO_FAST


@pytest.mark.parametrize("field", ["stretch", "left_arm", "left_arm[0][2]"])
def test_a_refusal_of_something_else_stays_as_it_is(field):
    """Of the wishes, of an arm; a jump is about where the arm is, not about the file."""
    code = Code.JUMP_TOO_FAR if "[" in field else Code.OUT_OF_RANGE
    with pytest.raises(Rejected) as caught, located(recording(), 0):
        refuse(code, field, "as it was")
    assert (caught.value.message, caught.value.refusal.field) == ("as it was", field)
