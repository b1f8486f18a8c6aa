"""Forces, contacts and motors of the scene, without the robot's rules."""

from __future__ import annotations

import math

import numpy as np
import pytest

from gateway.kinematics.description import nominal
from gateway.kinematics.gripper import Gripper
from gateway.sim.physics.linkage import OPEN_RAD
from gateway.sim.physics.robot_xml import arm_joint, hand_link
from gateway.sim.physics.scene import THINGS
from gateway.sim.robot.chassis import wheel_matrix
from gateway.sim.robot.geometry import EePose, arm_geometry
from gateway.sim.robot.manual import EXAMPLE_HOME_RAD, Side
from gateway.sim.robot.parts import WorldUnstable
from gateway.sim.robot.settings import HANGING_RAD
from tests.sim.physics.mujoco_needed import REASON

mujoco = pytest.importorskip("mujoco", reason=REASON)

from gateway.sim.physics.world import World

HOME = {side: np.array(EXAMPLE_HOME_RAD[side]) for side in Side}
BLOCK_M = 2.0 * THINGS["block"][1][0]


def world(*, has_lift: bool = False, pose=HANGING_RAD) -> World:
    """A world whose arms hold a pose, with grippers half open."""
    made = World(has_lift=has_lift)
    for side in Side:
        made.pose_arm(side, np.array(pose[side]))
        made.pose_gripper(side, 0.5 * OPEN_RAD)
        made.drive(side, np.array(pose[side]))
    made.pose_lift(0.30)
    return made


def run(made: World, seconds: float) -> None:
    """Let time pass."""
    for _ in range(round(seconds * 500)):
        made.step()


def between_pads(made: World, side: Side) -> np.ndarray:
    """The middle between both pads' inner faces, 10 mm back from their tips [m]."""
    first, second = (made.data.site(f"{side.value}_tip{number}").xpos for number in (1, 2))
    along = made.data.body(hand_link(side)).xmat.reshape(3, 3)[:, 0]
    return 0.5 * (first + second) - 0.020 * along


def hanging_on(made: World, name: str) -> set[int]:
    """Numbers of a body and of all that hang on it."""
    found = {made.model.body(name).id}
    for body in range(made.model.nbody):  # parents come first
        if int(made.model.body_parentid[body]) in found:
            found.add(body)
    return found


# -------------------------------------------------------------------------------------------------------- at rest


@pytest.mark.parametrize("has_lift", [False, True])
def test_everything_comes_to_rest(has_lift):
    """After three seconds nothing moves but the can's shimmer on its round face, by hundredths of a millimetre."""
    made = world(has_lift=has_lift)
    run(made, 3.0)
    can = int(made.model.joint("can").dofadr[0])
    assert np.abs(np.delete(made.data.qvel, range(can, can + 6))).max() < 2e-3
    assert np.abs(made.data.qvel[can : can + 6]).max() < 2e-2
    assert made.base() == pytest.approx((0.0, 0.0, 0.0), abs=1e-6)
    for side in Side:
        q_rad, v_radps, _ = made.arm(side)
        assert q_rad == pytest.approx(HANGING_RAD[side], abs=1e-4)
        assert np.abs(v_radps).max() < 1e-4
    for name, (_, size, _, x_m, y_m, _) in THINGS.items():
        assert made.place(name).position_m == pytest.approx((x_m, y_m, 0.75 + size[-1]), abs=1e-3)
    assert made.lowered_m() == (pytest.approx(0.30, abs=1e-4) if has_lift else None)
    assert made.time_s == pytest.approx(3.0)


def test_held_torques_are_those_that_gravity_asks_for():
    """Motors of an arm at rest carry the slope of its potential energy: central differences over all links' masses."""
    made = world(pose=EXAMPLE_HOME_RAD)
    run(made, 2.0)
    for side in Side:
        q_rad, _, effort_nm = made.arm(side)
        for joint in range(7):
            energies = []
            for step in (1e-5, -1e-5):
                moved = q_rad.copy()
                moved[joint] += step
                made.pose_arm(side, moved)
                energies.append(9.81 * float(made.model.body_mass @ made.data.xipos[:, 2]))
            made.pose_arm(side, q_rad)
            slope_nm = (energies[0] - energies[1]) / 2e-5
            friction_nm = float(made.model.dof_frictionloss[made.model.joint(arm_joint(side, joint + 1)).dofadr[0]])
            assert effort_nm[joint] == pytest.approx(slope_nm, abs=friction_nm + 1e-3)
    assert abs(made.arm(Side.LEFT)[2][0]) > 1.0  # there is something to carry


