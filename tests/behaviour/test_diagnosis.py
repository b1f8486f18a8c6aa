"""Why the robot does not do what it is told: eight scripted faults, each recognised in time, and silence when all is well."""

from __future__ import annotations

import math
import random
from collections.abc import Callable
from dataclasses import dataclass

import pytest

from gateway.codes import Code
from gateway.core.messages.events import RobotsAnnounced, RouteObserved
from gateway.errors import CODES
from gateway.messages.requests import Cancel, Disable, Enable, Hold, Move, MovePose, Release, Stop
from gateway.messages.snapshot import Finding
from gateway.robot.limits import JOINT_LOWER_RAD, JOINT_UPPER_RAD
from gateway.robot.topics import (
    CHASSIS_STATE,
    CURRENT_MODE,
    FSM_ENABLE,
    FSM_STATE,
    STATE_TOPICS,
    arm_state,
    ee_pose,
    gripper_state,
    joint_command,
    pose_command,
    shoulder_frame,
)
from gateway.settings.settings import ArmSettings
from gateway.sim.robot.settings import SimSettings
from gateway.values import Side
from tests.behaviour.scene import HOME, Scene, scene
from tests.pair import MS, START_NS, S
from tests.thoroughness import either

LEFT = arm_state(Side.LEFT)


def whole(state: str, right_mode: str = "joint") -> Scene:
    """Return a scene in which every topic is heard, with snapshots at 50 Hz."""
    pair = Scene(SimSettings(state_period_ns=10 * MS, right_mode=right_mode), snapshot_hz=50, is_modelled=True)
    pair.topics = STATE_TOPICS
    return scene(state, pair)


def found(pair: Scene) -> list[str]:
    """Return the codes of the findings now."""
    return [finding.code for finding in pair.see().findings]


def finding(pair: Scene, code: Code) -> Finding:
    """Return the first finding of a code."""
    return next(finding for finding in pair.see().findings if finding.code == code.value)


def distance(pair: Scene, side: Side) -> float:
    """How far an arm is from its last setpoint [rad]."""
    measured = pair.heard[arm_state(side)].value.q_rad
    return max(abs(a - b) for a, b in zip(pair.arm_frames_now()[side], measured, strict=True))


# --------------------------------------------------------------------------------------------- eight scripted faults


@dataclass(frozen=True)
class Script:
    """A fault and what it shows first.

    Attributes:
        state: Where it begins.
        begin: What goes wrong, and what is asked for then.
        symptom: Whether the first thing can be seen that could not be in nominal use.
        code: What it must be recognised as.
        besides: Codes that are true of it as well.
        right_mode: Control mode of the right arm.
    """

    state: str
    begin: Callable[[Scene], object]
    symptom: Callable[[Scene], bool]
    code: Code
    besides: frozenset[Code] = frozenset()
    right_mode: str = "joint"


def _inject(**fault: object) -> Callable[[Scene], object]:
    return lambda pair: pair.robot.inject(fault, pair.now_ns)


def _then(begin: Callable[[Scene], object], request: Callable[[Scene], object]) -> Callable[[Scene], object]:
    return lambda pair: (begin(pair), pair.granted(request(pair), "ann"))


def _off_by(side: Side, rad: float) -> Callable[[Scene], bool]:
    return lambda pair: distance(pair, side) > rad


def _unanswered(pair: Scene) -> bool:
    return bool(pair.beats) and pair.now_ns - pair.beats_at_ns[0] > 150 * MS


def _quiet(topic: str, seconds: float) -> Callable[[Scene], bool]:
    return lambda pair: pair.now_ns - pair.heard[topic].received_ns > seconds * S


def _tick_late(ms: int) -> Callable[[Scene], object]:
    def late(pair: Scene) -> None:
        pair.late_ns = ms * MS
        pair.step(pair.now_ns + (ms + 10) * MS)

    return late


def _now(pair: Scene) -> bool:
    return pair.now_ns > pair.mark_ns


