"""Each fault of the simulated robot is found by the row that should find it, and by no other; without sockets, in virtual time.

`LOOKED` are found without moving anything, `MOVED` by a trial; `UNSEEN` are found by neither, and say why.
"""

from __future__ import annotations

import pytest

from gateway.cli.check import moved
from gateway.cli.check.looked import Wish
from gateway.cli.check.rows import MOVING
from gateway.robot.topics import (
    CHASSIS_STATE,
    CHASSIS_VELOCITY,
    CURRENT_MODE,
    FSM_ENABLE,
    FSM_STATE,
    arm_state,
    ee_pose,
    gripper_command,
    gripper_state,
    joint_command,
    pose_command,
)
from gateway.sim.robot.faults import FAULTS
from gateway.sim.robot.manual import Side as SimSide
from gateway.sim.robot.settings import HANGING_RAD, SimSettings
from gateway.values import Side
from tests.cli.check.seen import Bench, looked_at, named

ARM, GRIPPER = arm_state(Side.LEFT), gripper_state(Side.RIGHT)

LOOKED = [
    ({"fault": "drop", "topic": ARM}, "states"),
    ({"fault": "drop", "topic": ee_pose(Side.RIGHT)}, "states"),
    ({"fault": "drop", "topic": CURRENT_MODE}, "states"),
    ({"fault": "drop", "topic": "*"}, "states"),
    ({"fault": "freeze", "topic": ARM}, "fresh"),
    ({"fault": "freeze", "topic": CHASSIS_STATE}, "fresh"),
    ({"fault": "delay", "topic": GRIPPER, "delay_s": 0.3}, "latency"),
    ({"fault": "delay", "topic": "*", "delay_s": 0.8}, "clock"),
    ({"fault": "duplicate", "topic": ARM, "copies": 2}, "copies"),
    ({"fault": "duplicate", "topic": ee_pose(Side.LEFT), "copies": 2}, "rates"),
    ({"fault": "reorder", "topic": GRIPPER}, "order"),
    ({"fault": "nan", "topic": ARM}, "samples"),
    ({"fault": "nan", "topic": ee_pose(Side.LEFT)}, "samples"),
    ({"fault": "short", "topic": ARM}, "samples"),
    ({"fault": "wrong_names", "topic": ARM}, "samples"),
    ({"fault": "fsm_error"}, "fsm"),
    ({"fault": "fsm_value", "value": 6}, "fsm"),
    ({"fault": "fsm_value", "value": 17}, "fsm"),
    ({"fault": "vr_mode"}, "mode"),
    ({"fault": "arm_disabled", "side": "right"}, "parts"),
    ({"fault": "control_mode", "side": "left", "mode": "pose"}, "control"),
    ({"fault": "jump", "side": "left", "joint": 3, "delta_rad": 0.2}, "still"),
    ({"fault": "clock_step", "step_s": 2.0}, "clock"),
    ({"fault": "clock_step", "step_s": -2.0}, "clock"),
    ({"fault": "frozen"}, "states"),
    ({"fault": "route_dead", "topic": ARM}, "routes"),
]
"""Fault -> the row that fails. Jump and freeze begin while it is listened, the others before."""
LATE = ("jump", "frozen")

UNSEEN = {
    "clock_drift": "some seconds are too short for parts in a million; what it has gained is found by `clock`",
    "joint_zero": "what it tells is consistent: only the body model knows better (`ta2 status`, `ta2 frames`)",
    "load": "a hand may hold something; what pulls at an arm is in the state (`ta2 watch`)",
    "tight_limit": "a small step is nowhere near a limit",
    "pause": "PAUSE is how a robot is found; kept there, it is not enabled (a trial's error, tested in test_trials.py)",
}

NODES = {"router_stop": "router", "node_lost": "bridge"}
"""Faults after which nothing is known of topics: their rows are tested below."""


def bench_with(fault: dict[str, object]) -> Bench:
    """Return what was listened to for some seconds."""
    bench = Bench()
    is_late = fault["fault"] in LATE
    if is_late:
        bench.run(1.0)
    bench.fault(**fault)
    bench.run(2.2 if is_late else 3.2)
    return bench


def test_every_fault_of_the_simulated_robot_is_in_a_table():
    """A new one has to be found by some row, or to say why none can."""
    tabled = [*(fault["fault"] for fault, _ in LOOKED), *(fault["fault"] for fault, *_ in MOVED), *UNSEEN, *NODES]
    assert set(tabled) == set(FAULTS) and all(UNSEEN.values())


