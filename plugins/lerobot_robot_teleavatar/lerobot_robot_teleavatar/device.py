"""What robot and leader have in common: being connected, and bearing short losses.

A loop of LeRobot ends with the first error, so a short loss raises none: meanwhile the gateway holds the robot.
"""

from __future__ import annotations

import logging
import time
from abc import abstractmethod
from collections.abc import Callable
from contextlib import ExitStack
from typing import Final

from gateway.client import Robot, RobotState
from gateway.errors import Code, GatewayError, Refusal, Stale, to_exception
from gateway.video.errors import VideoError
from lerobot.utils.errors import DeviceAlreadyConnectedError, DeviceNotConnectedError

__all__ = ["CONNECT_S", "Device", "Patience", "Sight"]

CONNECT_S: Final = 10.0
"""Longest wait for a first state, and for a first picture [s]."""
STALE_S: Final = 0.1
"""An arm's state that is older is a loss [s]."""

log = logging.getLogger(__name__)


class Device:
    """Connected or not; stands before LeRobot's own class among the bases."""

    _opened: ExitStack | None = None
    is_calibrated = True

    @property
    def is_connected(self) -> bool:
        """Whether it was connected and not disconnected since; it stays so in a loss."""
        return self._opened is not None

    def connect(self, calibrate: bool = True) -> None:
        """Connect; nothing is to be calibrated.

        Raises:
            DeviceAlreadyConnectedError: It is connected.
            DeviceNotConnectedError: What is missing or stands against it, in the gateway's words; nothing stays open.
        """
        del calibrate
        if self.is_connected:
            raise DeviceAlreadyConnectedError(f"{self} is connected")
        with ExitStack() as opened:
            try:
                self._open(opened)
            except (GatewayError, VideoError) as error:
                raise DeviceNotConnectedError(f"{self}: {error}") from error
            self._opened = opened.pop_all()

    @abstractmethod
    def _open(self, opened: ExitStack) -> None:
        """Connect; what must be undone goes on the stack."""

    def calibrate(self) -> None:
        """Do nothing: the robot calibrates itself."""

    def configure(self) -> None:
        """Do nothing: modes are set in the robot's system configuration (manual §2.3), limits in the gateway's."""

    def disconnect(self) -> None:
        """Undo what `connect` did. Raises `DeviceNotConnectedError` when it is not connected."""
        self._require_connected()
        opened, self._opened = self._opened, None
        if opened is not None:
            opened.close()

    def _require_connected(self) -> None:
        if not self.is_connected:
            raise DeviceNotConnectedError(f"{self} is not connected")


class Patience:
    """Tells a short loss from a long one.

    Args:
        what: Is lost, in words.
        most_s: So long it is borne [s].
    """

    def __init__(self, what: str, most_s: float) -> None:
        self._what, self._most_s = what, most_s
        self._since_s: float | None = None

    def well(self) -> None:
        """Nothing is lost, or nothing any more."""
        if self._since_s is not None:
            log.warning("%s: over after %.2f s", self._what, time.monotonic() - self._since_s)
            self._since_s = None

    def bear(self, error: GatewayError) -> None:
        """Bear a loss. Raises `DeviceNotConnectedError`, with the gateway's words, when it lasts for too long."""
        now_s = time.monotonic()
        if self._since_s is None:
            self._since_s = now_s
            log.warning("%s: %s", self._what, error)
        if now_s - self._since_s >= self._most_s:
            raise DeviceNotConnectedError(f"{self._what} for {now_s - self._since_s:.1f} s: {error}") from error


class Sight:
    """What is read of a robot, or was read last; waits for the first.

    Args:
        robot: To look at.
        read: Reads a state.
        patience_s: So long a loss is borne [s].

    Raises:
        GatewayError: Something of it is not heard within `CONNECT_S`, or the gateway is lost.
    """

    def __init__(self, robot: Robot, read: Callable[[RobotState], dict[str, float]], patience_s: float) -> None:
        self._robot, self._read, self._patience = robot, read, Patience("no new state of the robot", patience_s)
        end_s = time.monotonic() + CONNECT_S
        for state in robot.states(timeout=CONNECT_S):
            try:
                self._seen = self._young(state)
                break
            except Stale:
                if time.monotonic() > end_s:
                    raise

    def look(self) -> dict[str, float]:
        """Return the newest, never waiting; in a short loss the last. Raises `DeviceNotConnectedError` in a long one."""
        try:
            self._seen = self._young(self._robot.state)
            self._patience.well()
        except GatewayError as error:
            self._patience.bear(error)
        return dict(self._seen)

    def _young(self, state: RobotState) -> dict[str, float]:
        for arm in (state.left_arm, state.right_arm):
            if arm.age > STALE_S:
                message = f"the newest state of the {arm.name.replace('_', ' ')} is {arm.age:.2f} s old"
                raise to_exception(Refusal(code=Code.PART_STALE, message=message, field=arm.name))
        return self._read(state)
