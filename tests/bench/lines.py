"""Straight motions in joint mode: what one tick of working them out costs, how long they wait, and how many can be gone."""

from __future__ import annotations

import random
import statistics
import time

from gateway.core.motion.lines.line_path import LinePath
from gateway.core.motion.lines.line_plan import plan_lines
from gateway.core.requests.cartesian import PIECES
from gateway.errors import Refusal
from gateway.robot.limits import HOME_Q_RAD
from gateway.values import EePose, Side
from tests.bench.table import Row
from tests.core.lines import FREE, HOME, going, planned, random_way
from tests.kinematics.bodies import ARMS

__all__ = ["line_rows"]

GOAL_US = 500.0
"""Of one tick; its period is 10 ms."""
COUNT = 200


def line_rows(count: int = COUNT) -> list[Row]:
    """Measure motions of one hand from home that its arm can end, and of random arms.

    Args:
        count: Motions of each kind.
    """
    rng = random.Random(count)
    ticks_us: list[float] = []
    lengths: list[int] = []
    for side, target in _from_home(rng, count):
        taken = _ticks_us(side, target)
        ticks_us += taken
        lengths.append(len(taken))
    ticks_us.sort()
    p50, p99 = ticks_us[len(ticks_us) // 2], ticks_us[int(0.99 * len(ticks_us))]
    rows = [
        Row(
            name=f"a straight motion worked out, {PIECES} pieces a tick",
            ours=f"p50 {p50:.0f}, p99 {p99:.0f} us a tick",
            ratio=f"{statistics.median(lengths):.0f} ticks of 10 ms, at most {max(lengths)}",
            goal=f"p99 <= {GOAL_US:g} us",
            good=p99 <= GOAL_US,
        )
    ]
    for name, paths in (
        ("from home, 10 cm around", [planned(target, None, side) for side, target in _from_home(rng, count)]),
        ("of random arms", [_anywhere(rng, rng.choice(list(Side))) for _ in range(count)]),
    ):
        gone = sorted(path.clock.slowness for path in paths if isinstance(path, LinePath))
        p50, p90 = gone[len(gone) // 2], gone[int(0.9 * len(gone))]
        rows.append(
            Row(
                name=f"straight motions {name}",
                ours=f"{len(gone) / len(paths):.1%} can be gone",
                ratio=f"p50 {p50:.2f}, p90 {p90:.1f} times the time of the poses alone",
            )
        )
    return rows


def _from_home(rng: random.Random, count: int) -> list[tuple[Side, EePose]]:
    """Return sides and poses up to 10 cm from home that the arm can take."""
    found: list[tuple[Side, EePose]] = []
    while len(found) < count:
        side = rng.choice(list(Side))
        p_m = tuple(c + rng.uniform(-0.1, 0.1) for c in HOME[side].p_m)
        target = EePose(p_m=p_m, quat_xyzw=HOME[side].quat_xyzw)
        if ARMS[side].solution(target, HOME_Q_RAD[side]) is not None:
            found.append((side, target))
    return found


def _anywhere(rng: random.Random, side: Side) -> LinePath | Refusal:
    q_rad, target = random_way(rng, side)
    return planned(target, q_rad, side)


def _ticks_us(side: Side, target: EePose) -> list[float]:
    """Return what each tick of working a motion out costs [us of processor time]."""
    work = plan_lines({side: going(side, target)}, FREE, 1.0)
    taken: list[float] = []
    while True:
        begin_ns = time.thread_time_ns()
        try:
            for _ in range(PIECES):
                next(work)
        except StopIteration:
            return taken
        finally:
            taken.append((time.thread_time_ns() - begin_ns) / 1e3)
