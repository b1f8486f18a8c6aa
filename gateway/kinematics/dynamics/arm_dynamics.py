"""One arm's rigid-body dynamics on the lifted, driven base, by pinocchio: gravity, torques, momentum, Jacobian.

The base's motion is given, not found: x, y [m/s] and yaw [rad/s] of the chassis, then the lift, down is positive [m/s]. Where
it stands changes no torque, so it is always at zero. The other arm acts on this one through the base only, and is left out.
The one module beside `pin_model` that imports pinocchio (extra `body`): see `loading.py`.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from gateway.kinematics.description import Description, Kind, arm_joint, ee_frame
from gateway.kinematics.dynamics.observer import Terms
from gateway.kinematics.dynamics.parameters import DriveParameters, Load
from gateway.kinematics.pin_model import pin_model
from gateway.values import ARM_DOF, Side, Vector

__all__ = ["ArmDynamics"]

Array = NDArray[np.float64]

PARAMETERS, MOMENTS = 10, 4
"""Of a link, in pinocchio's order: mass, three first moments, six moments of inertia; and those of them that are identified."""

BASE: Final = (("base_x", pin.JointModelPX), ("base_y", pin.JointModelPY), ("base_yaw", pin.JointModelRZ))


class ArmDynamics:
    """Dynamics of an arm; not safe to use from two threads, since pinocchio writes into one set of data.

    Args:
        description: Of the body; parents come before children.
        side: Which arm.
        drives: Its drives.
        load: What its hand holds; None for nothing.

    Attributes:
        side: Which arm.
        drives: Its drives.
        load: What its hand holds.
        frame: In whose axes wrenches are given: the arm's shoulder frame, that of its poses (§4.0.1).
        point: Frame at whose origin they act.
        model: pinocchio's model: base, lift where there is one, then the seven joints.
    """

    def __init__(self, description: Description, side: Side, drives: DriveParameters, load: Load | None = None) -> None:
        self.side, self.drives = side, drives
        self._description = description
        self.frame, self.point = f"{side.value}_shoulder_base", ee_frame(side)
        self.model: Any = _model(description, side)
        self.model.armature[-ARM_DOF:] = np.array(drives.armature_kgm2)
        for link, more in zip(range(self.model.njoints - ARM_DOF, self.model.njoints), drives.heavier, strict=False):
            described = self.model.inertias[link].toDynamicParameters()
            described[:MOMENTS] += more
            self.model.inertias[link] = pin.Inertia.FromDynamicParameters(described)
        self._hand: Any = self.model.inertias[self.model.njoints - 1].copy()
        self._data: Any = self.model.createData()
        self._q, self._v = np.zeros(self.model.nq), np.zeros(self.model.nv)
        self._given = self.model.nv - ARM_DOF  # coordinates of base and lift come first
        self._ee = self.model.getFrameId(self.point)
        pin.framesForwardKinematics(self.model, self._data, self._q)
        self._shoulder_R_world = self._data.oMf[self.model.getFrameId(self.frame)].rotation.T.copy()
        self.carry(load)

    def __reduce__(self) -> tuple[type[ArmDynamics], tuple[Description, Side, DriveParameters, Load | None]]:
        return ArmDynamics, (self._description, self.side, self.drives, self.load)  # pinocchio's own state is scratch

    def carry(self, load: Load | None) -> None:
        """Hold a load from now on; None for nothing."""
        self.load, hand = load, self._hand
        if load is not None:
            at = self.model.frames[self._ee].placement.act(np.array(load.com_m))
            hand = hand + pin.Inertia(load.mass_kg, at, np.zeros((3, 3)))
        self.model.inertias[self.model.njoints - 1] = hand

    def gravity(self, q_rad: Array) -> Array:
        """Return the torques that hold the arm up at joint positions, shape (7,) [N·m]."""
        return self._gravity(self._at(q_rad)).copy()

    def torques(
        self, q_rad: Array, dq_radps: Array, ddq_radps2: Array, base: Vector = (), base_accelerates: Vector = ()
    ) -> Array:
        """Return the torques of a motion without friction, shape (7,) [N·m], by the recursive Newton-Euler algorithm.

        Args:
            q_rad: Joint positions, shape (7,) [rad].
            dq_radps: Joint velocities, shape (7,) [rad/s].
            ddq_radps2: Joint accelerations, shape (7,) [rad/s²].
            base: Velocities of the base, lift last; what is left out is at rest.
            base_accelerates: Its accelerations, likewise [m/s², rad/s²].
        """
        v = self._moving(dq_radps, base)
        a = np.zeros(self.model.nv)
        a[: len(base_accelerates)], a[self._given :] = base_accelerates, ddq_radps2
        torques: Array = pin.rnea(self.model, self._data, self._at(q_rad), v, a)
        return torques[self._given :].copy()

    def terms(self, q_rad: Array, dq_radps: Array, base: Vector = ()) -> Terms:
        """Return what an observer of the momentum needs; arguments as for `torques`."""
        q, v, arm = self._at(q_rad), self._moving(dq_radps, base), slice(self._given, None)
        masses = pin.crba(self.model, self._data, q)[arm]
        momentum, own = masses @ v, masses[:, arm].copy()
        # dT/dq = C'v with Christoffel's C: the momentum needs no acceleration, not even that of the base.
        drift = v @ pin.computeCoriolisMatrix(self.model, self._data, q, v)[:, arm]
        gravity = self._gravity(q).copy()
        return Terms(momentum, drift - gravity, gravity, own)

    def regressor(self, q_rad: Array, dq_radps: Array, ddq_radps2: Array) -> Array:
        """Return torques per what the links are heavier by, shape (7, 28) [N·m/kg, N·m/(kg·m)], on a base at rest.

        Columns are those of `DriveParameters.heavier`, link by link: mass and first moments. Moments of inertia are left as
        described: behind rotors like these nobody finds them.
        """
        a = np.zeros(self.model.nv)
        a[self._given :] = ddq_radps2
        whole = pin.computeJointTorqueRegressor(self.model, self._data, self._at(q_rad), self._moving(dq_radps, ()), a)
        links: Array = whole[self._given :, PARAMETERS * self._given :].reshape(ARM_DOF, ARM_DOF, PARAMETERS)
        return links[:, :, :MOMENTS].reshape(ARM_DOF, MOMENTS * ARM_DOF)

    def jacobian(self, q_rad: Array) -> Array:
        """Return velocity [m/s] and angular velocity [rad/s] of the hand in the shoulder's axes per joint's, shape (6, 7)."""
        q, turn = self._at(q_rad), self._shoulder_R_world
        seen = pin.computeFrameJacobian(self.model, self._data, q, self._ee, pin.LOCAL_WORLD_ALIGNED)[:, self._given :]
        jacobian: Array = np.concatenate((turn @ seen[:3], turn @ seen[3:]))
        return jacobian

    def load_columns(self, q_rad: Array) -> Array:
        """Return the torques that the weight of a load pulls the joints with, shape (7, 4) [N·m/kg, N·m/(kg·m)].

        Columns are per mass, and per first moments along x, y, z of the end effector's frame (`point`) about its origin.
        """
        turning = self.jacobian(q_rad).T
        pin.updateFramePlacement(self.model, self._data, self._ee)
        shoulder_R_ee = self._shoulder_R_world @ self._data.oMf[self._ee].rotation
        g_mps2 = self._shoulder_R_world @ self.model.gravity.linear
        return np.column_stack((turning[:, :3] @ g_mps2, turning[:, 3:] @ np.cross(shoulder_R_ee.T, g_mps2).T))

    def _gravity(self, q: Array) -> Array:
        gravity: Array = pin.computeGeneralizedGravity(self.model, self._data, q)
        return gravity[self._given :]

    def _at(self, q_rad: Array) -> Array:
        self._q[self._given :] = q_rad
        return self._q

    def _moving(self, dq_radps: Array, base: Vector) -> Array:
        self._v[: self._given] = 0.0
        self._v[: len(base)], self._v[self._given :] = base, dq_radps
        return self._v


def _model(description: Description, side: Side) -> Any:  # noqa: ANN401  pinocchio has no types
    """Return base, lift and one arm, everything else fixed where it is at zero."""
    body = pin_model(description)
    moving = {arm_joint(side, number) for number in range(1, ARM_DOF + 1)}
    moving |= {joint.name for joint in description.joints.values() if joint.kind is Kind.PRISMATIC}
    fixed = [body.getJointId(name) for name in list(body.names)[1:] if name not in moving]
    arm = pin.buildReducedModel(body, fixed, pin.neutral(body))
    base, index = pin.Model(), 0
    for name, kind in BASE:
        index = base.addJoint(index, kind(), pin.SE3.Identity(), name)
    return pin.appendModel(base, arm, base.addJointFrame(index), pin.SE3.Identity())
