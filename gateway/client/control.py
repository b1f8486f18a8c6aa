"""Owning the robot: `with robot.control() as own`, its arms, motions and streams. The blocking half of `client`."""

from __future__ import annotations

from gateway.api import protocol
from gateway.client.asking.arm_commands import ArmCommands
from gateway.client.asking.commands import MotionCommands
from gateway.client.asking.options import OnExitName
from gateway.client.asking.ownership import Accepted
from gateway.client.asking.procedures import Procedure
from gateway.client.blocking import run
from gateway.client.connection.session import Session
from gateway.client.handles import JointStream, MotionHandle, PoseStream
from gateway.client.parts import ChassisControl, GripperControl, LiftControl

__all__ = ["ArmControl", "Control"]


class ArmControl(ArmCommands[MotionHandle, None, JointStream, PoseStream]):
    """One arm of a `Control`."""

    _joint_stream = JointStream
    _pose_stream = PoseStream


class Control(MotionCommands[MotionHandle, None]):
    """The right to command the robot. Made by `Robot.control`; use it in a `with` block.

    Attributes:
        left_arm: The left arm.
        right_arm: The right arm.
        left_gripper: The left gripper.
        right_gripper: The right gripper.
        chassis: The chassis.
        lift: The lift, on the model that has one.
    """

    def __init__(
        self,
        session: Session,
        on_loss: protocol.OnLossName,
        on_exit: OnExitName,
        take: str | None,
        timeout_ns: int,
    ) -> None:
        super().__init__(session, on_loss, on_exit, take, timeout_ns)
        self.left_arm = ArmControl(self, "left")
        self.right_arm = ArmControl(self, "right")
        self.left_gripper = GripperControl(self, "left")
        self.right_gripper = GripperControl(self, "right")
        self.chassis = ChassisControl(self)
        self.lift = LiftControl(self)

    def acquire(self) -> Control:
        """Become the owner; what `with` does.

        Raises:
            LeaseError: LEASE_HELD, somebody else owns the robot; the message says who and since when.
        """
        run(self._session, self._acquire())
        return self

    def __enter__(self) -> Control:
        return self.acquire()

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        if kind is None:
            run(self._session, self._end())
        else:
            self._break_off()

    def _do(self, procedure: Procedure[None]) -> None:
        run(self._session, procedure)

    def _begin(self, procedure: Procedure[Accepted]) -> MotionHandle:
        return MotionHandle(*run(self._session, procedure))
