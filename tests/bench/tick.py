"""What one tick of the engine costs: both arms ACTIVE and moving, full state, snapshots at 50 Hz; virtual time."""

from __future__ import annotations

import statistics
import time

from gateway.core.engine import Output
from gateway.robot import HOME_Q_RAD
from tests.bench.table import Row
from tests.pair import Pair, S

__all__ = ["tick_rows"]

SECONDS = 6.0


class _Stopwatch:
    """Times `engine.tick` and `engine.receive` of a pair."""

    def __init__(self, pair: Pair) -> None:
        self.tick_us: list[float] = []
        self.receive_us: list[float] = []
        engine = pair.engine
        tick, receive = engine.tick, engine.receive

        def timed_tick(now_ns: int, late_ns: int = 0) -> Output:
            begun = time.perf_counter_ns()
            output = tick(now_ns, late_ns)
            self.tick_us.append((time.perf_counter_ns() - begun) / 1e3)
            return output

        def timed_receive(event: object, now_ns: int) -> None:
            begun = time.perf_counter_ns()
            receive(event, now_ns)
            self.receive_us.append((time.perf_counter_ns() - begun) / 1e3)

        engine.tick, engine.receive = timed_tick, timed_receive


def _steps_us(seconds: float) -> tuple[_Stopwatch, int]:
    pair = Pair()
    epoch = pair.activate()
    watch = _Stopwatch(pair)
    hung = {side: tuple(arm.q_rad) for side, arm in zip(HOME_Q_RAD, pair.robot.arms.values(), strict=True)}
    begun_ns = pair.now_ns
    goals = [HOME_Q_RAD, hung]
    while pair.now_ns - begun_ns < seconds * S:
        pair.move(epoch, goals[0])
        goals.reverse()
        pair.run(2.0)
    return watch, len(watch.tick_us)


def tick_rows() -> list[Row]:
    """Measure the tick."""
    watch, ticks = _steps_us(SECONDS)
    ordered = sorted(watch.tick_us)
    per_tick = sum(watch.receive_us) / ticks
    return [
        Row(
            name="engine.tick, both arms moving",
            ours=f"mean {statistics.fmean(ordered):.0f} us",
            peer="",
            ratio=f"p50 {ordered[ticks // 2]:.0f}, p99 {ordered[int(ticks * 0.99)]:.0f} us",
        ),
        Row(name="engine.receive, all samples of a tick", ours=f"mean {per_tick:.0f} us"),
        Row(name="share of the 10 ms period", ours=f"{(statistics.fmean(ordered) + per_tick) / 100:.1f} %"),
    ]