def test_a_healthy_robot_passes_every_row():
    """Of those for which nothing moves; figures are where there are any."""
    bench = Bench()
    bench.run(3.2)
    rows = looked_at(bench, Wish(mode="joint"))
    assert {row.verdict for row in rows.values()} == {"pass"} and not {*MOVING, "video"} & set(rows)
    assert rows["rates"].figure == pytest.approx(1.0, abs=0.01) and rows["rates"].bound == "0.8 to 1.25"
    assert rows["clock"].figure == pytest.approx(0.0, abs=0.02) and not any(row.remedy for row in rows.values())


@pytest.mark.parametrize(
    ("fault", "row"), LOOKED, ids=lambda each: each if isinstance(each, str) else "-".join(map(str, each.values()))
)
def test_a_fault_is_found_by_its_row_and_by_no_other(fault, row):
    """Which says what to do, too."""
    rows = looked_at(bench_with(fault), Wish(mode="joint"))
    assert named(rows.values(), "fail") == [row]
    assert rows[row].remedy and rows[row].found


def test_without_a_robot_at_the_router_nothing_is_said_of_its_topics():
    """A node that is away is found by `bridge`; a router that is away by `router`."""
    bench = Bench()
    bench.fault(fault="node_lost")
    bench.run(0.5)
    for row, changes in (("bridge", {"tokens": ()}), ("router", {"router_zid": ""})):
        rows = looked_at(bench, **changes)
        assert named(rows.values(), "fail") == [row]
        assert set(named(rows.values(), "skipped")) >= {"states", "rates", "mode", "fsm", "writers"}


# ------------------------------------------------------------------------------------------------------------ trials


HEART = [(FSM_ENABLE, [1.0])]
STEP = moved.STEP_RAD


class Commander:
    """Commands both arms to stay where they hang, or a joint of the left one a little off, as a gateway would."""

    def __init__(self, bench: Bench, *, is_pose: bool = False) -> None:
        self.bench = bench
        self.offset = 0.0
        self.more: list[tuple[str, list[float]]] = []
        poses = {}
        for side in Side:
            _, pose = bench.capture.messages(ee_pose(side))[-1]
            p, q = pose.position, pose.orientation
            poses[side] = ([p.x, p.y, p.z], [q.x, q.y, q.z, q.w])
        self.poses, self.is_pose = poses, is_pose

    def __call__(self):
        for side in Side:
            if self.is_pose:
                p_m, quat_xyzw = self.poses[side]
                reach_m = sum(x * x for x in p_m) ** 0.5
                yield pose_command(side), [*(x * (1.0 + self.offset / reach_m) for x in p_m), *quat_xyzw]
            else:
                q_rad = list(HANGING_RAD[SimSide(side.value)])
                q_rad[2] += self.offset
                yield joint_command(side), q_rad
        yield from HEART
        yield from self.more


def enabled(settings: SimSettings | None = None) -> tuple[Bench, Commander]:
    """Return a robot that was brought to READY."""
    bench = Bench(settings)
    bench.run(0.1)
    commander = Commander(bench, is_pose=settings is not None and settings.left_mode == "pose")
    bench.run(1.0, commander)
    return bench, commander


def echo(bench, commander):
    """Hold."""
    return moved.echoed(bench.capture, list(Side), bench.run(0.5, commander))


def step_and_back(bench, commander):
    """Move a joint, or the end effector."""
    step = -moved.STEP_M if commander.is_pose else STEP
    begin = bench.now_ns + 1
    for offset in (step, 0.0):
        commander.offset = offset
        span = bench.run(0.7, commander)
    return moved.moved_back(
        bench.capture, Side.LEFT, None if commander.is_pose else 2, step, span._replace(begin_ns=begin)
    )


def grip(bench, commander):
    """Open the left gripper."""
    commander.more = [(gripper_command(Side.LEFT), [0.05])]
    return moved.gripped(bench.capture, Side.LEFT, bench.run(0.3, commander))


def disable(bench, _):
    """Send 0.0."""
    return moved.paused("disable", bench.capture, bench.run(0.6, lambda: [(FSM_ENABLE, [0.0])]))