def test_energy_is_kept_where_nothing_takes_it():
    """Without motors, friction, stops and contacts both arms swing for a second and lose less than 1e-4 of what moves."""
    made = world(pose=EXAMPLE_HOME_RAD)
    model, data = made.model, made.data
    model.opt.integrator = mujoco.mjtIntegrator.mjINT_RK4
    model.opt.timestep = 5e-4
    off = mujoco.mjtDisableBit
    model.opt.disableflags |= off.mjDSBL_ACTUATION | off.mjDSBL_CONTACT | off.mjDSBL_LIMIT | off.mjDSBL_FRICTIONLOSS
    model.opt.enableflags |= mujoco.mjtEnableBit.mjENBL_ENERGY
    model.dof_damping[:] = 0.0
    model.body_gravcomp[:] = 0.0
    for name in THINGS:  # they would fall through the table
        model.body_gravcomp[model.body(name).id] = 1.0
    mujoco.mj_forward(model, data)
    begin = float(data.energy.sum())
    most = 0.0
    for _ in range(2000):
        mujoco.mj_step(model, data)
        most = max(most, float(data.energy[1]))
    assert most > 5.0
    assert abs(float(data.energy.sum()) - begin) < 1e-4 * most + 1e-2


def test_the_same_inputs_give_the_same_world():
    """To the last bit."""
    states = []
    for _ in range(2):
        made = world()
        for side in Side:
            made.drive(side, HOME[side])
            made.grip(side, -0.8)
        made.roll(wheel_matrix() @ (0.1, 0.0, 0.2))
        run(made, 0.5)
        states.append(made.data.qpos.copy())
    assert np.array_equal(*states)


# ----------------------------------------------------------------------------------------------------------- arms


def test_servos_bring_the_arms_home():
    """A step of the target is followed within a second or two; friction keeps less than 5 mrad."""
    made = world()
    for side in Side:
        made.drive(side, HOME[side])
    run(made, 3.0)
    for side in Side:
        assert made.arm(side)[0] == pytest.approx(HOME[side], abs=5e-3)


def test_a_servo_is_a_spring_and_a_brake_is_not():
    """Pushed, a following arm gives way by force over stiffness and comes back; a braking one goes on and stays (§4.10)."""
    pushed_n = np.array([0.0, 20.0, 0.0, 0.0, 0.0, 0.0])
    ways = {}
    for name in ("follow", "brake"):
        made = world(pose=EXAMPLE_HOME_RAD)
        if name == "brake":
            made.drive(Side.LEFT, None)
        made.data.xfrc_applied[made.model.body(hand_link(Side.LEFT)).id] = pushed_n
        way = []
        for seconds, force_n in ((1.0, pushed_n), (1.0, pushed_n), (2.0, np.zeros(6))):
            made.data.xfrc_applied[made.model.body(hand_link(Side.LEFT)).id] = force_n
            run(made, seconds)
            way.append(float(np.abs(made.arm(Side.LEFT)[0] - HOME[Side.LEFT]).max()))
        ways[name] = way
        assert made.arm(Side.RIGHT)[0] == pytest.approx(HOME[Side.RIGHT], abs=5e-3)  # the other arm goes on holding
    assert ways["follow"][1] == pytest.approx(ways["follow"][0], abs=5e-3)
    assert ways["follow"][2] < 5e-3 < ways["follow"][1]
    assert ways["brake"][1] > 1.8 * ways["brake"][0]
    assert ways["brake"][2] == pytest.approx(ways["brake"][1], rel=0.05)


