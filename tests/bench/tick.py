"""What one tick of the engine costs, by what it has to do: at rest, held, moving, everything; virtual time.

Ticks follow each other, so that caches are hot. A loop sleeps in between, and other processes empty them: the last scene.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable

from gateway.core.engine import Output
from gateway.core.robot_state.body_model import body_model
from gateway.messages import requests
from gateway.robot.limits import HOME_Q_RAD
from gateway.settings.settings import Settings
from gateway.values import Side
from tests.bench.table import Row
from tests.pair import MS, Pair, S

__all__ = ["tick_rows"]

SECONDS = 6.0
PERIOD_US = 10_000.0


class _Stopwatch:
    """Times `engine.tick` and `engine.receive` of a pair, in processor time of this thread; may sleep before each tick."""

    def __init__(self, pair: Pair, sleep_s: float = 0.0) -> None:
        self.tick_us: list[float] = []
        self.receive_us: list[float] = []
        engine = pair.engine
        tick, receive = engine.tick, engine.receive

        def timed_tick(now_ns: int, late_ns: int = 0) -> Output:
            time.sleep(sleep_s)
            begun = time.thread_time_ns()
            output = tick(now_ns, late_ns)
            self.tick_us.append((time.thread_time_ns() - begun) / 1e3)
            return output

        def timed_receive(event: object, now_ns: int) -> None:
            begun = time.thread_time_ns()
            receive(event, now_ns)
            self.receive_us.append((time.thread_time_ns() - begun) / 1e3)

        engine.tick, engine.receive = timed_tick, timed_receive


def _run(
    pair: Pair, seconds: float, act: Callable[[], None] = lambda: None, every_s: float = 2.0, sleep_s: float = 0.0
) -> _Stopwatch:
    """Run a pair for a while, acting now and then, and time it."""
    watch = _Stopwatch(pair, sleep_s)
    begun_ns = pair.now_ns
    while pair.now_ns - begun_ns < seconds * S:
        act()
        pair.run(every_s)
    return watch


def _at_rest() -> _Stopwatch:
    pair = Pair()
    pair.engine.is_watched = False
    pair.run(0.5)
    return _run(pair, SECONDS)


def _held() -> _Stopwatch:
    pair = Pair()
    pair.activate()
    return _run(pair, SECONDS)


def _moving(*, everything: bool, is_modelled: bool = False, sleep_s: float = 0.0) -> _Stopwatch:
    """Both arms go to the initial position and back; with everything: grippers grip and the chassis drives, too."""
    pair = Pair(model=body_model(Settings()) if is_modelled else None)
    epoch = pair.activate()
    hung = {side: tuple(arm.q_rad) for side, arm in zip(HOME_Q_RAD, pair.robot.arms.values(), strict=True)}
    goals = [HOME_Q_RAD, hung]
    if everything:
        for side in Side:
            pair.granted(requests.SetGripper(epoch=epoch, side=side, raw=0.5))
    acts = 0

    def act() -> None:
        nonlocal acts
        if acts % 10 == 0:
            pair.move(epoch, goals[0])
            goals.reverse()
        acts += 1
        if everything:
            drive = requests.DriveChassis(epoch=epoch, vx_mps=0.05, vy_mps=0.0, wz_radps=0.0, expiry_ns=300 * MS)
            pair.granted(drive)

    return _run(pair, SECONDS, act, every_s=0.2, sleep_s=sleep_s)


def _row(name: str, watch: _Stopwatch) -> Row:
    ordered = sorted(watch.tick_us)
    ticks = len(ordered)
    receive_us = sum(watch.receive_us) / ticks
    mean_us = statistics.fmean(ordered)
    return Row(
        name=f"engine.tick, {name}",
        ours=f"{mean_us:.0f} us, and {receive_us:.0f} us to receive",
        peer=f"{(mean_us + receive_us) / PERIOD_US:.1%} of 10 ms",
        ratio=f"p50 {ordered[ticks // 2]:.0f}, p99 {ordered[int(ticks * 0.99)]:.0f} us",
    )


def tick_rows() -> list[Row]:
    """Measure the tick in six scenes."""
    scenes: dict[str, Callable[[], _Stopwatch]] = {
        "nobody owns, nobody watches": _at_rest,
        "both arms held, watched": _held,
        "both arms moving, watched": lambda: _moving(everything=False),
        "arms, grippers and chassis, watched": lambda: _moving(everything=True),
        "the same, the model checked live": lambda: _moving(everything=True, is_modelled=True),
        "the same, after 10 ms of sleep each": lambda: _moving(everything=True, is_modelled=True, sleep_s=0.01),
    }
    return [_row(name, scene()) for name, scene in scenes.items()]
