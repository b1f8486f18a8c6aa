"""DESIGN §8 with motion by the body model on: straight motions and poses of joint-mode arms among requests and faults."""

from __future__ import annotations

import math
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from gateway.core.motion.poses.quaternion import exp, multiply
from gateway.core.robot_state.body_model import body_model
from gateway.messages.requests import Move, MovePose
from gateway.robot.limits import HOME_Q_RAD
from gateway.robot.topics import ee_pose, joint_command, shoulder_frame
from gateway.settings.settings import LinkSettings, LocalSettings, Settings
from gateway.sim.robot.settings import SimSettings
from gateway.values import Side
from tests import thoroughness
from tests.kinematics.bodies import ARMS
from tests.pair import COMPLIANCE_RADPNM, MS, Pair
from tests.test_invariants import LEAN, Trace, clients, disturbances, goals, sides, speeds, waits

pytestmark = pytest.mark.slow


class Lined(Trace):
    """Plays steps on a pair, poses for joint-mode arms among them."""

    accepted = 0
    """Motions by the model that were accepted."""

    def do_line(self, client: str, on: list[Side], parts: list[float], speed: float, straight: bool) -> None:
        """Up to 10 cm and half a radian from where the hands are held; often more than an arm can do."""
        targets = {}
        for side in on:
            sent = [frame for _, frame in self.pair.frames[-400:] if frame.topic == joint_command(side)]
            pose = ARMS[side].forward(sent[-1].values if sent else HOME_Q_RAD[side])
            a, b, c, d, e, f, _ = (2.0 * part - 1.0 for part in parts)
            turned = multiply(exp((0.3 * d, 0.3 * e, 0.3 * f)), pose.quat_xyzw)
            by = zip(pose.p_m, (0.06 * a, 0.06 * b, 0.06 * c), strict=True)
            targets[side] = (*(p + way for p, way in by), *turned)
        frames = {side: shoulder_frame(side) for side in on}
        request = MovePose(epoch=self.epoch[client], targets=targets, frames=frames, speed=speed, straight=straight)
        reply = self.pair.ask(request, client)
        self.accepted += reply.refusal is None
        self.last_motion = int(str(reply.facts.get("motion_id", self.last_motion)))

    def do_model(self, seconds: float) -> None:
        """The model begins anew, as with another link: nothing may be moved by it for a while."""
        assert self.pair.model is not None
        self.pair.model.forget()
        self.pair.run(seconds)


arms = st.lists(sides, min_size=1, max_size=2, unique=True)
lines = st.tuples(st.just("line"), clients, arms, goals, speeds, st.booleans())
happenings = st.one_of(
    lines,
    lines,
    disturbances,
    disturbances,
    st.tuples(st.just("ask"), clients, st.sampled_from(["stop", "hold", "cancel", "cancel", "disable"])),
    st.tuples(st.just("model"), st.sampled_from([0.0, 0.2])),
)
traces = st.lists(
    st.tuples(st.booleans(), lines, waits, st.lists(st.tuples(happenings, waits), min_size=1, max_size=3)),
    min_size=1,
    max_size=3,
)


def run_trace(trace: list[Any]) -> Lined:
    """Play one trace from an ACTIVE robot at home, whose model agrees, to a clean end; every tick is judged."""
    settings_ = Settings(local=LocalSettings(snapshot_hz=1.0), link=LinkSettings(model="lift"))
    sim = SimSettings(state_period_ns=10 * MS, model="lift", compliance_radpnm=COMPLIANCE_RADPNM)
    pair = Pair(settings_, sim, model=body_model(settings_))
    pair.topics = (*LEAN, *map(ee_pose, Side))
    player = Lined(pair)
    player.epoch["ann"] = pair.activate("ann")
    pair.granted(Move(epoch=player.epoch["ann"], targets_rad=HOME_Q_RAD), "ann")
    pair.run(3.0)
    player.play_all(trace)
    return player


@pytest.mark.timeout(1800)
@settings(max_examples=thoroughness.traces(4), suppress_health_check=list(HealthCheck))
@given(traces)
def test_no_trace_with_motion_by_the_model_breaks_an_invariant(trace: list[Any]) -> None:
    """Invariants 1 to 8 on every tick, whatever comes while a line is worked out or gone along."""
    player = run_trace(trace)
    assert player.monitor.checked > 0


def test_lines_are_accepted_and_gone_in_such_traces() -> None:
    """What is judged is there to be judged: one straight motion superseded while it is worked out, one stopped on its way."""
    up = [0.5, 0.5, 0.9, 0.5, 0.5, 0.5, 0.5]
    there = ("line", "ann", list(Side), up, 1.0, True)
    player = run_trace([(False, there, 0.1, [(there, 0.6), (("ask", "ann", "stop"), 0.5)])])
    assert player.accepted == 2
    moved = [math.dist(a, b) for a, b in zip(held(player, 0.0), held(player, 1.2), strict=True)]
    assert min(moved) > 0.0


def held(player: Lined, back_s: float) -> list[tuple[float, ...]]:
    """Setpoints of both arms so long before the end of a trace [rad]."""
    until_ns = player.pair.now_ns - round(back_s * 1e9)
    rows = []
    for side in Side:
        sent = [f.values for at_ns, f in player.pair.frames if f.topic == joint_command(side) and at_ns <= until_ns]
        rows.append(sent[-1])
    return rows
