"""Owning the robot under asyncio: the twin of `control`, class for class, which documents what each method does.

Import these names from `gateway.client.aio`.
"""

from __future__ import annotations

import asyncio
from collections.abc import Generator, Mapping
from types import TracebackType
from typing import TYPE_CHECKING, Any, Literal, TypeVar, overload

from gateway.api import protocol
from gateway.client.aio_parts import ChassisControl, GripperControl, LiftControl
from gateway.client.awaiting import run
from gateway.client.chunks import Tolerance, Wishes
from gateway.client.door import OnExitName
from gateway.client.motion import MotionRecord
from gateway.client.ownership import Ownership
from gateway.client.poses import PoseLike, PoseTarget, frame_of, require_space
from gateway.client.procedures import MotionResult
from gateway.client.session import Session
from gateway.client.stream import JointTargets, PoseTargets, StreamOptions, TargetStream
from gateway.errors import GatewayError

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

__all__ = ["ArmControl", "Control", "JointStream", "MotionHandle", "PoseStream"]


StreamT = TypeVar("StreamT", bound=TargetStream)


class Control(Ownership):
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

    async def release(self) -> None:
        """Brake, rest, pause the robot, and give the lease back."""
        await run(self._session, self._release())

    async def leave(self) -> None:
        """Leave the robot held, as if this client had vanished."""
        await run(self._session, self._leave())

    async def __aenter__(self) -> Control:
        return await self.acquire()

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if kind is not None:
            self._break_off()
            return
        try:
            await run(self._session, self._end())
        except asyncio.CancelledError:
            self._break_off()
            raise

    async def enable(self, timeout: float = 12.0) -> None:
        """Bring the robot's FSM to READY and wait until it is there."""
        await run(self._session, self._enable(timeout))

    async def disable(self, timeout: float = 10.0) -> None:
        """Brake to rest and pause the robot's FSM; the lease stays."""
        await run(self._session, self._disable(timeout))

    async def hold(self) -> None:
        """Brake both arms and hold them."""
        await run(self._session, self._hold())

    async def move_to(
        self,
        targets: Mapping[str, ArrayLike],
        *,
        speed: float = 1.0,
        tolerance: float | None = None,
        on_limit: protocol.OnLimitName = "reject",
    ) -> MotionHandle:
        """Move one or both arms to joint positions [rad]; returns when it was accepted."""
        return MotionHandle(*await run(self._session, self._move(targets, False, speed, tolerance, on_limit)))

    async def move_by(
        self,
        offsets: Mapping[str, ArrayLike],
        *,
        speed: float = 1.0,
        tolerance: float | None = None,
        on_limit: protocol.OnLimitName = "reject",
    ) -> MotionHandle:
        """Move one or both arms by offsets from where they are being held [rad]."""
        return MotionHandle(*await run(self._session, self._move(offsets, True, speed, tolerance, on_limit)))

    async def follow(
        self,
        points: Mapping[str, ArrayLike],
        dt: float | None = None,
        *,
        frames: Mapping[str, str] | None = None,
        times: ArrayLike | None = None,
        start_at: float | None = None,
        start_in: float | None = None,
        open_end: bool = False,
        stretch: float = 1.0,
        smoothing: float = 0.0,
        path_tolerance: Tolerance = None,
        goal_tolerance: Tolerance = None,
        goal_time: float | None = None,
    ) -> MotionHandle:
        """Follow points, shape (N, 7) [rad], with one or both arms on one clock; returns when they were accepted."""
        wishes: Wishes = {
            "frames": frames,
            "times": times,
            "start_at": start_at,
            "start_in": start_in,
            "open_end": open_end,
            "stretch": stretch,
            "smoothing": smoothing,
            "path_tolerance": path_tolerance,
            "goal_tolerance": goal_tolerance,
            "goal_time": goal_time,
        }
        return MotionHandle(*await run(self._session, self._follow(points, dt, wishes)))

    async def move_pose(
        self,
        targets: Mapping[str, PoseLike],
        *,
        speed: float = 1.0,
        tolerance_m: float | None = None,
        tolerance_rad: float | None = None,
        on_limit: protocol.OnLimitName = "reject",
    ) -> MotionHandle:
        """Move one or both end effectors to poses; returns when it was accepted."""
        accepted = await run(
            self._session, self._move_pose(targets, False, speed, tolerance_m, tolerance_rad, on_limit)
        )
        return MotionHandle(*accepted)

    async def move_linear(
        self,
        targets: Mapping[str, PoseLike],
        *,
        speed: float = 1.0,
        tolerance_m: float | None = None,
        tolerance_rad: float | None = None,
        on_limit: protocol.OnLimitName = "reject",
    ) -> MotionHandle:
        """Move one or both end effectors straight to poses, in either control mode; returns when it was accepted."""
        accepted = await run(self._session, self._move_pose(targets, True, speed, tolerance_m, tolerance_rad, on_limit))
        return MotionHandle(*accepted)


