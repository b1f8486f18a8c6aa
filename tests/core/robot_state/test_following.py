"""Does an arm follow: lag, reversal, noise and standing still are no stall; what is stuck is named, until it caught up."""

from __future__ import annotations

import math
import random
from collections.abc import Callable

import pytest

from gateway.core.robot_state.following import JOINT_GRAIN, POSE_GRAIN, WINDOW_NS, Following, Stall

MS = 1_000_000
S = 1_000_000_000
PERIOD_NS = 100 * MS

Course = Callable[[float], float]


def play(
    setpoint: Course,
    measured: Course,
    seconds: float,
    joints: tuple[int, ...] = (0,),
    following: Following | None = None,
) -> list[tuple[float, Stall | None]]:
    """Look ten times a second at joints that are all asked for one course and do another; the rest stands still."""
    following = following or Following(JOINT_GRAIN)
    seen = []
    for n in range(round(seconds * 10) + 1):
        t = n / 10
        asked = tuple(setpoint(t) if joint in joints else 0.5 for joint in range(7))
        went = tuple(measured(t) if joint in joints else 0.5 for joint in range(7))
        seen.append((t, following.look(asked, went, n * PERIOD_NS)))
    return seen


def stalls(seen: list[tuple[float, Stall | None]]) -> list[Stall]:
    """Return the verdicts that are one."""
    return [stall for _, stall in seen if stall is not None]


@pytest.mark.parametrize("speed", [0.05, 0.1, 0.5, 3.0])
def test_an_arm_that_stands_while_its_setpoint_moves_is_stuck(speed: float) -> None:
    """Within a second of being noticeably behind, at any speed; where it is and where it should be are given."""
    seen = play(lambda t: speed * t, lambda t: 0.0, 3.0)
    at_s, stall = next((t, stall) for t, stall in seen if stall is not None)
    assert at_s <= max(0.7, 0.06 / speed + 0.5) and stall is not None
    assert (stall.stuck, stall.worst, stall.others_follow) == ((0,), 0, False)
    assert stall.measured == 0.0 and stall.off == pytest.approx(speed * at_s)


def test_an_arm_that_stops_on_its_way_is_stuck_since_it_stopped() -> None:
    """What it did before counts for nothing once it stands."""
    seen = play(lambda t: 0.5 * t, lambda t: 0.5 * min(t, 1.05), 2.0)
    at_s, stall = next((t, stall) for t, stall in seen if stall is not None)
    assert stall is not None and 1.3 <= at_s <= 1.7 and stall.since_ns == 1100 * MS


@pytest.mark.parametrize("lag_s", [0.0, 0.05, 0.2])
@pytest.mark.parametrize(
    "course",
    [
        lambda t: 1.0 * t,
        lambda t: 0.02 * t,
        lambda t: 0.3 * math.sin(2 * math.pi * 0.5 * t),
        lambda t: 0.1 * math.sin(2 * math.pi * 1.0 * t),
        lambda t: 0.02 * math.sin(2 * math.pi * 2.0 * t),
        lambda t: 0.2 * (int(t) % 2),
        lambda t: min(1.0, max(0.0, t - 2.0)),
        lambda t: 0.0,
    ],
    ids=["fast", "slow", "sine 0.5 Hz", "sine 1 Hz", "shaking", "steps", "begins and rests", "rests"],
)
def test_lag_reversal_noise_and_rest_are_no_stall(course: Course, lag_s: float) -> None:
    """An arm that does what it is told, late and with noise, is never called stuck."""
    noise = random.Random(3)
    assert stalls(play(course, lambda t: course(t - lag_s) + noise.gauss(0.0, 3e-4), 8.0)) == []


def test_an_arm_that_is_held_off_its_setpoint_at_rest_is_not_stuck() -> None:
    """Nothing was asked for: sag or a push is not told here."""
    assert stalls(play(lambda t: 0.0, lambda t: 0.2, 3.0)) == []


def test_one_joint_that_stops_while_the_others_go_on_is_told_apart() -> None:
    """The others moved after it had stopped."""
    following = Following(JOINT_GRAIN)
    verdicts = []
    for n in range(20):
        t = n / 10
        asked = (0.5 * t,) * 3 + (0.0,) * 4
        verdicts.append(following.look(asked, (0.5 * t, 0.5 * min(t, 0.6), 0.5 * t, 0.0, 0.0, 0.0, 0.0), n * PERIOD_NS))
    stall = next(stall for stall in verdicts if stall is not None)
    assert stall.others_follow and stall.stuck == (1,) and stall.since_ns == 600 * MS


def test_joints_that_all_stop_at_once_are_one_stall() -> None:
    """Whichever is noticed first: what moved before it stopped is no sign that the arm follows. The worst one is named."""
    following = Following(JOINT_GRAIN)
    verdicts = []
    for n in range(20):
        t, stop = n / 10, min(n / 10, 0.8)
        asked = (0.5 * t**2, 0.8 * math.sin(t), *(0.3 * t for _ in range(5)))
        went = (0.5 * stop**2, 0.8 * math.sin(stop), *(0.3 * stop for _ in range(5)))
        verdicts.append(following.look(asked, went, n * PERIOD_NS))
    found = [stall for stall in verdicts if stall is not None]
    assert found and not any(stall.others_follow for stall in found)
    assert found[-1].worst == 0


def test_a_stall_stands_until_the_arm_has_caught_up() -> None:
    """A setpoint that rests is no end of it; to be where it should be is."""
    following = Following(JOINT_GRAIN)
    seen = play(lambda t: 0.5 * min(t, 1.0), lambda t: 0.0 if t < 3.0 else 0.5, 4.0, following=following)
    states = {t: stall is not None for t, stall in seen}
    assert states[1.0] and states[2.9] and not states[3.0] and not states[4.0]


def test_what_is_forgotten_is_judged_anew() -> None:
    """A stream that was seeded elsewhere has jumped; the arm has not."""
    following = Following(JOINT_GRAIN)
    assert stalls(play(lambda t: 0.5 * t, lambda t: 0.0, 1.0, following=following))
    following.forget()
    assert following.look((0.5,) * 7, (0.5,) * 7, 2 * S) is None
    assert stalls(play(lambda t: 0.0, lambda t: 0.0, 1.0, following=following)) == []


def test_old_looks_do_not_count() -> None:
    """After a pause in looking there is nothing to compare with."""
    following = Following(JOINT_GRAIN)
    following.look((0.0,) * 7, (0.0,) * 7, 0)
    assert following.look((1.0,) * 7, (0.0,) * 7, 2 * WINDOW_NS) is None


def test_a_pose_has_its_own_grains() -> None:
    """Metres and quaternion parts: 3 cm without an answer are a stall."""
    following = Following(POSE_GRAIN)
    pose = (0.3, 0.0, -0.4, 0.0, 0.0, 0.0, 1.0)
    verdicts = [
        following.look((0.3 + 0.05 * n / 10, *pose[1:]), pose, n * PERIOD_NS) for n in range(15)
    ]  # fmt: skip
    assert any(stall is not None and stall.stuck == (0,) for stall in verdicts)