def test_a_brake_stops_a_moving_arm():
    """From full motion to rest within a quarter of a second."""
    made = world()
    made.drive(Side.LEFT, HOME[Side.LEFT])
    run(made, 0.15)
    assert np.abs(made.arm(Side.LEFT)[1]).max() > 1.0
    made.drive(Side.LEFT, None)
    run(made, 0.25)
    assert np.abs(made.arm(Side.LEFT)[1]).max() < 0.05


def test_arms_meet_instead_of_passing_through_each_other():
    """Both hands sent 6 cm beyond the middle touch each other's arm and stay on their own side."""
    made = world(pose=EXAMPLE_HOME_RAD)
    for side, beyond_m in ((Side.LEFT, -0.28), (Side.RIGHT, 0.28)):
        pose = EePose(position_m=(0.36, beyond_m, -0.25), quat_xyzw=arm_geometry(side).forward(HOME[side]).quat_xyzw)
        target_rad = arm_geometry(side).inverse(pose, HOME[side])
        assert target_rad is not None
        made.drive(side, target_rad)
    arms = {body: side for side in Side for body in hanging_on(made, f"arm{side.value[0].upper()}1_link")}
    has_met = False
    for _ in range(1000):
        made.step()
        for contact in made.data.contact[: made.data.ncon]:
            bodies = (int(made.model.geom_bodyid[number]) for number in (contact.geom1, contact.geom2))
            has_met = has_met or {arms.get(body) for body in bodies} == set(Side)
    assert has_met
    assert made.place("left_ee").position_m[1] > -0.05 and made.place("right_ee").position_m[1] < 0.05


# -------------------------------------------------------------------------------------------------------- grippers


@pytest.mark.parametrize("side", Side)
def test_the_linkage_closes_at_every_angle_and_opens_as_the_gateway_s_kinematics_says(side):
    """Pins meet to a nanometre; the opening is that of another four-bar, solved by other code."""
    made, theirs = world(), Gripper.of(nominal())
    for motor_rad in np.linspace(0.0, OPEN_RAD, 11):
        made.pose_gripper(side, motor_rad)
        assert np.abs(made.data.efc_pos[: made.data.ne]).max() < 1e-9
        assert made.opening_m(side) == pytest.approx(theirs.opening_m(motor_rad), abs=5e-5)
    made.pose_gripper(side, 0.0)
    assert made.opening_m(side) == pytest.approx(0.0, abs=1e-4)


@pytest.mark.parametrize(("torque_nm", "end_rad"), [(2.0, OPEN_RAD), (-1.6, 0.0)])
def test_the_motor_opens_and_closes_the_fingers_to_their_stops(torque_nm, end_rad):
    """Full torque either way: at the stop within a second, the linkage still closed, pads parallel."""
    made = world()
    for side in Side:
        made.grip(side, torque_nm)
    run(made, 1.0)
    for side in Side:
        angle_rad, v_radps = made.gripper(side)
        assert angle_rad == pytest.approx(end_rad, abs=0.01)
        assert abs(v_radps) < 1e-2
        assert np.abs(made.data.efc_pos[: made.data.ne]).max() < 1e-5
        hand = made.data.body(hand_link(side)).xmat
        for number in (1, 2):
            assert made.data.body(f"{side.value}_finger{number}").xmat == pytest.approx(hand, abs=2e-3)


