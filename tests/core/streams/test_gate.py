"""The gate: every bound from below to above, every kind in every state, with and without owner, fresh and stale."""

from __future__ import annotations

import math
from itertools import product

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gateway.core.messages.outputs import Frame, FrameKind
from gateway.core.streams.gate import Gate, GateContext
from gateway.errors import Code, Refusal
from gateway.robot.limits import HOME_Q_RAD, JOINT_LOWER_RAD, JOINT_UPPER_RAD
from gateway.robot.topics import (
    CHASSIS_VELOCITY,
    FSM_ENABLE,
    LIFT_COMMAND,
    TOPICS,
    VARIANTS,
    gripper_command,
    joint_command,
    pose_command,
)
from gateway.settings.settings import ArmSettings, ChassisSettings, PoseSettings
from gateway.values import Side

STATES = ("OFFLINE", "READ_ONLY", "IDLE", "ENABLING", "ACTIVE", "HOLDING", "PAUSED", "STALE", "STOPPING")
SETTINGS = ArmSettings()
LIFT = VARIANTS["lift"]
EPOCH = 5
PERIOD_S = 0.01
JOINTS = {side: joint_command(side) for side in Side}
POSES = {side: pose_command(side) for side in Side}
GRIPPERS = {side: gripper_command(side) for side in Side}
ARMS = (*JOINTS.values(), *POSES.values())
HOME = {
    **{JOINTS[side]: HOME_Q_RAD[side] for side in Side},
    **{POSES[side]: (0.3, 0.0, -0.2, 0.0, 0.0, 0.0, 1.0) for side in Side},
    **{GRIPPERS[side]: (0.1,) for side in Side},
    CHASSIS_VELOCITY: (0.01, 0.0, -0.01),
    LIFT_COMMAND: (0.3, 1.0),
    FSM_ENABLE: (1.0,),
}
"""A proper value of every command topic."""
MOTION, ECHO, BRAKE, HOLD, WALK, BEAT, STOP = FrameKind


def frame(topic: str, values=None, kind: FrameKind = MOTION, epoch: int = EPOCH) -> Frame:
    """A frame that is right unless told otherwise."""
    return Frame(topic=topic, values=HOME[topic] if values is None else values, kind=kind, epoch=epoch, due_ns=0)


def context(state: str = "ACTIVE", epoch: int = EPOCH, fresh: bool = True, **flags: bool) -> GateContext:
    """A tick in which everything is in order unless told otherwise."""
    return GateContext(state=state, epoch=epoch, fresh=fresh, **flags)


def running(*topics: str, arm: ArmSettings = SETTINGS) -> Gate:
    """A gate through which the starts of these streams have passed."""
    gate = Gate(arm, LIFT)
    for topic in topics:
        assert passes(gate, frame(topic, kind=ECHO), context("ENABLING"))
    return gate


def passes(gate: Gate, candidate: Frame, facts: GateContext | None = None) -> bool:
    """Whether the gate lets it through; a refusal is always the same code and names topic, kind and state."""
    facts = facts or context()
    answer = gate.clear(candidate, facts)
    if isinstance(answer, Refusal):
        assert answer.code is Code.GATE_VIOLATION and answer.field == candidate.topic
        assert answer.message.startswith(f"{candidate.kind.value} frame for {candidate.topic} in {facts.state}: ")
        return False
    assert answer is candidate
    return True


def why(gate: Gate, candidate: Frame, facts: GateContext | None = None) -> str:
    """The message of the refusal."""
    answer = gate.clear(candidate, facts or context())
    assert isinstance(answer, Refusal)
    return answer.message


def around(low: float, high: float, slack: float) -> list[tuple[float, bool]]:
    """Values from below to above a range, and whether they are inside."""
    inside = [low, low + slack, (low + high) / 2, high - slack, high]
    outside = [low - 1.0, low - 2 * slack, high + 2 * slack, high + 1.0, math.inf, -math.inf, math.nan]
    return [(value, True) for value in inside] + [(value, False) for value in outside]


# -------------------------------------------------------------------------------------------------- form and range


