"""The body model, checked live: agreement on a nominal robot whatever it does, another body told in time, and corrected."""

from __future__ import annotations

import random
from pathlib import Path

import pytest

from gateway.cli.body.calibration_writing import write_arms
from gateway.codes import Code
from gateway.core.robot_state.body_model import body_model
from gateway.kinematics.arm import ArmModel
from gateway.kinematics.calibration import RobotIdentity
from gateway.kinematics.calibration_file.arm_section import ArmCalibration, fingerprint
from gateway.kinematics.description import nominal
from gateway.kinematics.identification.pairing import Pair, Pairing
from gateway.kinematics.identification.parameters import Group
from gateway.kinematics.identify import Identification, identify
from gateway.messages.snapshot import ModelView, Snapshot
from gateway.robot.limits import JOINT_LOWER_RAD, JOINT_UPPER_RAD
from gateway.robot.topics import STATE_TOPICS, arm_state, ee_pose
from gateway.settings.settings import ArmSettings, LinkSettings, LocalSettings, ModelSettings, Settings
from gateway.sim.robot.settings import SimSettings
from gateway.values import Side
from tests.behaviour.scene import Scene, scene
from tests.pair import MS
from tests.pair import Pair as Both
from tests.thoroughness import either

SIDES = ("left", "right")
ZEROS_RAD = (0.02, -0.03, 0.05, 0.04, -0.06, 0.03, 0.05)
"""What the left arm's joints are off by."""


def modelled(state: str, right_mode: str = "joint", arm: ArmSettings | None = None) -> Scene:
    """Return a scene whose engine has the model, with every topic and snapshots at 50 Hz."""
    sim = SimSettings(state_period_ns=10 * MS, right_mode=right_mode)
    pair = Scene(sim, snapshot_hz=50, is_modelled=True, arm=arm)
    pair.topics = STATE_TOPICS
    return scene(state, pair)


def seen(pair: Both) -> dict[str, ModelView]:
    """Return what is shown of the model of each arm."""
    return models(pair.see())


def models(snapshot: Snapshot) -> dict[str, ModelView]:
    """Return the same of a snapshot."""
    return {side: model for side, arm in snapshot.arms.items() if (model := arm.model) is not None}


def states(pair: Both) -> list[str]:
    """Return the verdicts, left and right."""
    return [seen(pair)[side].state for side in SIDES]


def zero(pair: Both, side: Side, joint: int, delta_rad: float) -> None:
    """Let a joint be somewhere else than it says."""
    fault = {"fault": "joint_zero", "side": side.value, "joint": joint, "delta_rad": delta_rad}
    pair.robot.inject(fault, pair.now_ns)


def wander(pair: Scene, seconds: float, seed: int = 5) -> dict[Side, list[Pair]]:
    """Let both arms go from posture to posture for a while; return joints and poses that belong together."""
    rng = random.Random(seed)
    pairings = {side: Pairing() for side in Side}
    pairs: dict[Side, list[Pair]] = {side: [] for side in Side}
    until_ns, next_ns = pair.now_ns + round(seconds * 1e9), 0
    while pair.now_ns < until_ns:
        if pair.now_ns >= next_ns:
            next_ns = pair.now_ns + 2_500 * MS
            goals = {
                side: tuple(
                    rng.uniform(0.9 * low + 0.1 * high, 0.1 * low + 0.9 * high)
                    for low, high in zip(JOINT_LOWER_RAD[side], JOINT_UPPER_RAD[side], strict=True)
                )
                for side in Side
            }
            pair.move(pair.epoch, goals, "ann")
        pair.step()
        for side in Side:
            joints, pose = (pair.heard[topic] for topic in (arm_state(side), ee_pose(side)))
            pairs[side] += pairings[side].joints(joints.value.q_rad, joints.received_ns)
            pairs[side] += pairings[side].pose(pose.value, pose.received_ns)
    return pairs


# ------------------------------------------------------------------------------------------------------------- nominal


@pytest.mark.parametrize(("state", "right_mode"), [("READ_ONLY", "joint"), ("HOLDING", "joint"), ("at rest", "pose")])
def test_a_nominal_robot_agrees_within_two_seconds(state: str, right_mode: str) -> None:
    """Owned or not, at rest or held, in either control mode."""
    pair = modelled(state, right_mode)
    pair.run(2.0)
    assert states(pair) == ["agrees"] * 2
    for model in seen(pair).values():
        assert model.position_m is not None and model.position_m < 1e-4 and model.pairs > 12


