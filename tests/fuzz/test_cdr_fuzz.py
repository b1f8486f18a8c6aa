"""Hostile samples on the robot's state topics against an engine that drives a robot: refused in words, or harmless.

They take the daemon's own way (mailbox, codec, engine) into a pair of engine and simulated robot in virtual time, among
the robot's good samples, while the monitor of the invariants judges every frame that leaves. A nurse keeps the robot
enabled. What decodes is believed: a robot that says PAUSE or VR is one; so the lies that stop everything come in spells.
"""

from __future__ import annotations

import gc
import json
import math
import random
from collections import Counter
from typing import Any

import pytest

from cdr_types import CdrError, encode
from cdr_types.messages import builtin_interfaces, geometry_msgs, sensor_msgs, std_msgs
from gateway.api import protocol
from gateway.core.engine import Output
from gateway.core.messages.events import SampleArrived, SampleRefused
from gateway.core.messages.outputs import FrameKind
from gateway.errors import Code
from gateway.link.codec import MAX_MODE_CHARACTERS, BadSample, decode_sample, stamp_of
from gateway.link.mailbox import Mailbox
from gateway.messages.requests import Move
from gateway.robot.limits import HOME_Q_RAD
from gateway.robot.topics import CURRENT_MODE, FSM_STATE, JOINT_NAMES, JOINT_STATE, STATE_TOPICS, TOPICS, arm_state
from gateway.settings.settings import LocalSettings, Settings
from gateway.values import ArmState, EePose, FsmState, MotorState, Side
from tests.cdr_types.oracle import ros_encode
from tests.fuzz.hostile import FLOATS, ODD, TEXTS, WORDS, mutated, scratched
from tests.fuzz.nurse import Nurse
from tests.invariants import Monitor
from tests.pair import Pair, S
from tests.thoroughness import either

pytestmark = pytest.mark.slow

PAYLOADS = either(4_000, 25_000)
SEEDS = either((1,), (1, 2, 3, 4))
"""A hundred thousand payloads before a release."""
PER_TICK = 20
BLOCK = 1_000
"""Payloads from one wild spell to the next."""
WILD = 100
"""Of a block, so many may tell any lie; then the nurse comes."""

ARMS = tuple(map(arm_state, Side))
MOTORS = tuple(topic for topic in STATE_TOPICS if TOPICS[topic].type_name == JOINT_STATE)
QUIET = tuple(topic for topic in STATE_TOPICS if topic not in (FSM_STATE, CURRENT_MODE))
"""Topics of which a lie does not stop everything at once."""

MODE = {
    "meta_mode": 1, "left_arm_control_mode": 1, "right_arm_control_mode": 1, "enable_left_arm": 1, "enable_right_arm": 1,
    "enable_chassis": 1, "enable_lift_servo": 0, "enable_collision_check": 1,
}  # fmt: skip


