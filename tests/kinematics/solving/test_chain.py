"""Forward kinematics and Jacobian: against the published figures, the simulation's own geometry, and differences."""

from __future__ import annotations

import numpy as np
import pytest

from gateway.kinematics.description import nominal
from gateway.kinematics.solving.chain import ArmChain
from gateway.robot.limits import HOME_Q_RAD
from gateway.sim.robot import manual
from gateway.sim.robot.geometry import arm_geometry
from gateway.values import Side
from tests.kinematics.bodies import difference, nudged, samples

HOME = {
    Side.LEFT: ((0.37342, 0.09287, -0.35109), (-0.60615, 0.06309, -0.20164, 0.76678)),
    Side.RIGHT: ((0.40409, -0.11846, -0.22319), (0.27021, 0.25035, 0.38367, 0.84682)),
}
"""Published with the numbers: the home of §6.6."""


@pytest.mark.parametrize("side", list(Side))
def test_home_of_the_manual_has_the_published_pose(side):
    """The figures that were published with the numbers, to their five digits."""
    pose = ArmChain(nominal(), side).forward(HOME_Q_RAD[side]).pose
    position, quat = HOME[side]
    assert pose.p_m == pytest.approx(position, abs=6e-6)
    assert pose.quat_xyzw == pytest.approx(quat, abs=6e-6)


@pytest.mark.parametrize("side", list(Side))
def test_the_simulations_own_geometry_agrees_everywhere(side):
    """Two implementations that share no code, position, orientation and Jacobian, at 300 configurations."""
    chain, witness = ArmChain(nominal(), side), arm_geometry(manual.Side(side.value))
    for q in samples(side, 300):
        here, there = chain.forward(q), witness.forward(q)
        assert here.p_m == pytest.approx(there.position_m, abs=1e-14)
        assert abs(np.dot(here.pose.quat_xyzw, there.quat_xyzw)) == pytest.approx(1.0, abs=1e-14)
        assert np.allclose(chain.jacobian(q), witness.jacobian(q), atol=1e-13)


@pytest.mark.parametrize("side", list(Side))
@pytest.mark.parametrize("number", [0, 2, 5])
def test_the_jacobian_is_what_finite_differences_give(side, number):
    """For the nominal arm (0) and for one whose axes lean, where no axis is a coordinate axis any more."""
    body = nudged(side, number, xyz_m=(0.001, -0.002, 0.003), rpy_rad=(0.01, 0.02, -0.03)) if number else nominal()
    chain = ArmChain(body, side)
    for q in samples(side, 20):
        jacobian = chain.jacobian(q)
        for joint in range(7):
            ahead, behind = list(q), list(q)
            ahead[joint] += 1e-6
            behind[joint] -= 1e-6
            a, b = chain.forward(behind), chain.forward(ahead)
            way = np.subtract(b.p_m, a.p_m) / 2e-6
            assert np.allclose(way, jacobian[:3, joint], atol=1e-8)
            assert difference(a, b)[1] / 2e-6 == pytest.approx(np.linalg.norm(jacobian[3:, joint]), abs=1e-7)


@pytest.mark.parametrize("side", list(Side))
def test_pinocchio_agrees(side):
    """The model that is built for pinocchio from the same numbers, and one whose axes lean."""
    pin = pytest.importorskip("pinocchio", reason="the extra `body` is not installed")
    from gateway.kinematics.pin_model import pin_model

    for body in (nominal(), nudged(side, 3, rpy_rad=(0.1, -0.2, 0.3))):
        chain, model = ArmChain(body, side), pin_model(body)
        data = model.createData()
        first = model.joints[model.getJointId(body.arm(side)[0].name)].idx_q
        for q in samples(side, 100):
            everything = pin.neutral(model)
            everything[first : first + 7] = q
            pin.framesForwardKinematics(model, data, everything)
            shoulder, ee = (data.oMf[model.getFrameId(name)] for name in (f"{side}_shoulder_base", f"{side}_ee"))
            wanted = shoulder.inverse() * ee
            here = chain.forward(q)
            assert np.allclose(here.p_m, wanted.translation, atol=1e-14)
            assert np.allclose(here.rows, wanted.rotation, atol=1e-14)