@pytest.mark.parametrize("side", Side)
def test_a_grip_holds_a_block_by_the_force_of_the_linkage(side):
    """0.8 N·m hold the block through a motion, pressed by torque over lever (§4.4.2); opened, it falls."""
    made = world(pose=EXAMPLE_HOME_RAD)
    made.pose_gripper(side, 0.7)
    made.model.opt.gravity[2] = 0.0  # until it is held
    made.pose_thing("block", tuple(between_pads(made, side)))
    hand = made.data.body(hand_link(side))
    made.data.joint("block").qpos[3:] = hand.xquat
    made.grip(side, -0.8)
    run(made, 1.0)
    made.model.opt.gravity[2] = -9.81
    run(made, 1.0)
    assert made.opening_m(side) == pytest.approx(BLOCK_M, abs=1e-3)

    pressing_n = 0.0
    for number, contact in enumerate(made.data.contact[: made.data.ncon]):
        names = {made.model.geom(contact.geom1).name, made.model.geom(contact.geom2).name}
        if names == {"block", f"{side.value}_pad1"}:
            force = np.zeros(6)
            mujoco.mj_contactForce(made.model, made.data, number, force)
            pressing_n += force[0]
    lever_m = Gripper.of(nominal()).opening_per_rad_m(made.gripper(side)[0])
    assert pressing_n == pytest.approx(0.8 / lever_m, rel=0.12)  # dry friction of the motor: 0.06 N·m

    moved = HOME[side].copy()
    moved[0] += 0.3 if side is Side.LEFT else -0.3
    made.drive(side, moved)
    run(made, 2.0)
    assert math.dist(made.place("block").position_m, between_pads(made, side)) < 0.010
    held_m = made.place("block").position_m[2]
    made.grip(side, 2.0)
    run(made, 0.6)
    assert made.place("block").position_m[2] < held_m - 0.1


# ---------------------------------------------------------------------------------------------------- base and lift


@pytest.mark.parametrize("body", [(0.2, 0.0, 0.0), (0.0, -0.2, 0.0), (0.0, 0.0, 0.4)])
def test_wheels_carry_the_base_where_they_roll(body):
    """Ramped up and down as the robot does it, the base goes the way of the wheels to a millimetre, and stays."""
    made, matrix = world(), wheel_matrix()
    way = np.zeros(3)
    for part in (*np.linspace(0.0, 1.0, 400), *np.ones(500), *np.linspace(1.0, 0.0, 200), *np.zeros(400)):
        made.roll(matrix @ (part * np.array(body)))
        made.step()
        way += part * np.array(body) * 0.002
    assert made.base() == pytest.approx(tuple(way), abs=1.5e-3)
    assert made.wheels()[0] == pytest.approx(matrix @ way, abs=2e-2)
    assert np.abs(made.wheels()[1]).max() < 1e-3


def test_wheels_slip_when_asked_for_more_than_the_ground_gives():
    """All wheels at once to 3 m/s along x: no more than two wheels' share of friction 0.8 pushes, about 0.46 g."""
    made = world()
    made.roll(wheel_matrix() @ (3.0, 0.0, 0.0))
    run(made, 0.2)
    x_m, _, _ = made.base()
    share = 0.8 / 3.0 * 2.0 * math.cos(math.radians(30.0))
    assert x_m == pytest.approx(0.5 * share * 9.81 * 0.2**2, rel=0.1)
    assert made.wheels()[0][0] / wheel_matrix()[0, 0] > 3.0 * x_m  # they turned, the base did not follow


def test_the_lift_goes_where_it_is_told_and_stalls_under_too_much():
    """2 mm of servo; 1,000 N more than its motor gives push it down."""
    made = world(has_lift=True)
    for lowered_m in np.linspace(0.30, 0.20, 300):
        made.lower(lowered_m)
        made.step()
    run(made, 0.5)
    assert made.lowered_m() == pytest.approx(0.20, abs=2e-3)
    made.data.xfrc_applied[made.model.body("lift_carriage_link").id, 2] = -2351.9
    run(made, 0.5)
    assert made.lowered_m() > 0.25


# ----------------------------------------------------------------------------------------------------------- errors


def test_a_world_that_went_wrong_is_an_error():
    """MuJoCo would start anew at zero without a word; here the time and the reason are told."""
    made = world()
    run(made, 0.1)
    made.data.qvel[10] = math.inf
    with pytest.raises(WorldUnstable, match=r"after 0\.102 s of physics: mjWARN_BADQVEL; start the simulation again"):
        made.step()


def test_what_is_not_there_has_no_place():
    """Neither a thing nor a frame."""
    with pytest.raises(KeyError):
        world().place("cup")


def test_a_thing_is_put_down_upright():
    """Where it is told, at rest."""
    made = world()
    made.pose_thing("can", (1.0, 0.1, 0.8))
    assert made.place("can").position_m == pytest.approx((1.0, 0.1, 0.8))
    assert made.place("can").quat_xyzw == pytest.approx((0.0, 0.0, 0.0, 1.0))
