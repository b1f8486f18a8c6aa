"""Random traces of requests, losses and faults, engine and robot in one virtual-time loop; all invariants on each tick.

8 traces in a usual run, 50 in CI; TA2_HYPOTHESIS_PROFILE=long tries 20,000, TA2_TRACES any number.
"""

from __future__ import annotations

import math
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from gateway.core.messages.events import ClientGone, ExitRequested, Suspended
from gateway.core.messages.sightings import ForeignData, ForeignTokens, Gateway, GatewayTokens, Means, Writer
from gateway.core.motion.poses.quaternion import exp, multiply
from gateway.messages.incoming import OnLimit, OnLoss
from gateway.messages.requests import (
    Abandon,
    Acquire,
    Cancel,
    CloseStream,
    Disable,
    DisableLift,
    DriveChassis,
    DriveLift,
    Enable,
    Estop,
    Follow,
    Hold,
    Move,
    MovePose,
    OpenStream,
    Recover,
    Release,
    Request,
    SetGripper,
    Stop,
    StopChassis,
    StopLift,
    Take,
)
from gateway.robot.limits import HOME_Q_RAD, JOINT_LOWER_RAD, JOINT_UPPER_RAD
from gateway.robot.topics import (
    CHASSIS_VELOCITY,
    CURRENT_MODE,
    FSM_ENABLE,
    FSM_STATE,
    arm_state,
    ee_pose,
    joint_command,
    pose_command,
    shoulder_frame,
)
from gateway.settings.settings import LinkSettings, LocalSettings, Settings
from gateway.sim.robot.settings import SimSettings
from gateway.values import Side, Space, Vector
from tests import thoroughness
from tests.invariants import POSE_TOPICS, Monitor
from tests.pair import COMPLIANCE_RADPNM, MS, Pair, S

pytestmark = pytest.mark.slow

LEAN = (*map(arm_state, Side), FSM_STATE, CURRENT_MODE)
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
    {"fault": "reorder", "topic": "/left_arm/joint_states", "duration_s": 0.5},
    {"fault": "tight_limit", "side": "left", "joint": 4, "margin_rad": 0.5, "duration_s": 1.0},
    {"fault": "clock_step", "step_s": 3600.0, "duration_s": 0.5},
    {"fault": "clock_step", "step_s": -3600.0, "duration_s": 0.5},
)

sides = st.sampled_from(list(Side))
clients = st.sampled_from(("ann", "ann", "ann", "bob"))
unit = st.floats(0.0, 1.0, allow_nan=False)


def _goal(side: Side, parts: list[float]) -> Vector:
    bounds = zip(JOINT_LOWER_RAD[side], parts, JOINT_UPPER_RAD[side], strict=True)
    return tuple(low + part * (high - low) for low, part, high in bounds)


goals = st.lists(unit, min_size=7, max_size=7)
speeds = st.sampled_from([0.1, 0.5, 1.0, 1.0])
motions = st.one_of(
    st.tuples(st.just("move"), clients, st.just(list(Side)), goals, speeds),
    st.tuples(st.just("move"), clients, st.lists(sides, min_size=1, max_size=2, unique=True), goals, speeds),
    st.tuples(st.just("stream"), clients, sides, goals, st.integers(1, 8)),
    st.tuples(
        st.just("chunks"), clients, st.lists(sides, min_size=1, max_size=2, unique=True), goals, st.integers(1, 5)
    ),
)
velocities = st.sampled_from([(0.3, 0.0, 0.0), (-0.2, 0.1, 0.0), (0.0, 0.0, 0.5), (0.1, -0.1, -0.4), (0.0, 0.0, 0.0)])
grounds = st.one_of(
    st.tuples(st.just("drive"), clients, velocities, st.integers(1, 12)),
    st.tuples(st.just("lift"), clients, st.sampled_from([0.3, -1.0, 0.0]), st.integers(1, 4)),
    st.tuples(st.just("grip"), clients, sides, st.sampled_from([0.0, 0.1, 0.6, 1.0])),
    st.tuples(st.just("ask"), clients, st.sampled_from(["stop chassis", "stop lift", "lift off"])),
)
disturbances = st.one_of(
    motions,
    grounds,
    grounds,
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
    st.tuples(
        st.just("other"),
        st.sampled_from(["arm data", "fsm data", "wheel data", "token", "gateway", "gateway in a stall"]),
        st.sampled_from([0.02, 0.2, 0.7]),
    ),
)
waits = st.sampled_from([0.0, 0.03, 0.11, 0.3, 0.6])
scenes = st.tuples(
    st.booleans(),
    st.one_of(motions, motions, grounds),
    waits,
    st.lists(st.tuples(disturbances, waits), min_size=1, max_size=3),
)
"""Back to ACTIVE (faults cleared or not), something in motion, and what happens to it."""
traces = st.lists(scenes, min_size=1, max_size=4)