@pytest.mark.parametrize("variant", VARIANTS.values(), ids=lambda variant: variant.name)
def test_only_command_topics_of_the_model_pass(variant):
    """A key outside the profile is never published (DESIGN §8.2): no state topic, no lift where there is none."""
    for topic in (*TOPICS, "/rosout", "/api/nothing"):
        gate = Gate(SETTINGS, variant)
        kind = BEAT if topic == FSM_ENABLE else ECHO if topic in (*ARMS, *GRIPPERS.values()) else MOTION
        candidate = frame(topic, values=HOME.get(topic, (0.0,)), kind=kind)
        state = "ENABLING" if kind is ECHO else "ACTIVE"
        assert passes(gate, candidate, context(state)) is (topic in variant.command_topics)
        stop = TOPICS[topic].stop_frame if topic in TOPICS else ()
        if stop:
            assert passes(gate, frame(topic, stop, STOP)) is (topic in variant.command_topics)


@pytest.mark.parametrize("topic", HOME)
def test_only_the_exact_width_and_finite_values_pass(topic):
    """One value too few, one too many, or one NaN or infinity anywhere: refused, as stop frame, too."""
    good = HOME[topic]
    bad = [good[:-1], (*good, 0.0), ()]
    bad += [(*good[:n], value, *good[n + 1 :]) for n in range(len(good)) for value in (math.nan, math.inf, -math.inf)]
    for values, kind in product(bad, FrameKind):
        gate = Gate(SETTINGS, LIFT)
        assert not passes(
            gate, frame(topic, values=values, kind=kind), context("ENABLING" if kind is ECHO else "ACTIVE")
        )


def replaced(values: tuple[float, ...], n: int, value: float) -> tuple[float, ...]:
    """The same vector with one element changed."""
    return (*values[:n], value, *values[n + 1 :])


@pytest.mark.parametrize("side", Side)
@pytest.mark.parametrize("joint", range(7))
@pytest.mark.parametrize("tighter_rad", [0.0, 0.04])
def test_every_joint_is_held_inside_its_configured_limits(side, joint, tighter_rad):
    """Swept from below to above, for the manual's limits (§4.13) and for tighter ones."""
    lower = tuple(low + tighter_rad for low in JOINT_LOWER_RAD[side])
    upper = tuple(high - tighter_rad for high in JOINT_UPPER_RAD[side])
    arm = ArmSettings(lower_rad=JOINT_LOWER_RAD | {side: lower}, upper_rad=JOINT_UPPER_RAD | {side: upper})
    middle = tuple((low + high) / 2 for low, high in zip(lower, upper, strict=True))
    for value, inside in around(lower[joint], upper[joint], 1e-9):
        start = frame(JOINTS[side], replaced(middle, joint, value), ECHO)
        assert passes(Gate(arm, LIFT), start, context("ENABLING")) is inside, value
    too_far = frame(JOINTS[side], replaced(middle, joint, 3.0), ECHO)
    assert f"joint {joint + 1} at 3.0 rad is outside" in why(Gate(arm, LIFT), too_far, context("ENABLING"))


@pytest.mark.parametrize(
    ("topic", "n", "low", "high", "other"),
    [
        *((topic, 0, 0.0, 1.0, (0.0,)) for topic in GRIPPERS.values()),
        (LIFT_COMMAND, 0, -1.0, 1.0, (0.0, 1.0)),
    ],
)
def test_grippers_and_lift_are_held_inside_their_hard_bounds(topic, n, low, high, other):
    """Force 0..1 (§4.4), normalised lift speed (§4.6)."""
    for value, inside in around(low, high, 1e-12):
        gate = running(topic) if topic in GRIPPERS.values() else Gate(SETTINGS, LIFT)
        assert passes(gate, frame(topic, replaced(other, n, value))) is inside, value


