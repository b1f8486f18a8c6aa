"""One arm with its gripper, as LeRobot's actions move it: by a stream that is opened anew after each end."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from gateway.client import ArmControl, GripperControl, JointStream
from gateway.errors import GatewayError, Rejected
from gateway.robot.vector_layout import command_of_effort, effort_of_command

__all__ = ["Arm"]

GRIP_STEP: Final = 0.005  # a smaller change of a gripper's command, 0..1, is not sent


class Arm:
    """An arm of an owned, enabled robot; `speed` is a factor on its velocity limit, 0 < speed <= 1.

    Attributes:
        sent: What is followed: seven joints [rad], where the arm is before the first target, and the gripper's torque [N·m].

    Raises:
        GatewayError: The arm cannot be moved, as where it is disabled (manual §2.3); with the remedy.
    """

    def __init__(self, arm: ArmControl, gripper: GripperControl, speed: float) -> None:
        self._arm, self._gripper, self._speed = arm, gripper, speed
        self._stream: JointStream | None = None
        self._grip: float | None = None
        self.sent = [*self._open().q.tolist(), 0.0]

    def _open(self) -> JointStream:
        self._stream, self._grip = self._arm.stream(speed=self._speed, on_limit="clip").__enter__(), None
        return self._stream

    def send(self, target: Sequence[float]) -> None:
        """Send a target; does not pace. A stream that was ended by a loss is opened anew, where the arm is held.

        Args:
            target: Seven joints [rad], and the torque of the gripper's motor [N·m], positive opens.

        Raises:
            ValueError: The torque is not a number; `Rejected`, a joint is none.
            GatewayError: It cannot be sent now; the arm is held, or the gripper keeps its torque. `sent` has what was sent.
        """
        grip = command_of_effort(target[7])
        if self._stream is not None:
            try:
                self._stream.check()
            except Rejected:
                raise
            except GatewayError:
                self._stream = None
        stream = self._stream or self._open()
        self.sent[:7] = stream.set(target[:7]).tolist()
        if self._grip is None or abs(grip - self._grip) > GRIP_STEP:
            self._gripper.set(grip)
            self._grip = grip
            self.sent[7] = effort_of_command(grip)
