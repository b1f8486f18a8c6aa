"""Owning the robot: `with robot.control() as own`, its arms, motions and streams. The blocking half of `client`."""

from __future__ import annotations

from collections.abc import Mapping
from types import TracebackType
from typing import TYPE_CHECKING

from gateway.api import protocol
from gateway.client.blocking import run
from gateway.client.door import OnExitName
from gateway.client.motion import MotionRecord
from gateway.client.ownership import Ownership
from gateway.client.procedures import MotionResult
from gateway.client.session import Session
from gateway.client.stream import TargetStream
from gateway.errors import GatewayError

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

__all__ = ["ArmControl", "Control", "JointStream", "MotionHandle"]


class Control(Ownership):
    """The right to command the robot. Made by `Robot.control`; use it in a `with` block.

    Attributes:
        left_arm: The left arm.
        right_arm: The right arm.
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

    def acquire(self) -> Control:
        """Become the owner; what `with` does.

        Raises:
            LeaseError: LEASE_HELD, somebody else owns the robot; the message says who and since when.
        """
        run(self._session, self._acquire())
        return self

    def release(self) -> None:
        """Brake, rest, pause the robot, and give the lease back. Nothing happens when it is already gone.

        Raises:
            GatewayTimeout: The robot did not come to rest in time; it is still braking or pausing.
        """
        run(self._session, self._release())

    def leave(self) -> None:
        """Leave the robot held, as if this client had vanished: held for 60 s, free for others after 10 s."""
        run(self._session, self._leave())

    def __enter__(self) -> Control:
        return self.acquire()

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if kind is None:
            run(self._session, self._end())
        else:
            self._break_off()

    def enable(self, timeout: float = 12.0) -> None:
        """Bring the robot's FSM to READY; the arms are held where they are. Waits until it is there.

        Args:
            timeout: How long to wait [s]; the daemon itself gives up after 10 s and says what was missing.

        Raises:
            NotReady: What stands against it (mode, disabled arm, latch, stale state ...), at once or after 10 s.
            GatewayTimeout: Neither in time.
        """
        run(self._session, self._enable(timeout))

    def disable(self, timeout: float = 10.0) -> None:
        """Brake to rest and pause the robot's FSM; the grip is lost, the lease stays. Waits until it is done.

        Raises:
            GatewayTimeout: Not in time; it goes on.
        """
        run(self._session, self._disable(timeout))

    def hold(self) -> None:
        """Brake both arms and hold them; ends their motions as cancelled, and their streams."""
        run(self._session, self._hold())

    def move_to(
        self,
        targets: Mapping[str, ArrayLike],
        *,
        speed: float = 1.0,
        tolerance: float | None = None,
        on_limit: protocol.OnLimitName = "reject",
    ) -> MotionHandle:
        """Move one or both arms to joint positions, smoothly, all joints ending together. Does not wait for the end.

        Args:
            targets: Per side (`left`, `right`) seven joints [rad], in the order of manual §4.0.3.
            speed: Factor on the velocity limit, 0 < speed <= 1.
            tolerance: Reached when every joint is measured within this of its goal [rad]; None for the configured one.
            on_limit: `reject` refuses a goal outside the limits, `clip` moves it to the limit and reports it.

        Returns:
            The motion, accepted and under way.

        Raises:
            Rejected: The goal is wrong: WRONG_SHAPE, NOT_FINITE, OUT_OF_RANGE with joint, value and bound.
            NotReady: The robot or the gateway is not in a state for it.
            LeaseError: This control is over.
        """
        return MotionHandle(*run(self._session, self._move(targets, False, speed, tolerance, on_limit)))

    def move_by(
        self,
        offsets: Mapping[str, ArrayLike],
        *,
        speed: float = 1.0,
        tolerance: float | None = None,
        on_limit: protocol.OnLimitName = "reject",
    ) -> MotionHandle:
        """Move one or both arms by offsets from where they are being held [rad]; else as `move_to`."""
        return MotionHandle(*run(self._session, self._move(offsets, True, speed, tolerance, on_limit)))


class ArmControl:
    """One arm of a `Control`."""

    def __init__(self, control: Control, side: protocol.SideName) -> None:
        self._control = control
        self.side = side

    def move_to(
        self,
        q: ArrayLike,
        *,
        speed: float = 1.0,
        tolerance: float | None = None,
        on_limit: protocol.OnLimitName = "reject",
    ) -> MotionHandle:
        """Move this arm to seven joint positions [rad]; see `Control.move_to`."""
        return self._control.move_to({self.side: q}, speed=speed, tolerance=tolerance, on_limit=on_limit)

    def move_by(
        self,
        dq: ArrayLike,
        *,
        speed: float = 1.0,
        tolerance: float | None = None,
        on_limit: protocol.OnLimitName = "reject",
    ) -> MotionHandle:
        """Move this arm by seven joint offsets [rad]; see `Control.move_to`."""
        return self._control.move_by({self.side: dq}, speed=speed, tolerance=tolerance, on_limit=on_limit)

    def hold(self) -> None:
        """Brake this arm and hold it; ends its motion as cancelled, or its stream."""
        run(self._control._session, self._control._hold((self.side,)))

    def stream(
        self,
        rate_hz: float = 50.0,
        *,
        speed: float = 1.0,
        on_limit: protocol.OnLimitName = "reject",
        expiry: float | None = None,
    ) -> JointStream:
        """Return a stream of joint targets for this arm, to be used in a `with` block.

        Args:
            rate_hz: Rate of `tick` [Hz], 1 to 100; targets may also be set without ticking.
            speed: Factor on the velocity limit, 0 < speed <= 1.
            on_limit: `reject` refuses a target outside the limits, `clip` moves it to the limit.
            expiry: A target that has no successor for so long makes the arm brake and hold [s], 0.05 to 3; None for
                the configured time (1.5 s).
        """
        owner = self._control
        return JointStream(
            owner._session, owner._owned(), self.side, rate_hz=rate_hz, speed=speed, on_limit=on_limit, expiry=expiry
        )


class MotionHandle(MotionRecord):
    """A motion that was accepted. Dropping the handle does not end the motion."""

    def result(self, timeout: float = 60.0) -> MotionResult:
        """Wait until the motion has ended well.

        Args:
            timeout: How long to wait [s].

        Raises:
            Aborted: A fault, a stop or a loss ended it; `.code` says which. The arm braked and is held.
            Cancelled: `cancel()` or `hold()` ended it.
            Superseded: A later motion or stream took the arm over.
            GatewayTimeout: It has not ended yet, and goes on.
            Disconnected: The daemon is gone.
        """
        return run(self._session, self._result(timeout))

    def cancel(self, timeout: float = 5.0) -> None:
        """Brake and end the motion; waits until the arms' references stand still.

        Raises:
            GatewayTimeout: They do not in time.
            LeaseError: This control is over.
        """
        run(self._session, self._cancel(timeout))


class JointStream(TargetStream):
    """A stream of joint targets. Context manager; a normal end of the block makes the arm brake and hold."""

    def tick(self) -> None:
        """Wait for the next instant of the grid; a late one is skipped, not caught up.

        Raises:
            GatewayError: The stream has ended, or a target was refused; class, `.code` and message say why.
        """
        run(self._session, self._tick())

    def __enter__(self) -> JointStream:
        run(self._session, self._open())
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            run(self._session, self._close())
        except GatewayError:
            if kind is None:  # else the error that ended the block is the one to tell
                raise
