"""Tests of chunks: an answer read column by column, and the arithmetic of steps that have passed."""

from __future__ import annotations

import numpy as np
import pytest

from gateway.errors import Code, Rejected
from gateway.policy.chunks import Chunk, chunk_of, retry_after_ns
from gateway.policy.policy_map import Actions, load_map

VENDOR = load_map("vendor_openpi").actions
MS = 1_000_000
PERIOD_NS = 100 * MS
T0 = 5_000 * MS


def chunk(steps: int = 10, joints: np.ndarray | None = None) -> Chunk:
    """A chunk of the left arm."""
    arms = {"left": np.zeros((steps, 7)) if joints is None else joints}
    return Chunk(arms=arms, grips={}, observed_ns=T0, period_ns=PERIOD_NS)


def test_a_row_is_left_arm_left_gripper_right_arm_right_gripper() -> None:
    """Efforts become commands by the vendor's curve, and are clipped to what may be sent."""
    actions = np.tile(np.arange(16, dtype=np.float32), (3, 1))
    actions[:, 7], actions[:, 15] = [2.0, 0.0, -0.8], [-9.0, 9.0, -1.6]
    found = chunk_of({"actions": actions, "x": 1}, VENDOR, T0, PERIOD_NS)
    assert found.steps == 3 and found.observed_ns == T0
    np.testing.assert_array_equal(found.arms["left"][2], range(7))
    np.testing.assert_array_equal(found.arms["right"][0], range(8, 15))
    np.testing.assert_allclose(found.grips["left"], [0.0, 0.1, 0.55])
    np.testing.assert_allclose(found.grips["right"], [1.0, 0.0, 1.0])


def test_a_gripper_may_be_told_its_command_itself() -> None:
    """One arm, lists instead of arrays, clipped to 0..1."""
    layout = Actions(columns=("right_gripper_command", "right_arm"), key="act")
    found = chunk_of({"act": [[1.5] + [0.1] * 7, [0.3] + [0.2] * 7]}, layout, T0, PERIOD_NS)
    np.testing.assert_allclose(found.grips["right"], [1.0, 0.3])
    assert found.arms["right"].shape == (2, 7) and "left" not in found.arms


@pytest.mark.parametrize(
    ("answer", "code", "words"),
    [
        ({"action": 1}, Code.WRONG_SHAPE, "no 'actions', only ['action']"),
        ({"actions": np.zeros((30, 14))}, Code.WRONG_SHAPE, "shape (30, 14), (H, 16), H from 2 to 450 is needed"),
        ({"actions": np.zeros(16)}, Code.WRONG_SHAPE, "shape (16,)"),
        ({"actions": np.zeros((1, 30, 16))}, Code.WRONG_SHAPE, "shape (1, 30, 16)"),
        ({"actions": np.zeros((1, 16))}, Code.WRONG_SHAPE, "shape (1, 16)"),
        ({"actions": np.zeros((451, 16))}, Code.WRONG_SHAPE, "shape (451, 16)"),
        ({"actions": "none"}, Code.WRONG_SHAPE, "shape ()"),
        ({"actions": [[1.0], [1.0, 2.0]]}, Code.WRONG_SHAPE, "no table of numbers"),
        ({"actions": np.zeros((2, 16), bool)}, Code.WRONG_SHAPE, "actions are of bool"),
        ({"actions": [["a"] * 16] * 2}, Code.WRONG_SHAPE, "numbers are needed"),
        ({"actions": np.where(np.arange(32).reshape(2, 16) == 19, np.nan, 0.0)}, Code.NOT_FINITE, "step 1, column 3"),
        ({"actions": np.full((2, 16), np.inf)}, Code.NOT_FINITE, "inf in step 0, column 0"),
    ],
)
def test_an_answer_that_is_no_chunk_is_refused(answer, code, words) -> None:
    """With what it is and what is needed; nothing of it is sent."""
    with pytest.raises(Rejected) as caught:
        chunk_of(answer, VENDOR, T0, PERIOD_NS)
    assert caught.value.code is code and words in caught.value.message and caught.value.bound and caught.value.hint


