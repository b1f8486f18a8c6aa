"""Random traces of requests, losses and faults, engine and robot in one virtual-time loop; all invariants on each tick.

300 traces with the profile of CI; TA2_HYPOTHESIS_PROFILE=long tries 20,000 by hand.
"""

from __future__ import annotations

import dataclasses
import os
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from gateway import robot
from gateway.core.events import (
    Abandon,
    Acquire,
    Cancel,
    ClientGone,
    CloseStream,
    Disable,
    Enable,
    Estop,
    ExitRequested,
    Hold,
    Move,
    OnLimit,
    OnLoss,
    OpenStream,
    Recover,
    Release,
    Stop,
    Suspended,
    Take,
)
from gateway.settings import LocalSettings, Settings
from gateway.sim.settings import SimSettings
from gateway.values import Side, Vector
from tests.invariants import Monitor
from tests.pair import MS, Pair, S

pytestmark = pytest.mark.slow

LEAN = (*map(robot.arm_state, Side), robot.FSM_STATE, robot.CURRENT_MODE)
"""State topics that matter here: fewer make a trace cheaper."""

CLIENTS = ("ann", "bob")
FAULTS: tuple[dict[str, Any], ...] = (
    {"fault": "pause"},
    {"fault": "pause", "duration_s": 0.3},
    {"fault": "fsm_error", "duration_s": 0.4},
    {"fault": "fsm_value", "value": 3, "duration_s": 0.3},
    {"fault": "fsm_value", "value": 7, "duration_s": 0.2},
    {"fault": "vr_mode", "duration_s": 1.5},
    {"fault": "arm_disabled", "side": "left", "duration_s": 1.2},
    {"fault": "control_mode", "side": "right", "mode": "pose", "duration_s": 1.2},
    {"fault": "jump", "side": "left", "joint": 2, "delta_rad": 0.6, "duration_s": 0.4},
    {"fault": "blocked", "side": "right", "duration_s": 1.0},
    {"fault": "nan", "topic": "/left_arm/joint_states", "duration_s": 0.2},
    {"fault": "short", "topic": "/right_arm/joint_states", "duration_s": 0.3},
    {"fault": "wrong_names", "topic": "/left_arm/joint_states", "duration_s": 0.1},
    {"fault": "drop", "topic": "/left_arm/joint_states", "duration_s": 0.4},
    {"fault": "drop", "topic": "/fsm_state", "duration_s": 0.8},
    {"fault": "drop", "topic": "/api/current_mode", "duration_s": 4.0},
    {"fault": "drop", "topic": "*", "duration_s": 0.5},
    {"fault": "freeze", "topic": "/right_arm/joint_states", "duration_s": 0.3},
    {"fault": "delay", "topic": "/left_arm/joint_states", "delay_s": 0.25, "duration_s": 0.6},
    {"fault": "duplicate", "topic": "/left_arm/joint_states", "copies": 3, "duration_s": 0.5},
    {"fault": "clock_step", "step_s": 3600.0, "duration_s": 0.5},
    {"fault": "clock_step", "step_s": -3600.0, "duration_s": 0.5},
)

sides = st.sampled_from(list(Side))
clients = st.sampled_from(("ann", "ann", "ann", "bob"))
unit = st.floats(0.0, 1.0, allow_nan=False)


def _goal(side: Side, parts: list[float]) -> Vector:
    bounds = zip(robot.JOINT_LOWER_RAD[side], parts, robot.JOINT_UPPER_RAD[side], strict=True)
    return tuple(low + part * (high - low) for low, part, high in bounds)


