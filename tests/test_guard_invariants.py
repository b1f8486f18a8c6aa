"""Random traces with a daemon that dies or freezes at any tick: the invariants hold across the succession.

The monitor judges every frame of daemon, guard and next daemon as one sequence: no step over the limits, no arm gap of
100 ms, no motion without a command; and in the end the robot is in PAUSE.
"""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from gateway.core.guardian import Phase
from gateway.robot.topics import FSM_ENABLE, ee_pose
from gateway.settings.settings import LocalSettings, Settings
from gateway.sim.robot.settings import SimSettings
from gateway.values import FsmState, Side
from tests.guarded import Guarded
from tests.pair import COMPLIANCE_RADPNM, MS, S
from tests.test_invariants import LEAN, Trace, motions, traces
from tests.thoroughness import either

pytestmark = pytest.mark.slow


def guarded(poses: tuple[Side, ...] = ()) -> tuple[Guarded, Trace]:
    """A guarded pair that carries only what matters here, ACTIVE, and who plays with it; some arms in end-effector mode."""
    modes = {f"{side}_mode": "pose" for side in poses}
    pair = Guarded(
        Settings(local=LocalSettings(snapshot_hz=1.0)),
        SimSettings(state_period_ns=10 * MS, **modes, compliance_radpnm=COMPLIANCE_RADPNM),
    )
    pair.topics = (*LEAN, *map(ee_pose, poses))
    player = Trace(pair, poses)
    pair.on_succession = lambda: player.monitor.latches.clear()
    player.epoch["ann"] = pair.activate("ann")
    return pair, player


def to_the_end(pair: Guarded) -> None:
    """The guard holds or ends what was out, and goes; the robot is left in PAUSE."""
    died_ns = pair.now_ns
    pair.run_until(lambda: pair.guardian.phase is Phase.DONE, 16.0)
    kinds = {frame.kind.value for at_ns, frame in pair.frames if at_ns > died_ns}
    assert kinds <= {"brake", "hold", "beat", "stop"}, "a guard moved something"
    if pair.robot.api_mode and pair.is_up and any(pair.sent_on(FSM_ENABLE)):
        assert pair.robot.fsm.published not in (FsmState.SLOW_START, FsmState.READY)


@settings(max_examples=either(10, 50), suppress_health_check=list(HealthCheck))
@given(motions, st.floats(0.0, 2.0), st.booleans(), st.floats(0.0, 45.0), st.sampled_from([(), tuple(Side)]))
def test_a_daemon_that_ends_in_any_tick_of_a_motion_is_succeeded(
    motion: tuple[Any, ...], after_s: float, is_frozen: bool, seen_after_ms: float, poses: tuple[Side, ...]
) -> None:
    """Both ways to end, at any instant, in both control modes; seen within 45 ms, or by missing ticks."""
    pair, player = guarded(poses)
    player.play(motion)
    pair.run(after_s)
    if is_frozen:
        pair.freeze_daemon()
    else:
        pair.die(seen_after_ms)
    to_the_end(pair)


@settings(max_examples=either(10, 25), suppress_health_check=list(HealthCheck))
@given(traces, st.booleans(), st.floats(0.0, 1.5))
def test_a_daemon_that_ends_in_any_trace_is_succeeded(trace: list[Any], is_restarted: bool, then_s: float) -> None:
    """After any history; restarted at once or never."""
    pair, player = guarded()
    for is_healed, motion, wait_s, happenings in trace:
        player.resume(is_healed=is_healed)
        player.play(motion)
        pair.run(wait_s)
        for happening, after_s in happenings:
            player.play(happening)
            pair.run(after_s)
    if is_restarted:
        latches = set(pair.engine.latches)
        pair.restart()
        player.monitor.note_restart()
        assert latches <= set(pair.engine.latches), "a restart cleared a latch (7)"
        pair.run(then_s)
    pair.die()
    pair.robot.clear()
    to_the_end(pair)
    assert pair.now_ns > S
