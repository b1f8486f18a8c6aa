"""Owning the robot under asyncio: the twin of `control`, class for class, which documents what each method does.

Import these names from `gateway.client.aio`.
"""

from __future__ import annotations

import asyncio
from collections.abc import Coroutine, Generator
from typing import Any, Literal, TypeVar

from gateway.api import protocol
from gateway.client.aio_parts import ChassisControl, GripperControl, LiftControl
from gateway.client.asking.arm_commands import ArmCommands
from gateway.client.asking.commands import MotionCommands
from gateway.client.asking.motion import MotionRecord
from gateway.client.asking.options import OnExitName
from gateway.client.asking.ownership import Accepted
from gateway.client.asking.procedures import Procedure
from gateway.client.asking.results import MotionResult, Payload
from gateway.client.asking.stream import JointTargets, PoseTargets, TargetStream
from gateway.client.awaiting import run
from gateway.client.connection.session import Session
from gateway.errors import GatewayError

__all__ = ["ArmControl", "Control", "JointStream", "MotionHandle", "PoseStream"]


StreamT = TypeVar("StreamT", bound=TargetStream)


class MotionHandle(MotionRecord):
    """A motion that was accepted; awaiting it is `result()`."""

    def __await__(self) -> Generator[Any, None, MotionResult]:
        return self.result().__await__()

    async def result(self, timeout: float = 60.0) -> MotionResult:
        """Wait until the motion has ended well. As `client.MotionHandle.result`."""
        return await run(self._session, self._result(timeout))

    async def cancel(self, timeout: float = 5.0) -> None:
        """Brake and end the motion; waits until the arms' references stand still."""
        await run(self._session, self._cancel(timeout))


class _AsyncStream(TargetStream):
    """What both streams wait for, under asyncio."""

    async def tick(self) -> None:
        """Wait for the next instant, as the blocking one; raises when the stream has ended or a target was refused."""
        await run(self._session, self._tick())

    async def __aenter__(self: StreamT) -> StreamT:
        await run(self._session, self._open())
        return self

    async def __aexit__(self, kind: type[BaseException] | None, *_: object) -> None:
        try:
            await run(self._session, self._close())
        except GatewayError:
            if kind is None:  # else the error that ended the block is the one to tell
                raise


class JointStream(JointTargets, _AsyncStream):
    """A stream of joint targets; `set` does not wait, `tick` does. As `client.JointStream`."""


class PoseStream(PoseTargets, _AsyncStream):
    """A stream of poses; `set` does not wait, `tick` does. As `client.PoseStream`."""


class ArmControl(ArmCommands[Coroutine[Any, Any, MotionHandle], Coroutine[Any, Any, None], JointStream, PoseStream]):
    """One arm of a `Control`. As `client.ArmControl`."""

    _joint_stream = JointStream
    _pose_stream = PoseStream

    async def payload(
        self, known: Payload | Literal["weigh"] | None = "weigh", *, empty: Payload | None = None
    ) -> Payload:
        """Weigh what this hand holds, and count on it; or on what is known, None for an empty hand."""
        from gateway.client.weighing import payload

        return await run(self._control._session, payload(self._control, self.side, known, empty))


class Control(MotionCommands[Coroutine[Any, Any, MotionHandle], Coroutine[Any, Any, None]]):
    """The right to command the robot. As `client.Control`.

    Attributes:
        left_arm: The left arm.
        right_arm: The right arm.
        left_gripper: The left gripper.
        right_gripper: The right gripper.
        chassis: The chassis.
        lift: The lift, on the model that has one.
    """

    def __init__(
        self, session: Session, on_loss: protocol.OnLossName, on_exit: OnExitName, take: str | None, timeout_ns: int
    ) -> None:
        super().__init__(session, on_loss, on_exit, take, timeout_ns)
        self.left_arm = ArmControl(self, "left")
        self.right_arm = ArmControl(self, "right")
        self.left_gripper = GripperControl(self, "left")
        self.right_gripper = GripperControl(self, "right")
        self.chassis = ChassisControl(self)
        self.lift = LiftControl(self)

    async def acquire(self) -> Control:
        """Become the owner; what `async with` does."""
        await run(self._session, self._acquire())
        return self

    async def __aenter__(self) -> Control:
        return await self.acquire()

    async def __aexit__(self, kind: type[BaseException] | None, *_: object) -> None:
        if kind is not None:
            self._break_off()
            return
        try:
            await run(self._session, self._end())
        except asyncio.CancelledError:
            self._break_off()
            raise

    async def _do(self, procedure: Procedure[None]) -> None:
        await run(self._session, procedure)

    async def _begin(self, procedure: Procedure[Accepted]) -> MotionHandle:
        return MotionHandle(*await run(self._session, procedure))
