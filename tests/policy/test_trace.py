"""Tests of traces: what a policy told beside what was measured and commanded, and by how much they differ."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from gateway.policy.chunks import Chunk
from gateway.policy.trace import Trace

MS = 1_000_000
T0 = 10_000 * MS


def state(q, age=0.005, commanded=()):
    """A state whose arms are where `q` says, by side."""
    arms = {side: SimpleNamespace(q=np.full(7, q[side]), q_ref=np.array(commanded), age=age) for side in q}
    return SimpleNamespace(arm=arms.__getitem__)


def chunk(observed_ns=T0, sides=("left",), slope=0.1):
    """A chunk whose joints rise by so much with each step of 100 ms."""
    joints = np.outer(slope * np.arange(11), np.ones(7))
    return Chunk(arms=dict.fromkeys(sides, joints), grips={}, observed_ns=observed_ns, period_ns=100 * MS)


def test_what_was_told_is_compared_at_the_time_of_the_measurement():
    """Between steps too; an arm that the policy does not know, and one without commands, are not compared."""
    trace, told = Trace(), chunk()
    for at_ms in (50, 250, 450):
        trace.look(told, state({"left": at_ms / 1000 + 0.02, "right": 9.0}), T0 + (at_ms + 5) * MS)
    assert trace.differences() == {"left": {"measured": {"rms_rad": 0.02, "worst_rad": 0.02, "rows": 3}}}
    assert list(trace.boundaries_ns) == [T0 + 55 * MS]
    at_ns, joints = trace.table()
    assert list(at_ns) == [T0 + at_ms * MS for at_ms in (50, 250, 450)] and joints.shape == (3, 2, 3, 7)
    assert np.isnan(joints[:, 1, 0]).all() and np.isnan(joints[:, :, 2]).all()


def test_commands_of_whoever_drives_are_compared_too():
    """RMS over rows and joints, and the worst of them."""
    trace, told = Trace(), chunk(slope=0.0, sides=("left", "right"))
    for number, away in enumerate((0.3, -0.4)):
        trace.look(told, state({"left": 0.0, "right": 0.0}, commanded=[away] * 7), T0 + (100 * number + 50) * MS)
    for side in ("left", "right"):
        found = trace.differences()[side]
        assert found["measured"]["rms_rad"] == 0.0 and found["commanded"]["worst_rad"] == 0.4
        assert found["commanded"]["rms_rad"] == pytest.approx(np.sqrt(0.125), abs=1e-5)


def test_rows_without_a_chunk_or_a_measurement_are_no_difference():
    """Old states and those that were seen already are no rows; another chunk is a boundary."""
    trace = Trace()
    assert trace.differences() == {} and trace.table()[1].shape == (0, 2, 3, 7)
    here = {"left": 0.0, "right": 0.0}
    trace.look(None, state(here), T0)
    trace.look(None, state(here, age=0.0054), T0 + MS // 2)
    trace.look(chunk(), state(here, age=0.2), T0 + 300 * MS)
    trace.look(chunk(), state(here, age=float("inf")), T0 + 400 * MS)
    assert trace.differences() == {} and len(trace.table()[0]) == 1 and len(trace.boundaries_ns) == 2