def to_home(speed: float) -> Callable[[Scene], Move]:
    """A motion of both arms to the initial position."""
    return lambda pair: Move(epoch=pair.epoch, targets_rad=HOME, speed=speed)


def _moved_pose(by_m: float, turn_rad: float, speed: float) -> Callable[[Scene], MovePose]:
    """A motion of the right end effector, sideways and about the frame's z axis."""

    def request(pair: Scene) -> MovePose:
        x, y, z, qx, qy, qz, qw = pair.sent_on(pose_command(Side.RIGHT))[-1][1].values
        s, c = math.sin(0.5 * turn_rad), math.cos(0.5 * turn_rad)
        goal = (x, y + by_m, z + by_m, c * qx - s * qy, c * qy + s * qx, c * qz + s * qw, c * qw - s * qz)
        frames = {Side.RIGHT: shoulder_frame(Side.RIGHT)}
        return MovePose(epoch=pair.epoch, targets={Side.RIGHT: goal}, frames=frames, speed=speed)

    return request


def _pose_off_by(pair: Scene) -> bool:
    """Whether the right end effector is 2 cm or 0.08 rad from its setpoint."""
    setpoint = pair.sent_on(pose_command(Side.RIGHT))[-1][1].values
    measured = pair.heard[ee_pose(Side.RIGHT)].value
    cosine = abs(sum(a * b for a, b in zip(setpoint[3:], measured.quat_xyzw, strict=True)))
    return math.dist(setpoint[:3], measured.p_m) > 0.02 or 2.0 * math.acos(min(1.0, cosine)) > 0.08


SCRIPTS = {
    "the robot's IK finds nothing": Script(
        "at rest",
        _then(_inject(fault="no_ik", side="right"), _moved_pose(0.05, 0.3, 0.5)),
        _pose_off_by,
        Code.IK_REFUSED,
        right_mode="pose",
    ),
    "the robot's IK finds nothing for a turn": Script(
        "at rest",
        _then(_inject(fault="no_ik", side="right"), _moved_pose(0.0, 0.5, 0.5)),
        _pose_off_by,
        Code.IK_REFUSED,
        right_mode="pose",
    ),
    "arm blocked in mid-move": Script(
        "ACTIVE", _inject(fault="blocked", side="left"), _off_by(Side.LEFT, 0.08), Code.TRACKING_STALL
    ),
    "arm blocked, then a slow move": Script(
        "at rest",
        _then(_inject(fault="blocked", side="right"), to_home(0.1)),
        _off_by(Side.RIGHT, 0.03),
        Code.TRACKING_STALL,
    ),
    "setpoints lost on their way": Script(
        "at rest",
        _then(_inject(fault="drop", topic=joint_command(Side.LEFT)), to_home(0.5)),
        _off_by(Side.LEFT, 0.05),
        Code.TRACKING_STALL,
    ),
    "heartbeat lost on its way": Script(
        "IDLE",
        _then(_inject(fault="drop", topic=FSM_ENABLE), lambda p: Enable(epoch=p.epoch)),
        _unanswered,
        Code.HEARTBEAT_NOT_EFFECTIVE,
    ),
    "somebody keeps the robot paused": Script(
        "IDLE",
        _then(_inject(fault="pause", duration_s=9.0), lambda p: Enable(epoch=p.epoch)),
        _unanswered,
        Code.HEARTBEAT_NOT_EFFECTIVE,
    ),
    "one arm's state silent": Script(
        "ACTIVE", _inject(fault="drop", topic=LEFT), _quiet(LEFT, 0.02), Code.ROUTE_SUSPECT
    ),
    "a pose silent": Script(
        "ACTIVE",
        _inject(fault="drop", topic=ee_pose(Side.RIGHT)),
        _quiet(ee_pose(Side.RIGHT), 0.02),
        Code.ROUTE_SUSPECT,
    ),
    "fsm_state silent": Script(
        "HOLDING",
        _inject(fault="drop", topic=FSM_STATE),
        _quiet(FSM_STATE, 0.06),
        Code.ROUTE_SUSPECT,
    ),
    "current_mode silent": Script(
        "HOLDING",
        _inject(fault="drop", topic=CURRENT_MODE),
        _quiet(CURRENT_MODE, 1.25),
        Code.ROUTE_SUSPECT,
    ),
    "a joint clipped short of its goal": Script(
        "at rest",
        _then(_inject(fault="tight_limit", side="left", joint=7, margin_rad=0.4), to_home(0.5)),
        _off_by(Side.LEFT, 0.06),
        Code.CLIPPED_BY_ROBOT,
    ),
    "another joint clipped, slowly": Script(
        "at rest",
        _then(_inject(fault="tight_limit", side="right", joint=6, margin_rad=1.1), to_home(0.25)),
        _off_by(Side.RIGHT, 0.04),
        Code.CLIPPED_BY_ROBOT,
    ),
    "a joint whose zero is off": Script(
        "HOLDING",
        _inject(fault="joint_zero", side="right", joint=4, delta_rad=0.06),
        lambda p: p.now_ns > p.mark_ns + 1500 * MS,  # half of the window
        Code.MODEL_DIFFERS,
    ),
    "VR mode": Script(
        "HOLDING",
        _inject(fault="vr_mode"),
        lambda p: not p.heard[CURRENT_MODE].value.api,
        Code.MODE_VR,
    ),
    "VR mode in mid-move": Script(
        "ACTIVE",
        lambda p: (p.robot.inject({"fault": "vr_mode"}, p.now_ns), p.tell_mode(api=False)),
        _now,
        Code.MODE_VR,
    ),
    "arm disabled in mid-move": Script(
        "ACTIVE", lambda p: p.disable_arm(Side.LEFT), _now, Code.ARM_DISABLED, frozenset({Code.TRACKING_STALL})
    ),
    "this host too busy": Script("ACTIVE", _tick_late(70), _now, Code.STREAM_LATE),
    "NaN": Script("ACTIVE", _inject(fault="nan", topic=LEFT), _quiet(LEFT, 0.02), Code.SAMPLE_REFUSED),
    "a joint missing": Script("HOLDING", _inject(fault="short", topic=LEFT), _quiet(LEFT, 0.02), Code.SAMPLE_REFUSED),
    "an old sample again and again": Script(
        "HOLDING", _inject(fault="freeze", topic=LEFT), lambda p: p.now_ns > p.mark_ns + 30 * MS, Code.SAMPLE_REFUSED
    ),
}