def test_steps_pass_from_the_observation_on() -> None:
    """Step 0 is when the policy looked: what its thinking took is left out, by measured time."""
    found = chunk()
    assert [found.passed(T0 + ms * MS) for ms in (-50, 0, 1, 100, 101, 899, 5000)] == [0, 0, 1, 1, 2, 9, 10]
    assert [found.row(T0 + ms * MS) for ms in (-50, 0, 99, 100, 899, 5000)] == [0, 0, 0, 1, 8, 9]
    assert not found.is_over(T0 + 899 * MS) and found.is_over(T0 + 900 * MS)


def test_the_next_one_is_asked_for_so_early_that_it_is_there_in_time() -> None:
    """Earlier by as much as answers take; never later than for the last step."""
    assert chunk().ask_ns(5, 120 * MS) == T0 + 380 * MS
    assert chunk().ask_ns(99, 0) == T0 + 900 * MS


def test_smoothing_reaches_over_no_more_steps_than_there_are() -> None:
    """Over whole steps, and none where they are farther apart: the gateway would refuse the chunk."""
    assert [chunk(3).smoothing_s(s) for s in (0.0, 0.04, 0.1, 0.19, 1.0)] == [0.0, 0.0, 0.1, 0.2, 0.2]


def test_the_farthest_joint_is_named() -> None:
    """At the step that counts now, over both arms."""
    left, right = np.zeros((3, 7)), np.zeros((3, 7))
    left[1, 2], right[1, 6] = -0.2, 0.3
    found = Chunk(arms={"left": left, "right": right}, grips={}, observed_ns=T0, period_ns=PERIOD_NS)
    measured = {"left": np.zeros(7), "right": np.zeros(7)}
    assert found.gap(T0 + 150 * MS, measured) == (0.3, "right", 7)
    assert found.gap(T0, measured)[0] == 0.0


def test_steps_over_a_velocity_are_counted_once() -> None:
    """However many joints and arms are too fast in them."""
    joints = np.zeros((4, 7))
    joints[2:, :2] = 0.11
    found = Chunk(arms={"left": joints, "right": -joints}, grips={}, observed_ns=T0, period_ns=PERIOD_NS)
    assert found.over_speed(1.0) == 1 and found.over_speed(1.2) == 0


def test_waits_between_tries_double_up_to_two_seconds() -> None:
    """Whatever happens how often."""
    assert [retry_after_ns(n) / 1e9 for n in (0, 1, 2, 5, 6, 1000)] == [0.1, 0.1, 0.2, 1.6, 2.0, 2.0]


def line(begin: float, slope: float, observed_ns: int, steps: int = 10) -> Chunk:
    """A chunk whose joints move evenly [rad/s]."""
    rows = np.repeat(begin + slope * np.arange(steps)[:, np.newaxis] * PERIOD_NS / 1e9, 7, axis=1)
    return Chunk(arms={"left": rows}, grips={}, observed_ns=observed_ns, period_ns=PERIOD_NS)


def test_a_chunk_that_goes_on_as_the_last_one_is_the_same_way_with_what_was_played_in_front() -> None:
    """As many steps as smoothing looks back on, and three: at the old one's own instants, so that nothing is between them."""
    before = line(0.0, 1.0, T0)
    after = line(0.35, 1.0, T0 + 350 * MS)
    way = after.joined_to(before, T0 + 500 * MS, 0.1)
    assert (way.steps, way.observed_ns) == (13, T0)
    np.testing.assert_allclose(way.arms["left"][:, 0], 0.1 * np.arange(13))
    way = after.joined_to(before, T0 + 800 * MS, 0.1)
    assert way.observed_ns == T0 + 300 * MS


def test_the_old_way_stays_for_as_long_as_smoothing_has_looked_ahead_then_it_fades() -> None:
    """Twice the smoothing, then for four times, without a step of velocity or acceleration; behind it is the new one alone."""
    before, after = line(0.0, 0.0, T0, 20), line(1.0, 0.0, T0 + 500 * MS, 20)
    way = after.joined_to(before, T0 + 700 * MS, 0.2)
    at_s = (way.observed_ns - T0) / 1e9 + 0.1 * np.arange(way.steps)
    q = way.arms["left"][:, 0]
    assert np.all(q[at_s < 1.101] == 0.0) and np.all(q[at_s > 1.899] == 1.0) and np.all(np.diff(q) >= 0.0)
    assert q[np.argmin(abs(at_s - 1.5))] == pytest.approx(0.5)
    assert np.abs(np.diff(q, 2)).max() < 6.0 * (0.1 / 0.8) ** 2


