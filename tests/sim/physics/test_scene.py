"""The scene as MuJoCo compiles it, against the published numbers and the simulated robot's own kinematics."""

from __future__ import annotations

import numpy as np
import pytest

from gateway.sim.physics.body_numbers import body_numbers
from gateway.sim.physics.robot_xml import FIXED_LOWERED_M, MOVING_MASS_KG, arm_joint, robot_mass_kg
from gateway.sim.physics.scene import STEP_NS, TABLE_TOP_M, THINGS, scene_xml
from gateway.sim.robot.geometry import arm_geometry, quat_from_rotation, rotation_from_quat, rotation_vector
from gateway.sim.robot.manual import DOF, LOWER_RAD, UPPER_RAD, Side
from tests.sim.physics.mujoco_needed import REASON

mujoco = pytest.importorskip("mujoco", reason=REASON)


@pytest.fixture(scope="module", params=[False, True], ids=["standard", "lift"])
def model(request):
    """The compiled scene of a model with and without lift."""
    return mujoco.MjModel.from_xml_string(scene_xml(has_lift=request.param))


def test_it_weighs_what_the_description_says(model):
    """Sum of the published masses, 84.1 kg, and ours of the hands' moving parts; link by link too."""
    numbers = body_numbers()
    published_kg = sum(inertia.mass_kg for inertia in numbers.inertias.values())
    things_kg = sum(thing[2] for thing in THINGS.values())
    assert robot_mass_kg(numbers) == pytest.approx(published_kg + 2 * MOVING_MASS_KG)
    assert model.body_mass.sum() - things_kg == pytest.approx(robot_mass_kg(numbers), rel=1e-9)
    assert 80.0 < published_kg < 90.0
    for link, inertia in numbers.inertias.items():
        body = model.body(link)
        assert body.mass[0] == pytest.approx(inertia.mass_kg)
        assert body.ipos == pytest.approx(inertia.com_m)
        xx, xy, xz, yy, yz, zz = inertia.inertia_kgm2
        principal = np.linalg.eigvalsh([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        assert np.sort(body.inertia) == pytest.approx(principal, rel=1e-6)


def test_joints_are_in_the_robot_s_order_and_reach_beyond_its_software_limits(model):
    """By index as in §4.0.3; the stops lie outside §4.13, by 0.02 rad at least, never by more than the description has."""
    for side in Side:
        joints = [model.joint(arm_joint(side, number)) for number in range(1, DOF + 1)]
        addresses = [int(joint.qposadr[0]) for joint in joints]
        assert addresses == list(range(addresses[0], addresses[0] + DOF))
        for joint, lower, upper in zip(joints, LOWER_RAD[side], UPPER_RAD[side], strict=True):
            assert joint.range[0] == pytest.approx(lower - 0.02)
            assert joint.range[1] == pytest.approx(upper + 0.02)


def test_motors_pull_no_harder_than_described(model):
    """Torque limits of the arms with gravity compensation; servo gains of the vendor's example."""
    for side in Side:
        for number, effort in enumerate((40.0, 40.0, 20.0, 20.0, 6.0, 5.0, 6.0), start=1):
            joint = model.joint(arm_joint(side, number))
            assert model.jnt_actfrcrange[joint.id] == pytest.approx((-effort, effort))
            assert model.jnt_actgravcomp[joint.id]
            assert model.dof_armature[joint.dofadr[0]] == pytest.approx(0.02)
            servo = model.actuator(f"{arm_joint(side, number)}_follow")
            assert servo.gainprm[0] == 120.0 and servo.biasprm[:3] == pytest.approx((0.0, -120.0, -8.0))
    assert model.opt.timestep * 1e9 == pytest.approx(STEP_NS) == 2_000_000


def test_hands_are_where_the_robot_s_own_kinematics_has_them(model):
    """`left_ee` in `left_shoulder_base`, from another file and other code, anywhere inside the limits, to a nanometre."""
    data = mujoco.MjData(model)
    rng = np.random.default_rng(5)
    for _ in range(50):
        q_rad = {side: rng.uniform(LOWER_RAD[side], UPPER_RAD[side]) for side in Side}
        for side in Side:
            for number in range(1, DOF + 1):
                data.joint(arm_joint(side, number)).qpos[0] = q_rad[side][number - 1]
        mujoco.mj_kinematics(model, data)
        for side in Side:
            ee, shoulder = data.site(f"{side.value}_ee"), data.site(f"{side.value}_shoulder_base")
            rotation = shoulder.xmat.reshape(3, 3)
            wanted = arm_geometry(side).forward(q_rad[side])
            assert rotation.T @ (ee.xpos - shoulder.xpos) == pytest.approx(wanted.position_m, abs=1e-9)
            turn = rotation.T @ ee.xmat.reshape(3, 3) @ rotation_from_quat(wanted.quat_xyzw).T
            assert np.linalg.norm(rotation_vector(turn)) < 1e-7


def test_the_torso_stands_where_the_lift_is_or_begins(model):
    """Shoulders are level, to both sides of the middle, 1.406 m above the ground with the lift at its top."""
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    left, right = (data.site(f"{side.value}_shoulder_base").xpos for side in Side)
    lowered_m = 0.0 if model.nq == 56 else FIXED_LOWERED_M
    assert left == pytest.approx((0.04824, 0.22, 1.4057 - lowered_m), abs=3e-4)
    assert right == pytest.approx((left[0], -left[1], left[2]), abs=1e-9)


def test_eyes_look_where_the_manual_says(model):
    """Head: down by 26 deg (A.3); both eyes 65 mm apart, the left one left. Wrist: along the fingers, 50 mm apart."""
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    mujoco.mj_camlight(model, data)
    left, right = data.camera("head_left_eye"), data.camera("head_right_eye")
    assert -left.xmat.reshape(3, 3)[:, 2] == pytest.approx((0.89879, 0.0, -0.43837), abs=1e-5)
    assert left.xpos - right.xpos == pytest.approx((0.0, 0.065, 0.0), abs=1e-9)
    assert model.cam_fovy[model.camera("head_left_eye").id] == 120.0
    for side in Side:
        eyes = [data.camera(f"{side.value}_wrist_{eye}_eye") for eye in ("left", "right")]
        assert np.linalg.norm(eyes[0].xpos - eyes[1].xpos) == pytest.approx(0.050)
        fingers = data.body(f"{side.value[0]}g_base_link").xmat.reshape(3, 3)[:, 0]
        assert -eyes[0].xmat.reshape(3, 3)[:, 2] @ fingers > 0.9


def test_nothing_touches_anything_in_the_beginning_but_things_the_table(model):
    """Hulls of one arm, of trunk and upper arms may overlap; they are told not to touch."""
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    pairs = {frozenset((model.geom(c.geom1).name, model.geom(c.geom2).name)) for c in data.contact[: data.ncon]}
    assert pairs <= {frozenset(("table", name)) for name in THINGS}
    for name, thing in THINGS.items():
        assert data.body(name).xpos[2] == pytest.approx(TABLE_TOP_M + thing[1][-1], abs=2e-3)


def test_the_quaternions_of_the_document_are_those_of_the_numbers(model):
    """A link's place in its parent, against the matrix of the file."""
    for joint in body_numbers().joints:
        if joint.kind == "revolute":
            w, x, y, z = model.body(joint.child).quat
            wanted = quat_from_rotation(joint.parent_T_child[:3, :3].tolist())
            assert abs(np.dot((x, y, z, w), wanted)) == pytest.approx(1.0, abs=1e-9)
            assert model.body(joint.child).pos == pytest.approx(joint.parent_T_child[:3, 3])
