"""The body of the page is the one that the gateway reckons with."""

from __future__ import annotations

import math

import numpy as np
import pytest
from msgspec.structs import replace

from gateway.api.protocol import Snapshot, SpacingView
from gateway.cli.body.calibration_writing import write_arms
from gateway.kinematics.calibration import RobotIdentity
from gateway.kinematics.calibration_file.arm_section import ArmCalibration, fingerprint
from gateway.kinematics.collision import CollisionModel
from gateway.kinematics.correction import ArmCorrection, corrected
from gateway.kinematics.description import nominal
from gateway.kinematics.solving.chain import ArmChain
from gateway.robot.limits import HOME_Q_RAD
from gateway.settings.settings import LinkSettings, ModelSettings, Settings
from gateway.values import Side
from gateway.web.body import Body
from tests.cli.views import a_view
from tests.kinematics.guarded_arms import OWN, ZEROS_RAD

HOME = {side: tuple(HOME_Q_RAD[side]) for side in Side}
MODEL = CollisionModel(nominal())


@pytest.fixture(scope="module")
def body() -> Body:
    """The body of the settings that everybody has."""
    return Body(Settings())


def at(q_rad, **changes) -> Snapshot:
    """Return a state with these joints."""
    view = a_view(**changes)
    arms = {}
    for side, q in q_rad.items():
        arm = view.arms[side.value]
        arms[side.value] = replace(arm, measured=None if q is None else replace(arm.measured, q_rad=q))
    return replace(view, arms=arms)


def test_each_part_is_where_the_collision_model_has_it(body: Body) -> None:
    """Both ends of its line, in the order of names and radii; no arm's colour for what no joint moves."""
    seen = body.seen(at(HOME))
    assert seen is not None and len(seen.lines_m) == len(body.shape.parts) == len(MODEL.capsules)
    for line, (x, y, z, u, v, w, _) in zip(seen.lines_m, MODEL.posture(HOME).segments, strict=True):
        assert line == pytest.approx((x, y, z, x + u, y + v, z + w), abs=1e-4)
    shown = {part.name: (part.side, part.radius_m) for part in body.shape.parts}
    assert shown["left_palm"] == ("left", 0.055) and shown["left_torso"][0] == shown["column"][0] == ""


def test_frames_are_in_the_chest_with_axes_that_stand_on_each_other(body: Body) -> None:
    """The shoulders' lie beside its middle, the hands' at the end of the arms."""
    seen = body.seen(at(HOME))
    assert seen is not None
    frames = {**body.shape.frames, **seen.frames}
    for place in frames.values():
        axes = np.reshape(place[3:], (3, 3))
        assert axes @ axes.T == pytest.approx(np.eye(3), abs=1e-3) and np.linalg.det(axes) > 0.99
    names = {side: next(name for name in body.shape.frames if name.startswith(side)) for side in ("left", "right")}
    assert frames[names["left"]][:3] == pytest.approx((0.0, 0.22, 0.0), abs=1e-4)
    assert frames[names["right"]][:3] == pytest.approx((0.0, -0.22, 0.0), abs=1e-4)
    palm = next(n for n, part in enumerate(body.shape.parts) if part.name == "left_palm")
    assert math.dist(frames["left_ee"][:3], seen.lines_m[palm][:3]) < 0.2


def test_a_calibrated_body_is_where_its_joints_really_are_and_its_hand_where_the_robot_says(tmp_path) -> None:
    """Parts go with the zeros that were identified; a shoulder that was is the frame of the robot's own poses."""
    own = ArmCorrection(offsets_rad=ZEROS_RAD[Side.LEFT], ee=OWN, shoulder=OWN)
    numbers = fingerprint(nominal(), Side.LEFT)
    arm = ArmCalibration(side=Side.LEFT, correction=own, description="ours", numbers=numbers)
    write_arms(tmp_path / "own.json", RobotIdentity(serial="A", model="standard"), [arm])
    model = ModelSettings(calibration=str(tmp_path / "own.json"))
    seen = Body(Settings(link=LinkSettings(serial="A"), model=model)).seen(at(HOME))
    zeros_rad = {**dict.fromkeys(Side, (0.0,) * 7), Side.LEFT: ZEROS_RAD[Side.LEFT]}
    real = {side: tuple(q + zero for q, zero in zip(HOME[side], zeros_rad[side], strict=True)) for side in Side}
    for line, (x, y, z, u, v, w, _) in zip(seen.lines_m, MODEL.posture(real).segments, strict=True):
        assert line == pytest.approx((x, y, z, x + u, y + v, z + w), abs=1e-4)
    x, y, z = ArmChain(corrected(nominal(), Side.LEFT, own), Side.LEFT).forward(HOME[Side.LEFT]).p_m
    assert seen.frames["left_ee"][:3] == pytest.approx((x, y + 0.22, z), abs=1e-4)


def test_the_nearest_pair_is_the_model_s_own_where_the_gateway_says_none(body: Body) -> None:
    """Its gap is what is free between its two points."""
    seen = body.seen(at(HOME, spacing=None))
    near = MODEL.posture(HOME).nearest()
    radii = {part.name: part.radius_m for part in body.shape.parts}
    assert seen is not None and (seen.near.first, seen.near.second) == (near.first, near.second)
    free_m = math.dist(seen.near.from_m, seen.near.to_m) - radii[near.first] - radii[near.second]
    assert seen.near.gap_m == pytest.approx(free_m, abs=1e-3)


def test_the_nearest_pair_is_the_gateway_s_where_it_says_one(body: Body) -> None:
    """With its own figure; a pair that this body has not is not made up."""
    i, j, *_ = MODEL.pairs[-1]
    told = SpacingView(
        on=True,
        why="",
        gap_m=0.123,
        first=MODEL.capsules[j].name,
        second=MODEL.capsules[i].name,
        margin_m=0.02,
        held=(),
    )
    seen = body.seen(at(HOME, spacing=told))
    assert seen is not None and {seen.near.first, seen.near.second} == {told.first, told.second}
    assert seen.near.gap_m == 0.123
    strange = body.seen(at(HOME, spacing=replace(told, first="tail")))
    assert strange is not None and strange.near.first != "tail" and strange.near.gap_m != 0.123


@pytest.mark.parametrize(("age_ns", "is_drawn"), [(199_000_000, True), (200_000_000, False), (10_000_000_000, False)])
def test_a_body_whose_arm_is_silent_is_not_drawn_as_if_it_were_now(body: Body, age_ns: int, is_drawn: bool) -> None:
    """The page greys the view where there is none, and says that nobody knows."""
    view = at(HOME)
    arm = view.arms["right"]
    arms = {**view.arms, "right": replace(arm, measured=replace(arm.measured, age_ns=age_ns))}
    assert (body.seen(replace(view, arms=arms)) is not None) is is_drawn


@pytest.mark.parametrize("q_rad", [None, (0.0,) * 6, (math.nan,) * 7])
def test_a_body_whose_arm_is_not_known_is_not_drawn(body: Body, q_rad) -> None:
    """Half a body, or one from numbers that are none, would be believed."""
    assert body.seen(at({**HOME, Side.LEFT: q_rad})) is None
