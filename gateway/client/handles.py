"""What a motion or a stream is handed out as: to wait for, to cancel, to feed; the asyncio twins are in `aio_control`."""

from __future__ import annotations

from typing import TypeVar

from gateway.client.asking.motion import MotionRecord
from gateway.client.asking.results import MotionResult
from gateway.client.asking.stream import JointTargets, PoseTargets, TargetStream
from gateway.client.blocking import run
from gateway.errors import GatewayError

__all__ = ["JointStream", "MotionHandle", "PoseStream"]

StreamT = TypeVar("StreamT", bound=TargetStream)


class MotionHandle(MotionRecord):
    """A motion that was accepted. Dropping the handle does not end the motion."""

    def result(self, timeout: float = 60.0) -> MotionResult:
        """Wait until the motion has ended well, and after a touch at which it was to go back, until the hand is back.

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


class _BlockingStream(TargetStream):
    """What both streams wait for."""

    def tick(self) -> None:
        """Wait for the next instant: of a paced stream, where its next target is just in time; a late one is skipped.

        Raises:
            GatewayError: The stream has ended, or a target was refused; class, `.code` and message say why.
        """
        run(self._session, self._tick())

    def __enter__(self: StreamT) -> StreamT:
        run(self._session, self._open())
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        try:
            run(self._session, self._close())
        except GatewayError:
            if kind is None:  # else the error that ended the block is the one to tell
                raise


class JointStream(JointTargets, _BlockingStream):
    """A stream of joint targets. Context manager; a normal end of the block makes the arm brake and hold."""


class PoseStream(PoseTargets, _BlockingStream):
    """A stream of poses of an end effector. Context manager; a normal end makes the arm brake and hold."""