@pytest.mark.parametrize("name", SCRIPTS)
def test_a_fault_is_recognised_within_1_s_of_its_first_symptom(name: str) -> None:
    """The right code, with words, remedy and the time it began; nothing that is not true is said on the way."""
    script = SCRIPTS[name]
    pair = whole(script.state, script.right_mode)
    script.begin(pair)
    pair.run_until(lambda: script.symptom(pair), 4.0)
    symptom_ns = pair.now_ns
    said: set[str] = set()
    pair.run_until(lambda: said.update(found(pair)) or script.code.value in said, 1.0)
    seen = finding(pair, script.code)
    assert seen.hint == CODES[script.code].hint and seen.message
    assert symptom_ns - 2500 * MS <= seen.since_ns <= symptom_ns + 600 * MS
    for _ in range(20):
        pair.run(0.05)
        said.update(found(pair))
    assert said <= {script.code.value, *(code.value for code in script.besides)}, said


def test_the_numbers_of_a_finding_are_facts() -> None:
    """Joint, setpoint and measured value can be read by a program, and stand in the words."""
    pair = whole("at rest")
    pair.robot.inject({"fault": "tight_limit", "side": "left", "joint": 7, "margin_rad": 0.4}, pair.now_ns)
    pair.granted(Move(epoch=pair.epoch, targets_rad=HOME, speed=0.5), "ann")
    pair.run(2.5)
    seen = finding(pair, Code.CLIPPED_BY_ROBOT)
    facts = seen.facts
    assert facts["joint"] == 7 and facts["measured_rad"] == pytest.approx(0.3, abs=0.01)
    assert facts["off_rad"] == pytest.approx(facts["setpoint_rad"] - facts["measured_rad"])
    assert "left arm joint 7 (l_joint7) stays at 0.30" in seen.message