@pytest.mark.parametrize("value", [0.0, 1.0, -0.0, 0.5, 0.999999, 2.0, -1.0])
def test_switches_are_exactly_zero_or_one(value):
    """The lift's enable and the FSM heartbeat: anything between is somebody's accident."""
    assert passes(Gate(SETTINGS, LIFT), frame(LIFT_COMMAND, (0.0, value))) is (value in (0.0, 1.0))
    assert passes(Gate(SETTINGS, LIFT), frame(LIFT_COMMAND, (0.3, value))) is (value == 1.0), "servo off, and moving"
    assert passes(Gate(SETTINGS, LIFT), frame(FSM_ENABLE, (value,), BEAT)) is (value == 1.0)
    assert passes(Gate(SETTINGS, LIFT), frame(FSM_ENABLE, (value,), STOP)) is (value == 0.0)


def test_poses_are_within_reach_and_have_unit_quaternions():
    """§4.0.4: 0.55 m from the shoulder; an unnormalised quaternion means another turn to every reader."""
    for reach_m, inside in [(0.0, True), (0.55, True), (0.5501, False), (2.0, False)]:
        start = frame(POSES[Side.LEFT], (0.0, 0.0, -reach_m, 0.0, 0.0, 0.0, 1.0), ECHO)
        assert passes(Gate(SETTINGS, LIFT), start, context("ENABLING")) is inside
    for norm, unit in [(1.0, True), (1.0 + 5e-7, True), (1.0 + 2e-6, False), (1.0 - 2e-6, False), (0.0, False)]:
        start = frame(POSES[Side.LEFT], (0.1, 0.0, 0.0, 0.0, 0.6 * norm, 0.0, 0.8 * norm), ECHO)
        assert passes(Gate(SETTINGS, LIFT), start, context("ENABLING")) is unit


# ------------------------------------------------------------------------------------------------------ permission


def permitted(topic: str, kind: FrameKind, facts: GateContext) -> bool:
    """BEHAVIOUR and DESIGN §8.3 in words of their own, to compare with."""
    if kind is STOP:
        return topic in (CHASSIS_VELOCITY, LIFT_COMMAND, FSM_ENABLE)
    if topic == FSM_ENABLE:
        beating = facts.state in ("ENABLING", "ACTIVE", "HOLDING", "STOPPING")
        return kind is BEAT and facts.fresh and (beating or (facts.state == "STALE" and facts.resuming))
    if kind is MOTION:
        on_wheels = topic in (CHASSIS_VELOCITY, LIFT_COMMAND)
        states = ("IDLE", "ENABLING", "ACTIVE", "HOLDING") if on_wheels else ("ACTIVE",)
        return facts.state in states and facts.fresh and facts.epoch == EPOCH and not facts.latched
    if kind is BEAT or topic in (CHASSIS_VELOCITY, LIFT_COMMAND):
        return False
    if kind is HOLD and facts.state == "STALE":
        return facts.stale_hold or (facts.fresh and facts.resuming)
    if kind in (BRAKE, WALK) and topic in GRIPPERS.values():
        return False
    states = {
        ECHO: ("ENABLING", "ACTIVE", "HOLDING", "STOPPING", *(() if topic in GRIPPERS.values() else ("PAUSED",))),
        HOLD: ("ENABLING", "ACTIVE", "HOLDING", "PAUSED", "STOPPING"),
        BRAKE: ("ACTIVE", "HOLDING", "PAUSED", "STOPPING"),
        WALK: ("ACTIVE", "HOLDING", "PAUSED", "STOPPING"),
    }
    return facts.fresh and facts.state in states[kind]


@pytest.mark.parametrize("kind", FrameKind)
@pytest.mark.parametrize("topic", HOME)
def test_every_kind_of_frame_passes_where_the_rules_say_and_nowhere_else(topic, kind):
    """All topics, kinds, states, epochs, fresh or stale, held, resuming, latched: 36,288 combinations, no surprise."""
    stop = TOPICS[topic].stop_frame
    candidate = frame(topic, stop if kind is STOP and stop else None, kind)
    for state, epoch, fresh, held, resuming, latched in product(
        STATES, (0, EPOCH - 1, EPOCH, EPOCH + 1), *[(True, False)] * 4
    ):
        facts = context(state, epoch, fresh, stale_hold=held, resuming=resuming, latched=latched)
        gate = running(topic) if topic in (*ARMS, *GRIPPERS.values()) else Gate(SETTINGS, LIFT)
        assert passes(gate, candidate, facts) is permitted(topic, kind, facts), facts


