"""Owning the robot: `with robot.control() as own`, its arms, motions and streams. The blocking half of `client`."""

from __future__ import annotations

from typing import Literal

from gateway.api import protocol
from gateway.client.asking.arm_commands import ArmCommands
from gateway.client.asking.commands import MotionCommands
from gateway.client.asking.options import OnExitName
from gateway.client.asking.ownership import Accepted
from gateway.client.asking.procedures import Procedure
from gateway.client.asking.results import Payload
from gateway.client.blocking import run
from gateway.client.connection.session import Session
from gateway.client.handles import JointStream, MotionHandle, PoseStream
from gateway.client.parts import ChassisControl, GripperControl, LiftControl

__all__ = ["ArmControl", "Control"]


class ArmControl(ArmCommands[MotionHandle, None, JointStream, PoseStream]):
    """One arm of a `Control`."""

    _joint_stream = JointStream
    _pose_stream = PoseStream

    def payload(self, known: Payload | Literal["weigh"] | None = "weigh", *, empty: Payload | None = None) -> Payload:
        """Weigh what this hand holds, and count on it: what pulls at the arm is told without it from then on.

        The arm swings slowly by 0.05 rad in three postures, for some 15 s: where it stands, and with its hand tilted by 0.3 rad
        about its wrist, twice. It ends where it began. Nothing but the load may touch it.

        Args:
            known: A payload to count on without weighing; None for an empty hand.
            empty: What this call gave with the empty hand, in the same posture: what the arm's masses, or its hand's, differ
                in from the model is then no part of the load.

        Returns:
            Mass and centre, with standard deviations. What may be nothing has no centre, and is not counted on.

        Raises:
            NotReady: CANNOT_WEIGH, the arm moves, feels nothing, does not swing, or these postures cannot tell; MODEL_OFF
                without dynamics; MODEL_DIFFERS, MODEL_UNKNOWN; what refuses `move_to`.
            Rejected: OUT_OF_RANGE, a payload that nobody believes, or a posture outside the limits.
            MotionEnded: Something ended a swing. The arm is held there, and nothing is counted on.
        """
        from gateway.client.weighing import payload  # by those who weigh alone

        return run(self._control._session, payload(self._control, self.side, known, empty))


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