goals = st.lists(unit, min_size=7, max_size=7)
speeds = st.sampled_from([0.1, 0.5, 1.0, 1.0])
motions = st.one_of(
    st.tuples(st.just("move"), clients, st.just(list(Side)), goals, speeds),
    st.tuples(st.just("move"), clients, st.lists(sides, min_size=1, max_size=2, unique=True), goals, speeds),
    st.tuples(st.just("stream"), clients, sides, goals, st.integers(1, 8)),
)
disturbances = st.one_of(
    motions,
    st.tuples(st.just("ask"), clients, st.sampled_from(["acquire", "take", "release", "abandon", "enable", "disable"])),
    st.tuples(st.just("ask"), clients, st.sampled_from(["stop", "estop", "recover", "hold", "cancel", "close", "old"])),
    st.tuples(st.just("client"), clients, st.sampled_from(["kill", "freeze", "thaw"])),
    st.tuples(
        st.just("link"),
        st.sampled_from(["freeze", "freeze", "down", "other"]),
        st.sampled_from([0.05, 0.15, 0.3, 0.45, 1.2]),
    ),
    st.tuples(st.just("late"), st.sampled_from([15, 40, 80, 300])),
    st.tuples(st.just("fault"), st.sampled_from(FAULTS)),
    st.tuples(st.just("fault"), st.sampled_from(FAULTS)),
    st.tuples(st.just("race"), clients, goals, st.booleans()),
    st.tuples(st.just("daemon"), st.sampled_from(["restart", "suspend"])),
)
waits = st.sampled_from([0.0, 0.03, 0.11, 0.3, 0.6])
scenes = st.tuples(st.booleans(), motions, waits, st.lists(st.tuples(disturbances, waits), min_size=1, max_size=3))
"""Back to ACTIVE (faults cleared or not), something in motion, and what happens to it."""
traces = st.lists(scenes, min_size=1, max_size=4)


class Trace:
    """Plays steps on a pair."""

    def __init__(self, pair: Pair) -> None:
        self.pair = pair
        self.monitor = Monitor(pair)
        self.epoch = {name: 0 for name in CLIENTS}
        self.last_motion = 1
        self.last_stream = 1

    def play(self, step: tuple[Any, ...]) -> None:
        getattr(self, f"do_{step[0]}")(*step[1:])

    def resume(self, *, is_healed: bool) -> None:
        """Do what an owner does to get on: recover, acquire, enable, wait a while."""
        if self.pair.state == "ACTIVE" and self.pair.engine.owner_id == "ann" and "ann" in self.pair.alive:
            return
        if is_healed:
            self.pair.robot.clear()
            self.pair.run(0.2)
        for what in ("take" if self.pair.engine.owner_id == "bob" else "acquire", "recover"):
            self.do_ask("ann", what)
        self.pair.run(0.15)
        for _ in range(3):
            self.do_ask("ann", "enable")
            until_ns = self.pair.now_ns + S
            while self.pair.state != "ACTIVE" and self.pair.now_ns < until_ns:
                self.pair.step()
            if self.pair.state in {"ACTIVE", "HOLDING"}:
                return

    def do_move(self, client: str, on: list[Side], parts: list[float], speed: float) -> None:
        goals_rad = {side: _goal(side, parts) for side in on}
        reply = self.pair.ask(Move(epoch=self.epoch[client], targets_rad=goals_rad, speed=speed), client)
        self.last_motion = int(str(reply.facts.get("motion_id", self.last_motion)))

    def do_stream(self, client: str, side: Side, parts: list[float], count: int) -> None:
        reply = self.pair.ask(OpenStream(epoch=self.epoch[client], side=side, on_limit=OnLimit.CLIP), client)
        self.last_stream = int(str(reply.facts.get("stream_id", self.last_stream)))
        for n in range(count):
            turned = parts[n % 7 :] + parts[: n % 7]
            q_rad = tuple(1.2 * q for q in _goal(side, turned))
            self.pair.target(self.epoch[client], self.last_stream, q_rad, client)
            self.pair.run(0.02 + 0.1 * parts[n % 7])

    def do_ask(self, client: str, what: str) -> None:
        epoch = self.epoch[client]
        requests = {
            "acquire": Acquire(name=client, pid=1, on_loss=OnLoss.PAUSE if client == "bob" else OnLoss.HOLD),
            "take": Take(name=client, pid=1, reason="test"),
            "release": Release(epoch=epoch),
            "abandon": Abandon(epoch=epoch),
            "enable": Enable(epoch=epoch),
            "disable": Disable(epoch=epoch),
            "stop": Stop(),
            "estop": Estop(),
            "recover": Recover(),
            "hold": Hold(epoch=epoch, sides=tuple(Side)),
            "cancel": Cancel(epoch=epoch, motion_id=self.last_motion),
            "close": CloseStream(epoch=epoch, stream_id=self.last_stream),
            "old": Move(epoch=epoch - 1, targets_rad={Side.LEFT: robot.HOME_Q_RAD[Side.LEFT]}),
        }
        if what in {"acquire", "take"}:
            self.pair.alive.add(client)
        self.monitor.is_recovering = what == "recover"
        reply = self.pair.ask(requests[what], client)
        self.epoch[client] = int(str(reply.facts.get("epoch", epoch)))

    def do_race(self, client: str, parts: list[float], is_estop: bool) -> None:
        """A move and a target that arrived before a stop are looked at in the same tick as the stop."""
        pair = self.pair
        stream = pair.engine.open_stream_id
        move = Move(epoch=self.epoch[client], targets_rad={Side.LEFT: _goal(Side.LEFT, parts)})
        first = pair.tell(move, client)
        if stream is not None:
            pair.target(self.epoch[client], stream, _goal(Side.LEFT, parts), client)
        pair.now_ns += 1
        pair.tell(Estop() if is_estop else Stop(), client)
        pair.step()
        reply = next(reply for reply in pair.replies if reply.request_id == first)
        assert reply.refusal is not None, "a move from before a stop was accepted after it (5)"

    def do_client(self, client: str, what: str) -> None:
        if what == "kill":
            self.pair.alive.discard(client)
            self.pair.receive(ClientGone(client_id=client, at_ns=self.pair.now_ns))
        elif what == "freeze":
            self.pair.alive.discard(client)
        else:
            self.pair.alive.add(client)

    def do_link(self, what: str, seconds: float) -> None:
        pair = self.pair
        if what == "freeze":
            pair.freeze()
            pair.run(seconds)
            if seconds > 0.5:
                pair.down()  # the announced lease of 500 ms: what was under way is thrown away
                pair.up()
            else:
                pair.thaw()
            return
        pair.down()
        pair.run(seconds)
        pair.up("bb" if what == "other" else "aa")

    def do_late(self, milliseconds: int) -> None:
        late_ns = milliseconds * MS
        self.monitor.note_late(late_ns)
        self.pair.late_ns = late_ns
        self.pair.step(self.pair.now_ns + late_ns)

    def do_fault(self, fault: dict[str, Any]) -> None:
        self.pair.robot.inject(fault, self.pair.now_ns)

    def do_daemon(self, what: str) -> None:
        if what == "suspend":
            self.pair.receive(Suspended(slept_ns=2 * S, at_ns=self.pair.now_ns))
            return
        self.pair.restart()
        self.monitor.note_restart()