def test_motion_needs_an_epoch_even_when_nobody_owns_the_robot():
    """Epoch 0 is no epoch: a frame without one does not match a robot without owner."""
    assert not passes(running(JOINTS[Side.LEFT]), frame(JOINTS[Side.LEFT], epoch=0), context(epoch=0))


@pytest.mark.parametrize(
    ("topic", "stops"),
    [
        (CHASSIS_VELOCITY, [(0.0, 0.0, 0.0)]),
        (LIFT_COMMAND, [(0.0, 1.0), (0.0, 0.0)]),
        (FSM_ENABLE, [(0.0,)]),
    ],
)
@pytest.mark.parametrize("state", STATES)
def test_stop_frames_pass_always_and_nothing_else_passes_as_one(topic, stops, state):
    """At once, stale or not, in any state (BEHAVIOUR, stopping): and only the very frame that stops."""
    for fresh, latched in product((True, False), (True, False)):
        for values in stops:
            gate = Gate(SETTINGS, LIFT)
            assert passes(gate, frame(topic, values, STOP, 0), context(state, 0, fresh, latched=latched))
        for n in range(len(stops[0])):
            moving = replaced(stops[0], n, 0.01 if topic == CHASSIS_VELOCITY or n == 0 else 0.5)
            assert not passes(Gate(SETTINGS, LIFT), frame(topic, moving, STOP, 0), context(state, 0, fresh))


# ----------------------------------------------------------------------------------------------------- continuity


@pytest.mark.parametrize("topic", [*ARMS, *GRIPPERS.values()])
@pytest.mark.parametrize("kind", [MOTION, BRAKE, HOLD, WALK])
def test_a_stream_starts_with_an_echo(topic, kind):
    """And so does one that was silent in between: the robot may be anywhere else by then."""
    gate = Gate(SETTINGS, LIFT)
    assert not passes(gate, frame(topic, kind=kind))
    assert passes(gate, frame(topic, kind=ECHO), context("ENABLING"))
    assert passes(gate, frame(topic, kind=HOLD))
    gate.forget(topic)
    assert not passes(gate, frame(topic, kind=kind))
    assert passes(gate, frame(topic, kind=ECHO), context("HOLDING"))


def test_a_start_may_be_anywhere_and_forgetting_a_silent_stream_is_nothing():
    """Between two starts the steps are bounded, across a start they are not (DESIGN §8.1)."""
    topic = JOINTS[Side.LEFT]
    gate = running(topic)
    elsewhere = frame(topic, (0.0, 1.0, 0.0, 1.0, 0.0, 0.0, 0.0), ECHO)
    assert not passes(gate, elsewhere, context("ENABLING"))
    gate.forget(topic)
    gate.forget(topic)
    assert passes(gate, elsewhere, context("ENABLING"))


@pytest.mark.parametrize("topic", [*ARMS, *GRIPPERS.values()])
@pytest.mark.parametrize("kind", [HOLD, ECHO])
def test_holds_and_echoes_repeat_exactly(topic, kind):
    """The least step of a float is too much: constant means constant (late or in a burst they change nothing)."""
    gate = running(topic)
    moved = replaced(HOME[topic], 0, math.nextafter(HOME[topic][0], 9.0))
    assert not passes(gate, frame(topic, moved, kind), context("HOLDING"))
    assert passes(gate, frame(topic, kind=kind), context("HOLDING"))


@pytest.mark.parametrize("arm", [SETTINGS, ArmSettings(v_radps=0.2, a_radps2=15.0, rate_hz=50.0)])
@pytest.mark.parametrize("kind", [MOTION, BRAKE, WALK])
@pytest.mark.parametrize("joint", range(7))
def test_a_joint_never_moves_faster_than_configured(arm, kind, joint):
    """Speed limit times period per frame and joint, both ways, whatever the wall time between frames."""
    topic = JOINTS[Side.RIGHT]
    step = arm.v_radps / arm.rate_hz
    ramp = arm.a_radps2 / arm.rate_hz**2
    for sign, (factor, inside) in product((1, -1), [(1.0, True), (1.0 + 2e-6 / step, False)]):
        gate, q = running(topic, arm=arm), HOME[topic]
        target, moved, speed = sign * step * factor, 0.0, 0.0
        for _ in range(100):
            speed = sign * min(abs(speed) + ramp, abs(target))
            moved += speed
            good = passes(gate, frame(topic, replaced(q, joint, q[joint] + moved), kind))
            assert good or speed == target
            if speed == target:
                break
        assert good is inside


