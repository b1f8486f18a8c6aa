"""`with robot.stop_endpoint() as endpoint`: watching over the robot, in the blocking client."""

from __future__ import annotations

from gateway.client.asking.attendance import Attendance
from gateway.client.blocking import run

__all__ = ["StopEndpoint"]


class StopEndpoint(Attendance):
    """A stop endpoint: while it is registered and not heard, nothing moves. Made by `Robot.stop_endpoint`.

    A `with` block that ends normally leaves in order. One that is left by an exception, or by Ctrl-C, does not: the robot is
    held as soon as its period is over, or this client closes.
    """

    def register(self) -> StopEndpoint:
        """Promise to be heard; what `with` does.

        Raises:
            Rejected: OUT_OF_RANGE, the period.
            NotReady: TOO_MANY_ENDPOINTS; the message names them.
        """
        run(self._session, self._register())
        return self

    def leave(self) -> None:
        """Take the promise back: what goes on goes on. Does nothing when it was not registered."""
        run(self._session, self._leave())

    def __enter__(self) -> StopEndpoint:
        return self.register()

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        if kind is None:
            self.leave()