class ArmControl:
    """One arm of a `Control`. As `client.ArmControl`."""

    def __init__(self, control: Control, side: protocol.SideName) -> None:
        self._control = control
        self.side = side

    def __repr__(self) -> str:
        """Show which arm of which control."""
        return f"<{self.side} arm of {self._control!r}>"

    async def move_to(
        self,
        q: ArrayLike,
        *,
        speed: float = 1.0,
        tolerance: float | None = None,
        on_limit: protocol.OnLimitName = "reject",
    ) -> MotionHandle:
        """Move this arm to seven joint positions [rad]."""
        return await self._control.move_to({self.side: q}, speed=speed, tolerance=tolerance, on_limit=on_limit)

    async def move_by(
        self,
        dq: ArrayLike,
        *,
        speed: float = 1.0,
        tolerance: float | None = None,
        on_limit: protocol.OnLimitName = "reject",
    ) -> MotionHandle:
        """Move this arm by seven joint offsets [rad]."""
        return await self._control.move_by({self.side: dq}, speed=speed, tolerance=tolerance, on_limit=on_limit)

    async def follow(
        self,
        points: ArrayLike,
        dt: float | None = None,
        *,
        frame: str | None = None,
        times: ArrayLike | None = None,
        start_at: float | None = None,
        start_in: float | None = None,
        open_end: bool = False,
        stretch: float = 1.0,
        smoothing: float = 0.0,
        path_tolerance: Tolerance = None,
        goal_tolerance: Tolerance = None,
        goal_time: float | None = None,
    ) -> MotionHandle:
        """Follow points with this arm, shape (N, 7), joints [rad] or poses; returns when they were accepted."""
        return await self._control.follow(
            {self.side: points},
            dt,
            frames=None if frame is None else {self.side: frame},
            times=times,
            start_at=start_at,
            start_in=start_in,
            open_end=open_end,
            stretch=stretch,
            smoothing=smoothing,
            path_tolerance=path_tolerance,
            goal_tolerance=goal_tolerance,
            goal_time=goal_time,
        )

    async def move_pose(
        self,
        p: ArrayLike,
        quat_xyzw: ArrayLike,
        *,
        frame: str,
        speed: float = 1.0,
        tolerance_m: float | None = None,
        tolerance_rad: float | None = None,
        on_limit: protocol.OnLimitName = "reject",
    ) -> MotionHandle:
        """Move this arm's end effector to a pose in its own shoulder frame."""
        return await self._control.move_pose(
            {self.side: PoseTarget(p, quat_xyzw, frame)},
            speed=speed,
            tolerance_m=tolerance_m,
            tolerance_rad=tolerance_rad,
            on_limit=on_limit,
        )

    async def move_linear(
        self,
        p: ArrayLike,
        quat_xyzw: ArrayLike,
        *,
        frame: str,
        speed: float = 1.0,
        tolerance_m: float | None = None,
        tolerance_rad: float | None = None,
        on_limit: protocol.OnLimitName = "reject",
    ) -> MotionHandle:
        """Move this arm's end effector straight to a pose, in either control mode."""
        return await self._control.move_linear(
            {self.side: PoseTarget(p, quat_xyzw, frame)},
            speed=speed,
            tolerance_m=tolerance_m,
            tolerance_rad=tolerance_rad,
            on_limit=on_limit,
        )

    async def hold(self) -> None:
        """Brake this arm and hold it."""
        await run(self._control._session, self._control._hold((self.side,)))

    @overload
    def stream(
        self,
        space: Literal["joint"] = "joint",
        rate_hz: float = 50.0,
        *,
        speed: float = 1.0,
        on_limit: protocol.OnLimitName = "reject",
        expiry: float | None = None,
    ) -> JointStream: ...

    @overload
    def stream(
        self,
        space: Literal["pose"],
        rate_hz: float = 50.0,
        *,
        frame: str,
        speed: float = 1.0,
        on_limit: protocol.OnLimitName = "reject",
        expiry: float | None = None,
    ) -> PoseStream: ...

    def stream(
        self,
        space: protocol.SpaceName = "joint",
        rate_hz: float = 50.0,
        *,
        frame: str | None = None,
        speed: float = 1.0,
        on_limit: protocol.OnLimitName = "reject",
        expiry: float | None = None,
    ) -> JointStream | PoseStream:
        """Return a stream of targets for this arm, to be used in `async with`. As `client.ArmControl.stream`."""
        require_space(space)
        owner, how = self._control, StreamOptions(rate_hz=rate_hz, speed=speed, on_limit=on_limit, expiry=expiry)
        if space == "joint":
            return JointStream(owner._session, owner._owned(), self.side, how)
        return PoseStream(owner._session, owner._owned(), self.side, how, frame_of(self.side, frame))


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
        """Wait for the next instant of the grid; raises when the stream has ended or a target was refused."""
        await run(self._session, self._tick())

    async def __aenter__(self: StreamT) -> StreamT:
        await run(self._session, self._open())
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            await run(self._session, self._close())
        except GatewayError:
            if kind is None:  # else the error that ended the block is the one to tell
                raise


class JointStream(JointTargets, _AsyncStream):
    """A stream of joint targets; `set` does not wait, `tick` does. As `client.JointStream`."""


class PoseStream(PoseTargets, _AsyncStream):
    """A stream of poses; `set` does not wait, `tick` does. As `client.PoseStream`."""