class Liar:
    """Makes samples that a robot, a broken bridge or somebody else might publish."""

    def __init__(self, rng: random.Random, pair: Pair) -> None:
        self.rng = rng
        self.pair = pair
        self.kinds: Counter[str] = Counter()

    def sample(self, *, is_wild: bool) -> tuple[str, bytes]:
        """Return a topic and a payload for it."""
        rng = self.rng
        topic = rng.choice(STATE_TOPICS if is_wild else QUIET)
        kind = rng.choice(("twisted", "twisted", "scratched", "scratched", "foreign", "shapeless", "big-endian", "cut"))
        if not is_wild and kind == "scratched" and topic in ARMS:
            kind = "twisted"  # a flipped name latches JOINT_ORDER: for the wild spells
        if not is_wild and kind == "foreign" and topic in ARMS:
            kind = "shapeless"  # so do the names of the other arm
        if not is_wild and rng.random() < 0.05:
            topic, kind = rng.choice((FSM_STATE, CURRENT_MODE)), "cut"
        self.kinds[kind] += 1
        if kind == "foreign":
            return topic, self.good(rng.choice([other for other in STATE_TOPICS if other != topic]))
        if kind == "shapeless":
            return topic, self.shapeless()
        if kind == "big-endian":
            message = self.message(topic)
            return topic, scratched(rng, ros_encode(message, little_endian=False)) if is_wild else ros_encode(
                message, little_endian=False
            )
        if kind == "cut":
            good = self.good(topic)
            return topic, good[: rng.randrange(len(good))]
        if kind == "scratched":
            return topic, scratched(rng, self.good(topic), WORDS)
        return topic, self.twisted(topic, is_wild=is_wild)

    def good(self, topic: str) -> bytes:
        return encode(self.message(topic))

    def shapeless(self) -> bytes:
        rng = self.rng
        header = rng.choice((b"\x00\x01\x00\x00", b"\x00\x00\x00\x00", b"\x00\x03\x00\x00", b"\x01\x00\x00\x00", b""))
        return header + rng.choice(
            (
                rng.randbytes(rng.randrange(400)),
                bytes(rng.choice((1, 4, 100_000))),
                rng.choice(WORDS) * rng.randrange(100),
                b"\xff" * rng.choice((4, 324, 100_000)),
            )
        )

    # ------------------------------------------------------------------------------------------------ messages

    def message(self, topic: str) -> Any:
        """Return what the robot would say on a topic now: its latest words, with the stamp of this instant."""
        heard = self.pair.heard[topic].value
        if isinstance(heard, MotorState):
            return self.joints(topic, heard.q_rad, heard.dq_radps, heard.tau_nm)
        if isinstance(heard, EePose):
            return geometry_msgs.Pose(
                position=geometry_msgs.Point(*heard.p_m), orientation=geometry_msgs.Quaternion(*heard.quat_xyzw)
            )
        return std_msgs.Int32(data=heard) if isinstance(heard, int) else std_msgs.String(data=json.dumps(MODE))

    def joints(self, topic: str, q_rad: Any, dq_radps: Any, tau_nm: Any) -> sensor_msgs.JointState:
        heard = self.pair.heard[topic]
        sec, nanosec = divmod((heard.stamp_ns or 0) + self.pair.now_ns - heard.received_ns, S)
        return sensor_msgs.JointState(
            header=std_msgs.Header(stamp=builtin_interfaces.Time(sec=sec, nanosec=nanosec), frame_id=""),
            name=list(JOINT_NAMES[topic]), position=list(q_rad), velocity=list(dq_radps), effort=list(tau_nm),
        )  # fmt: skip

    def twisted(self, topic: str, *, is_wild: bool) -> bytes:
        """Return a payload that decodes, or nearly; what it says is hostile."""
        rng, message = self.rng, self.message(topic)
        if isinstance(message, sensor_msgs.JointState):
            self._twist_joints(message, is_mild=topic in ARMS and not is_wild)
        elif isinstance(message, geometry_msgs.Pose):
            part = rng.choice((message.position, message.orientation))
            setattr(part, rng.choice("xyz"), rng.choice((*FLOATS, rng.uniform(-2, 2))))
        elif isinstance(message, std_msgs.Int32):
            message.data = rng.choice((-1, 0, 1, 2, 3, 4, 5, 6, 7, 2**31 - 1, -(2**31)))
        else:
            message.data = self._mode_text()
        try:
            return encode(message)
        except CdrError:  # lone surrogates and the like cannot be said in CDR
            return scratched(rng, self.good(topic))

    def _twist_joints(self, message: sensor_msgs.JointState, *, is_mild: bool) -> None:
        """Change numbers, counts, stamp or names; a mild lie leaves stamp and names of an arm mostly as they are."""
        rng = self.rng
        array = rng.choice((message.position, message.position, message.velocity, message.effort))
        place, move = rng.randrange(len(array)), rng.random() * (0.76 if is_mild else 1.0)
        if move < 0.4:
            array[place] = rng.choice(FLOATS)
        elif move < 0.6:
            array[place] += rng.choice((1e-4, 0.05, -0.2, 1.0, -3.0))
        elif move < 0.75:
            array[:] = rng.choice(([], array[:-1], array * 2, array * 300))
        elif move < 0.85:
            stamp = message.header.stamp
            stamp.sec = rng.choice((0, -1, 2**31 - 1, -(2**31), stamp.sec, stamp.sec + 1, stamp.sec - 1))
            stamp.nanosec = rng.choice((0, 10**9 - 1, 10**9, 2**32 - 1, stamp.nanosec))
        else:
            message.name = rng.choice(
                ([], message.name[::-1], message.name[:-1], message.name * 2, ["x" * 5_000] * len(message.name),
                 [*message.name[:-1], rng.choice(("", "l_joint1", "人"))])
            )  # fmt: skip

    def _mode_text(self) -> str:
        rng = self.rng
        name, move = rng.choice(list(MODE)), rng.randrange(9)
        if move == 0:
            return json.dumps(
                {**MODE, name: rng.choice((0, 2, -1, 1.0, "1", None, math.nan, 10**30, [1], True, False))}
            )
        if move == 1:
            return json.dumps({key: value for key, value in MODE.items() if key != name})
        if move == 2:
            odd = mutated(rng, MODE)
            return json.dumps(odd, default=str)
        if move == 3:
            return rng.choice(("", "null", "[]", "1", '"x"', "{", "NaN", "\ufeff{}", "1" * 5_000, *TEXTS))
        if move == 4:
            return rng.choice(("[", '{"meta_mode":')) * rng.choice((900, 5_000))
        if move == 5:
            return json.dumps(MODE)[:-1] + f', "{name}": {rng.choice((0, 1, 7, "[]"))}}}'  # a key twice
        if move == 6:
            return json.dumps(MODE) + " " * rng.choice((1, MAX_MODE_CHARACTERS, 70_000))
        if move == 7:
            return json.dumps({**MODE, "z": [ODD[2]] * 3_000})
        return json.dumps(MODE)[: rng.randrange(200)]