def test_the_first_thing_that_fails_is_told_as_a_notice_once() -> None:
    """`events()` and the log hear of it when it begins, not again while it lasts, with what it is about."""
    pair = whole("ACTIVE")
    pair.robot.inject({"fault": "blocked", "side": "left"}, pair.now_ns)
    pair.run(4.0)
    (notice,) = [notice for notice in pair.notices if notice.code is Code.TRACKING_STALL]
    assert notice.facts == {"subject": "left_arm"} and "l_joint" in notice.message


@pytest.mark.parametrize(
    "name",
    [
        "arm blocked in mid-move",
        "the robot's IK finds nothing",
        "one arm's state silent",
        "NaN",
        "a joint clipped short of its goal",
        "VR mode",
    ],
)
def test_a_finding_ends_with_its_symptom(name: str) -> None:
    """When the fault is gone, and the owner has brought the robot back, nothing is said any more."""
    script = SCRIPTS[name]
    pair = whole(script.state, script.right_mode)
    script.begin(pair)
    pair.run_until(lambda: script.code.value in found(pair), 2.5)
    pair.robot.clear()
    pair.run(4.0)
    assert found(pair) == []


def test_why_an_enabling_failed_is_told_until_something_else_happens() -> None:
    """10 s later the heartbeat is silent; the owner who asks then still hears why, until the next attempt or PAUSE ends."""
    pair = whole("IDLE")
    pair.robot.inject({"fault": "drop", "topic": FSM_ENABLE}, pair.now_ns)
    pair.granted(Enable(epoch=pair.epoch), "ann")
    pair.run_until(lambda: pair.state == "IDLE", 12.0)
    pair.run(5.0)
    seen = finding(pair, Code.HEARTBEAT_NOT_EFFECTIVE)
    assert seen.facts["beats_s"] > 9.0
    pair.robot.clear()
    pair.run_until(lambda: not pair.engine.running_topics, 3.0)
    pair.granted(Enable(epoch=pair.epoch), "ann")
    pair.run(0.3)
    assert found(pair) == []


def test_a_route_that_discovery_says_is_bad_is_suspected() -> None:
    """The bridge says that nobody on the robot takes our heartbeat: said before anybody enables; not for a moment's doubt."""
    pair = whole("IDLE")

    def told(words: str) -> None:
        pair.receive(RouteObserved(topic=FSM_ENABLE, code=None, message=words, at_ns=pair.now_ns))

    told("not announced: nobody on the robot listens to it")
    pair.run(0.3)
    assert found(pair) == []
    told("ready")
    pair.run(1.0)
    assert found(pair) == []
    told("inactive: the robot's bridge does not write it; restart the robot's bridge")
    pair.run(0.8)
    assert "inactive" in finding(pair, Code.ROUTE_SUSPECT).message


def test_a_silence_of_everything_is_one_finding() -> None:
    """Eleven topics that fall silent together are one dead way, not eleven."""
    for state in ("ACTIVE", "IDLE"):
        pair = whole(state)
        pair.is_deaf = True
        pair.run(0.6)
        (seen,) = [f for f in pair.see().findings if f.code == "ROUTE_SUSPECT" and "none of" in f.message]
        assert seen.facts["silent_s"] > 0.3


def test_a_robot_under_another_namespace_is_offered_and_several_are_listed() -> None:
    """`enable` is refused with the setting to write, or with the list; `why` says the same; nothing is taken by itself."""
    for namespaces, words in ((("bot1",), 'namespace = "bot1"'), (("bot1", "bot2"), "choose one")):
        pair = whole("IDLE")
        pair.is_deaf = True
        pair.run(4.0)
        pair.receive(RobotsAnnounced(elsewhere=namespaces, at_ns=pair.now_ns))
        pair.run(0.5)
        refusal = pair.see().refusals["enable"]
        assert refusal.code == "OTHER_NAMESPACE" and words in refusal.hint
        assert all(name in refusal.message for name in namespaces)
        assert found(pair) == ["OTHER_NAMESPACE"]
        frames = len(pair.frames)
        pair.is_deaf = False
        pair.receive(RobotsAnnounced(elsewhere=(), at_ns=pair.now_ns))
        pair.run(1.0)
        assert found(pair) == [] and len(pair.frames) == frames


