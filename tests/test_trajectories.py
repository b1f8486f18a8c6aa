"""Trajectories and chunks in virtual time: tolerances as trajectory controllers have them, chunks as policies send them.

The simulated robot follows; every tick is judged by the monitor of the invariants.
"""

from __future__ import annotations

import math
import random
from itertools import pairwise

import pytest

from gateway.core.messages.outputs import FrameKind
from gateway.errors import Code
from gateway.messages.requests import Cancel, Follow
from gateway.messages.snapshot import MotionView
from gateway.values import Side, Vector
from tests.behaviour.scene import Scene, watched
from tests.invariants import Monitor
from tests.pair import S

LEFT, RIGHT = Side.LEFT, Side.RIGHT
BOTH = (LEFT, RIGHT)


@pytest.fixture
def pair() -> Scene:
    """Both arms held, ann their owner."""
    made = watched()
    Monitor(made).epoch = made.epoch
    return made


def path(pair: Scene, *offsets_rad: float, joint: int = 2, sides: tuple[Side, ...] = BOTH) -> dict[Side, list[Vector]]:
    """Points beside where the arms are held: one joint off by so much."""
    held = pair.arm_frames_now()
    return {
        side: [tuple(q + off * (n == joint) for n, q in enumerate(held[side])) for off in offsets_rad] for side in sides
    }


def rise(count: int = 31, size_rad: float = 0.3) -> list[float]:
    """Offsets that begin and end at rest, smoothly."""
    parts = [n / (count - 1) for n in range(count)]
    return [size_rad * x**3 * (10.0 + x * (6.0 * x - 15.0)) for x in parts]


def follow(pair: Scene, points: dict[Side, list[Vector]], dt_s: float = 0.1, **how: object) -> int:
    """Follow points; return the motion."""
    motion_id = pair.granted(Follow(epoch=pair.epoch, points=points, dt_s=dt_s, **how), "ann")["motion_id"]
    assert isinstance(motion_id, int)
    return motion_id


def ended(pair: Scene, motion_id: int, seconds: float = 20.0) -> MotionView:
    """Wait for a motion's end and return what is shown of it."""
    pair.run_until(lambda: pair.motion_view(motion_id).state not in {"queued", "executing"}, seconds)
    return pair.motion_view(motion_id)


def is_held_still(pair: Scene) -> bool:
    """Whether the arms brake to rest and stay there."""
    pair.run(1.0)
    before = pair.arm_frames_now()
    pair.run(0.5)
    return pair.arm_frames_now() == before and pair.state == "ACTIVE"


# ------------------------------------------------------------------------------------------------ success


@pytest.mark.parametrize("offsets_rad", [(0.0, 0.05), (0.0, 0.02, 0.06), tuple(rise())])
def test_points_are_followed_to_the_last_one_which_is_then_held(pair: Scene, offsets_rad: tuple[float, ...]) -> None:
    """Two points, three, many; without tolerances of their own."""
    points = path(pair, *offsets_rad)
    view = ended(pair, follow(pair, points, dt_s=0.4 if len(offsets_rad) < 9 else 0.1))
    assert (view.state, view.code, view.progress) == ("reached", "", 1.0)
    assert is_held_still(pair)
    for side in Side:
        assert pair.arm_frames_now()[side] == pytest.approx(points[side][-1], abs=1e-6)


def test_a_trajectory_inside_its_tolerances_is_reached(pair: Scene) -> None:
    """Path and goal tolerances for every joint, wide enough for the arm's lag and sag."""
    wide = {side: (0.1,) * 7 for side in Side}
    motion = follow(pair, path(pair, *rise()), path_tolerance=wide, goal_tolerance=wide, goal_time_ns=2 * S)
    assert ended(pair, motion).state == "reached"


# ------------------------------------------------------------------------------------------------ violations


def test_an_arm_that_is_held_up_on_the_way_aborts_with_the_joint_to_blame(pair: Scene) -> None:
    """PATH_TOLERANCE, long before the general guard against contact; both arms brake and hold."""
    tight = {RIGHT: (None, None, 0.08, None, None, None, None)}
    motion = follow(pair, path(pair, *rise()), path_tolerance=tight)
    pair.run(1.0)
    pair.robot.inject({"fault": "blocked", "side": "right", "duration_s": 5.0}, pair.now_ns)
    view = ended(pair, motion)
    assert (view.state, view.code) == ("aborted", "PATH_TOLERANCE") and "right arm joint 3" in view.message
    assert pair.told(Code.TRACKING_ERROR) == [] and is_held_still(pair)


def test_a_joint_without_a_path_tolerance_may_be_held_up(pair: Scene) -> None:
    """Another joint's tolerance says nothing about it; the goal is missed all the same."""
    other = {RIGHT: (0.08, 0.08, None, 0.08, 0.08, 0.08, 0.08)}
    motion = follow(pair, path(pair, *rise(size_rad=0.25)), path_tolerance=other, goal_time_ns=S)
    pair.run(1.0)
    pair.robot.inject({"fault": "blocked", "side": "right", "duration_s": 20.0}, pair.now_ns)
    assert ended(pair, motion).code == "GOAL_TOLERANCE"