def test_where_the_old_way_ends_its_last_difference_fades() -> None:
    """Held until then: a quarter of what is left of the new one, which fades over half of it."""
    before, after = line(0.0, 0.0, T0, 20), line(1.0, 0.5, T0 + 1500 * MS, 20)
    way = after.joined_to(before, T0 + 1700 * MS, 0.2)
    at_ns = way.observed_ns + PERIOD_NS * np.arange(way.steps)
    away = after.at(at_ns, "left")[:, 0] - way.arms["left"][:, 0]
    is_behind = at_ns >= before.end_ns
    assert np.all(np.diff(away[is_behind]) <= 1e-12) and away[is_behind][0] > 0.9
    assert np.all(away[at_ns >= T0 + 3050 * MS] == 0.0)


@pytest.mark.parametrize("steps", [5, 8, 30])
def test_short_chunks_come_to_count_as_well(steps: int) -> None:
    """However few steps they have, and however often they come: the way comes to where they all are."""
    way, every = line(0.0, 0.0, T0, steps), max(1, steps // 4)
    for n in range(1, 40):
        observed_ns = T0 + n * every * PERIOD_NS
        way = line(1.0, 0.0, observed_ns, steps).joined_to(way, observed_ns + PERIOD_NS // 2, 0.1)
    assert way.arms["left"][-1, 0] == pytest.approx(1.0, abs=0.01)


def test_a_chunk_stays_as_it_is_where_nothing_is_to_be_joined() -> None:
    """The first one, one behind an end, and where no smoothing is wanted."""
    before, after = line(0.0, 0.0, T0), line(1.0, 0.0, T0 + 500 * MS)
    assert after.joined_to(None, T0, 0.1) is after
    assert after.joined_to(before, T0 + 600 * MS, 0.0) is after
    assert after.joined_to(before, T0 + 900 * MS, 0.1) is after


def test_chassis_and_lift_are_driven_by_their_columns() -> None:
    """In the order of the map; judged whole by the bounds: over the ground, turning, a part of full speed."""
    layout = Actions(columns=("lift_velocity", "left_arm", "chassis_velocity"))
    rows = np.zeros((4, 11))
    rows[:, 0], rows[:, 8:] = [0.0, 1.0, -1.0, 0.5], [0.3, -0.4, 0.2]
    found = chunk_of({"actions": rows}, layout, T0, PERIOD_NS)
    np.testing.assert_allclose(found.drives["lift"], rows[:, :1])
    np.testing.assert_allclose(found.drives["chassis"], rows[:, 8:])
    found.require_drivable(0.5, 0.2, 1.0)
    for bounds, words in (
        ((0.49, 0.2, 1.0), "wants 0.5 m/s of the chassis, 0.49 is the bound"),
        ((0.5, 0.19, 1.0), "wants 0.2 rad/s of the chassis, 0.19 is the bound"),
        ((0.5, 0.2, 0.6), "wants 1 of the lift's full speed, 0.6 is the bound"),
    ):
        with pytest.raises(Rejected, match=words) as caught:
            found.require_drivable(*bounds)
        assert caught.value.code is Code.OUT_OF_RANGE
    chunk().require_drivable(0.0, 0.0, 0.0)


def test_a_chunk_is_known_between_its_steps() -> None:
    """Straight from one to the next; before and after it, as at its ends."""
    found = chunk(3, np.outer([0.0, 1.0, 3.0], np.ones(7)))
    assert found.at(T0 + PERIOD_NS * np.arange(5), "left").shape == (5, 7)
    for periods, q_rad in ((-1.0, 0.0), (0.5, 0.5), (1.75, 2.5), (9.0, 3.0)):
        np.testing.assert_allclose(found.at(T0 + round(periods * PERIOD_NS), "left"), q_rad)