class Trace:
    """Plays steps on a pair."""

    def __init__(self, pair: Pair, poses: tuple[Side, ...] = ()) -> None:
        self.pair = pair
        self.poses = poses
        self.monitor = Monitor(pair)
        self.epoch = {name: 0 for name in CLIENTS}
        self.last_motion = 1
        self.last_stream = 1

    def play(self, step: tuple[Any, ...]) -> None:
        getattr(self, f"do_{step[0]}")(*step[1:])

    def play_all(self, trace: list[Any]) -> None:
        """Play a trace: rounds of what an owner does and what happens meanwhile, then the clean end of the daemon."""
        for is_healed, motion, wait_s, happenings in trace:
            self.resume(is_healed=is_healed)
            self.play(motion)
            self.pair.run(wait_s)
            for happening, after_s in happenings:
                self.play(happening)
                self.pair.run(after_s)
        self.pair.robot.clear()
        self.pair.receive(ExitRequested(at_ns=self.pair.now_ns))
        self.pair.run_until(lambda: self.pair.done, 5.0)

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
        poses = [side for side in on if side in self.poses]
        for side in poses:
            del goals_rad[side]
        asked: list[Request] = []
        if goals_rad or not poses:
            asked.append(Move(epoch=self.epoch[client], targets_rad=goals_rad, speed=speed))
        if poses:
            targets, frames = (
                {side: self._place(side, parts) for side in poses},
                {s: f"{s}_shoulder_base" for s in poses},
            )
            asked.append(MovePose(epoch=self.epoch[client], targets=targets, frames=frames, speed=speed))
        for request in asked:
            reply = self.pair.ask(request, client)
            self.last_motion = int(str(reply.facts.get("motion_id", self.last_motion)))

    def do_stream(self, client: str, side: Side, parts: list[float], count: int) -> None:
        space = Space.POSE if side in self.poses else Space.JOINT
        frame = f"{side}_shoulder_base" if side in self.poses else ""
        opening = OpenStream(epoch=self.epoch[client], side=side, on_limit=OnLimit.CLIP, space=space, frame=frame)
        reply = self.pair.ask(opening, client)
        self.last_stream = int(str(reply.facts.get("stream_id", self.last_stream)))
        for n in range(count):
            turned = parts[n % 7 :] + parts[: n % 7]
            q_rad = tuple(1.2 * q for q in _goal(side, turned))
            if side in self.poses:
                q_rad = self._place(side, turned)
            self.pair.target(self.epoch[client], self.last_stream, q_rad, client)
            self.pair.run(0.02 + 0.1 * parts[n % 7])

    def _place(self, side: Side, parts: list[float]) -> Vector:
        """A pose up to 12 cm and 1 rad from the last one that was sent, now and then beyond the reach."""
        sent = [frame for _, frame in self.pair.frames[-400:] if frame.topic == pose_command(side)]
        x, y, z, *quat = sent[-1].values if sent else (0.3, 0.0, -0.3, 0.0, 0.0, 0.0, 1.0)
        a, b, c, d, e, f, _ = (2.0 * part - 1.0 for part in parts)
        turned = multiply(exp((0.6 * d, 0.6 * e, 0.6 * f)), tuple(quat))
        return (x + 0.07 * a, y + 0.07 * b, z + 0.07 * c, *turned)

    def do_chunks(self, client: str, on: list[Side], parts: list[float], count: int) -> None:
        """Swings from where the arms are held, one after the other: late, early, jittered, at speed at their ends."""
        spaces = {Space.POSE: [side for side in on if side in self.poses]}
        spaces[Space.JOINT] = [side for side in on if side not in self.poses]
        for n in range(count):
            a, b, c, d, *_ = parts[n:] + parts[:n]
            for space, those in spaces.items():
                is_pose = space is Space.POSE
                swing = self._pose_swing if is_pose else self._swing
                rows = {side: swing(side, a, b, c) for side in those}
                request = Follow(
                    epoch=self.epoch[client],
                    points=rows,
                    dt_s=0.02 + 0.05 * d,
                    smoothing_s=0.1,
                    space=space,
                    frames={side: shoulder_frame(side) for side in those if is_pose},
                    open_end=c < 0.5,
                    start_in_ns=round((0.5 * b - 0.3) * S),
                    path_tolerance={side: (0.05, 0.2) if is_pose else (0.2,) * 7 for side in those if a < 0.3},
                )
                reply = self.pair.ask(request, client)
                self.last_motion = int(str(reply.facts.get("motion_id", self.last_motion)))
            self.pair.run(0.05 + 0.4 * d)

    def _pose_swing(self, side: Side, a: float, b: float, c: float) -> list[Vector]:
        """Up to 8 cm and 0.6 rad away and back, now and then beyond the reach or too fast."""
        sent = [frame for _, frame in self.pair.frames[-400:] if frame.topic == pose_command(side)]
        x, y, z, *quat = sent[-1].values if sent else (0.3, 0.0, -0.3, 0.0, 0.0, 0.0, 1.0)
        swings = [a * (1.0 - math.cos(0.2 * b * n)) for n in range(25)]
        turns = (exp((0.3 * s * (c - 0.5), 0.1 * s, -0.2 * s * c)) for s in swings)
        away = zip(swings, turns, strict=True)
        return [(x - 0.04 * s, y + 0.04 * c * s, z + 0.02 * s, *multiply(turn, tuple(quat))) for s, turn in away]

    def _swing(self, side: Side, a: float, b: float, c: float) -> list[Vector]:
        sent = [frame for _, frame in self.pair.frames[-400:] if frame.topic == joint_command(side)]
        held = sent[-1].values if sent else HOME_Q_RAD[side]
        low, high = JOINT_LOWER_RAD[side], JOINT_UPPER_RAD[side]
        swings = [0.3 * a * (1.0 - math.cos(0.2 * b * n + 6.0 * c)) - 0.15 * a for n in range(25)]
        joints = range(7)
        return [tuple(min(max(held[k] + s * (1 - k % 3), low[k]), high[k]) for k in joints) for s in swings]

    def do_drive(self, client: str, velocity: tuple[float, float, float], count: int) -> None:
        vx, vy, wz = velocity
        for _ in range(count):
            command = DriveChassis(epoch=self.epoch[client], vx_mps=vx, vy_mps=vy, wz_radps=wz)
            if self.pair.ask(command, client).refusal is not None:
                return
            self.pair.run(0.1)

    def do_lift(self, client: str, velocity: float, count: int) -> None:
        for _ in range(count):
            if self.pair.ask(DriveLift(epoch=self.epoch[client], velocity=velocity), client).refusal is not None:
                return
            self.pair.run(0.1)

    def do_grip(self, client: str, side: Side, raw: float) -> None:
        self.pair.ask(SetGripper(epoch=self.epoch[client], side=side, raw=raw), client)

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
            "stop chassis": StopChassis(epoch=epoch),
            "stop lift": StopLift(epoch=epoch),
            "lift off": DisableLift(epoch=epoch),
            "old": Move(epoch=epoch - 1, targets_rad={Side.LEFT: HOME_Q_RAD[Side.LEFT]}),
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

    def do_other(self, what: str, seconds: float) -> None:
        """Somebody else commands the robot for a while, or announces it."""
        pair, monitor = self.pair, self.monitor
        if what == "token":
            for writers in ((Writer(topic=FSM_ENABLE, zid="b", means=Means.TOKEN),), ()):
                pair.receive(ForeignTokens(writers=writers, at_ns=pair.now_ns))
                pair.run(seconds)
        elif what.startswith("gateway"):
            if what.endswith("stall"):
                pair.is_deaf = True
                pair.run(0.15)
            for is_armed in (True, False):
                monitor.is_beside_gateway = monitor.ground.is_beside_gateway = is_armed
                pair.receive(GatewayTokens(gateways=(Gateway(zid="b", is_armed=is_armed),), at_ns=pair.now_ns))
                pair.run(0.5 * seconds)
                pair.is_deaf = False
                pair.run(0.5 * seconds)
        else:
            topics = {"arm": joint_command(Side.RIGHT), "fsm": FSM_ENABLE, "wheel": CHASSIS_VELOCITY}
            topic = topics[what.split()[0]]
            for _ in range(round(seconds / 0.02)):
                if topic != CHASSIS_VELOCITY:
                    monitor.note_foreign()
                pair.receive(ForeignData(topic=topic, zid="c", at_ns=pair.now_ns))
                pair.run(0.02)

    def do_late(self, milliseconds: int) -> None:
        late_ns = milliseconds * MS
        self.monitor.note_late(late_ns)
        self.pair.late_ns = late_ns
        self.pair.step(self.pair.now_ns + late_ns)

    def do_fault(self, fault: dict[str, Any]) -> None:
        self.monitor.may_clip = self.monitor.may_clip or fault["fault"] == "tight_limit"
        self.pair.robot.inject(fault, self.pair.now_ns)

    def do_daemon(self, what: str) -> None:
        if what == "suspend":
            self.pair.receive(Suspended(slept_ns=2 * S, at_ns=self.pair.now_ns))
            return
        self.pair.restart()
        self.monitor.note_restart()