@pytest.mark.parametrize("kind", [MOTION, BRAKE, WALK])
@pytest.mark.parametrize("joint", range(7))
def test_a_joint_never_changes_its_speed_faster_than_configured(kind, joint):
    """Acceleration limit times period squared per frame: speeding up from a start at rest, and slowing down again."""
    topic, ramp = JOINTS[Side.LEFT], 3.0 * PERIOD_S**2
    q = HOME[topic]
    for sign, (change, inside) in product((1, -1), [(ramp, True), (ramp + 2e-6, False)]):
        gate = running(topic)
        assert passes(gate, frame(topic, replaced(q, joint, q[joint] + sign * change), kind)) is inside
        gate = running(topic)
        moved = 0.0
        for n in (1, 2, 3):
            moved += sign * n * ramp
            assert passes(gate, frame(topic, replaced(q, joint, q[joint] + moved), kind))
        moved += sign * (3 * ramp - change)
        assert passes(gate, frame(topic, replaced(q, joint, q[joint] + moved), kind)) is inside


def test_a_moving_stream_cannot_hold_without_braking():
    """Repeating a setpoint in mid-motion is a step of the speed."""
    topic, q, moved = JOINTS[Side.LEFT], HOME[JOINTS[Side.LEFT]], 0.0
    gate = running(topic)
    for n in range(1, 5):
        moved += n * 3.0 * PERIOD_S**2
        assert passes(gate, frame(topic, replaced(q, 0, q[0] + moved)))
    assert "changes its step" in why(gate, frame(topic, replaced(q, 0, q[0] + moved), HOLD))


def test_a_refused_frame_leaves_no_trace():
    """What did not leave is no forerunner of what comes next."""
    topic, q = JOINTS[Side.LEFT], HOME[JOINTS[Side.LEFT]]
    gate = running(topic)
    for n in range(3):
        assert not passes(gate, frame(topic, replaced(q, 0, q[0] + 0.1 * (n + 1))))
    assert "joint 1 moves 0.100000 rad in a period, 1.0 rad/s allow" in why(
        gate, frame(topic, replaced(q, 0, q[0] + 0.1))
    )
    assert passes(gate, frame(topic, kind=HOLD))


def test_streams_do_not_mix():
    """Each topic has its own forerunner: the left arm's setpoint says nothing about the right arm's."""
    gate = running(*JOINTS.values())
    for side in Side:
        assert passes(gate, frame(JOINTS[side], kind=HOLD))
    gate.forget(JOINTS[Side.LEFT])
    assert passes(gate, frame(JOINTS[Side.RIGHT], kind=HOLD))
    assert not passes(gate, frame(JOINTS[Side.LEFT], kind=HOLD))


@pytest.mark.parametrize(
    ("metres", "radians", "inside"),
    [
        (1.5 / 70**2, 0.0, True),
        (1.5 / 70**2 + 2e-6, 0.0, False),
        (0.0, 5.0 / 70**2, True),
        (0.0, 5.0 / 70**2 + 1e-5, False),
        (0.0, math.pi, False),
    ],
)
def test_a_pose_starts_to_move_and_turn_within_the_configured_accelerations(metres, radians, inside):
    """1.5 m/s² and 5 rad/s² at 70 Hz, from rest."""
    topic = POSES[Side.RIGHT]
    x, y, z, *_ = HOME[topic]
    quat = (math.sin(radians / 2), 0.0, 0.0, math.cos(radians / 2))
    assert passes(running(topic), frame(topic, (x, y + metres, z, *quat))) is inside