def test_beside_a_second_robot_under_our_namespace_nothing_begins() -> None:
    """Both would obey: `enable` and driving are refused with both bridges named, until one is gone; what runs goes on."""
    pair = whole("IDLE")
    pair.receive(RobotsAnnounced(elsewhere=(), twins=("a1", "b2"), at_ns=pair.now_ns))
    pair.run(0.5)
    for kind in ("enable", "chassis"):
        refusal = pair.see().refusals[kind]
        assert refusal.code == "TWO_ROBOTS" and "a1, b2" in refusal.message and "stop one of them" in refusal.hint
    assert found(pair) == ["TWO_ROBOTS"]
    pair.receive(RobotsAnnounced(elsewhere=(), at_ns=pair.now_ns))
    pair.run(0.5)
    assert not {"enable", "chassis"} & pair.see().refusals.keys() and found(pair) == []
    pair = whole("ACTIVE")
    pair.receive(RobotsAnnounced(elsewhere=(), twins=("a1", "b2"), at_ns=pair.now_ns))
    pair.run(0.5)
    assert pair.state == "ACTIVE" and "TWO_ROBOTS" in found(pair)


def test_a_part_that_is_switched_off_may_be_silent() -> None:
    """A disabled arm sends nothing and is no dead route; that it is disabled is said."""
    pair = Scene(SimSettings(state_period_ns=10 * MS, enable_left_arm=False, enable_chassis=False), snapshot_hz=50)
    pair.topics = tuple(t for t in STATE_TOPICS if not t.startswith("/left_") and t != CHASSIS_STATE)
    scene("IDLE", pair)
    pair.run(4.0)
    assert found(pair) == ["ARM_DISABLED"]


def test_a_topic_that_never_came_is_told_after_the_links_first_seconds() -> None:
    """A fresh link gets 3 s; the gripper's state is missed then."""
    pair = Scene(snapshot_hz=50)
    pair.topics = tuple(t for t in STATE_TOPICS if t != gripper_state(Side.LEFT))
    pair.run_until(lambda: pair.now_ns > START_NS + 2900 * MS)
    assert found(pair) == []
    pair.run(0.3)
    assert gripper_state(Side.LEFT) in finding(pair, Code.ROUTE_SUSPECT).message


def test_without_a_link_nothing_is_inferred() -> None:
    """OFFLINE says it already; what was found on the old link is over."""
    pair = whole("ACTIVE")
    pair.robot.inject({"fault": "blocked", "side": "left"}, pair.now_ns)
    pair.run(0.9)
    assert found(pair) == ["TRACKING_STALL"]
    pair.down()
    pair.run(5.0)
    assert found(pair) == []


# ------------------------------------------------------------------------------------------------- nominal operation


def test_an_end_effector_that_follows_is_no_refusal() -> None:
    """Straight, turning, through both hemispheres of the quaternion, slowly and fast, and held."""
    pair = whole("at rest", "pose")
    for by_m, turn_rad, speed in ((0.03, 0.2, 1.0), (-0.03, -0.4, 0.3), (0.0, 0.6, 1.0), (0.02, -0.4, 0.1)):
        pair.granted(_moved_pose(by_m, turn_rad, speed)(pair), "ann")
        for _ in range(20):
            pair.run(0.15)
            assert found(pair) == []


