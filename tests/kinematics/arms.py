"""Forward kinematics for tests of the frames: the simulator's own geometry, which shares no code with the gateway's."""

from __future__ import annotations

from types import SimpleNamespace

from gateway.kinematics.transform import Transform
from gateway.sim.robot.geometry import arm_geometry
from gateway.sim.robot.manual import Side as SimSide
from gateway.values import ArmState, Side


class Witness:
    """One arm, by the simulator."""

    def __init__(self, side):
        self._arm = arm_geometry(SimSide(side.value))

    def forward(self, q_rad):
        """Return the end effector in the shoulder frame."""
        pose = self._arm.forward(q_rad)
        placed = Transform.of_quaternion("shoulder_T_ee", pose.position_m, pose.quat_xyzw)
        return SimpleNamespace(p_m=placed.p_m.tolist(), rows=placed.rotation.tolist())


WITNESSES = {side: Witness(side) for side in Side}


def joints_at(q_rad, stamp_ns=0):
    """Return measured joints of an arm."""
    return ArmState(q_rad=tuple(q_rad), dq_radps=(), tau_nm=(), stamp_ns=stamp_ns)