def lean_pair(poses: tuple[Side, ...] = ()) -> Pair:
    """Return a pair that carries only what matters here."""
    settings_ = Settings(local=LocalSettings(snapshot_hz=1.0), link=LinkSettings(model="lift"))
    modes = {f"{side}_mode": "pose" for side in poses}
    pair = Pair(
        settings_, SimSettings(state_period_ns=10 * MS, model="lift", **modes, compliance_radpnm=COMPLIANCE_RADPNM)
    )
    pair.topics = (*LEAN, *map(ee_pose, poses))
    return pair


def run_trace(trace: list[Any], poses: tuple[Side, ...] = ()) -> Trace:
    """Play one trace from an ACTIVE robot to a clean end; every tick is judged."""
    pair = lean_pair(poses)
    player = Trace(pair, poses)
    player.epoch["ann"] = pair.activate("ann")
    player.play_all(trace)
    return player


@pytest.mark.timeout(1800)
@settings(
    max_examples=thoroughness.traces(8),
    suppress_health_check=list(HealthCheck),
)
@given(traces)
def test_no_trace_breaks_an_invariant(trace: list[Any]) -> None:
    """DESIGN §8, invariants 1 to 8, on every tick of every trace."""
    player = run_trace(trace)
    assert player.monitor.checked > 0


def test_the_monitor_sees_grippers_chassis_and_lift() -> None:
    """A trace that drives and grips: what it judges has been there to be judged."""
    then = [(("grip", "ann", Side.LEFT, 0.6), 0.3), (("lift", "ann", 0.3, 3), 0.1), (("ask", "ann", "stop"), 0.5)]
    player = run_trace([(False, ("drive", "ann", (0.3, 0.0, 0.0), 8), 0.0, then)])
    ground = player.monitor.ground
    assert ground.driven > 20 and ground.gripped == 1 and not player.pair.engine.running_topics


@pytest.mark.timeout(1800)
@settings(
    max_examples=thoroughness.traces(3),
    suppress_health_check=list(HealthCheck),
)
@given(traces, st.sampled_from([(Side.RIGHT,), tuple(Side)]))
def test_no_trace_of_end_effectors_breaks_an_invariant(trace: list[Any], poses: tuple[Side, ...]) -> None:
    """The same with one arm, or both, in end-effector mode: poses within linear and angular limits, started at the arm."""
    player = run_trace(trace, poses)
    assert any(frame.topic in POSE_TOPICS for _, frame in player.pair.frames)