@pytest.mark.parametrize(("turns", "bound"), [(False, 0.1), (True, 0.3)])
def test_a_pose_moves_and_turns_within_the_configured_velocities(turns, bound):
    """Norms, in any direction: 0.1 m/s and 0.3 rad/s here, reached gently; a hair more is refused, and named."""
    topic = POSES[Side.LEFT]
    tight = PoseSettings(v_mps=0.1, w_radps=0.3, rate_hz=50.0)
    gate = Gate(SETTINGS, LIFT, pose=tight)
    assert passes(gate, frame(topic, kind=ECHO), context("ENABLING"))
    gone, step = 0.0, 0.0
    while step < bound / 50 - 1e-9:
        step = min(step + bound / 50 / 10, bound / 50)
        gone += step
        assert passes(gate, frame(topic, _gone(topic, gone, turns)))
    assert passes(gate, frame(topic, _gone(topic, gone + step, turns)))
    wrong = why(gate, frame(topic, _gone(topic, gone + 2 * step + 3e-6, turns)))
    assert wrong.endswith("(pose.w_radps)" if turns else "(pose.v_mps)")


def _gone(topic, by, turns):
    """The home pose, moved along the diagonal or turned about it."""
    x, y, z, *quat = HOME[topic]
    part = by / math.sqrt(3.0)
    if not turns:
        return (x - part, y + part, z + part, *quat)
    s = math.sin(by / 2) / math.sqrt(3.0)
    return (x, y, z, s, s, s, math.cos(by / 2))


def test_a_quaternion_that_changes_its_sign_does_not_leave():
    """The same turn to mathematics; another way to whoever interpolates."""
    topic = POSES[Side.RIGHT]
    x, y, z, *quat = HOME[topic]
    assert "changes its sign" in why(running(topic), frame(topic, (x, y, z, *(-c for c in quat))))


def test_rounding_of_a_quaternion_is_no_turn():
    """A norm of a hair above one, as encoders and normalisation leave it, can be held."""
    topic = POSES[Side.LEFT]
    start = (*HOME[topic][:3], 0.0, 0.0, 0.0, 1.0 + 4e-7)
    gate = Gate(SETTINGS, LIFT)
    assert passes(gate, frame(topic, start, ECHO), context("ENABLING")) and passes(gate, frame(topic, start, HOLD))


def test_grippers_and_the_lift_may_step():
    """A force is no setpoint of a position, and the lift's servo ramps by itself (manual §4.4, §4.6)."""
    gripper = GRIPPERS[Side.LEFT]
    gate = running(gripper)
    assert passes(gate, frame(gripper, (1.0,))) and passes(gate, frame(gripper, (0.0,)))
    assert passes(gate, frame(LIFT_COMMAND, (1.0, 1.0))) and passes(gate, frame(LIFT_COMMAND, (-1.0, 1.0)))


TIGHT = ChassisSettings(v_mps=0.2, w_radps=0.4, up_mps2=0.3, down_mps2=0.6)


def driven_to(velocity: tuple[float, float, float], limits: ChassisSettings = TIGHT) -> Gate:
    """A gate through which the chassis has been ramped to a velocity."""
    gate = Gate(SETTINGS, LIFT, limits)
    for part in range(1, 101):
        assert passes(gate, frame(CHASSIS_VELOCITY, tuple(part / 100 * v for v in velocity)))
    return gate


@pytest.mark.parametrize(("n", "bound"), [(0, 0.2), (1, 0.2), (2, 0.4)])
@pytest.mark.parametrize("sign", [1, -1])
def test_the_chassis_is_held_inside_its_limits(n, bound, sign):
    """The configured ones, component by component; without a configuration the hard ones (BEHAVIOUR, values)."""
    limit = replaced((0.0, 0.0, 0.0), n, sign * bound)
    gate = driven_to(limit)
    for value, inside in ((sign * bound, True), (sign * (bound + 1e-8), False)):
        assert passes(gate, frame(CHASSIS_VELOCITY, replaced(limit, n, value))) is inside, value
    hard = replaced((0.0, 0.0, 0.0), n, sign * (1.0 if n == 2 else 0.5))
    gate = Gate(SETTINGS, LIFT)
    for part in range(1, 101):
        assert passes(gate, frame(CHASSIS_VELOCITY, tuple(part / 100 * v for v in hard)))
    assert not passes(gate, frame(CHASSIS_VELOCITY, tuple(1.001 * v for v in hard)))