def silence(bench, commander):
    """Send nothing any more."""
    begin = bench.run(0.1, commander).begin_ns
    return moved.paused("heartbeat", bench.capture, bench.run(2.0)._replace(begin_ns=begin))


def chassis_stop(bench, _):
    """Drive, then zeros."""
    begin = bench.run(0.5, lambda: [(CHASSIS_VELOCITY, [0.05, 0.0, 0.0])]).begin_ns
    span = bench.run(1.5, lambda: [(CHASSIS_VELOCITY, [0.0, 0.0, 0.0])])
    return moved.rolled_out("chassis_stop", bench.capture, span._replace(begin_ns=begin))


def chassis_timeout(bench, _):
    """Drive, then silence."""
    begin = bench.run(0.5, lambda: [(CHASSIS_VELOCITY, [0.05, 0.0, 0.0])]).begin_ns
    return moved.rolled_out("chassis_timeout", bench.capture, bench.run(2.5)._replace(begin_ns=begin))


OTHERS = (grip, disable, silence, chassis_stop, chassis_timeout)
POSE = SimSettings(left_mode="pose", right_mode="pose")
MOVED = [
    ({"fault": "jump", "side": "left", "joint": 3, "delta_rad": 0.2}, echo, None),
    ({"fault": "blocked", "side": "left"}, step_and_back, None),
    ({"fault": "stuck", "side": "left", "joint": 3}, step_and_back, None),
    ({"fault": "stuck", "side": "left", "joint": 4}, step_and_back, POSE),
    ({"fault": "drop", "topic": joint_command(Side.LEFT)}, step_and_back, None),
    ({"fault": "arm_disabled", "side": "left"}, step_and_back, None),
    ({"fault": "control_mode", "side": "left", "mode": "pose"}, step_and_back, None),
    ({"fault": "no_ik", "side": "left"}, step_and_back, POSE),
    ({"fault": "drop", "topic": gripper_command(Side.LEFT)}, grip, None),
    ({"fault": "drop", "topic": FSM_ENABLE}, disable, None),
    ({"fault": "fsm_value", "value": 2}, silence, None),
    ({"fault": "drop", "topic": CHASSIS_VELOCITY}, chassis_stop, None),
    ({"fault": "delay", "topic": CHASSIS_VELOCITY, "delay_s": 0.9}, chassis_stop, None),
    ({"fault": "delay", "topic": CHASSIS_VELOCITY, "delay_s": 0.9}, chassis_timeout, None),
    ({"fault": "drop", "topic": FSM_STATE}, silence, None),
]
"""Fault that begins before a trial -> the trial that fails, and the robot where it is not the standard one."""


@pytest.mark.parametrize(
    ("trial", "settings"),
    [(echo, None), (step_and_back, None), (step_and_back, POSE), *((each, None) for each in OTHERS)],
)
def test_a_healthy_robot_passes_every_trial(trial, settings):
    """With its figure within the bound."""
    row = trial(*enabled(settings))
    assert row.verdict == "pass" and row.figure is not None and row.bound


@pytest.mark.parametrize(("name", "then"), [("chassis_stop", [(CHASSIS_VELOCITY, [0.0] * 3)]), ("chassis_timeout", [])])
def test_wheels_that_are_not_heard_any_more_while_they_roll_are_not_at_rest(name, then):
    """What was heard last is how they roll, soon after they were told to stop."""
    bench, _ = enabled()
    begin = bench.run(0.5, lambda: [(CHASSIS_VELOCITY, [0.05, 0.0, 0.0])]).begin_ns
    bench.fault(fault="drop", topic=CHASSIS_STATE)
    row = moved.rolled_out(name, bench.capture, bench.run(2.5, lambda: then)._replace(begin_ns=begin))
    assert row.verdict == "fail" and "stopped coming" in row.found and row.remedy


@pytest.mark.parametrize(("fault", "trial", "settings"), MOVED)
def test_a_fault_fails_its_trial(fault, trial, settings):
    """The robot was healthy when it was enabled."""
    bench, commander = enabled(settings)
    if trial is echo:
        bench.run(0.1, commander)
        span = bench.run(0.2, commander)
        bench.fault(**fault)
        row = moved.echoed(bench.capture, list(Side), span._replace(end_ns=bench.run(0.3, commander).end_ns))
    else:
        bench.fault(**fault)
        row = trial(bench, commander)
    assert row.verdict == "fail" and row.remedy