class Day(Scene):
    """A working day in which nothing is wrong, stepped as sparsely as the streams allow."""

    def __init__(self) -> None:
        super().__init__(
            SimSettings(state_period_ns=50 * MS, model="lift"),
            model="lift",
            arm=ArmSettings(rate_hz=50.0),
            is_modelled=True,
        )
        self.topics = STATE_TOPICS
        self.random = random.Random(7)
        self.said: set[tuple[str, str]] = set()
        self.on_step = self._listen

    def _listen(self, output: object) -> None:
        for seen in self.snapshot.findings if self.snapshot else ():
            self.said.add((seen.code, seen.message))

    def step(self, to_ns: int | None = None) -> object:
        """Steps of 20 ms: the grids of all streams here are multiples of 10 ms."""
        return super().step((self.now_ns // (20 * MS) + 1) * 20 * MS if to_ns is None else to_ns)

    def spend(self, seconds: float) -> None:
        """Enable, do all kinds of things, disable, rest; again and again."""
        until_ns = self.now_ns + round(seconds * S)
        self.run_until(lambda: self.state == "READY" or (self.state == "READ_ONLY" and self.knows_mode))
        while self.now_ns < until_ns:
            self.epoch = self.own("ann")
            self.granted(Enable(epoch=self.epoch), "ann")
            self.run_until(lambda: self.state == "ACTIVE")
            for _ in range(self.random.randint(3, 6)):
                self.random.choice([self._move, self._move, self._stream, self._hold, self._stop, self._wait])()
            self.granted(self.random.choice([Disable, Release])(epoch=self.epoch), "ann")
            self.run_until(lambda: self.state in ("IDLE", "READ_ONLY"))
            self.run(self.random.choice([1.0, 5.0, 30.0]))

    def _goal(self) -> dict[Side, tuple[float, ...]]:
        sides = self.random.choice([list(Side), [Side.LEFT], [Side.RIGHT]])
        return {
            side: tuple(q + self.random.uniform(-0.2, 0.2) * (n != 6) for n, q in enumerate(HOME[side]))
            for side in sides
        }

    def _move(self) -> None:
        speed = self.random.choice([0.02, 0.1, 0.5, 1.0, 1.0])
        motion_id = self.move(self.epoch, self._goal(), "ann", speed)
        self.run(self.random.choice([0.3, 2.0, 6.0, 12.0]))
        if self.random.random() < 0.3:
            self.ask(Cancel(epoch=self.epoch, motion_id=motion_id), "ann")
            self.run(0.5)

    def _stream(self) -> None:
        side = self.random.choice(list(Side))
        stream_id = self.stream(self.epoch, side, "ann")
        rate_hz = self.random.choice([1, 5, 10, 50])
        start = self.arm_frames_now()[side]
        for n in range(rate_hz * self.random.randint(2, 6)):
            by_rad = self.random.choice([0.2, 0.02]) * ((-1) ** (n // max(1, rate_hz // 2)))
            inner = [
                min(max(q, low + 0.3), high - 0.3)
                for q, low, high in zip(start, JOINT_LOWER_RAD[side], JOINT_UPPER_RAD[side], strict=True)
            ]
            self.target(self.epoch, stream_id, tuple(q + by_rad for q in inner), "ann")
            self.run(1 / rate_hz)
        self.run(2.0)

    def _hold(self) -> None:
        self.granted(Hold(epoch=self.epoch, sides=tuple(Side)), "ann")
        self.run(self.random.choice([1.0, 20.0]))

    def _stop(self) -> None:
        self.move(self.epoch, self._goal(), "ann")
        self.run(0.2)
        self.granted(Stop(), "ann")
        self.run(self.random.choice([1.0, 10.0]))

    def _wait(self) -> None:
        self.run(self.random.choice([1.0, 10.0, 30.0]))


@pytest.mark.slow
@pytest.mark.timeout(1800)
def test_nothing_is_said_in_nominal_use() -> None:
    """Moves, streams, holds, stops, enable and disable for an hour of virtual time (2 min outside releases): no finding."""
    seconds = either(120, 3600)
    day = Day()
    day.spend(seconds)
    assert day.said == set() and day.now_ns - START_NS >= seconds * S