@pytest.mark.parametrize("n", range(3))
def test_the_chassis_drives_off_and_brakes_inside_the_robots_ramps(n):
    """0.3 up and 0.6 down per second (manual §4.5), 20 Hz; from rest it is a start, whoever was silent before."""
    rest = (0.0, 0.0, 0.0)
    for step, inside in ((0.015, True), (0.0151, False), (-0.015, True), (-0.0151, False)):
        assert passes(Gate(SETTINGS, LIFT, TIGHT), frame(CHASSIS_VELOCITY, replaced(rest, n, step))) is inside
    at = replaced(rest, n, 0.1)
    for value, inside in ((0.115, True), (0.116, False), (0.07, True), (0.069, False)):
        assert passes(driven_to(at), frame(CHASSIS_VELOCITY, replaced(rest, n, value))) is inside, value
    slow = replaced(rest, n, 0.01)
    for value, inside in ((-0.015, True), (-0.021, False)):
        assert passes(driven_to(slow), frame(CHASSIS_VELOCITY, replaced(rest, n, value))) is inside, value


def test_a_stop_of_the_chassis_is_no_step_and_what_follows_it_begins_at_rest():
    """Zeros leave at any speed; the ramp begins at them."""
    gate = driven_to((0.2, 0.0, 0.0))
    assert passes(gate, frame(CHASSIS_VELOCITY, (0.0, 0.0, 0.0), STOP))
    assert not passes(gate, frame(CHASSIS_VELOCITY, (0.1, 0.0, 0.0)))
    assert passes(gate, frame(CHASSIS_VELOCITY, (0.015, 0.0, 0.0)))
    gate.forget(CHASSIS_VELOCITY)
    assert not passes(gate, frame(CHASSIS_VELOCITY, (0.03, 0.0, 0.0))), "a silent one begins at rest, too"


@settings(max_examples=200, deadline=None)
@given(st.lists(st.tuples(st.sampled_from([MOTION, BRAKE, HOLD, WALK]), st.floats(-0.02, 0.02)), max_size=60))
def test_whatever_is_asked_what_leaves_is_within_speed_and_acceleration(steps):
    """DESIGN §8.1 for arbitrary setpoints: the frames that passed, and only they, keep the limits."""
    topic, joint = JOINTS[Side.LEFT], 4
    gate, left = running(topic), [HOME[topic][joint]] * 2
    for kind, step in steps:
        q = left[-1] + step
        if passes(gate, frame(topic, replaced(HOME[topic], joint, q), kind)):
            left.append(q)
    for before, q, after in zip(left, left[1:], left[2:], strict=False):
        assert abs(after - q) <= 1.0 * PERIOD_S + 1.1e-6
        assert abs(after - 2 * q + before) <= 3.0 * PERIOD_S**2 + 1.1e-6


def test_a_stream_of_another_process_goes_on_from_its_last_frame():
    """No echo is needed, and its step limits count from there; `forget` ends that."""
    topic = JOINTS[Side.LEFT]
    gate = Gate(SETTINGS, LIFT)
    q_rad = HOME[topic]
    step = (0.005, *(0.0,) * 6)
    assert not passes(gate, frame(topic, kind=BRAKE))
    gate.resume(topic, q_rad, step)
    near = (q_rad[0] + 0.005, *q_rad[1:])
    assert passes(gate, frame(topic, near, BRAKE), context("HOLDING"))
    gate.resume(topic, q_rad, step)
    assert not passes(gate, frame(topic, q_rad, BRAKE), context("HOLDING")), "a sudden stop passed"
    gate.resume(topic, q_rad, step)
    assert not passes(gate, frame(topic, (q_rad[0] + 0.02, *q_rad[1:]), BRAKE), context("HOLDING"))
    gate.forget(topic)
    assert not passes(gate, frame(topic, near, BRAKE), context("HOLDING"))