def lean_pair() -> Pair:
    """Return a pair that carries only what matters here."""
    settings_ = Settings(local=LocalSettings(snapshot_hz=1.0))
    pair = Pair(settings_, SimSettings(state_period_ns=10 * MS))
    pair.topics = LEAN
    return pair


def run_trace(trace: list[Any]) -> Trace:
    """Play one trace from an ACTIVE robot to a clean end; every tick is judged."""
    pair = lean_pair()
    player = Trace(pair)
    player.epoch["ann"] = pair.activate("ann")
    for is_healed, motion, wait_s, happenings in trace:
        player.resume(is_healed=is_healed)
        player.play(motion)
        pair.run(wait_s)
        for happening, after_s in happenings:
            player.play(happening)
            pair.run(after_s)
    pair.robot.clear()
    pair.receive(ExitRequested(at_ns=pair.now_ns))
    pair.run_until(lambda: pair.done, 5.0)
    return player


@settings(
    max_examples=int(os.environ.get("TA2_TRACES", "0")) or settings().max_examples,
    suppress_health_check=list(HealthCheck),
)
@given(traces)
def test_no_trace_breaks_an_invariant(trace: list[Any]) -> None:
    """DESIGN §8, invariants 1 to 8, on every tick of every trace."""
    player = run_trace(trace)
    assert player.monitor.checked > 0
    assert dataclasses.is_dataclass(player.pair.settings)
