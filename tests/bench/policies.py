"""Policies and datasets: how smoothly action chunks are joined, in virtual time, and how long a dataset takes to build."""

from __future__ import annotations

import math
import time
from pathlib import Path

import numpy as np
import numpy.typing as npt

from gateway.api.translate import to_request
from gateway.dataset.building import Choices, build
from gateway.dataset.layout import vendor_layout
from gateway.errors import Refusal
from gateway.messages import requests
from gateway.policy.chunks import Chunk
from gateway.robot.topics import joint_command
from gateway.values import Side
from tests.bench.table import Row
from tests.dataset.motion import moving
from tests.pair import Pair

__all__ = ["dataset_rows", "join_rows"]

HZ, STEPS, PLAYED, LATE_S = 30.0, 30, 15, 0.117
"""A policy as the vendor's: 30 steps at 30 Hz, half of them played, 0.117 s from its looking to its answer: no whole steps."""
CHUNKS = 24
TOPIC = joint_command(Side.LEFT)
SMOOTHING_S = 0.1
JOIN_S = 0.45
"""So long after it has come a chunk is being joined [s]: most of the time until the next one."""
GOAL = 1.2
MINUTES = 1.0


def _away_rad(t_s: float) -> float:
    """Return how far a joint is from where it began, on the way that a policy has in mind [rad]."""
    return 0.12 * (1.0 - math.cos(2.2 * t_s)) + 0.03 * math.sin(3.7 * t_s) ** 2


def _played(differ_rad: float) -> tuple[npt.NDArray[np.float64], list[int]]:
    """Return a joint's setpoints, one each 10 ms [rad], and at which of them chunks came."""
    pair, random = Pair(), np.random.default_rng(5)
    epoch = pair.activate()
    held = pair.see().arms[Side.LEFT].q_ref_rad
    begun_ns, came = pair.now_ns, list[int]()
    before: Chunk | None = None
    for number in range(CHUNKS):
        looked_s = number * PLAYED / HZ - (LATE_S if number else 0.0)
        offset = float(random.uniform(-differ_rad, differ_rad)) if number else 0.0
        rows = np.tile(held, (STEPS, 1))
        rows[:, 0] += [_away_rad(max(0.0, looked_s + n / HZ)) + offset for n in range(STEPS)]
        chunk = Chunk(arms={"left": rows}, grips={}, observed_ns=round(looked_s * 1e9), period_ns=round(1e9 / HZ))
        led = chunk.joined_to(before, round(number * PLAYED / HZ * 1e9), SMOOTHING_S)
        before = led
        taken = to_request(
            requests.Follow(
                epoch=epoch,
                points={Side.LEFT: tuple(map(tuple, led.arms["left"].tolist()))},
                dt_s=1.0 / HZ,
                smoothing_s=SMOOTHING_S,
                open_end=True,
                start_in_ns=led.observed_ns - round(number * PLAYED / HZ * 1e9),
            )
        )
        assert not isinstance(taken, Refusal), taken
        came.append(len(pair.sent_on(TOPIC, begun_ns)))
        request, motion = taken
        pair.tell(request, chunk=motion)
        pair.run(PLAYED / HZ)
    return np.array([frame.values[0] for _, frame in pair.sent_on(TOPIC, begun_ns)]), came


def join_rows() -> list[Row]:
    """Measure the acceleration and jerk of setpoints where chunks are joined beside those in between."""
    rows = []
    for differ_rad in (0.0, 0.005):
        setpoints, came = _played(differ_rad)
        joining = np.zeros(len(setpoints), dtype=np.bool_)
        for first in came[1:]:
            joining[first : first + round(JOIN_S * 100)] = True
        settled = slice(came[2], None)
        for name, order, unit in (("acceleration", 2, "rad/s²"), ("jerk", 3, "rad/s³")):
            size = np.abs(np.diff(setpoints, order)) * 100.0**order
            at_joins = float(size[joining[order:]][settled].max())
            between = float(size[~joining[order:]][came[1] :].max())
            ratio = at_joins / between
            rows.append(
                Row(
                    name=f"{name} where chunks join that differ by {differ_rad * 1e3:g} mrad",
                    ours=f"{at_joins:.2f} {unit}",
                    peer=f"{between:.2f} {unit} in between",
                    ratio=f"{ratio:.2f}x",
                    goal=f"<= {GOAL:g}x",
                    good=ratio <= GOAL,
                )
            )
    return rows


def dataset_rows(folder: Path) -> list[Row]:
    """Measure how long a bag of a minute takes to become a dataset, without pictures."""
    bag = moving(folder / "minute", 60.0 * MINUTES)
    rows = []
    for version in ("v2.1", "v3.0"):
        begun = time.process_time()
        built = build([bag], folder / version, Choices(layout=vendor_layout(), version=version))
        used_s = time.process_time() - begun
        rows.append(
            Row(
                name=f"a minute's bag into a dataset, {version}",
                ours=f"{used_s:.2f} s of a core",
                peer=f"{built.rows} rows of 2 x 72",
                ratio=f"{60.0 * MINUTES / used_s:.0f} times real time",
            )
        )
    return rows