def test_a_goal_that_is_not_met_in_time_aborts_and_the_arm_holds(pair: Scene) -> None:
    """GOAL_TOLERANCE: this arm sags by more than is asked for; the goal time is the one of the request."""
    narrow = {side: (1e-4,) * 7 for side in Side}
    motion = follow(pair, path(pair, *rise()), goal_tolerance=narrow, goal_time_ns=S // 2)
    began_ns = pair.now_ns
    view = ended(pair, motion)
    assert (view.state, view.code) == ("aborted", "GOAL_TOLERANCE") and "0.0001 rad is asked for" in view.message
    assert 3.5 <= (pair.now_ns - began_ns) / S <= 3.6 and is_held_still(pair)


def test_the_goal_time_counts_in_every_segment(pair: Scene) -> None:
    """Skipped ticks hold the trajectory up on its way: it is too late before its last segment began."""
    motion = follow(pair, path(pair, *rise(count=11)), goal_time_ns=S // 10)
    for _ in range(30):
        pair.run(0.01)
        pair.late_ns = 60_000_000
        pair.step(pair.now_ns + 60_000_000)
    view = ended(pair, motion)
    assert view.code == "GOAL_TOLERANCE" and "of the trajectory was sent" in view.message
    ended_ns = pair.now_ns
    pair.run(1.0)
    assert FrameKind.MOTION not in pair.kinds_since(ended_ns + 1), "what was left of it is not sent"


def test_a_chunk_that_is_over_before_its_arm_got_there_ends_there(pair: Scene) -> None:
    """Two points 20 ms apart that an arm needs 0.5 s to join: late after the goal time, it brakes at once."""
    motion = follow(pair, path(pair, 0.09, 0.09), dt_s=0.02, goal_time_ns=S // 10)
    assert ended(pair, motion).code == "GOAL_TOLERANCE"
    ended_ns = pair.now_ns
    pair.run(0.3)
    assert FrameKind.MOTION not in pair.kinds_since(ended_ns + 1)


def test_a_cancelled_trajectory_brakes_and_holds_where_it_came_to_rest(pair: Scene) -> None:
    """Inside all limits, short of the last point."""
    points = path(pair, *rise())
    motion = follow(pair, points)
    pair.run(1.2)
    pair.granted(Cancel(epoch=pair.epoch, motion_id=motion), "ann")
    assert pair.motion_view(motion).state == "cancelled" and is_held_still(pair)
    assert pair.arm_frames_now()[LEFT][2] < points[LEFT][-1][2] - 0.02


# ------------------------------------------------------------------------------------------------ policies


@pytest.mark.parametrize("seed", range(3))
def test_chunks_five_times_a_second_that_come_late_never_stop_or_turn_the_arm(pair: Scene, seed: int) -> None:
    """Re-planned at 5 Hz from what was up to 0.4 s ago, jittered by 0.3 mrad: no limit, no reversal, hardly any slower."""
    rng = random.Random(seed)
    held, began_ns = pair.arm_frames_now(), pair.now_ns
    for n in range(30):
        observed_s = max((pair.now_ns - began_ns) / S - rng.uniform(0.2, 0.4), 0.0) if n > 2 else 0.0
        points: dict[Side, list[Vector]] = {side: [] for side in Side}
        for k in range(30):
            t = observed_s + k / 30
            way = 0.15 * (t - 0.5 * math.tanh(t / 0.5))
            for side, q in held.items():
                points[side].append(tuple(x + (way if j == 0 else 0.0) + rng.gauss(0.0, 3e-4) for j, x in enumerate(q)))
        how = {"dt_s": 1 / 30, "smoothing_s": 0.15, "open_end": True}
        request = Follow(epoch=pair.epoch, points=points, start_at_ns=began_ns + round(observed_s * S), **how)
        pair.granted(request, "ann")
        pair.run(0.2)
    topic_frames = [frame.values[0] for at_ns, frame in pair.arm_frames(LEFT) if at_ns - began_ns > 2 * S]
    steps = [later - earlier for earlier, later in pairwise(topic_frames)]
    assert min(steps) > 0.6 * 0.15 * 0.01 and max(steps) < 1.5 * 0.15 * 0.01


def test_a_policy_that_stops_sending_leaves_the_arm_held(pair: Scene) -> None:
    """The chunk runs out, the arm brakes and holds, the owner is told, and goes on when it likes."""
    motion = follow(pair, path(pair, *[0.01 * n for n in range(12)]), open_end=True)
    assert ended(pair, motion).code == "UNDERRUN"
    assert any("ran off the end" in message for message in pair.told(Code.MOTION_ENDED))
    assert is_held_still(pair)
    assert ended(pair, follow(pair, path(pair, *rise(size_rad=0.1)))).state == "reached"


def test_a_late_chunk_does_not_move_the_arm_and_says_how_late_it_is(pair: Scene) -> None:
    """All its points have passed."""
    points = path(pair, 0.0, 0.01, 0.02)
    refusal = pair.refused(Follow(epoch=pair.epoch, points=points, dt_s=0.1, start_at_ns=pair.now_ns - S), "ann")
    assert refusal.code is Code.TOO_LATE and not pair.moved()