def test_a_nominal_robot_agrees_however_fast_it_moves() -> None:
    """From posture to posture at three times the usual velocity: never another verdict, and far from the tolerances."""
    pair = modelled("at rest", arm=ArmSettings(v_radps=3.0, a_radps2=15.0, j_radps3=300.0))
    pair.run(2.0)
    shown: list[ModelView] = []
    pair.on_step = lambda output: shown.extend(models(output.snapshot).values()) if output.snapshot else None
    wander(pair, either(15.0, 120.0))
    assert {model.state for model in shown} == {"agrees"}
    assert max(model.position_m or 0.0 for model in shown) < 1e-3
    assert max(model.angle_rad or 0.0 for model in shown) < 4e-3


# --------------------------------------------------------------------------------------------------------- another body


@pytest.mark.parametrize("state", ["READ_ONLY", "at rest", "ACTIVE"])
def test_another_body_is_told_within_five_seconds_and_over_as_soon(state: str) -> None:
    """The left elbow is 60 mrad elsewhere: finding, notice, refusal, on that arm alone; at rest and in motion."""
    pair = modelled(state)
    pair.run(2.0)
    zero(pair, Side.LEFT, 4, 0.06)
    pair.run(5.0)
    left = seen(pair)["left"]
    assert states(pair) == ["differs", "agrees"]
    assert left.angle_rad == pytest.approx(0.06, abs=0.005) and (left.position_m or 0.0) > 0.01
    (finding,) = pair.see().findings
    assert finding.code == "MODEL_DIFFERS" and "left arm" in finding.message and "ta2 identify" in finding.hint
    assert [notice.facts for notice in pair.notices if notice.code is Code.MODEL_DIFFERS] == [{"subject": "left_arm"}]
    pair.robot.clear("joint_zero")
    pair.run(5.0)
    assert states(pair) == ["agrees"] * 2 and not pair.see().findings


def test_a_new_link_ends_in_nothing_known() -> None:
    """Another router may be another robot's: what was known of the body does not go over to it."""
    pair = modelled("at rest")
    pair.run(3.0)
    assert states(pair) == ["agrees"] * 2
    pair.down()
    pair.run(0.1)
    assert states(pair) == ["unknown"] * 2
    zero(pair, Side.RIGHT, 2, 0.05)
    pair.up("bb")
    pair.run(2.0)
    assert states(pair) == ["agrees", "differs"]


def test_without_poses_nothing_is_known() -> None:
    """The route of one arm's pose dies: after half a second that arm's verdict is no yes any more."""
    pair = modelled("at rest")
    pair.run(2.0)
    pair.robot.inject({"fault": "drop", "topic": ee_pose(Side.LEFT)}, pair.now_ns)
    pair.run(1.2)
    assert states(pair) == ["unknown", "agrees"]


# ---------------------------------------------------------------------------------------------------------- calibrated


@pytest.mark.thorough
def test_a_robot_that_differs_agrees_after_it_was_identified(tmp_path: Path) -> None:
    """Joints off by 20 to 60 mrad: found from its own motion, written to its calibration, loaded by the next daemon."""
    pair = modelled("at rest")
    for joint, delta_rad in enumerate(ZEROS_RAD, start=1):
        zero(pair, Side.LEFT, joint, delta_rad)
    pairs = wander(pair, 60.0)
    assert states(pair) == ["differs", "agrees"]
    groups = frozenset(Group) - {Group.SHOULDER, Group.LAG}
    found = identify(ArmModel(nominal(), Side.LEFT), pairs[Side.LEFT], groups)
    assert isinstance(found, Identification), found
    assert found.correction.offsets_rad == pytest.approx(ZEROS_RAD, abs=2e-4)
    arm = ArmCalibration(
        side=Side.LEFT,
        correction=found.correction,
        description=nominal().source,
        numbers=fingerprint(nominal(), Side.LEFT),
        note="",
    )
    path = tmp_path / "own.json"
    write_arms(path, RobotIdentity(serial="TA2-0042", model="standard"), [arm])
    settings = Settings(
        link=LinkSettings(serial="TA2-0042"),
        local=LocalSettings(snapshot_hz=50),
        model=ModelSettings(calibration=str(path), position_tolerance_m=0.001, angle_tolerance_rad=0.002),
    )
    after = Both(settings, SimSettings(state_period_ns=10 * MS), model=body_model(settings))
    for joint, delta_rad in enumerate(ZEROS_RAD, start=1):
        zero(after, Side.LEFT, joint, delta_rad)
    after.run(3.0)
    assert states(after) == ["agrees"] * 2
    after.robot.clear("joint_zero")
    after.run(5.0)
    assert states(after) == ["differs", "agrees"], "a correction of nothing is another robot's"