class Wire:
    """The robot plane in front of a pair, without zenoh: mailbox, codec, engine."""

    def __init__(self, pair: Pair) -> None:
        self.pair = pair
        self.monitor = Monitor(pair)
        self.mailboxes = {topic: Mailbox(is_stamped=topic in MOTORS) for topic in STATE_TOPICS}
        self.outcomes: Counter[str] = Counter()
        self.frames: Counter[FrameKind] = Counter()
        pair.on_step = self.see

    def deliver(self, topic: str, payload: bytes) -> None:
        """Hand a payload to the engine as the link does, but every one of them, not only the newest of a tick."""
        now_ns = self.pair.now_ns
        self.mailboxes[topic].put(payload, now_ns)
        try:
            value = decode_sample(topic, payload)
        except BadSample as bad:
            assert bad.code in (Code.SAMPLE_REFUSED, Code.JOINT_ORDER) and bad.message, bad
            self.outcomes[bad.code] += 1
            event: SampleArrived | SampleRefused = SampleRefused(
                topic=topic, code=bad.code, message=bad.message, received_ns=now_ns
            )
        else:
            self.outcomes["decoded"] += 1
            _assert_sound(value)
            event = SampleArrived(topic=topic, value=value, received_ns=now_ns, stamp_ns=stamp_of(value))
            if topic == FSM_STATE:
                self.monitor.told_pause = value == FsmState.PAUSE
        # Not by `pair.receive`: what the monitor takes for the truth is what the robot itself has said.
        self.pair.engine.receive(event, now_ns)

    def take(self) -> None:
        """Empty the mailboxes: their counts add up whatever was in them."""
        for mailbox in self.mailboxes.values():
            arrival = mailbox.take()
            assert arrival is None or (arrival.samples >= 1 and arrival.worst_gap_ns >= 0)
            assert mailbox.take() is None

    def see(self, output: Output) -> None:
        self.monitor.see(output)
        self.frames.update(frame.kind for frame in output.frames)
        if output.snapshot is not None:
            assert protocol.decode_snapshot(protocol.encode(output.snapshot)).seq == output.snapshot.seq


def _assert_sound(value: object) -> None:
    """What is decoded keeps the promises of its type."""
    if isinstance(value, MotorState):
        assert all(map(math.isfinite, (*value.q_rad, *value.dq_radps, *value.tau_nm)))
        assert not isinstance(value, ArmState) or len(value.q_rad) == 7
    elif isinstance(value, EePose):
        assert all(map(math.isfinite, value.p_m)) and math.isclose(math.hypot(*value.quat_xyzw), 1.0)


@pytest.mark.parametrize("seed", SEEDS)
def test_hostile_samples_are_refused_or_harmless(seed: int) -> None:
    """No exception escapes, every invariant holds on every tick, and afterwards the robot is enabled and moved."""
    rng = random.Random(seed)
    pair = Pair(Settings(local=LocalSettings(snapshot_hz=10.0)))
    wire, nurse, liar = Wire(pair), Nurse(pair), Liar(rng, pair)
    pair.run_until(lambda: pair.state == "READ_ONLY" and pair.heard.keys() == set(STATE_TOPICS))
    active = objects = 0
    for number in range(PAYLOADS):
        is_wild = number % BLOCK < WILD
        if number % PER_TICK == 0:
            wire.take()
            pair.step()
            if not is_wild and not nurse.is_well:
                nurse.revive()
            active += nurse.is_well
            if number % 400 == 200 and nurse.is_well:
                goal = {side: tuple(x + 0.1 * rng.random() for x in HOME_Q_RAD[side]) for side in Side}
                nurse.ask(Move(epoch=nurse.epoch, targets_rad=goal))
            pair.frames.clear()
            pair.notices.clear()
            pair.replies.clear()
        if number == PAYLOADS // 5:
            objects = _objects()
            gc.disable()
        topic, payload = liar.sample(is_wild=is_wild)
        wire.deliver(topic, payload)
        pair.now_ns += 400_000
    assert gc.collect() < 300, "what was sent left cycles behind, and the daemon collects none"
    assert _objects() < objects + 3_000, "what was sent is kept somewhere"

    nurse.revive()
    nurse.move_home()
    print(
        f"\n{PAYLOADS} payloads {dict(liar.kinds)}, outcomes {dict(wire.outcomes)}, {nurse.revivals} revivals, "
        f"frames {dict(wire.frames)}, active {active}"
    )
    assert active > 0.3 * PAYLOADS / PER_TICK, f"the robot was ACTIVE in {active} of {PAYLOADS // PER_TICK} ticks only"
    assert min(wire.outcomes[kind] for kind in ("decoded", Code.SAMPLE_REFUSED, Code.JOINT_ORDER)) > 30, wire.outcomes
    assert wire.frames[FrameKind.MOTION] > PAYLOADS / 100, wire.frames


def _objects() -> int:
    """Return how many objects there are, after a collection of cycles."""
    gc.collect()
    return len(gc.get_objects())
