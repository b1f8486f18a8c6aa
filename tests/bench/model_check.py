"""The live model check: what a sample of joints, a comparison and a verdict cost, and both arms' together, hot caches."""

from __future__ import annotations

import time
from collections.abc import Callable

from gateway.kinematics.arm import ArmModel
from gateway.kinematics.description import nominal
from gateway.kinematics.identification.agreement import ModelJudge
from gateway.robot.limits import HOME_Q_RAD
from gateway.values import Side
from tests.bench.table import Row

__all__ = ["model_check_rows"]

PERIOD_NS = 50_000_000
"""Poses are compared this far apart in the daemon [ns]."""
PAIRS = 60
"""So many are in a window of 3 s."""
A_SECOND = {"joints": 200, "comparison": 40, "verdict": 5}
"""How often both arms together need each: joints at 100 Hz, poses at 20 Hz, verdicts every 0.4 s."""
ROUNDS = 20
PER_ROUND = 100


def model_check_rows() -> list[Row]:
    """Measure one arm's, and add both arms' up to a second."""
    side = Side.LEFT
    arm, q_rad = ArmModel(nominal(), side), HOME_Q_RAD[side]
    judge, pose = ModelJudge(side, arm.chain), arm.forward(q_rad)
    now_ns = 0

    def joints() -> None:
        nonlocal now_ns
        now_ns += PERIOD_NS
        judge.joints(q_rad, now_ns)

    def compare() -> None:
        joints()
        judge.pose(pose, now_ns)

    found_us = {"joints": _best_us(joints)}
    found_us["comparison"] = _best_us(compare) - found_us["joints"]
    judge.forget()
    for _ in range(PAIRS):
        compare()
    found_us["verdict"] = _best_us(lambda: judge.verdict(now_ns))
    share = sum(found_us[name] * often for name, often in A_SECOND.items()) / 1e6
    names = {"joints": "a sample of joints", "comparison": "a comparison", "verdict": f"a verdict on {PAIRS}"}
    rows = [Row(name=f"model check, {names[name]}, one arm", ours=f"{us:.1f} us") for name, us in found_us.items()]
    return [*rows, Row(name="model check, both arms, a second of it", ours=f"{share:.2%} of a core")]


def _best_us(call: Callable[[], object]) -> float:
    return min(_round_us(call) for _ in range(ROUNDS))


def _round_us(call: Callable[[], object]) -> float:
    begun = time.perf_counter_ns()
    for _ in range(PER_ROUND):
        call()
    return (time.perf_counter_ns() - begun) / PER_ROUND / 1e3
